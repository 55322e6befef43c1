"""Protocol of the models of the air, and their compiled methods.

A model writes its equations as expressions; the protocol compiles them and adds
the methods a user calls with arrays. The robot's and the model's parameters stay
run-time inputs of the compiled functions.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, ClassVar, Protocol, runtime_checkable

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.named_descriptions import field_values
from patagium.aerodynamics.strip_loads import AeroExpressions
from patagium.arrays import Array, real_array
from patagium.errors import ShapeError
from patagium.native import NativeFunction, expression_digest, load_functions, named_function
from patagium.robot.model import Robot


class AtState(Protocol):
    """Methods of compiled code at a state: those of a model, and of the same over many states."""

    def compiled_at(self, name: str, *given: Any) -> Any:
        """Results of a compiled function, from q, v, state and wind."""

    def generalized_force(
        self, q: ArrayLike, v: ArrayLike, state: ArrayLike | None = None, wind: Any = None
    ) -> Array:
        """Generalized aerodynamic force B2 u2, (n,) [N, N m].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
            state: The model's own states, (n_z,) [m/s, -]; zero by default.
            wind: Velocity of the air, world axes, (3,) [m/s]; that of `air` at t = 0 by default.

        Raises:
            ShapeError: If an argument has another shape.
            ParameterError: If a quaternion is zero.
        """
        force: Array = self.compiled_at("generalized_force", q, v, state, wind)
        return force

    def strips(
        self, q: ArrayLike, v: ArrayLike, state: ArrayLike | None = None, wind: Any = None
    ) -> dict[str, Any]:
        """Flow and load of each strip; arguments as for `generalized_force`.

        Returns:
            strip_force (n_strips, 3) [N] and strip_point (n_strips, 3) [m] in world axes,
            angle_of_attack and effective_angle_of_attack (n_strips,) [rad], strip_airspeed
            (n_strips,) [m/s], power [W], circulation (n_strips,) [m^2/s] and downwash
            (n_strips,) [m/s].
        """
        found: dict[str, Any] = self.compiled_at("strips", q, v, state, wind)
        return found

    def state_derivative(
        self, q: ArrayLike, v: ArrayLike, state: ArrayLike | None = None, wind: Any = None
    ) -> Array:
        """Rate of the model's own states, (n_z,); arguments as for `generalized_force`."""
        rate: Array = self.compiled_at("state_derivative", q, v, state, wind)
        return rate


@runtime_checkable
class Aerodynamics(AtState, Protocol):
    """A model of the air around a robot.

    A model gives its description, parameters and expressions; the compiled methods
    follow. They use the robot's and the model's own numbers, and the wind at t = 0
    unless another is given.
    """

    name: ClassVar[str]
    robot: Robot
    air: Air

    @property
    def state_size(self) -> int:
        """Number of the model's own states, n_z."""

    @property
    def structure(self) -> str:
        """Text of what shapes the equations, numbers aside."""
        return self.name

    @cached_property
    def key(self) -> str:
        """Text on which compiled functions depend: `structure`, and code from outside patagium."""
        return f"{self.structure}{expression_digest(type(self), lambda: aero_functions(self))}"

    @property
    def numbers(self) -> dict[str, float]:
        """Parameters of the model by name, in their order [SI]."""
        return dict(zip(self.parameter_names, self.parameters, strict=True))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the model's parameters, in the order of `parameters`."""
        return tuple(self.numbers)

    @property
    def parameters(self) -> Array:
        """Values of the model's parameters, (n_c,)."""
        return np.array([*self.numbers.values()], float)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the model's own states, (n_z,); "velocity of x" and y: a vector in the world."""
        return tuple(f"lag state {k}" for k in range(self.state_size))

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the model's own states, (n_z,): "m/s" for lagged normalwashes, or "1"."""
        return ("m/s",) * self.state_size

    def describe(self) -> dict[str, Any]:
        """Description that makes the model again for a robot, as JSON-able values."""
        values = field_values(self)
        del values["robot"]
        return {"model": self.name, **values}

    def expressions(
        self, robot: Robot, q: ca.SX, v: ca.SX, state: ca.SX, wind: ca.SX, parameters: ca.SX
    ) -> AeroExpressions:
        """Equations of the model.

        Args:
            robot: The model's robot, its numbers floats or symbols.
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
            state: The model's own states, (n_z,) [m/s, -].
            wind: Velocity of the air, world axes, one for all strips, (3,), or one a strip,
                (3, n_strips) [m/s].
            parameters: The model's parameters, (n_c,) [SI].
        """

    def compiled_at(self, name: str, *given: Any) -> Any:
        """Results of a compiled function; see `AtState`."""
        return self._compiled.compiled_at(name, *given)

    @cached_property
    def batch(self) -> CompiledAero:
        """Methods of the model over many states: every array has a leading axis N.

        An argument without it (a wind, a state) holds for all.
        """
        return CompiledAero(self, batch=True)

    @cached_property
    def _compiled(self) -> CompiledAero:
        return CompiledAero(self, batch=False)

    def __getstate__(self) -> dict[str, Any]:
        compiled = {"batch", "key", "_compiled"}  # made again where they are needed
        return {name: one for name, one in self.__dict__.items() if name not in compiled}


OF_STRIPS = [
    *("strip_force", "strip_point", "angle_of_attack", "effective_angle_of_attack"),
    *("strip_airspeed", "power", "circulation", "downwash"),
]
"""Flow and load of strips among the expressions of a model; the first two are vectors."""


class CompiledAero(AtState):
    """The compiled methods of a model of the air, for one state or for many.

    Args:
        model: The model.
        batch: Whether arguments and results have a leading axis N.
    """

    def __init__(self, model: Aerodynamics, batch: bool) -> None:
        self._model, self._batch = model, batch
        self._wind = model.air.wind_at([0.0])[0]
        self._state = np.zeros(model.state_size)
        self._constants = (model.robot.parameters, model.parameters)
        self._functions = compile_aero(model)

    def __reduce__(self) -> tuple[type[CompiledAero], tuple[Aerodynamics, bool]]:
        return CompiledAero, (self._model, self._batch)

    def compiled_at(self, name: str, *given: Any) -> Any:
        """Results of a compiled function, over N states or at one; see `AtState`."""
        q, v, state, wind = given
        arguments = {
            "q": (q, self._model.robot.coordinate_count),
            "v": (v, self._model.robot.dof),
            "state": (self._state if state is None else state, self._model.state_size),
            "wind": (self._wind if wind is None else wind, 3),
        }
        arrays = [self._checked(k, value, n) for k, (value, n) in arguments.items()]
        self._model.robot.check_attitudes(arrays[0])
        function = self._functions[name]
        found = (function.batch if self._batch else function)(*arrays, *self._constants)
        if name != "strips":
            return self._column(found)
        shape = dict.fromkeys(OF_STRIPS, self._column)
        shape |= dict.fromkeys(OF_STRIPS[:2], self._vectors) | {"power": lambda value: value}
        return {one: shape[one](x) for one, x in zip(OF_STRIPS, found, strict=True)}

    def _checked(self, name: str, value: Any, size: int) -> Array:
        array = real_array(name, value)
        if array.shape[-1:] != (size,) or array.ndim > 1 + self._batch:
            raise ShapeError(name, f"(N, {size})" if self._batch else (size,), array.shape)
        return array

    def _vectors(self, value: Any) -> Array:
        """One vector a strip, ([N,] n_strips, 3)."""
        array = np.asarray(value, float)
        matrices = array.reshape(*array.shape[: int(self._batch)], 3, -1)
        return np.swapaxes(matrices, -1, -2)

    def _column(self, value: Any) -> Array:
        """A column of one number comes back from compiled code as a scalar."""
        array = np.asarray(value, float)
        return array[..., None] if array.ndim == int(self._batch) else array


def compile_aero(model: Aerodynamics) -> dict[str, NativeFunction]:
    """Compiled functions of a model: generalized_force, strips, state_derivative.

    Inputs of each: q, v, state, wind, robot_parameters, aero_parameters.
    """
    key = f"aerodynamics {model.key} {model.robot.structure}"
    label = f"aerodynamics of {model.robot.name}"
    return load_functions(key, lambda: aero_functions(model), label=label)


def checked_air(model: Aerodynamics, robot: Robot, air: AeroExpressions) -> AeroExpressions:
    """Expressions of a model, in the shapes on which compiled code counts.

    Args:
        model: The model.
        robot: The robot of the expressions.
        air: What the model gives for it.

    Raises:
        ShapeError: If an expression, or the names of the states, have another shape.
    """
    strips, states = len(robot.strips), (model.state_size, 1)
    shapes = dict.fromkeys(OF_STRIPS, (strips, 1)) | dict.fromkeys(OF_STRIPS[:2], (3, strips))
    shapes |= {"power": (1, 1), "generalized_force": (robot.dof, 1), "wind": (3, strips or 1)}
    given = {**vars(air), **(vars(air.memory) if air.memory else {}), "memory": None}
    given["state_names"] = ca.SX(len(model.state_names), 1)
    for name, one in given.items():
        wanted = shapes.get(name, states)
        if one is not None and ca.SX(one).shape != wanted:
            raise ShapeError(f"aero {type(model).__name__}: {name}", wanted, ca.SX(one).shape)
    return air


def aero_functions(model: Aerodynamics) -> Sequence[ca.Function]:
    """CasADi functions generalized_force, strips and state_derivative of a model."""
    robot, robot_parameters = model.robot.symbolic()
    inputs = {
        "q": ca.SX.sym("q", robot.coordinate_count),
        "v": ca.SX.sym("v", robot.dof),
        "state": ca.SX.sym("state", model.state_size),
        "wind": ca.SX.sym("wind", 3),
        "robot_parameters": robot_parameters,
        "aero_parameters": ca.SX.sym("c", len(model.parameter_names)),
    }
    q, v, state, wind, _, parameters = inputs.values()
    air = checked_air(model, robot, model.expressions(robot, q, v, state, wind, parameters))
    outputs = {
        "generalized_force": ["generalized_force"],
        "strips": OF_STRIPS,
        "state_derivative": ["state_derivative"],
    }
    return [
        named_function(name, inputs, {key: getattr(air, key) for key in keys})
        for name, keys in outputs.items()
    ]
