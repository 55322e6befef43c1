"""A measured flapping wing learned by grey boxes: physics whose numbers the lift corrects.

The wing pair of `yeo` stands on a floating body that does not move, whose vertical force is the
lift, added mass included. The record is one averaged cycle repeated, so that half of the cycles
shows what a model can represent; halves of the cycle that are not learned show whether it holds
elsewhere. Neglected: as in `yeo`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from patagium.aerodynamics import AddedMass, Aerodynamics, Air, DeLaurier, LiftingLine
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.model_file import model_of
from patagium.learning.models.grey_box import GreyBox
from patagium.learning.models.memory import network_inputs
from patagium.learning.parameter_paths import parameter_table
from patagium.learning.settings import NoiseEstimation
from patagium.learning.stream import stream
from patagium.report import PageSection, Table
from patagium.robot import Robot, load_robot, load_robot_text
from patagium.simulation import gaits
from patagium_lab.measured.yeo_case import YeoCase, load_yeo_case

Array = NDArray[np.float64]

CYCLES = 10
NOISE = 0.03
"""First standard deviation of the lift [N]; it is then estimated."""
PRIORS: Mapping[str, dict[str, float]] = {
    "lifting line": {
        "section.lift_slope": 1.0,
        "section.zero_lift_angle": 0.05,
        "section.stall_begins": 0.05,
        "lags.rate[0]": 0.02,
        "lags.rate[1]": 0.1,
        "lags.lift[1]": 0.1,
        "added_mass.factor": 0.3,
    },
    "DeLaurier's strips": {
        "lift_slope": 1.0,
        "zero_lift_angle": 0.05,
        "stall_angle": 0.05,
        "suction_efficiency": 0.3,
        "crossflow_drag": 0.5,
        "added_mass.factor": 0.3,
    },
}
"""Prior standard deviation of each number that is learned, by model."""
_MODELS: dict[str, Callable[[Robot, Air], Aerodynamics]] = {
    "lifting line": LiftingLine,
    "DeLaurier's strips": DeLaurier,
}
_STAND = """bodies:
  stand: {floating: true, mass: 1 g, shape: {type: box, size: [1 cm, 1 cm, 1 cm]}}
"""
"""Its inertia does not enter the lift, but the wings, two points, leave pitch without any."""


class GreyResult(NamedTuple):
    """A grey box of the measured wing.

    Attributes:
        untuned: Mean absolute error of the lift over a cycle before anything is learned [N].
        learned: Mean absolute error over the cycles after those that were learned [N].
        coverage: Share of their lift inside the predicted 95 % interval.
        unseen: Error in the half of the cycle that was not taught, mean over halves [N].
        unseen_untuned: Error there before anything is learned [N].
        unseen_coverage: Share of the lift there inside the predicted 95 % interval.
        scores: Scores of the online run over the first cycles, parameters included.
    """

    untuned: float
    learned: float
    coverage: float
    unseen: float
    unseen_untuned: float
    unseen_coverage: float
    scores: dict[str, Any]


@dataclass(frozen=True)
class _Log:
    """The wing over cycles: time (N,) [s], x = [q, v, a], lift (N, 1) [N]."""

    time: Array
    x: Array
    lift: Array

    def part(self, begin: int, end: int) -> _Log:
        return _Log(self.time[begin:end], self.x[begin:end], self.lift[begin:end])


def yeo_stand(strips: int = 12) -> Robot:
    """The measured wing pair on a body that floats, so that lift is its vertical force.

    Args:
        strips: Number of strips of a wing.
    """
    source = load_robot("yeo-wing").source
    source = source.replace("strips: 12", f"strips: {strips}").replace("bodies:\n", _STAND, 1)
    source = source.replace(
        "left_wing:\n    joints", "left_wing:\n    parent: stand\n    joints", 1
    )
    return load_robot_text(source, "yeo-wing")


def yeo_grey_box(model: str, *, cycles: int = CYCLES, strips: int = 12) -> GreyResult:
    """Result of a grey box that learns half of the cycles, or halves of the cycle.

    Args:
        model: Key of `PRIORS`.
        cycles: An even number; half of them are learned.
        strips: Number of strips of a wing.
    """
    case, robot = load_yeo_case(), yeo_stand(strips)
    air = Air(density=case.density, wind=(-case.airspeed, 0.0, 0.0))
    aero = _MODELS[model](robot, air)
    grey = GreyBox(aero, PRIORS[model], AddedMass(robot, air), measured=["z"])
    log, half = _log(case, robot, cycles), len(case.lift) * cycles // 2
    learner = _learner(grey, len(case.lift))
    untuned = _error(grey, np.zeros(grey.size), log)
    online = stream(learner, log.time[:half], log.x[:half], log.lift[:half], every=1)
    later = _error_and_coverage(learner, log.part(half, 2 * half))
    errors, inside, before = [], [], []
    for hidden in _halves(len(case.lift)):
        student, seen = _learner(grey, len(case.lift)), np.tile(~hidden, cycles)
        taught = np.where(seen[:, None], log.lift, np.nan)
        stream(student, log.time[:half], log.x[:half], taught[:half], every=1)
        found = _error_and_coverage(student, log.part(half, 2 * half), np.tile(hidden, cycles // 2))
        errors.append(found[0])
        inside.append(found[1])
        before.append(float(untuned[np.tile(hidden, cycles)][len(case.lift) :].mean()))
    return GreyResult(
        float(untuned[len(case.lift) :].mean()),
        *later,
        float(np.mean(errors)),
        float(np.mean(before)),
        float(np.mean(inside)),
        online.scores,
    )


def yeo_grey_section(results: Mapping[str, GreyResult]) -> PageSection:
    """Section of a page with the results.

    Args:
        results: Result of each model, by its name.
    """
    columns = [
        *("model", "untuned [N]", "later cycles, learned [N]", "in the 95 % interval"),
        *("untaught half, untuned [N]", "untaught half [N]", "in the 95 % interval there"),
    ]
    rows: list[list[Any]] = [
        [
            *(name, one.untuned, one.learned, one.coverage),
            *(one.unseen_untuned, one.unseen, one.unseen_coverage),
        ]
        for name, one in results.items()
    ]
    caption = "Mean absolute error of the lift of both wings; the physics before and after."
    tables = [parameter_table(one.scores) for one in results.values()]
    shown = [Table(columns, rows, caption), *(table for table in tables if table is not None)]
    return PageSection("Grey boxes of the measured wing", shown)


def _learner(grey: GreyBox, memory: int) -> ExtendedLearner:
    return ExtendedLearner(grey, measurement_std=NOISE, noise_estimation=NoiseEstimation(memory))


def _error_and_coverage(
    learner: ExtendedLearner, log: _Log, chosen: NDArray[np.bool_] | None = None
) -> tuple[float, float]:
    """Mean absolute error [N] and coverage over the chosen samples, all by default."""
    model, keep = model_of(learner), np.ones(len(log.time), bool) if chosen is None else chosen
    rows = network_inputs(model.network, model.weights, log.time, log.x)
    predicted = [model.predict(row) for row in rows[keep]]
    error = log.lift[keep, 0] - [float(mean[0]) for mean, _ in predicted]
    std = np.sqrt([float(covariance[0, 0]) for _, covariance in predicted])
    return float(np.abs(error).mean()), float((np.abs(error) <= 1.96 * std).mean())


def _error(grey: GreyBox, weights: Array, log: _Log) -> Array:
    rows = network_inputs(grey, weights, log.time, log.x)
    return np.abs(grey.evaluate(rows, weights) - log.lift)[:, 0]


def _halves(samples: int) -> list[NDArray[np.bool_]]:
    """Halves of the cycle that are not learned: a stroke, or two quarters, (100,) each."""
    quarter = 4 * np.arange(samples) // samples
    return [np.isin(quarter, chosen) for chosen in ((0, 1), (2, 3), (0, 2), (1, 3))]


def _log(case: YeoCase, robot: Robot, cycles: int) -> _Log:
    samples = len(case.lift)
    time = np.arange(samples * cycles) / (samples * case.frequency)
    angle = case.flap_angle
    flap = (angle.mean, list(zip(angle.cosine, angle.sine, strict=True)))
    motion = gaits.fourier(robot, frequency=case.frequency, plunge=flap).motion(time)
    parts = np.zeros((3, len(time), robot.dof))
    parts[:, :, list(robot.actuated)] = motion.position, motion.velocity, motion.acceleration
    return _Log(time, np.hstack(list(parts)), np.tile(case.lift, cycles)[:, None])
