"""Figures of the reproduction: the paper's four, and further ones.

Forces are shown over the last few wingbeats; the innovations show the start.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from patagium.learning.result import Identification
from patagium.report.figures import comparison, flight_overview, innovation_and_covariance
from patagium.report.style import color, dash, figures_for, legend_above, panels, styled
from patagium.viewer import still
from patagium_lab.comparisons import score_points, time_points
from patagium_lab.gallery import Gallery
from patagium_lab.reproduction.cases import LEARNERS, NETWORKS, STRIPS
from patagium_lab.reproduction.flights import beat_frequency
from patagium_lab.reproduction.trials import TrialResult

BEATS = 3
"""Number of wingbeats in the figures of forces."""
SILENT = 1e-9
"""Share of the largest force below which a force is rounding error and is drawn as zero."""
BODY = ("x", "y", "z")
ATTITUDE = ("roll", "pitch", "yaw")
LEFT_WING = ("left_plunge", "left_mediolateral", "left_elbow", "left_feather")
WORDS = {
    "published": "Published flight",
    "corrected": "Corrected flight",
    "unsteady_free": "Air with memory, free flight",
    "unsteady_fixed": "Air with memory, fixed mount",
}
PARTS = ("body", "attitude", "left_wing")


def opening_figures(
    gallery: Gallery,
    flight: str,
    record: xr.Dataset,
    runs: Mapping[str, xr.Dataset],
    predicted: Identification | None,
) -> None:
    """Picture of a moment of a flight, and its lift as it was predicted; legible on a phone.

    Args:
        gallery: Gallery that receives them.
        flight: Key of the flight.
        record: The flight.
        runs: Predictions of each network, by its name.
        predicted: What was learned from it, for arrows.
    """
    beat = 1.0 / beat_frequency(record)
    late = record["time"].values[-1] - 1.5 * beat
    highest = record["aero_force"].sel(dof="z", time=slice(late, late + beat)).idxmax("time")
    with figures_for("phone"):
        moment = still(record, highest.item(), predicted=predicted)
        lift = _forces(runs, ("z",), beat)
    lift.axes[0].set_title("Force of the air, upward", loc="left", fontsize="medium")
    caption = (
        "The robot at its greatest lift; arrows: force on each strip; a click in the report "
        "plays the flight."
    )
    gallery.add(f"{flight}_still", moment, caption)
    caption = (
        f"Lift over the last {BEATS} wingbeats: actual, and predicted before a sample was used."
    )
    gallery.add(f"{flight}_lift", lift, caption)


def force_figures(
    gallery: Gallery,
    flight: str,
    runs: Mapping[str, xr.Dataset],
    beat: float,
    parts: Sequence[str] = PARTS,
) -> None:
    """Generalized forces of body and left wing, actual and estimated, one sample in 100.

    Args:
        gallery: Gallery that receives them.
        flight: Key of the flight.
        runs: Predictions of each network, by its name.
        beat: Duration of a wingbeat [s].
        parts: Groups of forces that are drawn.
    """
    groups = {"body": BODY, "attitude": ATTITUDE, "left_wing": LEFT_WING}
    titles = {
        "body": "Generalized forces in x, y and z",
        "attitude": "Generalized forces on roll, pitch and yaw",
        "left_wing": "Generalized forces on the joints of the left wing",
    }
    for key in parts:
        figure = _forces(runs, groups[key], beat)
        caption = (
            f"{WORDS[flight]}. {titles[key]}, actual and estimated before the sample was used, "
            f"one sample in 100; the last {BEATS} wingbeats."
        )
        gallery.add(f"{flight}_forces_{key}", figure, caption)


def _forces(runs: Mapping[str, xr.Dataset], names: Sequence[str], beat: float) -> Figure:
    first = next(iter(runs.values()))
    time = first["time"].to_numpy()
    shown = time > time[-1] - BEATS * beat
    actual = first["measurement"].sel(output=list(names)).to_numpy()
    moving = np.abs(actual).max(axis=0) > SILENT * np.abs(first["measurement"]).max().item()
    truth = np.where(moving, actual, 0.0)[shown]
    chosen = {
        name: np.where(moving, record["prediction"].sel(output=list(names)).to_numpy(), 0.0)[shown]
        for name, record in runs.items()
    }
    units = ["N" if name in BODY else "N m" for name in names]
    return comparison(time[shown], truth, chosen, names=list(names), units=units)


def innovation_figure(gallery: Gallery, flight: str, record: xr.Dataset) -> None:
    """Innovation of each update of the strip network, and its largest variance.

    Args:
        gallery: Gallery that receives it.
        flight: Key of the flight.
        record: Predictions of its trial.
    """
    looked = np.isfinite(record["largest_variance"].to_numpy())
    chosen = record.isel(update_time=looked).sel(output=["x", "z", "pitch", "left_plunge"])
    figure = innovation_and_covariance(
        chosen["update_time"].to_numpy(),
        chosen["innovation"].to_numpy(),
        chosen["largest_variance"].to_numpy(),
        names=["x", "z", "pitch", "left plunge"],
        units=["N", "N", "N m", "N m"],
    )
    caption = (
        f"{WORDS[flight]}, strip network, one sample in 100: innovation of each update, and the "
        "largest variance of a weight, which starts just below 1e-2 by choice of the prior."
    )
    gallery.add(f"{flight}_innovation", figure, caption)


def overview_figure(gallery: Gallery, flight: str, record: xr.Dataset) -> None:
    """The flight at a glance.

    Args:
        gallery: Gallery that receives it.
        flight: Key of the flight.
        record: The flight.
    """
    caption = f"{WORDS[flight]}: path, attitude, joints, force and moment of the air, energies."
    gallery.add(f"{flight}_flight", flight_overview(record), caption)


def curve_figure(gallery: Gallery, flight: str, runs: Sequence[TrialResult]) -> None:
    """Learning curves: error against samples used.

    Args:
        gallery: Gallery that receives it.
        flight: Key of the flight.
        runs: Results of the trials of the flight.
    """
    curves = {_curve_name(run): run.scores["curve"] for run in _curves(runs)}
    caption = (
        f"{WORDS[flight]}: normalized mean square error, mean over the forces, in windows of "
        "time, against the samples used until the end of the window."
    )
    gallery.add(f"{flight}_learning", _learning(curves), caption)


def _curves(runs: Sequence[TrialResult]) -> Iterator[TrialResult]:
    best = STRIPS[runs[0].trial.flight][0]
    wanted = (
        (best, "cubature", 100),
        ("strip_rotation", "cubature", 100),
        ("dense", "cubature", 100),
        ("dense", "cubature", 1),
        ("dense_published", "extended", 100),
        ("dense_published", "replay", 100),
        ("", "features", 100),
    )
    for network, learner, every in wanted:
        for run in runs:
            trial = run.trial
            if (trial.network, trial.learner, trial.every) == (network, learner, every):
                yield run


def _curve_name(run: TrialResult) -> str:
    trial = run.trial
    rate = "every sample" if trial.every == 1 else f"one in {trial.every}"
    network = NETWORKS.get(trial.network)
    if network is None:
        return f"{LEARNERS[trial.learner]}, {rate}"
    return f"{network.split(',')[0]}, {trial.learner}, {rate}"


@styled
def _learning(curves: Mapping[str, Mapping[str, Sequence[float]]]) -> Figure:
    figure, axes = panels(1, 1, row_height=3.8)
    panel = axes[0, 0]
    for i, (name, curve) in enumerate(curves.items()):
        used, error = np.array(curve["samples_used"]), np.array(curve["nmse"])
        panel.plot(used, error, color=color(i), linestyle=dash(i), label=name)
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_xlabel("samples used [1]")
    panel.set_ylabel("normalized mean square error [1]")
    legend_above(figure, panel)
    return figure


def unseen_figure(gallery: Gallery, flight: str, runs: Mapping[str, TrialResult]) -> None:
    """Error of frozen weights on each gait that was not learned.

    Args:
        gallery: Gallery that receives it.
        flight: Key of the flight.
        runs: Result of each method, by its name.
    """
    gaits = list(next(iter(runs.values())).scores["unseen"])
    scores = {
        name: [run.scores["unseen"][gait]["worst"] for gait in gaits] for name, run in runs.items()
    }
    caption = f"{WORDS[flight]}: worst error on gaits that were not learned, weights frozen."
    gallery.add(f"{flight}_unseen", score_points(gaits, scores), caption)


def overhead_figures(gallery: Gallery, overhead: Mapping[str, Any]) -> None:
    """Figures of the overheads of dynamics and of aerodynamics, as in the paper.

    Args:
        gallery: Gallery that receives them.
        overhead: Rows of `dynamics_overhead` and `aerodynamics_overhead`.
    """
    quantities = {"mass_matrix": "D", "bias": "C v + G", "both": "D and C v + G"}
    times = {
        title: {
            f"{row['formulation']} ({row['run']})": 1e-9 * row[key]
            for row in overhead["dynamics"]
            if row[key] is not None and np.isfinite(row[key])
        }
        for key, title in quantities.items()
    }
    gallery.add(
        "overhead_dynamics",
        time_points(times),
        "Overhead of dynamics: symbolic against algorithmic differentiation, the same robot; "
        "compiled with compiled and interpreted with interpreted.",
    )
    models = {row["model"]: {row["kind"]: 1e-9 * row["single"]} for row in overhead["aerodynamics"]}
    gallery.add(
        "overhead_aerodynamics",
        time_points(models),
        "Overhead of aerodynamics: every model of the air and what learned it, force and rates of "
        "its own states, one state a call.",
    )
