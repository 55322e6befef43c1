"""Kernel that learns a whole sample in one call of C, for a covariance of blocks.

The memory of one filter lies in arrays that the kernel shares by address. Two layouts exist: by
panels of columns of a block (`cubature.c`, of whole layers; `extended.c`), of its square root or,
where noise is added between samples, of the covariance itself; and by neurons side by side
(`node.c`), of square roots. Two threads must not use one filter at the same time.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from patagium.arrays import Array
from patagium.errors import Outcome
from patagium.learning.filters.blocks import BlockCovariances, BlockRoots, Parts, blocks_in
from patagium.learning.filters.kernel_memory import (
    ACTIVATION_CODES,
    Compiled,
    addresses,
    aligned,
    install_encoder,
    rounded_up,
    screening_memory,
)
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.root import MatrixLost, triangular
from patagium.learning.filters.screening import new_screen
from patagium.learning.filters.state import symmetric
from patagium.learning.models.perceptron import PerceptronNetwork, as_perceptron
from patagium.learning.models.structure import blocks_of
from patagium.native import load_kernel
from patagium.native.structs import EXTENDED_FILTER, NODE_FILTER, PANEL_FILTER

_WIDE = 8
_TYPES = {
    "cubature": PANEL_FILTER.type,
    "extended": EXTENDED_FILTER.type,
    "node": NODE_FILTER.type,
}


def structure_and_kernel(
    numbers: FilterNumbers, compiled: bool = True
) -> tuple[BlockRoots, BlockKernel | None]:
    """Covariance structure of a filter, and its kernel.

    Returns:
        Structure, and the kernel that learns a whole sample; None: NumPy does.
    """
    if numbers.settings.square_root == "cholesky":
        return BlockCovariances(numbers), None
    structure = BlockCovariances if _keeps_covariance(numbers) else BlockRoots
    return structure(numbers), _kernel_for(numbers) if compiled else None


def _keeps_covariance(numbers: FilterNumbers) -> bool:
    """Whether P itself is kept, and no square root: where noise is added to large blocks."""
    return numbers.has_process_noise and (numbers.linear or numbers.settings.covariance != "node")


def _kernel_for(numbers: FilterNumbers) -> BlockKernel | None:
    """Kernel for the blocks of a filter; None where there is none."""
    network, node = numbers.network, numbers.settings.covariance == "node"
    name = "extended" if numbers.linear else "node" if node else "cubature"
    known = isinstance(network, PerceptronNetwork)
    known = known and (name != "cubature" or _of_whole_layers(numbers))
    return BlockKernel(name, numbers) if known and _library(name, numbers.dtype) else None


def _of_whole_layers(numbers: FilterNumbers) -> bool:
    """Whether blocks are layers, one or more, in the order of the weights, as in `points.h`."""
    blocks = blocks_in(numbers)
    ends = {int(layer[-1]) for layer in blocks_of(numbers.network, "layer")}
    ordered = bool(np.all(np.diff(np.concatenate(blocks)) == 1))
    return ordered and ends >= {int(block[-1]) for block in blocks}


class BlockKernel:
    """Memory of one filter, and the kernel's calls on it.

    With b weights a block, a sample costs about the sum of b^2 (n_y + 8) multiplications and
    additions by panels. By neurons of k weights it costs about 2 n k where at most one linear
    layer follows, n n_y (k + 2 n_y) further from the outputs, and noise adds n k^2 / 3. Noise adds
    nothing to a linear filter by panels; by points see `covariance.h`.

    Args:
        name: Name of the kernel: cubature, extended or node.
        numbers: Numbers of the filter.

    Attributes:
        mean: Weights W, (n,) [1], moved by the kernel.
        prior: Weights that a prior share goes back to, (n,) [1].
        screen: Screening of the samples, whose arrays are shared.
    """

    def __init__(self, name: str, numbers: FilterNumbers) -> None:
        library: Any = _library(name, numbers.dtype)
        self._neurons, self._numbers = name == "node", numbers
        self._network = as_perceptron(numbers.network)
        self.screen = new_screen(numbers)
        self._sizes = [len(block) for block in blocks_in(numbers)]
        self._lanes = int(getattr(library, f"{name}_lanes")())
        layout = _neuron_arrays if self._neurons else _panel_arrays
        self._arrays = layout(numbers, self._network, self._lanes) | _sample_arrays(self._network)
        self._covariance = "kept" in self._arrays
        self._whole = _TYPES[name]()
        self._struct = self._whole.filter if name == "extended" else self._whole
        self._screening, bounds = screening_memory(self.screen)
        self._fill(ctypes.addressof(self._screening))
        self._x, keep = self._installed(name)
        if self._x is not None:
            bounds.x = self._x.ctypes.data
        self._keep = keep, bounds
        self._address = ctypes.addressof(self._struct)
        self._predict, self._update = (
            _function(library, f"{name}_{verb}") for verb in ("predict", "update")
        )
        if self._neurons:
            self._pack = _function(library, "node_pack", 2)
            self._unpack = _function(library, "node_unpack", 2)
        self.mean, self.prior = self._arrays["mean"], self._arrays["prior"]
        self._measured = self._arrays["measured"]

    @property
    def nis(self) -> float:
        """Normalized innovation squared of the last sample; NaN before the first."""
        return float(self._struct.nis)

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean, (n_y,), and covariance, (n_y, n_y), of y at x.

        Args:
            x: Input, (n_x,) [units of x].

        Raises:
            MatrixLost: If the covariance is no longer positive definite.
        """
        self._take(x)
        if self._predict(self._address) == Outcome.COVARIANCE_LOST:
            raise MatrixLost(Outcome.COVARIANCE_LOST)
        return self._moments

    def update(self, x: Array, y: Array) -> tuple[Outcome, tuple[Array, Array]]:
        """Outcome of one sample, and the moments of y before it.

        Args:
            x: Input, (n_x,) [units of x].
            y: Measurement, (n_y,) [unit of y].
        """
        self._take(x)
        self._measured[:] = y
        return Outcome(self._update(self._address)), self._moments

    @property
    def _moments(self) -> tuple[Array, Array]:
        """Mean and covariance of y that the kernel found last."""
        return self._arrays["predicted"].copy(), self._arrays["covariance"].copy()

    @property
    def compiled(self) -> Compiled | None:
        """Filter as C code meets it; None where Python has to encode the inputs."""
        if self._x is None:
            return None
        calls = (self._update, self._predict)
        update, predict = (ctypes.cast(call, ctypes.c_void_p).value or 0 for call in calls)
        return Compiled(
            update=update,
            predict=predict,
            memory=self._address,
            x=self._x,
            y=self._measured,
            stamp=self.screen.numbers[:1],
            mean=self._arrays["predicted"],
            covariance=self._arrays["covariance"],
            alarm=self.screen.whole[3:4],
            left_out=self.screen.marks["left_out"],
            nis=self._address + type(self._struct).nis.offset,
            weights=self.mean,
        )

    def place(self, mean: Array, nis: float, parts: Parts) -> None:
        """Go on from weights and what is kept of their covariance.

        Args:
            mean: Weights W, (n,) [1].
            nis: Normalized innovation squared of the last sample.
            parts: Square root of each block, or its covariance, (k, k) [1].
        """
        self.mean[:], self._struct.nis = mean, nis
        if not self._covariance:
            parts = [triangular(one) if np.triu(one, 1).any() else one for one in parts]
        if self._neurons:
            self._struct.largest, self._struct.drifted = 0.0, 0
            flat = np.concatenate([np.asarray(part, float).ravel() for part in parts])
            self._pack(self._address, flat.ctypes.data)
            return
        for panel, part in self._panels(parts):
            panel[:] = part
        self._struct.largest = max(float(np.linalg.norm(part, axis=1).max()) for part in parts)

    def kept(self) -> list[Array]:
        """State after the last sample: of each block its root, lower triangular, or covariance."""
        sizes = self._sizes
        if self._neurons:
            flat = np.zeros(sum(size**2 for size in sizes))
            self._unpack(self._address, flat.ctypes.data)
            ends = np.cumsum([size**2 for size in sizes])[:-1]
            each = zip(np.split(flat, ends), sizes, strict=True)
            return [part.reshape(size, size) for part, size in each]
        parts = [np.zeros((size, size)) for size in sizes]
        for panel, part in self._panels(parts):
            part[:] = panel
        return [symmetric(np.tril(part)) for part in parts] if self._covariance else parts

    def _panels(self, parts: Parts) -> Iterator[tuple[Array, Array]]:
        """Every panel of the memory, and the columns of a block's matrix that it holds."""
        width, start = 2 * self._lanes, 0
        entries = self._arrays["kept" if self._covariance else "root"]
        for whole in parts:
            rows = rounded_up(len(whole), width)
            for first in range(0, rows, width):
                end = start + (rows - first) * width
                part = whole[first:, first : first + width]
                panel = entries[start:end].reshape(-1, width)
                yield panel[: part.shape[0], : part.shape[1]], part
                start = end

    def _fill(self, screening: int) -> None:
        """Numbers of the filter and addresses of its arrays, for the kernel."""
        numbers, network, struct = self._numbers, self._network, self._struct
        factor = 1.0 if self._covariance else numbers.forgetting_factor
        scalars = {
            "weights": network.size,
            "outputs": network.outputs,
            "items": network.items,
            "layers": len(network.perceptron.widths) - 1,
            "activation": ACTIVATION_CODES[network.perceptron.activation],
            "growth": 1.0 / np.sqrt(factor),
            "pull": numbers.pull,
            "screen": screening,
            "nis": float("nan"),
            **numbers.rule._asdict(),
            **addresses(self._arrays),
        }
        if self._neurons:
            scalars["stride"] = self._arrays["centers"].shape[1]
            scalars["drifts"] = numbers.has_process_noise
        else:
            scalars["stride"] = self._arrays["slopes"].shape[1]
            scalars["rows"] = len(self._arrays["near"])
            scalars["blocks"] = len(self._sizes)
            scalars["decay"] = 1.0 / numbers.forgetting_factor
        for name, value in scalars.items():
            setattr(struct, name, value)

    def _installed(self, name: str) -> tuple[Array | None, Any]:
        """Input x that the kernel reads, (n_x,), or None; what must stay alive."""
        network, keep = self._network, dict[str, Array]()
        if name == "extended":
            stride = self._struct.stride
            room = 2 * network.items * max(network.perceptron.widths)
            keep = {
                "derivative": aligned((network.size + 2 * self._lanes, stride)),
                "seeds": aligned((room, stride)),
            }
            if np.any(np.diff(order := self._arrays["order"]) != 1):
                keep["place"] = np.argsort(order).astype(np.int32)
            for key, address in addresses(keep).items():
                setattr(self._whole, key, address)
        x, encoder = install_encoder(network, self._struct, self._arrays)
        return x, (keep, encoder)

    def _take(self, x: Array) -> None:
        if self._x is not None:
            self._x[:] = x
            return
        self.screen.bounds.x[:] = x
        encoding = self._network.encode_one(x)
        self._arrays["features"][...] = encoding.features
        self._arrays["readout"][...] = encoding.readout.T


def _function(library: ctypes.CDLL, name: str, addresses: int = 1) -> Any:
    """Function of a kernel that takes addresses, first that of its memory; gives an outcome."""
    function = getattr(library, name)
    function.argtypes, function.restype = [ctypes.c_void_p] * addresses, ctypes.c_int
    return function


def _library(name: str, dtype: str) -> ctypes.CDLL | None:
    """Kernel for one precision; None without a compiler."""
    single = dtype == "float32"
    return load_kernel(name, {"REAL": "float" if single else "double", "SINGLE": int(single)})


def _sample_arrays(network: PerceptronNetwork) -> dict[str, Array]:
    """Zeroed arrays of one sample, on cache lines."""
    widths, items, outputs = network.perceptron.widths, network.items, network.outputs
    shapes = {
        "mean": (network.size,),
        "prior": (network.size,),
        "features": (items, widths[0]),
        "readout": (items * widths[-1], outputs),
        "offset": (outputs,),
        "measured": (outputs,),
        "predicted": (outputs,),
        "innovation": (outputs,),
        "covariance": (outputs, outputs),
    }
    arrays = {name: aligned(shape) for name, shape in shapes.items()}
    arrays["widths"] = np.array(widths, np.int32)
    arrays["offset"][:] = network.offset
    return arrays


def _panel_arrays(
    numbers: FilterNumbers, network: PerceptronNetwork, lanes: int
) -> dict[str, Array]:
    """Zeroed arrays of the sizes that `structs.PANEL_FILTER` names, on cache lines."""
    widths, items, outputs = network.perceptron.widths, network.items, network.outputs
    panel, layers, widest = 2 * lanes, len(widths) - 1, max(widths)
    counts = [len(block) for block in blocks_in(numbers)]
    heights = [rounded_up(count, panel) for count in counts]
    rows, stride = sum(heights), rounded_up(outputs, max(lanes, 4))
    shapes = {
        "root": (sum(height * (height + panel) // 2 for height in heights),),
        "near": (rows,),
        "slopes": (rows, stride),
        "curvatures": (rows, stride),
        "steps": (rows // panel, outputs, panel),
        "shrinks": (rows,),
        "cross": (rows, stride),
        "points": (2, items, widest, panel),
        "at_mean": (2, layers, rounded_up(items * widest, lanes)),
        "weighting": (items * widths[-1], stride),
    }
    arrays = {name: aligned(shape, numbers.dtype) for name, shape in shapes.items()}
    arrays["small"] = aligned((5 + len(counts), stride, stride))
    arrays["order"] = np.concatenate(blocks_in(numbers)).astype(np.int32)
    arrays["counts"] = np.array(counts, np.int32)
    arrays["starts"] = np.array([0, *np.cumsum(heights)], np.int32)
    return arrays | (_covariance_arrays(numbers, arrays) if _keeps_covariance(numbers) else {})


def _covariance_arrays(numbers: FilterNumbers, arrays: Mapping[str, Array]) -> dict[str, Array]:
    """Arrays of panels that hold the covariance itself, all in double."""
    (rows, stride), root = arrays["slopes"].shape, arrays["root"]
    found = {name: aligned((rows, stride)) for name in ("sensed", "linear", "whitened")}
    found["drift"], found["kept"] = aligned((rows,)), aligned(root.shape)
    found["turned"] = aligned((max(rows, stride), arrays["points"].shape[-1]))
    if not numbers.linear:
        found["factor"] = root if root.dtype == float else aligned(root.shape)
    for block, start in zip(blocks_in(numbers), arrays["starts"], strict=False):
        found["drift"][start : start + len(block)] = numbers.process_noise[block]
    return found


def _neuron_arrays(
    numbers: FilterNumbers, network: PerceptronNetwork, lanes: int
) -> dict[str, Array]:
    """Zeroed arrays of the sizes that `structs.NODE_FILTER` names, on cache lines."""
    widths, items, outputs = network.perceptron.widths, network.items, network.outputs
    stride = rounded_up(outputs, _WIDE)
    groups = [
        below + 1
        for below, above in pairwise(widths)
        for _ in range(rounded_up(above, lanes) // lanes)
    ]
    rows, most, widest, nodes = sum(groups), max(groups), max(widths), sum(widths[1:])
    entries = sum(_entries(k) for k in groups)
    terms = items * widths[-1] if len(widths) > 3 else items
    reals = {
        "root": (entries,),
        "grown": (entries if numbers.has_process_noise else 0,),
        "drift": (rows,),
        "near": (rows,),
        "plain": (rounded_up(network.size, lanes) // lanes + 1,),
        "steps": (most, items),
        "slopes": (rows, outputs),
        "curvatures": (most, outputs),
        "gains": (most, max(2, outputs + 1)),
        "cross": (most, outputs),
        "outputs_at": (items + 2 * terms + 2 * widest,),
        "towards": (terms, outputs),
        "at_mean": (2 * (len(widths) - 1), items, rounded_up(widest, lanes) // lanes),
    }
    doubles = {
        "directions": (nodes, stride),
        "centers": (nodes, stride),
        "squares": (nodes,),
        "small": (4, stride, stride),
        "wide_small": (2, outputs, outputs, _WIDE),
    }
    arrays = {name: aligned((*shape, lanes), numbers.dtype) for name, shape in reals.items()}
    arrays |= {name: aligned(shape) for name, shape in doubles.items()}
    _lay_out(network.perceptron.layers(numbers.process_noise), arrays["drift"])
    return arrays


def _lay_out(layers: Iterable[tuple[Array, Array]], rows: Array) -> None:
    """Numbers of the weights, layer by layer, as rows of groups, (rows, lanes)."""
    row, lanes = 0, rows.shape[1]
    for matrix, bias in layers:
        layer = np.vstack([matrix.T, bias])
        for first in range(0, len(bias), lanes):
            part = layer[:, first : first + lanes]
            rows[row : row + len(part), : part.shape[1]] = part
            row += len(part)


def _entries(size: int) -> int:
    """Entries of a root of k rows, packed by bands of four."""
    full = size // 4
    return 8 * full * (full + 1) + (size % 4) * size
