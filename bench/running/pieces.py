"""Tables of many families as one file, in pieces: memory holds a piece."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import BinaryIO

import pandas as pd

GROUP_ROWS = 100_000
"""Rows that are held before they are written: some 30 MB."""


def headlines(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of a table over all bands and angles."""
    return table[table.band_nm.isna() & table.angle_deg.isna()]


def stream(tables: Iterable[pd.DataFrame], parquet: Path, csv: Path) -> None:
    """Write tables as one Parquet file, and their headline rows as CSV."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    with ExitStack() as stack:
        lines = stack.enter_context(csv.open("w", encoding="utf-8", newline=""))
        writer = None
        for table in _groups(tables):
            table.attrs = {}  # those of one family
            group = pa.Table.from_pandas(table, preserve_index=False)
            if writer is None:
                writer = stack.enter_context(pq.ParquetWriter(parquet, group.schema))
            writer.write_table(group.cast(writer.schema))
            rows = headlines(table).drop(columns=["band_nm", "angle_deg"])
            rows.to_csv(lines, index=False, header=lines.tell() == 0)


def read_compact(parquet: BinaryIO) -> pd.DataFrame:
    """A table whose text is categories: few names, many times; a fifth of the memory.

    Columns are read one after the other, so that one at most is held twice.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields = pq.read_schema(parquet)
    texts = [
        f.name for f in fields if pa.types.is_string(f.type) or pa.types.is_large_string(f.type)
    ]
    with pq.ParquetFile(parquet, read_dictionary=texts) as file:
        columns = {name: file.read([name]).column(0).to_pandas() for name in fields.names}
    return pd.DataFrame(columns, copy=False)


def _groups(tables: Iterable[pd.DataFrame]) -> Iterator[pd.DataFrame]:
    """Tables joined to some `GROUP_ROWS` rows: small groups would make a long index."""
    waiting: list[pd.DataFrame] = []
    for table in tables:
        waiting.append(table)
        if sum(map(len, waiting)) >= GROUP_ROWS:
            yield pd.concat(waiting, ignore_index=True)
            waiting.clear()
    if waiting:
        yield pd.concat(waiting, ignore_index=True)
