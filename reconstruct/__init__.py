"""Methods that estimate polarisation components from one unpolarised image; none sees a truth.

`__init__.pyi` lists the names; those whose modules take long to import are imported when they are
first used.
"""

from lazy_loader import attach_stub

# `methods` is a function here: imported first, it is not taken for the module of that name.
from malus.reconstruct.methods import methods as methods

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
