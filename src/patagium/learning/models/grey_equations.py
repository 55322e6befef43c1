"""Equations of a grey box: what the air does, what its memory follows, and their slopes.

y = Q(x, z; p) + circulation and force of the air carried along - changes of the robot's own
inertia and damping, at numbers p of which some are learned. Slopes are forward derivatives
along one direction, by algorithmic differentiation. Neglected: gusts; the wind is steady.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from patagium.aerodynamics.added_mass import AddedMass
from patagium.aerodynamics.lag_states import Relaxation, lag_step
from patagium.aerodynamics.model import Aerodynamics
from patagium.dynamics.equations import inverse, kirchhoff_force
from patagium.errors import ParameterError
from patagium.learning.models.physical import PhysicalParameter, inertial, numbers_of
from patagium.native import NativeFunction, load_functions


@dataclass(frozen=True)
class GreyEquations:
    """What a grey box computes, as expressions and as compiled functions.

    Attributes:
        model: The air.
        added_mass: What it carries along, or None.
        parameters: What is learned.
        outputs: Coordinates whose force y is.
    """

    model: Aerodynamics
    added_mass: AddedMass | None
    parameters: tuple[PhysicalParameter, ...]
    outputs: tuple[int, ...]

    @property
    def names(self) -> list[str]:
        """Names of what is learned."""
        return [parameter.name for parameter in self.parameters]

    @property
    def explains_added_mass(self) -> bool:
        """Whether y holds the force of the air carried along."""
        return self.added_mass is not None

    @cached_property
    def needs_acceleration(self) -> bool:
        """Whether x ends with the accelerations."""
        return self.explains_added_mass or inertial(self.names, self.model.robot)

    @cached_property
    def measured_inputs(self) -> int:
        """Length of [q, v] or [q, v, a]."""
        robot = self.model.robot
        rates = 2 if self.needs_acceleration else 1
        return robot.coordinate_count + rates * robot.dof

    def compiled(self) -> dict[str, NativeFunction]:
        """Functions by name.

        force (x, z, theta) -> y; force_forward (x, z, theta, dz, dtheta) -> y, dy; of models
        with memory step_forward (before, after, z, theta, dz, dtheta, step) -> z', dz' and
        follow_forward (x, z, theta, dz, dtheta) -> target, dtarget. Their last input are all
        numbers, then the scales of theta.
        """
        model = self.model
        symbolic, _ = model.robot.symbolic()
        options = f"{self.names} {self.outputs} {self.added_mass is not None}"
        kinds = [parameter.positive for parameter in self.parameters]
        key = f"grey box {options} {kinds} {model.structure} {symbolic!r}"
        return load_functions(key, self.functions, label=f"grey box of {model.robot.name}")

    def functions(self) -> list[ca.Function]:
        """The same as CasADi functions."""
        n_z, count = self.model.state_size, len(self.parameters)
        x, z = ca.SX.sym("x", self.measured_inputs), ca.SX.sym("z", n_z)
        theta, numbers = ca.SX.sym("theta", count), ca.SX.sym("numbers", self._count + count)
        physics = self._physics()
        actual = self._actual(theta, numbers)

        def air(x: ca.SX, z: ca.SX) -> tuple[ca.SX, Relaxation]:
            y, rate, target = physics.call([x, z, actual, numbers[: self._count]], True, False)
            return y, Relaxation(rate, target)

        dz, dtheta = ca.SX.sym("dz", n_z), ca.SX.sym("dtheta", count)

        def along(value: ca.SX) -> ca.SX:
            slope = ca.jtimes(value, ca.vertcat(z, theta), ca.vertcat(dz, dtheta))
            return ca.densify(slope)

        y, memory = air(x, z)
        known, moved = {"x": x, "z": z, "theta": theta}, {"dz": dz, "dtheta": dtheta}
        found = [
            _function("force", known, numbers, {"y": y}),
            _function("force_forward", known | moved, numbers, {"y": y, "dy": along(y)}),
        ]
        if not n_z:
            return found
        target = memory.target
        follow = {"target": target, "dtarget": along(target)}
        after, step = ca.SX.sym("after", self.measured_inputs), ca.SX.sym("step")
        _, later = air(after, lag_step(z, step, memory, memory))
        reached = lag_step(z, step, memory, later)
        inputs = {"before": x, "after": after, **known, **moved, "step": step}
        del inputs["x"]
        advanced = {"reached": reached, "dreached": along(reached)}
        return [
            *found,
            _function("follow_forward", known | moved, numbers, follow),
            _function("step_forward", inputs, numbers, advanced),
        ]

    @property
    def _count(self) -> int:
        return len(numbers_of(self.model, self.added_mass))

    def _actual(self, theta: ca.SX, numbers: ca.SX) -> ca.SX:
        """All numbers, those that are learned as theta says."""
        places = list(numbers_of(self.model, self.added_mass))
        actual = ca.SX(numbers[: self._count])
        for k, parameter in enumerate(self.parameters):
            place, moved = places.index(parameter.name), theta[k] * numbers[self._count + k]
            value = actual[place] * ca.exp(moved) if parameter.positive else actual[place] + moved
            actual[place] = value
        return actual

    def _physics(self) -> ca.Function:
        """(x, z, numbers, numbers as they were before) -> y, rate and target of the memory."""
        model, robot = self.model, self.model.robot
        n, n_q, first = robot.dof, robot.coordinate_count, len(robot.parameter_names)
        machine, symbols = robot.symbolic()
        before, symbols_before = robot.symbolic()
        of_air = ca.SX.sym("c", len(model.parameter_names))
        wind, factor = ca.SX.sym("wind", 3), ca.SX.sym("factor")
        x, z = ca.SX.sym("x", self.measured_inputs), ca.SX.sym("z", model.state_size)
        q, v, a = x[:n_q], x[n_q : n_q + n], x[n_q + n :]
        air = model.expressions(machine, q, v, z, wind, of_air)
        y = air.generalized_force
        if self.added_mass is not None:
            density = of_air[model.parameter_names.index("density")]
            carried = ca.vertcat(density, factor)
            y = y + self.added_mass.circulation_force(machine, q, v, wind, carried)
            added = self.added_mass.inertia(machine, wind, carried)
            y = y + kirchhoff_force(machine, q, v, a, added)
        if inertial(self.names, robot):
            y = y - (inverse(machine, q, v, a) - inverse(before, q, v, a))
        y = y - (ca.vertcat(*machine.damping) - ca.vertcat(*before.damping)) * v
        memory = air.memory or Relaxation(ca.SX(0, 1), ca.SX(0, 1))
        if memory.rate.numel() != model.state_size:
            raise ParameterError("model", "one whose memory follows something", model.name)
        numbers = ca.vertcat(symbols, of_air, wind)
        known = ca.vertcat(symbols_before, ca.SX.sym("others", self._count - first))
        if self.added_mass is not None:
            numbers = ca.vertcat(numbers, factor)
        results = [y[list(self.outputs)], memory.rate, memory.target]
        return ca.Function("physics", [x, z, numbers, known], list(map(ca.densify, results)))


def _function(
    name: str, inputs: dict[str, ca.SX], numbers: ca.SX, outputs: dict[str, ca.SX]
) -> ca.Function:
    names: Sequence[str] = [*inputs, "grey_parameters"]
    given, found = [*inputs.values(), numbers], [*outputs.values()]
    return ca.Function(name, given, found, names, [*outputs])
