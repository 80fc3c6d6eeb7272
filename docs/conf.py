"""The site: `make docs` builds it into docs/_build/html, where index.html opens without a server."""

import os
import sys
from importlib import metadata
from pathlib import Path

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent / "tools"))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the build has processes enough
os.environ["PATH"] = os.pathsep.join(
    [str(Path(sys.executable).parent), os.environ.get("PATH", "")]
)  # `tacstrip`

from docs_site.scraper import figures  # noqa: E402

project = "tacstrip"
author = "tacstrip maintainers"
project_copyright = "tacstrip maintainers, MIT licence"
release = metadata.version("tacstrip")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "docs_site.ahead",
    "docs_site.commands",
    "docs_site.drawings",
    "docs_site.gallery_links",
    "docs_site.mathml",
    "docs_site.named",
    "docs_site.reproduction",
    "docs_site.transcript",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "_templates", "gallery/*.py", "gallery/README.rst"]
templates_path = ["_templates"]
suppress_warnings = ["config.cache", "toc.empty_glob"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
smartquotes = False  # -- is an option's beginning
html_math_renderer = "mathml"

default_role = "code"  # of `name` in docstrings
autosummary_generate = True
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

html_theme = "pydata_sphinx_theme"
html_title = "tacstrip"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "navbar_align": "left",
    "navbar_persistent": ["search-named"],
    "header_links_before_dropdown": 7,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}
# Records without a list of all the others beside each: it was most of their size.
html_sidebars = {"index": [], "glossary": [], "decisions/2*": []}

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "examples",
    "filename_pattern": r"/plot_",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "plot_gallery": "True",
    "capture_repr": ("_repr_html_",),  # what matplotlib's calls return is no output
    "abort_on_example_error": True,
    "remove_config_comments": True,
    "image_scrapers": (figures,),
    "reset_modules": (),
    "min_reported_time": 5,
    "write_computation_times": False,
}
