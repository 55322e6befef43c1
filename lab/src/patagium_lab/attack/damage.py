"""A wing that loses a third of its area in mid-flight, and a learner that knew it whole.

The robot beats its wings on a fixed mount in oblique wind, as a free one would roll over; then
the left wing loses the rear third of its chord, and every strip gets another polar. The network
is dense: a strip network gives both wings the same coefficients and fixed areas, so that it cannot
represent damage to one side. Neglected: the moment of breaking, the mass that is lost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from patagium.aerodynamics import Air, DickinsonPolar, QuasiSteady
from patagium.aerodynamics.polars import Polar
from patagium.arrays import Array
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.settings import ChangeDetection, NoiseEstimation, Screening
from patagium.robot import Robot, load_robot
from patagium.sensing.force.air_force import training_data
from patagium.simulation import mounts, simulate
from patagium_lab.attack.network import dense_network
from patagium_lab.reproduction.cases import FLIGHT_CASES, SPREAD, lever_arms
from patagium_lab.reproduction.flights import LEARNED
from patagium_lab.rivals.gradient_learner import GradientLearner

TIME_STEP = 1e-4
"""Every sample of it is learned [s]."""
BEAT = 1680
"""Samples in a wingbeat."""
BEATS = (12, 12)
"""Wingbeats before the damage, and after it."""
WIND = (-4.5, 0.8, 0.3)
"""Oblique, so that every coordinate feels the air before the damage too [m/s]."""
LOST = 1 / 3
"""Share of the left wing's chord."""
OTHER_POLAR = DickinsonPolar(
    lift_offset=0.15, lift_amplitude=1.2, drag_offset=2.2, drag_amplitude=1.5
)
"""After the damage, of every strip: a quarter less lift, more drag."""
NOISE = 0.02
"""Standard deviation of the noise over that of each output [1]."""
AHEAD, APART = 100, 20
"""Samples predicted by frozen weights, and samples between two such windows."""
FORMER = 3
"""Wingbeats before the damage over which the former error is averaged."""
HIDDEN = (20,)
LONG, SHORT = 1e-6, 1e-5
"""Shares of the prior: memories of 100 s and of 10 s."""


class DamagedFlight(NamedTuple):
    """A flight before and after the damage.

    Attributes:
        x: States q and v, (N, 2n) [m, rad, m/s, rad/s].
        y: Force of the air, (N, n) [N, N m].
        beats: Number of wingbeats before the damage.
    """

    x: Array
    y: Array
    beats: int


@dataclass(frozen=True)
class Recovery:
    """Errors of a learner before and after the damage.

    Attributes:
        learner: Name of the learner.
        hold: NMSE by wingbeat, one sample ahead, mean over outputs.
        ahead: NMSE by wingbeat over the 10 ms after each update, with frozen weights.
        beats: Number of wingbeats before the damage.
        changes: Samples after the damage at which a change was detected; before it, negative.
    """

    learner: str
    hold: Array
    ahead: Array
    beats: int
    changes: tuple[int, ...]

    def row(self) -> dict[str, Any]:
        """Former errors, errors over them by wingbeat after the damage, as JSON-able values.

        Returns:
            hold_former, ahead_former; hold_ratios, ahead_ratios; hold_beats, ahead_beats
            (wingbeats until the error stays within twice the former one; None: never);
            detected (samples after the damage; None: not within a wingbeat), alarms_before.
        """
        late = [change for change in self.changes if 0 < change <= BEAT]
        row: dict[str, Any] = {"learner": self.learner}
        for name, error in (("hold", self.hold), ("ahead", self.ahead)):
            former = float(error[self.beats - FORMER : self.beats].mean())
            ratios = error[self.beats :] / former
            over = np.flatnonzero(ratios > 2)
            beats = int(over[-1]) + 2 if len(over) else 1
            row[f"{name}_former"] = former
            row[f"{name}_ratios"] = ratios.tolist()
            row[f"{name}_beats"] = beats if beats <= len(ratios) else None
        row["detected"] = late[0] if late else None
        row["alarms_before"] = sum(change <= 0 for change in self.changes)
        return row


def damaged_flight(beats: Sequence[int] = BEATS) -> DamagedFlight:
    """The robot whole and damaged, one after the other without a step in its motion.

    Args:
        beats: Wingbeats before and after.
    """
    robot = load_robot("aerobat")
    whole = _flown(robot, DickinsonPolar(), beats[0])
    broken = _flown(damaged(robot), OTHER_POLAR, beats[1])
    x, y = (np.vstack([a[:-1], b]) for a, b in zip(whole, broken, strict=True))
    return DamagedFlight(x, y, beats[0])


def damaged(robot: Robot) -> Robot:
    """The robot without the rear third of its left wing.

    Args:
        robot: The whole one.
    """
    values = dict(zip(robot.parameter_names, robot.parameters, strict=True))
    changed: dict[str, float] = {}
    for strip in robot.strips:
        if not strip.mirrored:
            chord, point = f"{strip.name}.chord", f"{strip.name}.quarter_chord.x"
            changed[chord] = (1 - LOST) * values[chord]
            changed[point] = values[point] + LOST * values[chord] / 4
    return robot.with_parameters(changed)


def learner_names() -> list[str]:
    """Names of the learners that are compared."""
    return list(learners())


def damage_row(name: str) -> dict[str, Any]:
    """Row of a learner through the damage; see `Recovery.row`.

    Args:
        name: Name out of `learner_names`.
    """
    return recovery(name, damaged_flight(), learners()[name]()).row()


def recovery(name: str, flight: DamagedFlight, learner: Learner) -> Recovery:
    """Errors of a learner before and after the damage.

    Args:
        name: Name of the learner.
        flight: The flight; noise is added to its forces.
        learner: The learner; it is changed.
    """
    noise = NOISE * flight.y.std(axis=0)
    measured = flight.y + noise * np.random.default_rng(0).normal(size=flight.y.shape)
    hold, ahead = np.full_like(flight.y, np.nan), np.full(flight.y.shape, np.nan)
    for k, (x, y) in enumerate(zip(flight.x, measured, strict=True)):
        hold[k] = y - learner.update(x, y, TIME_STEP * k) - flight.y[k]
        end = k + 1 + AHEAD
        if k % APART == 0 and end <= len(measured) and not k < flight.beats * BEAT < end:
            guess = learner.network.evaluate(flight.x[k + 1 : end], learner.weights)
            ahead[k] = np.sqrt(np.mean((guess - flight.y[k + 1 : end]) ** 2, axis=0))
    damage = flight.beats * BEAT
    found = learner.changes if isinstance(learner, FilterLearner) else ()
    changes = tuple(change - damage for change in found)
    size = flight.y.std(axis=0)
    return Recovery(name, _by_beat(hold / size), _by_beat(ahead / size), flight.beats, changes)


def learners() -> dict[str, Callable[[], Learner]]:
    """Learners that are compared: one with and without detection, and its rivals."""
    detection = ChangeDetection(1e-9, window=50, reference=BEAT, reopening=0.3)
    return {
        "node, memory 100 s, detects changes": lambda: filter_learner(LONG, detection),
        "node, memory 100 s, detects no changes": lambda: filter_learner(LONG, None),
        "node, memory 10 s, detects changes": lambda: filter_learner(SHORT, detection),
        "node, memory 10 s, detects no changes": lambda: filter_learner(SHORT, None),
        "gradient descent": lambda: GradientLearner(dense_network(HIDDEN), learning_rate=0.003),
        "gradient descent, replay of 8": lambda: GradientLearner(
            dense_network(HIDDEN), learning_rate=0.03, replay=8
        ),
    }


def filter_learner(
    prior_share: float, detection: ChangeDetection | None, hidden: Sequence[int] = HIDDEN
) -> CubatureLearner:
    """Learner with one covariance block a neuron that estimates its noise.

    Args:
        prior_share: Share of the prior that is mixed in before each sample.
        detection: Change detection, or None.
        hidden: Neurons of its network's hidden layers.
    """
    subject = FLIGHT_CASES["corrected"]
    return CubatureLearner(
        dense_network(hidden),
        prior_std=0.5,
        measurement_std=0.05 * subject.strip_force * lever_arms(load_robot("aerobat")),
        spread=SPREAD,
        covariance="node",
        prior_share=prior_share,
        screening=Screening(),
        noise_estimation=NoiseEstimation(600),
        change_detection=detection,
    )


def _flown(robot: Robot, polar: Polar, beats: int) -> tuple[Array, Array]:
    wingbeat = replace(LEARNED, frequency=1 / (BEAT * TIME_STEP))
    flight = simulate(
        robot,
        QuasiSteady(robot, air=Air(wind=WIND), polar=polar),
        wingbeat.gait(robot),
        duration=beats * BEAT * TIME_STEP,
        time_step=TIME_STEP,
        q=robot.coordinates(pitch=0.2),
        mount=mounts.fixed(),
    )
    return training_data(flight)[1:]


def _by_beat(error: Array) -> Array:
    whole = len(error) // BEAT
    beats = np.square(error[: whole * BEAT]).reshape(whole, BEAT, -1)
    return np.asarray(np.nanmean(beats, axis=1).mean(axis=1))
