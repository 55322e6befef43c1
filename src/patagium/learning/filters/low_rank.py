"""The filter for many weights: the inverse of their covariance is a diagonal plus few columns.

    P^-1 = U + F F',  U diagonal, F (n, r).

The columns s_i of a square root of P are turned until all but n_y of them leave y where it is
to first order: with H = dy/dW and H P H' = V diag(l) V', the columns P H' V l^(-1/2) are the
ones y sees, and the points of `spread` lie along these alone. A sample adds n_y columns
H_e' M^(-1/2) to F; the r strongest, measured by U, are kept, and of the others the diagonal
is added to U. Neglected: what the dropped columns say of pairs of weights; bends along
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
from scipy.linalg import cho_factor, cho_solve, eigh, solve_triangular

from patagium.errors import Outcome
from patagium.learning.filters.array import (
    Prediction,
    nothing_known,
    screened,
)
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.root import MatrixLost, lower_factor
from patagium.learning.filters.spread import Moments, moments_of
from patagium.learning.filters.state import vector
from patagium.learning.models.network import Encoding
from patagium.learning.settings import LowRank

Array = NDArray[np.float64]
_LEAST = 1e-10  # of U beside the squares of a row of F, so that differences keep digits
_UNSEEN = 1e-13  # share of the largest variance of y below which a direction is rounding
_STEEPEST = 1e100  # of dy/dW: its square is a number
_FARTHEST = 1e18  # of a column of P^-1: its square is a number in single precision too


class Precision(NamedTuple):
    """The inverse of a covariance, U + F F'.

    Attributes:
        diagonal: U, (n,).
        columns: F, (n, r).
    """

    diagonal: Array
    columns: Array

    def solve(self, vectors: Array) -> Array:
        """(U + F F')^-1 v for vectors v, (n, m)."""
        scaled, columns = vectors / self.diagonal[:, None], self.columns
        inner = np.eye(columns.shape[1]) + columns.T @ (columns / self.diagonal[:, None])
        part = cho_solve(cho_factor(inner, check_finite=False), columns.T @ scaled)
        return np.asarray(scaled - (columns @ part) / self.diagonal[:, None])

    def variances(self) -> Array:
        """Diagonal of (U + F F')^-1, (n,)."""
        diagonal, columns = self
        scaled = columns / diagonal[:, None]
        lower = np.linalg.cholesky(np.eye(columns.shape[1]) + columns.T @ scaled)
        part = solve_triangular(lower, scaled.T, lower=True)
        return np.asarray(1.0 / diagonal - np.einsum("ij,ij->j", part, part))

    def drifted(self, growth: float, noise: Array) -> Precision:
        """The inverse of growth P + diag(noise), as exactly.

        Args:
            growth: Factor of the covariance; where it is 0 the noise is all of it.
            noise: Variances added, (n,).
        """
        if growth == 0:
            return Precision(1.0 / noise, np.zeros_like(self.columns))
        damping = growth + noise * self.diagonal
        inner = self.columns.T @ (self.columns * (noise / (growth * damping))[:, None])
        inner[np.diag_indices_from(inner)] += 1.0 / growth
        lower = np.linalg.cholesky(inner)
        columns = solve_triangular(lower, (self.columns / damping[:, None]).T, lower=True).T
        return Precision(self.diagonal / damping, columns)

    def compressed(self, rank: int) -> Precision:
        """The strongest columns, and of the others the diagonal; U is kept from vanishing.

        Args:
            rank: How many columns to keep.
        """
        scaled = self.columns / np.sqrt(self.diagonal)[:, None]
        _, turn = eigh(scaled.T @ scaled, check_finite=False)
        turned = self.columns @ turn[:, ::-1]
        squares = turned**2
        diagonal = self.diagonal + squares[:, rank:].sum(axis=1)
        return Precision(np.maximum(diagonal, _LEAST * squares.sum(axis=1)), turned[:, :rank])


def seen_directions(covariance: Array) -> tuple[Array, Array]:
    """What y sees of the weights to first order: variances, (q,), and their axes, (n_y, q).

    Args:
        covariance: H P H', (n_y, n_y).
    """
    variances, axes = eigh(covariance)
    clear = variances > _UNSEEN * max(variances.max(), 0.0)
    return variances[clear], axes[:, clear]


class LowRankFilter:
    """Filter of a diagonal plus low rank; of order n (r + n_y)^2 a sample, memory n (r + 2 n_y).

    Args:
        setting: What it is made of; its structure is a `LowRank`.
        mean: Weights to start from, (n,).
        precision: Inverse of their covariance.
    """

    def __init__(self, setting: FilterNumbers, mean: Array, precision: Precision) -> None:
        self.setting = setting
        self.screen = setting.screen()
        self.mean = np.array(mean, float)
        self.nis = float("nan")
        self._precision = self._rounded(precision)
        self._grown: Precision | None = None

    def precision(self) -> Precision:
        """Inverse of the covariance after the last sample."""
        return Precision(*(np.asarray(part, float) for part in self._precision))

    def drift(self, growth: float, noise: Array) -> None:
        """P <- growth P + diag(noise), once; growth > 0."""
        self._precision = self._rounded(self.precision().drifted(growth, noise))
        self._grown = None

    def covariance(self) -> Array:
        """P after the last sample, (n, n): not for many weights."""
        return self.precision().solve(np.eye(len(self.mean)))

    def variances(self) -> Array:
        """Its diagonal, (n,)."""
        return self.precision().variances()

    @np.errstate(over="ignore", invalid="ignore")
    def predict(self, x: Array) -> Prediction:
        """y at x, before it is measured."""
        encoding = self.setting.network.encode_one(x)
        found, _, _ = self._seen(encoding, self._advanced())
        return Prediction(found.mean, found.covariance)

    @np.errstate(over="ignore", invalid="ignore")
    def update(self, x: Array, y: Array) -> tuple[Outcome, Prediction]:
        """Learn one sample; whatever is not COMPLETED changed neither mean nor covariance."""
        refused = self.screen.admit()
        if refused:
            return refused, nothing_known(len(y))
        before, encoding = self._advanced(), self.setting.network.encode_one(x)
        if not (np.isfinite(encoding.features).all() and np.isfinite(encoding.readout).all()):
            self.screen.note("bad_inputs")
            return Outcome.BAD_INPUT, nothing_known(len(y))
        try:
            found, columns, sensed = self._seen(encoding, before)
        except MatrixLost as lost:
            return lost.outcome, nothing_known(len(y))
        prediction = Prediction(found.mean, found.covariance)
        sample = screened(self.screen, encoding, found, y)
        if isinstance(sample, Outcome):
            return sample, prediction
        moments, innovation = sample
        try:
            total, noise = lower_factor(moments.covariance), lower_factor(moments.remainder)
        except MatrixLost as lost:
            return lost.outcome, prediction
        whitened = solve_triangular(total, innovation, lower=True, check_finite=False)
        gain = solve_triangular(total, whitened, lower=True, trans="T", check_finite=False)
        nis, mean = float(whitened @ whitened), self.mean + columns @ (moments.slopes @ gain)
        seen = (sensed @ moments.slopes).T
        added = solve_triangular(noise, seen, lower=True, check_finite=False).T
        if not (np.isfinite(nis) and np.isfinite(mean).all() and np.abs(added).max() < _FARTHEST):
            return Outcome.NOT_FINITE, prediction
        after = Precision(before.diagonal, np.hstack([before.columns, added]))
        self._precision = self._rounded(after.compressed(self._rank))
        self.mean, self._grown, self.nis = mean, None, nis
        inverse = solve_triangular(total, np.eye(len(total)), lower=True)
        self.screen.learned(gain, np.einsum("ij,ij->j", inverse, inverse), nis)
        return Outcome.COMPLETED, prediction

    def state(self) -> dict[str, Array]:
        """All that the next samples depend on, as arrays by name."""
        diagonal, columns = self._precision
        return {
            "mean": self.mean.copy(),
            "nis": np.array(self.nis),
            "diagonal": diagonal.copy(),
            "columns": columns.copy(),
        }

    def resume(self, state: Mapping[str, Array]) -> None:
        """Go on from a state."""
        mean = vector(state, "mean", len(self.mean))
        diagonal = vector(state, "diagonal", len(mean))
        columns = vector(state, "columns", *self._precision.columns.shape)
        self.mean, self.nis = mean, float(state["nis"])
        self._precision, self._grown = self._rounded(Precision(diagonal, columns)), None

    @property
    def _rank(self) -> int:
        structure = self.setting.structure
        return structure.rank if isinstance(structure, LowRank) else len(self.mean)

    def _rounded(self, precision: Precision) -> Precision:
        return Precision(*(np.ascontiguousarray(part, self.setting.dtype) for part in precision))

    def _advanced(self) -> Precision:
        """The precision before the next sample, forgetting and noise done."""
        if self._grown is None:
            setting = self.setting
            growth = 1.0 / setting.forgetting_factor
            self._grown = self.precision().drifted(growth, setting.process_noise)
        return self._grown

    def _seen(self, encoding: Encoding, precision: Precision) -> tuple[Moments, Array, Array]:
        """Moments along the columns y sees, these columns, (n, q), and P^-1 times them."""
        y, slope = self.setting.network.linearized(encoding, self.mean)
        if not np.abs(slope).max() < _STEEPEST:
            raise MatrixLost(Outcome.NOT_FINITE)
        reached = precision.solve(slope.T)
        variances, axes = seen_directions(slope @ reached)
        turn = axes / np.sqrt(variances)
        columns = reached @ turn
        return self._moments(encoding, y, columns, variances, axes), columns, slope.T @ turn

    def _moments(
        self, encoding: Encoding, y: Array, columns: Array, variances: Array, axes: Array
    ) -> Moments:
        """What the points along the columns say of y; elsewhere y stays where it is."""
        rule = self.setting.rule
        steps = rule.spread * columns.T
        points = self.mean + np.concatenate([steps, -steps])
        plus, minus = np.split(self.setting.network.values(encoding, points), 2)
        return self._moments_at(encoding, y, plus, minus)

    def _moments_at(self, encoding: Encoding, y: Array, plus: Array, minus: Array) -> Moments:
        """The same from y at the mean and at the points on either side, (q, n_y)."""
        rule = self.setting.rule
        rest = rule.bend_gain * rule.centered * (len(self.mean) - len(plus))
        found = moments_of(y, plus, minus, self.screen.noise(encoding.readout), rule)
        shift = found.mean - y
        return found._replace(remainder=found.remainder + rest * np.outer(shift, shift))


class ExtendedLowRankFilter(LowRankFilter):
    """The same with y linear in the weights: no points."""

    def _moments(
        self, encoding: Encoding, y: Array, columns: Array, variances: Array, axes: Array
    ) -> Moments:
        slopes = np.sqrt(variances)[:, None] * axes.T
        return Moments(y, slopes, np.diag(self.screen.noise(encoding.readout)))
