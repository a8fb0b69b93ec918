"""Plan, run, score, gate and time suites; the command line. Stands on all other packages.

`malus` has the functions that users call; `run` here takes a Suite and writes no report.
`__init__.pyi` lists the names: they are imported when they are first used, so that `malus --help`
answers at once.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
