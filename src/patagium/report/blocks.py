"""Blocks of a page: prose, tables, pictures, remarks and links in titled sections.

`page` writes them as HTML or Markdown.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from patagium.report.tables import Table

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
class PageSection:
    """A titled run of blocks.

    Attributes:
        title: Title of the page.
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
