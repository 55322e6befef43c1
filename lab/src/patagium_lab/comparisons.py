"""Figures that compare methods: scores and times as points, and learning curves.

Points stand on logarithmic axes, where a bar would begin nowhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ShapeError
from patagium.report.style import color, dash, envelope, legend_above, panels, styled

Vectors = NDArray[np.float64]


@styled
def score_points(
    names: Sequence[str],
    scores: Mapping[str, ArrayLike],
    *,
    label: str = "normalized mean square error [1]",
) -> Figure:
    """A score per quantity and method as points on a logarithmic axis, one line each.

    Args:
        names: Names of the k quantities.
        scores: Score of each quantity by method, each (k,) [-]; nan leaves a gap.
        label: The abscissa, with its unit.

    Raises:
        ShapeError: If a method has another number of scores.
    """
    return _points(names, {m: _row(m, s, len(names)) for m, s in scores.items()}, label)


@styled
def time_points(times: Mapping[str, Mapping[str, float]]) -> Figure:
    """Time of a call as points on a logarithmic axis, with the times written out.

    Args:
        times: Function -> way of computing it -> time of a call [s]; a way that does
            not know a function leaves a gap.
    """
    ways = list(dict.fromkeys(way for one in times.values() for way in one))
    values = {way: np.array([times[f].get(way, np.nan) for f in times]) for way in ways}
    return _points(list(times), values, "time of a call [s]", texts=seconds_text)


@styled
def learning_curves(
    time: ArrayLike,
    errors: Mapping[str, ArrayLike],
    *,
    label: str = "normalized mean square error [1]",
    span: float | None = None,
) -> Figure:
    """Figure of the error of several learners over time, on a logarithmic axis.

    Args:
        time: Time, (N,) [s].
        errors: Squared or normalized error by learner, each (N,), in the unit of the label.
        label: The ordinate, with its unit.
        span: Running mean over this long [s]; None draws the errors as they are.

    Raises:
        ShapeError: If an array does not fit the time.
    """
    t = np.asarray(time, float)
    figure, grid = panels(1, 1, 3.4)
    panel = grid[0, 0]
    for i, (name, error) in enumerate(errors.items()):
        series = _row(name, error, t.size)
        smooth = series if span is None else _running_mean(t, series, span)
        panel.plot(*envelope(t, smooth), label=name, color=color(i), linestyle=dash(i))
    panel.set_yscale("log")
    panel.set_ylabel(label)
    panel.set_xlabel("time [s]")
    panel.margins(x=0.0)
    legend_above(figure, panel)
    return figure


def seconds_text(seconds: float) -> str:
    """A duration to three digits in ns, us, ms, s or min."""
    for unit, scale in (("ns", 1e-9), ("µs", 1e-6), ("ms", 1e-3), ("s", 1.0)):
        if abs(seconds) < 999.5 * scale and not (unit == "s" and abs(seconds) >= 120.0):
            return f"{seconds / scale:.3g} {unit}"
    return f"{seconds / 60.0:.3g} min"


def _points(
    names: Sequence[str],
    values: Mapping[str, Vectors],
    label: str,
    texts: Any = lambda value: f"{value:.1e}",
) -> Figure:
    thick = 0.8 / max(len(values), 1)
    figure, axes = panels(1, 1, row_height=0.6 + 0.19 * len(names) * max(len(values), 1.6))
    panel = axes[0, 0]
    base = np.arange(len(names), dtype=float)
    for i, (way, row) in enumerate(values.items()):
        place = base + (i - (len(values) - 1) / 2) * thick
        shown = np.where(row > 0, row, np.nan)
        panel.plot(shown, place, "o", color=color(i), markersize=5, label=way)
        for y, value in zip(place, shown, strict=True):
            if np.isfinite(value):
                panel.annotate(
                    texts(value), (value, y), (6, 0), textcoords="offset points", va="center",
                    fontsize="small",
                )  # fmt: skip
    panel.set_yticks(base, names)
    panel.invert_yaxis()
    panel.set_xscale("log")
    panel.set_xlabel(label)
    panel.grid(axis="y", visible=False)
    for y in base[:-1] + 0.5:
        panel.axhline(y, color="#e3e6e9", linewidth=0.6)
    panel.margins(x=0.12)
    legend_above(figure, panel)
    return figure


def _running_mean(time: Vectors, values: Vectors, span: float) -> Vectors:
    start = np.searchsorted(time, time - span, side="right")
    total = np.concatenate([[0.0], np.cumsum(values)])
    end = np.arange(1, time.size + 1)
    mean: Vectors = (total[end] - total[start]) / (end - start)
    return mean


def _row(name: str, values: ArrayLike, width: int) -> Vectors:
    array = np.asarray(values, float)
    if array.shape != (width,):
        raise ShapeError(name, (width,), array.shape)
    return array
