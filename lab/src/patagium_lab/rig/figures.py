"""The figures of the rig: errors against noise, forces over a few wingbeats, a lab's wingbeat.

Neglected: the arm in three dimensions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from patagium.report.figures import comparison, flight_overview
from patagium.report.style import TRUTH, color, dash, legend_above, panels, styled
from patagium_lab.comparisons import score_points
from patagium_lab.gallery import Gallery
from patagium_lab.rig.learning import SOURCES, LogResult
from patagium_lab.rig.plan import RigPlan
from patagium_lab.rig.scores import LEARNED_LIMIT, UNSEEN_LIMIT, true_force

SHOWN = {
    "x": "N",
    "y": "N",
    "z": "N",
    "roll": "N m",
    "pitch": "N m",
    "left_plunge": "N m",
    "left_elbow": "N m",
}
"""Forces that are drawn where the robot has them, and their units."""
BEATS = 3
"""Number of wingbeats that are drawn."""
_LEAST = 1e-7  # error below which a logarithmic axis begins


def flight_figure(gallery: Gallery, flight: xr.Dataset) -> None:
    """The flight that is learned, at a glance.

    Args:
        gallery: Gallery that receives it.
        flight: True flight.
    """
    caption = "The flight that is learned, as the simulation knows it: path, joints, air, energy."
    gallery.add("flight", flight_overview(flight), caption)


def noise_figure(gallery: Gallery, rows: Sequence[Mapping[str, Any]]) -> None:
    """Errors against the noise of the instruments, for each source of forces.

    Args:
        gallery: Gallery that receives it.
        rows: Scores at each factor of noise.
    """
    caption = (
        "Worst error of all coordinates against the noise of the instruments: of the measured "
        "force itself, of what was learned from it, and of frozen weights on a path and gait "
        "never seen. Dotted: the targets. The scales differ."
    )
    gallery.add("noise", _noise(rows), caption)


@styled
def _noise(rows: Sequence[Mapping[str, Any]]) -> Figure:
    titles = ("Measured force, second half", "Learned force, second half", "Unseen path and gait")
    figure, axes = panels(1, 3, row_height=3.4)
    factors = [row["noise"] for row in rows]
    for i, source in enumerate(SOURCES):
        ones = [row["sources"][source] for row in rows]
        lines = (
            [one["measured_worst"] for one in ones],
            [one["worst"] for one in ones],
            [one["unseen"]["path and gait"]["worst"] for one in ones],
        )
        for panel, line in zip(axes[0], lines, strict=True):
            values = np.maximum(line, _LEAST)
            panel.plot(factors, values, color=color(i), linestyle=dash(i), marker="o", label=source)
    for panel, title, limit in zip(
        axes[0], titles, (None, LEARNED_LIMIT, UNSEEN_LIMIT), strict=True
    ):
        if limit is not None:
            panel.axhline(limit, color=TRUTH, linestyle=":", linewidth=1.0)
        panel.set_yscale("log")
        panel.set_title(title)
        panel.set_xlabel("noise over the data sheets' [1]")
    axes[0, 0].set_ylabel("normalized mean square error [1]")
    legend_above(figure, axes[0, 0])
    return figure


def force_figure(
    gallery: Gallery, plan: RigPlan, flight: xr.Dataset, run: LogResult, factor: float
) -> None:
    """True, measured and learned forces over the last wingbeats.

    Args:
        gallery: Gallery that receives it.
        plan: Plan of the rig.
        flight: True flight.
        run: Result of a log.
        factor: Noise of the log over that of the data sheets.
    """
    one = run.runs[SOURCES[0]]
    time, robot = one.samples.time, one.samples.robot
    names = [name for name in SHOWN if name in robot.dof_names]
    columns = [robot.index(name) for name in names]
    shown = time > time[-1] - BEATS * plan.beat
    std = np.full_like(one.prediction, np.nan)
    std[one.checked] = one.std
    band = _filled(time, std)[shown][:, columns]
    figure = comparison(
        time[shown],
        true_force(flight, time)[shown][:, columns],
        {
            "learned": one.prediction[shown][:, columns],
            "measured": one.samples.force[shown][:, columns],
        },
        names=names,
        units=[SHOWN[name] for name in names],
        truth_name="true",
        std=band,
        columns=2,
    )
    caption = (
        f"Force of the air, added mass taken off, over the last {BEATS} wingbeats at {factor:g} "
        "times the noise of the data sheets: the truth, what inverse dynamics measured, and what "
        "had been learned before each sample was used, with its 95 % interval."
    )
    gallery.add("forces", figure, caption)


def wingbeat_figure(gallery: Gallery, cycles: Mapping[str, xr.Dataset], factor: float) -> None:
    """A wingbeat as a load-cell laboratory draws it, and the true one.

    Args:
        gallery: Gallery that receives it.
        cycles: Cycle statistics of "truth" and "measured".
        factor: Noise over that of the data sheets.
    """
    caption = (
        "Lift, thrust and power over a wingbeat, averaged over all wingbeats of the flight. Bands "
        "are one standard deviation between them, most of it from the arm's eight. Measured at "
        f"{factor:g} times the noise of the data sheets."
    )
    gallery.add("wingbeat", _wingbeat(cycles), caption)


@styled
def _wingbeat(cycles: Mapping[str, xr.Dataset]) -> Figure:
    figure, axes = panels(1, 3, row_height=3.0)
    groups = (("lift", "Lift", "N"), ("thrust", "Thrust", "N"), ("power", "Power", "W"))
    for panel, (name, title, unit) in zip(axes[0], groups, strict=True):
        for i, (label, one) in enumerate(cycles.items()):
            phase, mean = one["phase"].values, one[name].values
            spread = np.nan_to_num(one[f"{name}_spread"].values)
            shade = TRUTH if i == 0 else color(0)
            panel.fill_between(phase, mean - spread, mean + spread, color=shade, alpha=0.15)
            panel.plot(phase, mean, color=shade, linestyle=dash(i), label=label)
        panel.set_title(title)
        panel.set_ylabel(f"[{unit}]")
        panel.set_xlabel("share of a wingbeat [1]")
        panel.margins(x=0.0)
    legend_above(figure, axes[0, 0])
    return figure


def limits_figure(gallery: Gallery, rows: Sequence[Mapping[str, Any]]) -> None:
    """Figure of what limits the measured force.

    Args:
        gallery: Gallery that receives it.
        rows: Worst error by source, one row a case.
    """
    scores = {source: [row[source] for row in rows] for source in SOURCES}
    caption = "Worst error of the measured force, one thing changed at a time."
    gallery.add("limits", score_points([row["case"] for row in rows], scores), caption)


def _filled(time: Any, values: Any) -> Any:
    """Values between those that are known, by straight lines, (N, n)."""
    known = np.isfinite(values).all(axis=1)
    return np.column_stack([np.interp(time, time[known], column[known]) for column in values.T])
