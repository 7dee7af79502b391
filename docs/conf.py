"""Sphinx configuration: MyST pages, executed examples, API from the docstrings."""

import importlib
import os
import tempfile

os.environ.setdefault("JAX_ENABLE_X64", "1")
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=1")

# Guides that show the same session record it once a build, in a folder that goes with it.
_recordings = tempfile.TemporaryDirectory(prefix="icjax_guides_")
os.environ.setdefault("ICJAX_GUIDES", _recordings.name)

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from icjax import __version__
from icjax.files import layout

project = "icjax"
author = "The icjax developers"
copyright = "2026, " + author
release = __version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.mathjax", "sphinx.ext.viewcode"]
source_suffix = {".md": "myst-nb", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "jupyter_execute", "conf.py"]
html_theme = "furo"
html_title = "icjax"
myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_default_options = {"members": True, "show-inheritance": False}
default_role = "code"


class RecordLayout(SphinxDirective):
    """Table of every entry in the file of a record class, from its declaration."""

    required_arguments = 1

    def run(self):
        module, _, name = self.arguments[0].rpartition(".")
        rows = [("entry", "sort", "dimensions", "unit", "meaning")]
        for entry in layout(getattr(importlib.import_module(module), name)):
            rows.append((entry.path, entry.sort, ", ".join(entry.dims), entry.unit, entry.doc))
        return [_table(rows)]


def _table(rows):
    group = nodes.tgroup(cols=len(rows[0]))
    group += [nodes.colspec(colwidth=width) for width in (30, 10, 18, 12, 30)]
    head, body = nodes.thead(), nodes.tbody()
    for index, cells in enumerate(rows):
        row = nodes.row()
        for column, text in enumerate(cells):
            inline = nodes.literal(text=text) if index and column == 0 else nodes.Text(text)
            row += nodes.entry("", nodes.paragraph("", "", inline))
        if index:
            body += row
        else:
            head += row
    group += [head, body]
    return nodes.table("", group)


def setup(app):
    app.add_directive("record-layout", RecordLayout)
