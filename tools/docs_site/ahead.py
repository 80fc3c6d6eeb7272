"""What takes long is made in several processes before any page is read: the gallery's examples and the thesis' figures.

sphinx-gallery and the pages then find them up to date. Its own `parallel` needs joblib, and starts processes that
import everything anew; forked ones have it.
"""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx_gallery.gen_rst import generate_file_rst

from docs_site.reproduction import draw_figure, figure_numbers

# What takes longest begins first, so that none of it runs last, alone.
LONGEST = ("4.1", "18", "33", "30", "31", "28", "17", "16", "08", "26", "27")

_settings: dict[
    str, Any
] = {}  # of sphinx-gallery, as the forked processes have them: they hold what no pickle takes


def jobs(docs: Path) -> list[str]:
    """Return the examples' files and the figures' numbers, the longest jobs first."""
    examples = sorted(file.name for file in (docs / "gallery").glob("plot_*.py"))
    short = {**{name: name[5:7] for name in examples}, **{n: n for n in figure_numbers(docs)}}
    return sorted(short, key=lambda job: LONGEST.index(short[job]) if short[job] in LONGEST else len(LONGEST))


def _make(job: str) -> None:
    docs = Path(_settings["src_dir"])
    if job.endswith(".py"):
        generate_file_rst(job, docs / "examples", docs / "gallery", _settings)
    else:
        draw_figure(job, docs)


def _run(app: Sphinx) -> None:
    _settings.update(app.config.sphinx_gallery_conf)
    docs = Path(app.srcdir)
    (docs / "examples" / "images" / "thumb").mkdir(parents=True, exist_ok=True)
    # Not multiprocessing.Pool: its processes may have no children of their own.
    with ProcessPoolExecutor(app.parallel, multiprocessing.get_context("fork")) as pool:
        made = {job: pool.submit(_make, job) for job in jobs(docs)}
        for job, done in made.items():
            try:
                done.result()
            except Exception as error:
                raise ExtensionError(f"{job} failed: {error}", error) from error


def setup(app: Sphinx) -> dict[str, bool]:
    """Make them when sphinx-gallery has its settings (priority 10), and before its own turn (500)."""
    app.connect("builder-inited", _run, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
