"""Estimators of a flight: the true state with noise, late, or not at all.

Neglected: noise that is correlated in time, and biases.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from patagium.errors import ParameterError, finite
from patagium.robot import Robot
from patagium.simulation.simulator import FlightState

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Truth:
    """True motion of a flight so far, at every time step.

    Attributes:
        robot: The machine that flies.
        time_step: Step [s].
        q: Coordinates, (N, n_q) [m, rad, 1].
        v: Velocities, (N, n) [m/s, rad/s].
        a: Accelerations, (N, n) [m/s^2, rad/s^2].
    """

    robot: Robot
    time_step: float
    q: Array
    v: Array
    a: Array


@dataclass(frozen=True)
class Estimate:
    """Estimate of the state of a flight.

    Attributes:
        state: Coordinates and velocities, and the time that they are those of.
        acceleration: Accelerations then, (n,) [m/s^2, rad/s^2].
    """

    state: FlightState
    acceleration: Array


class Estimator(Protocol):
    """Estimator of the state of a flight."""

    def __call__(self, truth: Truth) -> Estimate | None:
        """Estimate by now, or None where there is none.

        Args:
            truth: All motion so far, of which its sensors see something.
        """


@dataclass(frozen=True)
class NoisyState:
    """State as it is, with white noise, late or missing.

    Args:
        std: Standard deviations by name: a coordinate such as `z`, `velocity of z`, or
            `acceleration of z` [SI]; what is not named is exact.
        delay: Time by which every sample is late; the controller takes it as a sample of its
            time [s].
        missing: Share of samples that do not come, below 1.

    Raises:
        ParameterError: If a number is out of its range.
    """

    std: Mapping[str, float] = field(default_factory=dict)
    delay: float = 0.0
    missing: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (*self.std.items(), ("delay", self.delay)):
            if finite(name, value) < 0:
                raise ParameterError(name, "zero or more", value)
        if not 0 <= finite("missing", self.missing) < 1:
            raise ParameterError("missing", "at least 0 and below 1", self.missing)

    def estimator(self, robot: Robot, seed: int) -> Estimator:
        """Estimator of one flight.

        Args:
            robot: The machine.
            seed: Seed of noise and missing samples.

        Raises:
            ParameterError: If the robot has no such state.
        """
        dofs = robot.dof_names
        names = [*robot.coordinate_names, *(f"{k} of {i}" for k in _RATES for i in dofs)]
        for name in self.std:
            if name not in names:
                raise ParameterError("std", "states of the robot", name, names)
        stds = np.array([self.std.get(name, 0.0) for name in names])
        rng = np.random.default_rng([seed, 0x5EED])

        def estimate(truth: Truth) -> Estimate | None:
            errors, lost = stds * rng.standard_normal(len(stds)), rng.random() < self.missing
            place = len(truth.q) - 1 - round(self.delay / truth.time_step)
            if lost or place < 0:
                return None
            moved = np.concatenate([part[place] for part in (truth.q, truth.v, truth.a)]) + errors
            q, v, a = np.split(moved, [truth.q.shape[1], truth.q.shape[1] + len(dofs)])
            return Estimate(FlightState(robot, place * truth.time_step, q, v), a)

        return estimate


_RATES = ("velocity", "acceleration")
