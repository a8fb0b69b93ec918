"""What a user would write in plain Mitsuba, for the benchmark that compares it with malus."""
