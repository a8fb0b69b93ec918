"""Scenes drawn at random from ranges and choices, and their division into training and test."""
