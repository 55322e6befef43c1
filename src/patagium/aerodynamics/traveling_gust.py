"""Gusts that travel: a frozen field that sweeps over the robot.

Each point of a wing meets the gust at its own time (Taylor's hypothesis): strip after strip,
and along the chord from the edge that meets it first. A section answers to two averages over
its chord, as thin airfoils do, whatever the direction the gust comes from; both are found here
in closed form for a gust that is a cubic between knots. Neglected: what the wing does to the
gust, and how the gust decays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics.gusts import (
    Gust,
    Profile,
    profile_from_description,
    triple,
)
from patagium.aerodynamics.named_descriptions import check_keys
from patagium.errors import ParameterError, ShapeError, positive

Array = NDArray[np.float64]

GUST_COMPONENTS = 9
"""Numbers of a strip in a field: mean, first moment and rate, a vector each."""


@dataclass(frozen=True)
class CubicPieces:
    """A gust as cubics in time.

    In piece j velocity is sum_m a_jm (t - anchor_j)^m; the first and the last one are
    constant and reach to infinity.

    Attributes:
        knots: Where pieces meet, (K,) [s].
        coefficients: a, (K + 1, 4, 3) [m/s, m/s^2, ...].
    """

    knots: Array
    coefficients: Array

    @property
    def anchors(self) -> Array:
        """Times from which each piece counts, (K + 1,) [s]."""
        return np.append(self.knots[0], self.knots)


@dataclass(frozen=True)
class TravelingGust:
    """A gust that sweeps over the robot, w(p, t) = g(t - n . (p - p0) / c).

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

    Raises:
        ParameterError: If a number is not finite, the direction zero, the speed not positive,
            or the profile has no knots.
        ShapeError: If a triple is not (3,).

    References:
        von Karman & Sears (1938), Airfoil theory for non-uniform motion, J. Aeronaut. Sci. 5.
        Miles (1956), The aerodynamic force on an airfoil in a moving gust, J. Aeronaut. Sci. 23.
    """

    profile: Profile
    direction: tuple[float, float, float]
    speed: float
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        direction = np.array(triple("direction", self.direction))
        length = float(np.linalg.norm(direction))
        if length == 0:
            raise ParameterError("direction", "a direction, not zero", self.direction)
        positive("speed", self.speed)
        if not callable(getattr(self.profile, "knots", None)):
            raise ParameterError("profile", "a gust with knots, that can travel", self.profile)
        object.__setattr__(self, "direction", tuple((direction / length).tolist()))
        object.__setattr__(self, "origin", triple("origin", self.origin))

    @property
    def parameters(self) -> Array:
        """Slowness n/c [s/m] and origin p0 [m], (6,)."""
        return np.array([*(np.array(self.direction) / self.speed), *self.origin])

    def velocity_at(self, time: Array) -> Array:
        """Velocity at the origin, world axes, (N, 3) [m/s], at times (N,) [s]."""
        return self.profile.velocity_at(time)

    def velocity_at_points(self, time: ArrayLike, points: ArrayLike) -> Array:
        """Velocity at points and times, world axes, (N, 3) [m/s].

        Args:
            time: Times, (N,) [s].
            points: World axes, (N, 3) [m].

        Raises:
            ShapeError: If they are not (N,) and (N, 3).
        """
        times, places = np.asarray(time, float), np.asarray(points, float)
        if times.ndim != 1 or places.shape != (len(times), 3):
            raise ShapeError("points", "(N, 3) for times (N,)", places.shape)
        delay = (places - np.array(self.origin)) @ self.parameters[:3]
        return self.profile.velocity_at(times - delay)

    def pieces(self, first: float, last: float) -> CubicPieces:
        """The profile as cubics, through its values at four times of each.

        Args:
            first: Earliest time that will be asked for [s].
            last: Latest time that will be asked for [s].
        """
        knots = np.asarray(self.profile.knots(first, last), float)
        spans = np.diff(knots)
        thirds = np.arange(4) / 3
        times = knots[:-1, None] + spans[:, None] * thirds
        times[:, 3] = knots[1:]
        values = self.profile.velocity_at(times.ravel()).reshape(len(spans), 4, 3)
        through = np.linalg.inv(np.vander(thirds, increasing=True))
        inner = np.einsum("mk,jka->jma", through, values)
        inner /= (spans[:, None] ** np.arange(4))[:, :, None]
        ends = np.zeros((2, 4, 3))
        ends[:, 0] = values[0, 0], values[-1, 3]
        return CubicPieces(knots, np.concatenate([ends[:1], inner, ends[1:]]))

    def describe(self) -> dict[str, Any]:
        """Description from which the object can be made again, as JSON-able values."""
        return {
            "name": "traveling",
            "profile": self.profile.describe(),
            "direction": list(self.direction),
            "speed": self.speed,
            "origin": list(self.origin),
        }


def gust_from_description(description: Mapping[str, Any]) -> Gust:
    """The gust of `describe()`.

    Raises:
        ParameterError: If the name is unknown, or a key is missing or unknown.
    """
    if description.get("name") != "traveling":
        return profile_from_description(description)
    known = {"name", "profile", "direction", "speed", "origin"}
    check_keys("gust traveling", description, known)
    profile = profile_from_description(description["profile"])
    direction, origin = tuple(description["direction"]), tuple(description["origin"])
    return TravelingGust(profile, direction, description["speed"], origin)


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
        total[left] += _moments(pieces.coefficients[j], offset, *slopes, between)
        begins[left] = ends
        piece[left] += 1
        left = left[~final]
    return np.asarray(np.moveaxis(total.reshape(*shape, GUST_COMPONENTS), 1, 2))


def _piece_of(pieces: CubicPieces, time: Array) -> NDArray[np.int64]:
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
    coefficients: Array, offset: Array, slope: Array, rates: Array, between: Array
) -> Array:
    """Contribution of a part of the chord to mean, first moment and rate, (N, 3, 3).

    Args:
        coefficients: a, (N, 4, 3) [m/s, m/s^2, ...], of g = sum_m a_m (offset + slope y)^m.
        offset: (N,) [s].
        slope: (N,) [s].
        rates: Of offset and slope, (2, N).
        between: Integrals of y^k over the part, (6, N) [-].
    """
    powers = np.zeros((4, 4, len(offset)))  # of y, in (offset + slope y)^m
    powers[0, 0] = 1.0
    for m in range(1, 4):
        powers[m] = powers[m - 1] * offset
        powers[m, 1:] += powers[m - 1, :-1] * slope
    value = np.einsum("nma,mkn->kna", coefficients, powers)
    slopes = coefficients[:, 1:] * np.arange(1, 4)[:, None]
    change = np.einsum("nma,mkn->kna", slopes, powers[:3])
    rate = change * rates[0][:, None]
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
