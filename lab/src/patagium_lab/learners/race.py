"""A learner along a course: the search of its setting, and its errors as it goes.

Samples are used in order. In a span of the course each hold interval is predicted by what was
known before it, and so are the next 10 ms and the long horizon, weights frozen, true states
in. Neglected: errors outside of the spans.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from patagium.errors import PatagiumError
from patagium.learning.schedule import Indices, thin, used_samples
from patagium.learning.scores import INTERVAL, normalized_error
from patagium_lab.learners.data_sets import Course
from patagium_lab.learners.entries import SPANS, Entrant, Entry

Array = NDArray[np.float64]

SHORT = 0.01
"""The short horizon [s]."""
_MOST = {"hold": 400, "short": 60, "long": 8, "checks": 60}
"""Predicted in each span, at most."""
_FAILURES = (PatagiumError, ArithmeticError, ValueError, np.linalg.LinAlgError)


@dataclass(frozen=True)
class RacePlan:
    """How much of everything.

    Attributes:
        after: Seconds of flight after which errors are given [s].
        tuning: First part of a course, on which a setting is chosen [s].
        draws: Settings tried for each entry.
        limit: Processor time an entry may take for one course, after its first sample [s].
        twin_limit: The same of an entry that is the same filter as another [s].
        seed: Of the draws and of the weights to start from.
    """

    after: tuple[float, ...] = (0.1, 0.5, 2.0, 10.0)
    tuning: float = 1.0
    draws: int = 16
    limit: float = 40.0
    twin_limit: float = 10.0
    seed: int = 0


QUICK = RacePlan(after=(0.05, 0.1, 0.3), tuning=0.1, draws=4, limit=2.0, twin_limit=2.0)
"""A look in about a minute."""


@dataclass
class Predicted:
    """What was predicted in a span.

    Attributes:
        begin: Of the span [s].
        end: Of the span [s].
        horizons: Kinds asked for, of "hold", "short", "long".
        truth: Kind to what was measured, each (k, n_y).
        guess: Kind to what was predicted, each (k, n_y).
        misses: |y - yhat| in predicted deviations at checks, each (n_y,).
        complete: Whether the learner passed its end.
    """

    begin: float
    end: float
    horizons: tuple[str, ...] = ("hold", "short", "long")
    truth: dict[str, list[Array]] = field(default_factory=dict)
    guess: dict[str, list[Array]] = field(default_factory=dict)
    misses: list[Array] = field(default_factory=list)
    complete: bool = False

    def errors(self, heard: NDArray[np.bool_]) -> dict[str, float]:
        """NMSE of each kind, mean over the outputs that are heard; inf where it left numbers.

        Args:
            heard: (n_y,).
        """
        found = {}
        for kind, truths in self.truth.items():
            truth, guess = np.concatenate(truths), np.concatenate(self.guess[kind])
            finite = bool(np.isfinite(guess).all())
            each = normalized_error(truth, guess)[heard] if finite else np.array([np.inf])
            found[kind] = float(np.nanmean(each))
        return found


@dataclass
class Passage:
    """How far a learner came.

    Attributes:
        samples: It learned.
        outcome: "completed", "out of time", or how it failed.
    """

    samples: int = 0
    outcome: str = "completed"


def race(
    entry: Entry, course: Course, setting: Mapping[str, float], factor: float, plan: RacePlan
) -> dict[str, Any]:
    """An entry along a course: errors after so many seconds, coverage, how far it came.

    Args:
        entry: Who.
        course: Where.
        setting: What was chosen for it.
        factor: On its deviations, so that they fit the first part of the course.
        plan: How much.

    Returns:
        `errors` (seconds as text to kind to NMSE), `coverage` of its 95 % interval as it is
        and `scaled` by the factor, `samples`, `outcome`.
    """
    spans = [Predicted(after, after + course.beat) for after in plan.after]
    limit = plan.twin_limit if entry.same else plan.limit
    passage = follow(entry, course, setting, spans, limit, plan.seed)
    misses = [row for span in spans[1:] if span.complete for row in span.misses]
    return {
        "errors": {f"{s.begin:g}": s.errors(course.heard) for s in spans if s.complete},
        "coverage": _inside(misses, course, INTERVAL),
        "scaled": _inside(misses, course, INTERVAL * factor),
        "samples": passage.samples,
        "outcome": passage.outcome,
    }


def _inside(misses: Sequence[Array], course: Course, stds: float) -> float:
    """Share of measurements that many predicted deviations off at most."""
    each = np.array(misses).reshape(-1, course.y.shape[1])[:, course.heard]
    return float((each <= stds).mean()) if np.isfinite(each).any() else float("nan")


def search(entry: Entry, course: Course, plan: RacePlan) -> tuple[dict[str, float], float]:
    """The best of so many settings on the first part of a course, by the error 10 ms ahead.

    All are tried on the first quarter of that part, the best quarter of them on the whole of
    it; the error is that of the second half of what is flown.

    Args:
        entry: Who; without knobs there is nothing to choose.
        course: Where.
        plan: How much.

    Returns:
        The setting, and the factor on its deviations that puts 95 % of that part inside.
    """
    settings, factor = draws(entry.knobs, plan.draws, plan.seed), float("nan")
    for part, kept in ((plan.tuning / 4, -(-plan.draws // 4)), (plan.tuning, 1)):
        tried: list[tuple[float, int, dict[str, float], float]] = []
        for setting in settings:
            span = Predicted(part / 2, part, ("short",))
            follow(entry, course, setting, [span], np.inf, plan.seed)
            error = span.errors(course.heard)["short"] if span.complete else np.inf
            tried.append((error, len(tried), setting, _factor(span.misses, course)))
        best = sorted(tried)[:kept]
        settings = [setting for _, _, setting, _ in best]
        factor = best[0][3] if best else factor
    return (settings[0] if settings else {}), factor


def _factor(misses: Sequence[Array], course: Course) -> float:
    each = np.array(misses).reshape(-1, course.y.shape[1])[:, course.heard]
    each = each[np.isfinite(each)]
    return float(np.quantile(each, 0.95)) / INTERVAL if each.size else float("nan")


def draws(knobs: Sequence[str], count: int, seed: int) -> list[dict[str, float]]:
    """Settings spread evenly over the spans, on a logarithmic scale, scrambled by a seed.

    Args:
        knobs: What is chosen.
        count: How many.
        seed: Of the scrambling.
    """
    if not knobs:
        return []
    points = qmc.Halton(len(knobs), seed=seed).random(count)
    low, high = np.log([SPANS[knob] for knob in knobs]).T
    values = np.exp(low + points * (high - low)).tolist()
    return [dict(zip(knobs, row, strict=True)) for row in values]


def follow(
    entry: Entry,
    course: Course,
    setting: Mapping[str, float],
    spans: Sequence[Predicted],
    limit: float,
    seed: int,
) -> Passage:
    """Teach an entry along a course up to the last span, filling the spans.

    Args:
        entry: Who.
        course: Where.
        setting: What was chosen for it.
        spans: Where it is scored; changed.
        limit: Processor time it may take [s].
        seed: Of the weights to start from.
    """
    passage, started = Passage(), np.inf
    asked = [_Asked(course, span) for span in spans]
    used = used_samples(len(course.clock), course.every, course.gaps)
    used = used[course.clock[used] < max(span.end for span in spans)]
    try:
        with np.errstate(all="ignore"):
            entrant = entry.build(course, setting, seed)
            for index in used.tolist():
                entrant.update(course.x[index], course.y[index])
                passage.samples += 1
                if passage.samples == 1:  # compiling is no part of it
                    started = process_time()
                for one in asked:
                    one.ask(entrant, index)
                if process_time() - started > limit:
                    passage.outcome = "out of time"
                    break
    except _FAILURES as problem:
        passage.outcome = f"failed: {type(problem).__name__}"
    reached = course.clock[used[passage.samples - 1]] if passage.samples else -np.inf
    whole = passage.samples == len(used)
    for span in spans:
        span.complete = bool(whole or reached >= span.end) and bool(span.truth)
    return passage


class _Asked:
    """What is predicted in a span, and after which samples."""

    def __init__(self, course: Course, span: Predicted) -> None:
        self.course, self.span = course, span
        used = used_samples(len(course.clock), course.every, course.gaps)
        begins = used[(course.clock[used] >= span.begin) & (course.clock[used] < span.end)]
        lengths = {"hold": course.every, "short": SHORT / course.step}
        lengths["long"] = course.beat / course.step
        self.length = {kind: max(1, round(lengths[kind])) for kind in span.horizons}
        self.after = {
            kind: set(thin(self._whole(begins, length), _MOST[kind]).tolist())
            for kind, length in self.length.items()
        }
        chosen = thin(self._whole(begins, course.every), _MOST["checks"]).tolist()
        self.checks = set(chosen)

    def _whole(self, begins: Indices, length: int) -> Indices:
        """Those whose windows neither leave the course nor cross a gap."""
        gaps = np.array(self.course.gaps, np.int64)
        ends = begins + length
        crossed = np.searchsorted(gaps, ends, "right") - np.searchsorted(gaps, begins, "right")
        whole: Indices = begins[(ends < len(self.course.clock)) & (crossed == 0)]
        return whole

    def ask(self, entrant: Entrant, index: int) -> None:
        course, span = self.course, self.span
        for kind, length in self.length.items():
            if index in self.after[kind]:
                window = slice(index + 1, index + 1 + length)
                span.truth.setdefault(kind, []).append(course.y[window])
                span.guess.setdefault(kind, []).append(entrant.predict(course.x[window]))
        if index in self.checks:
            ahead = index + course.every
            error = course.y[ahead] - entrant.predict(course.x[ahead : ahead + 1])[0]
            std = entrant.std(course.x[ahead])
            span.misses.append(np.abs(error) / std)
