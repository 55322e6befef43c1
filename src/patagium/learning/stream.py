"""Identification from arrays of samples, each predicted before it may be learned.

The scores are those a user would have had at that time: predictions over the whole hold interval,
over longer horizons with frozen weights and true states in, the predicted interval, and beside
them the last used sample held.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.deprecation import renamed_arguments
from patagium.errors import LogError, ShapeError
from patagium.learning.learners.learner import Learner
from patagium.learning.models.memory import measured_inputs
from patagium.learning.models.network import Network
from patagium.learning.prequential import BlockRun, Progress, Samples
from patagium.learning.result import Identification
from patagium.learning.scorer import Scorer
from patagium.learning.scores import persistence

Array = NDArray[np.float64]


class StreamOptions(TypedDict, total=False):
    """Options of `stream` that most logs do without.

    Attributes:
        std: Noise of each measurement beside the learner's own, (N, n_y) [unit of y];
            NaN where y is. Learners without noise of the measurement leave it aside.
        names: Names of the outputs; without it the network's.
        units: Units of the outputs, for axes of figures; without it "1".
        progress: Called now and then with samples done and samples in all.
    """

    std: ArrayLike | None
    names: Sequence[str] | None
    units: Sequence[str] | None
    progress: Progress | None


@renamed_arguments(deviation="std")
def stream(
    learner: Learner,
    time: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    *,
    every: int,
    horizons: Mapping[str, float] | None = None,
    gaps: ArrayLike = (),
    **options: Unpack[StreamOptions],
) -> Identification:
    """Identification of a log online, with scores of each prediction.

    One sample in `every` is used. Each sample is predicted by the weights known after the
    last used sample before it; the first one by the initial weights.

    Args:
        learner: What learns; it goes on from where it stands, and is changed.
        time: Increasing, (N,) [s].
        x: Measured inputs of the network, (N, n_measured) [units of x]; it recalls the rest.
        y: What it predicts, (N, n_y) [unit of y]; NaN where a channel was not measured.
        every: 1 to use each sample, 100 to use one in 100.
        horizons: Label and length [s] of the spans to predict with frozen weights.
        gaps: First sample after each gap in time; see `find_gaps`.
        **options: `std`, `names`, `units` and `progress`; see `StreamOptions`.

    Returns:
        Scores and predictions. If the learner diverged, those up to there, with `outcome`
        and `message` saying when and why.

    Raises:
        ShapeError: If the arrays do not fit each other or the network.
        LogError: If an input is not finite or time does not advance.
        TypeError: If there is no such option.
    """
    unknown = set(options) - set(StreamOptions.__annotations__)
    if unknown:
        raise TypeError(f"stream() got an unexpected keyword argument {sorted(unknown)[0]!r}")
    samples = checked_samples(learner.network, (time, x, y), gaps, options.get("std"))
    outputs = samples.y.shape[1]
    names = tuple(options.get("names") or learner.network.output_names)
    units = tuple(options.get("units") or ("1",) * outputs)
    for word, given in (("names", names), ("units", units)):
        if len(given) != outputs:
            raise ShapeError(word, (outputs,), (len(given),))
    run = BlockRun(learner, samples, every, horizons or {})
    run.go(options.get("progress"))
    held, scorer = persistence(samples.y, run.used), Scorer(names, horizons)
    run.score(scorer, held)
    scores: dict[str, Any] = {
        "samples": len(samples.time),
        "samples_predicted": run.reached,
        "every": every,
        "updates": run.updates,
        "median_step": float(np.median(np.diff(samples.time))),
        "gaps": len(samples.gaps),
        **scorer.scores(),
        **run.facts(),
    }
    return Identification(scores, run.record(names, units, held), learner, run.outcome, run.message)


def checked_samples(
    network: Network,
    arrays: tuple[ArrayLike, ArrayLike, ArrayLike],
    gaps: ArrayLike,
    std: ArrayLike | None,
) -> Samples:
    """Samples of arrays that fit a network.

    Args:
        network: What learns them.
        arrays: Time (N,) [s], x (N, n_measured) and y (N, n_y).
        gaps: First sample after each gap in time.
        std: Of each measurement, (N, n_y) [unit of y]; None for none.

    Raises:
        ShapeError: If the arrays do not fit each other or the network.
        LogError: If an input is not finite or time does not advance.
    """
    stamps, inputs, outputs = (np.ascontiguousarray(a, float) for a in arrays)
    if stamps.ndim != 1 or len(stamps) < 2:
        raise ShapeError("time", "(N,) with N >= 2", stamps.shape)
    if outputs.shape != (len(stamps), network.outputs):
        raise ShapeError("y", (len(stamps), network.outputs), outputs.shape)
    for name, array in (("time", stamps), ("x", inputs)):
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            raise LogError(
                f"{name}: expected finite numbers, found {len(bad)} that are not, the "
                f"first in sample {int(bad[0][0])}"
            )
    if (np.diff(stamps) <= 0).any():
        row = int(np.flatnonzero(np.diff(stamps) <= 0)[0]) + 1
        raise LogError(
            f"time: expected to advance, found {stamps[row]:.9g} s after "
            f"{stamps[row - 1]:.9g} s at sample {row}"
        )
    known = {(len(stamps), n) for n in (measured_inputs(network), network.inputs)}
    if inputs.shape not in known:
        raise ShapeError("x", (len(stamps), measured_inputs(network)), inputs.shape)
    noise = None if std is None else np.asarray(std, float)
    if noise is not None and noise.shape != outputs.shape:
        raise ShapeError("std", outputs.shape, noise.shape)
    return Samples(stamps, inputs, outputs, np.asarray(gaps, np.int64), noise)
