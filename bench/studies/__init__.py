"""Studies and benchmarks: they measure fixed cases and make tables of their own."""
