"""Give names to what the theme and sphinx-gallery leave without: toggles, links of thumbnails, empty cells of tables."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx

_TOGGLE = (
    '<summary><span class="toctree-toggle"',
    '<summary aria-label="Pages below"><span class="toctree-toggle"',
)
# The text of a thumbnail's link is hidden behind the picture.
_THUMBNAIL = re.compile(
    r'<a class="reference internal" (href="[^"]*")><span class="doc">([^<]*)</span></a></p>'
)
_EMPTY = re.compile(
    r"<th class=\"(head[^\"]*)\">(<p></p>)?</th>"
)  # as a table of two columns has without a title


def named(page: str) -> str:
    """Return a page with names for its toggles and thumbnails, and plain cells for empty headers."""
    page = _THUMBNAIL.sub(
        r'<a class="reference internal" \1 aria-label="\2"><span class="doc">\2</span></a></p>',
        page.replace(*_TOGGLE),
    )
    return _EMPTY.sub(r'<td class="\1"></td>', page)


def _finish(app: Sphinx, error: Exception | None) -> None:
    if error is not None or app.builder.format != "html":
        return
    for file in Path(app.outdir).rglob("*.html"):
        before = file.read_text(encoding="utf-8")
        if (after := named(before)) != before:
            file.write_text(after, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Do so when the site is built."""
    app.connect("build-finished", _finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
