"""How much memory a command took."""

from __future__ import annotations

import sys


def peak_memory() -> int:
    """Peak resident bytes of this process plus those of its largest child that has ended.

    Zero on Windows, which does not tell.

    Examples
    --------
    >>> peak_memory() >= 0
    True
    """
    try:
        import resource
    except ImportError:
        return 0
    unit = 1 if sys.platform == "darwin" else 1024
    asked = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(resource.getrusage(who).ru_maxrss for who in asked) * unit
