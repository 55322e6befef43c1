"""Recovery of the air's lags from noisy flights, and the coverage of their intervals.

A robot flaps on a fixed mount in a wind, with lags of the air drawn from the prior, and forces are
measured with noise. A grey box that starts at the usual lags learns them online. If its covariance
is right, two standard deviations hold the truth 19 times in 20. Neglected: noise of the measured
motion, errors of the model beside its numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from patagium.aerodynamics import Air, LiftingLine
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.models.grey_box import GreyBox
from patagium.learning.models.physical import Estimate
from patagium.learning.parameter_paths import estimates_of
from patagium.learning.refinement import refine
from patagium.learning.stream import stream
from patagium.robot import Robot, load_robot, load_robot_text
from patagium.sensing.force.air_force import training_data
from patagium.simulation import gaits, mounts, simulate

PRIORS = {
    "lags.rate[0]": 0.015,
    "lags.rate[1]": 0.1,
    "lags.lift[0]": 0.04,
    "lags.lift[1]": 0.06,
    "section.lift_slope": 0.5,
}
"""Standard deviations of the true numbers, and of the learner's prior."""
NOISE = 0.02
"""Noise of each measured force over its standard deviation, or over the loudest force's [1]."""
LEARNERS: dict[str, Callable[..., FilterLearner]] = {
    "cubature": CubatureLearner,
    "extended": ExtendedLearner,
}


@dataclass(frozen=True)
class RecoveryPlan:
    """Plan of the flights.

    Attributes:
        robot: The machine.
        duration: Duration of a flight [s].
        time_step: Time step of a flight [s].
        every: One sample in this many is learned.
    """

    robot: Robot
    duration: float = 0.6
    time_step: float = 5e-4
    every: int = 5


class Recovery(NamedTuple):
    """Estimates from one flight.

    Attributes:
        seed: Seed of the flight.
        truth: True numbers, by name.
        learned: Estimates after one pass online.
        refined: Estimates after least squares over the flight (`refine`).
        coverage: Share of forces inside the predicted 95 % interval.
    """

    seed: int
    truth: dict[str, float]
    learned: tuple[Estimate, ...]
    refined: tuple[Estimate, ...]
    coverage: float

    def distances(self, estimates: Sequence[Estimate]) -> list[float]:
        """Error of each number over its reported standard deviation.

        Args:
            estimates: Estimates, learned or refined.
        """
        return [(e.value - self.truth[e.name]) / e.std for e in estimates]


def usual_plan() -> RecoveryPlan:
    """The robot of the published experiment, with two strips a plate."""
    source = load_robot("aerobat").source
    return RecoveryPlan(load_robot_text(source.replace("strips: 5", "strips: 2"), "aerobat"))


def recover(plan: RecoveryPlan, seed: int, learner: str = "extended") -> Recovery:
    """Estimates from one flight with lags of its own.

    Args:
        plan: Plan of the flights.
        seed: Seed of lags, gait, wind and noise.
        learner: Key of `LEARNERS`.
    """
    draw = np.random.default_rng(seed)
    air = Air(wind=(-draw.uniform(3.0, 6.0), 0.0, 0.0))
    grey = GreyBox(LiftingLine(plan.robot, air), PRIORS, start="still")
    weights = draw.normal(size=grey.size)
    truth, _ = grey.air_at(weights)
    gait = gaits.sinusoidal(
        plan.robot,
        frequency=draw.uniform(3.0, 6.0),
        plunge=draw.uniform(0.3, 0.6),
        feather=draw.uniform(0.05, 0.25),
        phase={"feather": draw.uniform(0.0, 2 * np.pi)},
    )
    flight = simulate(
        plan.robot,
        truth,
        gait,
        duration=plan.duration,
        time_step=plan.time_step,
        mount=mounts.fixed(),
    )
    time, x, y = training_data(flight)
    loud = y.std(axis=0)
    noise = NOISE * np.maximum(loud, 1e-2 * loud.max())
    y = y + noise * draw.normal(size=y.shape)
    student = LEARNERS[learner](grey, measurement_std=noise)
    scores = stream(student, time, x, y, every=plan.every).scores
    model = refine(student, time, x, y, every=plan.every)
    return Recovery(
        seed,
        {e.name: e.value for e in grey.estimates(weights)},
        grey.estimates(student.weights, student.variances),
        estimates_of(model),
        scores["coverage"],
    )


def recovery_scores(recoveries: Sequence[Recovery]) -> dict[str, Any]:
    """Shares of flights whose truth lies within two reported standard deviations, JSON-able.

    Args:
        recoveries: Estimates from many flights.
    """
    return {
        "flights": len(recoveries),
        "learned": _judged([(one, one.learned) for one in recoveries]),
        "refined": _judged([(one, one.refined) for one in recoveries]),
        "coverage_of_forces": float(np.mean([one.coverage for one in recoveries])),
    }


def _judged(found: Sequence[tuple[Recovery, Sequence[Estimate]]]) -> dict[str, Any]:
    far = np.array([one.distances(estimates) for one, estimates in found])
    spread = np.array([[e.std / e.prior_std for e in known] for _, known in found])
    inside, names = np.abs(far) <= 2.0, list(PRIORS)
    lags = [k for k, name in enumerate(names) if name.startswith("lags.")]
    each = {
        "within_two_stds": inside.mean(axis=0),
        "error_over_std": np.sqrt((far**2).mean(axis=0)),
        "std_over_prior": np.median(spread, axis=0),
    }
    by_name = {key: dict(zip(names, row.tolist(), strict=True)) for key, row in each.items()}
    return {"lags_within_two_stds": float(inside[:, lags].mean()), **by_name}
