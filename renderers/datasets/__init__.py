"""Write and read truths: datasets, scene folders, spectral OpenEXR."""
