"""Covariance of many weights by its inverse: a diagonal plus few columns, in NumPy.

    P^-1 = U + F F',  U diagonal, F (n, r).

The columns s_i of a square root of P are turned until all but n_y of them leave y where it is
to first order: with H = dy/dW and H P H' = V diag(l) V', the columns P H' V l^(-1/2) are the
ones y sees, and the points of `spread` lie along these alone. A sample adds n_y columns
H_e' M^(-1/2) to F; the r strongest, measured by U, are kept, and of the others the diagonal
is added to U. Neglected: what the dropped columns say of pairs of weights; curvature along
directions y does not see to first order.

References:
    Chang, Duran-Martin, Shestopaloff, Jones & Murphy (2023), Low-rank extended Kalman
    filtering for online learning of neural networks from streaming data, CoLLAs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, solve_triangular

from patagium.errors import Outcome
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.root import MatrixLost, lower_factor
from patagium.learning.filters.spread import Moments, moments_of
from patagium.learning.filters.state import vector
from patagium.learning.filters.structure import Look, Structure
from patagium.learning.filters.weight_covariance import Precision
from patagium.learning.settings import LowRank

Array = NDArray[np.float64]
_UNSEEN = 1e-13  # share of the largest variance of y below which a direction is rounding
_STEEPEST = 1e100  # of dy/dW: its square is a number
_FARTHEST = 1e18  # of a column of P^-1: its square is a number in single precision too


def seen_directions(covariance: Array) -> tuple[Array, Array]:
    """Directions of the weights that move y: variances, (q,) [y^2], and axes, (n_y, q).

    Args:
        covariance: H P H', (n_y, n_y) [y^2].
    """
    variances, axes = eigh(covariance)
    clear = variances > _UNSEEN * max(variances.max(), 0.0)
    return variances[clear], axes[:, clear]


class Directions(NamedTuple):
    """Directions of the weights that y is seen along.

    Attributes:
        columns: Columns of a square root of P, (n, q) [1].
        sensed: P^-1 times these columns, (n, q) [1].
    """

    columns: Array
    sensed: Array


def rank_of(numbers: FilterNumbers) -> int:
    """Number of columns of F, at most that of the weights.

    Args:
        numbers: Numbers of the filter.
    """
    structure = numbers.structure
    return min(structure.rank if isinstance(structure, LowRank) else 0, numbers.network.size)


def rounded(numbers: FilterNumbers, precision: Precision) -> Precision:
    """Precision with its numbers in the precision of the filter.

    Args:
        numbers: Numbers of the filter.
        precision: P^-1.
    """
    return Precision(*(np.ascontiguousarray(part, numbers.dtype) for part in precision))


def doubled(precision: Precision) -> Precision:
    """Precision with its numbers in double precision.

    Args:
        precision: P^-1.
    """
    return Precision(*(np.asarray(part, float) for part in precision))


def moments_along(look: Look, y: Array, plus: Array, minus: Array) -> Moments:
    """Moments of y from its values on either side along the directions that y is seen along.

    Args:
        look: Sample before it is measured.
        y: y(W), (n_y,) [unit of y].
        plus: y(W + kappa s_i), (q, n_y).
        minus: y(W - kappa s_i), (q, n_y).
    """
    rule = look.numbers.rule
    rest = rule.curvature_gain * rule.centered * (len(look.mean) - len(plus))
    found = moments_of(y, plus, minus, look.noise, rule)
    shift = found.mean - y
    return found._replace(remainder=found.remainder + rest * np.outer(shift, shift))


def linear_moments_along(look: Look, y: Array, variances: Array, axes: Array) -> Moments:
    """Moments of y with the network linear around the weights.

    Args:
        look: Sample before it is measured.
        y: y(W), (n_y,) [unit of y].
        variances: Variances of y along its axes, (q,).
        axes: Axes of y along which it varies, (n_y, q) [1].
    """
    return Moments(y, np.sqrt(variances)[:, None] * axes.T, np.diag(look.noise))


def _start(numbers: FilterNumbers, std: Array) -> Precision:
    columns = np.zeros((len(std), rank_of(numbers)))
    return rounded(numbers, Precision(1.0 / std**2, columns))


def _drifted(
    numbers: FilterNumbers, precision: Precision, growth: float, noise: Array | None
) -> Precision:
    added = np.zeros(len(precision.diagonal)) if noise is None else noise
    return rounded(numbers, doubled(precision).drifted(growth, added))


def _moments(precision: Precision, look: Look) -> tuple[Moments, Directions]:
    network, rule = look.numbers.network, look.numbers.rule
    y, slope = network.linearized(look.encoding, look.mean)
    if not np.abs(slope).max() < _STEEPEST:
        raise MatrixLost(Outcome.NOT_FINITE)
    reached = doubled(precision).solve(slope.T)
    variances, axes = seen_directions(slope @ reached)
    turn = axes / np.sqrt(variances)
    along = Directions(reached @ turn, slope.T @ turn)
    if look.numbers.linear:
        return linear_moments_along(look, y, variances, axes), along
    steps = rule.spread * along.columns.T
    values = network.values(look.encoding, look.mean + np.concatenate([steps, -steps]))
    return moments_along(look, y, *np.split(values, 2)), along


def _learned(
    precision: Precision, look: Look, along: Directions, moments: Moments, gain: Array
) -> tuple[Array, Precision]:
    noise = lower_factor(moments.remainder)
    seen = (along.sensed @ moments.slopes).T
    added = solve_triangular(noise, seen, lower=True, check_finite=False).T
    if not np.abs(added).max() < _FARTHEST:
        raise MatrixLost(Outcome.NOT_FINITE)
    diagonal, columns = doubled(precision)
    after = Precision(diagonal, np.hstack([columns, added])).compressed(rank_of(look.numbers))
    mean = look.mean + along.columns @ (moments.slopes @ gain)
    return mean, rounded(look.numbers, after)


def _packed(numbers: FilterNumbers, precision: Precision) -> dict[str, Array]:
    return {"diagonal": precision.diagonal.copy(), "columns": precision.columns.copy()}


def _unpacked(numbers: FilterNumbers, state: Mapping[str, Array]) -> Precision:
    diagonal = vector(state, "diagonal", numbers.network.size)
    columns = vector(state, "columns", numbers.network.size, rank_of(numbers))
    return rounded(numbers, Precision(diagonal, columns))


LOW_RANK = Structure(
    start=_start,
    drifted=_drifted,
    moments=_moments,
    learned=_learned,
    covariance=lambda numbers, precision: Precision(*(np.array(part, float) for part in precision)),
    variances=lambda numbers, precision: doubled(precision).variances(),
    packed=_packed,
    unpacked=_unpacked,
)
"""Inverse of a diagonal plus few columns; the state is a `Precision`.

A sample costs of order n (r + n_y)^2, memory is n (r + 2 n_y).
"""
