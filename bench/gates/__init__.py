"""The gate: accuracy of a run against a reviewed baseline."""
