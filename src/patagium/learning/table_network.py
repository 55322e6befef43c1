"""Dense network for the columns of a table, scaled by stated ranges or by the first samples.

Samples that scale a network are not predicted, so that nothing looks ahead. Of a log that begins
at rest they end a second after it moves. Neglected: single columns that move later than others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from patagium.arguments import checked
from patagium.arrays import Array
from patagium.errors import LogError
from patagium.learning.models.dense import SCALES, DenseNetwork
from patagium.learning.models.network import Network
from patagium.sensing.logs.table import LogTable

SCALING_TIME, SCALING_SAMPLES = 1.0, 50
"""Time [s] and least number of the samples that scale columns without a stated range."""
_FAR = 10.0  # half widths from its center to where a column is far beyond its scale
_MOVES = 0.1
"""Share of its range (1 to 99 %) by which a column moves where it is no longer at rest [1]."""


@checked
def network_for(
    table: LogTable, hidden: Sequence[int], activation: str | None = None
) -> DenseNetwork:
    """Dense network for the columns of a table, scaled by their ranges.

    Center and half width of each range that the mapping states; of the others those of the first
    samples, which `identify` then does not predict (`scaling_samples`).

    Args:
        table: The log, or the beginning of it.
        hidden: Neurons of each hidden layer.
        activation: "softplus" or "tanh"; None: that of the network.

    Raises:
        LogError: If the log is too short to scale a column without a range.
    """
    bounds, count = _bounds(table), scaling_samples(table)
    for k, (_, values) in _without_range(table).items():
        known = values[:count][np.isfinite(values[:count])]
        low, high = (known.min(), known.max()) if len(known) else (-1.0, 1.0)
        if high - low <= 1e-9 * max(abs(low), abs(high)):  # it stood still
            low, high = low - 1.0, high + 1.0
        bounds[k] = low, high
    network = dense_network(table.output_names, hidden, bounds, activation)
    network.inputs_jump = True
    return network


def dense_network(
    names: Sequence[str], hidden: Sequence[int], ranges: ArrayLike, activation: str | None = None
) -> DenseNetwork:
    """Dense network whose inputs and outputs are scaled by their ranges.

    Args:
        names: Names of the outputs.
        hidden: Neurons of each hidden layer.
        ranges: Least and largest value of each input, then of each output, (n_x + n_y, 2).
        activation: "softplus" or "tanh"; None: that of the network.
    """
    low, high = np.asarray(ranges, float).T
    center, scale, n = (low + high) / 2, (high - low) / 2, len(low) - len(names)
    given: dict[str, Any] = {} if activation is None else {"activation": activation}
    given |= {"input_center": center[:n], "input_scale": scale[:n]}
    given |= {"output_center": center[n:], "output_scale": scale[n:]}
    return DenseNetwork(n, hidden, names, **given)


def sample_ranges(values: Array) -> Array:
    """Range of each column of samples, (n, 2); one to each side where it stands still.

    NaN is no sample; a column of nothing else stands still at zero.
    """
    low, high = np.nan_to_num([np.fmin.reduce(values), np.fmax.reduce(values)])
    still = high - low < max(1e-9 * float((high - low).max()), 2e-300)
    return np.column_stack([low - still, high + still])


def scaling_samples(table: LogTable) -> int:
    """Number of first samples that scale the columns without a stated range; 0 without any.

    They end a second after the log begins or, if later, after half of these columns move.

    Args:
        table: The log, or the beginning of it: more than a second, and 50 samples.

    Raises:
        LogError: If it has no samples after them.
    """
    unknown = _without_range(table)
    if not unknown:
        return 0
    names, columns = zip(*unknown.values(), strict=True)
    second = int(np.searchsorted(table.time, table.time[0] + SCALING_TIME))
    count = max(second, SCALING_SAMPLES)
    if count >= len(table.time) - 1:
        raise LogError(
            f"{table.source}: expected more than the first {SCALING_TIME:g} s and "
            f"{SCALING_SAMPLES} samples, which scale {', '.join(names)}, found "
            f"{len(table.time)} samples; state a range in the mapping, such as `range: [-1, 1]`"
        )
    rest = _rest(np.column_stack(columns))
    moving = int(np.searchsorted(table.time, table.time[rest] + SCALING_TIME))
    return moving if rest > count and moving < len(table.time) / 2 else count


def samples_that_scale(network: Network, table: LogTable) -> int:
    """Number of first samples of a table that scale the network; 0 if its scales are others."""
    try:
        own: Any = network_for(table, ())
    except LogError:
        return 0
    alike = (np.array_equal(getattr(own, k), getattr(network, k, np.nan)) for k in SCALES)
    return scaling_samples(table) if all(alike) else 0


def range_words(table: LogTable, first: int) -> list[str]:
    """Warnings of columns that go far beyond what the first samples scale them by.

    Args:
        table: The log, or the beginning of it.
        first: Number of samples that scale its network; 0: none, and no warning.
    """
    if not first:
        return []
    own, found = network_for(table, ()), []
    center = np.append(own.input_center, own.output_center)
    scale = np.append(own.input_scale, own.output_scale)
    for k, (name, values) in _without_range(table).items():
        apart = np.append(values[np.isfinite(values)] - center[k], 0.0)
        low, high = np.quantile(apart, (0.01, 0.99))
        far = high if high > -low else low
        if abs(far) > _FAR * scale[k]:
            reach = f"{name} goes to {center[k] + far:.3g}; the first {first} samples scale it"
            by = f"by {center[k]:.3g} +- {scale[k]:.3g}"
            found.append(f"Warning: {reach} {by}: state its `range` in the mapping.")
    return found


def _rest(values: Array) -> int:
    """Number of first samples in which less than half of the columns have moved."""
    values = values[:, np.isfinite(values).all(axis=0)]
    low, high = np.quantile(values, (0.01, 0.99), axis=0)
    moved = np.abs(values - values[0]) > _MOVES * (high - low)
    begins = np.sort(moved.argmax(axis=0)[moved.any(axis=0)])
    return int(begins[(len(begins) - 1) // 2]) if len(begins) else 0


def _without_range(table: LogTable) -> dict[int, tuple[str, Array]]:
    """Name and values, (N,), of each column without a stated range, by its number."""
    names, values = (*table.input_names, *table.output_names), np.hstack([table.x, table.y])
    unknown = np.flatnonzero(np.isnan(_bounds(table)).any(axis=1)).tolist()
    return {k: (names[k], values[:, k]) for k in unknown}


def _bounds(table: LogTable) -> Array:
    """Stated ranges of inputs and outputs, (n, 2); NaN where there is none."""
    return np.vstack([table.input_range, table.output_range])
