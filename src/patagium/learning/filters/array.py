"""The cubature filter in NumPy: the readable form of the kernel, and Algorithm 1 itself.

Both hold mean and covariance of the weights and take one encoded sample at a time.
Whatever fails leaves them as they were. Neglected: speed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from patagium.errors import Outcome
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.root import MatrixLost, lower_factor, measured_root, with_noise
from patagium.learning.filters.screening import Screen, Screened
from patagium.learning.filters.spread import Moments, moments_of
from patagium.learning.filters.state import (
    RootState,
    packed,
    root_state,
    symmetric,
    unpacked,
    vector,
)
from patagium.learning.models.network import Encoding

Array = NDArray[np.float64]
_POINTS_AT_ONCE = 256


class Prediction(NamedTuple):
    """y before it is measured.

    Attributes:
        mean: (n_y,).
        covariance: Noise of the measurement included, (n_y, n_y).
    """

    mean: Array
    covariance: Array


class WeightFilter(Protocol):
    """Mean and covariance of weights, and one step of a filter over them."""

    @property
    def screen(self) -> Screen:
        """What the samples go through."""
        ...

    @property
    def mean(self) -> Array:
        """W, (n,)."""
        ...

    @property
    def nis(self) -> float:
        """Normalized innovation squared e' P_yy^-1 e of the last sample learned."""
        ...

    def predict(self, x: Array) -> Prediction:
        """y at x, before it is measured.

        Raises:
            MatrixLost: If the covariance is no longer positive definite.
        """
        ...

    def update(self, x: Array, y: Array) -> tuple[Outcome, Prediction]:
        """Learn one sample; whatever is not COMPLETED changed nothing."""
        ...

    def drift(self, growth: float, noise: Array) -> None:
        """P <- growth P + diag(noise), once.

        Raises:
            MatrixLost: If the covariance is no longer positive definite.
        """
        ...

    def covariance(self) -> Array:
        """P after the last sample, (n, n)."""
        ...

    def variances(self) -> Array:
        """Its diagonal, (n,)."""
        ...

    def state(self) -> dict[str, Array]:
        """All that the next samples depend on, as arrays by name."""
        ...

    def resume(self, state: Mapping[str, Array]) -> None:
        """Go on from a state; KeyError or ShapeError, and nothing changes, if it does not fit."""
        ...


class ArrayFilter:
    """Square-root filter: S is carried through the measurement, see `root.measured_root`.

    Forgetting scales S; process noise costs a factorization of S S' + Q a sample.

    Args:
        setting: What it is made of.
        mean: Weights to start from, (n,).
        root: The lower triangular square root of their covariance, (n, n).
    """

    _measured = staticmethod(measured_root)

    def __init__(self, setting: FilterNumbers, mean: Array, root: Array) -> None:
        self.setting = setting
        self.screen = setting.screen()
        self.mean = np.array(mean, float)
        self.nis = float("nan")
        self._root = np.array(root, setting.dtype)
        self._grown: Array | None = None

    @np.errstate(over="ignore", invalid="ignore")
    def predict(self, x: Array) -> Prediction:
        """y at x, before it is measured."""
        found = self._moments(self.setting.network.encode_one(x), self._advanced())
        return Prediction(found.mean, found.covariance)

    @np.errstate(over="ignore", invalid="ignore")
    def update(self, x: Array, y: Array) -> tuple[Outcome, Prediction]:
        """Learn one sample; whatever is not COMPLETED changed neither mean nor covariance."""
        refused = self.screen.admit()
        if refused:
            return refused, nothing_known(len(y))
        root, encoding = self._advanced(), self.setting.network.encode_one(x)
        found = self._moments(encoding, root)
        prediction = Prediction(found.mean, found.covariance)
        sample = screened(self.screen, encoding, found, y)
        if isinstance(sample, Outcome):
            return sample, prediction
        (_, slopes, remainder), innovation = sample
        try:
            after, cross, inverse = self._measured(root, slopes, remainder)
        except MatrixLost as lost:
            return lost.outcome, prediction
        whitened = inverse.T @ innovation
        gain, nis = inverse @ whitened, float(whitened @ whitened)
        mean = self.mean + cross @ gain
        if not (np.isfinite(nis) and np.isfinite(mean).all() and np.isfinite(after).all()):
            return Outcome.NOT_FINITE, prediction
        self._root, self.mean = np.ascontiguousarray(after, root.dtype), mean
        self._grown = None
        self.nis = nis
        self.screen.learned(gain, np.einsum("ij,ij->i", inverse, inverse), nis)
        return Outcome.COMPLETED, prediction

    def drift(self, growth: float, noise: Array) -> None:
        """P <- growth P + diag(noise), once."""
        grown = with_noise(np.sqrt(growth) * self.root(), noise)
        self._root, self._grown = np.ascontiguousarray(grown, self.setting.dtype), None

    def root(self) -> Array:
        """The square root of the covariance after the last sample, (n, n)."""
        return self._root.astype(float)

    def covariance(self) -> Array:
        """P after the last sample, (n, n)."""
        root = self.root()
        return np.asarray(root @ root.T)

    def variances(self) -> Array:
        """Its diagonal, (n,)."""
        root = self.root()
        return np.asarray(np.einsum("ij,ij->i", root, root))

    def roots(self) -> list[Array]:
        """Square roots of the blocks of the covariance, (k, k) each: one of all weights."""
        return [self.root()]

    def state(self) -> dict[str, Array]:
        """All that the next samples depend on, as arrays by name."""
        return RootState(self.mean, self.nis, self.roots()).packed(self.setting.dtype)

    def resume(self, state: Mapping[str, Array]) -> None:
        """Go on from a state."""
        found = root_state(state, [len(root) for root in self.roots()])
        self.mean, self.nis = found.mean, found.nis
        self._root, self._grown = self._joined(found.roots).astype(self.setting.dtype), None

    def _joined(self, roots: list[Array]) -> Array:
        return roots[0]

    def _advanced(self) -> Array:
        """S before the next sample, forgetting and process noise done."""
        setting = self.setting
        if setting.forgetting_factor == 1 and not setting.has_process_noise:
            return self._root
        if self._grown is None:
            grown = self.root() / np.sqrt(setting.forgetting_factor)
            noisy = with_noise(grown, setting.process_noise) if setting.has_process_noise else grown
            self._grown = noisy.astype(setting.dtype)
        return self._grown

    def _moments(self, encoding: Encoding, root: Array) -> Moments:
        noise = self.screen.noise(encoding.readout)
        return point_moments(self.setting, encoding, noise, self.mean, root)


class CholeskyFilter:
    """Algorithm 1 of the paper: the covariance itself, factorized before every sample.

    Args:
        setting: What it is made of.
        mean: Weights to start from, (n,).
        root: A square root of their covariance, (n, n).
    """

    def __init__(self, setting: FilterNumbers, mean: Array, root: Array) -> None:
        self.setting = setting
        self.screen = setting.screen()
        self.mean = np.array(mean, float)
        self.nis = float("nan")
        self._covariance = np.asarray(root @ root.T, setting.dtype)

    @np.errstate(over="ignore", invalid="ignore")
    def predict(self, x: Array) -> Prediction:
        """y at x, before it is measured.

        Raises:
            MatrixLost: If the covariance is no longer positive definite.
        """
        encoding = self.setting.network.encode_one(x)
        found = self._moments(encoding, lower_factor(self._advanced()).astype(self.setting.dtype))
        return Prediction(found.mean, found.covariance)

    @np.errstate(over="ignore", invalid="ignore")
    def update(self, x: Array, y: Array) -> tuple[Outcome, Prediction]:
        """Learn one sample; whatever is not COMPLETED changed neither mean nor covariance."""
        refused = self.screen.admit()
        prediction = nothing_known(len(y))
        if refused:
            return refused, prediction
        covariance, encoding = self._advanced(), self.setting.network.encode_one(x)
        try:
            root = lower_factor(covariance).astype(self.setting.dtype)
            found = self._moments(encoding, root)
            prediction = Prediction(found.mean, found.covariance)
            sample = screened(self.screen, encoding, found, y)
            if isinstance(sample, Outcome):
                return sample, prediction
            moments, innovation = sample
            total = moments.covariance
            lower_factor(total)
        except MatrixLost as lost:
            return lost.outcome, prediction
        cross = root.astype(float) @ moments.slopes
        gain = np.linalg.solve(total, cross.T).T
        weighed = np.linalg.solve(total, innovation)
        nis, mean = float(innovation @ weighed), self.mean + gain @ innovation
        if not (np.isfinite(nis) and np.isfinite(mean).all()):
            return Outcome.NOT_FINITE, prediction
        smaller = covariance - gain @ total @ gain.T
        self._covariance = ((smaller + smaller.T) / 2).astype(self.setting.dtype)
        self.mean, self.nis = mean, nis
        inverse: Array = np.diagonal(np.linalg.inv(total)).astype(float)
        self.screen.learned(np.asarray(weighed, float), inverse, nis)
        return Outcome.COMPLETED, prediction

    def drift(self, growth: float, noise: Array) -> None:
        """P <- growth P + diag(noise), once."""
        covariance = growth * self.covariance()
        covariance[np.diag_indices_from(covariance)] += noise
        self._covariance = covariance.astype(self.setting.dtype)

    def root(self) -> Array:
        """The Cholesky factor of the covariance after the last sample, (n, n).

        Raises:
            MatrixLost: If it is no longer positive definite.
        """
        return lower_factor(self.covariance())

    def covariance(self) -> Array:
        """P after the last sample, (n, n)."""
        return self._covariance.astype(float)

    def variances(self) -> Array:
        """Its diagonal, (n,)."""
        return np.diagonal(self._covariance).astype(float)

    def state(self) -> dict[str, Array]:
        """All that the next samples depend on, as arrays by name."""
        lower = packed([self._covariance])
        return {"mean": self.mean.copy(), "nis": np.array(self.nis), "covariance": lower}

    def resume(self, state: Mapping[str, Array]) -> None:
        """Go on from a state."""
        mean = vector(state, "mean", len(self.mean))
        (lower,) = unpacked(np.asarray(state["covariance"], self.setting.dtype), [len(mean)])
        self.mean, self.nis = mean, float(state["nis"])
        self._covariance = symmetric(lower)

    def _moments(self, encoding: Encoding, root: Array) -> Moments:
        noise = self.screen.noise(encoding.readout)
        return point_moments(self.setting, encoding, noise, self.mean, root)

    def _advanced(self) -> Array:
        covariance = self.covariance() / self.setting.forgetting_factor
        covariance[np.diag_indices_from(covariance)] += self.setting.process_noise
        return covariance


def nothing_known(outputs: int) -> Prediction:
    """The prediction of a sample that was not looked at: NaN."""
    return Prediction(np.full(outputs, np.nan), np.full((outputs, outputs), np.nan))


def screened(screen: Screen, encoding: Encoding, found: Moments, y: Array) -> Screened | Outcome:
    """A sample as it is learned from, or why it is not.

    Args:
        screen: What it goes through.
        encoding: What the network sees of its input.
        found: Moments of y before it was measured.
        y: Measurement, (n_y,).
    """
    if not (np.isfinite(found.mean).all() and np.isfinite(found.covariance).all()):
        seen = np.isfinite(encoding.features).all() and np.isfinite(encoding.readout).all()
        if seen:
            return Outcome.NOT_FINITE
        screen.note("bad_inputs")
        return Outcome.BAD_INPUT
    sample = screen.screened(found, y)
    if sample is None:
        return Outcome.BLIND
    return sample if np.isfinite(sample.innovation).all() else Outcome.NOT_FINITE


def point_moments(
    setting: FilterNumbers, encoding: Encoding, noise: Array, mean: Array, root: Array
) -> Moments:
    """Moments of y at the points of a rule around the mean.

    Args:
        setting: What the filter is made of.
        encoding: What the network sees of its input.
        noise: Variances of the measurement, (n_y,).
        mean: W, (n,).
        root: S, (n, n); the points are evaluated in its precision.
    """
    network, rule = setting.network, setting.rule
    center = mean.astype(root.dtype)
    steps = np.asarray(rule.spread, root.dtype) * root.T
    values = [network.values(encoding, center[None])]
    for sign in (1, -1):
        for start in range(0, len(steps), _POINTS_AT_ONCE):
            part = center + sign * steps[start : start + _POINTS_AT_ONCE]
            values.append(network.values(encoding, part))
    y = np.concatenate(values)
    count = len(mean)
    return moments_of(y[0], y[1 : count + 1], y[count + 1 :], noise, rule)
