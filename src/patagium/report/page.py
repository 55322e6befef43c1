"""A page of prose, tables and pictures in sections: one self-contained HTML file.

Everything is inline, so that the file opens offline and survives being mailed; it reads in light
and dark, on a phone, and prints. It has no scripts; a `Link` leads to pages that have them. A
page with an opening shows it first, and folds its sections.
"""

from __future__ import annotations

import base64
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from markupsafe import Markup, escape

from patagium.errors import ParameterError, ShapeError
from patagium.whole_file import write_whole

SMALLEST_LETTERS = 8.5
"""Letters of figures, which a page shows at their size, at least [pt]."""
Cell: TypeAlias = "str | float | bool | None"


@dataclass(frozen=True)
class Table:
    """Rows under named columns.

    Attributes:
        columns: Heads of the columns, with units: "time per call [ns]".
        rows: One cell a column; numbers are printed to three digits.
        caption: Sentence about the table.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "columns", tuple(self.columns))
        object.__setattr__(self, "rows", tuple(map(tuple, self.rows)))
        for i, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                raise ShapeError(f"row {i} of table {self.caption!r}", len(self.columns), len(row))

    def texts(self) -> list[list[str]]:
        """Every cell as a reader sees it, row by row."""
        return [[cell_text(cell) for cell in row] for row in self.rows]

    def numeric(self, column: int) -> bool:
        """Whether a column holds numbers only, to be set flush right."""
        cells = [row[column] for row in self.rows if row[column] is not None]
        return bool(cells) and all(_is_number(cell) for cell in cells)


def cell_text(value: Cell) -> str:
    """A number to three significant digits, "–" for nothing, "yes"/"no" for a truth.

    Integers up to a million keep all their digits; nan reads "n/a".
    """
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    number = float(value)
    if not _is_number(value):
        return "yes" if number else "no"
    if _is_whole(value) and abs(number) < 1e6:
        return f"{number:.0f}"
    if math.isnan(number):
        return "n/a"
    if math.isinf(number):
        return "∞" if number > 0 else "−∞"
    if number == 0.0:
        return "0"
    if 1e-3 <= abs(number) < 1e5:
        decimals = max(0, 2 - math.floor(math.log10(abs(number))))
        return f"{number:.{decimals}f}".replace("-", "−")
    mantissa, exponent = f"{number:.2e}".split("e")
    digits = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa}×10{digits}".replace("-", "−")


def _is_number(value: object) -> bool:
    # NumPy's bool is neither Real nor Integral, so it falls out by itself.
    return isinstance(value, Real) and not isinstance(value, bool)


def _is_whole(value: object) -> bool:
    return isinstance(value, Integral)


if TYPE_CHECKING:
    from jinja2 import Template
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Picture:
    """An image that travels inside the page.

    Attributes:
        source: The image as a data address.
        caption: What is seen, and what to look for.
        address: Address of a page that a click opens, relative to this one; none if empty.
    """

    source: str
    caption: str
    address: str = ""

    def file(self) -> tuple[str, bytes]:
        """Kind of the image's file, "svg" or "png", and its bytes."""
        head, data = self.source.split(",", 1)
        return "svg" if "svg" in head else "png", base64.b64decode(data)

    def least_width(self) -> int:
        """Width below which the smallest letters of a figure would be under 11 pixels [px]."""
        kind, image = self.file()
        if kind == "png":
            points = int.from_bytes(image[16:20], "big") * 72 / _DOTS
        else:
            found = re.search(rb'<svg[^>]* width="([\d.]+)pt"', image)
            points = float(found[1]) if found else 0.0
        return math.ceil(points * _LEGIBLE / SMALLEST_LETTERS) + 2  # its frame


@dataclass(frozen=True)
class KeyNumber:
    """A number that a page is about, set large.

    Attributes:
        value: The number with its unit.
        meaning: Sentence about the number.
        beside: Value to compare it with, such as the number of a paper.
    """

    value: str
    meaning: str
    beside: str


@dataclass(frozen=True)
class Note:
    """A remark set apart: a limit, a warning, a definition."""

    text: str


@dataclass(frozen=True)
class Link:
    """A way to another page that lies beside this one.

    Attributes:
        text: Description of the page.
        address: Address of the page, relative to this one.
    """

    text: str
    address: str


Block: TypeAlias = "str | Table | Picture | KeyNumber | Note | Link"


@dataclass(frozen=True)
class PageSection:
    """A titled run of blocks.

    Attributes:
        title: Title of the page.
        blocks: Prose (`code` and **bold** are understood), tables, pictures, numbers, notes, links.
    """

    title: str
    blocks: Sequence[Block]


def picture(figure: Figure, caption: str, kind: Literal["svg", "png"] = "svg") -> Picture:
    """An image of a figure, to be put on a page.

    Args:
        figure: Figure.
        caption: What is seen, and what to look for.
        kind: "svg" stays sharp; "png" is smaller for tens of thousands of points.
    """
    kinds = {"svg": "image/svg+xml", "png": "image/png"}
    address = base64.b64encode(draw(figure, kind)).decode("ascii")
    return Picture(f"data:{kinds[kind]};base64,{address}", caption)


def snippet(title: str, facts: Mapping[str, Cell], figure: Figure | None = None) -> str:
    """Picture and table of one thing in HTML, as a notebook shows it.

    Args:
        title: The thing in a line.
        facts: Its facts by name, with units.
        figure: Picture of it; None for none.
    """
    cells = [(escape(name), escape(cell_text(value))) for name, value in facts.items()]
    rows = "".join(f"<tr><th>{name}</th><td>{value}</td></tr>" for name, value in cells)
    image = ""
    if figure is not None:
        image = f'<img src="{picture(figure, title).source}" style="max-width: 100%">'
    return f"<div><b>{escape(title)}</b></div>{image}<table>{rows}</table>"


_DOTS = 160
"""Dots of a figure that is a PNG [1/inch]."""
_LEGIBLE = 11
"""Least size of letters on a screen [px]."""
_UNSTAMPED = {"svg": {"Date": None}, "png": {"Software": None}, "pdf": {"CreationDate": None}}


def draw(figure: Figure, kind: Literal["svg", "png", "pdf"]) -> bytes:
    """File of a figure, the same bytes each time it is the same figure."""
    from matplotlib import rc_context
    from matplotlib.text import Text
    from matplotlib.ticker import LogFormatter

    axes = [axis for one in figure.axes for axis in (one.xaxis, one.yaxis)]
    logarithmic = [one for one in axes if isinstance(one.get_major_formatter(), LogFormatter)]
    powers = [label for one in logarithmic for label in one.get_ticklabels(which="both")]
    for text in figure.findobj(Text):
        if isinstance(text, Text) and text not in powers:
            text.set_parse_math(False)  # a name from a file is no formula; a power of ten is
    with rc_context({"svg.hashsalt": "patagium", "svg.fonttype": "path"}):
        stream = io.BytesIO()
        figure.savefig(stream, format=kind, dpi=_DOTS, metadata=_UNSTAMPED[kind])
    return stream.getvalue()


def write_page(
    path: str | Path,
    title: str,
    sections: Sequence[PageSection],
    *,
    summary: str = "",
    facts: Mapping[str, str] | None = None,
    opening: Sequence[Block] = (),
) -> Path:
    """A report, written whole or not at all.

    Args:
        path: File to write, in a folder that is there.
        title: Title of the page.
        sections: In reading order; a table of contents is made of their titles.
        summary: Findings in a few sentences, under the title.
        facts: Origin (program, version, robot, settings), at the foot.
        opening: First screen: pictures side by side, numbers, sentences. The sections of a page
            that has one are folded.

    Returns:
        The path written.

    Raises:
        ParameterError: If the name ends otherwise than a page's.
    """
    page = page_path(path, "")
    first = [[one for one in opening if isinstance(one, kind)] for kind in _FIRST]
    text = template("page.html").render(
        title=title, summary=summary, sections=sections, facts=dict(facts or {}), opening=first
    )
    return write_whole(page, text)


def page_path(path: str | Path, *more: str, name: str = "page") -> Path:
    """Path of a page, whose name ends in .html, .htm or as `more` says.

    Raises:
        ParameterError: If it ends otherwise.
    """
    page = Path(path)
    if page.suffix.lower() not in (".html", ".htm", *more):
        raise ParameterError(name, "a name ending in .html or .htm", page.name)
    return page


_FIRST: tuple[Any, ...] = (Picture, KeyNumber, str | Table | Note | Link)
"""Kinds of blocks of an opening, in the order of their rows."""


def prose(text: str) -> Markup:
    """Escaped text in which `code` and **bold** are set as such."""
    marked = re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text)))
    return Markup(re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", marked))


def template(name: str) -> Template:
    """Template of a page, a file of this package.

    Args:
        name: Its name, with the folder.
    """
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters["prose"] = prose
    environment.tests["a"] = lambda block, kind: type(block).__name__ == kind
    text = files("patagium.report").joinpath(name).read_text(encoding="utf-8")
    return environment.from_string(text)
