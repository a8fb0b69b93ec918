"""Results into figures, tables and one self-contained page. Reads results only."""

from malus.reports.write import write_report

__all__ = ["write_report"]
