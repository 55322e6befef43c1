"""Lag states of strips and the trailing vortices they share, for a network of attached flow.

The same functions as `LiftingLine`, as equations that a network's memory follows from sample to
sample: one lag a strip, of constant numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi
from typing import NamedTuple

import casadi as ca
import numpy as np

from patagium.aerodynamics.indicial import ONE_STATE, Lags, Relaxation
from patagium.aerodynamics.local_flow import StripMotion, airspeed, normalwash, strip_motions
from patagium.aerodynamics.smooth_functions import smooth_sign
from patagium.aerodynamics.trailing_vortices import (
    SURFACE_CONSTANT,
    Normalwash,
    VortexSystem,
    attached_lift,
    implicit_lag_step,
    lattice,
    solve_normalwash,
    surface_gains,
)
from patagium.arrays import Array
from patagium.learning.models.memory import CompiledSteps, MemoryState
from patagium.native import NativeFunction, named_function
from patagium.robot.model import Robot
from patagium.robot.strip_chains import strip_chains

LAGS = Lags(ONE_STATE.rate, ONE_STATE.lift, ONE_STATE.circulation)
"""Memory of a section."""
LIFT_SLOPE = 2 * pi
"""Lift slope of attached flow [1/rad]."""


class StripFlow:
    """Strips of a lifting line and their trailing vortices, as expressions.

    Args:
        machine: The robot in numbers.
        robot: Its symbolic twin.
        motion: q, v and the wind, world axes.

    Attributes:
        motions: Motion of each strip.
        state: Lag of each strip, (m, 1) [m/s].
        semichords: Half chords that each strip travels in a second, (m, 1) [1/s].
    """

    def __init__(self, machine: Robot, robot: Robot, motion: tuple[ca.SX, ca.SX, ca.SX]) -> None:
        chains = strip_chains(machine)
        self.motions = strip_motions(robot, *motion)
        self.vortices = VortexSystem(chains, lattice(robot, chains, *motion), self.motions)
        self.geometric = ca.vertcat(*[normalwash(one) for one in self.motions])
        self.gains = surface_gains(machine, robot, SURFACE_CONSTANT)
        self.state = ca.SX.sym("state", len(self.motions))
        self.semichords = ca.vertcat(*[2 * airspeed(m) / m.strip.chord for m in self.motions])

    def wash(self, held: bool = True) -> Normalwash:
        """Normalwashes of all strips; not held: as if nothing were held back by lags."""
        state, lags = (self.state, LAGS) if held else (ca.SX(0, 1), Lags((), (), ()))
        return solve_normalwash(self.vortices, self.geometric, state, lags, LIFT_SLOPE)

    def lift(self, wash: Normalwash, i: int, density: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Attached lift of strip i, forward, normal and spanwise, at `lift_place` [N]."""
        motion, strip = self.motions[i], self.motions[i].strip
        pressure = density * strip.chord * strip.width * LIFT_SLOPE * airspeed(motion) / 2
        return attached_lift(self.vortices, wash, i, self.gains[i], pressure, lift_place(motion))


def lift_place(motion: StripMotion) -> ca.SX:
    """Distance of the lift ahead of the quarter chord; at 3/4 of it in backward flow [m]."""
    return (smooth_sign(motion.forward) - 1.0) * (motion.strip.chord / 4)


def lag_functions(flow: StripFlow, x: ca.SX, parameters: ca.SX) -> list[ca.Function]:
    """Functions begin and step of `StripLags`.

    Args:
        flow: An expression of the measured inputs and the constants.
        x: Measured inputs.
        parameters: Constants.
    """
    given, count = {"x": x, "network_parameters": parameters}, len(flow.motions)
    effective = flow.wash(held=False).effective
    begun = ca.vertcat(effective, effective)
    step, effective = ca.SX.sym("step"), ca.SX.sym("effective", count)
    semichords, before = ca.SX.sym("semichords", count), ca.vertcat(flow.state, effective)
    relaxation = Relaxation(LAGS.rate[0] * semichords, effective)
    vortices = flow.vortices, flow.geometric, flow.state
    found = implicit_lag_step(*vortices, step, relaxation, LAGS, LIFT_SLOPE)
    carried = {**given, "step": step, "state": before, "semichords": semichords}
    return [
        named_function(name, known, {"reached": state, "driver": flow.semichords})
        for name, known, state in (("begin", given, begun), ("step", carried, ca.vertcat(*found)))
    ]


class StripLags(NamedTuple):
    """Equations of the lags of all strips. The state holds the lags, then the normalwashes.

    Attributes:
        functions: `lag_functions`.
        constants: Constants of the functions.
        measured: Length of [q, v, a].
        states: Number of strips, whose semichords a second each drive the next step.
        compiled: Equations in C; None without a compiler.
        parameters: Number of weights that the lags depend on.
    """

    functions: Mapping[str, NativeFunction]
    constants: Array
    measured: int
    states: int
    compiled: CompiledSteps | None
    parameters: int = 0

    @property
    def carried(self) -> tuple[int, int]:
        """Number of lags and normalwashes, and of strips."""
        return 2 * self.states, self.states

    def drivers(self, weights: Array, x: Array) -> Array:
        """Measured inputs of each sample, (N, measured)."""
        return x

    def begin(self, driver: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Lags of a flow that was always as it is at a sample."""
        return self._kept(self.functions["begin"](driver, self.constants))

    def step(
        self, driver: Array, weights: Array, time_step: float, before: MemoryState
    ) -> tuple[Array, Array, Array]:
        """Lags a step later."""
        known = driver, self.constants, time_step, before.state, before.driver
        return self._kept(self.functions["step"](*known))

    def _kept(self, found: Sequence[Array]) -> tuple[Array, Array, Array]:
        """State, no sensitivity, and driver."""
        state, semichords = found
        return state, np.zeros((len(state), 0)), semichords
