"""Sphinx: MyST pages, the API from the docstrings."""

import pathlib
import re
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent))  # a clean clone is enough, nothing need be installed

from fpjax._version import __version__

project = "fpjax"
author = "the fpjax authors"
release = version = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = "fpjax"
html_static_path = ["_static"]
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
