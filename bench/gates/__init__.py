"""Accuracy against a reviewed baseline."""
