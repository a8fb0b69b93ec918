"""Renders in plain Mitsuba and a profiler, for the benchmark of malus' own renderer."""
