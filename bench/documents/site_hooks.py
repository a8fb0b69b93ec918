"""What MkDocs calls while it builds the site: pages made from the code, and pictures beside them.

Configured in `reports/mkdocs.yml`. MkDocs loads this file by its path.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mkdocs.structure.files import Files

ROOT = Path(__file__).parents[2]
TUTORIALS = ROOT / "reports" / "docs" / "tutorials"
GALLERY = ROOT / "reports" / "gallery"


def heading_anchor(heading: str, separator: str) -> str:
    """The anchor of a heading, as code hosts make it: links work there and on the site.

    Examples
    --------
    >>> heading_anchor("Facets, bounces and s3", "-")
    'facets-bounces-and-s3'
    """
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", separator)


def on_files(files: Files, *, config: Any) -> Files:
    """Add the pages that are made from the code, and the pictures of the gallery."""
    from mkdocs.structure.files import File

    for path, text in generated_pages().items():
        files.append(File.generated(config, path, content=text))
    for picture in sorted((*GALLERY.glob("*.png"), *GALLERY.glob("*.jpg"))):
        path = f"gallery/{picture.name}"
        files.append(File.generated(config, path, abs_src_path=str(picture)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Point to the gallery in the site: in the repository it lies beside the pages' folder."""
    return re.sub(r'([("])\.\./((?:\.\./)*gallery/)', r"\1\2", markdown)


def generated_pages() -> dict[str, str]:
    """Markdown of every page that no file holds, by its path on the site."""
    from malus.bench.documents.command_pages import command_page
    from malus.bench.documents.reference_pages import (
        api_pages,
        list_page,
        metric_page,
        suite_page,
    )
    from malus.bench.documents.tutorial_pages import tutorial_page

    pages = {
        "reference/commands.md": command_page(),
        "reference/suites.md": suite_page(),
        "reference/metrics.md": metric_page(),
        "reference/lists.md": list_page(),
        "gallery.md": gallery_page(),
        "project/contributing.md": (ROOT / "CONTRIBUTING.md").read_text("utf-8"),
        "project/changes.md": (ROOT / "CHANGELOG.md").read_text("utf-8"),
    }
    pages |= {f"reference/api_{name}.md": text for name, text in api_pages().items()}
    for script in sorted(TUTORIALS.glob("*.py")):
        pages[f"tutorials/{script.stem}.md"] = tutorial_page(script.read_text("utf-8"))
    return pages


def gallery_page() -> str:
    """Markdown of the sheets that the repository holds.

    Examples
    --------
    >>> "gallery/photo.jpg" in gallery_page()
    True
    """
    sheets = sorted(path for path in GALLERY.glob("*.jpg") if path.stem != "photo")
    shown = [GALLERY / "photo.jpg", *sheets]
    parts = [_GALLERY]
    for path in shown:
        address = f"gallery/{path.name}"
        parts.append(f"## {path.stem.title()}\n\n[![{path.stem}]({address})]({address})")
    return "\n\n".join(parts)


_GALLERY = """# Gallery

Every picture is rendered from suites in the repository: `make gallery` draws all of them anew.
Beside a colour picture stands its degree of polarisation, each with a scale of its own. A click
shows a picture in full."""
