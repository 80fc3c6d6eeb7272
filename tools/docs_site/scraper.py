"""Pictures of the gallery: the figure that an example makes, of pyplot or not (`figure`), with an alternative text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from sphinx_gallery.scrapers import figure_rst

from docs_site.legible import refuse_small_letters


def figures(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Save the figure of the example after its last block, and return the reST that shows it."""
    figure = block_vars["example_globals"].get("figure")
    rest = Path(block_vars["src_file"]).read_text(encoding="utf-8").splitlines()[block[2] :]
    if figure is None or any(line.startswith("# %%") for line in rest):
        return ""
    path = Path(next(block_vars["image_path_iterator"]))
    figure.savefig(path, dpi=120)
    refuse_small_letters(figure, path.name)
    plt.close("all")
    titles = [axes.get_title() or axes.get_ylabel() for axes in figure.axes]
    words = str(block_vars["example_globals"].get("__doc__") or "").strip().splitlines()
    alt = ": ".join(filter(None, [words[0] if words else "", "; ".join(t for t in titles if t)]))
    return str(figure_rst([str(path)], gallery_conf["src_dir"], alt.replace("\n", " ")))
