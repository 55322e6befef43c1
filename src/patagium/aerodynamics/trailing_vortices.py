"""Horseshoe vortices: strips of wing that induce velocity on each other.

Each strip carries a bound vortex at its quarter chord and sheds a straight semi-infinite leg
from each end, along the wind relative to that end but at most 45 degrees from the plane across
the span; neighbors share a leg. A lifting line and the networks built on one share the linear
system of the circulations of all strips, and a step of the lag states in which vortices and lags
at its end feel each other. Neglected: what bound vortices induce on their own wing (sweep is in
the section's slope) and in the ground's image, the bending of the wake by its own velocity and by
the motion of long ago, in aspect ratios and the factor of low ones any difference between strips.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from patagium.aerodynamics.ground import GroundPlane
from patagium.aerodynamics.indicial import Lags, Relaxation, lag_relaxation, lag_step
from patagium.aerodynamics.local_flow import (
    StripMotion,
    quarter_chord,
    strip_airflows,
    strip_axes,
    strip_motions,
)
from patagium.aerodynamics.smooth_functions import SWITCH_SPEED, smooth_norm, smooth_sign
from patagium.arrays import Bools
from patagium.dynamics.chain import vector
from patagium.dynamics.kinematics import Pose, Twist, body_poses
from patagium.native import named_function
from patagium.robot.model import Robot, Strip
from patagium.robot.strip_chains import StripChain

SURFACE_CONSTANT = 13.5
"""K of the line-to-surface gain (Izraelevitz, Zhu and Triantafyllou 2017)."""


def surface_gains(numbers: Robot, robot: Robot, constant: Any) -> list[Any]:
    """Lift of a lifting surface over that of a lifting line, for every strip."""
    gains = []
    for span, area in spans_and_areas(numbers, robot):
        ratio = span * span / area
        line = 1 / (2 * pi) + 1 / (pi * ratio)
        gains.append(line / (line + constant * pi / (180 * ratio * ratio)))
    return gains


def spans_and_areas(numbers: Robot, robot: Robot) -> list[tuple[Any, Any]]:
    """Span [m] and area [m^2] of the wing that each strip is of.

    That of all wings that a lifting line runs through, with their mirror image.
    """
    whole = {strip.wing: strip.wing for strip in numbers.strips}
    for pair in (pair for pair in numbers.joined_wings if {*pair} <= whole.keys()):
        one, other = (whole[wing] for wing in pair)
        whole = {wing: one if name == other else name for wing, name in whole.items()}
    images = {*numbers.mirrored_wings, *(pair[::-1] for pair in numbers.mirrored_wings)}
    both = [(whole[a], whole[b]) for a, b in images if {a, b} <= whole.keys()]
    twins = {one for one, other in both if one != other}
    sizes = {}
    for name in dict.fromkeys(whole.values()):
        own = [strip for strip in robot.strips if whole[strip.wing] == name]
        span = sum((strip.width for strip in own), ca.SX(0))
        area = sum((strip.width * strip.chord for strip in own), ca.SX(0))
        sides = 2 if name in twins else 1
        sizes[name] = sides * span, sides * area
    return [sizes[whole[strip.wing]] for strip in robot.strips]


CORE = 0.125
"""Core radius of a leg over the mean width of its strips: a quarter of their half width."""

INSET = 0.125
"""How far a leg at a free end starts inside of it, over the width of a narrow strip.

The circulation near a tip grows as the square root of the distance; with this inset the
error of strips of equal circulation falls with the power 3/2 of their width, not the first.
"""

MOST_INDUCED = 4.0
"""Largest velocity that trailing vortices induce over that which drives them, norms over strips.
Where neighbors meet the wind from opposite sides, their equations pass through a singularity."""

NEAR = 1e-12
"""Added to squared distances, in squared core radii: no division by zero."""


@dataclass(frozen=True)
class Lattice:
    """Places of strips and legs, in the axes of the floating body (or the world's).

    Strips in the order of `robot.strips`, legs in that of the chains.

    Attributes:
        points: Quarter-chord points, (3, n) [m].
        normals: Unit vectors out of the upper surface, (3, n) [-].
        forwards: Unit vectors to the leading edge, (3, n) [-].
        edges: Where legs begin, (3, m) [m].
        directions: Directions of the legs, (3, m) [-]; of unit length but near rest.
        core_squares: Squared core radii, (m, 1) [m^2].
        shares: Length of each bound vortex, from leg to leg, over the strip's width, (n, 1) [-].
        slopes: Way of the quarter-chord line forward over that along normal x forward, (n, 1) [-].
    """

    points: ca.SX
    normals: ca.SX
    forwards: ca.SX
    edges: ca.SX
    directions: ca.SX
    core_squares: ca.SX
    shares: ca.SX
    slopes: ca.SX

    @property
    def cosines(self) -> ca.SX:
        """Cosine of the sweep angle of the quarter-chord line at each strip, (n, 1) [-]."""
        return 1.0 / ca.sqrt(1.0 + self.slopes**2)


def _lattice(
    robot: Robot, chains: Sequence[StripChain], q: ca.SX, v: ca.SX, wind: ca.SX
) -> Lattice:
    """Strips and legs of a moving robot; arguments of `vortex_system`."""
    poses = body_poses(robot, _from_floating_body(robot, q))
    airflows = strip_airflows(robot, q, v, wind)
    strips = robot.strips
    legs = [leg for chain in chains for leg in _legs(robot, chain, poses, airflows)]
    return Lattice(
        points=ca.horzcat(*[quarter_chord(poses, s) for s in strips]),
        normals=ca.horzcat(*[poses[s.body].rotation @ vector(s.normal) for s in strips]),
        forwards=ca.horzcat(*[poses[s.body].rotation @ vector(s.forward) for s in strips]),
        edges=ca.horzcat(*[leg[0] for leg in legs]),
        directions=ca.horzcat(*[leg[1] for leg in legs]),
        core_squares=ca.vertcat(*[leg[2] for leg in legs]),
        shares=_shares(robot, chains),
        slopes=_slopes(robot, chains),
    )


def _from_floating_body(robot: Robot, q: ca.SX) -> ca.SX:
    """Coordinates with the floating body at the world's origin, if there is one and only one."""
    alone = robot.bodies[0].floating_dofs == robot.floating_dofs
    held = robot.floating_coordinates(robot.bodies[0]) if alone else ()
    origin = robot.coordinates()
    return ca.vertcat(*[ca.SX(origin[i]) if i in held else q[i] for i in range(len(origin))])


def _ground_plane(robot: Robot, q: ca.SX, ground: ca.SX) -> GroundPlane | None:
    """Ground in the axes of the lattice; None without one."""
    if not ground.numel():
        return None
    world, own = (body_poses(robot, x)[0] for x in (q, _from_floating_body(robot, q)))
    normal = own.rotation @ world.rotation[2, :].T
    return GroundPlane(normal, ground[0] - world.position[2] + ca.dot(normal, own.position))


def _shares(robot: Robot, chains: Sequence[StripChain]) -> ca.SX:
    """Length of each bound vortex over its strip's width, (n, 1)."""
    shares = ca.SX.ones(len(robot.strips), 1)
    for chain in chains:
        for index in (chain.strips[0], chain.strips[-1]):
            strip = robot.strips[index]
            shares[index] = shares[index] - _inset(strip) / strip.width
    return shares


def _inset(strip: Strip) -> Any:
    """Distance of a leg inside of a free end: half a chord for a wide strip [m]."""
    ratio = strip.width / (4 * strip.chord)
    return INSET * strip.width / ca.sqrt(1.0 + ratio * ratio)


def _legs(
    robot: Robot, chain: StripChain, poses: Sequence[Pose], airflows: Sequence[Twist]
) -> list[tuple[ca.SX, ca.SX, ca.SX]]:
    """Beginning, direction and squared core radius of a chain's legs."""
    strips = [robot.strips[i] for i in chain.strips]
    ends = [_end_offsets(robot, chain, k) for k in range(len(strips))]
    legs = []
    for k in range(len(strips) + 1):
        # the leg at the end of the strip before it and at the beginning of the strip after it
        sides = [(i, ends[i][k - i]) for i in (k - 1, k) if 0 <= i < len(strips)]
        core = CORE * sum(strips[i].width for i, _ in sides) / len(sides)
        edge, velocity = ca.SX.zeros(3, 1), ca.SX.zeros(3, 1)
        span = ca.SX.zeros(3, 1)
        for i, offset in sides:
            strip = strips[i]
            span = span + poses[strip.body].rotation @ (strip_axes(strip)[2] * chain.right[i])
            edge = edge + poses[strip.body].at(offset) / len(sides)
            local = airflows[chain.strips[i]].at(offset)
            velocity = velocity + poses[strip.body].rotation @ local / len(sides)
        velocity = _across(velocity, span)
        direction = -velocity / smooth_norm(ca.dot(velocity, velocity))
        legs.append((edge, direction, ca.SX(core * core)))
    return legs


def _across(velocity: ca.SX, span: ca.SX) -> ca.SX:
    """Velocity whose part along the span is never greater than that across it, (3, 1) [m/s].

    A leg that ran along the wing would pass through the next strips, where it is no trailing
    vortex and may feed what makes it. With the tangent t of the angle between velocity and the
    plane across the span, the part along it is divided by (1 + t^4)^(1/4): by 1.0002 at 10
    degrees, 1.19 at 45.
    """
    along = span * (ca.dot(span, velocity) / (ca.dot(span, span) + NEAR))
    across = velocity - along
    square = smooth_norm(ca.dot(across, across)) ** 2
    return across + along * ca.sqrt(square / ca.sqrt(square**2 + ca.dot(along, along) ** 2))


def _end_offsets(robot: Robot, chain: StripChain, k: int) -> tuple[ca.SX, ca.SX]:
    """Beginnings of the legs of a strip, body axes, (3, 1) each [m]; inside of a free end."""
    strip, (before, after) = robot.strips[chain.strips[k]], _line(robot, chain, k)
    center, inset = vector(strip.quarter_chord), 2 * _inset(strip)
    begin = strip.width - (inset if k == 0 else 0.0)
    end = strip.width - (inset if k == len(chain.strips) - 1 else 0.0)
    return center - before * begin, center + after * end


def _line(robot: Robot, chain: StripChain, k: int) -> tuple[ca.SX, ca.SX]:
    """Line through the quarter chords of neighbors on the same body, over a strip's width.

    Pieces of a flexible body, unbent, and bodies that are fixed to each other are one. It goes on
    beyond the last neighbor. Half of it before the strip's middle and half after it, body axes,
    (3, 1) each [-].
    """
    strips = [robot.strips[i] for i in chain.strips]
    strip = strips[k]
    alone = vector(np.cross(strip.forward, strip.normal) * chain.right[k]) / 2
    forward, (own, place) = vector(strip.forward), _fixed_to(robot, strip.body)
    slopes: dict[int, ca.SX] = {}
    for side, i in ((-1, k - 1), (1, k + 1)):
        if not 0 <= i < len(strips):
            continue
        away, (base, pose) = vector(strips[i].quarter_chord), _fixed_to(robot, strips[i].body)
        step, widths = away - vector(strip.quarter_chord), strip.width + strips[i].width
        if strips[i].body == strip.body:
            slopes[side] = step * side / widths
        elif base == own and strips[i].wing == strip.wing:
            step = pose.at(away) - place.at(vector(strip.quarter_chord))
            along = ca.dot(place.rotation @ forward, step)
            slopes[side] = alone + forward * along * side / widths
    before = slopes.get(-1, slopes.get(1, alone))
    return before, slopes.get(1, slopes.get(-1, alone))


def _fixed_to(robot: Robot, body: int) -> tuple[int, Pose]:
    """Body that a body is fixed to, or of which it is a piece, and its pose there, unbent."""
    place, axes, one = ca.SX.zeros(3, 1), ca.SX.eye(3), robot.bodies[body]
    while one.piece or not (one.joints or one.floating_dofs or one.mounted or one.parent < 0):
        turn = ca.DM(np.array(one.orientation, float))
        place, axes = vector(one.position) + turn @ place, turn @ axes
        body = one.parent
        one = robot.bodies[body]
    return body, Pose(place, axes)


def _slopes(robot: Robot, chains: Sequence[StripChain]) -> ca.SX:
    """Way of the quarter-chord line forward over that along normal x forward, (n, 1) [-]."""
    slopes = ca.SX.zeros(len(robot.strips), 1)
    for chain in chains:
        strips = [robot.strips[i] for i in chain.strips]
        for k, index in enumerate(chain.strips):
            forward, _, span = strip_axes(strips[k])
            line = sum(_line(robot, chain, k), ca.SX(0))
            slopes[index] = ca.dot(line, forward) / ca.dot(line, span)
    return slopes


@functools.cache
def horseshoe_function(sizes: tuple[int, ...], images: bool = False) -> ca.Function:
    """Circulation of chains of strips, and the velocity that their vortices induce.

    A leg that begins at E and goes along the unit vector d gives a point at r = p - E
        K = d x r (1 + d.r/|r|) / (4 pi |d x r|^2)
    for unit circulation along d (a polynomial within its core), without d.r/|r| on strips of its
    own chain: there, each strip has its legs begin abreast of it, since without the wind of bound
    vortices on their own wing, which is left out, a swept wing has no solution that strips
    converge to. On strips of other chains the bound vortex from the beginning E of one leg to
    that of the next, at r and s = r - L, gives
        B = r x s (r/|r| - s/|s|).L / (4 pi (|r x s|^2 + core^2 |L|^2)),
    where core^2 is the mean of those of the two legs, which a mirror image swaps.
    With the circulation c_i of strip i along the chain, leg k carries c_(k-1) - c_k, and
        c_i = gain_i (wash_i + feedthrough n_i . (sum_k K_ki (c_(k-1) - c_k) + sum_j B_ji c_j)).
    One call in compiled code: `kernels/horseshoes.h`.

    Args:
        sizes: Strips of each chain.
        images: Whether the second half of the chains are images of the first half in the ground,
            whose bound vortices are left out as those of the own wing are.

    Returns:
        (points (3, n) [m], normals (3, n), edges (3, m) [m], directions (3, m),
        core_squares (m,) [m^2], gain (n,) [m], wash (n,) [m/s], feedthrough)
        -> (circulation (n,) [m^2/s], velocity (3, n) [m/s]).
    """
    count, legs, wings = sum(sizes), sum(sizes) + len(sizes), len(sizes) // (1 + images)
    shapes = {
        **{"points": (3, count), "normals": (3, count)},
        **{"edges": (3, legs), "directions": (3, legs), "core_squares": (legs, 1)},
        **{"gain": (count, 1), "wash": (count, 1), "feedthrough": (1, 1)},
    }
    inputs = {name: ca.SX.sym(name, *shape) for name, shape in shapes.items()}
    points, normals, edges, directions, core_squares, gain, wash, feedthrough = inputs.values()
    chain = np.repeat(np.arange(len(sizes)), sizes)
    first = np.arange(count) + chain  # leg at which each strip begins
    # which strips' circulation each leg carries: + of the one before, - of the one after
    carried = np.zeros((legs, count))
    carried[first, range(count)], carried[first + 1, range(count)] = -1.0, 1.0
    apart = np.repeat(np.arange(len(sizes)), np.array(sizes) + 1)[:, None] != chain
    influence = _influence(points, edges, directions, core_squares, apart)
    strange = chain[:, None] % wings != chain % wings
    bound = _bound_influence(points, edges, core_squares, first.tolist(), strange)
    carries = ca.sparsify(ca.DM(carried))
    by_strip = [k.T @ carries + one.T for k, one in zip(influence, bound, strict=True)]
    normalwash = ca.SX(0)
    for axis, one in enumerate(by_strip):
        normalwash += one * ca.repmat(normals[axis, :].T, 1, count)
    matrix = ca.SX.eye(count) - ca.diag(gain * feedthrough) @ normalwash
    circulation = _solve(ca.densify(matrix), gain * wash)
    velocity = ca.vertcat(*[(one @ circulation).T for one in by_strip])
    name = "_".join(["horseshoes", *map(str, (wings, *sizes))])
    outputs = {"circulation": circulation, "velocity": ca.densify(velocity)}
    return named_function(name, inputs, outputs, never_inline=True)


Vectors: TypeAlias = list[ca.SX]
"""x, y and z of vectors, each a matrix whose columns are those of strips."""


def _influence(
    points: ca.SX, edges: ca.SX, directions: ca.SX, core_squares: ca.SX, apart: Bools
) -> Vectors:
    """K for every leg (row) and strip (column), (m, n) each [1/m]; `apart` are other chains'."""
    count = points.shape[1]
    d = [ca.repmat(directions[axis, :].T, 1, count) for axis in range(3)]
    r = _from(edges, points)
    core = ca.repmat(core_squares, 1, count)
    across = _crossed(d, r)
    distance = _dot(across, across)
    square = _dot(r, r) + NEAR * core
    e = ca.fmin(distance / core, 1.0) - 1.0
    inverse = 1.0 / ca.fmax(distance, core) - e * (1.0 - e * (1.0 - e)) / core
    ahead = ca.sparsify(ca.DM(apart.astype(float))) * _dot(d, r) / ca.sqrt(square)
    strength = inverse * (1.0 + ahead) / (4 * pi)
    return [component * strength for component in across]


def _bound_influence(
    points: ca.SX, edges: ca.SX, core_squares: ca.SX, begins: list[int], strange: Bools
) -> Vectors:
    """B for every strip's bound vortex (row) and strip (column), (n, n) each [1/m]."""
    count = points.shape[1]
    ends = [k + 1 for k in begins]
    r, s = _from(edges[:, begins], points), _from(edges[:, ends], points)
    length = [ca.repmat((edges[a, ends] - edges[a, begins]).T, 1, count) for a in range(3)]
    core = ca.repmat((core_squares[begins] + core_squares[ends]) / 2, 1, count)
    across = _crossed(r, s)
    near = [ca.sqrt(_dot(x, x) + NEAR * core) for x in (r, s)]
    along = _dot(r, length) / near[0] - _dot(s, length) / near[1]
    square = _dot(across, across) + core * _dot(length, length)
    strength = ca.sparsify(ca.DM(strange.astype(float))) * along / square / (4 * pi)
    return [component * strength for component in across]


def _from(begins: ca.SX, points: ca.SX) -> Vectors:
    """From every beginning (row) to every point (column) [m]."""
    m, n = begins.shape[1], points.shape[1]
    return [ca.repmat(points[a, :], m, 1) - ca.repmat(begins[a, :].T, 1, n) for a in range(3)]


def _crossed(a: Vectors, b: Vectors) -> Vectors:
    return [a[i] * b[j] - a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1))]


def _dot(a: Vectors, b: Vectors) -> ca.SX:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _solve(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Solution of a linear system by Gaussian elimination without pivots, (n, 1)."""
    size = matrix.shape[0]
    table = ca.horzcat(matrix, right)
    for p in range(size - 1):
        factor = table[p + 1 :, p] / table[p, p]
        table[p + 1 :, p + 1 :] = table[p + 1 :, p + 1 :] - factor @ table[p, p + 1 :]
    x = ca.SX.zeros(size, 1)
    for p in reversed(range(size)):
        known = table[p, p + 1 : size] @ x[p + 1 :] if p + 1 < size else ca.SX(0)
        x[p] = (table[p, size] - known) / table[p, p]
    return x


@dataclass(frozen=True)
class VortexSystem:
    """Strips of a robot, how they move and the trailing vortices they share.

    Attributes:
        chains: Strips that share trailing vortices, chain by chain.
        lattice: Places of strips and vortices.
        motions: Motion of each strip relative to the air, n.
        ground: Ground in the axes of the lattice, in which all strips have mirror images; None:
            there is none.
    """

    chains: Sequence[StripChain]
    lattice: Lattice
    motions: Sequence[StripMotion]
    ground: GroundPlane | None = None


def vortex_system(
    robot: Robot,
    chains: Sequence[StripChain],
    motion: tuple[ca.SX, ca.SX, ca.SX],
    ground: ca.SX,
) -> VortexSystem:
    """Strips of a moving robot and their trailing vortices.

    Args:
        robot: The machine.
        chains: Chains of strips that share legs.
        motion: q, v and the wind, world axes, (3,) or (3, n_strips) [m/s].
        ground: Height of the ground, (1,) [m]; empty: there is none.
    """
    net, motions = _lattice(robot, chains, *motion), strip_motions(robot, *motion)
    return VortexSystem(chains, net, motions, _ground_plane(robot, motion[0], ground))


@dataclass(frozen=True)
class Normalwash:
    """Normal velocities of the air at the strips of a lifting line, (n, 1) each [m/s].

    Attributes:
        effective: Of the undisturbed wind at three quarters of the chord and of the wind
            induced by the trailing vortices.
        lagged: What the lift answers to, phi(0) effective + sum_k a_k z_k.
        circulation: Bound circulation along forward x normal [m^2/s].
        induced: Velocity induced by the trailing vortices, lattice axes, (3, n) [m/s].
    """

    effective: ca.SX
    lagged: ca.SX
    circulation: ca.SX
    induced: ca.SX


def solve_normalwash(
    vortices: VortexSystem, geometric: ca.SX, state: ca.SX, lags: Lags, lift_slope: Any
) -> Normalwash:
    """Normalwashes of all strips; linear in the geometric ones and the state up to `MOST_INDUCED`.

    Args:
        vortices: Strips and their trailing vortices.
        geometric: Undisturbed normalwash of each strip, (n, 1) [m/s].
        state: Lags strip by strip, (n_z, 1) [m/s].
        lags: Numbers of the memory.
        lift_slope: Lift slope of a section, or of each strip in turn [1/rad].
    """
    strips = range(len(vortices.motions))
    bound = [
        lags.first_circulation * geometric[i] + lags.lagged(lags.circulation, state, i)
        for i in strips
    ]
    feedthrough = lags.first_circulation
    signed, induced = _induced(vortices, bound, 1.0, feedthrough, lift_slope)
    driving = ca.sumsqr(geometric) + ca.sumsqr(state[: len(bound) * len(lags.rate)])
    most = MOST_INDUCED**2 * (driving + SWITCH_SPEED**2)
    share = 1.0 / ca.sqrt(ca.fmax(1.0, ca.sumsqr(induced) / most))
    signed, induced = share * signed, share * induced
    effective = geometric + ca.sum1(vortices.lattice.normals * induced).T
    lagged = [lags.first_lift * effective[i] + lags.lagged(lags.lift, state, i) for i in strips]
    return Normalwash(effective, ca.vertcat(*lagged), signed, induced)


def implicit_lag_step(
    vortices: VortexSystem,
    geometric: ca.SX,
    state: ca.SX,
    step: Any,
    before: Relaxation,
    lags: Lags,
    lift_slope: Any,
) -> tuple[ca.SX, ca.SX]:
    """Lags one step later and the effective normalwashes there, found together.

    The step of `lag_step` in which lags and vortices at its end feel each other: still one
    linear system, and where the vortices turn the flow against what makes them, bounded at
    any step.

    Args:
        vortices: Strips and their trailing vortices at the end of the step.
        geometric: Undisturbed normalwash of each strip there, (n, 1) [m/s].
        state: Lags strip by strip at the beginning, (n_z, 1) [m/s].
        step: Length of the step [s].
        before: Relaxation of the lags at the beginning.
        lags: Numbers of the memory.
        lift_slope: Lift slope of a section [1/rad].

    Returns:
        Lags, (n_z, 1) [m/s], and effective normalwashes, (n, 1) [m/s], at the end.
    """
    motions = vortices.motions
    count, still = len(lags.rate), ca.SX.zeros(len(motions), 1)
    after = lag_relaxation(motions, still, lags)
    fixed = lag_step(state, step, before, after)
    unit = Relaxation(before.rate, 0 * before.target), Relaxation(after.rate, 1 + after.target)
    share = lag_step(0 * state, step, *unit)  # of the effective normalwash at the end
    bound, feedthrough = [], []
    for i in range(len(motions)):
        through = lags.first_circulation + lags.lagged(lags.circulation, share, i)
        held = lags.lagged(lags.circulation, fixed, i)
        feedthrough.append(through)
        bound.append(geometric[i] + held / through)
    _, induced = _induced(vortices, bound, feedthrough, 1.0, lift_slope)
    effective = geometric + ca.sum1(vortices.lattice.normals * induced).T
    reached = fixed + share * ca.vec(ca.repmat(effective.T, count, 1))
    return reached, effective


def _induced(
    vortices: VortexSystem,
    bound: Sequence[Any],
    shares: Any,
    feedthrough: Any,
    lift_slope: Any,
) -> tuple[ca.SX, ca.SX]:
    """Circulation along forward x normal, (n, 1), and velocity induced, (3, n).

    c = 1/2 chord a0 share (bound + feedthrough n . induced) of each strip.
    """
    chains, net, motions = vortices.chains, vortices.lattice, vortices.motions
    sizes = tuple(len(chain.strips) for chain in chains)
    order = [i for chain in chains for i in chain.strips]
    right = [sign for chain in chains for sign in chain.right]
    gain = []
    for i, along in zip(order, right, strict=True):
        sign = along * smooth_sign(motions[i].forward)
        share = shares[i] if isinstance(shares, list) else shares
        slope = lift_slope[i] if isinstance(lift_slope, list) else lift_slope
        gain.append(sign * motions[i].strip.chord * slope * net.cosines[i] / 2 * share)
    given = [
        *(net.points[:, order], net.normals[:, order]),
        *(net.edges, net.directions, net.core_squares),
        *(ca.vertcat(*gain), ca.vertcat(*[bound[i] for i in order])),
    ]
    if vortices.ground is not None:
        sizes, given = 2 * sizes, _with_images(vortices.ground, given)
    circulation, induced = horseshoe_function(sizes, vortices.ground is not None)(
        *given, feedthrough
    )
    of_strip = [order.index(i) for i in range(len(order))]
    signed = [circulation[k] * right[k] for k in of_strip]
    return ca.vertcat(*signed), induced[:, of_strip]


def _with_images(ground: GroundPlane, given: Sequence[ca.SX]) -> list[ca.SX]:
    """Arguments of `horseshoe_function` for wings and their mirror images in the ground.

    A mirror turns the sense of a vortex: an image has the opposite circulation, which the
    opposite gain gives, and its normalwash is that of the wing.
    """
    points, normals, edges, directions, core_squares, gain, bound = given
    images = [
        *(ground.image(points), ground.turned(normals)),
        *(ground.image(edges), ground.turned(directions)),
        *(core_squares, -gain, bound),
    ]
    return [
        ca.horzcat(one, image) if k < 4 else ca.vertcat(one, image)
        for k, (one, image) in enumerate(zip(given, images, strict=True))
    ]


def attached_lift(
    vortices: VortexSystem,
    wash: Normalwash,
    strip: int,
    gain: Any,
    pressure: Any,
    ahead: Any,
) -> tuple[Any, Any, Any]:
    """Lift of attached flow along the strip's forward and normal axes and along their span [N].

    L = pressure W, perpendicular to the quarter-chord line and to the wind at the force:
    undisturbed, induced by all legs, and by the wake shed across the span, (W - w_e) along the
    lift. Induced drag is the tilt. Suction at a swept edge pulls along the span too, and wind
    along the span lifts a swept line.

    Args:
        vortices: Strips and their trailing vortices.
        wash: Normalwashes of all strips.
        strip: Index of the strip.
        gain: Lift of the lifting surface over that of the line.
        pressure: Lift per normalwash, 1/2 rho c ds a0 U [N s/m].
        ahead: Where the force acts, ahead of the quarter chord [m].
    """
    motion, net = vortices.motions[strip], vortices.lattice
    forward, sign, slope = motion.forward, smooth_sign(motion.forward), net.slopes[strip]
    normal = motion.normal_ahead(ahead)
    speed = smooth_norm(forward * forward + normal * normal)
    shed = sign * (wash.lagged[strip] - wash.effective[strip]) / speed
    induced = wash.induced[:, strip]
    wind_forward = -forward + gain * ca.dot(net.forwards[:, strip], induced) - shed * normal
    wind_normal = -normal + gain * ca.dot(net.normals[:, strip], induced) + shed * forward
    wind = smooth_norm(wind_forward * wind_forward + wind_normal * wind_normal)
    swept = net.cosines[strip] * net.shares[strip]
    lift = sign * gain * swept * pressure * wash.lagged[strip] / wind
    across = slope * motion.spanwise_ahead(ahead) + wind_forward
    return lift * wind_normal, -lift * across, -slope * lift * wind_normal
