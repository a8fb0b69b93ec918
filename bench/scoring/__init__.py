"""Scores of a method on a truth: errors, skill, colour difference, the ladder of knowledge."""
