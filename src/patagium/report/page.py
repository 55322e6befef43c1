"""One self-contained HTML page: prose, tables and pictures in numbered sections.

Everything is inline, so that the file opens offline and survives being mailed.
Neglected: scripts (a `Link` leads to pages that have them). The page reads in light and dark,
and prints.
"""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup, escape

from patagium.report.tables import Table
from patagium.whole_file import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Picture:
    """An image that travels inside the page.

    Attributes:
        source: The image as a data address.
        caption: What is seen, and what to look for.
    """

    source: str
    caption: str


@dataclass(frozen=True)
class Note:
    """A remark set apart: a limit, a warning, a definition."""

    text: str


@dataclass(frozen=True)
class Link:
    """A way to another page that lies beside this one.

    Attributes:
        text: What is there.
        address: Of the page, relative to this one.
    """

    text: str
    address: str


Block: TypeAlias = "str | Table | Picture | Note | Link"


@dataclass(frozen=True)
class Section:
    """A titled run of blocks.

    Attributes:
        title: Heading.
        blocks: Prose (`code` and **bold** are understood), tables, pictures, notes, links.
    """

    title: str
    blocks: Sequence[Block]


def picture(figure: Figure, caption: str, kind: Literal["svg", "png"] = "svg") -> Picture:
    """An image of a figure, to be put on a page.

    Args:
        figure: What to draw.
        caption: What is seen, and what to look for.
        kind: "svg" stays sharp; "png" is smaller for tens of thousands of points.
    """
    stream = io.BytesIO()
    draw(figure, stream, kind)
    kinds = {"svg": "image/svg+xml", "png": "image/png"}
    address = base64.b64encode(stream.getvalue()).decode("ascii")
    return Picture(f"data:{kinds[kind]};base64,{address}", caption)


_UNSTAMPED = {"svg": {"Date": None}, "png": {"Software": None}, "pdf": {"CreationDate": None}}


def draw(figure: Figure, target: io.BytesIO | Path, kind: Literal["svg", "png", "pdf"]) -> None:
    """Write a figure, the same bytes each time it is the same figure."""
    from matplotlib import rc_context

    with rc_context({"svg.hashsalt": "patagium", "svg.fonttype": "path"}):
        figure.savefig(target, format=kind, dpi=160, metadata=_UNSTAMPED[kind])


def write_page(
    path: str | Path,
    title: str,
    sections: Sequence[Section],
    *,
    summary: str = "",
    facts: Mapping[str, str] | None = None,
) -> Path:
    """A self-contained HTML report, written whole or not at all.

    Args:
        path: File to write; its folder is made.
        title: Title of the page.
        sections: In reading order; a table of contents is made of their titles.
        summary: What was found, in a few sentences, under the title.
        facts: Where it comes from (program, version, robot, settings), at the foot.

    Returns:
        The path written.
    """
    text = _template().render(
        title=title,
        summary=summary,
        sections=sections,
        facts=dict(facts or {}),
    )
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
