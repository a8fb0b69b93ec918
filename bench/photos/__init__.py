"""Photographs: a virtual filter, captures, picture files."""
