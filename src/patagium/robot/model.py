"""The machine as frozen numbers: bodies, joints, strips of wing.

A `Robot` is a tree of rigid bodies. Its numbers are floats, or CasADi symbols
after `symbolic()`: the expression builders of the layers above accept either.
Neglected: flexible bodies, closed chains (a gait may come from one), ground.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from patagium.errors import ParameterError
from patagium.robot.amendment import amended_source

Number: TypeAlias = "float | ca.SX"
Vector: TypeAlias = tuple[Any, Any, Any]
Axis: TypeAlias = tuple[float, float, float]

FLOATING_COORDINATES = ("x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class Joint:
    """One coordinate between a body and its parent.

    Attributes:
        name: Name of the coordinate.
        kind: Turns about its axis, or slides along it.
        axis: Unit axis in the frame left by the joints before it (structural).
        dof: Index of its coordinate in q.
    """

    name: str
    kind: Literal["revolute", "prismatic"]
    axis: Axis
    dof: int


@dataclass(frozen=True)
class Body:
    """One rigid body and what joins it to its parent.

    At zero coordinates the body's axes are its parent's, turned by `orientation`,
    with the origin at `position`. A floating body hangs on the world by
    x, y, z, roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll).

    Attributes:
        name: Name.
        parent: Index of the parent, -1 for the world; parents come first.
        position: Origin of the joints in the parent's axes, (3,) [m].
        orientation: Rotation of the joint axes to the parent's, 3 x 3 (structural).
        joints: In order from the parent; none: fixed. Empty when floating.
        floating_dofs: Indices of x, y, z, roll, pitch, yaw in q, or None.
        mass: Mass [kg].
        center_of_mass: In body axes from the body's origin, (3,) [m].
        inertia: xx, yy, zz, xy, xz, yz about the centre of mass, body axes [kg m^2].
    """

    name: str
    parent: int
    position: Vector
    orientation: tuple[Axis, Axis, Axis]
    joints: tuple[Joint, ...]
    floating_dofs: tuple[int, ...] | None
    mass: Any
    center_of_mass: Vector
    inertia: tuple[Any, Any, Any, Any, Any, Any]


@dataclass(frozen=True)
class Strip:
    """A blade element: a spanwise slice of a wing carried by one body.

    Attributes:
        name: `wing[index]`, from the root outwards.
        wing: Name of the wing.
        body: Index of the body that carries it.
        mirrored: True on the wing made by mirroring; it shares its coefficients.
        quarter_chord: Point behind the leading edge by a quarter chord, mid-strip,
            in body axes, (3,) [m].
        forward: Unit vector along the chord to the leading edge, body axes (structural).
        normal: Unit vector out of the upper surface, body axes (structural).
        chord: Chord [m].
        width: Extent along the span [m].
    """

    name: str
    wing: str
    body: int
    mirrored: bool
    quarter_chord: Vector
    forward: Axis
    normal: Axis
    chord: Any
    width: Any


@dataclass(frozen=True)
class Robot:
    """A morphing-wing robot: a tree of bodies, their wings, damping and limits.

    Attributes:
        name: Name.
        bodies: Parents before children.
        strips: Blade elements of all wings.
        dof_names: Names of the coordinates, in the order of q.
        dof_units: "m" or "rad" for each.
        actuated: Indices of the coordinates that follow a gait.
        damping: Passive damping of each coordinate, force = -damping v [N s/m, N m s].
        lower: Lower limit of each coordinate, -inf where none.
        upper: Upper limit of each coordinate, inf where none.
        gravity: Acceleration of free fall [m/s^2], along -z.
        source: Text of the robot file it came from; travels with every flight.
        speed_limit: Largest speed of each coordinate [m/s, rad/s]; empty: none has any.
        acceleration_limit: Largest acceleration of each [m/s^2, rad/s^2]; likewise.
        effort_limit: Largest force or torque of its actuator [N, N m]; likewise.
    """

    name: str
    bodies: tuple[Body, ...]
    strips: tuple[Strip, ...]
    dof_names: tuple[str, ...]
    dof_units: tuple[str, ...]
    actuated: tuple[int, ...]
    damping: tuple[Any, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    gravity: Any
    source: str = field(default="", repr=False, compare=False)
    # limits of an actuator plan its motion; no equation knows them
    speed_limit: tuple[float, ...] = field(default=(), repr=False)
    acceleration_limit: tuple[float, ...] = field(default=(), repr=False)
    effort_limit: tuple[float, ...] = field(default=(), repr=False)

    @property
    def dof(self) -> int:
        """Number of coordinates n."""
        return len(self.dof_names)

    @property
    def passive(self) -> tuple[int, ...]:
        """Indices of the coordinates that no gait prescribes."""
        return tuple(i for i in range(self.dof) if i not in self.actuated)

    @property
    def floating(self) -> bool:
        """Whether the root body is free of the world."""
        return any(body.floating_dofs is not None for body in self.bodies)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the run-time parameters, in the order of `parameters`."""
        return tuple(name for name, value in _leaves(self) if _is_parameter(value))

    @property
    def parameters(self) -> NDArray[np.float64]:
        """Values of the run-time parameters, (n_p,) [SI].

        A number that is exactly zero in the robot file is structure, not a
        parameter: the equations are generated without it.
        """
        return np.array([value for _, value in _leaves(self) if _is_parameter(value)], float)

    @property
    def structure(self) -> str:
        """Everything the generated equations depend on but the parameters' values."""
        same = self._with(dict.fromkeys(self.parameter_names, 1.0))
        return repr(replace(same, name="", lower=(), upper=()))

    def symbolic(self) -> tuple[Robot, ca.SX]:
        """The same robot with a symbol for each run-time parameter, and the symbols (n_p,)."""
        names = self.parameter_names
        symbols = ca.SX.sym("p", len(names))
        return self._with(dict(zip(names, ca.vertsplit(symbols), strict=True))), symbols

    def with_parameters(self, values: Mapping[str, float]) -> Robot:
        """A copy with some run-time parameters changed, for calibration and damage.

        Its source says what was changed, so that a flight carries it too.

        Raises:
            ParameterError: If a name is not in `parameter_names`, or a value cannot be.
        """
        known = set(self.parameter_names)
        for name, value in values.items():
            if name not in known:
                raise ParameterError(name, f"a parameter of robot {self.name!r}", name)
            if not np.isfinite(value):
                raise ParameterError(name, "a finite number", value)
            if value < 0 and name.rpartition(".")[2] in _NEVER_NEGATIVE:
                raise ParameterError(name, "a quantity that is not negative", value)
        source = amended_source(self.source, values) if self.source else ""
        return replace(self._with(values), source=source)

    def coordinates(self, **values: float) -> NDArray[np.float64]:
        """A vector over the coordinates, zero but for those named, (n,).

        Raises:
            ParameterError: If a name is not in `dof_names`.
        """
        vector = np.zeros(self.dof)
        for name, value in values.items():
            vector[self.index(name)] = value
        return vector

    def index(self, dof_name: str) -> int:
        """Index of a coordinate by name.

        Raises:
            ParameterError: If there is no such coordinate.
        """
        if dof_name not in self.dof_names:
            raise ParameterError("coordinate", f"one of {', '.join(self.dof_names)}", dof_name)
        return self.dof_names.index(dof_name)

    def body_index(self, name: str) -> int:
        """Index of a body by name.

        Raises:
            ParameterError: If there is no such body.
        """
        names = [body.name for body in self.bodies]
        if name not in names:
            raise ParameterError("body", f"one of {', '.join(names)}", name)
        return names.index(name)

    def mounted_on(
        self,
        arm: Robot,
        at: str,
        *,
        position: Axis = (0.0, 0.0, 0.0),
        orientation: Axis = (0.0, 0.0, 0.0),
        prefix: str = "arm_",
    ) -> Robot:
        """This robot fixed to a body of another: one tree, one dynamics.

        Its floating base becomes a body without coordinates of its own (their damping
        goes with them); joints, wings, limits and damping stay. Gravity is this robot's.

        Args:
            arm: What carries it; its coordinates come first.
            at: Body of the arm that holds it.
            position: Where on that body, in its axes, (3,) [m].
            orientation: Roll, pitch, yaw of this robot's axes in that body's, (3,) [rad].
            prefix: Put before the names of the arm's bodies, joints and wings.

        Raises:
            ParameterError: If the arm has no such body, or a name would be there twice.
        """
        from patagium.robot.composition import mounted  # it builds on this module

        return mounted(self, arm, at, position, orientation, prefix)

    def _with(self, values: Mapping[str, Any]) -> Robot:
        def vector(prefix: str, old: tuple[Any, ...], labels: tuple[str, ...]) -> Any:
            return tuple(values.get(f"{prefix}.{k}", x) for k, x in zip(labels, old, strict=True))

        bodies = tuple(
            replace(
                b,
                position=vector(f"{b.name}.position", b.position, _XYZ),
                mass=values.get(f"{b.name}.mass", b.mass),
                center_of_mass=vector(f"{b.name}.center_of_mass", b.center_of_mass, _XYZ),
                inertia=vector(f"{b.name}.inertia", b.inertia, _INERTIA),
            )
            for b in self.bodies
        )
        strips = tuple(
            replace(
                s,
                quarter_chord=vector(f"{s.name}.quarter_chord", s.quarter_chord, _XYZ),
                chord=values.get(f"{s.name}.chord", s.chord),
                width=values.get(f"{s.name}.width", s.width),
            )
            for s in self.strips
        )
        damping = tuple(
            values.get(f"{name}.damping", d)
            for name, d in zip(self.dof_names, self.damping, strict=True)
        )
        return replace(
            self,
            bodies=bodies,
            strips=strips,
            damping=damping,
            gravity=values.get("gravity", self.gravity),
        )


_XYZ = ("x", "y", "z")
_NEVER_NEGATIVE = ("gravity", "mass", "damping", "chord", "width")
_INERTIA = ("xx", "yy", "zz", "xy", "xz", "yz")


def _leaves(robot: Robot) -> Iterator[tuple[str, Any]]:
    yield "gravity", robot.gravity
    for name, value in zip(robot.dof_names, robot.damping, strict=True):
        yield f"{name}.damping", value
    for body in robot.bodies:
        for label, value in zip(_XYZ, body.position, strict=True):
            yield f"{body.name}.position.{label}", value
        yield f"{body.name}.mass", body.mass
        for label, value in zip(_XYZ, body.center_of_mass, strict=True):
            yield f"{body.name}.center_of_mass.{label}", value
        for label, value in zip(_INERTIA, body.inertia, strict=True):
            yield f"{body.name}.inertia.{label}", value
    for strip in robot.strips:
        for label, value in zip(_XYZ, strip.quarter_chord, strict=True):
            yield f"{strip.name}.quarter_chord.{label}", value
        yield f"{strip.name}.chord", strip.chord
        yield f"{strip.name}.width", strip.width


def _is_parameter(value: Any) -> bool:
    return bool(value != 0.0)
