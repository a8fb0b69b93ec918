"""The tables and sentences of a report, as numbers and as text."""
