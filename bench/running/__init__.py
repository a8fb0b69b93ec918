"""From a suite to its results: plan the families, do the work, keep parts, write the table."""
