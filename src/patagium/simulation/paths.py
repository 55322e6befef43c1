"""Paths of a carried robot: position and attitude of its mounting over time.

A path is the motion of x, y, z, roll, pitch and yaw in the world, with exact
velocity and acceleration; the last is continuous everywhere. Periodic ones repeat for
ever, the others start and end at rest and stay where they end. Attitude is fixed
but in a sinusoid, way-points and tables. Neglected: limits of what carries it, which
`patagium.simulation.arm` knows; a pitch of 90 degrees, where Euler angles end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics.named_descriptions import field_values
from patagium.arguments import checked, of_kind
from patagium.arrays import Array, brief, equal, real_array
from patagium.errors import (
    LogError,
    ParameterError,
    ShapeError,
    check_names,
    finite,
    positive,
    suggest_names,
)
from patagium.robot.model import FLOATING_COORDINATES, finite_triple
from patagium.robot.units import meant, spoken
from patagium.simulation.gait_models import (
    FourierGait,
    Gait,
    PrescribedMotion,
    SuperposedGait,
    asked_times,
    leads,
    read_columns,
    superposition,
)

__all__ = ["circle", "figure_of_eight", "from_csv", "line", "sinusoid", "superposed", "waypoints"]
suggest_names(__name__)

Path: TypeAlias = Gait
"""Path of a mount: a gait of the six coordinates of a floating base."""

Triple: TypeAlias = Sequence[float]
LEVEL = (0.0, 0.0, 0.0)
PITCH_LIMIT = np.pi / 2 - 0.02
"""Largest pitch of a path, up and down, for its Euler angles [rad]."""

AnyPath = TypeVar("AnyPath", bound=Gait)
_CLOSURE = 1e-9  # how far a last way-point may be from the first and still repeat it
_SHORTEST = 1e-9 * (1 - 1e-6)  # s between two way-points; accelerations of less may overflow


@dataclass(frozen=True)
class SplinePath:
    """Quintic spline through way-points: four continuous derivatives.

    Attributes:
        joints: x, y, z, roll, pitch, yaw.
        time: Strictly rising, from 0, (M,) [s].
        position: Way-points, (M, 6) [m, rad].
        closed: Whether it repeats for ever; else it starts and ends at rest.
    """

    joints: tuple[str, ...]
    time: Array
    position: Array
    closed: bool
    __repr__, __eq__ = brief, equal

    @property
    def period(self) -> float | None:
        """Time after which it repeats [s]; None if it ends."""
        return float(self.time[-1]) if self.closed else None

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Motion at the times asked for, (N,) [s]; at rest before the start and after the end."""
        from scipy.interpolate import make_interp_spline  # slow to import, rarely needed

        rest = [(1, np.zeros(6)), (2, np.zeros(6))]
        ends = "periodic" if self.closed else (rest, rest)
        spline = make_interp_spline(self.time, self.position, k=5, bc_type=ends)
        asked = asked_times(time)
        end = self.time[-1]
        inside = np.mod(asked, end) if self.closed else np.clip(asked, 0.0, end)
        moves = (inside == asked)[:, None] | self.closed
        return PrescribedMotion(
            spline(inside), moves * spline(inside, 1), moves * spline(inside, 2)
        )

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        return {"kind": "spline", **field_values(self)}


def line(start: Triple, end: Triple, *, duration: float, attitude: Triple = LEVEL) -> SplinePath:
    """Straight path from rest to rest with the least jerk.

    Args:
        start: First point, world axes, (3,) [m].
        end: Last point, (3,) [m].
        duration: Duration [s].
        attitude: Roll, pitch, yaw, (3,) [rad].

    Raises:
        ParameterError: If a number is not finite, or the duration not positive.
    """
    points = [finite_triple("start", start), finite_triple("end", end)]
    return waypoints([0.0, positive("duration", duration)], points, attitude=attitude)


def circle(
    center: Triple,
    radius: float,
    *,
    speed: float | None = None,
    frequency: float | None = None,
    normal: Triple = (0.0, 0.0, 1.0),
    attitude: Triple = LEVEL,
) -> FourierGait:
    """Circular path, counterclockwise seen against its normal.

    Args:
        center: World axes, (3,) [m].
        radius: Radius [m].
        speed: Along the path [m/s]; or
        frequency: Turns a second [Hz].
        normal: Normal of the plane, world axes, (3,) [-].
        attitude: Roll, pitch, yaw, (3,) [rad].

    Raises:
        ParameterError: If a number is not what it may be, or not one of speed and frequency
            is given.
    """
    radius = positive("radius", radius)
    rate = _frequency(speed, frequency, radius)
    out = _direction("normal", normal)
    ahead = np.eye(3)[0 if abs(out[0]) < 0.9 else 1]  # x where it can be
    first = ahead - out * (out @ ahead)
    first /= np.linalg.norm(first)
    return _harmonic(center, attitude, rate, [radius * first], [radius * np.cross(out, first)])


def figure_of_eight(
    center: Triple,
    length: float,
    width: float,
    *,
    speed: float | None = None,
    frequency: float | None = None,
    along: Triple = (1.0, 0.0, 0.0),
    across: Triple = (0.0, 1.0, 0.0),
    attitude: Triple = LEVEL,
) -> FourierGait:
    """Lying eight: (length/2) sin x along, (width/2) sin 2x across, x = 2 pi f t.

    Args:
        center: Crossing point, world axes, (3,) [m].
        length: From tip to tip [m].
        width: Across [m].
        speed: The greatest, at the crossing [m/s]; or
        frequency: Eights a second f [Hz].
        along: Direction of its length, world axes, (3,) [-].
        across: Direction of its width, square to it, (3,) [-].
        attitude: Roll, pitch, yaw, (3,) [rad].

    Raises:
        ParameterError: If a number is not what it may be, or not one of speed and frequency
            is given.
    """
    half, side = positive("length", length) / 2, positive("width", width) / 2
    first = _direction("along", along)
    second = _direction("across", across)
    if abs(first @ second) > 1e-9:
        raise ParameterError("across", "a direction square to along", tuple(across))
    rate = _frequency(speed, frequency, float(np.hypot(half, 2 * side)))
    still = np.zeros(3)
    return _harmonic(center, attitude, rate, [still, still], [half * first, side * second])


@checked
def sinusoid(
    center: Triple,
    *,
    frequency: float,
    phase: Mapping[str, float] | None = None,
    attitude: Triple = LEVEL,
    **amplitude: float,
) -> FourierGait:
    """One sine a coordinate: mean + amplitude sin(2 pi f t + phase).

    Args:
        center: Mean position, world axes, (3,) [m].
        frequency: Cycles a second f [Hz].
        phase: Lead by the coordinate's name [rad]; 0 where not named.
        attitude: Mean roll, pitch, yaw, (3,) [rad].
        **amplitude: By the coordinate's name, x, y, z, roll, pitch or yaw [m, rad].

    Raises:
        ParameterError: If a name is no coordinate, a number not finite, or a lead beyond a turn.
    """
    lead, size = _by_name(leads(phase)), _by_name(amplitude)
    rate = positive("frequency", frequency)
    return _harmonic(center, attitude, rate, [size * np.sin(lead)], [size * np.cos(lead)])


@checked
def waypoints(
    time: ArrayLike, points: ArrayLike, *, closed: bool = False, attitude: Triple = LEVEL
) -> SplinePath:
    """Smooth path through points at given times.

    Args:
        time: Strictly rising, (M,) [s]; counted from the first.
        points: World axes, (M, 3) [m], or with roll, pitch, yaw, (M, 6) [m, rad].
        closed: Whether it repeats for ever; the last point must be the first. Else it
            starts and ends at rest.
        attitude: Roll, pitch, yaw where the points have none, (3,) [rad].

    Raises:
        ShapeError: If times and points do not go together.
        ParameterError: If time does not rise, a number is not finite, or a closed path is open.
    """
    times, places = real_array("time", time), real_array("points", points).copy()
    if times.ndim != 1 or places.shape not in ((len(times), 3), (len(times), 6)):
        raise ShapeError("points", f"({times.size}, 3) or ({times.size}, 6)", places.shape)
    if not (np.isfinite(times).all() and np.isfinite(places).all()):
        raise ParameterError("waypoints", "finite numbers", "others")
    fewest = 7 if closed else 2
    if len(times) < fewest or not np.all(np.diff(times) > _SHORTEST):
        expected = f"at least {fewest}, each later than the one before, by a nanosecond or more"
        raise ParameterError("waypoints.time", expected, times.tolist()[:8])
    if places.shape[1] == 3:
        fixed = np.broadcast_to(finite_triple("attitude", attitude), places.shape)
        places = np.hstack([places, fixed])
    if closed:
        gap = float(np.abs(places[-1] - places[0]).max())
        if gap > _CLOSURE:
            raise ParameterError("waypoints", "a last point that is the first", f"{gap:g} away")
        places[-1] = places[0]
    return _checked(SplinePath(FLOATING_COORDINATES, times - times[0], places, closed))


def from_csv(path: str | File, *, closed: bool = False) -> SplinePath:
    """Path designed or measured elsewhere, splined through every row.

    Args:
        path: CSV file with a header: time and any of x, y, z, roll, pitch, yaw, each with
            its unit in brackets, such as `time [s], x [mm], pitch [deg]`. What has no
            column stays at zero.
        closed: Whether it repeats for ever; the last row must repeat the first.

    Raises:
        LogError: If the table cannot be used as it stands.
        ParameterError: If time does not rise, or a closed path is open.
    """
    file = File(path)

    def unit_of(name: str) -> str:
        if name not in FLOATING_COORDINATES:
            known = ", ".join(("time", *FLOATING_COORDINATES))
            raise LogError(file.name, f"columns among {known}", f"{name!r}")
        return "m" if name in "xyz" else "rad"

    time, table = read_columns(file, unit_of)
    none = np.zeros(len(time))
    points = np.column_stack([table.get(name, none) for name in FLOATING_COORDINATES])
    return waypoints(time, points, closed=closed)


def superposed(*parts: Path) -> SuperposedGait:
    """Sum of paths, such as a circle and a pitching sinusoid about the origin.

    Args:
        *parts: At least one; all end, or the longest period is a whole number of each other's.

    Raises:
        ParameterError: If there is none, or the sum does not repeat.
    """
    path = superposition(parts, check_path)
    if len({part.period is None for part in parts}) > 1:
        raise ParameterError("parts", "paths that all repeat or all end", "both kinds")
    return _checked(path)


def span_of(path: Path) -> float:
    """Time after which a path repeats or rests for ever [s]."""
    if path.period:
        return path.period
    ends = [part.time[-1] for part in getattr(path, "parts", (path,)) if hasattr(part, "time")]
    return float(max(ends, default=1.0))


def check_path(path: Path) -> None:
    """Refuse what is no path of a floating base.

    Raises:
        ParameterError: If it moves other coordinates.
    """
    of_kind("path", path, Path)
    if tuple(path.joints) != FLOATING_COORDINATES:
        expected = f"a path of {', '.join(FLOATING_COORDINATES)}"
        raise ParameterError("path", expected, ", ".join(path.joints))


def _harmonic(
    center: Triple, attitude: Triple, frequency: float, cosine: list[Array], sine: list[Array]
) -> FourierGait:
    """Path of a Fourier series, whose coefficients may leave out those of the angles."""
    mean = np.concatenate([finite_triple("center", center), finite_triple("attitude", attitude)])
    series = [np.pad(part, [(0, 0), (0, 6 - len(part[0]))]) for part in (cosine, sine)]
    return _checked(FourierGait(FLOATING_COORDINATES, frequency, mean, *series))


def _checked(path: AnyPath) -> AnyPath:
    """The path, unless it passes where Euler angles are singular."""
    pitch = path.motion(np.linspace(0.0, span_of(path), 2001)).position[:, 4]
    worst = float(pitch[np.argmax(np.abs(pitch))])
    if abs(worst) > PITCH_LIMIT:
        expected = f"a pitch within {spoken('rad', PITCH_LIMIT)}, for its Euler angles"
        raise ParameterError("path", expected, spoken("rad", worst) + meant(worst))
    return path


def _frequency(speed: float | None, frequency: float | None, speed_per_rate: float) -> float:
    """Frequency [Hz] from it or from the greatest speed [m/s]."""
    if (speed is None) == (frequency is None):
        raise ParameterError("speed", "one of speed and frequency", (speed, frequency))
    if speed is not None:
        return positive("speed", speed) / (2 * np.pi * speed_per_rate)
    return positive("frequency", float(frequency or 0.0))


def _direction(name: str, vector: Triple) -> Array:
    written = np.array(finite_triple(name, vector))
    length = float(np.linalg.norm(written))
    if not length > 1e-12:
        raise ParameterError(name, "a direction of some length", tuple(vector))
    return written / length


def _by_name(values: Mapping[str, float]) -> Array:
    vector = np.zeros(6)
    for name, value in values.items():
        check_names(name, [name], FLOATING_COORDINATES, "a coordinate of a path:")
        vector[FLOATING_COORDINATES.index(name)] = finite(name, value)
    return vector
