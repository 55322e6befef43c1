"""Schema of a robot file: keys, units and ranges.

Mirrors the file, not the machine: `patagium.robot.assembly` turns it into a
`Robot`. All numbers are SI here already. Neglected: contact and actuator dynamics; uneven density
of a shape: describe such a body by its measured moments.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictBool,
    model_validator,
)

from patagium.arrays import Array
from patagium.limits import LEAST_MASS
from patagium.robot.model import (
    CAPACITIES,
    INERTIA,
    PHYSICAL,
    capacity_units,
    inertia_tensor,
    is_physical,
)

from patagium.robot.units import (  # isort: skip
    Acceleration, Angle, BeamStiffness, Duration, Frequency, Inertia, Length, Mass, NumberInSI,
    PureNumber, SlidingDamping, Speed, Tilt, TurningDamping, UnitMismatch, in_si, mismatch, si_at,
    spoken,
)  # fmt: skip


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _positive(value: float, *, at: str = "") -> float:
    if not value > 0:
        raise mismatch("a positive quantity", f"{value:g}", at)
    return value


def _not_negative(value: float, *, at: str = "") -> float:
    if not value >= 0:
        raise mismatch("a quantity that is not negative", f"{value:g}", at)
    return value


_POSITIVE, _NOT_NEGATIVE = AfterValidator(_positive), AfterValidator(_not_negative)


def _unit_vector(written: object) -> object:
    """Axis as a letter with a sign ("x", "-z") or as three numbers, made a unit vector."""
    if isinstance(written, str) and written.removeprefix("-") in ("x", "y", "z"):
        return tuple((-1.0) ** written.startswith("-") * (written[-1] == k) + 0.0 for k in "xyz")
    if not isinstance(written, (list, tuple)) or len(written) != 3:
        raise mismatch("an axis: x, y, z, -x, -y, -z or three numbers", repr(written)[:40])
    try:
        vector = np.array([in_si(k, "") for k in written])
    except UnitMismatch as error:
        raise mismatch("an axis of three numbers", str(error)) from None
    length = float(np.linalg.norm(vector))
    if not (np.isfinite(length) and length > 1e-12):
        raise mismatch("an axis of some length", repr(written)[:40])
    return tuple(float(k) for k in vector / length)


Name: TypeAlias = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$", examples=["left_wing"])]
Point: TypeAlias = Annotated[tuple[Length, Length, Length], Field(examples=["[1 cm, 0, 2 mm]"])]
Direction: TypeAlias = Annotated[
    tuple[float, float, float], BeforeValidator(_unit_vector), Field(examples=["y"])
]
PositiveLength: TypeAlias = Annotated[Length, _POSITIVE]
FIRST_HINGE = 1 - 1 / np.sqrt(3)
"""Place of the first hinge of a flexible plate, over its share of the span."""
_ORIGIN = (0.0, 0.0, 0.0)


def _from_second_moments(second: Array) -> Array:
    return np.diag(second.sum() - second)


class Cylinder(_Part):
    """Solid cylinder along `axis`."""

    type: Literal["cylinder"]
    axis: Direction
    radius: PositiveLength
    length: PositiveLength

    def tensor(self, mass: float) -> Array:
        """Inertia about the centre of mass, (3, 3) [kg m^2].

        I = I_t (1 - u u^T) + I_a u u^T, I_a = m r^2 / 2, I_t = m (3 r^2 + l^2) / 12.

        Args:
            mass: Mass m [kg].
        """
        along = np.outer(self.axis, self.axis)
        across = mass * (3 * self.radius**2 + self.length**2) / 12
        return np.asarray(across * (np.eye(3) - along) + mass * self.radius**2 / 2 * along)


class Box(_Part):
    """Box with its edges along the body axes."""

    type: Literal["box"]
    size: tuple[PositiveLength, PositiveLength, PositiveLength]

    def tensor(self, mass: float) -> Array:
        """Inertia about the centre of mass, I_xx = m (y^2 + z^2) / 12, (3, 3) [kg m^2]."""
        return _from_second_moments(mass / 12 * np.square(self.size))


class Plate(_Part):
    """Flat rectangular wing, chord along x; `axis` is spanwise, y or z."""

    type: Literal["plate"]
    axis: Literal["y", "z"] = "y"
    chord: PositiveLength
    span: PositiveLength
    thickness: PositiveLength

    @property
    def size(self) -> tuple[float, float, float]:
        """Edges along the body axes, (3,) [m]."""
        y, z = (self.span, self.thickness)[:: 1 if self.axis == "y" else -1]
        return self.chord, y, z

    def tensor(self, mass: float) -> Array:
        """Inertia about the centre of mass, (3, 3) [kg m^2]."""
        return _from_second_moments(mass / 12 * np.square(self.size))


class Ellipsoid(_Part):
    """Solid ellipsoid along the body axes."""

    type: Literal["ellipsoid"]
    semi_axes: tuple[PositiveLength, PositiveLength, PositiveLength]

    def tensor(self, mass: float) -> Array:
        """Inertia about the centre of mass, I_xx = m (b^2 + c^2) / 5, (3, 3) [kg m^2]."""
        return _from_second_moments(mass / 5 * np.square(self.semi_axes))


class PointMass(_Part):
    """All mass in the centre of mass."""

    type: Literal["point"]

    def tensor(self, mass: float) -> Array:  # noqa: ARG002 - one signature for all shapes
        """Inertia of a point mass about itself: zero, (3, 3) [kg m^2]."""
        return np.zeros((3, 3))


Shape: TypeAlias = Annotated[
    Cylinder | Box | Plate | Ellipsoid | PointMass, Field(discriminator="type")
]


class Moments(_Part):
    """Inertia given directly, about the centre of mass, in body axes [kg m^2]."""

    xx: Inertia
    yy: Inertia
    zz: Inertia
    xy: Inertia = 0.0
    xz: Inertia = 0.0
    yz: Inertia = 0.0

    @model_validator(mode="after")
    def _physical(self) -> Moments:
        if not is_physical(self.tensor(0.0)):
            raise mismatch(PHYSICAL, f"xx {self.xx:g}, yy {self.yy:g}, zz {self.zz:g}")
        return self

    def tensor(self, mass: float) -> Array:  # noqa: ARG002 - one signature for all shapes
        """Inertia about the centre of mass, (3, 3) [kg m^2]."""
        return inertia_tensor([getattr(self, key) for key in INERTIA])


def _joint_units(kind: object) -> dict[str, str]:
    """Unit of a coordinate, of its damping and of its stiffness."""
    length, force = ("m", "N") if kind == "prismatic" else ("rad", "N m")
    return {"rest": length, "damping": f"{force} s/{length}", "stiffness": f"{force}/{length}"}


_AXIS = "the axis of the joint (about x a wing flaps, about y it feathers),"


class JointPart(_Part):
    """One coordinate of a body's chain of joints."""

    name: Name
    type: Literal["revolute", "prismatic"] = "revolute"
    axis: Annotated[Direction, Field(description=_AXIS, examples=["x"])]
    limits: tuple[float, float] | None = None
    speed_limit: float | None = None
    acceleration_limit: float | None = None
    effort_limit: float | None = None
    power_limit: float | None = None
    damping: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    passive: StrictBool = False

    @property
    def unit(self) -> str:
        """Unit of its coordinate."""
        return _joint_units(self.type)["rest"]

    @model_validator(mode="before")
    @classmethod
    def _in_si(cls, written: Any) -> Any:
        """Limits, damping and spring have the unit of the joint's kind."""
        if not isinstance(written, dict):
            return written
        units = _joint_units(written.get("type", "revolute"))
        converted = dict(written)
        for key, unit in zip(CAPACITIES, capacity_units(units["rest"]), strict=True):
            if key in written:
                converted[key] = _positive(si_at(written[key], unit, key, "a limit"), at=key)
        if isinstance(written.get("limits"), list):
            converted["limits"] = tuple(
                si_at(limit, units["rest"], f"limits.{i}", most=np.inf)
                for i, limit in enumerate(written["limits"])
            )
        for key, unit in units.items():
            if key in written:
                converted[key] = si_at(written[key], unit, key)
        return converted

    @model_validator(mode="after")
    def _ordered(self) -> JointPart:
        if self.limits is not None and not self.limits[0] < self.limits[1]:
            raise mismatch("the lower before the upper", spoken(self.unit, *self.limits), "limits")
        for key in ("damping", "stiffness"):
            _not_negative(getattr(self, key), at=key)
        if self.rest and not self.stiffness:
            raise mismatch("a stiffness where there is a rest", "none", "stiffness")
        low, high = self.limits or (-np.inf, np.inf)
        if self.passive and self.stiffness and not low <= self.rest <= high:
            expected = f"a rest within the joint's limits, {spoken(self.unit, low, high)}"
            raise mismatch(expected, spoken(self.unit, self.rest), "rest")
        return self


class FloatingDamping(_Part):
    """Passive damping of a floating body's velocities: force = -damping v."""

    x: Annotated[SlidingDamping, _NOT_NEGATIVE] = 0.0
    y: Annotated[SlidingDamping, _NOT_NEGATIVE] = 0.0
    z: Annotated[SlidingDamping, _NOT_NEGATIVE] = 0.0
    roll: Annotated[TurningDamping, _NOT_NEGATIVE] = 0.0
    pitch: Annotated[TurningDamping, _NOT_NEGATIVE] = 0.0
    yaw: Annotated[TurningDamping, _NOT_NEGATIVE] = 0.0


class FlexiblePart(_Part):
    """Elasticity of a plate along y: rigid pieces with springs between them."""

    elements: Annotated[int, Field(ge=2, le=40, multiple_of=2, strict=True, examples=[4])] = 4
    bending: Annotated[BeamStiffness, _NOT_NEGATIVE] = 0.0
    torsion: Annotated[BeamStiffness, _NOT_NEGATIVE] = 0.0
    damping: Annotated[Duration, _NOT_NEGATIVE] = 0.0

    @model_validator(mode="after")
    def _elastic(self) -> FlexiblePart:
        if not (self.bending or self.torsion):
            raise mismatch("a bending or a torsion stiffness above 0 such as '0.02 N m^2'", "none")
        return self


class BodyPart(_Part):
    """A rigid body, how it hangs on its parent, its mass; massless: a frame, or between joints."""

    parent: Name | None = None
    at: Point = _ORIGIN
    orientation: tuple[Angle, Angle, Angle] = _ORIGIN
    floating: StrictBool = False
    attitude: Literal["euler", "quaternion"] | None = None
    joints: Annotated[
        tuple[JointPart, ...], Field(examples=["[{name: left_plunge, axis: x}]"])
    ] = ()
    damping: FloatingDamping | None = None
    massless: StrictBool = False
    mass: Mass
    center_of_mass: Point = _ORIGIN
    inertia: Moments | None = None
    shape: Shape | None = None
    flexible: FlexiblePart | None = None

    @model_validator(mode="before")
    @classmethod
    def _frame(cls, written: Any) -> Any:
        """A massless body says nothing of its mass."""
        if not isinstance(written, dict) or written.get("massless") is not True:
            return written
        for key in ("mass", "center_of_mass", "inertia", "shape"):
            if key in written:
                raise mismatch("nothing with massless: true", repr(written[key])[:40], key)
        return {**written, "mass": 0.0, "shape": {"type": "point"}}

    @model_validator(mode="after")
    def _consistent(self) -> BodyPart:
        """Refuse a body whose mass, inertia, shape and joints do not go together."""
        if not (self.massless or self.mass >= LEAST_MASS):
            expected = f"a positive quantity, {LEAST_MASS:g} kg at least"
            raise mismatch(expected, f"{self.mass:g} kg", "mass")
        if (self.inertia is None) == (self.shape is None):
            both = "both" if self.shape is not None else "neither"
            inertia = "`inertia: {xx: 2 g cm^2, yy: 3 g cm^2, zz: 4 g cm^2}`"
            raise mismatch(
                f"either inertia or shape, such as `shape: {{type: point}}` or {inertia}", both
            )
        if self.floating and (self.joints or self.parent or any(self.at) or any(self.orientation)):
            expected = "a floating body without parent, at, orientation and joints"
            raise mismatch(expected, "at least one of them")
        if self.flexible is not None:
            plate = self.shape
            if not isinstance(plate, Plate) or plate.axis != "y" or self.floating:
                expected = "a flexible body whose shape is a plate along y, and that does not float"
                raise mismatch(expected, "another body", "flexible")
            inwards = plate.span / 2 - abs(self.center_of_mass[1])
            if inwards > FIRST_HINGE * plate.span / self.flexible.elements:
                expected = "a flexible plate to one side of its body's origin, where it is held"
                found = f"one that begins {inwards:.3g} m on the other side; cut it in two bodies"
                raise mismatch(expected, found, "center_of_mass")
        for key in ("attitude", "damping"):
            if getattr(self, key) is not None and not self.floating:
                expected = f"{key} on a floating body (a joint carries its own)"
                raise mismatch(expected, "a body that is not floating")
        return self

    def tensor(self) -> Array:
        """Inertia about the centre of mass, (3, 3) [kg m^2], body axes."""
        form = self.inertia if self.inertia is not None else self.shape
        return form.tensor(self.mass)  # type: ignore[union-attr]


class Station(_Part):
    """Station of a wing's outline: a span position and the two edges along x."""

    span: Length
    leading: Length
    trailing: Length
    incidence: Tilt = 0.0

    @model_validator(mode="after")
    def _chord(self) -> Station:
        if self.leading < self.trailing:
            found = f"leading {self.leading:g} m, trailing {self.trailing:g} m"
            raise mismatch("a leading edge ahead of the trailing edge", found)
        return self


_STATIONS = "[{span: 0, leading: 2 cm, trailing: -4 cm}, {span: 9 cm, leading: 0, trailing: -2 cm}]"


class Segment(_Part):
    """The part of a wing that one body carries, cut into strips of equal width."""

    body: Name
    strips: Annotated[int, Field(ge=1, le=200, strict=True, examples=[6])]
    at: Point = _ORIGIN
    span_axis: Direction = (0.0, 1.0, 0.0)
    stations: Annotated[tuple[Station, ...], Field(min_length=2, examples=[_STATIONS])]

    @model_validator(mode="before")
    @classmethod
    def _turned(cls, written: Any) -> Any:
        if isinstance(written, dict) and "orientation" in written:
            body = "a body that carries the segment (`massless: true` if it weighs nothing)"
            raise mismatch(f"it on {body}", "one of a segment", "orientation")
        return written

    @model_validator(mode="after")
    def _outline(self) -> Segment:
        spans = [k.span for k in self.stations]
        if any(b - a < 1e-9 for a, b in zip(spans, spans[1:], strict=False)):  # m
            raise mismatch("span positions that increase", str(spans)[:60], "stations")
        chords = [k.leading - k.trailing for k in self.stations]
        if any(max(pair) <= 0 for pair in zip(chords, chords[1:], strict=False)):
            raise mismatch("some chord between any two", str(chords)[:60], "stations")
        if abs(self.span_axis[0]) > 1e-9:
            expected = "an axis across x (the chord lies along x)"
            raise mismatch(expected, str(self.span_axis), "span_axis")
        return self


class WingPart(_Part):
    """A wing from the root outwards, on one or more bodies."""

    name: Name
    joins: tuple[Name, ...] | None = None
    segments: Annotated[
        tuple[Segment, ...],
        Field(min_length=1, examples=["[{body: left_wing, strips: 6, stations: [...]}]"]),
    ]


class Mirror(_Part):
    """Repeats in y all that is named `source`..., renamed `target`...."""

    model_config = ConfigDict(validate_by_alias=True, validate_by_name=False)
    source: Name = Field(alias="from")
    target: Name = Field(alias="to")

    def image(self, name: str) -> str:
        """Name of the image of what has this name; the same of what is not mirrored."""
        return self.target + name[len(self.source) :] if name.startswith(self.source) else name

    @model_validator(mode="after")
    def _different(self) -> Mirror:
        if self.source == self.target:
            raise mismatch("two different names", self.source)
        return self


class CruisePart(_Part):
    """Flight where nothing else is asked for: one sine a joint, whose unit the assembly knows."""

    frequency: Annotated[Frequency, _POSITIVE] | None = None
    amplitude: dict[Name, Any] = {}
    phase: dict[Name, Any] = {}
    offset: dict[Name, Any] = {}
    speed: Annotated[Speed, _NOT_NEGATIVE] = 0.0
    pitch: Tilt = 0.0
    duration: Annotated[Duration, _POSITIVE] = 1.0

    @model_validator(mode="after")
    def _beats(self) -> CruisePart:
        if self.amplitude and self.frequency is None:
            raise mismatch("a frequency such as '5 Hz' with an amplitude", "none", "frequency")
        return self


class ActuatorPart(_Part):
    """Limits of a command; the assembly knows its unit."""

    range: tuple[Any, Any] | None = None
    rate_limit: Any = None
    response_time: Annotated[Duration, _POSITIVE] | None = None
    cost: Annotated[PureNumber, _POSITIVE] = 1.0


class RobotFile(_Part):
    """All of a robot file."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,39}$", examples=["my_robot"])]
    gravity: Annotated[Acceleration, _NOT_NEGATIVE]
    coordinates: tuple[Name, ...] | None = None
    bodies: Annotated[
        dict[Name, BodyPart],
        Field(min_length=1, examples=["{body: {floating: true, mass: 20 g, shape: ...}}"]),
    ]
    wings: Annotated[
        tuple[WingPart, ...], Field(examples=["[{name: left_wing, segments: [...]}]"])
    ] = ()
    mirror: Annotated[tuple[Mirror, ...], Field(examples=["[{from: left, to: right}]"])] = ()
    cruise: CruisePart | None = None
    actuators: dict[Name, ActuatorPart] = {}
    parameters: dict[str, NumberInSI] = {}


class CompositionFile(_Part):
    """All of a file that mounts one robot on another; each is a preset or a robot file's text."""

    robot: str | dict[Any, Any]
    mounted_on: str | dict[Any, Any]
    at: str
    position: Point = _ORIGIN
    orientation: tuple[Angle, Angle, Angle] = _ORIGIN
    prefix: Annotated[str, Field(pattern=r"^[a-z0-9_]{0,39}$")] = "arm_"
    parameters: dict[str, NumberInSI] = {}
