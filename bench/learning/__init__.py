"""Train a small network that tells polarisation from one picture, on datasets of malus."""
