"""Figures of flights, estimates, learners and clocks, from plain arrays.

Each function returns a matplotlib `Figure` that no window owns; `report.picture`
puts it on a page and `report.save_figure` in a file. Units stand on every axis. A machine is
drawn from points, a flight from its Dataset, without perspective and hidden surfaces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, real_array
from patagium.errors import FlightError, ParameterError, ShapeError, finite
from patagium.reading import made_again, parsed_json
from patagium.report.page import draw
from patagium.report.style import TRUTH, color, dash, envelope, legend_above, panels, styled, width
from patagium.whole_file import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write a figure as PDF, PNG or SVG, chosen by the name of the file; whole or not at all.

    Raises:
        ParameterError: If the name ends otherwise.
        OutputError: If it cannot be written.
    """
    return write_whole(path, draw(figure, figure_kind(path)))


def figure_kind(path: str | Path) -> Literal["pdf", "svg", "png"]:
    """Kind of a figure by the name of its file.

    Args:
        path: The file, which need not exist.

    Raises:
        ParameterError: If the name ends otherwise.
    """
    kind = Path(path).suffix.lower().lstrip(".")
    if kind not in ("pdf", "png", "svg"):
        raise ParameterError("figure file", "a name ending in .pdf, .png or .svg", Path(path).name)
    return cast('Literal["pdf", "svg", "png"]', kind)


@styled
def comparison(
    time: ArrayLike,
    truth: ArrayLike | None,
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
        truth: Actual values, (N, k) [units]; None: not known.
        estimates: Estimated values by name, each (N, k) [units]; NaN where they are not known.
        names: Names of the k quantities.
        units: Units of the k quantities.
        truth_name: Name of the truth: "actual", "measured".
        std: Predicted standard deviation of the first estimate, (N, k) [units]: a
            band of 1.96 deviations, the predicted 95 % interval.
        columns: Panels side by side.

    Raises:
        ShapeError: If an array does not fit the others.
    """
    t = np.asarray(time, float)
    drawn = {key: _columns(key, value, t.size, len(names)) for key, value in estimates.items()}
    actual = None if truth is None else _columns("truth", truth, t.size, len(names))
    main = next(iter(drawn.values())) if actual is None else actual
    band = None if std is None else _columns("std", std, t.size, len(names))
    figure, axes = _over_time(names, units, columns)
    for k, panel in enumerate(axes):
        if actual is not None:
            _curve(panel, t, actual[:, k], truth_name, color=TRUTH, linewidth=2.4)
        for i, (label, value) in enumerate(drawn.items()):
            if i == 0 and band is not None:
                _band(panel, t, value[:, k], 1.96 * band[:, k])
            _curve(panel, t, value[:, k], label, color=color(i), linestyle=dash(i))
        _fit_to(panel, main[:, k])
    legend_above(figure, axes[0])
    return figure


@styled
def histories(
    time: ArrayLike, groups: Sequence[_Group], events: Sequence[tuple[float, str]] = ()
) -> Figure:
    """Signals over time, a panel for each group that shares a unit.

    Args:
        time: Time, (N,) [s].
        groups: Title of a panel, unit, and signals by name, each (N,) [unit].
        events: Times [s] and what happened then.
    """
    t = np.asarray(time, float)
    units = [unit for _, unit, _ in groups]
    figure, axes = _over_time([title for title, *_ in groups], units)
    for panel, (_, _, signals) in zip(axes, groups, strict=True):
        for i, (label, signal) in enumerate(signals.items()):
            _curve(panel, t, np.asarray(signal, float), label, color=color(i), linestyle=dash(i))
        for when, words in events:
            panel.axvline(when, color=TRUTH, ls=":", label=words)
        panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), fontsize="small")
    return figure


@styled
def innovation_and_covariance(
    time: ArrayLike,
    innovation: ArrayLike,
    largest_variance: ArrayLike,
    *,
    names: Sequence[str],
    units: Sequence[str],
) -> Figure:
    """Figure of the innovation of each update and of the largest variance of a weight.

    Args:
        time: Time of each update, (U,) [s].
        innovation: Measured minus predicted, (U, k).
        largest_variance: Largest diagonal entry of the weights' covariance, (U,).
        names: Names of the k outputs.
        units: Units of the k outputs.

    Raises:
        ShapeError: If an array does not fit the others.
    """
    t = np.asarray(time, float)
    found = _columns("innovation", innovation, t.size, len(names))
    titles = [*(f"Innovation of {name}" for name in names), "Largest variance of a weight"]
    figure, axes = _over_time(titles, [*units, "1"])
    for k, panel in enumerate(axes[:-1]):
        _curve(panel, t, found[:, k], "innovation", color=color(1))
        _fit_to(panel, found[:, k])
    variance = _columns("largest_variance", largest_variance, t.size, 1)
    _curve(axes[-1], t, variance[:, 0], "largest", color=color(0))
    axes[-1].set_yscale("log")
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
        time: Time of each estimate, (U,) [s].
        value: Estimates, (U, k).
        std: Their standard deviations, (U, k); nan draws no band.
        prior: Values before the first estimate, (k,) [units].
        names: Names of the k numbers.
        units: Units of the k numbers.

    Raises:
        ShapeError: If an array does not fit the others.
    """
    t = np.asarray(time, float)
    found = _columns("value", value, t.size, len(names))
    spread = _columns("std", std, t.size, len(names))
    start = real_array("prior", prior, (len(names),))
    figure, axes = _over_time(names, units)
    for k, (panel, before) in enumerate(zip(axes, start, strict=True)):
        _band(panel, t, found[:, k], 2 * spread[:, k])
        _curve(panel, t, found[:, k], "estimate", color=color(1))
        panel.axhline(before, color="0.5", linestyle="--", linewidth=0.8)
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
    figure, axes = panels(1, row_height=3.0)
    panel = axes[0, 0]
    marker = "o" if along.size < 12 else ""
    row = real_array("expected", expected, along.shape)
    panel.plot(along, row, label="expected", color=TRUTH, marker=marker)
    for i, (name, values) in enumerate(found.items()):
        row = real_array(name, values, along.shape)
        panel.plot(along, row, label=name, color=color(i), linestyle=dash(i), marker=marker)
    panel.set(xlabel=abscissa, ylabel=ordinate)
    legend_above(figure, panel)
    return figure


def _over_time(
    titles: Sequence[str], units: Sequence[str], columns: int = 1
) -> tuple[Figure, list[Axes]]:
    """Figure of a panel for each title, and the panels, with time below the last row."""
    figure, grid = panels(-(-len(titles) // columns), columns)
    axes: list[Axes] = list(grid.flat[: len(titles)])
    for spare in grid.flat[len(titles) :]:
        spare.set_visible(False)
    for panel, title, unit in zip(axes, titles, units, strict=True):
        panel.set(title=title, ylabel=f"[{unit}]")
        panel.margins(x=0.0)
    for panel in axes[:-columns]:
        panel.tick_params(labelbottom=False)
    for panel in axes[-columns:]:
        panel.set_xlabel("time [s]")
    return figure, axes


def _curve(panel: Axes, time: Array, values: Array, label: str, **look: Any) -> None:
    real_array(label, values, time.shape)
    panel.plot(*envelope(time, values), label=label, **look)


def _band(panel: Axes, time: Array, middle: Array, half_width: Array) -> None:
    t, m, w = envelope(time, middle, half_width)
    panel.fill_between(
        t, m - w, m + w, color="#b9c4cf", alpha=0.6, linewidth=0, label="predicted 95 % interval"
    )


def _fit_to(panel: Axes, truth: Array) -> None:
    """Limits from the truth alone: a diverged estimate does not flatten the curve."""
    finite = truth[np.isfinite(truth)]
    if finite.size == 0 or np.ptp(finite) == 0.0:
        return
    low, high = finite.min(), finite.max()
    room = 0.25 * (high - low)
    panel.set_ylim(low - room, high + room)


def _columns(name: str, values: ArrayLike, rows: int, width: int) -> Array:
    array = np.asarray(values, float)
    if array.ndim == 1:
        array = array[:, None]
    return real_array(name, array, (rows, width))


_ATTITUDE = ("roll", "pitch", "yaw")
_QUATERNION = ("qw", "qx", "qy", "qz")
_ABOVE, _BEHIND, _LEFT = [1, 0], [1, 2], [0, 2]  # the two axes of a view, across then up the page

_Group: TypeAlias = tuple[str, str, dict[str, Array]]


class Hinge(NamedTuple):
    """A joint in a drawing.

    Attributes:
        place: Position, (3,) [m].
        axis: Axis, a unit vector, (3,) [-].
        sweep: Way of a far point of its body between the limits, (n, 3) [m]; n = 0 without any.
        words: Line of the list below the drawing; empty where it is not in the list.
    """

    place: Array
    axis: Array
    sweep: Array
    words: str


@styled
def machine(
    title: str,
    *,
    strips: Mapping[str, ArrayLike],
    joints: Mapping[str, Hinge],
    centers: Mapping[str, ArrayLike],
    outlines: Sequence[Array] = (),
    lines: Sequence[Array] = (),
) -> Figure:
    """A robot from above, behind and the left: bodies, wings, joints with limits, centers of mass.

    Args:
        title: Name of the machine.
        strips: Wing -> corners of its strips, (n_strips, 4, 3) [m], world axes.
        joints: Name -> joint; those with words are numbered.
        centers: Body -> center of mass, (3,) [m].
        outlines: Points around each body, (n, 3) [m]; the first body has the nose.
        lines: Quarter chords of the strips of each lifting line, (n, 3) [m].

    Raises:
        ShapeError: If strips are not (n_strips, 4, 3), or there is nothing to draw.
    """
    corners = {wing: np.asarray(value, float) for wing, value in strips.items()}
    for wing, value in corners.items():
        if value.ndim != 3 or value.shape[1:] != (4, 3):
            raise ShapeError(f"strips of {wing}", "(n_strips, 4, 3)", value.shape)
    spots = [np.asarray(center, float).reshape(1, 3) for center in centers.values()]
    wings = [value.reshape(-1, 3) for value in corners.values()]
    points = [*wings, *spots, *(np.array([k.place, *k.sweep]) for k in joints.values()), *outlines]
    if not points:
        raise ShapeError("strips, joints and centers", "one point at least", "none")
    seen = np.concatenate(points)
    low, high = seen.min(axis=0), seen.max(axis=0)
    room = 0.06 * (high - low).max()
    low, high = low - room, high + room * np.array([2.2, 1.0, 1.0])  # the nose's arrow
    heights = (high - low)[[0, 2, 2]]
    listed = [hinge.words for hinge in joints.values() if hinge.words]
    tall = 0.82 * width() * heights.sum() / (high - low)[1] + 1.2 + 0.16 * len(listed)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width(), float(np.clip(tall, 3.0, 15.0))), layout="compressed")
    above, behind, left = figure.subplots(3, 1, height_ratios=heights.tolist())
    for panel, view in ((above, _ABOVE), (behind, _BEHIND), (left, _LEFT)):
        for outline in outlines:
            _draw_hull(panel, outline[:, view])
        _draw_wings(panel, view, corners, lines)
        _draw_joints(panel, view, list(joints.values()), 2.0 * room)
        masses = np.concatenate([np.zeros((0, 3)), *spots])[:, view]
        panel.plot(*masses.T, "P", color=color(3), markersize=6, label="center of mass")
        panel.set_aspect("equal")
        panel.set_xlim(high[view[0]], low[view[0]])  # y to the left, or x
        panel.set_ylim(low[view[1]], high[view[1]])
    if corners:  # of an arm there are none
        _draw_nose(above, (*outlines, seen)[0], 2.0 * room)
    above.set(title=f"{title}, from above", ylabel="x, forward [m]")
    behind.set(title="from behind", xlabel="y, to the left [m]", ylabel="z, up [m]")
    left.set(title="from the left", xlabel="x, forward [m]", ylabel="z, up [m]")
    middle, half = (high + low)[0] / 2, (high - low)[:2].max() / 2  # the scale of the others
    left.set_xlim(middle + half, middle - half)
    legend_above(figure, above)
    words = "\n".join(f"{i}  {line}" for i, line in enumerate(listed, 1))
    figure.supxlabel(words, x=0.02, ha="left", fontsize="small")
    return figure


@styled
def flight_overview(flight: Any) -> Figure:
    """A flight at a glance: path, attitude, joints, the air's force and the energies.

    Args:
        flight: Dataset [SI] with `q`, `v`, `aero_force` (time, dof; with a quaternion q is (time,
            coordinate)), `kinetic_energy`, `potential_energy`, `energy_residual` (time), and the
            unit of each coordinate, `dof_unit` (dof).

    Raises:
        FlightError: If one of them is missing.
    """
    wanted = ("q", "aero_force", "kinetic_energy", "potential_energy", "energy_residual")
    missing = [name for name in wanted if name not in flight]
    if missing:
        raise FlightError(f"flight: expected the quantities {wanted}, missing {missing}")
    return histories(flight["time"], _overview_groups(flight), events_of(flight))


@styled
def wingbeat(statistics: Any) -> Figure:
    """Forces and power over one wingbeat, with their spread from beat to beat.

    Args:
        statistics: Dataset with lift, thrust and power over phase, each with its
            `_spread`; mount_lift and mount_thrust where there are any.
    """
    groups = {
        "Lift": ("N", ("lift", "mount_lift")),
        "Thrust": ("N", ("thrust", "mount_thrust")),
        "Power of the joints": ("W", ("power",)),
    }
    phase = np.asarray(statistics["phase"], float)
    figure, axes = panels(len(groups))
    for panel, (title, (unit, names)) in zip(axes[:, 0], groups.items(), strict=True):
        for i, name in enumerate(name for name in names if name in statistics):
            mean = np.asarray(statistics[name], float)
            spread = np.nan_to_num(np.asarray(statistics[f"{name}_spread"], float))
            panel.fill_between(phase, mean - spread, mean + spread, color=color(i), alpha=0.25)
            label = "at the mount, inertia included" if i else "of the air"
            panel.plot(phase, mean, color=color(i), linestyle=dash(i), label=label)
        panel.set(title=title, ylabel=f"[{unit}]")
        panel.margins(x=0.0)
    axes[-1, 0].set_xlabel("share of a wingbeat [1]; bands: one deviation between beats")
    legend_above(figure, axes[0, 0])
    return figure


def _overview_groups(flight: Any) -> list[_Group]:
    """Panels of the overview: title, unit and curves by name."""
    names = [str(name) for name in flight["dof"].values]
    position = [n for n in ("x", "y", "z") if n in names]
    attitude = [n for n in _ATTITUDE if n in names]
    others = [n for n in names if n not in position + attitude]
    coordinates = [str(name) for name in flight[flight["q"].dims[1]].values]
    q = dict(zip(coordinates, flight["q"].values.T, strict=True))
    force = dict(zip(names, flight["aero_force"].values.T, strict=True))
    quaternion = [n for n in _QUATERNION if n in q]
    angles = [] if quaternion else attitude
    energy = ("kinetic_energy", "potential_energy", "energy_residual")
    moving, unit = _moving(q, others), dict(zip(names, flight["dof_unit"].values, strict=True))
    turning = {n: np.degrees(q[n]) for n in moving if unit[n] != "m"}
    groups: list[_Group] = [
        ("Position", "m", {n: q[n] for n in position}),
        ("Attitude", "deg", {n: unwound(q[n]) for n in angles}),
        ("Attitude", "1", {n: q[n] for n in quaternion}),
        ("Joints", "deg", turning),
        ("Joints", "m", {n: q[n] for n in moving if n not in turning}),
        ("Force of the air", "N", {n: force[n] for n in position}),
        ("Moment of the air", "N m", {n: force[n] for n in attitude}),
        ("Energy", "J", {n.replace("_", " "): flight[n].values for n in energy}),
    ]
    if "reference" in flight:
        off = dict(zip(coordinates, off_reference(flight).T, strict=True))
        groups.append(("Off reference", "m", {n: off[n] for n in position}))
        groups.append(("Off reference", "deg", {n: np.degrees(off[n]) for n in angles}))
    if "command" in flight:
        names = [str(name) for name in flight["command_name"].values]
        given = dict(zip(names, flight["command"].values.T, strict=True))
        groups.append(("Commands", "Hz, 1, rad or m", given))
    return [group for group in groups if group[2]]


def off_reference(flight: Any) -> Array:
    """Coordinates less their reference, straight between samples of a controller, (N, n_q)."""
    t, known = flight["time"].values, flight["control_time"].values
    q, wanted = flight["q"].values.T, flight["reference"].values.T
    gaps = [np.interp(known, t, own) - aim for own, aim in zip(q, wanted, strict=False)]
    return np.array([np.interp(t, known, gap) for gap in gaps]).T


def events_of(flight: Any) -> list[tuple[float, str]]:
    """Time [s] and words of each event of a closed loop; none of another flight.

    Raises:
        FlightError: If the flight's events cannot be read.
    """
    with made_again("the flight's events", FlightError):
        events = parsed_json(flight.attrs.get("events", "[]"), "events")
        return [(finite("time", one["time"]), str(one["words"])) for one in events]


def unwound(angle: Array) -> Array:
    """Angle without jumps, at first within half a turn of zero, (N,) [deg].

    Args:
        angle: Angle, (N,) [rad].
    """
    whole = np.unwrap(angle)
    turn: Array = np.degrees(whole - 2 * np.pi * np.round(whole[:1] / (2 * np.pi)))
    return turn


def _moving(q: Mapping[str, Array], names: Sequence[str]) -> list[str]:
    """The joints that move; one of each mirrored pair that moves alike."""
    kept: list[str] = []
    for name in names:
        twin = name.replace("right_", "left_", 1)
        alike = twin in kept and np.array_equal(q[name], q[twin])
        if np.ptp(q[name]) > 0.0 and not alike:
            kept.append(name)
    return kept


def _draw_hull(panel: Axes, points: Array) -> None:
    """Outline of a body, as the hull of its points."""
    from scipy.spatial import ConvexHull

    outline = points[ConvexHull(points).vertices]
    panel.fill(outline[:, 0], outline[:, 1], facecolor="0.85", edgecolor="0.5", linewidth=0.8)


def _draw_wings(
    panel: Axes, view: list[int], corners: Mapping[str, Array], lines: Sequence[Array]
) -> None:
    from matplotlib.collections import PolyCollection

    for i, (wing, value) in enumerate(corners.items()):
        outlines = list(value[:, :, view])
        panel.add_collection(
            PolyCollection(outlines, facecolor=color(i), edgecolor=color(i), alpha=0.35, label=wing)
        )
    for i, line in enumerate(lines):
        label = "lifting line" if i == 0 else None
        panel.plot(*line[:, view].T, color=TRUTH, lw=0.8, ls=(0, (1, 1)), label=label)


def _draw_joints(panel: Axes, view: list[int], joints: Sequence[Hinge], length: float) -> None:
    """Places, ways between limits, and the axes that lie in the plane of the view."""
    swept = [k.sweep[:, view] for k in joints if len(k.sweep)]
    for i, way in enumerate(swept):
        label = "path of the tip between its limits" if i == 0 else None
        panel.plot(*way.T, color=color(1), linewidth=1.0, label=label)
    places = np.array([k.place for k in joints]).reshape(-1, 3)[:, view]
    panel.plot(*places.T, "o", color=TRUTH, markersize=4, label="joint")
    numbered = [k for k in joints if k.words]
    for number, joint in enumerate(numbered, 1):
        start, way = joint.place[view], joint.axis[view]
        if np.linalg.norm(way) > _IN_PLANE:
            look = {"arrowstyle": "<-", "color": TRUTH, "shrinkA": 1, "shrinkB": 0}
            tip = start + length * way
            panel.annotate(
                str(number), (*start,), (*tip,), arrowprops=look, ha="center", va="center"
            )


_IN_PLANE = 0.5  # of an axis' unit length, for its arrow to be drawn in a view


def _draw_nose(panel: Axes, outline: Array, length: float) -> None:
    front = (float(np.ptp(outline[:, 1]) / 2 + outline[:, 1].min()), float(outline[:, 0].max()))
    look = {"arrowstyle": "<-", "color": TRUTH, "linewidth": 1.6}
    tip = (front[0], front[1] + length)
    panel.annotate("nose", front, tip, arrowprops=look, ha="center", va="bottom")
