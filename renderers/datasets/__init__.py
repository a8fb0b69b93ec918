"""Truths on disk: datasets, scene folders, spectral OpenEXR."""
