"""Benchmarks and studies that make tables of their own."""
