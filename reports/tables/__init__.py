"""The tables and sentences of a report, as plain cells."""
