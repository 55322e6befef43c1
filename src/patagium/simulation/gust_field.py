"""Traveling gust as the integrator looks it up, between the state and its rate.

Where strips are in the gust is a function of state and row; what is there ends the row.
Neglected: what `aerodynamics.traveling_gust` neglects.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from patagium.aerodynamics.traveling_gust import GUST_COMPONENTS, CubicPieces, gusts_at_strips
from patagium.native import NativeFunction, load_kernel

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class GustField:
    """Traveling gust and the delays with which strips meet the gust.

    Attributes:
        meet: Delays of the strips, (4, n) [s, -], of (state, row, robot and aero parameters).
        constants: Robot and aero parameters.
        pieces: The gust from one time to another.
        slowness: Of the gust, the inverse of its speed [s/m].
        fastest: No part of the robot is faster [m/s].
    """

    meet: NativeFunction
    constants: tuple[Array, Array]
    pieces: Callable[[float, float], CubicPieces]
    slowness: float
    fastest: float

    @property
    def strips(self) -> int:
        """Number of strips."""
        return self.meet.size_out[0][1]

    def gust_pieces(self, states: Array, rows: Array, first: float, last: float) -> CubicPieces:
        """All of the gust that can be met in a stretch of time.

        Args:
            states: States at its beginning, or at all times of it, (N, size) [SI].
            rows: Prescribed rows then, (N, row_size) [SI].
            first: Where it begins [s].
            last: Where it ends [s].
        """
        delays = self._delays(states, rows)
        reach = np.abs(delays[:, :, 1]).max() + self.fastest * self.slowness * (last - first)
        earliest, latest = delays[:, :, 0].min(), delays[:, :, 0].max()
        return self.pieces(float(first - latest - reach), float(last - earliest + reach))

    def with_gust(self, states: Array, rows: Array, times: Array, pieces: CubicPieces) -> Array:
        """Rows with what strips meet, (N, row_size + 9 n).

        Args:
            states: States, (N, size) [SI].
            rows: Prescribed rows, (N, row_size) [SI].
            times: (N,) [s].
            pieces: All of the gust that is met.
        """
        return np.column_stack([rows, _met(pieces, times, self._delays(states, rows))])

    def without_gust(self, rows: Array) -> Array:
        """Rows of full length, with nothing met, (N, row_size + 9 n).

        Args:
            rows: Prescribed rows, (N, row_size) [SI].
        """
        return np.column_stack([rows, np.zeros((len(rows), GUST_COMPONENTS * self.strips))])

    def _delays(self, states: Array, rows: Array) -> Array:
        """Strip after strip, (N, n, 4)."""
        pairs = zip(states, self.without_gust(rows), strict=True)
        found = [np.reshape(self.meet(*pair, *self.constants), (4, -1)).T for pair in pairs]
        return np.ascontiguousarray(found)


def _met(pieces: CubicPieces, times: Array, delays: Array) -> Array:
    """Gust at the strips, strip after strip, (N, 9 n), from delays (N, n, 4)."""
    library, (count, strips, _) = load_kernel("march"), delays.shape
    if library is None:
        met = gusts_at_strips(pieces, times, delays.swapaxes(1, 2))
        return met.swapaxes(1, 2).reshape(count, -1)
    found = np.empty((count, GUST_COMPONENTS * strips))
    cubics, at = np.ascontiguousarray(pieces.coefficients), np.ascontiguousarray(times)
    library.met_by_strips(
        ctypes.c_long(count),
        ctypes.c_long(len(pieces.knots)),
        *(ctypes.c_void_p(array.ctypes.data) for array in (pieces.knots, cubics, at)),
        ctypes.c_long(strips),
        ctypes.c_void_p(delays.ctypes.data),
        ctypes.c_void_p(found.ctypes.data),
    )
    return found
