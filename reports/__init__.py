"""Reports: figures, tables and one self-contained HTML page from the results of a run."""

from malus.reports.write import write_report

__all__ = ["write_report"]
