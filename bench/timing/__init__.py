"""Time and error of single parts, and the stress table."""
