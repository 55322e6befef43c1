"""The filter of low rank in C: three passes over the weights, `kernels/low_rank.c`.

Between the passes only matrices of r + n_y rows are left, and NumPy does them: with
P^-1 = U + F F' and H = dy/dW, the products [F, H']' U^-1 [F, H'] give all of P H' and of the
columns to keep. Neglected: process noise, which NumPy adds in passes of its own before.
"""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, eigh, solve_triangular

from patagium.errors import Outcome
from patagium.learning.filters.array import (
    Prediction,
    nothing_known,
    screened,
)
from patagium.learning.filters.kernel_memory import ACTIVATION_CODES, aligned, rounded_up
from patagium.learning.filters.low_rank import (
    ExtendedLowRankFilter,
    LowRankFilter,
    Precision,
    seen_directions,
)
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.root import MatrixLost, lower_factor
from patagium.learning.filters.spread import Moments
from patagium.learning.models.network import Encoding
from patagium.learning.models.perceptron import PerceptronNetwork, as_perceptron
from patagium.native import load_kernel

Array = NDArray[np.float64]

_INTEGERS = ("rank", "padded", "depth", "items", "layers", "activation")
_STATE = ("mean", "diagonal", "columns", "next_mean", "next_diagonal", "next_columns")
_WORK = ("inputs", "seeds", "gram", "turn", "gains", "points")


class _LowRank(ctypes.Structure):
    """`low_rank` of the kernel, field by field."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in _INTEGERS),
        ("room", ctypes.c_int64),
        ("growth", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("widths", *_STATE, *_WORK)),
    ]


class _Seen(NamedTuple):
    """What a sample shows before it is measured.

    Attributes:
        moments: Of y.
        columns: [F, H'] times this, over U, are the columns y sees, (r + n_y, q).
        turn: H' times this is the inverse of P times them, (n_y, q).
        products: Of [F, H'], U^-1 between them, forgetting done, (r + n_y, r + n_y).
    """

    moments: Moments
    columns: Array
    turn: Array
    products: Array


def load_low_rank(dtype: str) -> ctypes.CDLL | None:
    """The kernel for U and F of one precision, or None without a compiler."""
    return load_kernel("low_rank", {"STORE": "float" if dtype == "float32" else "double"})


def restore_low_rank(
    setting: FilterNumbers, mean: Array, precision: Precision, linear: bool = False
) -> LowRankFilter:
    """A filter in the state given, compiled where there is a compiler and a perceptron.

    Args:
        setting: What it is made of; its structure is a `LowRank`.
        mean: Weights, (n,).
        precision: Inverse of their covariance.
        linear: Whether y is taken as linear around the weights: no points.
    """
    library = load_low_rank(setting.dtype)
    if library is None or not isinstance(setting.network, PerceptronNetwork):
        return (ExtendedLowRankFilter if linear else LowRankFilter)(setting, mean, precision)
    return LowRankKernel(setting, mean, precision, linear, library)


class LowRankKernel(LowRankFilter):
    """Filter of a diagonal plus low rank, compiled; equations and orders of `LowRankFilter`.

    U and F are kept in the dtype of the setting, twice, and all sums are in double.

    Args:
        setting: What it is made of; its structure is a `LowRank`.
        mean: Weights to start from, (n,).
        precision: Inverse of their covariance.
        linear: Whether y is taken as linear around the weights: no points.
        library: The compiled kernel.
    """

    def __init__(
        self,
        setting: FilterNumbers,
        mean: Array,
        precision: Precision,
        linear: bool,
        library: ctypes.CDLL,
    ) -> None:
        super().__init__(setting, mean, precision)
        self._linear, self._library = linear, library
        network = as_perceptron(setting.network)
        outputs, lanes = len(setting.noise), library.low_rank_lanes()
        widths, items = network.perceptron.widths, network.items
        rank = precision.columns.shape[1]
        padded, depth = rounded_up(outputs, lanes), rounded_up(rank + outputs, 8)
        room = items * max(widths) * 2 * padded
        sizes = {
            "inputs": (items * sum(widths[:-1]),),
            "seeds": (items * sum(widths[1:]), padded),
            "gram": (depth, depth),
            "turn": (depth * max(depth, padded),),
            "gains": (depth,),
            "points": (2, room),
        }
        self._work = {name: aligned(shape, np.dtype(float)) for name, shape in sizes.items()}
        self._spare = self._rounded(Precision(*(np.zeros_like(part) for part in precision)))
        self._widths = np.array(widths, np.int32)
        self._struct = _LowRank(
            rank=rank,
            padded=padded,
            depth=depth,
            items=items,
            layers=len(widths) - 1,
            activation=ACTIVATION_CODES[network.perceptron.activation],
            room=room,
            widths=self._widths.ctypes.data,
            **{name: array.ctypes.data for name, array in self._work.items()},
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return restore_low_rank, (self.setting, self.mean, self.precision(), self._linear)

    @np.errstate(over="ignore", invalid="ignore")
    def predict(self, x: Array) -> Prediction:
        """y at x, before it is measured."""
        seen = self._shown(self.setting.network.encode_one(x))
        return nothing_known(len(self.setting.noise)) if seen is None else _prediction(seen)

    @np.errstate(over="ignore", invalid="ignore")
    def update(self, x: Array, y: Array) -> tuple[Outcome, Prediction]:
        """Learn one sample; whatever is not COMPLETED changed neither mean nor covariance."""
        refused = self.screen.admit()
        if refused:
            return refused, nothing_known(len(y))
        encoding = self.setting.network.encode_one(x)
        if not (np.isfinite(encoding.features).all() and np.isfinite(encoding.readout).all()):
            self.screen.note("bad_inputs")
            return Outcome.BAD_INPUT, nothing_known(len(y))
        seen = self._shown(encoding)
        if seen is None:
            return Outcome.NOT_FINITE, nothing_known(len(y))
        prediction = _prediction(seen)
        sample = screened(self.screen, encoding, seen.moments, y)
        if isinstance(sample, Outcome):
            return sample, prediction
        return self._learn(seen, *sample), prediction

    def _learn(self, seen: _Seen, moments: Moments, innovation: Array) -> Outcome:
        """Mean, U and F after the sample."""
        try:
            total, noise = lower_factor(moments.covariance), lower_factor(moments.remainder)
        except MatrixLost as lost:
            return lost.outcome
        inverse = solve_triangular(total, np.eye(len(total)), lower=True)
        whitened = inverse @ innovation
        gain, nis = inverse.T @ whitened, float(whitened @ whitened)
        added = solve_triangular(noise, (seen.turn @ moments.slopes).T, lower=True).T
        if not (np.isfinite(nis) and np.isfinite(added).all()):
            return Outcome.NOT_FINITE
        mean = np.empty_like(self.mean)
        self._put("gains", (seen.columns @ (moments.slopes @ gain))[:, None], 1)
        self._put("turn", self._kept(seen.products, added), self._struct.depth)
        self._struct.next_mean = mean.ctypes.data
        if not self._call("low_rank_change"):
            return Outcome.NOT_FINITE
        self._spare, self._precision = self._precision, self._spare
        self.mean, self._grown, self.nis = mean, None, nis
        self.screen.learned(gain, np.einsum("ij,ij->j", inverse, inverse), nis)
        return Outcome.COMPLETED

    @property
    def _forgets(self) -> float:
        setting = self.setting
        return 1.0 if setting.has_process_noise else setting.forgetting_factor

    def _before(self) -> Precision:
        """U and F before the sample, but for forgetting, which the passes do."""
        return (
            self._rounded(self._advanced()) if self.setting.has_process_noise else self._precision
        )

    def _place(self, before: Precision) -> None:
        """Tell the kernel where everything is."""
        struct, spare = self._struct, self._spare
        self._held = before  # while the kernel has its address
        struct.mean, struct.growth = self.mean.ctypes.data, self._forgets
        struct.diagonal, struct.columns = (part.ctypes.data for part in before)
        struct.next_diagonal, struct.next_columns = (part.ctypes.data for part in spare)

    def _shown(self, encoding: Encoding) -> _Seen | None:
        """What y sees of the weights, and its moments; None where that is no number."""
        self._place(self._before())
        network = as_perceptron(self.setting.network)
        rank, outputs = self._struct.rank, len(self.setting.noise)
        out, inputs, seeds = network.perceptron.sensitivities(
            encoding.features, self.mean, encoding.readout
        )
        np.concatenate([part.ravel() for part in inputs], out=self._work["inputs"])
        seed = np.concatenate([part.reshape(-1, outputs) for part in seeds])
        self._work["seeds"][:, :outputs] = seed
        self._call("low_rank_products")
        forgets = np.sqrt(self._forgets)
        size = rank + outputs
        products = self._work["gram"][:size, :size] / np.repeat([1.0, forgets], [rank, outputs])
        products /= np.repeat([1.0, forgets], [rank, outputs])[:, None]
        if not np.isfinite(products).all():
            return None
        inner = cho_factor(np.eye(rank) + products[:rank, :rank])
        part = cho_solve(inner, products[:rank, rank:])
        sensed = products[rank:, rank:] - products[rank:, :rank] @ part
        variances, axes = seen_directions((sensed + sensed.T) / 2)
        turn = axes / np.sqrt(variances)
        columns = np.vstack([-forgets * (part @ turn), turn]) / forgets**2
        y = encoding.readout @ out.ravel() + encoding.offset
        if self._linear:
            slopes = np.sqrt(variances)[:, None] * axes.T
            noise = np.diag(self.screen.noise(encoding.readout))
            return _Seen(Moments(y, slopes, noise), columns, turn, products)
        self._put("turn", self.setting.rule.spread * columns, self._struct.padded)
        self._call("low_rank_points")
        ends = network.items * network.perceptron.widths[-1]
        values = self._work["points"].ravel()[: ends * 2 * self._struct.padded]
        values = values.reshape(ends, 2, -1)[:, :, : turn.shape[1]]
        plus, minus = (values[:, side].T @ encoding.readout.T + encoding.offset for side in (0, 1))
        return _Seen(self._moments_at(encoding, y, plus, minus), columns, turn, products)

    def _kept(self, products: Array, added: Array) -> Array:
        """What makes of [F, H'] the columns to keep, strongest first, and those to drop."""
        rank = self._struct.rank
        cross = products[:rank, rank:] @ added
        corner = added.T @ products[rank:, rank:] @ added
        whole = np.block([[products[:rank, :rank], cross], [cross.T, corner]])
        turn = eigh((whole + whole.T) / 2, check_finite=False)[1][:, ::-1]
        return np.vstack([np.sqrt(self._forgets) * turn[:rank], added @ turn[rank:]])

    def _put(self, name: str, values: Array, width: int) -> None:
        """A small matrix in front of zeros."""
        array = self._work[name].ravel()[: self._struct.depth * width].reshape(-1, width)
        array[:] = 0.0
        array[: len(values), : values.shape[1]] = values

    def _call(self, name: str) -> int:
        return int(getattr(self._library, name)(ctypes.byref(self._struct)))


def _prediction(seen: _Seen) -> Prediction:
    return Prediction(seen.moments.mean, seen.moments.covariance)
