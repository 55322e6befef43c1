"""A long log through a learner block by block: the scores of `stream`, memory of one block.

Each block ends right before a sample that is used, so predictions and updates are those of one
stream over all samples. What was learned and counted is kept after every block; who was
interrupted, or killed, goes on from there. Neglected: horizons across the ends of blocks, the
memory of networks across them, and a record of every prediction: that of the last block remains.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.errors import LogError, Outcome
from patagium.learning.calibration import NOMINAL, calibration_scores, reliability
from patagium.learning.learners.learner import Resumable
from patagium.learning.learners.registry import load_learner
from patagium.learning.result import Identification
from patagium.learning.schedule import used_samples
from patagium.learning.scores import SILENT_RATIO, coverage, persistence, span_scores
from patagium.learning.stream import Progress, StreamRun
from patagium.learning.tables import HORIZONS
from patagium.sensing.logs.record import LogRecord
from patagium.sensing.logs.table import LogTable, find_gaps
from patagium.whole_file import write_whole

Array = NDArray[np.float64]

LONG = 1_000_000
"""Samples from which a log is learned from block by block."""
BLOCK = 1 << 18
_UPDATES = 2000
"""Updates of each block that calibration is judged by: its last ones."""


def identify_record(
    record: LogRecord,
    learner: Resumable,
    *,
    every: int = 100,
    horizons: Mapping[str, float] | None = None,
    progress: Progress | None = None,
    course: Path | None = None,
    block: int = BLOCK,
) -> Identification:
    """What a learner makes of an imported log of any length; see `identify_table`.

    Args:
        record: The log, with inputs and outputs.
        learner: What learns; it is changed, or another goes on in its place: see the result.
        every: 100 to use one sample in 100.
        horizons: Label and length [s] of the spans to predict with frozen weights; None:
            10 ms and 1 s.
        progress: Called now and then with samples done and samples in all.
        course: File to go on from, and to keep the course in; removed at the end.
        block: Samples a block, at most; at least ten times `every`.

    Returns:
        Scores over all samples; the record of the last block. If the learner diverged, those
        up to there.
    """
    spans = dict(HORIZONS if horizons is None else horizons)
    run = _Course(record, learner, every, spans, max(block, 10 * every), course)
    run.go(progress)
    return run.result()


class _Course:
    """How far the learner came, and what was counted on the way."""

    def __init__(
        self,
        record: LogRecord,
        learner: Resumable,
        every: int,
        horizons: dict[str, float],
        block: int,
        path: Path | None,
    ) -> None:
        self.record, self.learner, self.every = record, learner, every
        self.horizons, self.block, self.path = horizons, block, path
        self.names = record.of_role("output")
        self.step = float(np.median(np.diff(record.time(0, block))))
        self.totals = _Totals(len(self.names), tuple(horizons))
        self.begin, self.last, self.gaps = 0, float("nan"), 0
        self.lengths: dict[str, int] = {}
        self.outcome, self.message = Outcome.COMPLETED, ""
        self.table: LogTable | None = None
        self.final: Identification | None = None
        self._resume()

    def go(self, progress: Progress | None) -> None:
        total = self.record.count
        if self.begin and progress is not None:
            progress(self.begin, total)
        while self.begin < total:
            begin, end = self._learn_block(progress)
            if self.outcome is not Outcome.COMPLETED:
                break
            self.begin = end
            if self.begin < total:
                self._keep(begin)
        if self.path is not None:
            self._remove()

    def result(self) -> Identification:
        reached = self.totals.samples
        scores: dict[str, Any] = {
            "samples": self.record.count,
            "samples_predicted": reached,
            "every": self.every,
            "updates": self.totals.updates,
            "median_step": self.step,
            "gaps": self.gaps,
            "gaps_found": f"{self.gaps} gap(s) longer than {self.record.gap:g} times the median "
            f"step of {self.step:.4g} s",
            "events": {name: count for name, count in self.learner.events.items() if count},
            "outcome": self.outcome.name,
            "message": self.message,
            **self.totals.scores(self.names, self.horizons, self.lengths),
            "time_per_update": float(self.learner.time_per_update),
            "recorded": f"the last {0 if self.final is None else len(self.final.prediction.time)} "
            "samples",
        }
        if self.final is None:
            raise LogError(f"{self.record.path}: expected samples to learn from, found none")
        scores["largest_variance"] = self.final.scores["largest_variance"]
        return Identification(
            scores, self.final.prediction, self.learner, self.outcome, self.message
        )

    def _learn_block(self, progress: Progress | None) -> tuple[int, int]:
        total = self.record.count
        begin, end = self.begin, min(self.begin + self.block, total)
        if total - end < 10 * self.every:
            end = total
        table = self.record.table(begin, end)
        time = table.time if begin else self.record.time(begin, end)
        gaps = find_gaps(time, self.record.gap)
        used = used_samples(len(time), self.every, gaps)
        if end < total and len(used) > 1:
            end = begin + int(used[-1])  # the next block begins with a used sample
        rows = slice(0, end - begin)
        gaps = gaps[gaps < end - begin]
        if begin and time[0] - self.last > self.record.gap * self.step:
            self.gaps += 1
        self.gaps += len(gaps)
        x, y = table.x[rows], table.y[rows]
        run = StreamRun(self.learner, time[rows], x, y, self.every, self.horizons, gaps)
        run.go(None if progress is None else lambda done, _: progress(begin + done, total))
        self.totals.add(run, begin, total)
        self.lengths = {h.label: h.length for h in run.horizons}
        self.outcome, self.message = run.outcome, run.message
        self.last = float(time[rows][-1])
        self.final = run.result(self.names)
        self.final.prediction.coords["unit"] = ("output", list(table.output_units))
        return begin, end

    def _mark(self) -> str:
        facts = self.record.path.stat()
        words = [
            facts.st_size, facts.st_mtime_ns, self.every, self.horizons, self.block,
            self.learner.describe(),
        ]  # fmt: skip
        return hashlib.sha256(json.dumps(words, sort_keys=True, default=str).encode()).hexdigest()

    def _keep(self, begin: int) -> None:
        """Learner and counts, as of the end of a block; the learner first, under a new name."""
        if self.path is None:
            return
        kept = self.path.with_name(f"{self.path.name}.{self.begin}.state")
        self.learner.save(kept)
        words = {
            "mark": self._mark(), "begin": self.begin, "gaps": self.gaps, "last": self.last,
            "lengths": self.lengths, "learner": kept.name,
        }  # fmt: skip
        content = io.BytesIO()
        arrays: dict[str, Any] = {**self.totals.state(), "words": np.array(json.dumps(words))}
        np.savez(content, **arrays)
        write_whole(self.path, content.getvalue())
        if begin:
            self.path.with_name(f"{self.path.name}.{begin}.state").unlink(missing_ok=True)

    def _resume(self) -> None:
        if self.path is None or not self.path.exists():
            return
        try:
            with np.load(self.path) as held:
                words = json.loads(str(held["words"]))
                counts = {name: held[name] for name in held.files if name != "words"}
        except (OSError, ValueError, KeyError) as problem:
            raise LogError(f"{self.path}: no course to go on from: {problem}; remove it") from None
        if words["mark"] != self._mark():
            raise LogError(
                f"{self.path}: of another log, learner or setting; remove it to begin anew"
            )
        self.learner = load_learner(self.path.with_name(words["learner"]), like=self.learner)
        self.begin, self.gaps, self.last = words["begin"], words["gaps"], words["last"]
        self.lengths = words["lengths"]
        self.totals.resume(counts)

    def _remove(self) -> None:
        if self.path is None:
            return
        for name in self.path.parent.glob(f"{self.path.name}.*.state"):
            name.unlink(missing_ok=True)
        self.path.unlink(missing_ok=True)


class _Totals:
    """Sums over all blocks that the scores are made of.

    Sums of squares are about the first sample of each output, so that means do not drown them.
    """

    _PARTS = ("count", "y", "y2", "e2", "held2")

    def __init__(self, outputs: int, horizons: tuple[str, ...]) -> None:
        self.samples, self.updates = 0, 0
        self.center = np.full(outputs, np.nan)
        self.carried = np.zeros(outputs)
        spans = ("whole", "late", *horizons)
        self.sums = {name: np.zeros((len(self._PARTS), outputs)) for name in spans}
        self.windows = dict.fromkeys(horizons, 0)
        none = np.empty((0, outputs))
        self.checks = {"error": none, "std": none, "late": np.empty(0, bool)}
        self.recent = {"innovation": none, "std": none, "nis": np.empty(0)}

    def add(self, run: StreamRun, begin: int, total: int) -> None:
        y, guess = run.y[: run.reached], run.prediction[: run.reached]
        if not len(y):
            return
        self.center = np.where(np.isnan(self.center), _first_finite(y), self.center)
        held = persistence(run.y, run.used)[: run.reached]
        unheard = np.arange(len(y))[:, None] <= _first_measured(run.y, run.used)
        held = np.where(unheard, self.carried, held)
        late = begin + np.arange(len(y)) >= total // 2
        self._sum("whole", y, guess, held)
        self._sum("late", y[late], guess[late], held[late])
        for horizon in run.horizons:
            self._sum_windows(run, horizon)
        self._check(run, begin, total)
        self._learned(run)
        self.samples += len(y)
        self.updates += run.updates
        measured = run.y[run.used]
        last = [column[np.isfinite(column)][-1:] for column in measured.T]
        self.carried = np.array(
            [new[0] if len(new) else old for new, old in zip(last, self.carried, strict=True)]
        )

    def scores(
        self, names: tuple[str, ...], horizons: dict[str, float], lengths: dict[str, int]
    ) -> dict[str, Any]:
        variance = self._variance("whole")
        largest = np.sqrt(np.nanmax(self._square("whole"), initial=0.0))
        silent = ~(np.sqrt(variance) > SILENT_RATIO * largest)
        scores: dict[str, Any] = {
            "silent": [name for name, mute in zip(names, silent, strict=True) if mute]
        }
        for span, end in (("whole", ""), ("late", "_second_half")):
            scores |= span_scores(self._ratio(span, "e2", silent), names, f"nmse{end}")
            scores |= span_scores(self._ratio(span, "held2", silent), names, f"persistence{end}")
        for label, duration in horizons.items():
            key = f"horizon_{label}"
            scores |= {
                f"{key}_seconds": duration,
                f"{key}_samples": lengths.get(label, 0),
                f"{key}_windows": self.windows[label],
            }
            if self.windows[label]:
                nmse = self._ratio(label, "e2", silent)
                scores |= span_scores(nmse, names, f"{key}_nmse")
                held = self._ratio(label, "held2", silent)
                scores |= span_scores(held, names, f"{key}_persistence")
        return scores | self._interval_scores(names, ~silent)

    def _interval_scores(self, names: tuple[str, ...], heard: NDArray[np.bool_]) -> dict[str, Any]:
        error, std, late = (self.checks[k] for k in ("error", "std", "late"))
        each = coverage(error, std, heard)
        after = coverage(error[late], std[late], heard)
        told = [name for name, loud in zip(names, heard, strict=True) if loud]
        shares = reliability(error[:, heard], std[:, heard])
        return {
            "coverage": _mean(each),
            "coverage_second_half": _mean(after),
            "coverage_by_output": dict(zip(names, each.tolist(), strict=True)),
            "coverage_checks": len(error),
            "reliability": dict(zip(map(str, NOMINAL), shares, strict=True)),
            **calibration_scores(
                self.recent["innovation"][:, heard],
                self.recent["std"][:, heard],
                self.recent["nis"],
                told,
            ),
        }

    def state(self) -> dict[str, Array]:
        """All counts as arrays."""
        return {
            "counts": np.array([self.samples, self.updates], float),
            "center": self.center,
            "carried": self.carried,
            "windows": np.array(list(self.windows.values()), float),
            **{f"sums {name}": value for name, value in self.sums.items()},
            **{f"checks {name}": value for name, value in self.checks.items()},
            **{f"recent {name}": value for name, value in self.recent.items()},
        }

    def resume(self, state: Mapping[str, Array]) -> None:
        """Go on from counts."""
        self.samples, self.updates = (int(number) for number in state["counts"])
        self.center, self.carried = state["center"], state["carried"]
        self.windows = dict(zip(self.windows, map(int, state["windows"]), strict=True))
        for name, held in (("sums", self.sums), ("checks", self.checks), ("recent", self.recent)):
            held.update({key: state[f"{name} {key}"] for key in held})

    def _sum(self, span: str, y: Array, guess: Array, held: Array) -> None:
        known = np.isfinite(y)
        about = np.where(known, y - self.center, 0.0)
        error = np.where(known, y - guess, 0.0)
        miss = np.where(known, y - held, 0.0)
        parts = (known, about, about**2, error**2, miss**2)
        self.sums[span] += np.array([part.sum(axis=0) for part in parts])

    def _sum_windows(self, run: StreamRun, horizon: Any) -> None:
        for begin, ahead in run.windows[horizon.label]:
            rows = slice(begin, begin + horizon.length)
            held = np.broadcast_to(run.y[begin - 1], ahead.shape)
            self._sum(horizon.label, run.y[rows], ahead, np.where(np.isfinite(held), held, 0.0))
            self.windows[horizon.label] += 1

    def _check(self, run: StreamRun, begin: int, total: int) -> None:
        if not run.checks:
            return
        fresh = {
            "error": np.array([one.error for one in run.checks]),
            "std": np.array([one.std for one in run.checks]),
            "late": np.array([begin + one.sample >= total // 2 for one in run.checks]),
        }
        for name, values in fresh.items():
            self.checks[name] = np.concatenate([self.checks[name], values])

    def _learned(self, run: StreamRun) -> None:
        rows = slice(max(0, run.updates - _UPDATES), run.updates)
        fresh = {"innovation": run.innovation, "std": run.std, "nis": run.nis}
        for name, values in fresh.items():
            self.recent[name] = np.concatenate([self.recent[name], values[rows]])

    def _square(self, span: str) -> Array:
        count, y, y2 = self.sums[span][:3]
        count = np.where(count, count, np.nan)
        return np.asarray(y2 / count + 2 * self.center * y / count + self.center**2)

    def _variance(self, span: str) -> Array:
        count, y, y2 = self.sums[span][:3]
        count = np.where(count, count, np.nan)
        return np.asarray(np.maximum(0.0, y2 / count - (y / count) ** 2))

    def _ratio(self, span: str, part: str, silent: NDArray[np.bool_]) -> Array:
        count, variance = self.sums[span][0], self._variance(span)
        error = self.sums[span][self._PARTS.index(part)]
        heard = ~silent & (variance > 0)
        scale = np.where(heard, count * variance, 1.0)
        return np.where(heard, error / scale, np.nan)


def _first_finite(values: Array) -> Array:
    return np.array(
        [column[np.isfinite(column)][0] if np.isfinite(column).any() else np.nan
         for column in values.T]
    )  # fmt: skip


def _first_measured(y: Array, used: NDArray[np.int64]) -> NDArray[np.int64]:
    """First used sample at which each output was measured; past the end if none."""
    known = np.isfinite(y[used])
    first = used[known.argmax(axis=0)]
    return np.where(known.any(axis=0), first, len(y))


def _mean(values: Array) -> float:
    heard = values[~np.isnan(values)]
    return float(heard.mean()) if heard.size else float("nan")
