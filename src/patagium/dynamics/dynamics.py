"""The equations and the poses of one robot as compiled functions of NumPy arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from patagium.arguments import checked
from patagium.arrays import Array, real_array
from patagium.dynamics import equations, kinematics
from patagium.errors import ShapeError
from patagium.native import NativeFunction, load_functions, named_function
from patagium.robot.model import Robot


def _build(robot: Robot) -> list[ca.Function]:
    """Functions of the equations of motion, by name, for one robot's structure."""
    machine, p = robot.symbolic()
    n, n_a = robot.dof, len(robot.actuated)
    q = ca.SX.sym("q", robot.coordinate_count)
    v, a, f = (ca.SX.sym(name, n) for name in ("v", "a", "f"))
    a_a = ca.SX.sym("a_actuated", n_a)
    mass = equations.mass_matrix(machine, q)
    bias = equations.bias(machine, q, v)
    a_all, u = equations.forward_prescribed(machine, q, v, a_a, f)
    u1 = u[list(robot.actuated)] if n_a else ca.SX(0, 1)
    at, moving = {"q": q}, {"q": q, "v": v}
    prescribed = {**moving, "a_actuated": a_a, "f": f}
    named: dict[str, tuple[dict[str, ca.SX], dict[str, ca.SX]]] = {
        "mass_matrix": (at, {"mass_matrix": mass}),
        "coriolis": (moving, {"force": equations.coriolis(machine, q, v)}),
        "gravity": (at, {"force": equations.gravity_force(machine, q)}),
        "bias": (moving, {"force": bias}),
        "mass_matrix_and_bias": (moving, {"mass_matrix": mass, "bias": bias}),
        "inverse": ({**moving, "a": a}, {"force": equations.inverse(machine, q, v, a)}),
        "forward": ({**moving, "f": f}, {"a": equations.forward(machine, q, v, f)}),
        "forward_prescribed": (prescribed, {"a": a_all, "u1": u1}),
        "kinetic_energy": (moving, {"energy": equations.kinetic_energy(machine, q, v)}),
        "potential_energy": (at, {"energy": equations.potential_energy(machine, q)}),
        "momentum": (moving, {"momentum": equations.momentum(machine, q, v)}),
        "angular_momentum": (moving, {"momentum": equations.angular_momentum(machine, q, v)}),
        "center_of_mass": (at, {"position": equations.center_of_mass(machine, q)}),
        "coordinate_rates": (moving, {"rates": kinematics.coordinate_rates(machine, q, v)}),
    }
    return [named_function(name, {**i, "parameters": p}, o) for name, (i, o) in named.items()]


class _Methods:
    """The equations as methods; one body for single states and for batches."""

    def __init__(self, call: Callable[..., Array]) -> None:
        self._call = call

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Generalized inertia D(q), (n, n) [kg, kg m, kg m^2]; symmetric, positive definite.

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
        """
        return self._call("mass_matrix", q)

    def coriolis(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Coriolis and centrifugal force C(q, v) v, (n,) [N, N m].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
        """
        return self._call("coriolis", q, v)

    def gravity(self, q: ArrayLike) -> Array:
        """Force of gravity and of springs, G(q) = dU/dq, (n,) [N, N m].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
        """
        return self._call("gravity", q)

    def bias(self, q: ArrayLike, v: ArrayLike) -> Array:
        """C v + G, (n,) [N, N m].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
        """
        return self._call("bias", q, v)

    def mass_matrix_and_bias(self, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """D, (n, n), and C v + G, (n,), in one call that shares their common terms.

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
        """
        inertia, bias = self._call("mass_matrix_and_bias", q, v)
        return inertia, bias

    def inverse(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Generalized force of a motion, D a + C v + G, (n,) [N, N m].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
            a: Generalized accelerations, (n,) [m/s^2, rad/s^2].
        """
        return self._call("inverse", q, v, a)

    def forward(self, q: ArrayLike, v: ArrayLike, f: ArrayLike) -> Array:
        """Acceleration of the free robot, D^-1 (f - C v - G), (n,) [m/s^2, rad/s^2].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
            f: Every generalized force but inertia and gravity, (n,) [N, N m].
        """
        return self._call("forward", q, v, f)

    def forward_prescribed(
        self, q: ArrayLike, v: ArrayLike, a_actuated: ArrayLike, f: ArrayLike
    ) -> tuple[Array, Array]:
        """Acceleration and joint forces where the actuated joints follow a motion exactly.

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
            a_actuated: Accelerations of the actuated coordinates, (n_a,) [m/s^2, rad/s^2].
            f: Aerodynamic, damping and other given forces, (n,) [N, N m].

        Returns:
            a, (n,), and u1, (n_a,): the force or torque each actuator must give.
        """
        a, u1 = self._call("forward_prescribed", q, v, a_actuated, f)
        return a, u1

    def kinetic_energy(self, q: ArrayLike, v: ArrayLike) -> Any:
        """Kinetic energy, 1/2 v^T D v, scalar [J].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
        """
        return self._call("kinetic_energy", q, v)

    def potential_energy(self, q: ArrayLike) -> Any:
        """Potential energy of gravity, zero at the world's origin, and of springs, scalar [J].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
        """
        return self._call("potential_energy", q)

    def momentum(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Linear momentum, world axes, (3,) [kg m/s].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
        """
        return self._call("momentum", q, v)

    def angular_momentum(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Angular momentum about the world's origin, world axes, (3,) [kg m^2/s].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
        """
        return self._call("angular_momentum", q, v)

    def center_of_mass(self, q: ArrayLike) -> Array:
        """Center of mass of the robot, world axes, (3,) [m].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
        """
        return self._call("center_of_mass", q)

    def coordinate_rates(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Rates of the coordinates, dq/dt = N(q) v, (n_q,) [m/s, rad/s, 1/s].

        v itself, but for the quaternion of a robot that has one.

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
        """
        return self._call("coordinate_rates", q, v)


class Dynamics(_Methods):
    """Equations of motion of a robot, compiled and cached.

    D(q) a + C(q, v) v + G(q) = u1 + Q, dq/dt = N(q) v. Every method takes one state; `batch` has
    the same methods over a leading axis of N states (eight at a time).
    The symbolic functions are in `expressions`.

    Args:
        robot: The machine. Its parameters are inputs of the compiled functions: a
            robot that differs only in values (`with_parameters`) compiles nothing.
    """

    def __repr__(self) -> str:
        return f"<Dynamics of {self.robot!r}>"

    def __reduce__(self) -> tuple[type[Dynamics], tuple[Robot]]:
        return Dynamics, (self.robot,)

    @checked
    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._parameters = robot.parameters
        self._functions = load_functions(
            robot.structure, lambda: _build(robot), label=f"{robot.name} dynamics"
        )
        super().__init__(self._evaluated)
        self.batch = _Methods(partial(self._evaluated, many=True))
        self._one_coordinate = robot.dof == 1 or len(robot.actuated) == 1

    def _evaluated(self, name: str, *arguments: ArrayLike, many: bool = False) -> Any:
        function = self._functions[name]
        result = (function.batch if many else function)(*arguments, self._parameters)
        self.robot.check_attitudes(arguments[0])
        return self._restored(name, result)

    def _restored(self, name: str, result: Any) -> Any:
        """Axes of length one, which compiled functions drop, put back."""
        if not self._one_coordinate or name.endswith("_energy"):
            return result
        signature, single = self._functions[name].signature, not isinstance(result, tuple)
        outputs = zip(signature.names_out, signature.sizes_out, strict=True)
        lost = [(1 + (key == "mass_matrix")) * (size == (1, 1)) for key, size in outputs]
        parts = zip((result,) if single else result, lost, strict=True)
        whole = tuple(np.asarray(part)[(..., *(None,) * axes)] for part, axes in parts)
        return whole[0] if single else whole

    @property
    def functions(self) -> dict[str, NativeFunction]:
        """The compiled functions by name; each takes the robot's parameters last."""
        return dict(self._functions)

    @property
    def expressions(self) -> dict[str, ca.Function]:
        """The CasADi functions by name; each takes the robot's parameters last."""
        return {name: function.expression for name, function in self._functions.items()}

    def point(self, body: str, offset: ArrayLike = (0.0, 0.0, 0.0)) -> Point:
        """A point fixed to a body.

        Args:
            body: Name of the body.
            offset: From the body's origin, body axes, (3,) [m].

        Raises:
            ParameterError: If there is no such body.
            ShapeError: If `offset` is not (3,).
        """
        return Point(self.robot, *self.robot.place(body, real_array("offset", offset, (3,))))


class Point:
    """Point fixed to a body: its position, velocity and Jacobian.

    Args:
        robot: The machine.
        body: Index of the body.
        offset: From the body's origin, body axes, (3,) [m].

    Raises:
        ShapeError: If `offset` is not (3,).
    """

    def __init__(self, robot: Robot, body: int, offset: Array) -> None:
        if offset.shape != (3,):
            raise ShapeError("offset", (3,), offset.shape)
        self.robot, self.body, self.offset = robot, body, offset.copy()

        def build() -> list[ca.Function]:
            machine, p = robot.symbolic()
            q, v, r = map(ca.SX.sym, "qvr", (robot.coordinate_count, robot.dof, 3))
            at = {"q": q, "offset_parameters": r, "parameters": p}
            position = kinematics.point_position(machine, q, body, r)
            velocity = kinematics.point_velocity(machine, q, v, body, r)
            jacobian = kinematics.point_jacobian(machine, q, body, r)
            return [
                named_function("position", at, {"position": position}),
                named_function("velocity", {"q": q, "v": v, **at}, {"velocity": velocity}),
                named_function("jacobian", at, {"jacobian": jacobian}),
            ]

        name = robot.bodies[body].name
        self._functions: Mapping[str, Callable[..., Array]] = load_functions(
            f"{robot.structure} point {body}", build, label=f"{robot.name} point on {name}"
        )
        self._parameters = robot.parameters

    def __repr__(self) -> str:
        return f"<Point {self.offset} m on {self.robot.bodies[self.body].name} of {self.robot!r}>"

    def __reduce__(self) -> tuple[type[Point], tuple[Robot, int, Array]]:
        return Point, (self.robot, self.body, self.offset)

    def _call(self, name: str, *state: ArrayLike) -> Array:
        found = self._functions[name](*state, self.offset, self._parameters)
        self.robot.check_attitudes(state[0])
        return found

    def position(self, q: ArrayLike) -> Array:
        """Position in world axes, (3,) [m].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
        """
        return self._call("position", q)

    def velocity(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Velocity in world axes, (3,) [m/s].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
        """
        return self._call("velocity", q, v)

    def jacobian(self, q: ArrayLike) -> Array:
        """Jacobian J of the position: its velocity is J v, (3, n) [1, m].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
        """
        return self._call("jacobian", q).reshape(3, self.robot.dof)


def poses_at(robot: Robot, q: ArrayLike) -> tuple[Array, Array]:
    """Origin and axes of every body in the world, at many states.

    A point r fixed to body b is at p_b + R_b r.

    Args:
        robot: The machine.
        q: Generalized coordinates, (N, n_q) [m, rad, 1].

    Returns:
        p, (N, n_bodies, 3) [m], and R, body axes to world axes, (N, n_bodies, 3, 3).

    Raises:
        ShapeError: If `q` is not (N, n_q).
    """
    return Poses(robot)(q)


class Poses:
    """Compiled poses of one robot, for repeated calls.

    Args:
        robot: The machine.
    """

    def __init__(self, robot: Robot) -> None:
        key, label = f"{robot.structure} poses", f"poses of {robot.name}"
        self._function = load_functions(key, lambda: [_poses(robot)], label=label)["poses"]
        self._bodies, self._coordinates = len(robot.bodies), robot.coordinate_count
        self._parameters = robot.parameters

    def __call__(self, q: ArrayLike) -> tuple[Array, Array]:
        """Origins (N, n_bodies, 3) [m] and axes (N, n_bodies, 3, 3) of all bodies in the world.

        Args:
            q: Generalized coordinates, (N, n_q) [m, rad, 1].

        Raises:
            ShapeError: If `q` is not (N, n_q).
        """
        states = np.asarray(q, float)
        if states.ndim != 2 or states.shape[1] != self._coordinates or not len(states):
            raise ShapeError("q", ("N", self._coordinates), states.shape)
        position, rotation = self._function.batch(states, self._parameters)
        shape = (len(states), 3, self._bodies)
        columns = rotation.reshape(len(states), 3, self._bodies, 3)
        return position.reshape(shape).transpose(0, 2, 1), columns.transpose(0, 2, 1, 3)


def _poses(robot: Robot) -> ca.Function:
    machine, parameters = robot.symbolic()
    q = ca.SX.sym("q", robot.coordinate_count)
    poses = kinematics.body_poses(machine, q)
    position = ca.horzcat(*[pose.position for pose in poses])
    rotation = ca.horzcat(*[pose.rotation for pose in poses])
    outputs = {"position": position, "rotation": rotation}
    return named_function("poses", {"q": q, "parameters": parameters}, outputs)
