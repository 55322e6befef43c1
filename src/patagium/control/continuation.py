"""Continuation: the branch of periodic orbits along a speed, a climb or a gait parameter.

Pseudo-arclength continuation (Keller 1977): from an orbit a step along the branch's tangent, then
Newton's method across it, so that a branch that turns back (a fold) is followed around its turn.
Unknowns are those of a trim and are one more than the equations. Bifurcations are named from the
multipliers, as AUTO and MatCont name them. Neglected: branches that begin at a bifurcation, and
closed branches, which are followed until the points are used up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from patagium.arguments import Progress, checked
from patagium.arrays import Array
from patagium.control.gait_family import gait_family
from patagium.control.orbit import STILL, Orbit
from patagium.control.trimming import TOLERANCE, Conditions, OrbitSearch, orbit_of
from patagium.control.trimming import Point as SearchPoint
from patagium.errors import ParameterError, check_names

_NEWTON = 8  # steps of a correction, at most
_FIRST, _LONGEST = 1 / 40, 1 / 12  # parts of the range that a step changes the parameter by
_SHORTEST = 1e-4  # of the longest step
_BEND = 0.9  # cosine of the angle between tangents of neighbors, at least
_BISECTIONS = 14
_OUTSIDE = 1e-7  # of the unit circle: a double neutral multiplier is 1 within sqrt(rounding)
_NEAR = 1e-4  # distance from the unit circle of what crosses it, after the bisections
_RANK = 1e-7  # of singular values of the conditions
_ROUNDING = 1e-9  # of singular values of the equations


@dataclass(frozen=True)
class Bifurcation:
    """Point of a branch where it turns back or its stability changes.

    Attributes:
        kind: "fold": the branch turns back. "flip": a multiplier leaves or enters the unit circle
            at -1, "Neimark-Sacker": a complex pair, "branch point": a multiplier at 1.
        value: Value of the parameter [its unit].
        multiplier: Multiplier that crosses the unit circle; of a fold the one nearest to 1.
        orbit: The orbit there.
    """

    kind: str
    value: float
    multiplier: complex
    orbit: Orbit = field(repr=False)


@dataclass(frozen=True, eq=False)
class Branch:
    """Branch of periodic orbits along a parameter, from one end to the other.

    Attributes:
        along: Name of the parameter.
        unit: Its unit.
        free: Gait parameters that change along the branch.
        values: Value of the parameter at each orbit, (m,) [unit].
        orbits: The orbits, neighbors next to each other.
        bifurcations: Folds and changes of stability in the same order.
        ends: Why the branch ends at its first and at its last orbit.
    """

    along: str
    unit: str
    free: tuple[str, ...]
    values: Array
    orbits: tuple[Orbit, ...] = field(repr=False)
    bifurcations: tuple[Bifurcation, ...]
    ends: tuple[str, str]

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Multipliers of each orbit, the largest first, (m, n - 4) [1]."""
        return np.array([orbit.multipliers for orbit in self.orbits])

    def summary(self) -> list[dict[str, Any]]:
        """Orbits as rows of a table, with units in the names."""
        rows = []
        for value, orbit, own in zip(self.values, self.orbits, self.multipliers, strict=True):
            row = {f"{self.along}_{self.unit}".removesuffix("_1"): float(value)}
            told = zip(orbit.family.names, orbit.parameter_facts.items(), strict=True)
            row |= dict(fact for name, fact in told if name in self.free)
            size = float(abs(own[0]))
            rows.append(row | {"largest_multiplier": size, "stable": size < 1.0 - STILL})
        return rows

    def __repr__(self) -> str:
        low, high = self.values.min(), self.values.max()
        sizes = np.abs(self.multipliers[:, 0])
        told = [
            f"branch of {len(self.orbits)} orbits along {self.along}, {low:.4g} to {high:.4g} "
            f"{self.unit}, {np.count_nonzero(sizes < 1 - STILL)} of them stable",
            f"  free: {', '.join(self.free)}",
            *(f"  {one.kind} at {one.value:.5g} {self.unit}" for one in self.bifurcations),
            f"  begins: {self.ends[0]}; ends: {self.ends[1]}",
        ]
        return "\n".join(told)


@checked
def continue_orbit(
    orbit: Orbit,
    along: str,
    limits: tuple[float, float],
    *,
    hold: Sequence[str] = ("climb",),
    points: int = 200,
    progress: Progress | None = None,
) -> Branch:
    """Branch of periodic orbits through one, along a parameter, folds passed.

    Of the orbit's free parameters those with the largest effect on the conditions change.

    Args:
        orbit: Orbit to begin from.
        along: "speed" or "climb" [m/s], or a gait parameter by its name.
        limits: Least and greatest value of the parameter, where the branch ends [its unit].
        hold: Which of "speed" and "climb" keep the orbit's value; that of `along` never does.
            The turn rate does.
        points: Number of orbits at most, on either side of the first.
        progress: Function that takes the orbits found, and those at most.

    Raises:
        ParameterError: If there is no such parameter, the points are below one, the orbit is
            outside of the limits, or the conditions are more than the orbit's free parameters.
    """
    check_names("hold", hold, ("speed", "climb"))
    if points < 1:
        raise ParameterError("points", "one orbit at least", points)
    curve = _Curve(orbit, along, {k: getattr(orbit, k) for k in hold if k != along})
    low, high = limits
    if not (low <= curve.first.value <= high and 0 < high - low < np.inf):
        own = f"{along} {curve.first.value:.6g} {curve.unit}"
        expected = f"two that hold the orbit's {own}, a finite number apart"
        raise ParameterError("limits", expected, limits)
    told = progress or (lambda done, total: None)
    down, back = _walk(curve, -1.0, limits, points, lambda k: told(k, 2 * points))
    up, ahead = _walk(curve, 1.0, limits, points, lambda k: told(len(down) + k, 2 * points))
    places = [*down[::-1], curve.first, *up]
    return Branch(
        along,
        curve.unit,
        tuple(np.array(curve.family.names)[curve.search.reach != 0].tolist()),
        np.array([one.value for one in places]),
        tuple(orbit_of(curve.search, one.at) for one in places),
        tuple(mark for one in places for mark in one.marks),
        (back, ahead),
    )


class _Place(NamedTuple):
    """Orbit on the branch: its point of the search, parameter, tangent, and what is near it."""

    at: SearchPoint
    value: float
    tangent: Array
    pace: float
    size: NDArray[np.complex128]
    marks: tuple[Bifurcation, ...] = ()


class _Curve:
    """Equations of a branch: those of a trim without a condition on the parameter."""

    def __init__(self, orbit: Orbit, along: str, held: dict[str, float]) -> None:
        names = orbit.family.names
        self.place = None
        if along not in ("speed", "climb"):
            names = tuple(dict.fromkeys([*names, along]))
            self.place = names.index(along)
        try:
            family = gait_family(orbit.robot, orbit.family.base, names)
        except ParameterError:
            known = ["speed", "climb", *orbit.family.names]
            raise ParameterError("along", f"one of {', '.join(known)}", along, known) from None
        given: dict[str, Any] = held if self.place is not None else held | {along: 0.0}
        self.conditions = Conditions(orbit.turn_rate, given.get("climb"), given.get("speed"))
        self.row = -1 if along == "speed" or "speed" not in given else -2
        self.unit = "m/s" if self.place is None else family.units[self.place]
        self.search = OrbitSearch(orbit.map, family, orbit.steps)
        self.family, self.count = family, len(self.search.frame.kept)
        own = zip(names, family.neutral, strict=True)
        values = np.array([orbit.parameters.get(name, neutral) for name, neutral in own])
        at = self.fly(orbit.states, values)
        self._choose(at, len(held))
        found = self.corrected(at)
        if found is None:
            raise ParameterError("orbit", "one that meets the conditions", repr(orbit))
        self.first = self.placed(found, None, 1.0)

    def fly(self, states: Array, values: Array) -> SearchPoint:
        """Flight whose condition on the parameter is met by the parameter's own value."""
        at = self.search.point(states, values, self.conditions)
        if self.place is None:
            misfit, rates = at.misfit.copy(), at.by_period.copy()
            rates[self.row] = -misfit[self.row] / at.period
            misfit[self.row] = 0.0
            at = at._replace(misfit=misfit, by_period=rates)
        return at

    def value(self, at: SearchPoint) -> float:
        """Value of the parameter [unit]."""
        if self.place is not None:
            return float(at.values[self.place])
        return float(-at.by_period[self.row])

    def equations(self, at: SearchPoint) -> tuple[Array, Array, Array, Any]:
        """Slopes of the equations and of the parameter, right-hand side, nodes; scaled."""
        matrix, right, nodes = self.search.system(at)
        if self.place is not None:
            slope = np.zeros(matrix.shape[1])
            slope[self.count + self.place] = self.search.reach[self.place]
            return matrix, slope, right, nodes
        slope = matrix[self.row] * at.scales[1][self.row] / at.period
        rest = np.arange(len(right)) != self.row % len(right)
        return matrix[rest], slope, right[rest], nodes

    def _choose(self, at: SearchPoint, held: int) -> None:
        """Hold all gait parameters but those with the largest effect on the conditions."""
        matrix, slope, _, _ = self.equations(at)
        n = self.count
        whole = np.vstack([matrix, slope])
        inner = np.linalg.lstsq(whole[:n, :n], whole[:n, n:], rcond=_RANK)[0]
        effect = whole[n:, n:] - whole[n:, :n] @ inner
        sizes = np.linalg.svd(effect, compute_uv=False)
        rank = int(np.count_nonzero(sizes > _RANK * sizes[0]))
        if rank < held + 1:
            expected = f"{held + 1} free parameters that move the conditions on their own"
            raise ParameterError("orbit", expected, ", ".join(self.family.names))
        for k, step in enumerate(1e-3 * np.diag(self.search.reach)):
            if self.search.excess(at.values + step) or self.search.excess(at.values - step):
                effect[:, k] *= 1e-6  # it stands at a limit: the last to be taken
        if self.place is not None:
            effect[:, self.place] *= 1e9  # always among them
        order = qr(effect, pivoting=True, mode="r")[1]
        self.search.still[order[rank:]] = True

    def corrected(
        self, at: SearchPoint, row: Array | None = None, target: float | None = None
    ) -> SearchPoint | None:
        """Orbit near a point, by Newton's method; None where it does not converge.

        It is searched the shortest way, across a scaled direction, or where the parameter has a
        target value.
        """
        for _ in range(_NEWTON):
            off = 0.0 if target is None else target - self.value(at)
            if not np.isfinite(at.size):
                return None
            if at.residual <= 0.1 * TOLERANCE and abs(off) <= TOLERANCE:
                return at
            matrix, slope, right, nodes = self.equations(at)
            if not np.isfinite(matrix).all():
                return None
            more = slope if target is not None else row
            if more is not None:
                matrix, right = np.vstack([matrix, more]), np.r_[right, off]
            step = np.asarray(np.linalg.lstsq(matrix, right, rcond=_ROUNDING)[0], float)
            at = self.fly(*self.search.moved(at, nodes, step))
        return at if at.residual <= TOLERANCE else None

    def placed(self, at: SearchPoint, before: Array | None, way: float) -> _Place:
        """Orbit with its tangent, which goes on as before, or first to larger or smaller values."""
        matrix, slope, _, _ = self.equations(at)
        moving = np.r_[np.ones(self.count, bool), ~self.search.still]
        tangent = np.zeros(matrix.shape[1])
        _, sizes, ways = np.linalg.svd(matrix[:, moving])
        ways = ways[np.count_nonzero(sizes > _ROUNDING * sizes[0]) :]  # several at a branch point
        goes = ways @ (way * slope if before is None else before)[moving]
        tangent[moving] = goes @ ways / max(np.linalg.norm(goes), _ROUNDING)
        size = orbit_of(self.search, at).multipliers
        return _Place(at, self.value(at), tangent, float(slope @ tangent), size)

    def next(self, here: _Place, length: float) -> _Place | None:
        """Orbit at a distance along the branch, or None."""
        _, _, _, nodes = self.equations(here.at)
        ahead = self.fly(*self.search.moved(here.at, nodes, length * here.tangent))
        at = self.corrected(ahead, here.tangent)
        if at is None:
            return None
        found = self.placed(at, here.tangent, 1.0)
        return found if found.tangent @ here.tangent >= _BEND else None


def _walk(
    curve: _Curve, way: float, limits: tuple[float, float], points: int, tell: Callable[[int], Any]
) -> tuple[list[_Place], str]:
    """Orbits from the first to an end of the branch, and why it ends there."""
    here = curve.placed(curve.first.at, None, way)
    low, high = limits
    longest = _LONGEST * (high - low) / max(abs(here.pace), 1e-9)
    length, found = longest * _FIRST / _LONGEST, list[_Place]()
    if here.value == (high if way > 0 else low):
        return found, f"the limit {here.value:.5g} {curve.unit}"
    while len(found) < points:
        tell(len(found))
        ahead, end = curve.next(here, length), None
        if ahead is not None and not low <= ahead.value <= high:
            end = min(max(ahead.value, low), high)
            at = curve.corrected(ahead.at, target=end)
            ahead = None if at is None else curve.placed(at, here.tangent, 1.0)
        excess = ""
        if ahead is not None:
            excess = curve.search.excess(ahead.at.values) or curve.search.strained(ahead.at)
        if ahead is None or excess:
            length /= 2
            if length < _SHORTEST * longest:
                return found, excess or f"no orbit was found beyond {here.value:.5g} {curve.unit}"
            continue
        found.append(ahead._replace(marks=_marks(curve, here, ahead, way, length)))
        if end is not None:
            return found, f"the limit {end:.5g} {curve.unit}"
        here, length = ahead, min(1.5 * length, longest)
    return found, f"{points} orbits"


def _marks(
    curve: _Curve, here: _Place, ahead: _Place, way: float, length: float
) -> tuple[Bifurcation, ...]:
    """Bifurcations between neighbors, in the order of the branch from its least end."""
    marks: list[tuple[float, str, _Place, complex]] = []
    turned = here.pace * ahead.pace < 0
    if turned:
        part, place = _between(curve, here, length, lambda one: np.sign(one.pace))
        near = place.size[np.argmin(np.abs(place.size - 1.0))]
        marks.append((part, "fold", place, near))
    if _unstable(here) != _unstable(ahead):
        part, place = _between(curve, here, length, _unstable)
        apart = np.abs(np.abs(place.size) - 1.0)
        near = place.size[apart < max(_NEAR, 1.01 * apart.min())]
        crossing = near[np.argmax(np.abs(near - 1.0))]  # neutral ones stay at 1
        kind = crossing_kind(crossing)
        if not (kind == "branch point" and turned):
            marks.append((part, kind, place, crossing))
    return tuple(
        Bifurcation(kind, place.value, complex(multiplier), orbit_of(curve.search, place.at))
        for _, kind, place, multiplier in sorted(marks, key=lambda one: way * one[0])
    )


def crossing_kind(multiplier: complex) -> str:
    """Name of the bifurcation at which a multiplier crosses the unit circle."""
    if abs(multiplier.imag) > 1e-6:
        return "Neimark-Sacker"
    return "flip" if multiplier.real < 0 else "branch point"


def _unstable(place: _Place) -> int:
    """Number of multipliers outside of the unit circle."""
    return int(np.count_nonzero(np.abs(place.size) > 1.0 + _OUTSIDE))


def _between(
    curve: _Curve, here: _Place, length: float, number: Callable[[_Place], float]
) -> tuple[float, _Place]:
    """Part of a step and orbit at which a number of an orbit changes, by bisection."""
    low, high, place = 0.0, 1.0, here
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        found = curve.next(here, middle * length)
        if found is None:
            break
        place = found
        low, high = (middle, high) if number(found) == number(here) else (low, middle)
    return low, place
