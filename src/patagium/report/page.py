"""A page of prose, tables and pictures in sections: one self-contained HTML file, or Markdown.

In HTML everything is inline, so that the file opens offline and survives being mailed; it reads
in light and dark, and prints. It has no scripts; a `Link` leads to pages that have them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup, escape

from patagium.report.blocks import Link, Note, PageSection, Picture
from patagium.report.markdown import markdown_page
from patagium.report.tables import Table
from patagium.whole_file import write_whole


def write_page(
    path: str | Path,
    title: str,
    sections: Sequence[PageSection],
    *,
    summary: str = "",
    facts: Mapping[str, str] | None = None,
) -> Path:
    """A report, written whole or not at all.

    Args:
        path: File to write; its folder is made. A name ending in .md makes a Markdown page
            with its pictures in a folder of the same name beside it, any other a
            self-contained HTML page.
        title: Title of the page.
        sections: In reading order; a table of contents is made of their titles.
        summary: What was found, in a few sentences, under the title.
        facts: Where it comes from (program, version, robot, settings), at the foot.

    Returns:
        The path written.
    """
    path, told = Path(path), dict(facts or {})
    if path.suffix == ".md":
        text, pictures = markdown_page(title, sections, summary, told, path.stem)
        for name, image in pictures.items():
            write_whole(path.with_suffix("") / name, image)
    else:
        text = _template().render(title=title, summary=summary, sections=sections, facts=told)
    return write_whole(path, text)


def prose(text: str) -> Markup:
    """Escaped text in which `code` and **bold** are set as such."""
    marked = re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text)))
    return Markup(re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", marked))


def _template() -> Template:
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters["prose"] = prose
    environment.tests["table"] = lambda block: isinstance(block, Table)
    environment.tests["picture"] = lambda block: isinstance(block, Picture)
    environment.tests["link"] = lambda block: isinstance(block, Link)
    environment.tests["note"] = lambda block: isinstance(block, Note)
    text = files("patagium.report").joinpath("page.html").read_text(encoding="utf-8")
    return environment.from_string(text)
