"""The site of the docs: `make docs` builds it, with warnings as errors."""

import os
import sys
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import Any

import numpy as np
from pygments.lexers.special import TextLexer
from sphinx.highlighting import lexers
from sphinx.util import logging

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent))
os.environ["MPLBACKEND"] = "agg"

project = "rigctl"
author = "The rigctl developers"
project_copyright = "2026, The rigctl developers"
release = installed_version("rigctl")

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "gallery/GALLERY_HEADER.rst"]
html_theme = "pydata_sphinx_theme"
html_title = "rigctl"
html_static_path = ["pictures"]
html_show_sourcelink = False
html_theme_options = {
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "show_toc_level": 2,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "navigation_with_keys": False,
}
templates_path: list[str] = []

myst_heading_anchors = 4

autodoc_typehints = "none"  # the docstrings have the types
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
default_role = "code"  # what stands between single backticks in a docstring

# The examples run in a folder of their own and see the files of examples/.
sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "made/gallery",
    "filename_pattern": r"\.py",
    "within_subsection_order": "FileNameSortKey",
    "show_memory": False,
    "show_signature": False,
    "remove_config_comments": True,
    "abort_on_example_error": True,
    "min_reported_time": 1e6,
    "write_computation_times": False,
    "thumbnail_size": (320, 200),
}

# GitHub draws it; here its text stands, so that no script has to come from elsewhere.
lexers["mermaid"] = TextLexer()


def _write_reference(_: Any) -> None:
    """Write the pages of the reference that are made from the code."""
    from docs.reference_pages import write_pages

    write_pages(DOCS)


def _try_search(app: Any, _: Any) -> None:
    """Warn if the search of the site finds no page for one of these questions: each word, by its stem, on one page."""
    index = getattr(app.builder, "indexer", None)
    for question in ("dark current", "exposure too long", "port busy") if index is not None else ():
        terms = index.freeze()["terms"]
        words = [index.lang.stem(word) for word in question.split() if index.lang.word_filter(word)]
        pages = [set(np.atleast_1d(terms.get(word, [])).tolist()) for word in words]
        if not set.intersection(*pages):
            logging.getLogger(__name__).warning("the search of the site finds nothing for: %s", question)


def setup(app: Any) -> None:
    """Have pages that are made from the code written before they are read, and try the search of the site."""
    app.connect("builder-inited", _write_reference)
    app.connect("build-finished", _try_search)
