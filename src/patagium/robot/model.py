"""The machine as frozen numbers: bodies, joints, strips of wing.

A `Robot` is a tree of rigid bodies. Its numbers are floats, or CasADi symbols
after `symbolic()`: the expression builders of the layers above accept either.
Its state is (q, v). They are as long as each other, and v = dq/dt, unless a body's
attitude is a quaternion: four coordinates then go with three velocities. Its qx, qy, qz stand
where v has roll, pitch, yaw, and qw before the first of them.
Neglected: flexible bodies, closed chains (a gait may come from one), ground.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from patagium.arguments import checked
from patagium.arrays import Array, real_array
from patagium.errors import ParameterError, check_names
from patagium.robot.amendment import amended_source, composed_source, source_with_attitude
from patagium.robot.attitude import quaternion_from_angles, rotation_from_angles


def repeated(names: Sequence[str]) -> list[str]:
    """Names that stand more than once."""
    return [name for i, name in enumerate(names) if name in names[:i]]


Vector: TypeAlias = tuple[Any, Any, Any]
Axis: TypeAlias = tuple[float, float, float]
Attitude: TypeAlias = Literal["euler", "quaternion"]

_XYZ = ("x", "y", "z")
INERTIA = ("xx", "yy", "zz", "xy", "xz", "yz")
"""Entries of an inertia tensor as a robot and its file name them."""
_BODY_LEAVES = {"position": _XYZ, "mass": (), "center_of_mass": _XYZ, "inertia": INERTIA}
_OF_PIECE = ("mass", "center_of_mass", "inertia")
_STRIP_LEAVES: dict[str, tuple[str, ...]] = {"quarter_chord": _XYZ, "chord": (), "width": ()}
_JOINT_LEAVES = ("damping", "stiffness", "rest")
_OF_JOINTS = ("dof_units", "damping", "lower", "upper")
CAPACITIES = ("speed_limit", "acceleration_limit", "effort_limit", "power_limit")
"""What a joint's motor can do at most, by its name in a robot and in its file."""


def capacity_units(unit: str) -> tuple[str, ...]:
    """SI units of `CAPACITIES` of a joint whose coordinate is in "m" or "rad"."""
    return f"{unit}/s", f"{unit}/s^2", "N" if unit == "m" else "N m", "W"


COMMANDS = ("amplitude", "offset", "phase")
"""What is commanded of a joint of a gait; `frequency` is commanded of all together."""
_EXCESS = 0.1
"""Share of a moment of inertia that an estimate for a thin wing lacks in the other two."""
_NEVER_NEGATIVE = ("gravity", "mass", "damping", "stiffness", "chord", "width")
FLOATING_COORDINATES = ("x", "y", "z", "roll", "pitch", "yaw")
PHYSICAL = "principal moments of a real body (none below 0 or above the sum of the others)"


def inertia_tensor(moments: Sequence[Any]) -> Array:
    """Tensor of the entries `INERTIA`, (3, 3) [kg m^2]."""
    xx, yy, zz, xy, xz, yz = moments
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], float)


def moments_of(tensor: Array) -> tuple[float, float, float, float, float, float]:
    """Entries `INERTIA` of a tensor, (3, 3) [kg m^2]."""
    xx, xy, xz, yy, yz, zz = (float(k) + 0.0 for k in tensor[np.triu_indices(3)])
    return xx, yy, zz, xy, xz, yz


def is_physical(tensor: Array, excess: float = 1e-6) -> bool:
    """Whether some distribution of mass has this inertia.

    The principal moments satisfy I1, I2, I3 >= 0 and I1 + I2 >= I3 (triangle inequality).

    Args:
        tensor: Inertia about the centre of mass, (3, 3) [kg m^2].
        excess: Share of I3 that the other two may lack: files carry six or seven digits.
    """
    if not np.isfinite(tensor).all():
        return False
    moments = np.linalg.eigvalsh(tensor)
    large = abs(moments).max()
    return bool(moments[0] >= -1e-6 * large and moments[:2].sum() >= moments[2] - excess * large)


@dataclass(frozen=True)
class Joint:
    """One degree of freedom between a body and its parent.

    Attributes:
        name: Name of the coordinate.
        kind: Turns about its axis, or slides along it.
        axis: Unit axis in the frame left by the joints before it (structural).
        dof: Index of its rate in v; `Robot.coordinate_indices` has that of its coordinate in q.
        coupling: Stiffness and damping between it and the joint `inner`, over its own [-].
        inner: Name of the joint that it is coupled to, or "".
    """

    name: str
    kind: Literal["revolute", "prismatic"]
    axis: Axis
    dof: int
    coupling: float = 0.0
    inner: str = ""


@dataclass(frozen=True)
class Body:
    """One rigid body and what joins it to its parent.

    At zero coordinates the body's axes are its parent's, turned by `orientation`,
    with the origin at `position`. A floating body hangs on the world by
    x, y, z, roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll). With a quaternion for its
    attitude its coordinates are x, y, z, qw, qx, qy, qz (Hamilton, scalar first, body axes
    to world axes), its velocities those of the origin in world axes and the angular
    velocity in body axes.

    Attributes:
        name: Name.
        parent: Index of the parent, -1 for the world; parents come first.
        position: Origin of the joints in the parent's axes, (3,) [m].
        orientation: Rotation of the joint axes to the parent's, 3 x 3 (structural).
        joints: In order from the parent; none: fixed. Empty when floating.
        floating_dofs: Indices of x, y, z, roll, pitch, yaw in v, or None.
        mass: Mass [kg].
        center_of_mass: In body axes from the body's origin, (3,) [m].
        inertia: xx, yy, zz, xy, xz, yz about the centre of mass, body axes [kg m^2].
        attitude: Coordinates of a floating body's attitude.
        piece: Whether it is a piece of a flexible body and goes on from its parent, another one.
        mounted: Whether it is the root of a robot that an arm carries.
        flexible: Whether it is the piece at the root of a flexible body, and has its name.
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
    attitude: Attitude = "euler"
    piece: bool = False
    mounted: bool = False
    flexible: bool = field(default=False, repr=False)

    @property
    def own_name(self) -> str:
        """Name that its mass, center of mass and inertia have as parameters."""
        return f"{self.name}_0" if self.flexible else self.name

    @property
    def by_quaternion(self) -> bool:
        """Whether it floats, its attitude a quaternion."""
        return self.floating_dofs is not None and self.attitude == "quaternion"

    @property
    def tensor(self) -> Array:
        """Inertia about the centre of mass in numbers, (3, 3) [kg m^2], body axes."""
        return inertia_tensor(self.inertia)


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
class Cruise:
    """Flight of a robot where nothing else is asked for.

    Attributes:
        frequency: Wingbeats a second [Hz]; None where the joints are held.
        amplitude: Amplitude of joints by name [rad, m].
        phase: Lead of joints by name [rad].
        offset: Mean of joints by name [rad, m].
        speed: Speed forward at the start, or of the wind ahead of a robot that is held [m/s].
        pitch: Pitch at the start, positive nose down [rad].
        duration: Duration of the flight [s].
    """

    frequency: float | None
    amplitude: Mapping[str, float]
    phase: Mapping[str, float]
    offset: Mapping[str, float]
    speed: float
    pitch: float
    duration: float


@dataclass(frozen=True)
class Actuator:
    """Range, rate limit and response time of a command, and its weight in a controller's cost.

    Attributes:
        unit: SI unit of the command [Hz, rad or m].
        range: Least and greatest value [unit].
        rate_limit: Fastest change [unit/s].
        response_time: Time within which 99 % of a small change is there [s]; None for the default
            of `SteeredGait`.
        cost: Weight of the square of the command's departure, over half its range, in the cost
            of a controller [1].
    """

    unit: str
    range: tuple[float, float]
    rate_limit: float
    response_time: float | None
    cost: float


PAGES: list[Callable[[Robot], str]] = []
"""Page of a robot in a notebook, which a module above adds: it knows how a robot is drawn."""


@dataclass(frozen=True, repr=False)
class Robot:
    """A morphing-wing robot: a tree of bodies, their wings, damping and limits.

    Attributes:
        name: Name.
        bodies: Parents before children.
        strips: Blade elements of all wings.
        dof_names: Names of the degrees of freedom, in the order of v. Where the attitude is a
            quaternion, roll, pitch and yaw are turns about the body's own axes.
        dof_units: "m" or "rad" for each.
        actuated: Indices of those that follow a gait.
        damping: Passive damping of each, force = -damping v [N s/m, N m s].
        stiffness: Stiffness of the spring of each joint, force = -stiffness (q - rest) [N/m, N m];
            empty: none has any.
        rest: Coordinate of each at which its spring has no force [m, rad]; likewise.
        lower: Lower limit of each, -inf where none.
        upper: Upper limit of each, inf where none.
        gravity: Acceleration of free fall [m/s^2], along -z.
        source: Text of the robot file it came from; travels with every flight. `with_parameters`
            changes it as well, `dataclasses.replace` does not.
        speed_limit: Largest speed of each coordinate [m/s, rad/s]; empty: none has any.
        acceleration_limit: Largest acceleration of each [m/s^2, rad/s^2]; likewise.
        effort_limit: Largest force or torque of its actuator [N, N m]; likewise.
        power_limit: Largest mechanical power of its actuator [W]; likewise.
        cruise: How it flies where nothing else is asked for, or None.
        joined_wings: Wings that one lifting line runs through, as pairs of names.
        mirrored_wings: Wings and their mirror images, as pairs of names.
        mirrored_joints: Joints of the left and their mirror images on the right, likewise.
        actuators: Limits of the commands of a gait, by their names in `SteeredGait`.
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
    power_limit: tuple[float, ...] = field(default=(), repr=False)
    cruise: Cruise | None = field(default=None, repr=False, compare=False)
    joined_wings: tuple[tuple[str, str], ...] = ()
    mirrored_wings: tuple[tuple[str, str], ...] = ()
    mirrored_joints: tuple[tuple[str, str], ...] = field(default=(), repr=False)
    actuators: Mapping[str, Actuator] = field(default_factory=dict, repr=False, compare=False)
    stiffness: tuple[Any, ...] = ()
    rest: tuple[Any, ...] = ()

    @property
    def dof(self) -> int:
        """Number of degrees of freedom n: velocities, accelerations, forces."""
        return len(self.dof_names)

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the coordinates, in the order of q: those of v, but for a quaternion's."""
        names = [[name] for name in self.dof_names]
        for dofs in self._attitudes:
            stem = self.dof_names[dofs[0]].removesuffix("roll")
            for dof, letter in zip(dofs, "xyz", strict=True):
                names[dof] = [f"{stem}q{letter}"]
            names[min(dofs)].insert(0, f"{stem}qw")
        return tuple(name for own in names for name in own)

    @property
    def coordinate_count(self) -> int:
        """Number of coordinates, the length of q: n, and one more with a quaternion."""
        return self.dof + len(self._attitudes)

    @property
    def state_size(self) -> int:
        """Length of the state [q, v]: 2 n, and one more with a quaternion."""
        return self.coordinate_count + self.dof

    @property
    def coordinate_units(self) -> tuple[str, ...]:
        """Unit of each coordinate: "m", "rad", or "1" in a quaternion."""
        units = dict(zip(self.dof_names, self.dof_units, strict=True))
        return tuple(units.get(name, "1") for name in self.coordinate_names)

    @property
    def mass(self) -> Any:
        """Mass of all bodies [kg]: a number, or an expression where theirs are symbols."""
        return sum(body.mass for body in self.bodies)

    @property
    def scale_gravity(self) -> float:
        """Gravity that scales forces, the standard one where it is zero, as in water [m/s^2]."""
        return float(self.gravity) or 9.80665

    @property
    def force_units(self) -> tuple[str, ...]:
        """Unit of each generalized force: "N", or "N m" of a turn."""
        return tuple("N" if unit == "m" else "N m" for unit in self.dof_units)

    @property
    def coordinate_indices(self) -> tuple[int, ...]:
        """For each entry of v the place in q of what it moves; of roll that of qx, and so on."""
        firsts = [min(dofs) for dofs in self._attitudes]
        return tuple(i + sum(first <= i for first in firsts) for i in range(self.dof))

    def floating_coordinates(self, body: Body) -> tuple[int, ...]:
        """Places in q of x, y, z and then roll, pitch, yaw or qw, qx, qy, qz; empty if held.

        Args:
            body: One of the robot's bodies.
        """
        places = self.coordinate_indices
        found = [places[dof] for dof in body.floating_dofs or ()]
        if body.by_quaternion:
            found.insert(3, min(found[3:]) - 1)
        return tuple(found)

    @cached_property
    def _quaternions(self) -> list[int]:
        return [self.floating_coordinates(body)[3] for body in self.bodies if body.by_quaternion]

    def check_attitudes(self, q: ArrayLike) -> None:
        """Refuse quaternions of zeros, which say nothing and make every number NaN.

        Args:
            q: Generalized coordinates, (..., n_q) [m, rad, 1].

        Raises:
            ParameterError: If there is one.
        """
        for k in self._quaternions:
            whole = np.asarray(q)
            if not whole[..., k].all() and not whole[..., k : k + 4].any(axis=-1).all():
                expected = "a quaternion of length 1, such as robot.coordinates() has"
                raise ParameterError("q", expected, "qw, qx, qy, qz = 0")

    @property
    def couplings(self) -> tuple[tuple[int, int, float], ...]:
        """Coupled joints: index of the inner and of the outer one, and the coupling [-]."""
        return tuple(
            (self.dof_names.index(outer.inner), outer.dof, outer.coupling)
            for body in self.bodies
            for outer in body.joints
            if outer.coupling
        )

    @property
    def wing_names(self) -> tuple[str, ...]:
        """Names of its wings, in the order of their strips."""
        return tuple(dict.fromkeys(strip.wing for strip in self.strips))

    @property
    def actuated_names(self) -> tuple[str, ...]:
        """Names of the actuated joints."""
        return tuple(self.dof_names[i] for i in self.actuated)

    @property
    def passive(self) -> tuple[int, ...]:
        """Indices of the degrees of freedom that no gait prescribes."""
        return tuple(i for i in range(self.dof) if i not in self.actuated)

    @property
    def resting(self) -> dict[str, float]:
        """Rest of each passive joint's spring by name, where it is not zero [rad, m]."""
        rest = self.rest or (0.0,) * self.dof
        return {self.dof_names[i]: rest[i] for i in self.passive if rest[i]}

    @property
    def floating(self) -> bool:
        """Whether the root body is free of the world."""
        return bool(self.floating_dofs)

    @property
    def floating_dofs(self) -> tuple[int, ...]:
        """Indices in v of x, y, z, roll, pitch and yaw of each floating body."""
        return tuple(i for body in self.floating_bodies.values() for i in body.floating_dofs or ())

    @property
    def floating_bodies(self) -> dict[int, Body]:
        """Bodies with a floating base, by their indices in `bodies`."""
        return {k: one for k, one in enumerate(self.bodies) if one.floating_dofs is not None}

    @property
    def flying(self) -> Robot:
        """The robot without the mass of bodies attached to the ground, where another one floats."""
        aloft: list[bool] = []
        for k in self.bodies:
            aloft.append(k.floating_dofs is not None or (k.parent >= 0 and aloft[k.parent]))
        if all(aloft) or not any(aloft):
            return self
        parts = zip(self.bodies, aloft, strict=True)
        return replace(self, bodies=tuple(k if up else replace(k, mass=0.0) for k, up in parts))

    @property
    def attitude(self) -> Attitude | None:
        """Coordinates of the floating body's attitude; None where no body floats."""
        return next((body.attitude for body in self.floating_bodies.values()), None)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the run-time parameters, in the order of `parameters`."""
        return tuple(self._known)

    @property
    def parameters(self) -> Array:
        """Values of the run-time parameters, (n_p,) [SI].

        A number that is exactly zero in the robot file is structure, not a
        parameter: the equations are generated without it.
        """
        return np.array([*self._known.values()], float)

    @cached_property
    def _known(self) -> dict[str, Any]:
        return {name: value for name, value in _leaves(self) if value != 0.0}

    @cached_property
    def structure(self) -> str:
        """Text of all that the generated equations depend on, values of the parameters aside."""
        same = _with_values(self, dict.fromkeys(self.parameter_names, 1.0))
        plain = replace(same, name="", lower=(), upper=())
        parts = [f"{one.name}={getattr(plain, one.name)!r}" for one in fields(plain) if one.repr]
        return f"Robot({', '.join(parts)})"

    def __repr__(self) -> str:
        wings, strips = len(self.wing_names), len(self.strips)
        counts = f"{len(self.bodies)} bodies, {wings} wings, {strips} strips"
        return f"<Robot {self.name}: {self.dof} degrees of freedom, {counts}>"

    def _repr_html_(self) -> str | None:
        return PAGES[0](self) if PAGES else None

    def symbolic(self) -> tuple[Robot, ca.SX]:
        """Copy of the robot with a symbol for each run-time parameter, and the symbols (n_p,)."""
        names = self.parameter_names
        symbols = ca.SX.sym("p", len(names))
        return _with_values(self, dict(zip(names, ca.vertsplit(symbols), strict=True))), symbols

    @checked
    def with_parameters(self, values: Mapping[str, float]) -> Robot:
        """A copy with some run-time parameters changed, for calibration and damage.

        Its source says what was changed. A number that was zero makes another `structure`. A
        moment of inertia may exceed the sum of the other two by a tenth, as estimates do.

        Raises:
            ParameterError: If a name is no number of the robot, or a value cannot be.
        """
        known = {name for name, _ in _leaves(self)}
        changed = _with_values(self, values)
        for name, value in values.items():
            if name not in known:
                told = self.refusal(name)
                expected = told or f"a parameter of robot {self.name!r}"
                raise ParameterError(name, expected, name, () if told else known)
            if value < 0 and name.rpartition(".")[2] in _NEVER_NEGATIVE:
                raise ParameterError(name, "a quantity that is not negative", value)
        for body in changed.bodies:
            if not values.get(name := f"{body.own_name}.mass", 1.0) and any(body.inertia):
                raise ParameterError(name, "a mass above 0 of a body with inertia", body.mass)
            own = [name for name in values if name.startswith(f"{body.own_name}.inertia.")]
            if own and not is_physical(body.tensor, _EXCESS):
                found = [float(f"{x:.4g}") for x in body.inertia]
                raise ParameterError(own[0], PHYSICAL, dict(zip(INERTIA, found, strict=True)))
        source = amended_source(self.source, values) if self.source else ""
        return replace(changed, source=source)

    def refusal(self, name: str) -> str:
        """Words on what to write in place of a name that is no run-time parameter; or ""."""
        body = name.partition(".")[0]
        if any(one.flexible and one.name == body for one in self.bodies):
            told = f"a number of a piece, {body}_0, {body}_1 and so on, as {body} is flexible"
            return f"{told} (that of the whole body is changed under `bodies` in the robot's file)"
        if name in dict(_leaves(self)):
            told = "equations are made without zeros: write a first guess there"
            return f"a number that is not 0 in the robot's file ({told})"
        return ""

    @checked
    def with_attitude(self, attitude: Attitude) -> Robot:
        """Copy of the robot with its floating body's attitude in other coordinates.

        A quaternion has no singularity: loops, rolls and vertical climbs go through. Its
        source says so too.

        Args:
            attitude: "euler" or "quaternion".

        Raises:
            ParameterError: If it is neither, no body floats, or a joint has a quaternion's name.
        """
        if not self.floating:
            raise ParameterError("attitude", f"a robot that floats, not {self.name!r}", attitude)
        bodies = tuple(
            body if body.floating_dofs is None else replace(body, attitude=attitude)
            for body in self.bodies
        )
        source = source_with_attitude(self.source, attitude) if self.source else ""
        other = replace(self, bodies=bodies, source=source)
        if taken := repeated(other.coordinate_names):
            raise ParameterError("attitude", "coordinates named once", f"{taken[0]} again")
        return other

    @checked
    def coordinates(self, **values: float) -> Array:
        """Generalized coordinates, zero but for those named, (n_q,).

        Attitudes are given as roll, pitch and yaw, whatever the coordinates are.

        Raises:
            ParameterError: If a name is not in `dof_names`.
        """
        given = self.velocities(**values)
        places = self.coordinate_indices
        q = np.zeros(self.coordinate_count)
        q[list(places)] = given
        for body in self.bodies:
            if body.by_quaternion:
                angles = given[list(body.floating_dofs or ())[3:]]
                q[list(self.floating_coordinates(body)[3:])] = quaternion_from_angles(angles)
        return q

    @checked
    def velocities(self, **values: float) -> Array:
        """Generalized velocities, zero but for those named, (n,).

        Raises:
            ParameterError: If a name is not in `dof_names`.
        """
        vector = np.zeros(self.dof)
        for name, value in values.items():
            vector[self.index(name)] = value
        return vector

    @cached_property
    def _images(self) -> dict[str, tuple[int, str]]:
        """Side of each joint that has a mirror image, and that image."""
        both = [(side, pair[::side]) for pair in self.mirrored_joints for side in (1, -1)]
        return {name: (side, image) for side, (name, image) in both}

    def side(self, name: str) -> int:
        """Side of a degree of freedom: 1 left, -1 right, 0 without a mirror image.

        Raises:
            ParameterError: If there is none of that name.
        """
        self.index(name)
        return self._images.get(name, (0, name))[0]

    def twin(self, name: str) -> str:
        """Degree of freedom of the other side, `right_plunge` for `left_plunge`, or the same.

        Raises:
            ParameterError: If there is none of that name.
        """
        self.index(name)
        return self._images.get(name, (0, name))[1]

    @cached_property
    def joint_groups(self) -> dict[str, tuple[str, ...]]:
        """Actuated joints by the name that addresses them: `plunge` those of both sides.

        It is the words that both names have but left and right, or both names where it is taken.
        """
        joints = self.actuated_names
        groups = [tuple(k for k in joints if k in (name, self.twin(name))) for name in joints]
        short = {}
        for group in groups:
            common = {*group[0].split("_")}.intersection(group[-1].split("_")) - {"left", "right"}
            short[group] = "_".join(k for k in group[0].split("_") if k in common)
        names = [*short.values()]
        return {k if k and names.count(k) == 1 else "_".join(g): g for g, k in short.items()}

    @checked
    def joints_named(self, name: str) -> tuple[str, ...]:
        """Actuated joints that a name addresses: itself, or those of both sides."""
        alone = [k for joints in self.joint_groups.values() for k in joints if k == name]
        return self.joint_groups.get(name, tuple(alone))

    def command(self, name: str) -> tuple[str, tuple[str, ...]]:
        """Kind of a command of a gait, such as `plunge_offset`, and the joints that answer it.

        Args:
            name: Name of the command.

        Returns:
            `frequency` or one of `COMMANDS`, and actuated joints, none where nobody answers.
        """
        joint, _, kind = str(name).rpartition("_")
        if name in ("frequency", "amplitude"):
            return name, self.actuated_names
        return kind, self.joints_named(joint) if kind in COMMANDS else ()

    def paired(self, name: str) -> str:
        """Command of both sides: `plunge_offset` for `left_plunge_offset`.

        Raises:
            ParameterError: If no joint answers it.
        """
        kind, joints = self.command(name)
        if not joints:
            raise ParameterError("command", "one that a joint answers", name)
        groups = (group for group, own in self.joint_groups.items() if {*joints} <= {*own})
        return name if kind == name else f"{next(groups)}_{kind}"

    def index(self, dof_name: str) -> int:
        """Index of a degree of freedom by name.

        Raises:
            ParameterError: If there is none of that name.
        """
        check_names("coordinate", [dof_name], self.dof_names, near=True)
        return self.dof_names.index(dof_name)

    def body_index(self, name: str) -> int:
        """Index of a body by name.

        Raises:
            ParameterError: If there is no such body.
        """
        names = [body.name for body in self.bodies]
        check_names("body", [name], names, near=True)
        return names.index(name)

    def place(self, body: str, point: ArrayLike) -> tuple[int, Array]:
        """Index of the body that holds a point, and the point in its axes, (3,) [m].

        Where the body is flexible it is the piece at the point.

        Args:
            body: Name of a body.
            point: Point in the axes of that body, nothing bent, (3,) [m].

        Raises:
            ParameterError: If there is no such body, or the point is not three finite numbers.
        """
        index, (x, y, z) = self.body_index(body), finite_triple("point", point)
        for k, piece in enumerate(self.bodies):  # from the root outwards
            beyond = y - piece.position[1]
            if piece.piece and piece.parent == index and beyond * piece.center_of_mass[1] > 0:
                index, y = k, beyond
        return index, np.array([x, y, z])

    @checked
    def mounted_on(
        self,
        arm: Robot,
        at: str,
        *,
        position: Axis = (0.0, 0.0, 0.0),
        orientation: Axis = (0.0, 0.0, 0.0),
        prefix: str = "arm_",
    ) -> Robot:
        """Robot that is fixed to a body of another: one tree, one dynamics.

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
        return _mounted(self, arm, at, position, orientation, prefix)

    @property
    def _attitudes(self) -> list[tuple[int, ...]]:
        """Roll, pitch, yaw in v of every body whose attitude is a quaternion."""
        return [(body.floating_dofs or ())[3:] for body in self.bodies if body.by_quaternion]


def _with_values(robot: Robot, values: Mapping[str, Any]) -> Robot:
    """Copy of a robot with some parameters set to numbers or symbols; unknown names are ignored."""

    def changed(part: Any, labels: Mapping[str, tuple[str, ...]]) -> Any:
        fields: dict[str, Any] = {}
        for field_name, leaves in _leaves_of(part, labels):
            new = tuple(values.get(name, old) for name, old in leaves)
            fields[field_name] = new if labels[field_name] else new[0]
        return replace(part, **fields)

    joints: dict[str, Any] = {
        field_name: tuple(
            values.get(f"{name}.{field_name}", old)
            for name, old in zip(robot.dof_names, getattr(robot, field_name), strict=False)
        )
        for field_name in _JOINT_LEAVES
    }
    return replace(
        robot,
        bodies=tuple(changed(body, _BODY_LEAVES) for body in robot.bodies),
        strips=tuple(changed(strip, _STRIP_LEAVES) for strip in robot.strips),
        **joints,
        gravity=values.get("gravity", robot.gravity),
    )


def _leaves(robot: Robot) -> Iterator[tuple[str, Any]]:
    """Name and value of every number that may be a parameter [SI]."""
    yield "gravity", robot.gravity
    for field_name in _JOINT_LEAVES:
        for name, value in zip(robot.dof_names, getattr(robot, field_name), strict=False):
            yield f"{name}.{field_name}", value
    for parts, labels in ((robot.bodies, _BODY_LEAVES), (robot.strips, _STRIP_LEAVES)):
        for part in parts:
            for _, leaves in _leaves_of(part, labels):
                yield from leaves


def _leaves_of(
    part: Any, labels: Mapping[str, tuple[str, ...]]
) -> Iterator[tuple[str, list[tuple[str, Any]]]]:
    """Fields of a body or strip, each with name and value of its numbers: of its parts, or one."""
    for field_name, parts in labels.items():
        owner = part.name if field_name not in _OF_PIECE else part.own_name
        prefix, value = f"{owner}.{field_name}", getattr(part, field_name)
        names = [f"{prefix}.{one}" for one in parts]
        yield field_name, list(zip(names, value, strict=True)) if parts else [(prefix, value)]


def _mounted(
    robot: Robot, arm: Robot, at: str, position: Axis, orientation: Axis, prefix: str
) -> Robot:
    """A robot fixed to a body of an arm; see `Robot.mounted_on`."""
    shift = np.array(finite_triple("position", position))
    turn = rotation_from_angles(finite_triple("orientation", orientation))
    carrier = arm.body_index(at)
    kept = tuple(i for i in range(robot.dof) if i not in robot.floating_dofs)
    dof = {old: arm.dof + new for new, old in enumerate(kept)}
    first = len(arm.bodies)
    bodies = (
        *(_renamed(body, prefix) for body in arm.bodies),
        *(_carried(body, carrier, first, dof, shift, turn) for body in robot.bodies),
    )
    strips = (
        *(replace(s, name=prefix + s.name, wing=prefix + s.wing) for s in arm.strips),
        *(replace(s, body=s.body + first) for s in robot.strips),
    )

    def joined(name: str, none: float = np.inf) -> tuple[Any, ...]:
        """Values for the joints of both, `none` for those of one that has none; or ()."""
        own, carriers = getattr(robot, name), getattr(arm, name)
        if not own and not carriers:
            return ()
        own = own or (none,) * robot.dof
        return (*(carriers or (none,) * arm.dof), *(own[i] for i in kept))

    def pairs(name: str) -> tuple[tuple[str, str], ...]:
        of_arm = tuple((prefix + one, prefix + other) for one, other in getattr(arm, name))
        return (*of_arm, *getattr(robot, name))

    of_both: dict[str, Any] = {name: joined(name, 0.0) for name in ("stiffness", "rest")}
    of_both |= {name: joined(name) for name in (*_OF_JOINTS, *CAPACITIES)}
    of_both |= {name: pairs(name) for name in ("joined_wings", "mirrored_wings", "mirrored_joints")}
    names = (*(prefix + k for k in arm.dof_names), *(robot.dof_names[i] for i in kept))
    for kind, own in (
        ("bodies", [body.name for body in bodies]),
        ("coordinates", names),
        ("strips", [strip.name for strip in strips]),
    ):
        if taken := repeated(own):
            raise ParameterError("prefix", f"one that keeps names of {kind} apart", taken[0])
    return replace(
        robot,
        name=f"{robot.name}-on-{arm.name}",
        bodies=bodies,
        strips=strips,
        dof_names=names,
        actuated=(*arm.actuated, *(dof[i] for i in robot.actuated if i in dof)),
        source=composed_source(robot.source, arm.source, at, (position, orientation), prefix),
        cruise=None,
        **of_both,
    )


def _renamed(body: Body, prefix: str) -> Body:
    joints = tuple(
        replace(joint, name=prefix + joint.name, inner=joint.inner and prefix + joint.inner)
        for joint in body.joints
    )
    return replace(body, name=prefix + body.name, joints=joints)


def _carried(
    body: Body, carrier: int, first: int, dof: dict[int, int], shift: Any, turn: Any
) -> Body:
    """A body of the robot in the tree of the arm; a root is moved to the mounting."""
    joints = tuple(replace(joint, dof=dof[joint.dof]) for joint in body.joints)
    if body.parent >= 0:
        return replace(body, parent=body.parent + first, joints=joints)
    return replace(
        body,
        parent=carrier,
        position=axis_of(shift + turn @ body.position),
        orientation=axes_of(turn @ body.orientation),
        joints=joints,
        floating_dofs=None,
        mounted=True,
    )


def axis_of(vector: Any) -> Axis:
    """Three numbers, (3,) [any unit], as a tuple of floats, a zero without its sign."""
    x, y, z = (float(k) + 0.0 for k in vector)
    return (x, y, z)


def axes_of(matrix: Any) -> tuple[Axis, Axis, Axis]:
    """Rows of a matrix, (3, 3) [any unit], as tuples of numbers."""
    return axis_of(matrix[0]), axis_of(matrix[1]), axis_of(matrix[2])


def finite_triple(name: str, values: ArrayLike) -> Axis:
    """Three finite numbers as a tuple of floats.

    Raises:
        ParameterError: If they are not.
    """
    vector = real_array(name, values).copy()
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ParameterError(name, "three finite numbers", np.ravel(vector).tolist()[:6])
    return axis_of(vector)
