"""Identification from a flight or a table, and scores of a learned model on one it never saw.

Names of a flight's inputs are those of the state: `q.<coordinate>` and `v.<coordinate>`.
Neglected: errors of the states; a flight's accelerations, too, are taken as they stand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from patagium.arguments import Progress, checked
from patagium.arrays import Array, Bools, find_gaps, median_step, thin, usual_step
from patagium.errors import LogError, Outcome, ParameterError
from patagium.learning.default_learner import choices, chosen_every, default_learner, table_every
from patagium.learning.filters.misfit import unseen
from patagium.learning.forecast import Horizons, named_horizons
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.learner import Learner, Updated
from patagium.learning.model_file import Model
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.learning.models.memory import network_inputs
from patagium.learning.parameter_paths import Trained, parameter_scores
from patagium.learning.propagation import robot_motion
from patagium.learning.result import Check, Identification, check, record_of
from patagium.learning.samples import (
    flown,
    go_on_in,
    in_flight,
    samples,
    stds,
    wind_change,
    with_force,
)
from patagium.learning.scores import Scorer, persistence
from patagium.learning.stream import MOST_CHECKS, late_samples, stream, used_samples
from patagium.learning.table_network import range_words, samples_that_scale
from patagium.learning.verdict import frozen_scores, with_verdict
from patagium.learning.what_if import what_if
from patagium.sensing.force.measured_force import ForceSamples
from patagium.sensing.logs.table import LogTable
from patagium.simulation import gait_period, robot_of
from patagium.simulation.flight import MASS

_BEYOND_NOISE = 10.0
"""Errors over the noise of a measured force from which they are no noise."""


@checked
def identify(
    flight: xr.Dataset | ForceSamples | LogTable,
    learner: Learner | None = None,
    *,
    every: int | None = None,
    inputs: Sequence[str] | None = None,
    horizons: Horizons = None,
    progress: Progress | None = None,
) -> Identification:
    """Identification of the air's force from a flight, or of a table's outputs, sample by sample.

    The force is found by inverse dynamics (`training_data`), or as it was measured; each sample
    is predicted before it may be used (`stream`). Where the first samples of a table scale the
    network, since its mapping states no range for a column (`network_for`), they are neither
    predicted nor learned.

    Args:
        flight: Record with q, v, a, u1; measured forces, or a motion with them, whose std is
            noise on top; or a table.
        learner: What learns; it goes on from where it stands, and is changed. Its network sees
            the inputs and gives generalized forces, or what it measures; None: `default_learner`.
        every: 100 to use one sample in 100; None: as `chosen_every`, of a table `table_every` says.
        inputs: Names of what the network sees of a flight, such as `v.roll`; None: q, then v.
        horizons: Times ahead for which outputs are forecast from samples up to a time alone, such
            as "100ms": the state of a robot in free flight is propagated by its equations with
            the learned force; other inputs are held, or repeat their last wingbeat.
        progress: Called now and then with samples done and samples in all.

    Returns:
        Scores and predictions; see `stream`.

    Raises:
        FlightError: If the flight misses a quantity.
        ShapeError: If the network does not fit the inputs or the outputs.
        ParameterError: If an input has no such name, or inputs are given for a table.
    """
    count, flight = np.size(getattr(flight, "time", ())), with_force(flight)
    chosen = learner or default_learner(flight, every=every)
    given = {"learner_given": learner is not None, "every_given": every is not None}
    words = {} if isinstance(flight, LogTable) else _flight_words(flight, chosen, count)
    if isinstance(flight, LogTable):
        _refuse_for_tables(inputs)
        first, inputs = samples_that_scale(chosen.network, flight), flight.input_names
        time, x, y = flight.time[first:], flight.x[first:], flight.y[first:]
        taken = table_every(chosen, usual_step(time)) if every is None else every
        known: dict[str, Any] = {"names": flight.output_names, "units": flight.output_units}
        known["gaps"] = flight.gaps[flight.gaps > first] - first
    else:
        simulated = isinstance(flight, xr.Dataset) and "air" not in flight.attrs  # imported has it
        time, x, y, units = samples(flight, chosen.network, inputs)
        if isinstance(chosen, FilterLearner):
            chosen.expect(x, y)  # by the ranges of the record it judges faults of sensors
        motion, period = None, None if isinstance(flight, ForceSamples) else gait_period(flight)
        if named_horizons(horizons) and not isinstance(flight, ForceSamples):
            motion = robot_motion(flight, robot_of(flight), chosen.network, inputs, period)
        taken = chosen_every(chosen, usual_step(time), period) if every is None else every
        known = {"units": units, "std": stds(flight, chosen.network), "gaps": find_gaps(time)}
        known |= {"motion": motion, "period": period}
    _check_horizons(horizons, float(time[-1] - time[0]))
    result = stream(chosen, time, x, y, every=taken, horizons=horizons, progress=progress, **known)
    result.scores["chosen"] = words | choices(chosen, taken, usual_step(time), **given)
    result.scores["verdict"] += _noise_words(known.get("std"), y[len(y) // 2 :], result.scores)
    if isinstance(flight, LogTable):
        result.scores["gaps_found"] = flight.describe_gaps()
        result.scores.update(samples=len(flight.time), samples_that_scaled=first)
        result.scores["verdict"] += range_words(flight, first)
    elif isinstance(chosen.network, LinearStripNetwork) and not simulated:
        result.scores["verdict"] += what_if(chosen.network, (time, x, y), known["std"], period)
    return replace(result, inputs=None if inputs is None else tuple(inputs))


def _flight_words(
    flight: xr.Dataset | ForceSamples, learner: Learner, count: int
) -> dict[str, str]:
    """Words about air, forces and left out samples of a flight, by what they describe."""
    words, (robot, air) = go_on_in(learner, flight), flown(flight)
    changes = wind_change(flight, learner.network) is not None
    if changes and robot.floating:
        words["wind"] = "as the flight has it at each sample"
    elif changes or air.gust is not None:
        words["wind"] = "steady; its changes are errors of the network"
    if changes and not robot.floating:
        words["wind"] += f", because no body of {robot.name} is floating (`floating: true`)"
    if not isinstance(flight, ForceSamples):
        if MASS in flight:
            words["mass"] = "changes in the flight; what its change weighs counts as force of air"
        return words
    names, lost = ", ".join(flight.measured), count - len(flight.time)
    left = f"; {lost} of {count} samples, whose motion is not known, are left out" * bool(lost)
    told = f"of {names} by {flight.source}, each with its standard deviation{left}"
    return words | {"forces": told}


def _check_horizons(horizons: Horizons, span: float) -> None:
    """Refuse horizons as long as a log."""
    for ahead in named_horizons(horizons).values():
        if ahead >= span:
            raise ParameterError("horizon", f"less than the {span:.4g} s of the log", ahead)


def _noise_words(std: Array | None, y: Array, scores: Mapping[str, Any]) -> list[str]:
    """Notes on measured forces below their noise, and on errors far beyond it."""
    nmse: Mapping[str, float] = scores.get("nmse_second_half", {})
    if std is None or not nmse:
        return []
    heard = np.flatnonzero(np.isfinite(y).any(axis=0) & np.isfinite(std).any(axis=0)).tolist()
    names = [[*nmse][k] for k in heard]
    stated, scatter = np.nanmedian(std[:, heard], axis=0), np.nanstd(y[:, heard], axis=0)
    usual = np.sqrt(np.nanmean(std[-len(y) :, heard] ** 2, axis=0))
    times = np.sqrt([nmse[name] for name in names]) * scatter / usual
    below = [name for name, one in zip(names, scatter < stated, strict=True) if one]
    beyond = [name for name, one in zip(names, times, strict=True) if one > _BEYOND_NOISE]
    found = []
    if below:
        words = "is smaller than its noise, and its score says little."
        found.append(f"Note: the force of {', '.join(below)} {words}")
    if beyond:
        found.append(
            f"Note: errors of {', '.join(beyond)} are up to {np.nanmax(times):.2g} times the noise "
            "of the measured force, and no noise: if they stay so, ask for signs and axes of the "
            "joints, delays, and wind that is another or changes."
        )
    return found


def _refuse_for_tables(inputs: Sequence[str] | None) -> None:
    """Refuse inputs of a table."""
    if inputs is not None:
        raise ParameterError("inputs", "None for a table, whose mapping says it", inputs)


@checked
def evaluate(
    flight: xr.Dataset | ForceSamples | LogTable,
    model: Trained,
    *,
    every: int | None = None,
    inputs: Sequence[str] | None = None,
) -> Identification:
    """Scores of a model with frozen weights on a flight or a table it never saw.

    A network with physics takes the steady wind and the density of the flight.

    Args:
        flight: Record with q, v, a, u1; measured forces; or a table.
        model: A learner (it is not taught), or network and weights.
        every: The rival holds one measured sample in so many, and the model sees none; None: as
            many as `identify` would have used with this model.
        inputs: Names of what the network sees; None: those of the model's file, or q, then v.

    Returns:
        Scores and predictions, without updates.

    Raises:
        FlightError: If the flight misses a quantity.
        ShapeError: If the network does not fit the inputs or the outputs.
        ParameterError: If an input has no such name, or inputs are given for a table.
        LogError: If a table has other inputs or outputs than the model.
    """
    if isinstance(flight, LogTable):
        _refuse_for_tables(inputs)
        _check_columns(flight, model)
        rows, gaps, names = (flight.time, flight.x, flight.y), flight.gaps, flight.output_units
        taken = table_every(model, usual_step(flight.time)) if every is None else every
        result = compare(model, *rows, every=taken, units=names, gaps=gaps)
        result.scores["gaps_found"] = flight.describe_gaps()
        return result
    if inputs is None and isinstance(model, Model):
        inputs = model.inputs
    model, told = in_flight(model, flight)
    time, x, y, units = samples(flight, model.network, inputs)
    period = gait_period(flight) if isinstance(flight, xr.Dataset) else None
    taken = chosen_every(model, usual_step(time), period) if every is None else every
    std, gaps = stds(flight, model.network), find_gaps(time)
    result = compare(model, time, x, y, every=taken, units=units, std=std, gaps=gaps)
    result.scores["verdict"] += told
    return result


def _check_columns(table: LogTable, model: Trained) -> None:
    """Refuse a table of other columns than those of a model."""
    outputs = tuple(model.network.output_names)
    inputs = model.inputs if isinstance(model, Model) else None
    for word, expected, found in (
        ("outputs", outputs, table.output_names),
        ("inputs", inputs or table.input_names, table.input_names),
    ):
        if expected != found:
            told = f"expected the {word} {', '.join(expected)}, found {', '.join(found)}"
            raise LogError(f"{table.source}: {told}")


def compare(
    model: Trained,
    time: Array,
    x: Array,
    y: Array,
    *,
    every: int = 100,
    units: Sequence[str] | None = None,
    std: Array | None = None,
    gaps: ArrayLike = (),
) -> Identification:
    """Scores of a model with frozen weights on samples it never saw; see `evaluate`.

    Args:
        model: A learner (it is not taught), or network and weights.
        time: (N,) [s].
        x: Measured inputs of the network, (N, n_measured) [units of x]; it recalls the rest.
        y: What was measured, (N, n_y) [unit of y].
        every: The rival holds one measured sample in so many.
        units: Units of the outputs; None for "1".
        std: Standard deviation of each measurement, (N, n_y) [unit of y]; None: the model's alone.
        gaps: First sample after each gap in time.
    """
    names = model.network.output_names
    x = network_inputs(model.network, model.weights, time, x, gaps)
    guess = model.network.evaluate(x, model.weights)
    held = persistence(y, used_samples(y, every, gaps))
    predicts = isinstance(model, Model | Updated)
    chosen = thin(np.arange(len(y)), MOST_CHECKS).tolist() if predicts else []
    noise = np.zeros_like(y) if std is None else std
    checks = [check(model, k, (x[k], y[k]), noise[k]) for k in chosen]  # type: ignore[arg-type]
    scorer = Scorer(names, getattr(model.network, "output_scale", 1.0))
    late = np.arange(len(y)) >= len(y) // 2
    scorer.add_predictions(y, guess, held, late)
    if checks:
        checked, error, std = map(np.array, zip(*checks, strict=True))
        scorer.add_checks(error, std, late[checked])
    scores: dict[str, Any] = {
        "samples": len(time),
        "samples_predicted": len(time),
        "every": every,
        "frozen": True,
        "updates": 0,
        "median_step": median_step(time),
        "gaps": len(np.asarray(gaps)),
        "outcome": Outcome.COMPLETED.name,
        "message": "",
        **scorer.error_scores(),
        **scorer.interval_scores(),
        **parameter_scores(model),
        **frozen_scores(model.network, [(time, x, y, gaps, late_samples(len(y)))]),
        **_unseen_scores(model, checks, noise[chosen], ~scorer.silent),
    }
    arrays = {"time": time, "measurement": y, "prediction": guess, "persistence": held}
    record = record_of(names, units or ["1"] * len(names), arrays, checks)
    return Identification(with_verdict(scores), record, model, Outcome.COMPLETED, "")


def _unseen_scores(
    model: Trained, checks: Sequence[Check], noise: Array, heard: Bools
) -> dict[str, Any]:
    """Share of the checks in flow that was not learned; nothing of models without `misfit`."""
    usual = getattr(model, "usual_std", None)
    error = getattr(model, "measurement_std", None)
    if usual is None or error is None or not checks:
        return {}
    stated = np.array([one.std for one in checks]) ** 2 - noise**2
    return {"unseen_share": float(unseen(error**2, stated, usual**2)[:, heard].mean())}
