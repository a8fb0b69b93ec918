"""Names of the files that a run writes and a report reads."""

from __future__ import annotations

TABLE = "results.parquet"
HEADLINES = "results.csv"
RUN = "run.json"
PARTS = "parts"
EXAMPLES = "examples"
