"""Weight filter: mean and covariance of a network's weights, moved by one sample at a time.

Prediction, update, screening, drift, state and pickling stand here once, for every covariance
structure (`blocks`), for the cubature points and for the network linear around the weights
(`spread`). Where a kernel learns a whole sample in one call of C (`block_kernel`), the filter
hands the sample on and keeps the books. Whatever fails leaves mean and covariance as they were.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from patagium.arrays import Array
from patagium.errors import Outcome
from patagium.learning.filters.block_kernel import BlockKernel, structure_and_kernel
from patagium.learning.filters.blocks import BlockRoots, Look
from patagium.learning.filters.kernel_memory import Compiled
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.root import MatrixLost, inverse_root
from patagium.learning.filters.screening import new_screen
from patagium.learning.filters.spread import Moments
from patagium.learning.filters.state import arrays_like, vector
from patagium.learning.filters.weight_covariance import BlockCovariance
from patagium.learning.models.network import Encoding


class WeightFilter:
    """Weight filter for a covariance structure, compiled where it can be.

    Args:
        numbers: Numbers of the filter.
        parts: Covariance structure, and kernel that learns whole samples; None: NumPy does.
        mean: Weights to start from, which a prior share goes back to, (n,) [1].
        std: Standard deviations of the weights, (n,) [1]; None: those of the prior.

    Attributes:
        numbers: Numbers of the filter.
        screen: Screening that the samples go through.
    """

    def __init__(
        self,
        numbers: FilterNumbers,
        parts: tuple[BlockRoots, BlockKernel | None],
        mean: Array,
        std: Array | None = None,
    ) -> None:
        self.numbers, (self._structure, kernel) = numbers, parts
        self.screen = new_screen(numbers) if kernel is None else kernel.screen
        self._kernel, self._prior = kernel, np.array(mean, float)
        if kernel is not None:
            kernel.prior[:] = mean
        self._noise = numbers.process_noise if numbers.has_process_noise else None
        start = np.sqrt(numbers.prior_variance) if std is None else std
        self._place(self._prior.copy(), float("nan"), self._structure.start(start))

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self.numbers, self._prior, self.state(), dict(self.screen.arrays))

    @property
    def mean(self) -> Array:
        """Weights W, (n,)."""
        return self._mean.copy()

    @property
    def nis(self) -> float:
        """Normalized innovation squared e' P_yy^-1 e of the last sample; NaN before the first."""
        return self._nis if self._kernel is None else self._kernel.nis

    @property
    def compiled(self) -> Compiled | None:
        """Filter as C code meets it; None where a sample takes Python as well."""
        return None if self._kernel is None else self._kernel.compiled

    @np.errstate(over="ignore", invalid="ignore")
    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean of y at x before it is measured, (n_y,), and covariance with noise, (n_y, n_y).

        Args:
            x: Input, (n_x,) [units of x].

        Raises:
            MatrixLost: If the covariance is no longer positive definite.
        """
        if self._kernel is not None:
            return self._kernel.predict(x)
        look = self._look(self.numbers.network.encode_one(x))
        found, _ = self._structure.moments(self._advanced(), look)
        stated = self.screen.stated_covariance(found.covariance, carried=False)
        return found.mean, stated

    @np.errstate(over="ignore", invalid="ignore")
    def update(self, x: Array, y: Array) -> tuple[Outcome, tuple[Array, Array]]:
        """Learn one sample; whatever is not COMPLETED changed neither mean nor covariance.

        Args:
            x: Input, (n_x,) [units of x].
            y: Measurement, (n_y,) [y]; NaN where a channel is missing.

        Returns:
            How it went, and what `predict` would have said before.
        """
        if self._kernel is not None:
            return self._kernel.update(x, y)
        prediction = np.full(len(y), np.nan), np.full((len(y), len(y)), np.nan)
        refused = self.screen.admit()
        if refused:
            return refused, prediction
        within = self.screen.bounded(x, y)
        if within is None:
            return Outcome.BAD_INPUT, prediction
        y = within
        self.screen.follow(y)  # before the noise is found
        encoding = self.numbers.network.encode_one(x)
        look = self._look(encoding)
        if not (np.isfinite(encoding.features).all() and np.isfinite(encoding.readout).all()):
            self.screen.note("bad_inputs")
            return Outcome.BAD_INPUT, prediction
        try:
            before = self._advanced()
            found, root = self._structure.moments(before, look)
            stated = self.screen.stated_covariance(found.covariance, carried=True)
            misfit = self.screen.misfit  # of the last error, what is still there at this sample
            mean = found.mean + misfit.parts["carried"] if misfit.floor else found.mean
            prediction = mean, stated
            return self._learn(before, look, root, found, y), prediction
        except MatrixLost as lost:
            return lost.outcome, prediction

    def drift(self, growth: float, noise: Array) -> None:
        """P <- growth P + diag(noise), once.

        Args:
            growth: Factor of the covariance.
            noise: Variances added to the weights, (n,) [1].

        Raises:
            MatrixLost: If the covariance is no longer positive definite.
        """
        drifted = self._structure.drifted(self.kept(), growth, noise)
        self._place(self._mean, self.nis, drifted)

    def reset(self) -> None:
        """Begin the covariance anew with that of the prior; the weights stay."""
        start = np.sqrt(self.numbers.prior_variance)
        self._place(self._mean, self.nis, self._structure.start(start))

    def kept(self) -> Any:
        """State of the covariance structure after the last sample."""
        return self._kept if self._kernel is None else self._kernel.kept()

    def covariance(self) -> BlockCovariance:
        """P after the last sample."""
        return self._structure.covariance(self.kept())

    def variances(self) -> Array:
        """Diagonal of P after the last sample, (n,)."""
        return self._structure.variances(self.kept())

    def state(self) -> dict[str, Array]:
        """Arrays by name that the next samples depend on, but for the screening's."""
        kept = self._structure.packed(self.kept())
        return {"mean": self.mean, "nis": np.array(self.nis), **kept}

    def resume(self, state: Mapping[str, Array]) -> None:
        """Go on from a state.

        Args:
            state: Arrays by name, of a filter with the same numbers, compiled or not.

        Raises:
            KeyError: If an array is missing.
            ShapeError: If an array has another shape; nothing changes then.
        """
        mean = vector(state, "mean", len(self._mean))
        self._place(mean, float(state["nis"]), self._structure.unpacked(state))

    def _place(self, mean: Array, nis: float, kept: Any) -> None:
        """Go on from mean, NIS and the state of the covariance structure."""
        self._before: Any = None
        if self._kernel is None:
            self._mean, self._nis, self._kept = mean, nis, kept
        else:
            self._kernel.place(mean, nis, kept)
            self._mean = self._kernel.mean

    def _advanced(self) -> Any:
        """State of the covariance before the next sample, forgetting and process noise done."""
        numbers = self.numbers
        if self._noise is None and numbers.forgetting_factor == 1:
            return self._kept
        if self._before is None:
            growth = 1.0 / numbers.forgetting_factor
            self._before = self._structure.drifted(self._kept, growth, self._noise)
        return self._before

    def _look(self, encoding: Encoding) -> Look:
        return Look(self._mean, encoding, self.screen.noise(encoding.readout))

    def _learn(self, before: Any, look: Look, root: Array, found: Moments, y: Array) -> Outcome:
        """Mean and covariance after the sample; MatrixLost if they would not be finite."""
        if not (np.isfinite(found.mean).all() and np.isfinite(found.covariance).all()):
            return Outcome.NOT_FINITE
        sample = self.screen.screened(found, y)
        if sample is None:
            return Outcome.BLIND
        moments, innovation = sample
        if not np.isfinite(innovation).all():
            return Outcome.NOT_FINITE
        inverse = inverse_root(moments.covariance).T
        whitened = inverse @ innovation
        stated = inverse @ self.screen.stated_innovation(innovation)
        gain, nis = inverse.T @ whitened, float(stated @ stated)
        if not np.isfinite(nis):
            return Outcome.NOT_FINITE
        mean, kept = self._structure.learned(before, look.mean, root, moments, gain)
        if not np.isfinite(mean).all():
            return Outcome.NOT_FINITE
        mean = mean + self.numbers.pull * (self._prior - look.mean)
        self._place(mean, nis, kept)
        squares = np.einsum("ij,ij->j", inverse, inverse)
        self.screen.learned(moments.mean, innovation, gain, squares, nis)
        return Outcome.COMPLETED


def _restored(
    numbers: FilterNumbers, prior: Array, state: Mapping[str, Array], seen: Mapping[str, Array]
) -> WeightFilter:
    """Weight filter of a pickle."""
    found = WeightFilter(numbers, structure_and_kernel(numbers), prior)
    found.resume(state)
    found.screen.restore(arrays_like(found.screen.arrays, seen))
    return found
