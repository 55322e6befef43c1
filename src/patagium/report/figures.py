"""Figures of flights, estimates, learners and clocks, from plain arrays.

Each function returns a matplotlib `Figure` that no window owns; `report.picture`
puts it on a page and `report.save_figure` in a file. Units stand on every axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ParameterError, ShapeError
from patagium.report.blocks import draw
from patagium.report.style import TRUTH, color, dash, envelope, legend_above, panels, styled

Vectors = NDArray[np.float64]


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write a figure as PDF, PNG or SVG, chosen by the name of the file.

    Raises:
        ParameterError: If the name ends otherwise.
    """
    path = Path(path)
    kind = path.suffix.lower().lstrip(".")
    if kind not in ("pdf", "png", "svg"):
        raise ParameterError("figure file", "a name ending in .pdf, .png or .svg", path.name)
    path.parent.mkdir(parents=True, exist_ok=True)
    draw(figure, path, cast('Literal["pdf", "svg", "png"]', kind))
    return path


@styled
def comparison(
    time: ArrayLike,
    truth: ArrayLike,
    estimates: Mapping[str, ArrayLike],
    *,
    names: Sequence[str],
    units: Sequence[str],
    truth_name: str = "actual",
    std: ArrayLike | None = None,
    columns: int = 1,
) -> Figure:
    """Figure of quantities over time, a panel each: the truth and its estimates.

    Args:
        time: Time, (N,) [s].
        truth: Actual values, (N, k) [units].
        estimates: Estimated values by name, each (N, k) [units].
        names: Names of the k quantities.
        units: Units of the k quantities.
        truth_name: What the truth is called: "actual", "measured".
        std: Predicted standard deviation of the first estimate, (N, k) [units]: a
            band of 1.96 deviations, the predicted 95 % interval.
        columns: Panels side by side.

    Raises:
        ShapeError: If an array does not fit the others.
    """
    t = np.asarray(time, float)
    actual = _columns("truth", truth, t.size, len(names))
    drawn = {key: _columns(key, value, t.size, len(names)) for key, value in estimates.items()}
    band = None if std is None else _columns("std", std, t.size, len(names))
    figure, axes = _grid(len(names), columns)
    for k, panel in enumerate(axes):
        _curve(panel, t, actual[:, k], truth_name, color=TRUTH, linewidth=2.4)
        for i, (label, value) in enumerate(drawn.items()):
            if i == 0 and band is not None:
                _band(panel, t, value[:, k], 1.96 * band[:, k])
            _curve(panel, t, value[:, k], label, color=color(i), linestyle=dash(i))
        _fit_to(panel, actual[:, k])
        panel.set_title(names[k])
        panel.set_ylabel(f"[{units[k]}]")
    _time_axis(axes, columns)
    legend_above(figure, axes[0])
    return figure


@styled
def histories(
    time: ArrayLike,
    values: Mapping[str, tuple[str, Mapping[str, ArrayLike]]],
    *,
    columns: int = 1,
) -> Figure:
    """Signals over time, a panel for each group that shares a unit.

    Args:
        time: Time, (N,) [s].
        values: Title of a panel -> (unit, signals by name, each (N,) [unit]).
        columns: Panels side by side.
    """
    t = np.asarray(time, float)
    figure, axes = _grid(len(values), columns)
    for panel, (title, (unit, signals)) in zip(axes, values.items(), strict=True):
        for i, (label, signal) in enumerate(signals.items()):
            _curve(panel, t, np.asarray(signal, float), label, color=color(i), linestyle=dash(i))
        panel.set_title(title)
        panel.set_ylabel(f"[{unit}]")
        if len(signals) > 1:
            panel.legend(ncols=min(len(signals), 4), loc="best")
    _time_axis(axes, columns)
    return figure


@styled
def innovation_and_covariance(
    time: ArrayLike,
    innovation: ArrayLike,
    largest_variance: ArrayLike,
    *,
    names: Sequence[str],
    units: Sequence[str],
    expected_std: ArrayLike | None = None,
) -> Figure:
    """Figure of the innovation of each update and of the largest variance of a weight.

    Args:
        time: Time of each update, (U,) [s].
        innovation: Measured minus predicted, (U, k).
        largest_variance: Largest diagonal entry of the weights' covariance, (U,).
        names: Names of the k outputs.
        units: Units of the k outputs.
        expected_std: Standard deviation the filter gave each innovation, (U, k).

    Raises:
        ShapeError: If an array does not fit the others.
    """
    t = np.asarray(time, float)
    found = _columns("innovation", innovation, t.size, len(names))
    figure, axes = _grid(len(names) + 1, 1)
    for k, panel in enumerate(axes[:-1]):
        if expected_std is not None:
            expected = _columns("expected_std", expected_std, t.size, len(names))
            _band(panel, t, np.zeros(t.size), 1.96 * expected[:, k])
        _curve(panel, t, found[:, k], "innovation", color=color(1))
        _fit_to(panel, found[:, k])
        panel.set_title(f"Innovation of {names[k]}")
        panel.set_ylabel(f"[{units[k]}]")
    variance = _columns("largest_variance", largest_variance, t.size, 1)
    _curve(axes[-1], t, variance[:, 0], "largest", color=color(0))
    axes[-1].set_yscale("log")
    axes[-1].set_title("Largest variance of a weight")
    axes[-1].set_ylabel("[1]")
    _time_axis(axes, 1)
    return figure


@styled
def paths(
    time: ArrayLike,
    value: ArrayLike,
    std: ArrayLike,
    prior: ArrayLike,
    *,
    names: Sequence[str],
    units: Sequence[str],
) -> Figure:
    """Estimated numbers over time, within two standard deviations.

    Args:
        time: Of each estimate, (U,) [s].
        value: Estimates, (U, k).
        std: Their standard deviations, (U, k); nan draws no band.
        prior: Values before any, (k,) [units].
        names: Of the k numbers.
        units: Of the k numbers.

    Raises:
        ShapeError: If an array does not fit the others.
    """
    t = np.asarray(time, float)
    found = _columns("value", value, t.size, len(names))
    spread = _columns("std", std, t.size, len(names))
    figure, axes = _grid(len(names), 1)
    for k, (panel, before) in enumerate(zip(axes, _row("prior", prior, len(names)), strict=True)):
        _band(panel, t, found[:, k], 2 * spread[:, k])
        _curve(panel, t, found[:, k], "estimate", color=color(1))
        panel.axhline(before, color="0.5", linestyle="--", linewidth=0.8)
        panel.set_title(names[k])
        panel.set_ylabel(f"[{units[k]}]")
    _time_axis(axes, 1)
    return figure


@styled
def curves(
    x: ArrayLike,
    expected: ArrayLike,
    found: Mapping[str, ArrayLike],
    *,
    abscissa: str,
    ordinate: str,
) -> Figure:
    """Figure of expected and found values over any abscissa.

    Args:
        x: Abscissa, (N,), in the unit of its name.
        expected: Expected values, (N,), in the unit of the ordinate.
        found: Found values by name, each (N,), in the unit of the ordinate.
        abscissa: Its name and unit.
        ordinate: Its name and unit.

    Raises:
        ShapeError: If an array does not fit the abscissa.
    """
    along = np.asarray(x, float)
    figure, axes = _grid(1, 1, height=3.0)
    few = {"marker": "o"} if along.size < 12 else {}
    _curve(axes[0], along, _row("expected", expected, along.size), "expected", color=TRUTH, **few)
    for i, (name, values) in enumerate(found.items()):
        row = _row(name, values, along.size)
        _curve(axes[0], along, row, name, color=color(i), linestyle=dash(i), **few)
    axes[0].set_xlabel(abscissa)
    axes[0].set_ylabel(ordinate)
    legend_above(figure, axes[0])
    return figure


def _grid(count: int, columns: int, height: float = 1.7) -> tuple[Figure, list[Axes]]:
    rows = -(-count // columns)
    figure, axes = panels(rows, columns, height)
    for spare in axes.flat[count:]:
        spare.set_visible(False)
    return figure, list(axes.flat[:count])


def _time_axis(axes: Sequence[Axes], columns: int) -> None:
    for panel in axes:
        panel.margins(x=0.0)
    for panel in axes[:-columns]:
        panel.tick_params(labelbottom=False)
    for panel in axes[-columns:]:
        panel.set_xlabel("time [s]")


def _curve(panel: Axes, time: Vectors, values: Vectors, label: str, **look: Any) -> None:
    if values.shape != time.shape:
        raise ShapeError(label, time.shape, values.shape)
    panel.plot(*envelope(time, values), label=label, **look)


def _band(panel: Axes, time: Vectors, middle: Vectors, half_width: Vectors) -> None:
    step = max(1, time.size // 1600)
    t, m, w = time[::step], middle[::step], half_width[::step]
    panel.fill_between(
        t, m - w, m + w, color="#b9c4cf", alpha=0.6, linewidth=0, label="predicted 95 % interval"
    )


def _fit_to(panel: Axes, truth: Vectors) -> None:
    """Limits from the truth alone: a diverged estimate does not flatten the curve."""
    finite = truth[np.isfinite(truth)]
    if finite.size == 0 or np.ptp(finite) == 0.0:
        return
    low, high = finite.min(), finite.max()
    room = 0.25 * (high - low)
    panel.set_ylim(low - room, high + room)


def _columns(name: str, values: ArrayLike, rows: int, width: int) -> Vectors:
    array = np.asarray(values, float)
    if array.ndim == 1:
        array = array[:, None]
    if array.shape != (rows, width):
        raise ShapeError(name, (rows, width), array.shape)
    return array


def _row(name: str, values: ArrayLike, width: int) -> Vectors:
    array = np.asarray(values, float)
    if array.shape != (width,):
        raise ShapeError(name, (width,), array.shape)
    return array
