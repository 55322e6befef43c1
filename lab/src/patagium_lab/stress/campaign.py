"""Learners flown through faults, each beside a twin that never met one.

A run draws a learner, a fault, its place and its length from a seed. What is checked: nothing
stops the learner, its weights are finite, its covariance definite, it counted what was done to
it, and soon after it predicts as its twin does. Neglected: faults of the machine that it runs on,
but for kill -9.
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
from numpy.typing import NDArray

from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.registry import load_learner
from patagium.learning.models.strip import StripNetwork
from patagium.learning.settings import (
    ChangeDetection,
    LowRank,
    NoiseEstimation,
    Screening,
    Structure,
)
from patagium.robot import load_robot
from patagium.sensing.force.training_data import training_data
from patagium_lab.reproduction.cases import FLIGHT_CASES, SPREAD, lever_arms
from patagium_lab.reproduction.flights import corrected_flight
from patagium_lab.stress.faults import FAULTS, STUCK_SAMPLES, Fault, Faulted, Feed
from patagium_lab.stress.network import dense_network, is_definite

Array = NDArray[np.float64]

SAMPLES = 1500
TIME_STEP, EVERY = 1e-4, 4
"""Of the flight [s]; one sample in so many is learned, so that wingbeats come again."""
NOISE = 0.02
"""Deviation of the measurement, as a share of each output's own."""
FIRST, LAST = 500, 800
"""The fault begins between these samples."""
SETTLING, WINDOW = 200, 300
"""The error is compared over so many samples, so many after the fault."""
WORST_RATIO = 2.0
"""Of the error after a fault over that of the twin; above it a learner has not recovered."""
KILL = "kill -9 while saving"
FAULT_NAMES = (*FAULTS, KILL)
STRUCTURES: tuple[Structure, ...] = ("full", "layer", "node", LowRank(4))
SHARES = (0.1, 0.15, 0.7, 0.05)
"""Of the learners that have each; noise between samples makes the others slow."""


@dataclass(frozen=True)
class Pilot:
    """A learner as a user would fly it.

    Attributes:
        network: "strip" or "dense".
        covariance: What is kept of it.
        dtype: Its precision.
        detects: Whether it looks for changes.
        seed: Of the weights to start from and of the measurement's noise.
        screened: Whether it screens its samples.
    """

    network: str
    covariance: Structure
    dtype: str
    detects: bool
    seed: int
    screened: bool = True


class Course(NamedTuple):
    """A flight, measured with noise.

    Attributes:
        feed: Samples as they are measured.
        truth: What there was to measure, (N, n_y).
        std: Of the noise, (n_y,).
        size: Deviation of what there was to measure, (n_y,).
    """

    feed: Feed
    truth: Array
    std: Array
    size: Array


class Twin(NamedTuple):
    """A learner that met no fault.

    Attributes:
        error: Normalized square error by sample, (N,).
        state: What it was before the sample `FIRST`.
        events: What it had counted by then.
    """

    error: Array
    state: dict[str, Any]
    events: dict[str, int]


@dataclass(frozen=True)
class Flown:
    """What became of a learner.

    Attributes:
        error: Normalized square error by sample of the flight, mean over outputs, (N,).
        events: What it counted.
        finite: Whether all weights are.
        definite: Whether the covariance has a Cholesky factor.
        crash: What stopped it; empty: nothing.
    """

    error: Array
    events: dict[str, int]
    finite: bool
    definite: bool
    crash: str


def campaign(seed: int, first: int, last: int) -> list[dict[str, Any]]:
    """Runs `first` to `last - 1` of a seed, one JSON-able row each; see `run_fault`.

    Args:
        seed: Of the campaign.
        first: Number of the first run.
        last: One past the last.
    """
    return [one_run(seed, number) for number in range(first, last)]


def one_run(seed: int, number: int) -> dict[str, Any]:
    """A run of a campaign; faults come in turn, everything else is drawn.

    Args:
        seed: Of the campaign.
        number: Of the run.
    """
    draw = np.random.default_rng([seed, number])
    names = FAULT_NAMES if hasattr(os, "fork") else tuple(FAULTS)
    name, pilot = names[number % len(names)], drawn_pilot(draw)
    row = run_kill(pilot, draw) if name == KILL else run_fault(pilot, FAULTS[name], draw)
    about = {"run": number, "fault": name, "network": pilot.network, "dtype": pilot.dtype}
    return about | {"covariance": str(pilot.covariance), "detects": pilot.detects} | row


def drawn_pilot(draw: np.random.Generator) -> Pilot:
    """A learner out of 64 kinds.

    Args:
        draw: Where it comes from.
    """
    return Pilot(
        network=str(draw.choice(["strip", "dense"])),
        covariance=STRUCTURES[int(draw.choice(len(STRUCTURES), p=SHARES))],
        dtype="float32" if draw.integers(2) else "float64",
        detects=bool(draw.integers(2)),
        seed=int(draw.integers(2)),
    )


def run_fault(pilot: Pilot, fault: Fault, draw: np.random.Generator) -> dict[str, Any]:
    """A learner through a fault.

    Args:
        pilot: The learner.
        fault: One of `FAULTS`.
        draw: Where the fault's place and length come from.

    Returns:
        crash, finite, definite, counted (events as injected), ratio (error after the fault over
        the twin's), recovered, events.
    """
    course, twin, learner = course_of(pilot.seed), undisturbed(pilot), learner_of(pilot)
    learner.resume(twin.state)
    faulted = fault(draw, course.feed, int(draw.integers(FIRST, LAST)), course.std)
    end = faulted.last + SETTLING + WINDOW
    kept = np.flatnonzero(faulted.feed.sample < end)[FIRST:]
    flown = fly(learner, faulted.feed.taken(kept), course)
    added = {name: flown.events[name] - twin.events[name] for name in flown.events}
    ratio = _ratio(flown.error, twin.error, end - WINDOW)
    return {
        "crash": flown.crash,
        "finite": flown.finite,
        "definite": flown.definite,
        "counted": _counted(faulted, added),
        "ratio": ratio,
        "recovered": ratio <= WORST_RATIO,
        "events": {name: n for name, n in added.items() if n > 0},
    }


def run_kill(pilot: Pilot, draw: np.random.Generator) -> dict[str, Any]:
    """A learner that is killed while it saves, and goes on from its file.

    Args:
        pilot: The learner.
        draw: Where the moment comes from.

    Returns:
        As `run_fault`; lost: the file does not load, is older than what was said to be saved, or
        the learner in it does not go on bit for bit; interrupted: a draft was left behind.
    """
    feed, learner = course_of(pilot.seed).feed, learner_of(pilot)
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
def course_of(seed: int) -> Course:
    """The flight, measured with noise drawn from a seed.

    Args:
        seed: Of the noise.
    """
    every = training_data(corrected_flight(SAMPLES * EVERY * TIME_STEP))
    stamps, x, truth = (part[:-1:EVERY] for part in every)
    size = truth.std(axis=0)
    std = NOISE * np.maximum(size, 1e-3 * size.max())
    noise = std * np.random.default_rng(seed).normal(size=truth.shape)
    return Course(Feed(stamps, x, truth + noise, np.arange(SAMPLES)), truth, std, size)


def learner_of(pilot: Pilot) -> CubatureLearner:
    """A learner at its start.

    Args:
        pilot: What it is.
    """
    subject = FLIGHT_CASES["corrected"]
    robot, lever = load_robot(subject.robot), lever_arms(load_robot(subject.robot))
    strip = pilot.network == "strip"
    network = StripNetwork(robot, (6,), activation="tanh") if strip else dense_network((3,))
    return CubatureLearner(
        network,
        prior_std=0.5,
        measurement_std=0.05 * subject.strip_force * lever,
        spread=SPREAD,
        dtype=pilot.dtype,
        seed=pilot.seed,
        prior_share=1e-4,
        covariance=pilot.covariance,
        screening=Screening(stuck_samples=STUCK_SAMPLES) if pilot.screened else None,
        noise_estimation=NoiseEstimation(300),
        change_detection=ChangeDetection(1e-9, 50, 300, 0.3) if pilot.detects else None,
    )


@cache
def undisturbed(pilot: Pilot) -> Twin:
    """The same learner through the same flight without a fault.

    Args:
        pilot: What it is.
    """
    course, learner = course_of(pilot.seed), learner_of(pilot)
    before, after = course.feed.taken(slice(FIRST)), course.feed.taken(slice(FIRST, None))
    error = fly(learner, before, course).error[:FIRST]
    state, events = learner.state(), learner.events
    later = fly(learner, after, course).error[FIRST:]
    return Twin(np.concatenate([error, later]), state, events)


def fly(learner: CubatureLearner, feed: Feed, course: Course) -> Flown:
    """A learner through a feed.

    Args:
        learner: It is changed.
        feed: What it gets.
        course: What there was to measure.
    """
    innovation, crash = np.full(feed.y.shape, np.nan), ""
    try:
        for row, stamp in enumerate(feed.time):
            innovation[row] = learner.update(feed.x[row], feed.y[row], stamp)
    except Exception as problem:  # whatever it is, it is what the campaign looks for
        crash = f"{type(problem).__name__}: {problem}"
    size = np.where(course.size > 1e-3 * course.size.max(), course.size, np.nan)
    error = np.full(course.truth.shape, np.nan)
    sane = np.where(np.abs(feed.y) < 1e3 * size, feed.y, np.nan)  # beyond, the sum is rounding
    error[feed.sample] = (sane - innovation - course.truth[feed.sample]) / size
    finite = bool(np.isfinite(learner.weights).all())
    known = np.isfinite(error)
    total, parts = np.where(known, error, 0.0) ** 2, known.sum(axis=1)
    each = total.sum(axis=1) / np.where(parts > 0, parts, np.nan)
    return Flown(each, learner.events, finite, finite and is_definite(learner), crash)


def _ratio(error: Array, twin: Array, begin: int) -> float:
    """Error after a fault over that of the twin; infinite where nothing was predicted."""
    after, usual = (values[begin : begin + WINDOW] for values in (error, twin))
    if not np.isfinite(after).any():
        return np.inf
    floor = 0.1 * NOISE**2  # what a learner makes of noise; below it errors do not count
    return float((np.nanmean(after) + floor) / (np.nanmean(usual) + floor))


def _counted(faulted: Faulted, added: dict[str, int]) -> bool:
    exact = all(added[name] == count for name, count in faulted.exact.items())
    return exact and all(added[name] >= count for name, count in faulted.least.items())


def _killed_child(learner: CubatureLearner, feed: Feed, path: Path, delay: float) -> int:
    """Samples that a forked child said it had saved before it was killed."""
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
    """Whether the file holds the learner as it was, and that goes on as if never killed."""
    kept = load_learner(path)
    if not said <= kept.count <= said + 1:
        return False
    for k in range(learner.count, kept.count):
        learner.update(feed.x[k], feed.y[k], feed.time[k])
    for k in range(kept.count, kept.count + 20):
        learner.update(feed.x[k], feed.y[k], feed.time[k])
        kept.update(feed.x[k], feed.y[k], feed.time[k])
    return bool((learner.weights == kept.weights).all())
