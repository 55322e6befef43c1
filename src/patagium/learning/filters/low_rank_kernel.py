"""Covariance of low rank in C: three passes over the weights, `kernels/low_rank.c`.

Between the passes only matrices of r + n_y rows are left, and NumPy does them: with
P^-1 = U + F F' and H = dy/dW, the products [F, H']' U^-1 [F, H'] give all of P H' and of the
columns to keep. Process noise is added before, in NumPy.
"""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, eigh, solve_triangular

from patagium.errors import Outcome
from patagium.learning.filters.kernel_memory import (
    ACTIVATION_CODES,
    addresses,
    aligned,
    rounded_up,
)
from patagium.learning.filters.low_rank import (
    LOW_RANK,
    linear_moments_along,
    moments_along,
    rank_of,
    seen_directions,
)
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.root import MatrixLost, lower_factor
from patagium.learning.filters.spread import Moments
from patagium.learning.filters.structure import Look, Structure
from patagium.learning.filters.weight_covariance import Precision
from patagium.learning.models.perceptron import PerceptronNetwork, as_perceptron
from patagium.native import load_kernel, structs

Array = NDArray[np.float64]


class _Directions(NamedTuple):
    """Directions of the weights that y is seen along, by few numbers.

    Attributes:
        columns: [F, H'] times this, over U, are the columns y sees, (r + n_y, q).
        turn: H' times this is the inverse of P times them, (n_y, q) [1/y].
        products: Of [F, H'], U^-1 between them, forgetting done, (r + n_y, r + n_y).
    """

    columns: Array
    turn: Array
    products: Array


def compiled_low_rank(numbers: FilterNumbers) -> Structure | None:
    """Compiled structure of low rank; None without a compiler or a perceptron.

    Args:
        numbers: Numbers of the filter.
    """
    library = load_kernel("low_rank", {"STORE": _STORES[numbers.dtype]})
    if library is None or not isinstance(numbers.network, PerceptronNetwork):
        return None
    passes = LowRankPasses(numbers, library)
    return LOW_RANK._replace(moments=passes.moments, learned=passes.learned, forgets=True)


_STORES = {"float64": "double", "float32": "float"}


class LowRankPasses:
    """Passes over the weights of one filter, and the memory of the kernel.

    U and F are kept in the precision of the filter, and all sums are in double.

    Args:
        numbers: Numbers of the filter.
        library: Compiled kernel.
    """

    def __init__(self, numbers: FilterNumbers, library: ctypes.CDLL) -> None:
        self._library = library
        self._spare: Precision | None = None
        network = as_perceptron(numbers.network)
        outputs, lanes = len(numbers.noise), library.low_rank_lanes()
        widths, items, rank = network.perceptron.widths, network.items, rank_of(numbers)
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
        self._widths = np.array(widths, np.int32)
        self._forgets = 1.0 if numbers.has_process_noise else numbers.forgetting_factor
        self._struct: Any = structs.LOW_RANK.type(
            rank=rank,
            padded=padded,
            depth=depth,
            items=items,
            layers=len(widths) - 1,
            activation=ACTIVATION_CODES[network.perceptron.activation],
            room=room,
            growth=self._forgets,
            widths=self._widths.ctypes.data,
            **addresses(self._work),
        )

    def moments(self, precision: Precision, look: Look) -> tuple[Moments, _Directions]:
        """Moments of y, and the directions that it is seen along; see `Structure`.

        Args:
            precision: P^-1 before the sample, but for forgetting.
            look: Sample before it is measured.

        Raises:
            MatrixLost: If something is not finite.
        """
        products, y = self._products(precision, look)
        if not np.isfinite(products).all():
            raise MatrixLost(Outcome.NOT_FINITE)
        rank, encoding = self._struct.rank, look.encoding
        forgets = np.sqrt(self._forgets)
        inner = cho_factor(np.eye(rank) + products[:rank, :rank])
        part = cho_solve(inner, products[:rank, rank:])
        sensed = products[rank:, rank:] - products[rank:, :rank] @ part
        variances, axes = seen_directions((sensed + sensed.T) / 2)
        turn = axes / np.sqrt(variances)
        columns = np.vstack([-forgets * (part @ turn), turn]) / forgets**2
        along = _Directions(columns, turn, products)
        if look.numbers.linear:
            return linear_moments_along(look, y, variances, axes), along
        self._put("turn", look.numbers.rule.spread * columns, self._struct.padded)
        self._library.low_rank_points(ctypes.byref(self._struct))
        network = as_perceptron(look.numbers.network)
        ends = network.items * network.perceptron.widths[-1]
        values = self._work["points"].ravel()[: ends * 2 * self._struct.padded]
        values = values.reshape(ends, 2, -1)[:, :, : turn.shape[1]]
        plus, minus = (values[:, side].T @ encoding.readout.T + encoding.offset for side in (0, 1))
        return moments_along(look, y, plus, minus), along

    def learned(
        self, precision: Precision, look: Look, along: _Directions, moments: Moments, gain: Array
    ) -> tuple[Array, Precision]:
        """Weights and precision after a sample; see `Structure`.

        Args:
            precision: P^-1 before the sample, but for forgetting.
            look: Sample before it was measured.
            along: Directions that y is seen along.
            moments: Moments of y as screened.
            gain: P_yy^-1 (y - mean), (n_y,) [1/y].

        Raises:
            MatrixLost: If something is not finite, or the noise not positive definite.
        """
        noise = lower_factor(moments.remainder)
        added = solve_triangular(noise, (along.turn @ moments.slopes).T, lower=True).T
        if not np.isfinite(added).all():
            raise MatrixLost(Outcome.NOT_FINITE)
        mean = np.empty_like(look.mean)
        after = self._spare or Precision(*(np.empty_like(part) for part in precision))
        self._put("gains", (along.columns @ (moments.slopes @ gain))[:, None], 1)
        self._put("turn", self._kept(along.products, added), self._struct.depth)
        struct = self._struct
        struct.mean, struct.next_mean = look.mean.ctypes.data, mean.ctypes.data
        struct.diagonal, struct.columns = (part.ctypes.data for part in precision)
        struct.next_diagonal, struct.next_columns = (part.ctypes.data for part in after)
        if not self._library.low_rank_change(ctypes.byref(struct)):
            raise MatrixLost(Outcome.NOT_FINITE)
        self._spare = precision  # nobody needs it any more: memory of the next one
        return mean, after

    def _products(self, precision: Precision, look: Look) -> tuple[Array, Array]:
        """Products of [F, H'], (r + n_y, r + n_y), and y at the weights, (n_y,)."""
        struct, encoding = self._struct, look.encoding
        struct.mean = look.mean.ctypes.data
        struct.diagonal, struct.columns = (part.ctypes.data for part in precision)
        network, rank = as_perceptron(look.numbers.network), struct.rank
        outputs = len(look.noise)
        out, inputs, seeds = network.perceptron.sensitivities(
            encoding.features, look.mean, encoding.readout
        )
        np.concatenate([part.ravel() for part in inputs], out=self._work["inputs"])
        seed = np.concatenate([part.reshape(-1, outputs) for part in seeds])
        self._work["seeds"][:, :outputs] = seed
        self._library.low_rank_products(ctypes.byref(struct))
        scale = np.repeat([1.0, np.sqrt(self._forgets)], [rank, outputs])
        size = rank + outputs
        products = self._work["gram"][:size, :size] / scale
        return products / scale[:, None], encoding.readout @ out.ravel() + encoding.offset

    def _kept(self, products: Array, added: Array) -> Array:
        """Turn of [F, H'] to the columns to keep, strongest first, and those to drop."""
        rank = self._struct.rank
        cross = products[:rank, rank:] @ added
        corner = added.T @ products[rank:, rank:] @ added
        whole = np.block([[products[:rank, :rank], cross], [cross.T, corner]])
        turn = eigh((whole + whole.T) / 2, check_finite=False)[1][:, ::-1]
        return np.vstack([np.sqrt(self._forgets) * turn[:rank], added @ turn[rank:]])

    def _put(self, name: str, values: Array, width: int) -> None:
        """Write a small matrix in front of zeros."""
        array = self._work[name].ravel()[: self._struct.depth * width].reshape(-1, width)
        array[:] = 0.0
        array[: len(values), : values.shape[1]] = values
