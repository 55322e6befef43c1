"""Run of the study of feedback: flights side by side with delays, rates and starts."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

import patagium as pt
from patagium import control
from patagium.aerodynamics import Aerodynamics, QuasiSteady, SmoothPolar
from patagium.arrays import Array
from patagium.control import LinearRegulator, Orbit, PredictiveController, RealTimeIteration
from patagium.control.predictive import OrbitController
from patagium.robot import Robot
from patagium.robot.model import Actuator
from patagium.simulation.steered_gait import SteeredGait
from patagium_lab.conditions import conditions
from patagium_lab.feedback.flights import Flights, Law, Numbers
from patagium_lab.feedback.plan import (
    AVERAGED,
    IN_FLIGHT,
    MASSES,
    NOISE,
    OUTSIDE,
    PARTS,
    PERIODIC,
    PREDICTIVE,
    PUSHED,
    RECOVERED,
    STARTS,
    Case,
    FeedbackPlan,
)
from patagium_lab.gallery import Gallery
from patagium_lab.jobs import Job, run_jobs
from patagium_lab.study import Results, Stages

STEPS = 80
"""Time steps of a beat, at least."""
TRUTHS = 10
"""Draws of masses and inertias among the starts of a controller."""
RATE, RESPONSE = 5.0, 0.1
"""Rate [rad/s] and response time [s] of actuators that a preset does not have."""


@cache
def design(case: Case) -> Orbit:
    """Orbit of a case in the model's air, which the controllers follow.

    Args:
        case: The case.
    """
    robot = pt.load_robot(case.robot)
    aero = QuasiSteady(robot, polar=SmoothPolar())
    orbit = cast(Orbit, pt.trim(robot, aero, speed=case.speed))
    if case.amplitude is None or case.offset is None:
        return orbit
    ranges = {"amplitude": case.amplitude, "offset": case.offset}
    actuators = {
        name: Actuator("rad", ranges[name.rpartition("_")[2]], RATE, RESPONSE, 1.0)
        for name in case.commands
    }
    robot = replace(robot, actuators=actuators)
    return replace(orbit, robot=robot, aero=QuasiSteady(robot, polar=SmoothPolar()))


def truth(case: Case, seed: int) -> tuple[Robot, Aerodynamics]:
    """Robot whose masses are off, and the published polar around it.

    Args:
        case: The case.
        seed: Seed of the masses.
    """
    robot = control.off_nominal(design(case).robot, MASSES, seed)
    return robot, QuasiSteady(robot)


@cache
def controller(case: Case, kind: str, parts: int = PARTS) -> OrbitController:
    """Controller of a case.

    Args:
        case: The case.
        kind: `PERIODIC`, `AVERAGED` or `PREDICTIVE`.
        parts: Commands of a beat.
    """
    orbit = design(case)
    if kind == PREDICTIVE:
        return PredictiveController(orbit, case.commands, parts=parts)
    return LinearRegulator(orbit, case.commands, parts=parts, averaged=kind == AVERAGED)


def law_of(one: OrbitController, count: int) -> Law:
    """Answers of a controller to many flights at once.

    Args:
        one: The controller.
        count: Number of flights, each with a controller of its own where it has a memory.
    """
    model = one.model
    last = np.zeros((count, len(model.commands)))
    if isinstance(one, LinearRegulator):

        def linear(first: int, flights: Numbers, departures: Array) -> Array:
            last[flights] = one.answer(first, departures, last[flights])
            return last[flights]

        return linear
    assert isinstance(one, PredictiveController)
    pilots = [fresh(one) for _ in range(count)]

    def predictive(first: int, flights: Numbers, departures: Array) -> Array:
        for k, departure in zip(flights, departures, strict=True):
            answer = pilots[k].answer(first, departure, last[k])
            last[k] = last[k] if answer is None else answer
        return last[flights]

    return predictive


def fresh(one: PredictiveController) -> PredictiveController:
    """Controller of the same design, without limits of states, for another flight.

    Args:
        one: A controller that has not flown.
    """
    found, model, before = copy(one), copy(one.model), one.iteration
    found.model, found.held = model, Counter()
    model.steered = SteeredGait(model.robot, model.steered.gait)
    costs = one.state_cost, one.input_cost
    found.iteration = RealTimeIteration(model.predict, len(before.inputs), *costs)
    found.iteration.inverses = before.inverses
    for name in ("lower", "upper", "fall", "rise"):
        found.iteration.program[name][...] = before.program[name]
    return found


def vector(orbit: Orbit, sizes: Mapping[str, float], missing: float) -> Array:
    """Sizes of states by name as a vector, (n,) [SI].

    Args:
        orbit: Orbit whose states they are.
        sizes: The sizes.
        missing: Size of a state that is not named.
    """
    return np.array([sizes.get(name, missing) for name in orbit.names])


def in_flight(
    case: Case, kind: str, seeds: range, delays: Numbers, parts: int, wait: int, beats: int
) -> list[bool]:
    """Whether all flights of each delay stay in flight.

    Args:
        case: The case.
        kind: Controller.
        seeds: Seeds of masses, noise and start of the flights.
        delays: Delays that are tried, (d,) [time steps].
        parts: Commands of a beat.
        wait: Intervals from one command to the next.
        beats: Beats of a flight.
    """
    orbit, one = design(case), controller(case, kind, parts)
    count, size = len(seeds), len(orbit.names)
    draw = np.random.default_rng([seeds[0], 0xDE1A])
    pushes = vector(orbit, PUSHED, 0.0) * draw.standard_normal((count, size))
    flights = Flights(
        [truth(case, seed) for seed in seeds], one, law_of(one, count * len(delays)),
        one.model.course.states[0] + np.tile(pushes, (len(delays), 1)), STEPS // parts,
        np.repeat(delays, count), wait, vector(orbit, NOISE, 0.0), seeds[0],
        vector(orbit, IN_FLIGHT, np.inf),
    )  # fmt: skip
    flights.fly(beats * parts)
    return [bool(one.all()) for one in flights.alive.reshape(len(delays), count)]


def margins(case: Case, kind: str, plan: FeedbackPlan) -> dict[str, Any]:
    """Largest delay and slowest rate of a controller at which all flights stay in flight.

    Args:
        case: The case.
        kind: Controller.
        plan: Plan of the study.
    """
    orbit = design(case)
    seeds = range(plan.seed, plan.seed + plan.flights)
    delays = np.arange(round(plan.longest * plan.shares) + 1) * (STEPS // plan.shares)
    kept = in_flight(case, kind, seeds, delays, PARTS, 1, plan.beats)
    held = int(np.argmin(kept)) if not all(kept) else len(kept)
    rows: list[tuple[float, int, int]] = [(1 / rate, rate, 1) for rate in plan.rates] + [
        (wait, 1, wait) for wait in plan.waits
    ]
    slowest = None
    for length, parts, wait in rows:
        try:
            holds = in_flight(case, kind, seeds, delays[:1], parts, wait, plan.beats)[0]
        except pt.errors.ParameterError:  # no such regulator holds the orbit
            holds = False
        if not holds:
            break
        slowest = length
    size = float(np.abs(np.linalg.eigvals(orbit.return_slope)).max())
    return {
        "robot": case.name,
        "controller": kind,
        "beat": orbit.period,
        "doubling": float(np.log(2) / np.log(size)) if size > 1 else None,
        "delay": float(delays[held - 1] / STEPS) if held else None,
        "delay_longest": held == len(kept),
        "interval": slowest,
        "interval_longest": slowest == rows[-1][0],
    }


def starts_of(case: Case, seed: int, count: int) -> tuple[Array, Array]:
    """Sizes of starts, (count,), even from 0 to 1, and starts on boxes of that size, (count, n).

    The first of many are those of a few.

    Args:
        case: The case.
        seed: Seed.
        count: Number of starts.
    """
    orbit = design(case)
    draws = np.random.default_rng([seed, 0x5A27]).uniform(-1, 1, (count, len(orbit.names) + 1))
    ways, sizes = draws[:, 1:], 0.5 * (1 + draws[:, 0])
    scale = vector(orbit, STARTS, 0.0)
    ways /= np.abs(ways[:, scale > 0]).max(axis=1)[:, None]
    return sizes, controller(case, PERIODIC).model.course.states[0] + sizes[:, None] * ways * scale


def region(case: Case, kind: str, seed: int, count: int, beats: int) -> dict[str, Any]:
    """Starts that a controller recovers.

    Args:
        case: The case.
        kind: Controller.
        seed: Seed of starts and noise, and the first of masses.
        count: Number of starts.
        beats: Beats of a flight.
    """
    orbit, one = design(case), controller(case, kind)
    sizes, starts = starts_of(case, seed, count)
    flights = Flights(
        [truth(case, seed + k) for k in range(TRUTHS)], one, law_of(one, count), starts,
        STEPS // PARTS,
        np.zeros(count, np.int64), std=vector(orbit, NOISE, 0.0), seed=seed,
        region=vector(orbit, OUTSIDE, np.inf),
    )  # fmt: skip
    flights.fly(beats * PARTS)
    near = (np.abs(flights.departures) <= vector(orbit, RECOVERED, np.inf)).all(axis=1)
    largest = None
    if isinstance(one, LinearRegulator):
        largest = float(np.abs(periodic_multipliers(one)).max())
    return {
        "robot": case.name,
        "controller": kind,
        "sizes": sizes.tolist(),
        "recovered": (flights.alive & near).tolist(),
        "lost": int((~flights.alive).sum()),
        "largest_multiplier": largest,
    }


def periodic_multipliers(regulator: LinearRegulator) -> NDArray[np.complex128]:
    """Multipliers of the beat under feedback, without the neutral way sideways.

    Args:
        regulator: The regulator.
    """
    found = regulator.multipliers
    return np.asarray(np.delete(found, np.argmin(np.abs(found - 1.0))), complex)


def run(plan: FeedbackPlan, out: Path, stages: Stages) -> Results:
    """Results of the study.

    Args:
        plan: Plan of the study.
        out: Folder of the results.
        stages: Receives progress.
    """
    jobs: list[Job] = []
    for case in plan.margins:
        for kind in (PERIODIC, PREDICTIVE):
            cost = 4.0 if kind == PREDICTIVE else 2.0
            jobs.append(Job(margins, (case, kind, plan), cost * plan.flights))
    first = len(jobs)
    for case in plan.regions:
        for kind in (PREDICTIVE, PERIODIC, AVERAGED):
            few = kind == PREDICTIVE
            count = max(1, round((min(plan.few, plan.starts) if few else plan.starts) * case.share))
            words = case, kind, plan.seed, count, plan.beats
            jobs.append(Job(region, words, (0.4 if few else 0.08) * count))
    kept = out / "jobs.jsonl"
    done = _read(kept)
    left = [job for job in jobs if _key(job) not in done]
    with stages.stage("flights", 0.0, 1.0) as tell, kept.open("a") as file:

        def keep(number: int, row: Mapping[str, Any]) -> None:
            file.write(json.dumps([_key(left[number]), row], default=_plain) + "\n")
            file.flush()

        run_jobs(left, tell, plan.workers, keep)
    done = _read(kept)
    found = [done[_key(job)] for job in jobs]
    metrics = {
        "environment": conditions(),
        "seed": plan.seed,
        "flights": plan.flights,
        "starts": plan.starts,
        "few": plan.few,
        "beats": plan.beats,
        "longest": plan.longest,
        "margins": found[:first],
        "regions": found[first:],
    }
    return Results(metrics, Gallery(out))


def _read(path: Path) -> dict[str, dict[str, Any]]:
    """Results that are there already, by the call that gave each."""
    return dict(json.loads(line) for line in path.read_text().splitlines()) if path.exists() else {}


def _key(job: Job) -> str:
    """Call of a job, without what does not bear on it."""
    words = [
        replace(one, starts=0, few=0, workers=0, margins=(), regions=())
        if isinstance(one, FeedbackPlan)
        else one
        for one in job.arguments
    ]
    return f"{job.function.__name__} {words}"


def _plain(number: Any) -> Any:
    """Number of NumPy as one of Python."""
    return number.item()
