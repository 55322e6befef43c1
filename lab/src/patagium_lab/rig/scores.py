"""Scores and targets of the rig, against the truth that the simulation knows.

Errors are those of the force that is learned, without added mass, which is known; the error of each
coordinate is divided by the variance of the truth. Neglected: chance; one seed is flown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from patagium.arrays import Array
from patagium.learning import load_learner
from patagium.learning.models.memory import network_inputs
from patagium.learning.scores import IntervalSums, normalized_error
from patagium.sensing.sensors import Sensor
from patagium.simulation import cycle_statistics
from patagium_lab.rig.learning import LogResult, SourceResult
from patagium_lab.rig.plan import UNIT, RigPlan
from patagium_lab.targets import at_most, between

LEARNED_LIMIT, UNSEEN_LIMIT, COVERED = 0.02, 0.04, (0.90, 0.98)
"""Limits of the worst error, second half and unseen flights; share of the truth in the interval."""
CLOCK_LIMIT = 1e-3
"""Limit of the error of an estimated clock [s]."""


def true_force(flight: xr.Dataset, times: Array) -> Array:
    """Force of the air without added mass at given times, (N, n) [N, N m]."""
    return _at(flight, "aero_force", times)


def compare(
    plan: RigPlan, flight: xr.Dataset, unseen: Mapping[str, xr.Dataset], run: LogResult
) -> dict[str, Any]:
    """Scores of the result of one log.

    Args:
        plan: Plan of the rig.
        flight: True flight of the log.
        unseen: True flights that were not learned, by name.
        run: Result of the log.
    """
    return {
        "motion": motion_errors(flight, run.motion),
        "seconds": run.seconds,
        "sources": {
            name: _source_scores(plan, flight, unseen, one) for name, one in run.runs.items()
        },
    }


def measured_error(flight: xr.Dataset, samples: Any) -> float:
    """Worst error of a measured force over the second half, of the coordinates measured."""
    late = slice(len(samples.time) // 2, None)
    truth = true_force(flight, samples.time)[late]
    heard = np.isfinite(normalized_error(truth, truth)) & np.isfinite(samples.force[late]).all(
        axis=0
    )
    return float(normalized_error(truth[:, heard], samples.force[late][:, heard]).max())


def clock_rows(sensors: Sequence[Sensor], run: LogResult) -> list[dict[str, Any]]:
    """Rows of the true and the estimated delay of each instrument.

    Args:
        sensors: Instruments with their true clocks.
        run: Result of a log.
    """
    late = {s.name: s.clock_offset + s.delay for s in sensors}
    return [
        {
            "instrument": name,
            "true": late[name],
            "found": found,
            "std": run.shift_stds[name],
            "error": found - late[name],
        }
        for name, found in run.shifts.items()
        if name != UNIT
    ]


def motion_errors(flight: xr.Dataset, motion: xr.Dataset) -> dict[str, dict[str, float]]:
    """Standard deviation of the errors of q, v and a, without a twentieth at each end.

    Args:
        flight: True flight.
        motion: Estimated motion.
    """
    times, names = motion["time"].values, [str(name) for name in motion["dof"].values]
    inner = slice(len(times) // 20, -len(times) // 20)
    errors = {}
    for part in "qva":
        apart = (motion[part].values - _at(flight, part, times))[inner]
        errors[part] = dict(zip(names, apart.std(axis=0).tolist(), strict=True))
    return errors


def cycles(plan: RigPlan, flight: xr.Dataset, run: LogResult) -> dict[str, xr.Dataset]:
    """Cycle statistics of the truth and of the measurements, over the same wingbeats.

    Args:
        plan: Plan of the rig.
        flight: True flight.
        run: Result of a log: force of the air by the load cell, torques of the motors.
    """
    begin, end = run.motion["time"].values[[0, -1]]
    span = flight.sel(time=slice(begin - 1e-9, end + 1e-9))
    return {
        "truth": cycle_statistics(span, period=plan.beat),
        "measured": cycle_statistics(_as_flight(plan, run), period=plan.beat),
    }


def _as_flight(plan: RigPlan, run: LogResult) -> xr.Dataset:
    """Measurements as a flight whose air pushes on the body alone."""
    robot, count = run.whole_air.robot, len(run.motion["time"])
    base = next(body.floating_dofs for body in robot.bodies if body.floating_dofs is not None)
    place = list(base[:3])
    wind = np.broadcast_to(plan.air().wind, (count, 3))
    return run.motion.assign(
        strip_force=(("time", "strip", "axis"), run.whole_air.force[:, None, place]),
        added_mass_force=(("time", "dof"), np.zeros((count, robot.dof))),
        momentum=(("time", "axis"), robot.mass * run.motion["v"].values[:, place]),
        wind=(("time", "axis"), wind),
    )


def _source_scores(
    plan: RigPlan, flight: xr.Dataset, unseen: Mapping[str, xr.Dataset], run: SourceResult
) -> dict[str, Any]:
    count = len(run.samples.time)
    late = slice(count // 2, None)
    truth = true_force(flight, run.samples.time)
    heard = np.isfinite(normalized_error(truth[late], truth[late]))
    names = np.asarray(run.samples.robot.dof_names)[heard]
    error = normalized_error(truth[late], run.prediction[late])[heard]
    checked = run.checked >= count // 2
    apart = truth[run.checked[checked]] - run.prediction[run.checked[checked]]
    intervals = IntervalSums(len(heard))
    intervals.add(apart, run.std[checked])
    inside = intervals.coverage(heard)[heard]
    return {
        "measured_worst": measured_error(flight, run.samples),
        "measured": list(run.samples.measured),
        "worst": float(error.max()),
        "worst_coordinate": str(names[int(error.argmax())]),
        "mean": float(error.mean()),
        "by_coordinate": dict(zip(names.tolist(), error.tolist(), strict=True)),
        "coverage": float(inside.mean()),
        "coverage_by_coordinate": dict(zip(names.tolist(), inside.tolist(), strict=True)),
        "unseen": unseen_scores(plan, unseen, run),
        "stream": run.scores,
        "seconds": run.seconds,
    }


def unseen_scores(
    plan: RigPlan, unseen: Mapping[str, xr.Dataset], run: SourceResult
) -> dict[str, dict[str, float]]:
    """Scores of frozen weights on flights that were not learned, after the first wingbeat.

    The states are true. The first wingbeat is left out because the model assumes a wake from
    before the record, where in truth there was none.

    Args:
        plan: Plan of the rig.
        unseen: True flights, by name.
        run: Result of learning.
    """
    learner, scores = load_learner(run.model), {}
    for name, flight in unseen.items():
        time = flight["time"].values
        thin = slice(None, None, max(1, round(1.0 / (plan.rate * (time[1] - time[0])))))
        state = np.hstack([flight["q"].values, flight["v"].values])[thin]
        x = network_inputs(learner.network, learner.weights, time[thin], state)
        guess = learner.network.evaluate(x, learner.weights)
        truth = flight["aero_force"].values[thin]
        later = time[thin] >= plan.beat
        heard = np.isfinite(normalized_error(truth[later], truth[later]))
        error = normalized_error(truth[later], guess[later])[heard]
        whole = normalized_error(truth, guess)[heard]
        scores[name] = {
            "worst": float(error.max()),
            "mean": float(error.mean()),
            "worst_with_first_beat": float(whole.max()),
        }
    return scores


def targets(metrics: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Targets of the rig at the noise of the data sheets, and its results.

    Args:
        metrics: Of the rig.
    """
    by_noise = {row["noise"]: row for row in metrics["noise"]}
    row = by_noise.get(1.0) or metrics["noise"][0]
    at, sources = f"{row['noise']:g} x data sheet", row["sources"].items()
    pairs = [
        (at_most(f"{name}: worst force, second half, {at}", LEARNED_LIMIT), one["worst"])
        for name, one in sources
    ]
    pairs += [
        (
            at_most(f"{name}: unseen path and gait, worst force, {at}", UNSEEN_LIMIT),
            one["unseen"]["path and gait"]["worst"],
        )
        for name, one in sources
    ]
    covered = "truth in the 95 % interval, second half"
    pairs += [
        (between(f"{name}: {covered}, {at}", *COVERED, ideal=0.95), one["coverage"])
        for name, one in sources
    ]
    pairs += [
        (
            at_most(f"clock and delay of {clock['instrument']} [s]", CLOCK_LIMIT),
            abs(clock["error"]),
        )
        for clock in row["clocks"]
    ]
    return [target.row(found) for target, found in pairs]


def _at(flight: xr.Dataset, name: str, times: Array) -> Array:
    """A quantity of each coordinate at given times, between samples by straight lines, (N, n)."""
    stamps, values = flight["time"].values, flight[name].values
    return np.column_stack([np.interp(times, stamps, column) for column in values.T])
