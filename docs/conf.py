"""Sphinx: MyST pages, the API from the docstrings; commands and notebooks of the pages run while they are built.

`FPJAX_DOCS=text` builds without running anything (for writing), so without outputs and pictures.
"""

import logging
import os
import pathlib
import re
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent))  # a clean clone is enough, nothing need be installed
sys.path.insert(0, str(pathlib.Path(__file__).parent / "_ext"))

from terminal import fingerprint

from fpjax._version import __version__

# Kernels are processes of their own: they import this tree too, and every page shares what was compiled.
HERE = pathlib.Path(__file__).parent
BUILD = HERE / "_build"
logging.getLogger("traitlets").setLevel(logging.WARNING)  # a notebook that runs is no news
os.environ["PYTHONPATH"] = os.pathsep.join([str(HERE.parent), *filter(None, [os.environ.get("PYTHONPATH")])])
os.environ["FPJAX_CACHE"] = os.environ["JAX_COMPILATION_CACHE_DIR"] = str(BUILD / "compiled")
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
RECORDS = pathlib.Path(os.environ.get("FPJAX_RECORDS", HERE.parent.parent / "shared" / "data"))  # where they are
os.environ["FPJAX_RECORDS"] = str(RECORDS.resolve())

project = "fpjax"
author = "the fpjax authors"
release = version = __version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml", "terminal"]
html_math_renderer = "mathml"
execute_pages = os.environ.get("FPJAX_DOCS") != "text"
sources_fingerprint = fingerprint(str(RECORDS.is_dir()))
nb_execution_mode = "cache" if execute_pages else "off"
nb_execution_cache_path = str(BUILD / "notebooks" / sources_fingerprint)
nb_execution_timeout = -1
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_merge_streams = True
myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = "fpjax"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
exclude_patterns = ["_build"]
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_preserve_defaults = True  # as written: the objects themselves are pages of lambdas
autodoc_default_options = {"members": True, "show-inheritance": False}
napoleon_google_docstring = True
napoleon_use_ivar = True
suppress_warnings = ["ref.python"]


def escape(app, what, name, obj, options, lines):
    """Docstrings are plain text with |w|, a*b and close lists; reStructuredText would read them as markup."""
    del app, what, name, obj, options
    escaped = []
    for line in lines:
        parts = re.split(r"(``.*?``|`[^`]*`)", line)
        parts[::2] = [re.sub(r"[|*]", r"\\\g<0>", part) for part in parts[::2]]
        parts[2::2] = [re.sub(r"^\w", r"\\ \g<0>", part) for part in parts[2::2]]  # `Parameter`s
        text, before = "".join(parts), escaped[-1] if escaped else ""
        indent = len(text) - len(text.lstrip())
        list_begins = text.lstrip().startswith("- ") and not before.lstrip().startswith("- ")
        if list_begins and before.strip() and len(before) - len(before.lstrip()) <= indent:
            escaped.append("")
        escaped.append(text)
    lines[:] = escaped


def skip(app, what, name, obj, skip, options):
    """The fields of a named tuple say no more than their number; the class' docstring has told them."""
    del app, what, name, skip, options
    return True if type(obj).__name__ == "_tuplegetter" else None


def setup(app):
    """Before napoleon (priority 500), which adds markup of its own."""
    app.connect("autodoc-process-docstring", escape, priority=400)
    app.connect("autodoc-skip-member", skip)
