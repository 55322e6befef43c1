"""Identification from a table, by networks scaled with the ranges its mapping states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from patagium.errors import LogError
from patagium.learning.identify import compare
from patagium.learning.learners.learner import Learner
from patagium.learning.model_file import Model
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.parameter_paths import Trained
from patagium.learning.prequential import Progress
from patagium.learning.result import Identification
from patagium.learning.stream import stream
from patagium.sensing.logs.table import LogTable

Array = NDArray[np.float64]

HORIZONS = {"10ms": 0.01, "1s": 1.0}
"""Spans predicted with frozen weights unless others are asked for [s]."""


def network_for(
    table: LogTable, hidden: Sequence[int], activation: str = "softplus"
) -> DenseNetwork:
    """Dense network for the columns of a table, scaled by their stated ranges.

    Center and half width of each range; nothing is taken from the samples, so that a
    stream through it does not look ahead.

    Args:
        table: The log.
        hidden: Neurons of each hidden layer.
        activation: "softplus" or "tanh".

    Raises:
        LogError: If the mapping states no range for a column.
    """
    names, bounds = _bounds(table)
    silent = [name for name, row in zip(names, bounds, strict=True) if np.isnan(row).any()]
    if silent:
        raise LogError(
            f"{table.source}: expected a range for {', '.join(silent)} in the mapping, such as "
            "`range: [-1, 1]`: the network is scaled by it without looking ahead"
        )
    center, scale = bounds.mean(axis=1), np.diff(bounds, axis=1)[:, 0] / 2
    n = len(table.input_names)
    return DenseNetwork(
        n,
        hidden,
        table.output_names,
        activation,
        input_center=center[:n],
        input_scale=scale[:n],
        output_center=center[n:],
        output_scale=scale[n:],
    )


def identify_table(
    table: LogTable,
    learner: Learner,
    *,
    every: int = 100,
    horizons: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identification from a table, sample by sample; see `stream`.

    Args:
        table: The log.
        learner: What learns; it is changed.
        every: 100 to use one sample in 100.
        horizons: Label and length [s] of the spans to predict with frozen weights; None:
            10 ms and 1 s.
        progress: Called now and then with samples done and samples in all.
    """
    result = stream(
        learner,
        table.time,
        table.x,
        table.y,
        every=every,
        horizons=HORIZONS if horizons is None else horizons,
        names=table.output_names,
        units=table.output_units,
        gaps=table.gaps,
        progress=progress,
    )
    result.scores["gaps_found"] = table.describe_gaps()
    return result


def evaluate_table(table: LogTable, model: Trained, *, every: int = 100) -> Identification:
    """Scores of a model with frozen weights on a table it never saw; see `evaluate`.

    Args:
        table: The log.
        model: A learner (it is not taught), or a model from a file.
        every: The rival holds one measured sample in so many.

    Raises:
        LogError: If the table has other inputs or outputs than the model.
    """
    expected = tuple(model.network.output_names)
    if expected != table.output_names:
        raise LogError(
            f"{table.source}: expected the outputs {', '.join(expected)}, "
            f"found {', '.join(table.output_names)}"
        )
    if isinstance(model, Model) and model.inputs not in (None, table.input_names):
        raise LogError(
            f"{table.source}: expected the inputs {', '.join(model.inputs or ())}, "
            f"found {', '.join(table.input_names)}"
        )
    result = compare(
        model, table.time, table.x, table.y, every=every, units=table.output_units, gaps=table.gaps
    )
    result.scores["gaps_found"] = table.describe_gaps()
    return result


def _bounds(table: LogTable) -> tuple[tuple[str, ...], Array]:
    names = (*table.input_names, *table.output_names)
    return names, np.vstack([table.input_range, table.output_range])
