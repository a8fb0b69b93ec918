"""Import Matplotlib without the lists of properties in its documentation: a quarter of the time.

For the processes of commands. Who draws with Matplotlib of one's own reads these lists, and gets
them where this is not imported first.
"""

from __future__ import annotations

from matplotlib import artist


def _no_list(_artist: object) -> str:
    return ""


artist.kwdoc = _no_list
