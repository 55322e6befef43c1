"""Trial of a learner on a data set: the search of its settings, and its errors over time.

Samples are used in order. In a span of the data set each hold interval is predicted with the
weights known before it, and so are the next 10 ms and the long horizon, from the true states.
Errors outside of the spans are not computed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from patagium.arrays import Array, Indices, thin
from patagium.errors import PatagiumError
from patagium.learning.scores import INTERVAL, normalized_error
from patagium.learning.stream import used_samples
from patagium_lab.learners.data_sets import DataSet
from patagium_lab.learners.entries import SPANS, AnyLearner, Entry
from patagium_lab.learners.plan import LearnersPlan

SHORT = 0.01
"""Short horizon of prediction [s]."""
_MOST = {"hold": 400, "short": 60, "long": 8, "checks": 60}
"""Largest number of predictions of each kind in a span."""
_FAILURES = (PatagiumError, ArithmeticError, ValueError, np.linalg.LinAlgError)


@dataclass
class ScoredSpan:
    """Predictions in a span of a data set.

    Attributes:
        begin: Begin of the span [s].
        end: End of the span [s].
        horizons: Horizons that are predicted, of "hold", "short", "long".
        truth: Measured outputs by horizon, each (k, n_y) [as y].
        guess: Predicted outputs by horizon, each (k, n_y) [as y].
        misses: |y - yhat| over the predicted standard deviation at checks, each (n_y,) [1].
        complete: Whether the learner passed the end of the span.
    """

    begin: float
    end: float
    horizons: tuple[str, ...] = ("hold", "short", "long")
    truth: dict[str, list[Array]] = field(default_factory=dict)
    guess: dict[str, list[Array]] = field(default_factory=dict)
    misses: list[Array] = field(default_factory=list)
    complete: bool = False

    def errors(self, moving: NDArray[np.bool_]) -> dict[str, float]:
        """NMSE of each horizon, mean over the moving outputs; inf where a prediction is not finite.

        Args:
            moving: Whether each output is scored, (n_y,).
        """
        found = {}
        for kind, truths in self.truth.items():
            truth, guess = np.concatenate(truths), np.concatenate(self.guess[kind])
            finite = bool(np.isfinite(guess).all())
            each = normalized_error(truth, guess)[moving] if finite else np.array([np.inf])
            found[kind] = float(np.nanmean(each))
        return found


@dataclass
class Progress:
    """Progress of a learner along a data set.

    Attributes:
        samples: Number of samples that it learned.
        outcome: "completed", "out of time", or the error that ended it.
    """

    samples: int = 0
    outcome: str = "completed"


def run_trial(
    entry: Entry, data: DataSet, settings: Mapping[str, float], factor: float, plan: LearnersPlan
) -> dict[str, Any]:
    """Errors, coverage and progress of an entry on a data set.

    Args:
        entry: The entry.
        data: Data set.
        settings: Settings of the entry.
        factor: Factor on its standard deviations that fits the first part of the data set.
        plan: Plan of the comparison.

    Returns:
        `errors` (NMSE by time in seconds, as text, and horizon), `coverage` of the 95 %
        interval as it is, and `scaled` by the factor, `samples`, `outcome`.
    """
    spans = [ScoredSpan(after, after + data.beat) for after in plan.after]
    limit = plan.twin_limit if entry.same else plan.limit
    progress = teach(entry, data, settings, spans, limit, plan.seed)
    misses = [row for span in spans[1:] if span.complete for row in span.misses]
    return {
        "errors": {f"{s.begin:g}": s.errors(data.moving) for s in spans if s.complete},
        "coverage": _inside(misses, data, INTERVAL),
        "scaled": _inside(misses, data, INTERVAL * factor),
        "samples": progress.samples,
        "outcome": progress.outcome,
    }


def _inside(misses: Sequence[Array], data: DataSet, stds: float) -> float:
    """Share of measurements within a number of predicted standard deviations."""
    each = np.array(misses).reshape(-1, data.y.shape[1])[:, data.moving]
    return float((each <= stds).mean()) if np.isfinite(each).any() else float("nan")


def search_settings(
    entry: Entry, data: DataSet, plan: LearnersPlan
) -> tuple[dict[str, float], float]:
    """Best settings on the first part of a data set, by the error 10 ms ahead.

    All settings are tried on the first quarter of that part, and the best quarter of them on the
    whole part; the error is that of the second half of the samples learned.

    Args:
        entry: The entry; without free settings there is nothing to choose.
        data: Data set.
        plan: Plan of the comparison.

    Returns:
        The settings, and the factor on the standard deviations that puts 95 % of that part
        into the interval.
    """
    settings, factor = drawn_settings(entry.knobs, plan.draws, plan.seed), float("nan")
    for part, kept in ((plan.tuning / 4, -(-plan.draws // 4)), (plan.tuning, 1)):
        tried: list[tuple[float, int, dict[str, float], float]] = []
        for one in settings:
            span = ScoredSpan(part / 2, part, ("short",))
            teach(entry, data, one, [span], np.inf, plan.seed)
            error = span.errors(data.moving)["short"] if span.complete else np.inf
            tried.append((error, len(tried), one, _factor(span.misses, data)))
        best = sorted(tried)[:kept]
        settings = [one for _, _, one, _ in best]
        factor = best[0][3] if best else factor
    return (settings[0] if settings else {}), factor


def _factor(misses: Sequence[Array], data: DataSet) -> float:
    each = np.array(misses).reshape(-1, data.y.shape[1])[:, data.moving]
    each = each[np.isfinite(each)]
    return float(np.quantile(each, 0.95)) / INTERVAL if each.size else float("nan")


def drawn_settings(knobs: Sequence[str], count: int, seed: int) -> list[dict[str, float]]:
    """Settings spread evenly over their ranges on a logarithmic scale.

    Args:
        knobs: Free settings, keys of `SPANS`.
        count: Number of settings.
        seed: Seed of the scrambling.
    """
    if not knobs:
        return []
    points = qmc.Halton(len(knobs), seed=seed).random(count)
    low, high = np.log([SPANS[knob] for knob in knobs]).T
    values = np.exp(low + points * (high - low)).tolist()
    return [dict(zip(knobs, row, strict=True)) for row in values]


def teach(
    entry: Entry,
    data: DataSet,
    settings: Mapping[str, float],
    spans: Sequence[ScoredSpan],
    limit: float,
    seed: int,
) -> Progress:
    """Teach an entry a data set up to the end of the last span, and fill the spans.

    Args:
        entry: The entry.
        data: Data set.
        settings: Settings of the entry.
        spans: Spans that are scored; they are changed.
        limit: Processor time that the entry may take [s].
        seed: Seed of the first weights.
    """
    progress, started = Progress(), np.inf
    watches = [_SpanWatch(data, span) for span in spans]
    used = used_samples(data.y, data.every, data.gaps)
    used = used[data.clock[used] < max(span.end for span in spans)]
    try:
        with np.errstate(all="ignore"):
            learner = entry.build(data, settings, seed)
            for index in used.tolist():
                learner.update(data.x[index], data.y[index])
                progress.samples += 1
                if progress.samples == 1:  # the time of compiling does not count
                    started = process_time()
                for one in watches:
                    one.look(learner, index)
                if process_time() - started > limit:
                    progress.outcome = "out of time"
                    break
    except _FAILURES as problem:
        progress.outcome = f"failed: {type(problem).__name__}"
    reached = data.clock[used[progress.samples - 1]] if progress.samples else -np.inf
    whole = progress.samples == len(used)
    for span in spans:
        span.complete = bool(whole or reached >= span.end) and bool(span.truth)
    return progress


class _SpanWatch:
    """Samples of a span after which predictions are made."""

    def __init__(self, data: DataSet, span: ScoredSpan) -> None:
        self.data, self.span = data, span
        used = used_samples(data.y, data.every, data.gaps)
        begins = used[(data.clock[used] >= span.begin) & (data.clock[used] < span.end)]
        lengths = {"hold": data.every, "short": SHORT / data.step}
        lengths["long"] = data.beat / data.step
        self.length = {kind: max(1, round(lengths[kind])) for kind in span.horizons}
        self.after = {
            kind: set(thin(self._whole(begins, length), _MOST[kind]).tolist())
            for kind, length in self.length.items()
        }
        chosen = thin(self._whole(begins, data.every), _MOST["checks"]).tolist()
        self.checks = set(chosen)

    def _whole(self, begins: Indices, length: int) -> Indices:
        """Samples whose windows neither leave the data set nor cross a gap."""
        gaps = np.array(self.data.gaps, np.int64)
        ends = begins + length
        crossed = np.searchsorted(gaps, ends, "right") - np.searchsorted(gaps, begins, "right")
        whole: Indices = begins[(ends < len(self.data.clock)) & (crossed == 0)]
        return whole

    def look(self, learner: AnyLearner, index: int) -> None:
        data, span = self.data, self.span
        for kind, length in self.length.items():
            if index in self.after[kind]:
                window = slice(index + 1, index + 1 + length)
                span.truth.setdefault(kind, []).append(data.y[window])
                span.guess.setdefault(kind, []).append(learner.predict(data.x[window]))
        if index in self.checks:
            ahead = index + data.every
            error = data.y[ahead] - learner.predict(data.x[ahead : ahead + 1])[0]
            std = learner.std(data.x[ahead])
            span.misses.append(np.abs(error) / std)
