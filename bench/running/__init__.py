"""A suite from plan to table: families, engines, parts, results."""
