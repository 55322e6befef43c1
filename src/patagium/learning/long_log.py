"""Identification from a long log, block by block, in the memory of one block.

Each block ends right before a sample that is used, so predictions and updates are those of one
stream over all samples. Learner and sums are kept after every block; a run that was interrupted,
or killed, goes on from there. No forecast reaches across the end of a block, and each block's
begin anew with what they know; of the record of predictions that of the last block remains.
"""

from __future__ import annotations

import glob
import hashlib
import io
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from patagium.arguments import Progress
from patagium.arrays import find_gaps, usual_step
from patagium.errors import LogError, Outcome, OutputError
from patagium.learning.default_learner import choices, default_learner, table_every
from patagium.learning.forecast import ForecastSums, Horizons, named_horizons
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.registry import load_learner
from patagium.learning.models.memory import ModelMemory
from patagium.learning.result import Identification
from patagium.learning.scores import Scorer, persistence
from patagium.learning.stream import BlockRun, Samples, forecast_scores, used_samples
from patagium.learning.table_network import range_words, samples_that_scale
from patagium.learning.verdict import Block, frozen_scores, with_verdict
from patagium.sensing.logs.record import LogRecord
from patagium.whole_file import write_whole

LONG = 1_000_000
"""Samples from which a log is learned from block by block."""
BLOCK = 1 << 18
"""Samples of a block, at most, unless another number is asked for."""
_FEW = 1 << 14  # samples that constant weights predict at a time
_FORMAT = 6  # of the file that a run goes on from
_NUMBERS = ("begin", "last", "gaps", "updates")  # of a run, beside its sums


def identify_record(
    record: LogRecord,
    learner: FilterLearner | None = None,
    *,
    every: int | None = None,
    horizons: Horizons = None,
    progress: Progress | None = None,
    course: Path | None = None,
    block: int = BLOCK,
) -> Identification:
    """Identification from an imported log of any length; see `identify`.

    Args:
        record: The log, with inputs and outputs.
        learner: What learns; it is changed, or another goes on in its place: see the result.
            None: the default, a dense network.
        every: 100 to use one sample in 100; None: as `table_every` says.
        horizons: Times ahead for which outputs are forecast; see `stream`.
        progress: Called now and then with samples done and samples in all.
        course: File to go on from, in which progress is kept until `remove_course`, or
            until the learner diverges.
        block: Samples a block, at most; at least ten times `every`.

    Returns:
        Scores over all samples; the record of the last block. If the learner diverged, those
        up to there.

    Raises:
        LogError: If the log holds no samples, or `course` is of another log or learner.
    """
    start = record.table(0, min(record.count, BLOCK))
    chosen = learner or default_learner(start, every=every)
    step = usual_step(start.time)
    taken = table_every(chosen, step) if every is None else every
    run = _LongRun(record, chosen, taken, named_horizons(horizons), max(block, 10 * taken), course)
    first = samples_that_scale(chosen.network, start)
    run.begin = run.begin or first
    run.go(progress)
    result = run.result()
    result.scores["samples_that_scaled"] = first
    result.scores["verdict"] += range_words(start, first)
    result.scores["chosen"] = choices(
        run.learner, taken, step, learner_given=learner is not None, every_given=every is not None
    )
    return result


def remove_course(course: Path) -> None:
    """Remove the kept progress of a run, once its learner is on the disk."""
    course.unlink(missing_ok=True)  # first: without its learner it could not be gone on from
    for kept in course.parent.glob(f"{glob.escape(course.name)}.[0-9]*.state"):
        kept.unlink(missing_ok=True)


class _LongRun:
    """Run of a learner through a long log, with the sums of its scores."""

    def __init__(
        self,
        record: LogRecord,
        learner: FilterLearner,
        every: int,
        horizons: Mapping[str, float],
        block: int,
        path: Path | None,
    ) -> None:
        self.record, self.learner, self.every = record, learner, every
        self.block, self.path = block, path
        names = record.of_role("output")
        self.step = usual_step(record.time(0, block))
        scale = getattr(learner.network, "output_scale", 1.0)
        self.scorer, self.held = Scorer(names, scale), np.zeros(len(names))
        self.horizons = dict(horizons)
        self.forecasts = [ForecastSums(label, s, names, scale) for label, s in horizons.items()]
        self.begin, self.last, self.gaps, self.updates = 0, float("nan"), 0, 0
        self.final: tuple[BlockRun, xr.Dataset] | None = None
        self.memory, self.unkept = ModelMemory(learner.network), ""
        self._resume()

    def go(self, progress: Progress | None) -> None:
        """Learn all blocks in order, or those up to where the learner diverged."""
        total = self.record.count
        if self.begin and progress is not None:
            progress(self.begin, total)
        while (begin := self.begin) < total:
            if self._learn_block(progress).outcome is not Outcome.COMPLETED:
                break
            if self.begin < total:
                try:
                    self._keep(begin)
                except OutputError as problem:  # the run goes on; an older course stays
                    self.unkept = str(problem)
        done = self.final is not None and self.final[0].outcome is Outcome.COMPLETED
        if done and isinstance(self.learner, FilterLearner):
            last = self.record.table(max(0, total - self.block), total)
            self.learner.look_back(last.time, last.x, find_gaps(last.time, self.record.gap))
        if not done and self.path is not None:
            remove_course(self.path)

    def result(self) -> Identification:
        """Scores over all samples, and the record of the last block.

        Raises:
            LogError: If the log holds no samples.
        """
        if self.final is None:
            raise LogError(self.record.path, "samples to learn from", "none")
        run, record = self.final
        scores = {
            "samples": self.record.count,
            "samples_predicted": self.scorer.samples,
            "every": self.every,
            "updates": self.updates,
            "median_step": self.step,
            "gaps": self.gaps,
            "gaps_found": f"{self.gaps} gap(s) longer than {self.record.gap:g} times the median "
            f"step of {self.step:.4g} s",
            **self.scorer.scores(),
            **forecast_scores(self.forecasts),
            **run.facts(),
            **frozen_scores(self.learner.network, self._second_half(), self.learner.weights),
            "recorded": f"the last {len(record.time)} samples",
            **({"course_not_kept": self.unkept} if self.unkept else {}),
        }
        facts = self.learner, run.outcome, run.message, self.record.of_role("input")
        return Identification(with_verdict(scores), record, *facts)

    def _second_half(self) -> Iterator[Block]:
        """Samples of the second half, block by block."""
        for begin in range(self.record.count // 2, self.begin, _FEW):
            one = self.record.table(begin, min(begin + _FEW, self.begin))
            yield one.time, one.x, one.y, find_gaps(one.time, self.record.gap), slice(None)

    def _learn_block(self, progress: Progress | None) -> BlockRun:
        """Learn and score the samples from `begin` on, up to right before a used one."""
        total, begin = self.record.count, self.begin
        end = min(begin + self.block, total)
        if total - end < 10 * self.every:
            end = total
        table = self.record.table(begin, end)
        time = table.time if begin else self.record.time(begin, end)
        gaps = find_gaps(time, self.record.gap)
        used = used_samples(table.y, self.every, gaps)
        if end < total and len(used) > 1:
            end = begin + int(used[-1])  # the next block begins with a used sample
        rows = slice(0, end - begin)
        gaps = gaps[gaps < end - begin]
        if begin and time[0] - self.last > self.record.gap * self.step:
            self.gaps += 1
            self.memory.last = None  # it begins anew after a gap
        self.gaps += len(gaps)
        samples = Samples(time[rows], table.x[rows], table.y[rows], gaps)
        run = BlockRun(self.learner, samples, self.every, memory=self.memory)
        run.forecast(self.forecasts, total // 2 - begin)
        run.go(None if progress is None else lambda done, _: progress(begin + done, total))
        held = persistence(samples.y, run.used, self.held)
        run.score(self.scorer, held, begin, total // 2)
        self.updates += run.updates
        self.final = run, run.record(self.scorer.names, table.output_units, held)
        self.begin, self.last = end, float(samples.time[-1])
        measured = persistence(samples.y[run.used], np.arange(len(run.used)), self.held)
        newest = samples.y[run.used[-1]]
        self.held = np.where(np.isfinite(newest), newest, measured[-1])
        return run

    def _mark(self) -> str:
        facts = self.record.path.stat()
        learner = {k: value for k, value in self.learner.describe().items() if k != "found"}
        words = [
            _FORMAT, facts.st_size, facts.st_mtime_ns, self.record.mapping, self.every,
            self.horizons, self.block, learner,
        ]  # fmt: skip
        return hashlib.sha256(json.dumps(words, sort_keys=True, default=str).encode()).hexdigest()

    def _keep(self, begin: int) -> None:
        """Write learner and sums after a block; the learner first, under a new name."""
        if self.path is None:
            return
        kept = self.path.with_name(f"{self.path.name}.{self.begin}.state")
        self.learner.save(kept)
        words = {"mark": self._mark(), "learner": kept.name}
        words |= {name: getattr(self, name) for name in _NUMBERS}
        content = io.BytesIO()
        arrays: dict[str, Any] = {
            "held": self.held,
            **self.memory.state(),
            **self.scorer.state(),
            **{name: value for one in self.forecasts for name, value in one.state().items()},
        }
        np.savez(content, words=np.array(json.dumps(words)), **arrays)
        write_whole(self.path, content.getvalue())
        if begin:
            self.path.with_name(f"{self.path.name}.{begin}.state").unlink(missing_ok=True)

    def _resume(self) -> None:
        """Go on from the course of an earlier run of the same log and settings."""
        if self.path is None or not self.path.exists():
            return
        try:
            with np.load(io.BytesIO(self.path.read_bytes())) as held:
                words = json.loads(str(held["words"]))
                sums = {name: held[name] for name in held.files if name != "words"}
        except Exception as problem:  # of the libraries, in many kinds
            raise LogError(f"{self.path}: no course to go on from: {problem}; remove it") from None
        if words["mark"] != self._mark():
            raise LogError(
                f"{self.path}: of another log, learner or setting; remove it to begin anew"
            )
        self.learner = load_learner(self.path.with_name(words["learner"]), like=self.learner)
        for name in _NUMBERS:
            setattr(self, name, words[name])
        self.held = sums.pop("held")
        self.memory = ModelMemory(self.learner.network)
        self.memory.resume(sums)
        self.scorer.resume(sums)
        for one in self.forecasts:
            one.resume(sums)
