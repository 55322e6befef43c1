"""Covariance structure of a weight filter: functions with equal signatures over a state.

A structure keeps as much of the covariance P of the weights as its state holds: square roots of
blocks (`blocks`) or blocks of P itself (`blocks.WHOLE`). The state is that between two samples, or
that before the next one, forgetting and process noise done.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from patagium.arrays import Array
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.spread import Moments
from patagium.learning.filters.weight_covariance import BlockCovariance
from patagium.learning.models.network import Encoding


class Look(NamedTuple):
    """Sample before it is measured.

    Attributes:
        numbers: Numbers of the filter.
        mean: Weights W, (n,) [1].
        encoding: Features and readout of the network at the input.
        noise: Variances of the measurement, (n_y,) [y^2].
    """

    numbers: FilterNumbers
    mean: Array
    encoding: Encoding
    noise: Array


class Structure(NamedTuple):
    """Functions of a covariance structure.

    Attributes:
        start: State of independent weights: (numbers, standard deviations (n,)) -> state.
        drifted: State of growth P + diag(noise): (numbers, state, growth, noise (n,) [1] or None)
            -> state.
        moments: Moments of y, and directions of the weights that they are seen along: (state,
            look) -> moments, directions.
        learned: Weights and state after a sample: (state, look, directions, moments as screened,
            P_yy^-1 (y - mean) (n_y,)) -> W (n,), state.
        covariance: P: (numbers, state) -> covariance, which shares no memory with the state.
        variances: Diagonal of P, (n,) [1]: (numbers, state) -> array.
        packed: Arrays of a file: (numbers, state) -> arrays by name.
        unpacked: Inverse of `packed`: (numbers, arrays by name) -> state.
    """

    start: Callable[[FilterNumbers, Array], Any]
    drifted: Callable[[FilterNumbers, Any, float, Array | None], Any]
    moments: Callable[[Any, Look], tuple[Moments, Any]]
    learned: Callable[[Any, Look, Any, Moments, Array], tuple[Array, Any]]
    covariance: Callable[[FilterNumbers, Any], BlockCovariance]
    variances: Callable[[FilterNumbers, Any], Array]
    packed: Callable[[FilterNumbers, Any], dict[str, Array]]
    unpacked: Callable[[FilterNumbers, Mapping[str, Array]], Any]
