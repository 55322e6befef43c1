"""Times of the equations of motion: ours and every rival's, on the same states.

Every pair is timed in turns, so that a busy machine slows both; before that the rival's numbers
are checked against ours. Neglected: cold caches, many cores.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from patagium.arrays import Array
from patagium.dynamics import Dynamics
from patagium.errors import PatagiumError
from patagium.robot.model import Robot
from patagium_lab.bench.result import Result, compared
from patagium_lab.rivals.compiled import Rival
from patagium_lab.timing import (
    CompiledCall,
    compiled_call,
    time_batch,
    time_call,
    time_python,
)

ARGUMENTS = {
    "mass_matrix": "q",
    "coriolis": "qv",
    "gravity": "q",
    "bias": "qv",
    "mass_matrix_and_bias": "qv",
    "inverse": "qva",
    "forward": "qvf",
}
"""Each quantity and its arguments."""

AGREEMENT = 1e-8  # relative; forward dynamics divide by a D of condition 1e7
_RIVAL_NAMES = {"both": "mass_matrix_and_bias"}
_BATCH = 4096
_TURNS = 3


@dataclass(frozen=True)
class States:
    """Random states of a robot, each (N, n).

    Attributes:
        q: Coordinates, uniform within 1 m or rad.
        v: Velocities, normal, 3 m/s or rad/s.
        a: Accelerations, normal, 10 m/s^2 or rad/s^2.
        f: Forces, normal, 0.01 N or N m.
    """

    q: Array
    v: Array
    a: Array
    f: Array

    def of(self, quantity: str) -> list[Array]:
        """Arguments of a quantity."""
        return [getattr(self, letter) for letter in ARGUMENTS[quantity]]


def random_states(robot: Robot, count: int, seed: int = 0) -> States:
    """States to time on.

    Args:
        robot: The machine.
        count: Number of states, N.
        seed: Seed of the draw.
    """
    rng = np.random.default_rng(seed)
    shape = (count, robot.dof)
    normal = [rng.normal(size=shape) * scale for scale in (3.0, 10.0, 0.01)]
    return States(rng.uniform(-1, 1, shape), *normal)


class DynamicsBench:
    """Our compiled equations, ready to be timed beside others.

    Args:
        robot: The machine.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, self.dynamics = robot, Dynamics(robot)
        self.states = random_states(robot, 512)

    def alone(self) -> list[Result]:
        """Time of each quantity, one state a call."""
        note = "compiled, timed in C"
        if self._call("bias") is None:
            note = "no C compiler: CasADi's virtual machine, Python call included"
        return [Result(name, self._time(name), "ns", note=note) for name in ARGUMENTS]

    def batches(self) -> list[Result]:
        """Time a state of `dyn.batch`, from Python, results in arrays of their own."""
        states = random_states(self.robot, _BATCH, seed=1)
        note = f"a state, {_BATCH} in one Python call, everything included"
        results = []
        for name in ARGUMENTS:
            method = getattr(self.dynamics.batch, name)
            arrays = states.of(name)
            value = time_batch(lambda m=method, x=arrays: m(*x), _BATCH)  # type: ignore[misc]
            results.append(
                compared(f"{name} batch", value, "ns", "one state a call", self._time(name), note)
            )
        return results

    def against(self, rival: Rival, batch: bool = False) -> Iterator[Result]:
        """Each quantity the rival offers beside ours, after a check of its numbers.

        Args:
            rival: Compiled functions.
            batch: Whether our batch calls are set against the rival's single calls too.

        Raises:
            PatagiumError: If the rival's numbers are not ours.
        """
        for theirs, call in rival.calls.items():
            name = _RIVAL_NAMES.get(theirs, theirs)
            agreement = self._agreement(rival, name, call)
            inputs = [x[:, rival.order] for x in self.states.of(name)]
            values = [
                (self._time(name), time_call(call, [*inputs, *rival.extra])) for _ in range(_TURNS)
            ]
            ours, value = (float(x) for x in np.median(values, axis=0))
            note = f"{rival.story}; {agreement}"
            yield compared(name, ours, "ns", rival.name, value, note)
            if batch:
                yield self._batch_against(name, rival, value)

    def in_python(self, name: str, rivals: dict[str, Callable[..., object]]) -> list[Result]:
        """One quantity called from Python, one state a call.

        Args:
            name: The quantity.
            rivals: Other ways to it, functions of the arguments of one state.
        """
        rows = list(zip(*self.states.of(name), strict=True))
        ours = time_python(walk(getattr(self.dynamics, name), rows))
        results = []
        for rival, function in rivals.items():
            value = time_python(walk(function, rows))
            note = "Python calls, overhead included on both sides"
            results.append(compared(f"{name}, from Python", ours, "ns", rival, value, note))
        return results

    def casadi_call(self, name: str) -> Callable[..., object]:
        """A quantity as a plain call of the CasADi function behind it."""
        function: ca.Function = self.dynamics.expressions[name]
        return lambda *arguments: function(*arguments, self.robot.parameters)

    def _call(self, name: str) -> CompiledCall | None:
        return compiled_call(self.dynamics.functions[name])

    def _time(self, name: str) -> float:
        call, arguments = self._call(name), self.states.of(name)
        if call is None:
            rows = list(zip(*arguments, strict=True))
            return time_python(walk(getattr(self.dynamics, name), rows))
        return time_call(call, [*arguments, self.robot.parameters])

    def _batch_against(self, name: str, rival: Rival, value: float) -> Result:
        states = random_states(self.robot, _BATCH, seed=1)
        method, arrays = getattr(self.dynamics.batch, name), states.of(name)
        ours = time_batch(lambda: method(*arrays), _BATCH)
        note = f"a state, {_BATCH} in one Python call, beside one call of the rival a state"
        return compared(f"{name} batch", ours, "ns", rival.name, value, note)

    def _agreement(self, rival: Rival, name: str, call: CompiledCall) -> str:
        copies = getattr(call.keep, "rival_copies_out", lambda on: None)
        copies(1)
        worst = 0.0
        for k in range(5):
            arguments = [x[k] for x in self.states.of(name)]
            expected = getattr(self.dynamics, name)(*arguments)
            expected = expected if isinstance(expected, tuple) else (expected,)
            found = call.evaluate([*(x[rival.order] for x in arguments), *rival.extra])
            for ours, theirs in zip(expected, found, strict=True):
                permuted = _permuted(ours, rival.order)
                scale = np.abs(ours).max() or 1.0  # a force that vanishes identically
                worst = max(worst, np.abs(permuted - theirs).max() / scale)
        copies(0)
        if not worst <= AGREEMENT:
            raise PatagiumError(f"{rival.name} and we disagree on {name} by {worst:.1e} (relative)")
        return f"numbers agree to {worst:.0e}"


def _permuted(ours: Array, order: NDArray[np.intp]) -> Array:
    """Our vector or symmetric matrix in the rival's order of coordinates, flat."""
    if ours.ndim == 2:
        return np.asarray(ours[np.ix_(order, order)].ravel())
    return np.asarray(ours[order])


def walk(
    function: Callable[..., object], rows: Sequence[tuple[Array, ...]]
) -> Callable[[], object]:
    """A call that takes the next state each time.

    Args:
        function: The call.
        rows: Arguments for each state.
    """
    turn = cycle(rows)
    return lambda: function(*next(turn))
