"""How Sphinx builds this documentation: ``make docs``, without any network."""

from __future__ import annotations

import logging
import sys
from importlib import metadata
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "hpp_framework"
author = "the hpp_framework authors"
copyright = author
release = metadata.version("hpp-framework")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "hpp_reference"]
exclude_patterns = ["_extensions"]

html_theme = "furo"
html_title = f"hpp_framework {release}"
html_show_copyright = False
html_static_path = ["_static"]
html_css_files = ["hpp.css"]

myst_heading_anchors = 3
# some entries begin with small headings
suppress_warnings = ["myst.header"]
# pages join the index by pattern; one that matches nothing yet is no fault, and Sphinx names it by no type
logging.getLogger("sphinx.sphinx.directives.other").addFilter(
    lambda record: "didn't match any documents" not in record.getMessage()
)

autodoc_default_options = {"members": True, "show-inheritance": True, "member-order": "bysource"}
autodoc_typehints = "signature"
python_maximum_signature_line_length = 90
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
