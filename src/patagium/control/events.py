"""Events of a flight: gusts, wind that turns, a payload, a wing cut, another polar, a stuck drive.

An event has a time, and changes the air, the machine or what its drives answer from then on. Of
what is lost a thousandth remains, and strips of a lost tip lie at the cut, so that other equations
are compiled only where a number that is exactly zero in the robot's file becomes another one.
Neglected: what flies off, and the time that a change takes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any, TypeAlias

import numpy as np

from patagium.aerodynamics import Aerodynamics, OneMinusCosineGust, RampGust
from patagium.aerodynamics.description import aero_from_description, innermost
from patagium.aerodynamics.gusts import Gust, triple
from patagium.arguments import check_fields, checked
from patagium.arrays import Array
from patagium.errors import ParameterError, check_names, finite, positive
from patagium.robot import Robot
from patagium.robot.model import INERTIA, Body, Strip, moments_of
from patagium.robot.planform import sides_of, strip_corners
from patagium.robot.review import mass_beside_strips

Machine: TypeAlias = tuple[Robot, Aerodynamics]
"""Machine, and the model of the air around it."""

LEFT = 1e-3
"""Share of a lost strip, and of a body that is lost as a whole, that remains for the equations."""
_ROUNDING = 1e-12  # of the largest number of the same vector


@dataclass(frozen=True, kw_only=True)
class Event:
    """Event at one time of a flight; by itself it changes nothing.

    Args:
        time: When it happens [s].

    Raises:
        ParameterError: If the time is negative or not finite.
    """

    time: float

    def __post_init__(self) -> None:
        check_fields(self)
        if self.time < 0:
            raise ParameterError("time", "zero or more seconds", self.time)

    @property
    def words(self) -> str:
        """Event in words."""
        given = ", ".join(f"{k} {v}" for k, v in asdict(self).items() if k != "time")
        return f"{type(self).__name__}: {given}"

    @contextmanager
    def named(self) -> Iterator[None]:
        """Errors in whose message the event is named."""
        try:
            yield
        except ParameterError as error:
            error.args = (f"events: at {self.time:g} s {self.words}: {error}",)
            raise

    def gust(self) -> Gust | None:
        """Gust that it adds to the air, or None."""
        return None

    def changed(self, robot: Robot, aero: Aerodynamics) -> Machine:
        """Machine and air from then on.

        Args:
            robot: The machine before.
            aero: Model of the air before.

        Raises:
            ParameterError: If the machine or the air has no such part.
        """
        return robot, aero

    def describe(self) -> dict[str, Any]:
        """Event as JSON-able values, in words too."""
        return {"kind": type(self).__name__, **asdict(self), "words": self.words}


@dataclass(frozen=True, kw_only=True)
class GustEvent(Event):
    """Gust of one minus cosine that begins at a time, or wind that turns and stays.

    Args:
        time: When it begins [s].
        velocity: Its largest velocity, world axes, (3,) [m/s].
        length_time: Time it lasts, or that the wind takes to turn [s].
        stays: Whether the velocity goes up along a ramp and stays.
    """

    velocity: tuple[float, float, float]
    length_time: float
    stays: bool = False

    @property
    def words(self) -> str:
        """Event in words."""
        velocity = ", ".join(f"{value:.3g}" for value in self.velocity)
        if self.stays:
            return f"a wind of {velocity} m/s more, within {self.length_time:g} s"
        return f"a gust of {velocity} m/s, {self.length_time:g} s long"

    def gust(self) -> Gust:
        """Gust that it adds to the air."""
        kind = RampGust if self.stays else OneMinusCosineGust
        return kind(self.velocity, self.time, self.length_time)


@dataclass(frozen=True, kw_only=True)
class PayloadEvent(Event):
    """Mass that is put on a body, as a point; at most a thousand times that of the robot.

    Args:
        time: When it is there [s].
        body: Name of the body.
        mass: The mass [kg].
        position: Where, in the body's axes before it bends, (3,) [m]; None for its centre of mass,
            which has no place of its own where the body is flexible.
    """

    body: str
    mass: float
    position: tuple[float, float, float] | None = None

    @property
    def words(self) -> str:
        """Event in words."""
        return f"a payload of {1e3 * self.mass:.4g} g on {self.body}"

    def changed(self, robot: Robot, aero: Aerodynamics) -> Machine:
        """Machine with the payload, and the air around it.

        Raises:
            ParameterError: If the mass is not positive, or its mass matrix singular to rounding.
        """
        place, mass = robot.body_index(self.body), positive("mass", self.mass)
        where = np.array(robot.bodies[place].center_of_mass, float)
        if self.position is not None:
            place, where = robot.place(self.body, triple("position", self.position))
        elif any(one.piece and one.parent == place for one in robot.bodies):
            raise ParameterError("position", f"a point, as {self.body} is flexible", None)
        if mass > 1000 * robot.mass:
            raise ParameterError("mass", "at most 1000 times that of the robot", mass)
        point = _with_point(robot.bodies[place], mass, where)
        return _around(robot.with_parameters(point), aero)


@dataclass(frozen=True, kw_only=True)
class WingLossEvent(Event):
    """Outer part of one wing that is cut off, with its share of the mass of its bodies.

    The mass of a body goes as the area of its strips, its centre as their centroid, and its
    second moments as theirs: a plate that is cut is a smaller plate. Pieces of a flexible body are
    plates cut where it is. A body that floats, or whose mass lies elsewhere than its strips, is a
    fuselage with a wing fixed to it, and loses none.

    Args:
        time: When it is lost [s].
        wing: Name of the wing.
        share: Part of its span that is lost, from the tip inwards, above 0 to 1.
    """

    wing: str
    share: float

    @property
    def words(self) -> str:
        """Event in words."""
        return f"the outer {100 * self.share:.3g} % of {self.wing} lost"

    def changed(self, robot: Robot, aero: Aerodynamics) -> Machine:
        """Machine without the tip, and the air around it."""
        return _around(without_tip(robot, self.wing, self.share), aero)


@dataclass(frozen=True, kw_only=True)
class PolarEvent(Event):
    """Polar or section whose numbers are multiplied at a time, as by rain, dirt or a torn skin.

    Args:
        time: When they change [s].
        factors: Factors by the names of the numbers, as the model's description has them, such as
            `lift_amplitude`, or `fin.lift_amplitude` where each wing has its own [1].
    """

    factors: Mapping[str, float]

    @property
    def words(self) -> str:
        """Event in words."""
        parts = [f"{name} x {value:g}" for name, value in self.factors.items()]
        return "another polar: " + ", ".join(parts)

    def changed(self, robot: Robot, aero: Aerodynamics) -> Machine:
        """Machine, and the air with the other numbers.

        Raises:
            ParameterError: If the model has no such number.
        """
        described = aero.describe()
        inner = innermost(described)
        known = _numbers_of(inner.get("polar") or inner.get("section") or inner)
        check_names("factors", self.factors, known, near=True)
        for name, factor in self.factors.items():
            part, key = known[name]
            part[key] *= factor
        return robot, aero_from_description(robot, described)


def _numbers_of(described: dict[str, Any], prefix: str = "") -> dict[str, tuple[Any, str]]:
    """Place of each number of a described polar or model by its name, of wings with theirs."""
    known = {
        prefix + key: (described, key)
        for key, value in described.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }
    for key, part in described.items():
        if isinstance(part, dict) and key not in ("stalled", "air"):
            known |= _numbers_of(part, f"{prefix}{key}.")
    return known


@dataclass(frozen=True, kw_only=True)
class StuckEvent(Event):
    """Drive that no longer takes a command, and holds its value.

    Args:
        time: When it sticks [s].
        command: Name of the command, as `SteeredGait` takes it.
        value: What it goes to and holds, within the range of its actuator and the limits of its
            joints [unit of the command]; None for what was commanded last.
    """

    command: str
    value: float | None = None

    @property
    def words(self) -> str:
        """Event in words."""
        held = "its last value" if self.value is None else f"{self.value:g}"
        return f"{self.command} stuck at {held}"


def with_gusts(aero: Aerodynamics, events: Sequence[Event]) -> Aerodynamics:
    """Model of the air with the gusts of all events.

    Raises:
        ParameterError: If there are other gusts than one that travels.
    """
    gusts = []
    for event in events:
        with event.named():
            gust = event.gust()
        gusts += [] if gust is None else [gust.describe()]
    if not gusts:
        return aero
    aero.air.require_uniform("aero")
    described = aero.describe()
    inner = innermost(described)
    gusts = [one for one in (inner["air"]["gust"], *gusts) if one is not None]
    inner["air"]["gust"] = {"name": "sum", "gusts": gusts} if len(gusts) > 1 else gusts[0]
    return aero_from_description(aero.robot, described)


@checked
def off_nominal(robot: Robot, share: float, seed: int) -> Robot:
    """Robot whose masses and inertias differ from what its file says.

    Args:
        robot: The machine of the file.
        share: Standard deviation of each body's mass, and of its inertia at that mass, over their
            values, below 0.3; no number is off by more than three times that.
        seed: Seed of the numbers.

    Raises:
        ParameterError: If the share is out of its range.
    """
    if not 0 <= share < 0.3:
        raise ParameterError("share", "at least 0 and below 0.3", share)
    rng = np.random.default_rng([seed, 0x0FF])
    values: dict[str, float] = {}
    for body in robot.bodies:
        mass, moment = 1 + share * np.clip(rng.standard_normal(2), -3, 3)
        values[f"{body.own_name}.mass"] = float(body.mass) * mass
        inertia = np.array(body.inertia, float) * mass * moment
        values |= _named(f"{body.own_name}.inertia", inertia)
    return robot.with_parameters(values)


def without_tip(robot: Robot, wing: str, share: float) -> Robot:
    """Robot without the outer share of a wing's span; the same structure with other numbers.

    Raises:
        ParameterError: If there is no such wing, or the share is not within its range.
    """
    check_names("wing", [wing], robot.wing_names, near=True)
    if not 0 < finite("share", share) <= 1:
        raise ParameterError("share", "above 0, up to 1", share)
    strips = [strip for strip in robot.strips if strip.wing == wing]
    room = (1 - share) * sum(float(strip.width) for strip in strips)
    values: dict[str, float] = {}
    edge: dict[int, Array] = {}
    cuts: dict[int, float] = {}
    for k, strip in enumerate(strips):
        width = float(strip.width)
        kept = float(np.clip(room, 0.0, width))
        room -= kept
        if kept == width:
            continue
        out = _outwards(robot, strips, k)
        center = np.array(strip.quarter_chord, float)
        inner = edge.get(strip.body, center - width / 2 * out)
        root, along = _root(robot, strip.body)
        cuts.setdefault(root, along + (inner + kept * out)[1])
        left = max(kept, LEFT * width)
        edge[strip.body] = inner + left * out  # side by side: no two vortices in one place
        values[f"{strip.name}.width"] = left
        values |= _named(f"{strip.name}.quarter_chord", inner + left / 2 * out)
    less = robot.with_parameters(values)
    for place, body in enumerate(robot.bodies):
        root, along = _root(robot, place)
        if body.floating_dofs or root not in cuts:
            continue
        hinge = next((b.position[1] for b in robot.bodies if b.piece and b.parent == place), None)
        if body.piece or hinge is not None:
            values |= _shorter(body, cuts[root] - along, hinge)
        elif not mass_beside_strips(robot, place):
            values |= _lighter(less, robot, place)
    return robot.with_parameters(values)


def _root(robot: Robot, place: int) -> tuple[int, float]:
    """Root of a flexible body of which a body is a piece, and its origin there along y [m]."""
    along = 0.0
    while robot.bodies[place].piece:
        along, place = along + float(robot.bodies[place].position[1]), robot.bodies[place].parent
    return place, along


def _shorter(body: Body, cut: float, hinge: Any) -> dict[str, float]:
    """Numbers of a piece that is cut at a place along y, the root up to its hinge [m]."""
    center = np.array(body.center_of_mass, float)
    half = center[1] if body.piece else hinge - center[1]
    share = float(np.clip((cut - center[1]) / (2 * half) + 0.5, LEFT, 1.0))
    center[1] -= (1 - share) * half
    return _scaled(body, share, np.array([1.0, share**2, 1.0]), center)


def _outwards(robot: Robot, strips: Sequence[Strip], place: int) -> Array:
    """Unit vector along the span of a strip to the tip, axes of its body, (3,)."""
    strip = strips[place]
    span = np.cross(strip.normal, strip.forward)
    near = [one for one in strips[max(place - 1, 0) : place + 2] if one.body == strip.body]
    way = span @ np.subtract(near[-1].quarter_chord, near[0].quarter_chord)
    side = float(way) or sides_of(robot)[robot.strips.index(strip)]
    return np.asarray(span if side >= 0 else -span)


def _lighter(less: Robot, robot: Robot, place: int) -> dict[str, float]:
    """Numbers of a body whose mass goes as the area of its strips, smaller in `less`."""
    body = robot.bodies[place]
    area, center, second = _plates(less, place)
    whole, former, seconds = _plates(robot, place)
    thick = np.where(seconds > 1e-9 * seconds.max(), seconds, 1.0)
    squares = np.where(thick == seconds, second / thick, 1.0)
    where = np.array(body.center_of_mass) + center - former
    return _scaled(body, area / whole, squares, where)


def _scaled(body: Body, share: float, squares: Array, center: Array) -> dict[str, float]:
    """Numbers of a body with a share of its mass, whose variances are scaled, (3,) [1]."""
    scale = np.sqrt(share * squares)
    variances, axes = np.linalg.eigh(np.trace(body.tensor) / 2 * np.eye(3) - body.tensor)
    axes = scale[:, None] * axes
    spread = axes * np.maximum(variances, 0.0) @ axes.T  # an estimate may be below 0
    tensor = np.trace(spread) * np.eye(3) - spread
    return _mass_of(body, float(body.mass) * share, center, tensor)


def _plates(robot: Robot, place: int) -> tuple[float, Array, Array]:
    """Area of the strips of a body [m^2], its centroid [m] and its variances, (3,) [m^2]."""
    strips = [strip for strip in robot.strips if strip.body == place]
    areas = np.array([strip.chord * strip.width for strip in strips], float)
    corners = np.array([strip_corners(strip) for strip in strips])
    chords, widths = corners[:, 0] - corners[:, 3], corners[:, 1] - corners[:, 0]
    centers, shares = corners.mean(axis=1), areas / areas.sum()
    center = shares @ centers
    spread = (chords**2 + widths**2) / 12 + centers**2
    return areas.sum(), center, shares @ spread - center**2


def _with_point(body: Body, mass: float, center: Array) -> dict[str, float]:
    """Numbers of a body with a mass more at a point, (3,) [m]."""
    total, old = float(body.mass) + mass, np.array(body.center_of_mass, float)
    new = (float(body.mass) * old + mass * center) / total
    tensor = body.tensor
    for part, at in ((float(body.mass), old), (mass, center)):
        arm = at - new
        tensor += part * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return _mass_of(body, total, new, tensor)


def _mass_of(body: Body, mass: float, center: Array, tensor: Array) -> dict[str, float]:
    """Numbers of a body with another mass, centre and inertia, by name."""
    return {
        f"{body.own_name}.mass": mass,
        **_named(f"{body.own_name}.center_of_mass", center),
        **_named(f"{body.own_name}.inertia", moments_of(tensor)),
    }


def _named(name: str, values: Any) -> dict[str, float]:
    """Numbers of a vector by name, rounding as zero."""
    parts = "xyz" if len(values) == 3 else INERTIA
    kept = np.where(np.abs(values) > _ROUNDING * np.abs(values).max(), values, 0.0)
    return {f"{name}.{part}": float(value) for part, value in zip(parts, kept, strict=True)}


def _around(robot: Robot, aero: Aerodynamics) -> Machine:
    return robot, aero_from_description(robot, aero.describe())
