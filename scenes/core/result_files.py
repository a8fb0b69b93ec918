"""Names of the files and folders of a run, which `bench` writes and `reports` reads."""

from __future__ import annotations

TABLE = "results.parquet"
HEADLINES = "results.csv"
RUN = "run.json"
PARTS = "parts"
EXAMPLES = "examples"
