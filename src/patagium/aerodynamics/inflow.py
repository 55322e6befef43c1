"""Induced inflow of flapping wings: the velocity that their own forces give the air.

Flapping wings throw air downwards through the area that they sweep, and work in that stream.
Momentum theory gives its velocity, the air's own inertia the time that it takes. It is put on
any model of the air, which then sees it as wind. Neglected: how the inflow is spread over the
stroke, the wake's swirl and contraction, the part of a wing in another wing's wake.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise, permutations
from math import pi
from typing import Any, TypeAlias, TypeVar

import casadi as ca
import numpy as np

from patagium.aerodynamics.ground import ground_share
from patagium.aerodynamics.indicial import Relaxation
from patagium.aerodynamics.local_flow import quarter_chord, strip_axes
from patagium.aerodynamics.on_model import OnModel
from patagium.aerodynamics.smooth_functions import smooth_norm, smooth_step
from patagium.aerodynamics.strip_loads import AeroExpressions
from patagium.aerodynamics.wind_shear import WindShear
from patagium.arrays import Array
from patagium.dynamics.chain import vector
from patagium.dynamics.kinematics import Pose, Twist, body_poses, body_velocities
from patagium.errors import positive
from patagium.robot.model import Robot, Strip
from patagium.robot.planform import (
    BOTH_SIDES,
    hinge_of,
    inwards,
    mirror_body,
    placed,
    poses,
    strip_corners,
)

NUMBERS = ("induced_factor", "apparent_mass", "memory")
"""Parameters that follow those of the model, in their order."""
TANDEM = 0.5
"""Distance of two held wings along the body below which their streams are one, over the length."""
SWEEPS = 0.5
"""Sine of the angle between span and hinge above which a joint turns the span."""


@dataclass(frozen=True)
class Inflow(OnModel):
    """Model of the air with the velocity that its own forces induce through the strokes.

    All wings that sweep share one stroke, held ones a stream if they are close. With F the
    force of the air on them, V their velocity through the air, u the induced velocity (world
    axes, the same for all of their strips) and w what the model itself says of its downwash,

        m du/dt = f (max(k |F| / f - w.d, 0) d - u),   f = 2 rho A |u - V|,   d = -F/|F|,

    with m = mu rho (A/pi)^(3/2), so that at rest u = sqrt(k T / 2 rho A) for a thrust T, in fast
    flight it fades as Glauert's 1/V, and what a lifting line, or the wing on which a polar was
    measured, induces itself is not counted twice. A is the area from which
    the stroke takes its air: what the wings sweep, 1/2 Phi R^2 each but once for what wings of
    one side sweep both (less with the distance of their hinges, nothing from R on), where the
    stream goes through the stroke, and the circle on the span where it goes along it (at any
    stagger: Munk's theorem); R and the span are those of the pose. Phi is found on the
    way from the directions of each wing from root to tip, e, over the angle that it has
    swept, (|de/dt|^2 + |V|^2/R^2)^(1/2) dt: ds = (e - s)/memory of it, |s| = sin(Phi/2) / (Phi/2).
    Wings that sweep less than their own area have no stroke: of F, the part along u - V counts
    less, and none where they are held, as the drag of a wing that translates is in its polar.
    Wings whose span no joint turns, or on both sides of their hinge as tails, have the circle as A.

    Args:
        model: Model of the air that gives the force.
        induced_factor: k; 1: the induced velocity is the same all over the stroke.
        apparent_mass: mu; 8/3: the air that moves with a disk.
        memory: Angle over which the stroke is remembered [rad].

    Raises:
        ParameterError: If a number is not finite and positive, or the model has inflow already.

    References:
        Ellington (1984), The aerodynamics of hovering insect flight V, Philosophical
        Transactions B 305, 115-144 (area swept); Glauert (1935) in Durand, Aerodynamic Theory IV;
        Pitt & Peters (1981), Vertica 5, 21-34 (inertia of the inflow); Munk (1921), NACA TR 121.
    """

    induced_factor: float = 1.0
    apparent_mass: float = 8 / 3
    memory: float = 2 * pi

    name = "inflow"

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in NUMBERS:
            positive(name, getattr(self, name))

    @cached_property
    def strokes(self) -> tuple[Stroke, ...]:
        """Strokes of the robot, and the wings that share each."""
        return strokes_of(self.robot)

    @property
    def state_size(self) -> int:
        """States of the model, then of each stroke its induced velocity and its wings' means."""
        return self._places[-1]

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the model's own states, and of those of each stroke."""
        found = list(self.model.state_names)
        for number, stroke in enumerate(self.strokes):
            which = f"induced {number} " if number else "induced "
            found += [f"{which}velocity of {axis}" for axis in "xyz"]
            wings = [self.robot.strips[wing[0]].wing for wing in stroke.swept]
            found += [f"mean direction {axis} of {wing}" for wing in wings for axis in "xyz"]
        return tuple(found)

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the model's own states, and of those of each stroke."""
        own = [("m/s",) * 3 + ("1",) * 3 * len(stroke.swept) for stroke in self.strokes]
        return sum(own, self.model.state_units)

    @property
    def _places(self) -> list[int]:
        """Place of the first state of each stroke, then the number of states."""
        sizes = [3 + 3 * len(stroke.swept) for stroke in self.strokes]
        return [*accumulate([self.model.state_size, *sizes])]

    @property
    def structure(self) -> str:
        """Text of what shapes the equations, numbers aside: part of a compiled function's key."""
        return f"{self.name} {self.strokes} on {self.model.key}"

    @property
    def own_parameters(self) -> dict[str, float]:
        """Numbers of the inflow by name [1, rad]."""
        return {f"inflow.{name}": getattr(self, name) for name in NUMBERS}

    def expressions(
        self, robot: Robot, q: ca.SX, v: ca.SX, state: ca.SX, wind: ca.SX, parameters: ca.SX
    ) -> AeroExpressions:
        """Equations of the model; see `Aerodynamics.expressions`."""
        names = self.model.parameter_names
        own, count = self.model.state_size, len(names)
        if isinstance(self.model, WindShear):  # shear is the wind's, not that of what is induced
            within = replace(self, model=self.model.model)
            first = len(within.model.parameter_names)
            order = ca.vertcat(parameters[:first], parameters[count:], parameters[first:count])
            swapped = replace(self.model, model=within)
            return swapped.expressions(robot, q, v, state, wind, order)
        states = [state[begin:end] for begin, end in pairwise(self._places)]
        winds = wind if wind.shape[1] > 1 else ca.repmat(wind, 1, len(robot.strips))
        induced = ca.SX.zeros(3, len(robot.strips))
        for stroke, one in zip(self.strokes, states, strict=True):
            induced[:, list(stroke.strips)] = ca.repmat(one[:3], 1, len(stroke.strips))
        air = self.model.expressions(robot, q, v, state[:own], winds + induced, parameters[:count])
        numbers = (parameters[names.index("density")], *ca.vertsplit(parameters[count:]))
        ground = parameters[names.index("ground")] if "ground" in names else None
        moving = _Moving(robot, q, v, wind, ground)
        of_strokes = zip(self.strokes, states, strict=True)
        parts = [_relaxation(stroke, moving, air, one, numbers) for stroke, one in of_strokes]
        parts[:0] = [air.memory] if air.memory is not None else []
        memory = Relaxation(
            ca.vertcat(*(part.rate for part in parts)),
            ca.vertcat(*(part.target for part in parts)),
        )
        power = air.power + ca.dot(air.strip_force, induced)  # relative to the undisturbed air
        return replace(air, power=power, state_derivative=memory.derivative(state), memory=memory)


Wing: TypeAlias = tuple[int, ...]
"""Places of the strips of a wing in `robot.strips`, from the root outwards."""


@dataclass(frozen=True)
class Stroke:
    """Wings that sweep one area, or held wings, which sweep none.

    Attributes:
        wings: Wings.
        left: Whether each wing is on the left.
        base: Body in whose axes y points left; "" of the world. Bodies are named, since their
            numbers are others in a machine with load cells.
        hinges: Body at the hinge of each wing that sweeps, and the body that the hinge is fixed to.
        ends: Strips farthest apart, each with the side of it that ends there, of wings whose span
            no joint turns or that go to both sides of their hinge, as tails do; else none.
    """

    wings: tuple[Wing, ...]
    left: tuple[bool, ...]
    base: str
    hinges: tuple[tuple[str, str], ...] = ()
    ends: tuple[tuple[int, int], ...] = ()

    @property
    def swept(self) -> tuple[Wing, ...]:
        """Wings that sweep an area: all, or none."""
        return () if self.ends else self.wings

    @property
    def strips(self) -> tuple[int, ...]:
        """Places of the strips of all wings in `robot.strips`."""
        return sum(self.wings, ())


def strokes_of(robot: Robot) -> tuple[Stroke, ...]:
    """Strokes of a robot: that of all wings that sweep, and held wings close along the body."""
    bodies, base = poses(robot), _base(robot)
    origin, axes = bodies[base] if base >= 0 else (np.zeros(3), np.eye(3))
    found: list[_Placed] = []
    for wing, hinge, reach in _wings(robot):
        strips = [robot.strips[i] for i in wing]
        edges = np.vstack([_edges(bodies, s) for s in strips]) @ axes
        root, tip = ((x - origin) @ axes for x in (bodies[hinge][0], _edges(bodies, strips[-1])[1]))
        held = _on_both_sides(robot, strips) or not _turned(robot, wing)
        spread = root + [0.0, reach if root[1] + tip[1] > 0 else -reach, 0.0]
        found.append((wing, hinge, held, edges if held else np.array([root, spread])))
    return tuple(_stroke(robot, base, group) for group in _gathered(found, _close))


_One = TypeVar("_One")


def _gathered(found: Iterable[_One], related: Callable[[_One, _One], bool]) -> list[list[_One]]:
    """Groups of which each member is related to another one."""
    groups: list[list[_One]] = []
    for one in found:
        near = [k for k, group in enumerate(groups) if any(related(one, each) for each in group)]
        joined = [*near, len(groups)]
        groups.append([one])
        groups[joined[0]] = [each for k in joined for each in groups[k]]
        groups = [group for k, group in enumerate(groups) if k not in joined[1:]]
    return groups


_Placed: TypeAlias = tuple[Wing, int, bool, Array]
"""Wing, body at its hinge, whether it is held, and hinge and tip if spread, or all edges [m]."""


def _base(robot: Robot) -> int:
    """Body in whose axes y points left: that of a pair's mirror, or under a hinge; -1: world."""
    mirrors = (mirror_body(robot, *pair) for pair in robot.mirrored_wings)
    roots = ((k, robot.bodies[k]) for _, k, _ in _wings(robot))
    others = (k if body.mounted else body.parent for k, body in roots)
    return next((k for k in (*mirrors, *others) if k is not None), -1)


def _span(bodies: Any, strip: Strip) -> Array:
    """Span axis of a strip in the world, (3,) [1]."""
    return np.asarray(bodies[strip.body][1] @ np.cross(strip.normal, strip.forward))


def _edges(bodies: Any, strip: Strip) -> Array:
    """Leading corners of a strip in the world, (2, 3) [m]."""
    return placed(bodies[strip.body], strip_corners(strip)[:2])


def _on_both_sides(robot: Robot, strips: Sequence[Strip]) -> bool:
    """Whether what the innermost joint of a wing turns as a whole lies on both sides of it."""
    bodies, joint = poses(robot), hinge_of(robot, strips[0].body)
    rigid = [_edges(bodies, s) for s in strips if hinge_of(robot, s.body) == joint]
    along = (np.vstack(rigid) - bodies[joint][0]) @ _span(bodies, strips[0])
    near, far = sorted((along.max(), -along.min()))
    return bool(near > BOTH_SIDES * far)


def _turned(robot: Robot, wing: Wing) -> bool:
    """Whether a joint turns the span of a strip of a wing; no joint turns that of a rudder."""
    bodies, strips = poses(robot), [robot.strips[i] for i in wing]
    return any(
        np.linalg.norm(np.cross(bodies[k][1] @ joint.axis, _span(bodies, strip))) > SWEEPS
        for k in _inwards(robot, wing)
        for joint in robot.bodies[k].joints
        for strip in strips
        if joint.kind == "revolute" and k in inwards(robot, strip.body)
    )


def _close(one: _Placed, other: _Placed) -> bool:
    """Whether two wings share a stream: both sweep, or both are held and close from the side."""
    held, points = one[2:]
    apart = np.linalg.norm(points[:, None, ::2] - other[3][:, ::2], axis=-1).min()
    length = min(np.linalg.norm(np.ptp(x, axis=0)) for x in (points, other[3]))
    return bool(held == other[2] and (not held or apart < TANDEM * length))


def _stroke(robot: Robot, base: int, group: list[_Placed]) -> Stroke:
    """Stroke of wings with their hinge and tip, or if held the two edges of each strip."""
    wings, hinges, (held, *_), points = zip(*group, strict=True)
    names = [*(body.name for body in robot.bodies), ""]  # the last is the world
    fixed = tuple((names[k], names[robot.bodies[k].parent]) for k in hinges if not held)
    stroke = Stroke(wings, tuple(k[-1, 1] > k[0, 1] for k in points), names[base], fixed)
    edges = np.vstack(points)[:, 1:]
    across = edges[:, np.ptp(edges, axis=0).argmax()]  # of a fin upward
    ends = [divmod(int(k), 2) for k in (across.argmin(), across.argmax())]
    named = tuple((stroke.strips[k], 2 * side - 1) for k, side in ends if held)
    return replace(stroke, ends=named)


def _wings(robot: Robot) -> Iterator[tuple[Wing, int, float]]:
    """Wings, each with the body at its hinge and its reach spread; parts of one arm are one."""
    parts = list[tuple[Wing, int, float]]()
    for name in robot.wing_names:
        wing = tuple(i for i, strip in enumerate(robot.strips) if strip.wing == name)
        *links, hinge = _inwards(robot, wing)
        offsets = [robot.bodies[k].position for k in links]
        reach = sum(map(np.linalg.norm, [*offsets, robot.strips[wing[-1]].quarter_chord]))
        parts.append((wing, hinge, float(reach)))

    def of_one_arm(one: tuple[Wing, int, float], other: tuple[Wing, int, float]) -> bool:
        hinge, ends = robot.bodies[one[1]], [robot.strips[k[0][-1]].body for k in (one, other)]
        turned = one[1] == other[1] and hinge.parent >= 0 and not hinge.mounted
        return turned and any(a in inwards(robot, b) for a, b in (ends, ends[::-1]))

    for group in _gathered(parts, of_one_arm):
        outwards = sorted(group, key=lambda part: part[2])
        yield sum((wing for wing, *_ in outwards), ()), *outwards[-1][1:]


def _inwards(robot: Robot, wing: Wing) -> list[int]:
    """Bodies from that of a wing's outermost strip inwards to the one that its hinge moves."""
    chain = inwards(robot, robot.strips[wing[-1]].body)
    images = {k for _, k in robot.mirrored_wings}
    carried = [(s.wing in images, inwards(robot, s.body)) for s in robot.strips]
    found = 1
    for n, k in enumerate(chain):
        if robot.bodies[k].joints and len({side for side, on in carried if k in on}) < 2:
            found = n + 1  # what carries wings of both sides is no wing
        if robot.bodies[k].mounted:
            break
    return chain[:found]


class _Moving:
    """Places and velocities of a robot that strokes need.

    Attributes:
        robot: The machine.
        poses: Poses of the bodies in the world.
        wind: Velocity of the air, world axes, mean over the strips, (3, 1) [m/s].
        ground: Height of the ground [m], or None.
    """

    def __init__(self, robot: Robot, q: ca.SX, v: ca.SX, wind: ca.SX, ground: Any) -> None:
        still, world = ca.SX.zeros(3, 1), Pose(ca.SX.zeros(3, 1), ca.SX.eye(3))
        self.robot, self.poses, self.ground = robot, [*body_poses(robot, q), world], ground
        self.wind = ca.sum2(wind) / wind.shape[1]
        self._twists = [*body_velocities(robot, q, v), Twist(still, still)]
        self._places = {name: k for k, name in enumerate([*(b.name for b in robot.bodies), ""])}

    def sizes(self, stroke: Stroke) -> tuple[list[Any], Any]:
        """Length R of each wing that sweeps [m], and area of the circle on their span [m^2]."""
        lengths, roots = [], []
        if stroke.ends:
            ends = [self._end(self.robot.strips[place], side) for place, side in stroke.ends]
            return [], pi * ca.sumsqr(ends[1] - ends[0]) / 4
        left = self.poses[self._places[stroke.base]].rotation[:, 1]
        for wing, (hinge, _) in zip(stroke.wings, stroke.hinges, strict=True):
            strip = self.robot.strips[wing[-1]]
            root = self.poses[self._places[hinge]].position
            roots.append(ca.dot(left, root))
            away = ca.sqrt(ca.sumsqr(quarter_chord(self.poses, strip) - root))
            lengths.append(away + strip.width / 2)
        longest = ca.mmax(ca.vertcat(*lengths))
        between = ca.mmax(ca.vertcat(*roots)) - ca.mmin(ca.vertcat(*roots))
        return lengths, pi * ((len({*stroke.left}) * longest + between) / 2) ** 2

    def others(
        self, stroke: Stroke, means: ca.SX, halves: Sequence[ca.SX], lengths: Sequence[Any]
    ) -> list[ca.SX]:
        """Number of other wings on its side that sweep the sector of each wing, 0 to all [1].

        Their mean directions are those in the axes of what their hinges are fixed to, (3, n) [1].
        """
        count = [ca.SX(0)] * len(halves)
        axes = [self.poses[self._places[fixed]].rotation for _, fixed in stroke.hinges]
        roots = [self.poses[self._places[hinge]].position for hinge, _ in stroke.hinges]
        vectors = [turn @ means[:, k] for k, turn in enumerate(axes)]
        units = [x / smooth_norm(ca.sumsqr(x), _SLIGHT) for x in vectors]
        for j, k in permutations(range(len(halves)), 2):
            if stroke.left[j] == stroke.left[k]:
                apart = smooth_norm(ca.sumsqr(units[j] - units[k]), _SLIGHT)
                apart = apart * (1 + apart**2 / 24 + 3 * apart**4 / 640)  # arc over its chord
                both = halves[j] + halves[k]
                common = smooth_step((both - apart) * both / (4 * halves[j] * halves[k]))
                shift = ca.sumsqr(roots[j] - roots[k]) / ca.fmin(lengths[j], lengths[k]) ** 2
                common *= smooth_step(1.0 - smooth_norm(shift, _SLIGHT))
                squares = halves[j] ** 2, halves[k] ** 2
                count[k] += common * 2 * squares[0] / (squares[0] + squares[1])
        return count

    def _end(self, strip: Strip, side: int) -> ca.SX:
        """Quarter chord at one end of a strip, (3, 1) [m]."""
        half = side * strip.width / 2 * strip_axes(strip)[2]
        return self.poses[strip.body].at(vector(strip.quarter_chord) + half)

    def direction(self, wing: Wing, hinged: tuple[str, str]) -> tuple[ca.SX, ca.SX]:
        """Unit vector from hinge to tip in the axes that the hinge is fixed to, its rate [1/s]."""
        strip = self.robot.strips[wing[-1]]
        hinge, fixed = (self._places[name] for name in hinged)
        axes, turn = self.poses[fixed].rotation, self._twists[fixed].angular
        tip, at_tip = self._moving(strip.body, vector(strip.quarter_chord))
        root, at_root = self._moving(hinge, ca.SX.zeros(3, 1))
        away, velocity = axes.T @ (tip - root), axes.T @ (at_tip - at_root)
        distance = ca.sqrt(ca.sumsqr(away))
        unit, turning = away / distance, (velocity - ca.cross(turn, away)) / distance
        return unit, turning - unit * ca.dot(unit, turning)

    def middle(self, stroke: Stroke) -> tuple[ca.SX, ca.SX]:
        """Mean place [m] and velocity [m/s] of hinges, or strips if held, world axes, (3, 1)."""
        held = [self.robot.strips[i] for i in stroke.strips] if stroke.ends else []
        points = [(self._places[hinge], ca.SX.zeros(3, 1)) for hinge, _ in stroke.hinges]
        points += [(strip.body, vector(strip.quarter_chord)) for strip in held]
        places, velocities = zip(*(self._moving(*point) for point in points), strict=True)
        still = ca.SX.zeros(3, 1)
        return sum(places, still) / len(points), sum(velocities, still) / len(points)

    def _moving(self, body: int, offset: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Place [m] and velocity [m/s] of a point of a body, world axes, (3, 1)."""
        pose = self.poses[body]
        return pose.at(offset), pose.rotation @ self._twists[body].at(offset)


def _relaxation(
    stroke: Stroke,
    moving: _Moving,
    air: AeroExpressions,
    state: ca.SX,
    numbers: tuple[Any, ...],
) -> Relaxation:
    """Relaxation of the induced velocity of a stroke and of its wings' mean directions."""
    density, factor, apparent_mass, memory = numbers
    induced, means = state[:3], ca.reshape(state[3:], 3, -1)
    lengths, circle = moving.sizes(stroke)
    middle, velocity = moving.middle(stroke)
    met = moving.wind - velocity
    halves = [_half_angle(ca.sumsqr(means[:, k])) for k in range(len(stroke.swept))]
    sectors = [half * length**2 for half, length in zip(halves, lengths, strict=True)]
    others = moving.others(stroke, means, halves, lengths)
    swept = sum((area / (1 + more) for area, more in zip(sectors, others, strict=True)), ca.SX(0))
    rates, targets = [], []
    for length, wing, hinge in zip(lengths, stroke.swept, stroke.hinges, strict=False):
        direction, turning = moving.direction(wing, hinge)
        turned = ca.sumsqr(turning) + ca.sumsqr(met) / length**2
        rates.append(ca.repmat(smooth_norm(turned, _SLIGHT) / memory, 3, 1))
        targets.append(direction)
    own, planform = _own_downwash(stroke, moving, air)
    whole, through = induced + own, induced + met
    speed = smooth_norm(ca.sumsqr(through), _SLIGHT)
    along = ca.dot(through, whole) ** 2
    share = along / (smooth_norm(ca.sumsqr(whole), _SLIGHT) * speed) ** 2
    area = circle + (swept - circle) * share if stroke.swept else circle
    force = ca.sum2(air.strip_force[:, list(stroke.strips)])
    still = 1.0 - smooth_step(sum(sectors, ca.SX(0)) / planform)
    force = force - still * ca.dot(force, through) / speed**2 * through
    flow = 2 * density * area * speed
    thrust = ca.sqrt(ca.sumsqr(force) + (_SLIGHT * flow) ** 2)
    if moving.ground is not None:
        height = middle[2] - moving.ground
        factor = factor * (1.0 - ground_share(height, 2 * ca.sqrt(circle / pi)))
    excess = factor * thrust / flow + ca.dot(own, force) / thrust
    wanted = (excess + ca.sqrt(excess**2 + _SLIGHT**2)) / 2
    mass = apparent_mass * density * (area / pi) ** 1.5
    return Relaxation(
        ca.vertcat(ca.repmat(flow / mass, 3, 1), *rates),
        ca.vertcat(-wanted * force / thrust, *targets),
    )


_SLIGHT = 0.01
"""Speed [m/s] and rate [rad/s] within which norms, and the limit to what is there already, are
rounded off: slow enough for large wings in oil and water."""


def _half_angle(square: ca.SX) -> ca.SX:
    """Half of the angle that a direction sweeps, from the squared length of its mean [rad].

    The inverse of sin(a)/a by its series, 2 % at a = pi/2, where it ends.
    """
    short = 1.0 - ca.sqrt(square + 1e-12)
    angle_square = short * (6.0 + short * (1.8 + 0.7 * short))
    most = (pi / 2) ** 2
    bounded = (angle_square + most - ca.sqrt((angle_square - most) ** 2 + 1e-2)) / 2
    return ca.sqrt(smooth_norm(bounded * bounded, 1e-3))


def _own_downwash(stroke: Stroke, moving: _Moving, air: AeroExpressions) -> tuple[ca.SX, ca.SX]:
    """Mean velocity that the model says its wings induce, (3, 1) [m/s], and their area [m^2]."""
    whole, area = ca.SX.zeros(3, 1), ca.SX(0)
    for place in stroke.strips:
        strip = moving.robot.strips[place]
        size = strip.chord * strip.width
        normal = moving.poses[strip.body].rotation @ vector(strip.normal)
        whole, area = whole - size * air.downwash[place] * normal, area + size
    return whole / area, area
