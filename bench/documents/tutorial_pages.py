"""Tutorials are Python scripts; their pages show comments as prose, and the code between them."""

from __future__ import annotations

import re

CELL = re.compile(r"^# %%(.*)$", re.MULTILINE)


def tutorial_page(script: str) -> str:
    r"""Markdown of a script in cells: `# %% [markdown]` starts prose, `# %%` code.

    Examples
    --------
    >>> print(tutorial_page("# %% [markdown]\n# # Title\n# Words.\n# %%\nx = 1\n"))
    # Title
    Words.
    <BLANKLINE>
    ```python
    x = 1
    ```
    """
    parts = CELL.split(script)
    cells = zip(parts[1::2], parts[2::2], strict=True)
    return "\n\n".join(
        _prose(text) if "[markdown]" in kind else f"```python\n{text.strip()}\n```"
        for kind, text in cells
    )


def _prose(text: str) -> str:
    return re.sub(r"^# ?", "", text.strip(), flags=re.MULTILINE)
