"""Course of a periodic orbit: where its beats are, one after another, and departures from it.

A beat moves the flight and turns its heading. Nothing depends on the place or the heading, so that
departures are seen along the heading with which the orbit began the beat, as in the first one.
Nor does anything depend on how far a flight has come: it is compared with the orbit where that is
as far, straight ahead or along the circle of a turn. The time decides of the height alone, and in
hover, where nothing is ahead, of the place.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from patagium.arrays import Array
from patagium.control.orbit import Frame
from patagium.errors import ParameterError

CLOSED, TURNS = 1e-4, 1e-6
"""Largest change of a state, but for place and heading, over a beat, and over its largest value
where that is above one [m/s, rad, rad/s]; and the change of the heading from which it turns, more
than other time steps make of a straight orbit [rad]."""
STANDS = 1e-6
"""Largest horizontal way of a beat of a hover, more than other time steps make of one [m]."""


class Course:
    """Course of an orbit through a beat, and through all that follow.

    Args:
        names: Names of the entries of a state, with x, y and z.
        states: Orbit at the beginning of each interval of a beat, and at its end,
            (parts + 1, n) [SI].

    Raises:
        ParameterError: If the state does not return after the beat, or a turn is one on the spot.

    Attributes:
        states: Those but the end, (parts, n) [SI].
        travel: Way of a beat along x, y and z, (3,) [m].
        turn: Change of the heading in a beat [rad].
        stands: Whether it hovers, maybe climbing, so that no way is ahead.
        origin: Way by which the course is moved, (3,) [m]; zero to begin with.
        heading: Angle by which it is turned about the vertical [rad]; zero to begin with.
        lead: Angle by which the flight is ahead of the time on the circle of a turn [rad].
        center: Center of the circle of a turn, x + iy [m]; zero of a straight course.
        pairs: Places of x and y, and of other horizontal vectors, (m, 2) [-].
        ahead: Change of the state with the way ahead at each interval, (parts, n) [SI/m].
    """

    def __init__(self, names: Sequence[str], states: Array) -> None:
        self.names = tuple(names)
        self.states, end = states[:-1], states[-1]
        self.places = [self.names.index(name) for name in ("x", "y", "z")]
        self.yaw = self.names.index("yaw") if "yaw" in self.names else None
        self.pairs = np.array([self.places[:2], *Frame(self.names).vectors])
        self.travel = (end - states[0])[self.places]
        turned = 0.0 if self.yaw is None else float(end[self.yaw] - states[0, self.yaw])
        self.turn = turned if abs(turned) > TURNS else 0.0
        self.origin, self.heading, self.lead, self.center = np.zeros(3), 0.0, 0.0, 0j
        self.ahead = np.zeros_like(self.states)
        self.stands = bool(np.hypot(*self.travel[:2]) <= STANDS)
        self.ahead[:, self.places[0]] = not self.stands
        if not self.stands and abs(self.travel[0]) > abs(self.travel[1]):  # who is lopsided crabs
            self.ahead[:, self.places[1]] = self.travel[1] / self.travel[0]
        if self.turn:
            self._bend()
        sizes = np.maximum(1.0, np.abs(self.states).max(axis=0))
        left = np.abs(self.apart(len(self.states), end)) / sizes
        if not left.max() <= CLOSED:
            expected = f"an orbit whose state returns after a beat, to {CLOSED:g}"
            k = int(np.argmax(left))
            found = f"{self.names[k]} changes by {left[k] * sizes[k]:.3g}"
            raise ParameterError("orbit", expected, found)

    def _bend(self) -> None:
        """Find the center of a turn, and how states change along its circle."""
        vectors = self._vectors(self.states)
        begun = complex(*self.travel[:2]) * 1j * self.turn / (np.exp(1j * self.turn) - 1.0)
        self.center = vectors[0, 0] - begun / (1j * self.turn)
        vectors[:, 0] -= self.center
        moved = 1j * self.turn * vectors
        if not moved[:, 0].real.min() > 0.5 * abs(begun):
            expected = "a turn along a circle, the heading within 60 deg of the way"
            radius = abs(begun / self.turn)
            raise ParameterError("orbit", expected, f"a turn on the spot, of radius {radius:.3g} m")
        self._place(self.ahead, moved / moved[:, :1].real)
        self.ahead[:, self.yaw] = self.turn / moved[:, 0].real

    def _vectors(self, states: Array) -> NDArray[np.complex128]:
        """Horizontal vectors of states, as x + iy, (..., m)."""
        return np.asarray(
            states[..., self.pairs[:, 0]] + 1j * states[..., self.pairs[:, 1]], complex
        )

    def _place(self, states: Array, vectors: NDArray[np.complex128]) -> None:
        states[..., self.pairs[:, 0]] = vectors.real
        states[..., self.pairs[:, 1]] = vectors.imag

    def _turned(self, first: int) -> float:
        """Angle of the beat of an interval from the first one, about the vertical [rad]."""
        return self.turn * (first // len(self.states)) + self.lead

    def along(self, first: int) -> Array:
        """State of the orbit at the beginning of an interval by its number, (n,) [SI]."""
        beat, part = divmod(first, len(self.states))
        found, turned = self.states[part].copy(), self._turned(first)
        vectors = self._vectors(found)
        vectors[0] -= self.center
        vectors *= np.exp(1j * turned)
        vectors[0] += self.center + (0.0 if self.turn else beat * complex(*self.travel[:2]))
        self._place(found, vectors * np.exp(1j * self.heading))
        found[self.places[2]] += beat * self.travel[2]
        found[self.places] += self.origin
        if self.yaw is not None:
            found[self.yaw] += self.heading + turned
        return np.asarray(found)

    def catch_up(self, first: int, state: Array) -> None:
        """Go on to where a flight is on the circle of a turn at the beginning of an interval."""
        apart = self._vectors(self.seen(first, state - self.along(first)))[0]
        radius = self._vectors(self.states[first % len(self.states)])[0] - self.center
        if self.turn and np.isfinite(apart):
            self.lead += float(np.angle(1.0 + apart / radius))

    def seen(self, first: int, rows: Array) -> Array:
        """Changes of the state, (..., n), seen along the heading of an interval's beat [SI]."""
        found = np.array(rows)
        angle = self.heading + self._turned(first)
        self._place(found, self._vectors(found) * np.exp(-1j * angle))
        return found

    def apart(self, first: int, states: Array) -> Array:
        """Departures of states from the orbit at an interval, (..., n) [SI]; x in hover alone."""
        found = self.seen(first, states - self.along(first))
        if self.yaw is not None:  # headings are known but for whole turns
            found[..., self.yaw] -= 2 * np.pi * np.round(found[..., self.yaw] / (2 * np.pi))
        way = found[..., self.places[:1]]
        return np.asarray(found - way * self.ahead[first % len(self.states)])

    def after(self, part: int, slopes: Array) -> Array:
        """Derivatives of the state after an interval, (n, m), as those of the departure then."""
        moved = slopes.T.copy()
        if part + 1 == len(self.states):
            self._place(moved, self._vectors(moved) * np.exp(-1j * self.turn))
        way = moved[:, self.places[:1]]
        return np.asarray(moved - way * self.ahead[(part + 1) % len(self.states)]).T
