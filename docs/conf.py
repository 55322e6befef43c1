"""How the documentation is built: `make docs`. Nothing here reaches for a network."""

from __future__ import annotations

import gc
from importlib.metadata import version as installed
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

gc.disable()  # the pages are trees without end: seeking garbage is a quarter of the time

project = "patagium"
author = "The patagium maintainers"
copyright = author
version = release = installed("patagium")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]

html_theme = "furo"
html_title = f"patagium {release}"
html_math_renderer = "mathml"
html_show_sphinx = False
html_static_path = ["_static"]
html_css_files = ["site.css"]

autodoc_typehints = "none"  # the docstrings say shapes and units, which types do not
autodoc_member_order = "bysource"
napoleon_numpy_docstring = False
napoleon_use_ivar = True


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _display(writer: Any, node: nodes.math_block) -> None:
    """An equation in MathML, which browsers draw by themselves, and its number."""
    number = f'<span class="eqno">({node["number"]})</span>' if node.get("number") else ""
    anchor = f' id="equation-{node["label"]}"' if node.get("label") else ""
    drawn = convert(node.astext(), display="block")
    writer.body.append(
        f'<div class="math"{anchor}><span class="drawn">{drawn}</span>{number}</div>\n'
    )
    raise nodes.SkipNode


def _plain_text(app: Sphinx, what: str, name: str, o: Any, options: Any, lines: list[str]) -> None:
    """A docstring as it was written: equations on lines of their own, bars as bars."""
    written, lines[:] = list(lines), []
    prose, literal = True, False
    for before, line in zip(["", *written], written, strict=False):
        prose = prose and line not in _PARTS
        indented = line.startswith("    ") and prose
        if indented and not literal and not before.strip():
            lines.extend(["::", ""])
        literal = indented or (literal and not line.strip())
        lines.append(line if literal else line.replace("|", r"\|"))


_PARTS = ("Args:", "Attributes:", "Returns:", "Raises:", "References:", "Note:", "Yields:")


def setup(app: Sphinx) -> None:
    """Equations without a script, docstrings without markup."""
    app.add_html_math_renderer("mathml", (_inline, None), (_display, None))
    app.connect("autodoc-process-docstring", _plain_text, priority=400)  # before napoleon
