"""Figures of whole things: a machine from above and behind, a flight at a glance, a wingbeat.

A machine is drawn from points, a flight from its Dataset (dimensions time, dof,
strip, axis). They have no perspective and no hidden surfaces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from patagium.errors import FlightError, ShapeError
from patagium.report.style import (
    TRUTH,
    color,
    dash,
    envelope,
    height,
    legend_above,
    panels,
    styled,
    width,
)

_ATTITUDE = ("roll", "pitch", "yaw")
_QUATERNION = ("qw", "qx", "qy", "qz")
_ABOVE, _BEHIND = (1, 0), (1, 2)  # the two axes of a view, across then up the page

_Group: TypeAlias = tuple[str, str, dict[str, NDArray[np.float64]]]


@styled
def machine(
    title: str,
    *,
    strips: Mapping[str, ArrayLike],
    joints: Mapping[str, ArrayLike],
    centers: Mapping[str, ArrayLike],
    links: Sequence[ArrayLike] = (),
) -> Figure:
    """A robot from above and from behind: wings cut in strips, joints, centers of mass.

    Args:
        title: Name of the machine.
        strips: Wing -> corners of its strips, (n_strips, 4, 3) [m], world axes.
        joints: Name -> position, (3,) [m].
        centers: Body -> center of mass, (3,) [m].
        links: Ends of the lines that join the joints, each (2, 3) [m].

    Raises:
        ShapeError: If strips are not (n_strips, 4, 3), or there is nothing to draw.
    """
    corners = {wing: np.asarray(value, float) for wing, value in strips.items()}
    for wing, value in corners.items():
        if value.ndim != 3 or value.shape[1:] != (4, 3):
            raise ShapeError(f"strips of {wing}", "(n_strips, 4, 3)", value.shape)
    points = _points(corners, joints, centers)
    if not len(points):
        raise ShapeError("strips, joints and centers", "one point at least", "none")
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.06 * (high - low).max()
    low, high = low - room, high + room
    heights = (high - low)[[0, 2]]
    tall = 0.82 * width() * heights.sum() / (high - low)[1] + 1.2
    figure = Figure(figsize=(width(), float(np.clip(tall, 3.0, 12.0))), layout="compressed")
    above, behind = figure.subplots(2, 1, height_ratios=heights.tolist())
    for panel, view in ((above, _ABOVE), (behind, _BEHIND)):
        _draw_machine(panel, view, corners, joints, centers, links)
        panel.set_xlim(high[view[0]], low[view[0]])  # y, to the left
        panel.set_ylim(low[view[1]], high[view[1]])
    above.set_title(f"{title}, from above")
    above.set_ylabel("x, forward [m]")
    behind.set_title("from behind")
    behind.set_ylabel("z, up [m]")
    behind.set_xlabel("y, to the left [m]")
    legend_above(figure, above)
    return figure


@styled
def flight_overview(flight: Any) -> Figure:
    """A flight at a glance: path, attitude, joints, the air's force and the energies.

    Args:
        flight: Dataset [SI] with `q`, `v`, `aero_force` (time, dof; with a quaternion q is (time,
            coordinate)), `kinetic_energy`, `potential_energy` and `energy_residual` (time).

    Raises:
        FlightError: If one of them is missing.
    """
    wanted = ("q", "aero_force", "kinetic_energy", "potential_energy", "energy_residual")
    missing = [name for name in wanted if name not in flight]
    if missing:
        raise FlightError(f"flight: expected the quantities {wanted}, missing {missing}")
    time = np.asarray(flight["time"], float)
    groups = _overview_groups(flight)
    figure = Figure(figsize=(width(), height(1.75 * len(groups)) + 0.5), layout="constrained")
    axes = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
    for panel, (name, unit, signals) in zip(axes, groups, strict=True):
        for i, (label, values) in enumerate(signals.items()):
            look = {"color": color(i), "linestyle": dash(i), "label": label}
            panel.plot(*envelope(time, np.asarray(values, float)), **look)
        panel.set_title(name)
        panel.set_ylabel(f"[{unit}]")
        panel.margins(x=0.0)
        panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), fontsize="small")
    axes[-1].set_xlabel("time [s]")
    return figure


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
        panel.set_title(title)
        panel.set_ylabel(f"[{unit}]")
        panel.margins(x=0.0)
    axes[-1, 0].set_xlabel("share of a wingbeat [1]; bands: one deviation between beats")
    legend_above(figure, axes[0, 0])
    return figure


def _overview_groups(flight: Any) -> list[_Group]:
    names = [str(name) for name in flight["dof"].values]
    position = [n for n in ("x", "y", "z") if n in names]
    attitude = [n for n in _ATTITUDE if n in names]
    others = [n for n in names if n not in position + attitude]
    q, force = flight["q"], flight["aero_force"]
    if "coordinate" in q.dims:
        q = q.rename(coordinate="dof")
    coordinates = [str(name) for name in q["dof"].values]
    quaternion = [n for n in _QUATERNION if n in coordinates]
    angles = [] if quaternion else attitude
    energy = ("kinetic_energy", "potential_energy", "energy_residual")
    groups: list[_Group] = [
        ("Position", "m", {n: q.sel(dof=n).values for n in position}),
        ("Attitude", "deg", {n: np.degrees(q.sel(dof=n).values) for n in angles}),
        ("Attitude", "1", {n: q.sel(dof=n).values for n in quaternion}),
        ("Joints", "deg", {n: np.degrees(q.sel(dof=n).values) for n in _moving(q, others)}),
        ("Force of the air", "N", {n: force.sel(dof=n).values for n in position}),
        ("Moment of the air", "N m", {n: force.sel(dof=n).values for n in attitude}),
        ("Energy", "J", {n.replace("_", " "): flight[n].values for n in energy}),
    ]
    return [group for group in groups if group[2]]


def _moving(q: Any, names: Sequence[str]) -> list[str]:
    """The joints that move; one of each mirrored pair that moves alike."""
    kept: list[str] = []
    for name in names:
        values = q.sel(dof=name).values
        twin = name.replace("right_", "left_", 1)
        alike = twin in kept and np.array_equal(values, q.sel(dof=twin).values)
        if np.ptp(values) > 0.0 and not alike:
            kept.append(name)
    return kept


def _draw_machine(
    panel: Axes,
    view: tuple[int, int],
    corners: Mapping[str, NDArray[np.float64]],
    joints: Mapping[str, ArrayLike],
    centers: Mapping[str, ArrayLike],
    links: Sequence[ArrayLike],
) -> None:
    across, up = view
    for i, (wing, value) in enumerate(corners.items()):
        outlines = list(value[:, :, [across, up]])
        panel.add_collection(
            PolyCollection(outlines, facecolor=color(i), edgecolor=color(i), alpha=0.35, label=wing)
        )
    for link in links:
        ends = np.asarray(link, float)
        panel.plot(ends[:, across], ends[:, up], color=TRUTH, linewidth=1.6)
    spots = np.array([np.asarray(p, float) for p in joints.values()]).reshape(-1, 3)
    panel.plot(spots[:, across], spots[:, up], "o", color=TRUTH, markersize=5, label="joint")
    masses = np.array([np.asarray(p, float) for p in centers.values()]).reshape(-1, 3)
    panel.plot(
        masses[:, across], masses[:, up], "P", color=color(3), markersize=6, label="center of mass"
    )
    panel.set_aspect("equal")


def _points(
    corners: Mapping[str, NDArray[np.float64]],
    joints: Mapping[str, ArrayLike],
    centers: Mapping[str, ArrayLike],
) -> NDArray[np.float64]:
    """All points to be seen, (N, 3) [m]."""
    spots = [np.asarray(p, float) for p in (*joints.values(), *centers.values())]
    return np.concatenate(
        [np.zeros((0, 3)), *(p.reshape(-1, 3) for p in (*spots, *corners.values()))]
    )
