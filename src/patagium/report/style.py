"""Style of all figures: one type face, colors for every eye, a size for each use.

Colors are those of Okabe and Ito; the truth is black, an estimate is colored, wherever it is
shown: on a page, in print or on a wall.

References:
    Okabe and Ito (2008), Color Universal Design.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from patagium.arrays import Array, find_gaps
from patagium.errors import ShapeError, check_names
from patagium.report.page import SMALLEST_LETTERS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TRUTH = "#1a1a1a"
COLORS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
_DRAWN = 1600  # points of a curve, about
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)), (0, (7, 2)))

SCENE = {
    "paper": "#f4f7f9",
    "grid": "#dbe2e8",
    "gridMajor": "#bcc8d1",
    "shadow": "#d3dbe1",
    "bodies": "#8c9aa7",
    "carrier": "#c3ccd4",
    "upper": "#9fc0d8",
    "lower": "#7d9db6",
    "edge": "#46627a",
    "path": "#7b8894",
    "ahead": "#c6cfd7",
    "trace": "#4f86ad",
}
"""Things in space: on the replay page, live, and in pictures."""


@dataclass(frozen=True)
class Look:
    """Sizes in figures for one use: a page, a paper or slides.

    Attributes:
        width: Width of a figure [inch].
        letters: Size of letters over those of a page.
        lines: Width of lines over those of a page.
    """

    width: float
    letters: float = 1.0
    lines: float = 1.0


LOOKS = {
    "page": Look(9.0),
    "phone": Look(3.8),
    "paper": Look(7.0, letters=8.0 / 9.0, lines=0.8),  # two columns wide, 8 point
    "slides": Look(12.0, letters=16.0 / 9.0, lines=1.8),
}
"""A page on a screen, a phone, a paper in print, slides on a wall."""

_look: ContextVar[Look] = ContextVar("look", default=LOOKS["page"])


@contextmanager
def figures_for(where: str) -> Iterator[None]:
    """Figures made meanwhile are for a place.

    Args:
        where: Name of the place, one of `LOOKS`.

    Raises:
        ParameterError: If it is none.
    """
    check_names("look", [where], LOOKS)
    before = _look.set(LOOKS[where])
    try:
        yield
    finally:
        _look.reset(before)


def width() -> float:
    """Width of a figure in its present use [inch]."""
    return _look.get().width


def round_down(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above it, for scales and grids."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(k for k in (1, 2, 5) if k * power <= value * (1 + 1e-9)))


_STYLE: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "grid.color": "#e3e6e9",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": SMALLEST_LETTERS,
    "xtick.labelsize": SMALLEST_LETTERS,
    "ytick.labelsize": SMALLEST_LETTERS,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "figure.facecolor": "white",
}
_LETTERS = ("font.size", "titlesize", "labelsize", "fontsize")


Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def styled(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Drawing function that runs under the common style and restores the former one."""

    @wraps(function)
    def draw(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        from matplotlib import rc_context  # takes long to load

        with rc_context(_sized(_look.get())):
            return function(*args, **kwargs)

    return draw


def _sized(look: Look) -> Any:
    sized = {
        key: look.letters if key.endswith(_LETTERS) else look.lines
        for key in _STYLE
        if key.endswith(("size", "width"))
    }
    return _STYLE | {key: scale * _STYLE[key] for key, scale in sized.items()}


def panels(rows: int, columns: int = 1, row_height: float = 1.7) -> tuple[Figure, NDArray[Any]]:
    """An empty grid of panels, and its axes (rows, columns)."""
    from matplotlib.figure import Figure

    tall = row_height * rows * _look.get().letters + 0.5
    figure = Figure(figsize=(width(), tall), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def color(index: int) -> str:
    """Color of the estimate of that index."""
    return COLORS[index % len(COLORS)]


def dash(index: int) -> Any:
    """Line style of the estimate of that index, for print without color."""
    return DASHES[index % len(DASHES)]


def legend_above(figure: Figure, axes: Axes) -> None:
    """One legend for all panels, over them, from the labels of one."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=legend_columns(labels))


def legend_columns(labels: Sequence[str]) -> int:
    """Most columns, five at most, of a legend that fits across; it fills column by column."""
    for columns in range(min(len(labels), 5), 1, -1):
        rows = -(-len(labels) // columns)
        longest = (max(map(len, labels[i : i + rows])) for i in range(0, len(labels), rows))
        size = _look.get().letters
        if size * sum(_HANDLE + _LETTER * count for count in longest) <= width():
            return columns
    return 1


_HANDLE, _LETTER = 0.65, 0.075  # inches of a legend's key and of a wide letter


def envelope(time: Array, values: Array, *others: Array) -> tuple[Array, ...]:
    """A long signal thinned for drawing, its peaks and its gaps kept.

    Each run of samples gives its smallest and its largest, in the order they came.

    Args:
        time: Abscissa, (N,) [s].
        values: Signal, (N,), in any unit of its own.
        others: Signals thinned at the same times, (N,), each in any unit of its own.

    Returns:
        Thinned abscissa and signals, with a row of NaN in each gap of the abscissa.

    Raises:
        ShapeError: If the two differ in length.
    """
    time, values = np.asarray(time, float), np.asarray(values, float)
    if time.shape != values.shape or time.ndim != 1:
        raise ShapeError("values", time.shape, values.shape)
    index = np.arange(time.size)
    if time.size > _DRAWN:
        run = -(-2 * time.size // _DRAWN)
        start = index[::run]
        room = start.size * run - time.size
        blocks = np.pad(values, (0, room), constant_values=np.nan).reshape(-1, run)
        finite = np.where(np.isfinite(blocks), blocks, np.inf)
        low = finite.argmin(axis=1)
        finite[np.isinf(finite)] = -np.inf
        ends = np.sort(np.stack([low, finite.argmax(axis=1)]), axis=0) + start
        index = np.concatenate([ends.T.ravel(), index[-1:]])
    cuts = np.searchsorted(index, find_gaps(time))
    return tuple(np.insert(one[index], cuts, np.nan) for one in (time, values, *others))
