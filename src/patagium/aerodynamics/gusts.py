"""Gusts: velocity of the air as a function of time, everywhere or as a field that travels.

Discrete gusts (one minus cosine, ramp) and continuous turbulence (Dryden) are functions of time
alone: the same answer whatever the time step that asks. A `TravelingGust` sweeps over the
robot: each point of a wing meets it at its own time (Taylor's hypothesis), strip after strip,
and along the chord from the edge that meets it first. A section answers to two averages over
its chord, as thin airfoils do, whatever the direction the gust comes from; both are found here
in closed form for a gust that is a cubic between knots. Where a chord is in the gust depends on
the state (`strip_delays`); what is there is looked up between. On its way it may decay as an
exponential of time. Neglected: what the wing does to the gust, how large vortices outlive small
ones, the width of strips along the span.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, exp, floor, inf, sqrt
from typing import Any, ClassVar, Protocol, runtime_checkable

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics.local_flow import strip_motions
from patagium.aerodynamics.named_descriptions import (
    check_keys,
    field_values,
    from_field_values,
    from_named_description,
)
from patagium.aerodynamics.smooth_functions import smooth_sign
from patagium.arguments import check_fields
from patagium.arrays import Array, Indices, brief, equal, real_array, rising
from patagium.dynamics.chain import vector
from patagium.dynamics.kinematics import body_poses, body_velocities
from patagium.errors import ParameterError, check_names, positive
from patagium.robot.model import Robot

STEPS_PER_LENGTH = 50
"""Samples of Dryden turbulence in the time the shortest length scale takes to pass."""

STEPS_PER_DECAY = 8
"""Cubics that stand for the time in which a gust decays to 1/e: to 2e-7 of its velocity."""

SHORTEST_DECAY = 0.001
"""Least time in which a gust decays to 1/e [s]: shorter ones end before they arrive."""

PIECES = 32
"""Cubics that stand for one minus cosine where it travels: to 2e-6 of its velocity."""


@runtime_checkable
class Gust(Protocol):
    """Velocity of the air added to the steady wind."""

    def velocity_at(self, time: Array) -> Array:
        """Velocity, world axes, (N, 3) [m/s], at times (N,) [s]."""

    def describe(self) -> dict[str, Any]:
        """Description from which the object can be made again, as JSON-able values."""


@runtime_checkable
class Profile(Gust, Protocol):
    """A gust that can travel: between its knots a cubic in time."""

    def knots(self, first: float, last: float) -> Array:
        """Times between which the velocity is as good as a cubic, (K >= 2,) ascending [s].

        Before the first and after the last one it is constant, at least from `first` to `last`.

        Args:
            first: Earliest time that will be asked for [s].
            last: Latest time that will be asked for [s].
        """


class NamedGust:
    """Gust that describes itself by its name and its fields."""

    name: ClassVar[str] = ""

    def describe(self) -> dict[str, Any]:
        """Description from which the gust can be made again, as JSON-able values."""
        return {"name": self.name, **field_values(self)}


@dataclass(frozen=True)
class DiscreteGust(NamedGust):
    """A gust of one shape in time: a velocity times a share that depends on (t - start)/T.

    Arguments and errors are those of `OneMinusCosineGust`.
    """

    velocity: tuple[float, float, float]
    start: float
    length_time: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "velocity", triple("velocity", self.velocity))
        check_fields(self)
        positive("length_time", self.length_time)

    def share(self, phase: Array) -> Array:
        """Share of the largest velocity, (N,), at phases (t - start)/T within 0 to 1, (N,)."""
        raise NotImplementedError

    def velocity_at(self, time: Array) -> Array:
        """Velocity of the gust, world axes, (N, 3) [m/s], at times (N,) [s]."""
        phase = np.clip((time - self.start) / self.length_time, 0.0, 1.0)
        return np.outer(self.share(phase), self.velocity)


@dataclass(frozen=True)
class OneMinusCosineGust(DiscreteGust):
    """One smooth gust, w(t) = W/2 (1 - cos(2 pi (t - start)/T)) for 0 <= t - start <= T.

    Args:
        velocity: Largest velocity W, world axes, (3,) [m/s].
        start: Time when it begins [s].
        length_time: Time it lasts, T [s].

    Raises:
        ParameterError: If a number is not finite or T not positive.
        ShapeError: If `velocity` is not (3,).

    References:
        MIL-F-8785C, section 3.7.1.3.
    """

    name = "one_minus_cosine"

    def share(self, phase: Array) -> Array:
        """Share of the largest velocity, (N,), at phases (t - start)/T within 0 to 1, (N,)."""
        return 0.5 * (1.0 - np.cos(2 * np.pi * phase))

    def knots(self, first: float, last: float) -> Array:
        """Times between which the velocity is as good as a cubic, (K,) [s]."""
        return self.start + self.length_time * np.linspace(0.0, 1.0, PIECES + 1)


@dataclass(frozen=True)
class RampGust(DiscreteGust):
    """An edge: w grows evenly from zero to W while 0 <= t - start <= T, and stays.

    The sharp-edged gust of textbooks is one whose T is short beside the time it takes to
    pass a chord.

    Args:
        velocity: Velocity W behind the edge, world axes, (3,) [m/s].
        start: Time when it begins [s].
        length_time: Time it grows, T [s].

    Raises:
        ParameterError: If a number is not finite or T not positive.
        ShapeError: If `velocity` is not (3,).
    """

    name = "ramp"

    def share(self, phase: Array) -> Array:
        """Share of the largest velocity, (N,), at phases (t - start)/T within 0 to 1, (N,)."""
        return phase

    def knots(self, first: float, last: float) -> Array:
        """Times between which the velocity is as good as a cubic, (K,) [s]."""
        return self.start + np.array([0.0, self.length_time])


@dataclass(frozen=True)
class GustSum(NamedGust):
    """Several gusts at once, each the same everywhere.

    Args:
        gusts: The gusts.
    """

    gusts: tuple[Gust, ...]

    name = "sum"

    def velocity_at(self, time: Array) -> Array:
        """Velocity of all gusts together, world axes, (N, 3) [m/s], at times (N,) [s]."""
        return sum((gust.velocity_at(time) for gust in self.gusts), np.zeros((len(time), 3)))


@dataclass(frozen=True)
class DrydenGust(NamedGust):
    """Continuous turbulence: white noise through the Dryden shaping filters.

    Along x   H = s sqrt(2 T) / (1 + T iw),            T = L/U,
    along y, z H = s sqrt(T) (1 + sqrt(3) T iw) / (1 + T iw)^2,
    driven by noise of unit two-sided density, so that each variance is s^2. The
    filters are discretized exactly on a fixed grid of `STEPS_PER_LENGTH` steps in the
    shortest T and read off linearly in between; motion faster than a step is missing.

    Args:
        intensity: Standard deviation s along world x, y, z, (3,) [m/s].
        length_scale: Length scale L along x, y, z, (3,) [m].
        airspeed: Speed U at which the robot meets the frozen turbulence [m/s].
        seed: Seed of the noise.

    Raises:
        ParameterError: If a number is negative (intensity) or not positive (the others).
        ShapeError: If a triple is not (3,).

    References:
        MIL-F-8785C, section 3.7.2.
    """

    intensity: tuple[float, float, float]
    length_scale: tuple[float, float, float]
    airspeed: float
    seed: int

    name = "dryden"

    def __post_init__(self) -> None:
        object.__setattr__(self, "intensity", triple("intensity", self.intensity))
        object.__setattr__(self, "length_scale", triple("length_scale", self.length_scale))
        check_fields(self)
        if min(self.intensity) < 0:
            raise ParameterError("intensity", "three numbers >= 0 [m/s]", self.intensity)
        positive("length_scale", min(self.length_scale))
        positive("airspeed", self.airspeed)

    @property
    def step(self) -> float:
        """Time between two samples of the turbulence [s]."""
        return min(self.length_scale) / self.airspeed / STEPS_PER_LENGTH

    def velocity_at(self, time: Array) -> Array:
        """Velocity of the turbulence, world axes, (N, 3) [m/s], at times (N,) [s].

        What was before time zero is the same process run backward from there.
        """
        latest, earliest = (time.max(), time.min()) if time.size else (0.0, 0.0)
        count = ceil(max(latest, 0.0) / self.step) + 2
        before = ceil(max(-earliest, 0.0) / self.step)
        noise = np.random.default_rng(self.seed).standard_normal((count, 3, 2))
        past = np.random.default_rng([self.seed, 1]).standard_normal((before, 3, 2))
        grid = self.step * np.arange(-before, count)
        units = [self._unit(axis, noise[:, axis], past[:, axis]) for axis in range(3)]
        pairs = zip(self.intensity, units, strict=True)
        return np.stack([np.interp(time, grid, size * unit) for size, unit in pairs], axis=-1)

    def knots(self, first: float, last: float) -> Array:
        """Times between which the velocity is a straight line, (K,) [s]."""
        places = np.arange(floor(first / self.step), ceil(last / self.step) + 2)
        return np.asarray(self.step * places)

    def _unit(self, axis: int, noise: Array, past: Array) -> Array:
        """Stationary turbulence of unit variance along an axis, (before + count,) [1].

        It filters white noise: `noise`, (count, 2), from time zero on, and `past`, (before, 2),
        which runs backward from time zero.
        """
        step = self.step * self.airspeed / self.length_scale[axis]
        decay = exp(-step)
        if axis == 0:
            drive = sqrt(1.0 - decay**2) * noise[:, 0]
            drive[0] = noise[0, 0]
            behind = np.append(drive[0], sqrt(1.0 - decay**2) * past[:, 0])
            return np.append(_recursion(decay, behind)[:0:-1], _recursion(decay, drive))
        return _transverse(step, decay, noise, past)


def _transverse(step: float, decay: float, noise: Array, past: Array) -> Array:
    """Unit turbulence across the flow: two lags in a row, stationary from the start.

    In time units of T: dx = -x + n, dy = -y + x, output sqrt(3) x + (1 - sqrt(3)) y,
    n of unit density. Stationary covariance C of (x, y): [[1/2, 1/4], [1/4, 1/4]]. Backward
    in time C^-1 (x, y) is two lags in a row too, y first.
    """
    stationary = np.array([[0.5, 0.25], [0.25, 0.25]])
    drive = noise @ _added_root(step, decay, stationary).T
    drive[0] = np.linalg.cholesky(stationary) @ noise[0]
    behind = past @ _added_root(step, decay, np.linalg.inv(stationary)[::-1, ::-1]).T
    behind = np.vstack([np.linalg.solve(stationary, drive[0])[::-1], behind])
    ahead = _two_lags(step, decay, drive)
    back = _two_lags(step, decay, behind)
    states = np.vstack([back[:0:-1, ::-1] @ stationary, ahead])
    return sqrt(3.0) * states[:, 0] + (1.0 - sqrt(3.0)) * states[:, 1]


def _added_root(step: float, decay: float, stationary: Array) -> Array:
    """Root of what noise adds in a step to two lags in a row of a stationary covariance, (2, 2)."""
    transition = decay * np.array([[1.0, 0.0], [step, 1.0]])
    added = stationary - transition @ stationary @ transition.T
    return np.asarray(np.linalg.cholesky(added))


def _two_lags(step: float, decay: float, drive: Array) -> Array:
    """States of two lags in a row, (N, 2), from what drives them, (N, 2)."""
    first = _recursion(decay, drive[:, 0])
    second_drive = drive[:, 1].copy()
    second_drive[1:] += decay * step * first[:-1]
    return np.column_stack([first, _recursion(decay, second_drive)])


def _recursion(decay: float, drive: Array) -> Array:
    """State s_k = decay s_(k-1) + drive_k, (N,)."""
    from scipy.signal import lfilter  # half of the time it takes to import patagium

    return np.asarray(lfilter([1.0], [1.0, -decay], drive))


@dataclass(frozen=True, eq=False)
class RecordedGust(NamedGust):
    """Measured wind, interpolated linearly in time; constant before and after its samples.

    Args:
        time: Increasing, (N >= 2,) [s].
        velocity: Of the air beside the steady wind, world axes, (N, 3) [m/s].

    Raises:
        LogError: If the times do not increase.
        ParameterError: If there are less than two, or a number is not finite.
        ShapeError: If the velocity is not (N, 3).
    """

    time: Array
    velocity: Array

    name = "recorded"
    __repr__ = brief
    __eq__ = equal

    def __post_init__(self) -> None:
        time = rising(self.time)
        if len(time) < 2:
            raise ParameterError("time", "two at least", self.time)
        velocity = real_array("velocity", self.velocity, (len(time), 3))
        if not np.isfinite(velocity).all():
            wrong = float(velocity[~np.isfinite(velocity)][0])
            raise ParameterError("velocity", "finite numbers", wrong)
        object.__setattr__(self, "time", time.copy())
        object.__setattr__(self, "velocity", velocity.copy())

    def velocity_at(self, time: Array) -> Array:
        """Velocity, world axes, (N, 3) [m/s], at times (N,) [s]."""
        columns = [np.interp(time, self.time, column) for column in self.velocity.T]
        return np.stack(columns, axis=-1)

    def knots(self, first: float, last: float) -> Array:
        """Times between which the velocity changes linearly, (K >= 2,) [s]; see `Profile`."""
        begin, end = np.searchsorted(self.time, [first, last])
        begin = min(max(begin - 1, 0), len(self.time) - 2)
        return self.time[begin : max(end + 1, begin + 2)]


def profile_from_description(description: Mapping[str, Any]) -> Profile:
    """The gust of `describe()`, one that can travel.

    Raises:
        ParameterError: If the name is unknown, or a key is missing or unknown.
    """
    kinds: tuple[Any, ...] = OneMinusCosineGust, RampGust, DrydenGust, RecordedGust
    known, words = [kind.name for kind in kinds], "RecordedGust in place of an own gust, or one of"
    check_names("gust", [description.get("name")], known, words)
    return from_named_description("gust", kinds, description)  # type: ignore[no-any-return]


def triple(name: str, value: ArrayLike) -> tuple[float, ...]:
    """Three finite numbers.

    Args:
        name: Name of the argument, for messages.
        value: Numbers to check, (3,) [any unit].

    Raises:
        ShapeError: If they are not (3,).
        ParameterError: If one is not finite.
    """
    array = real_array(name, value, (3,))
    if not np.isfinite(array).all():
        raise ParameterError(name, "three finite numbers", value)
    return tuple(array.tolist())


GUST_COMPONENTS = 9
"""Numbers of a strip in a field: mean, first moment and rate, a vector each."""


@dataclass(frozen=True)
class CubicPieces:
    """A gust as cubics in time.

    In piece j velocity is sum_m a_jm (t - anchor_j)^m; the first and the last one are
    constant and reach to infinity. What was at the origin at t has by now lost a share of
    1 - exp(r (t - now)); in a, the share until the anchor is still to be taken.

    Attributes:
        knots: Where pieces meet, (K,) [s].
        coefficients: a, (K + 1, 4, 3) [m/s, m/s^2, ...].
        decay_rate: r [1/s].
    """

    knots: Array
    coefficients: Array
    decay_rate: float = 0.0

    @property
    def anchors(self) -> Array:
        """Times from which each piece counts, (K + 1,) [s]."""
        return np.append(self.knots[0], self.knots)


@dataclass(frozen=True)
class TravelingGust(NamedGust):
    """A gust that sweeps over the robot, w(p, t) = g(t - s) exp(-s/T), s = n . (p - p0) / c.

    It decays on its way, so that before the origin, where s < 0, it is stronger than there.

    A wing element of chord 2b whose points lie at y b ahead of mid-chord, y = cos(theta), with
    g(y) what it meets there: the part of its lift that circulation gives follows, in place of
    the wind, the mean of g weighted toward the trailing edge, 1/pi int g (1 - y) dtheta. With
    `AddedMass` it is also pushed by the rate of 2/pi int g sin^2(theta) dtheta. Together they
    are the lift of a thin airfoil in any frozen gust: Kussner's and Sears' functions where the
    air carries it, Wagner's where it is so fast that it comes at once. Without `AddedMass`
    the push is missing.

    Args:
        profile: The gust g as the origin meets it.
        direction: Direction of travel, any length, world axes, (3,) [-].
        speed: How fast, relative to the ground, c [m/s]; that of the wind if the air carries it.
        origin: Point p0 that meets it at the profile's own time, world axes, (3,) [m].
        decay_time: Time in which it falls to 1/e on its way, T [s]; None: it stays as it is.

    Raises:
        ParameterError: If a number is not finite, the direction zero, the speed not positive,
            the decay time below `SHORTEST_DECAY`, or the profile has no knots.
        ShapeError: If a triple is not (3,).

    References:
        von Karman & Sears (1938), Airfoil theory for non-uniform motion, J. Aeronaut. Sci. 5.
        Miles (1956), The aerodynamic force on an airfoil in a moving gust, J. Aeronaut. Sci. 23.
    """

    profile: Profile
    direction: tuple[float, float, float]
    speed: float
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    decay_time: float | None = None

    name = "traveling"

    def __post_init__(self) -> None:
        direction = np.array(triple("direction", self.direction))
        origin = triple("origin", self.origin)
        check_fields(self)
        length = float(np.linalg.norm(direction))
        if length == 0:
            raise ParameterError("direction", "a direction, not zero", self.direction)
        positive("speed", self.speed)
        if self.decay_time is not None and not SHORTEST_DECAY <= self.decay_time < inf:
            raise ParameterError("decay_time", f"at least {SHORTEST_DECAY} s", self.decay_time)
        object.__setattr__(self, "direction", tuple((direction / length).tolist()))
        object.__setattr__(self, "origin", origin)

    @property
    def parameters(self) -> Array:
        """Slowness n/c [s/m] and origin p0 [m], (6,)."""
        return np.array([*(np.array(self.direction) / self.speed), *self.origin])

    def velocity_at(self, time: Array) -> Array:
        """Velocity at the origin, world axes, (N, 3) [m/s], at times (N,) [s]."""
        return self.profile.velocity_at(time)

    def pieces(self, first: float, last: float) -> CubicPieces:
        """The profile as cubics, through its values at four times of each.

        Args:
            first: Earliest time that will be asked for [s].
            last: Latest time that will be asked for [s].
        """
        knots = np.asarray(self.profile.knots(first, last), float)
        rate = 0.0 if self.decay_time is None else 1.0 / self.decay_time
        if rate:
            knots = _close_knots(knots, first, last, 1.0 / (STEPS_PER_DECAY * rate))
        spans = np.diff(knots)
        thirds = np.arange(4) / 3
        times = knots[:-1, None] + spans[:, None] * thirds
        times[:, 3] = knots[1:]
        values = self.profile.velocity_at(times.ravel()).reshape(len(spans), 4, 3)
        values = values * np.exp(rate * (times - knots[:-1, None]))[:, :, None]
        through = np.linalg.inv(np.vander(thirds, increasing=True))
        inner = np.einsum("mk,jka->jma", through, values)
        inner /= (spans[:, None] ** np.arange(4))[:, :, None]
        ends = np.zeros((2, 4, 3))
        ends[:, 0] = values[0, 0], values[-1, 3]
        return CubicPieces(knots, np.concatenate([ends[:1], inner, ends[1:]]), rate)


def _close_knots(knots: Array, first: float, last: float, step: float) -> Array:
    """Knots from `first` to `last` that are not farther apart than a step, (K',) [s]."""
    before = knots[0] - step * np.arange(max(ceil((knots[0] - first) / step), 0), 0, -1)
    after = knots[-1] + step * np.arange(max(ceil((last - knots[-1]) / step), 0) + 1)
    parts = np.ceil(np.diff(knots) / step).astype(int)
    pairs = zip(knots[:-1], knots[1:], parts, strict=True)
    between = [np.linspace(a, b, count, endpoint=False) for a, b, count in pairs]
    return np.concatenate([before, *between, after])


def gust_from_description(description: Mapping[str, Any]) -> Gust:
    """The gust of `describe()`.

    Raises:
        ParameterError: If the name is unknown, or a key is missing or unknown.
    """
    if description.get("name") == "sum":
        check_keys("gust sum", description, {"name", "gusts"})
        return GustSum(tuple(profile_from_description(one) for one in description["gusts"]))
    if description.get("name") != "traveling":
        return profile_from_description(description)
    values = {"decay_time": None, **description}  # there where the gust decays
    del values["name"]
    values["profile"] = profile_from_description(values.get("profile", {}))
    return from_field_values("gust traveling", TravelingGust, values)


def gusts_at_strips(pieces: CubicPieces, time: Array, delays: Array) -> Array:
    """Gust at the strips, (N, 9, n): mean, first moment [m/s] and rate [m/s^2], world axes.

    With g what the points of a chord meet, y = cos(theta) from -1 at the trailing to 1 at the
    leading edge: mean 1/pi int g dtheta [m/s], first moment 1/pi int g y dtheta [m/s], and
    rate 2/pi int dg/dt sin^2(theta) dtheta [m/s^2]. The loop of `kernels/gust.h`, for all
    samples at once.

    Args:
        pieces: The gust.
        time: Of the samples, (N,) [s].
        delays: For each sample and strip how much later mid-chord meets the gust than its
            origin, how much later than that the leading edge, and the rates of both,
            (N, 4, n) [s, s, 1, 1].
    """
    delay, spread, delay_rate, spread_rate = np.moveaxis(delays, 1, 0)
    middle = time[:, None] - delay
    shape = middle.shape
    now = np.broadcast_to(time[:, None], shape).ravel()
    middle, spread = middle.ravel(), spread.ravel()
    rates = np.stack([1.0 - delay_rate.ravel(), -spread_rate.ravel()])
    side = np.where(spread < 0, -1.0, 1.0)  # of the chord that meets the latest part first
    last = _piece_of(pieces, middle + np.abs(spread))
    piece = _piece_of(pieces, middle - np.abs(spread))
    total, begins = np.zeros((len(middle), 3, 3)), side.copy()
    left = np.arange(len(middle))
    while left.size:
        j = piece[left]
        final = j == last[left]
        knot = pieces.knots[np.minimum(j, len(pieces.knots) - 1)]
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = np.clip((middle[left] - knot) / spread[left], -1.0, 1.0)
        ends = np.where(final, -side[left], crossing)
        between = side[left] * (_integrals(ends) - _integrals(begins[left]))
        offset = middle[left] - pieces.anchors[j]
        slopes = -spread[left], rates[:, left]
        fade = np.exp(pieces.decay_rate * (pieces.anchors[j] - now[left]))
        cubics = pieces.coefficients[j] * fade[:, None, None]
        total[left] += _moments(cubics, offset, *slopes, between, pieces.decay_rate)
        begins[left] = ends
        piece[left] += 1
        left = left[~final]
    return np.moveaxis(total.reshape(*shape, GUST_COMPONENTS), 1, 2)


def _piece_of(pieces: CubicPieces, time: Array) -> Indices:
    return np.searchsorted(pieces.knots, time, side="right").astype(np.int64)


def _integrals(y: Array) -> Array:
    """Integrals of cos^k over angles from zero to arccos y, k = 0..5, (6, N)."""
    sine = np.sqrt(np.maximum(1.0 - y * y, 0.0))
    found, power = [np.arccos(y), sine], sine
    for k in range(2, 6):
        power = power * y
        found.append(power / k + (k - 1) / k * found[k - 2])
    return np.stack(found)


def _moments(
    coefficients: Array,
    offset: Array,
    slope: Array,
    rates: Array,
    between: Array,
    decay_rate: float,
) -> Array:
    """Contribution of a part of the chord to mean, first moment and rate, (N, 3, 3).

    The gust is g = sum_m a_m (offset + slope y)^m, with coefficients a (N, 4, 3) [m/s, m/s^2, ...];
    `between` holds the integrals of y^k over the part, (6, N) [-].
    """
    powers = np.zeros((4, 4, len(offset)))  # of y, in (offset + slope y)^m
    powers[0, 0] = 1.0
    for m in range(1, 4):
        powers[m] = powers[m - 1] * offset
        powers[m, 1:] += powers[m - 1, :-1] * slope
    value = np.einsum("nma,mkn->kna", coefficients, powers)
    slopes = coefficients[:, 1:] * np.arange(1, 4)[:, None]
    change = np.einsum("nma,mkn->kna", slopes, powers[:3])
    rate = change * rates[0][:, None] - decay_rate * value
    rate[1:] += change[:-1] * rates[1][:, None]
    bent = between[:4] - between[2:]  # sin^2
    return np.stack(
        [
            np.einsum("kna,kn->na", value, between[:4]) / np.pi,
            np.einsum("kna,kn->na", value, between[1:5]) / np.pi,
            np.einsum("kna,kn->na", rate, bent) * (2 / np.pi),
        ],
        axis=1,
    )


GUST = 6
"""Numbers of a gust that travels: slowness and origin."""


def strip_delays(robot: Robot, q: ca.SX, v: ca.SX, gust: ca.SX) -> ca.SX:
    """Delays of strips behind a gust's origin, and their rates, (4, n_strips) [s, s, 1, 1].

    With slowness s = n/c: s . (p - p0) of mid-chord [s], how much later than that the leading
    edge is [s], and the rates of both [1].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        gust: Slowness [s/m] and origin [m], (6,).
    """
    poses, twists = body_poses(robot, q), body_velocities(robot, q, v)
    slowness, origin = gust[:3], gust[3:]
    columns = []
    for strip in robot.strips:
        pose, twist = poses[strip.body], twists[strip.body]
        ahead = vector(strip.forward) * (strip.chord / 2)
        middle = vector(strip.quarter_chord) - ahead / 2
        local = pose.rotation.T @ slowness
        columns.append(
            ca.vertcat(
                ca.dot(slowness, pose.position - origin) + ca.dot(local, middle),
                ca.dot(local, ahead),
                ca.dot(local, twist.at(middle)),
                ca.dot(local, ca.cross(twist.angular, ahead)),
            )
        )
    return ca.horzcat(*columns) if columns else ca.SX(4, 0)


def strip_winds(robot: Robot, q: ca.SX, v: ca.SX, wind: ca.SX, met: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Wind that the circulation of each strip answers to, and the mean along its chord.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        wind: What of the wind is the same everywhere, world axes, (3,) [m/s].
        met: What strips meet, (9, n_strips).

    Returns:
        World axes, (3, n_strips) each [m/s].
    """
    count = len(robot.strips)
    mean = ca.repmat(wind, 1, count) + met[:3, :]
    edges = [smooth_sign(motion.forward) for motion in strip_motions(robot, q, v, mean)]
    weighted = [mean[:, i] - edges[i] * met[3:6, i] for i in range(count)]
    return ca.horzcat(ca.SX(3, 0), *weighted), mean
