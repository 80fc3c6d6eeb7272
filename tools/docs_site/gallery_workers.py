"""Run the gallery's examples in several processes; sphinx-gallery, which comes after, finds each of them up to date.

Its own `parallel` needs joblib, and starts processes that import everything anew; forked ones have it.
"""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx_gallery.gen_rst import generate_file_rst

# Those that take long begin first, so that none of them runs last, alone.
LONGEST = ("18", "33", "30", "31", "28", "17", "16", "08", "26", "27")

_settings: dict[
    str, Any
] = {}  # of sphinx-gallery, as the forked processes have them: they hold what no pickle takes


def _make(name: str) -> None:
    source = Path(_settings["src_dir"])
    generate_file_rst(name, source / "examples", source / "gallery", _settings)


def _run(app: Sphinx) -> None:
    _settings.update(app.config.sphinx_gallery_conf)
    source = Path(app.srcdir)
    (source / "examples" / "images" / "thumb").mkdir(parents=True, exist_ok=True)
    names = sorted(file.name for file in (source / "gallery").glob("plot_*.py"))
    names.sort(key=lambda name: name[5:7] not in LONGEST)
    # Not of multiprocessing.Pool, whose processes may have no children of their own.
    with ProcessPoolExecutor(app.parallel, multiprocessing.get_context("fork")) as pool:
        try:
            list(pool.map(_make, names))
        except Exception as error:
            raise ExtensionError(f"an example of the gallery failed: {error}", error) from error


def setup(app: Sphinx) -> dict[str, bool]:
    """Run them when sphinx-gallery has its settings (priority 10), and before its own turn (500)."""
    app.connect("builder-inited", _run, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
