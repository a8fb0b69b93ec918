"""The HTML of a report, as templates."""
