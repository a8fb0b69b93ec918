"""Datasets from rendering to score: render, export, predictions made elsewhere."""
