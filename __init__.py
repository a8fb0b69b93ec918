"""Synthetic ground truth for methods that tell polarisation from one unpolarised image."""
