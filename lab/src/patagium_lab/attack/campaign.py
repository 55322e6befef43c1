"""Campaign of faults: learners flown through faults, each beside the same learner without one.

A run draws a learner, a fault, its place and its length from a seed. These are checked: nothing
stops the learner, its weights are finite, its covariance is definite, it counts the faulty
samples, and soon after the fault it predicts as well as without it. Neglected: faults of the
machine that it runs on, except for kill -9.
"""

from __future__ import annotations

import os
import signal
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from patagium.arrays import Array
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.registry import load_learner
from patagium.learning.models.strip import StripNetwork
from patagium.learning.settings import (
    ChangeDetection,
    NoiseEstimation,
    Screening,
    Structure,
)
from patagium.robot import load_robot
from patagium.sensing.force.air_force import training_data
from patagium_lab.attack.faults import FAULTS, STUCK_SAMPLES, Fault, Faulted, Feed
from patagium_lab.attack.network import dense_network, is_definite
from patagium_lab.reproduction.cases import FLIGHT_CASES, SPREAD, lever_arms
from patagium_lab.reproduction.flights import corrected_flight

SAMPLES = 1500
TIME_STEP, EVERY = 1e-4, 4
"""Time step of the flight [s]; one sample in this many is learned, so that wingbeats repeat."""
NOISE = 0.02
"""Standard deviation of the noise over that of each output."""
FIRST, LAST = 500, 800
"""The fault begins between these samples."""
SETTLING, WINDOW = 200, 300
"""Samples between the fault and the comparison of errors, and samples of the comparison."""
WORST_RATIO = 2.0
"""Error after a fault over that without it, above which a learner has not recovered."""
KILL = "kill -9 while saving"
FAULT_NAMES = (*FAULTS, KILL)
STRUCTURES: tuple[Structure, ...] = ("full", "layer", "node")
SHARES = (0.1, 0.15, 0.75)
"""Share of the learners that have each structure; screening makes the others slow."""


@dataclass(frozen=True)
class LearnerKind:
    """Kind of a learner, set as a user would set it.

    Attributes:
        network: "strip" or "dense".
        covariance: Structure of the covariance.
        dtype: Precision of the filter.
        detects: Whether it detects changes.
        seed: Seed of the first weights and of the measurement's noise.
        screened: Whether it screens its samples.
    """

    network: str
    covariance: Structure
    dtype: str
    detects: bool
    seed: int
    screened: bool = True


class MeasuredFlight(NamedTuple):
    """A flight measured with noise.

    Attributes:
        feed: Samples as they are measured.
        truth: True outputs, (N, n_y) [N, N m].
        std: Standard deviation of the noise, (n_y,) [N, N m].
        size: Standard deviation of the true outputs, (n_y,) [N, N m].
    """

    feed: Feed
    truth: Array
    std: Array
    size: Array


class FaultFree(NamedTuple):
    """Result of a learner without a fault.

    Attributes:
        error: Normalized square error by sample, (N,) [1].
        state: State of the learner before the sample `FIRST`.
        events: Events counted by then.
    """

    error: Array
    state: dict[str, Any]
    events: dict[str, int]


@dataclass(frozen=True)
class FlightResult:
    """Result of a learner on a feed.

    Attributes:
        error: Normalized square error by sample of the flight, mean over outputs, (N,) [1].
        events: Events that it counted.
        finite: Whether all weights are finite.
        definite: Whether the covariance has a Cholesky factor.
        crash: Error that stopped it; empty if none did.
    """

    error: Array
    events: dict[str, int]
    finite: bool
    definite: bool
    crash: str


def campaign(seed: int, first: int, last: int) -> list[dict[str, Any]]:
    """JSON-able rows of the runs `first` to `last - 1`; see `run_fault`.

    Args:
        seed: Seed of the campaign.
        first: Number of the first run.
        last: Number after that of the last run.
    """
    return [one_run(seed, number) for number in range(first, last)]


def one_run(seed: int, number: int) -> dict[str, Any]:
    """One run of a campaign; faults come in turn, everything else is drawn.

    Args:
        seed: Seed of the campaign.
        number: Number of the run.
    """
    draw = np.random.default_rng([seed, number])
    names = FAULT_NAMES if hasattr(os, "fork") else tuple(FAULTS)
    name, kind = names[number % len(names)], drawn_kind(draw)
    row = run_kill(kind, draw) if name == KILL else run_fault(kind, FAULTS[name], draw)
    about = {"run": number, "fault": name, "network": kind.network, "dtype": kind.dtype}
    return about | {"covariance": str(kind.covariance), "detects": kind.detects} | row


def drawn_kind(draw: np.random.Generator) -> LearnerKind:
    """Random kind of learner.

    Args:
        draw: Generator of random numbers.
    """
    return LearnerKind(
        network=str(draw.choice(["strip", "dense"])),
        covariance=STRUCTURES[int(draw.choice(len(STRUCTURES), p=SHARES))],
        dtype="float32" if draw.integers(2) else "float64",
        detects=bool(draw.integers(2)),
        seed=int(draw.integers(2)),
    )


def run_fault(kind: LearnerKind, fault: Fault, draw: np.random.Generator) -> dict[str, Any]:
    """Result of a learner flown through a fault.

    Args:
        kind: Kind of the learner.
        fault: One of `FAULTS`.
        draw: Generator of the fault's place and length.

    Returns:
        crash, finite, definite, counted (events as injected), ratio (error after the fault over
        that without it), recovered, events.
    """
    flight, clean, learner = measured_flight(kind.seed), fault_free(kind), learner_of(kind)
    learner.resume(clean.state)
    faulted = fault(draw, flight.feed, int(draw.integers(FIRST, LAST)), flight.std)
    end = faulted.last + SETTLING + WINDOW
    kept = np.flatnonzero(faulted.feed.sample < end)[FIRST:]
    found = fly(learner, faulted.feed.taken(kept), flight)
    added = {name: found.events[name] - clean.events[name] for name in found.events}
    ratio = _ratio(found.error, clean.error, end - WINDOW)
    return {
        "crash": found.crash,
        "finite": found.finite,
        "definite": found.definite,
        "counted": _counted(faulted, added),
        "ratio": ratio,
        "recovered": ratio <= WORST_RATIO,
        "events": {name: n for name, n in added.items() if n > 0},
    }


def run_kill(kind: LearnerKind, draw: np.random.Generator) -> dict[str, Any]:
    """Result of a learner that is killed while it saves, and goes on from its file.

    Args:
        kind: Kind of the learner.
        draw: Generator of the moment.

    Returns:
        As `run_fault`; lost: the file does not load, is older than what was said to be saved, or
        the learner in it does not go on bit for bit; interrupted: a draft was left behind.
    """
    feed, learner = measured_flight(kind.seed).feed, learner_of(kind)
    begin = int(draw.integers(5, 50))
    for k in range(begin):
        learner.update(feed.x[k], feed.y[k], feed.time[k])
    with tempfile.TemporaryDirectory(prefix="patagium-") as folder:
        path = learner.save(Path(folder) / "learner.state")
        said = _killed_child(learner, feed, path, float(draw.uniform(0, 0.03)))
        interrupted = len(os.listdir(folder)) > 1
        lost = not _goes_on(learner, feed, path, max(said, begin))
    return {
        "crash": "",
        "finite": bool(np.isfinite(learner.weights).all()),
        "definite": is_definite(learner),
        "counted": not any(learner.events[name] for name in ("missing", "late", "refused")),
        "ratio": 1.0,
        "recovered": not lost,
        "events": {},
        "lost": lost,
        "interrupted": interrupted,
    }


@cache
def measured_flight(seed: int) -> MeasuredFlight:
    """The corrected flight measured with noise.

    Args:
        seed: Seed of the noise.
    """
    every = training_data(corrected_flight(SAMPLES * EVERY * TIME_STEP))
    stamps, x, truth = (part[:-1:EVERY] for part in every)
    size = truth.std(axis=0)
    std = NOISE * np.maximum(size, 1e-3 * size.max())
    noise = std * np.random.default_rng(seed).normal(size=truth.shape)
    return MeasuredFlight(Feed(stamps, x, truth + noise, np.arange(SAMPLES)), truth, std, size)


def learner_of(kind: LearnerKind) -> CubatureLearner:
    """A learner at its start.

    Args:
        kind: Kind of the learner.
    """
    subject = FLIGHT_CASES["corrected"]
    robot, lever = load_robot(subject.robot), lever_arms(load_robot(subject.robot))
    strip = kind.network == "strip"
    network = StripNetwork(robot, (6,), activation="tanh") if strip else dense_network((3,))
    return CubatureLearner(
        network,
        prior_std=0.5,
        measurement_std=0.05 * subject.strip_force * lever,
        spread=SPREAD,
        dtype=kind.dtype,
        seed=kind.seed,
        prior_share=1e-4,
        covariance=kind.covariance,
        screening=Screening(stuck_samples=STUCK_SAMPLES) if kind.screened else None,
        noise_estimation=NoiseEstimation(300),
        change_detection=ChangeDetection(1e-9, 50, 300, 0.3) if kind.detects else None,
    )


@cache
def fault_free(kind: LearnerKind) -> FaultFree:
    """Result of a learner on the flight without a fault.

    Args:
        kind: Kind of the learner.
    """
    flight, learner = measured_flight(kind.seed), learner_of(kind)
    before, after = flight.feed.taken(slice(FIRST)), flight.feed.taken(slice(FIRST, None))
    error = fly(learner, before, flight).error[:FIRST]
    state, events = learner.state(), learner.events
    later = fly(learner, after, flight).error[FIRST:]
    return FaultFree(np.concatenate([error, later]), state, events)


def fly(learner: CubatureLearner, feed: Feed, flight: MeasuredFlight) -> FlightResult:
    """Result of a learner on a feed.

    Args:
        learner: The learner; it is changed.
        feed: Samples in the order in which it gets them.
        flight: The flight that was measured.
    """
    innovation, crash = np.full(feed.y.shape, np.nan), ""
    try:
        for row, stamp in enumerate(feed.time):
            innovation[row] = learner.update(feed.x[row], feed.y[row], stamp)
    except Exception as problem:  # any error at all is what the campaign looks for
        crash = f"{type(problem).__name__}: {problem}"
    size = np.where(flight.size > 1e-3 * flight.size.max(), flight.size, np.nan)
    error = np.full(flight.truth.shape, np.nan)
    sane = np.where(np.abs(feed.y) < 1e3 * size, feed.y, np.nan)  # beyond, the sum is rounding
    error[feed.sample] = (sane - innovation - flight.truth[feed.sample]) / size
    finite = bool(np.isfinite(learner.weights).all())
    known = np.isfinite(error)
    total, parts = np.where(known, error, 0.0) ** 2, known.sum(axis=1)
    each = total.sum(axis=1) / np.where(parts > 0, parts, np.nan)
    return FlightResult(each, learner.events, finite, finite and is_definite(learner), crash)


def _ratio(error: Array, clean: Array, begin: int) -> float:
    """Error after a fault over that without it; infinite where nothing was predicted."""
    after, usual = (values[begin : begin + WINDOW] for values in (error, clean))
    if not np.isfinite(after).any():
        return np.inf
    floor = 0.1 * NOISE**2  # a learner's own error from noise; smaller errors do not count
    return float((np.nanmean(after) + floor) / (np.nanmean(usual) + floor))


def _counted(faulted: Faulted, added: dict[str, int]) -> bool:
    exact = all(added[name] == count for name, count in faulted.exact.items())
    told = {**added, "outliers": added["outliers"] + added["out_of_range"]}
    return exact and all(told[name] >= count for name, count in faulted.least.items())


def _killed_child(learner: CubatureLearner, feed: Feed, path: Path, delay: float) -> int:
    """Number of samples that a forked child reported as saved before it was killed."""
    listen, speak = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            for k in range(learner.count, SAMPLES):
                learner.update(feed.x[k], feed.y[k], feed.time[k])
                learner.save(path)
                os.write(speak, b"%d " % learner.count)
            time.sleep(60)
        finally:
            os._exit(1)
    os.close(speak)
    time.sleep(delay)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    with os.fdopen(listen, "rb") as heard:
        said = heard.read().split()
    return int(said[-1]) if said else 0


def _goes_on(learner: CubatureLearner, feed: Feed, path: Path, said: int) -> bool:
    """Whether the file holds the learner as it was, and it goes on as if it was never killed."""
    kept = load_learner(path)
    if not said <= kept.count <= said + 1:
        return False
    for k in range(learner.count, kept.count):
        learner.update(feed.x[k], feed.y[k], feed.time[k])
    for k in range(kept.count, kept.count + 20):
        learner.update(feed.x[k], feed.y[k], feed.time[k])
        kept.update(feed.x[k], feed.y[k], feed.time[k])
    return bool((learner.weights == kept.weights).all())
