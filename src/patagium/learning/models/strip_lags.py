"""Lag states of strips and the trailing vortices they share, for a network of attached flow.

The same functions as `LiftingLine`, as equations that a network's memory follows from sample to
sample: one lag a strip, of constant numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from patagium.aerodynamics.indicial import Relaxation
from patagium.aerodynamics.linear_strips import LAGS, LIFT_SLOPE, StripFlow
from patagium.aerodynamics.trailing_vortices import implicit_lag_step
from patagium.arrays import Array
from patagium.learning.models.memory import CompiledSteps, MemoryState
from patagium.native import NativeFunction, named_function


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

    def begin(self, x: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Lags of a flow that was always as it is at a sample."""
        return self._kept(self.functions["begin"](x, self.constants))

    def step(
        self, x: Array, weights: Array, time_step: float, before: MemoryState
    ) -> tuple[Array, Array, Array]:
        """Lags a step later."""
        known = x, self.constants, time_step, before.state, before.driver
        return self._kept(self.functions["step"](*known))

    def _kept(self, found: Sequence[Array]) -> tuple[Array, Array, Array]:
        """State, no sensitivity, and driver."""
        state, semichords = found
        return state, np.zeros((len(state), 0)), semichords
