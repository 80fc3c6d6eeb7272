"""Links of pages to the gallery: to its sources, which are there without a build, and in the site to its pages."""

from __future__ import annotations

import re

from sphinx.application import Sphinx

_LINK = re.compile(r"\]\(((?:\.\./)*)gallery/(?:README\.rst|(plot_\w+)\.py)\)")


def to_pages(text: str) -> str:
    """Return a page's text with links to the gallery's sources as links to the pages made of them."""
    return _LINK.sub(lambda found: f"]({found[1]}examples/{found[2] or 'index'}.rst)", text)


def _redirect(_: Sphinx, __: str, source: list[str]) -> None:
    source[0] = to_pages(source[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Have every page read with its links redirected."""
    app.connect("source-read", _redirect)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
