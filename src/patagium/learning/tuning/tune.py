"""Settings of a learner chosen by what it predicts: no hand in it, no truth looked up.

Each trial teaches a new learner the used samples of a flight and takes the likelihood of its
innovations over the second half (`foresight`): what it has come to, not how it began. `search`
says what to try, `knobs` what there is to try. Neglected: the luck of the initial weights, which
are those of one seed; flights other than the one given.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.errors import LogError, ParameterError, ShapeError
from patagium.learning.identify import samples
from patagium.learning.models.memory import measured_inputs
from patagium.learning.models.network import Network
from patagium.learning.schedule import LogSamples, used_samples
from patagium.learning.tuning.foresight import Foresight, moving, predict
from patagium.learning.tuning.journal import Journal, described_foresight
from patagium.learning.tuning.knobs import Choice, Knob, LearnerKind, knobs_for, values_at
from patagium.learning.tuning.pool import in_any_order, pool
from patagium.learning.tuning.search import Asked, evaluations, search
from patagium.learning.tuning.settings import (
    LearnerSettings,
    NetworkSettings,
    Settings,
    make_learner,
)
from patagium.sensing.logs.table import LogTable
from patagium.version import __version__

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

PIECE = 4
"""The first trials see one in so many samples, in a row where most moves, ..."""
LEAST_SAMPLES = 50
"""... at least so many."""
MOST_WEIGHTS = 400
"""Larger networks are tried with blocks of one neuron only, unless others are asked for."""
SHOWN = 10
"""Trials that stand in the file."""
_SHOWN_SCORES = ("log_likelihood_second_half", "nmse_second_half", "coverage_second_half")


@dataclass(frozen=True)
class Trial:
    """Settings that were tried over all samples.

    Attributes:
        hidden: Neurons of each hidden layer of the network.
        values: Knobs of the learner, plain.
        foresight: What it predicted.
    """

    hidden: tuple[int, ...]
    values: dict[str, Any]
    foresight: Foresight

    def describe(self) -> dict[str, Any]:
        """As JSON-able values, scores of six digits."""
        gave = described_foresight(self.foresight)
        scores = {k: _short(gave[k]) for k in _SHOWN_SCORES}
        return {**scores, "hidden": list(self.hidden), **self.values}


@dataclass(frozen=True)
class Tuned:
    """The settings that predicted a flight best.

    Attributes:
        best: They, as a file holds them.
        trials: All that were tried over all samples, the best first.
        network: The network they are for, of those given.
    """

    best: Settings
    trials: tuple[Trial, ...]
    network: Network

    def learner(self, network: Network | None = None) -> Any:
        """A learner with the best settings that has learned nothing yet.

        Args:
            network: Whose weights it learns; None for the one it was tuned with.
        """
        return self.best.made(self.network if network is None else network)

    def save(self, path: str | Path) -> Path:
        """Write the settings for `patagium identify --settings`.

        Args:
            path: A YAML file, replaced if it exists.
        """
        return self.best.save(path)


def tune(
    flight: xr.Dataset | LogTable,
    network: Network | Sequence[Network],
    *,
    every: int = 100,
    trials: int = 64,
    learner: LearnerKind = "cubature",
    covariance: Sequence[Any] | None = None,
    seed: int = 0,
    jobs: int | None = None,
    cluster: str | None = None,
    journal: str | Path | None = None,
    source: str = "",
    progress: Progress | None = None,
) -> Tuned:
    """The settings of a learner that predict a flight best, by the innovation likelihood.

    The answer depends on the seed, not on the number of processes.

    Args:
        flight: Record with q, v, a, u1, or a table.
        network: What learns; several that differ in their hidden layers are tried in turn.
        every: 100 to use one sample in 100. What is found is for that rate.
        trials: Settings to try.
        learner: "cubature" or "extended".
        covariance: Structures to try, as files hold them: "full", "layer", "node" or
            {"rank": r}; None: the first three, or "node" where a network has more than 400
            weights.
        seed: Of the search, and of the initial weights.
        jobs: Processes; None: one a core.
        cluster: Address of a Dask scheduler whose workers do it instead.
        journal: File that keeps each trial as it ends; a search that was stopped goes on
            from it.
        source: What the flight is called in the file.
        progress: Called with trials done and trials in all.

    Raises:
        ParameterError: If a number is out of its range, no output moves, or dask.distributed
            is asked for and not installed.
        ShapeError: If the network does not fit the flight.
        LogError: If the journal is of another question, or every trial diverged.
    """
    networks = tuple(network) if isinstance(network, Sequence) else (network,)
    task = _Task(flight, networks, every, learner, covariance, seed, source)
    book = Journal(task.question(), journal)
    told = _Count(evaluations(trials), progress)
    with ExitStack() as stack:
        workers: list[Any] = []

        def judge(asked: Sequence[Asked]) -> list[float]:
            plans = [task.plan(one) for one in asked]
            left = {json.dumps(plan): plan for plan in plans if book.found(plan) is None}
            told.add(len(plans) - len(left))
            if left and not workers:
                workers.append(stack.enter_context(pool(jobs, cluster)))
            todo = list(left.values())
            calls = [task.call(plan) for plan in todo]
            for number, gave in in_any_order(workers[0], _try, calls) if todo else ():
                book.keep(todo[number], gave)
                told.add(1)
            return [_kept(book, plan).score for plan in plans]

        points = search(task.choosing, trials, seed, judge)
    plans = {json.dumps(plan): plan for plan in (task.plan(Asked(p, True)) for p, _ in points)}
    tried = tuple(
        Trial(tuple(plan["hidden"]), plan["learner"], _kept(book, plan)) for plan in plans.values()
    )
    return task.answer(tried, trials)


class _Task:
    """What all trials have in common: samples, networks, knobs."""

    def __init__(
        self,
        flight: xr.Dataset | LogTable,
        networks: tuple[Network, ...],
        every: int,
        learner: LearnerKind,
        covariance: Sequence[Any] | None,
        seed: int,
        source: str,
    ) -> None:
        self.networks = {n.hidden: n for n in networks}
        if len(self.networks) != len(networks) or not networks:
            raise ParameterError(
                "network", "networks with different hidden layers", list(self.networks)
            )
        self.every, self.kind, self.seed = every, learner, seed
        self.log, self.y, self.source = _used(flight, networks[0], every, source)
        seen, sees = self.log.x.shape[1], measured_inputs(networks[0])
        if self.y.shape[1] != networks[0].outputs or seen != sees:
            raise ShapeError(
                "network",
                f"{seen} inputs, {self.y.shape[1]} outputs",
                f"{sees} inputs, {networks[0].outputs} outputs",
            )
        self.scored = moving(self.y)
        self.heard = self.scored.any(axis=0)
        if not self.scored[len(self.y) // 2 :].any():
            raise ParameterError(
                "flight",
                "an output that moves in the second half of the samples used",
                f"{len(self.y)} samples",
            )
        large = max(n.size for n in networks) > MOST_WEIGHTS
        structures = covariance or (("node",) if large else ("full", "layer", "node"))
        self.knobs: tuple[Knob, ...] = (
            *knobs_for(learner, self._unit(), structures),
            Choice("hidden", tuple(self.networks)),
        )

    @property
    def choosing(self) -> list[bool]:
        """Of each coordinate, whether it chooses."""
        return [axis for knob in self.knobs for axis in knob.axes]

    def question(self) -> dict[str, Any]:
        """What the trials of a journal have in common."""
        described = next(iter(self.networks.values())).describe()
        seen = self.log.x.tobytes() + self.y.tobytes()
        rest = {key: value for key, value in described.items() if key != "hidden"}
        return {
            "patagium": __version__,
            "flight": self.source,
            "samples": f"{len(self.y)} of digest {_digest(seen)}",
            "every": self.every,
            "network": f"{described['kind']} of digest {_digest(json.dumps(rest).encode())}",
            "learner": self.kind,
            "seed": self.seed,
        }

    def plan(self, asked: Asked) -> dict[str, Any]:
        """A trial, JSON-able."""
        values = values_at(self.knobs, asked.point)
        hidden = list(values.pop("hidden"))
        span = [0, len(self.y)] if asked.whole else self._piece()
        return {"hidden": hidden, "samples": span, "learner": values}

    def call(self, plan: dict[str, Any]) -> tuple[Any, ...]:
        """Arguments of `_try` for a trial."""
        network = self.networks[tuple(plan["hidden"])]
        span = plan["samples"]
        return network, self.kind, self.seed, plan["learner"], self.log, self.y, self.scored, span

    def answer(self, tried: tuple[Trial, ...], trials: int) -> Tuned:
        """The best of the trials.

        Raises:
            LogError: If all diverged.
        """
        best = tried[0]
        if not np.isfinite(best.foresight.score):
            raise LogError(
                f"{self.source}: expected a trial that learns, found that all diverged; the "
                f"first one: {best.foresight.reason}"
            )
        network = self.networks[best.hidden]
        described, names = network.describe(), np.array(network.output_names)
        settings = Settings(
            flight=self.source,
            every=self.every,
            network=NetworkSettings(
                kind=described["kind"],
                hidden=best.hidden,
                activation=described["activation"],
            ),
            learner=LearnerSettings(kind=self.kind, seed=self.seed, **best.values),
            foresight={
                **{k: _short(v) for k, v in described_foresight(best.foresight).items()},
                "outputs": names[self.heard].tolist(),
            },
            search={
                "trials": trials,
                "diverged": sum(not np.isfinite(t.foresight.score) for t in tried),
                "patagium": __version__,
            },
            trials=[trial.describe() for trial in tried[:SHOWN]],
        )
        return Tuned(settings, tried, network)

    def _piece(self) -> list[int]:
        """First sample that the first trials see, and one past the last: where most moves."""
        count = len(self.y)
        length = min(count, max(LEAST_SAMPLES, count // PIECE))
        until = np.append(0, np.cumsum(self.scored.sum(axis=1)))
        begin = int(np.argmax(until[length:] - until[: count + 1 - length]))
        return [begin, begin + length]

    def _unit(self) -> list[float]:
        """Deviation of each output; of those that never move, the middle of the others."""
        std = np.nanstd(self.y, axis=0)
        std[~(std > 1e-9 * std.max())] = np.median(std[self.heard])
        return [float(one) for one in std]


class _Count:
    """Trials done, told as they end."""

    def __init__(self, total: int, progress: Progress | None) -> None:
        self._done, self._total, self._progress = 0, total, progress

    def add(self, count: int) -> None:
        self._done += count
        if self._progress is not None and count:
            self._progress(self._done, self._total)


def _try(
    network: Network,
    kind: LearnerKind,
    seed: int,
    values: dict[str, Any],
    log: LogSamples,
    y: Array,
    scored: NDArray[np.bool_],
    span: list[int],
) -> Foresight:
    """One trial, in a worker."""
    rows, learner = slice(*span), make_learner(network, kind, seed, values)
    return predict(learner, log.part(*span), y[rows], scored[rows])


def _used(
    flight: xr.Dataset | LogTable, network: Network, every: int, source: str
) -> tuple[LogSamples, Array, str]:
    """The samples used, those between them where the network remembers; y; their name."""
    if isinstance(flight, LogTable):
        time, x, y, gaps, name = flight.time, flight.x, flight.y, flight.gaps, flight.source
    else:
        time, x, y, _ = samples(flight, network)
        gaps, name = np.zeros(0, int), f"a flight of {flight.attrs.get('robot_name', 'a robot')}"
    chosen = used_samples(len(x), every, gaps)
    log = LogSamples(time, x, np.asarray(gaps, int), chosen)
    if measured_inputs(network) == network.inputs:
        log = LogSamples(time[chosen], x[chosen], log.gaps[:0], np.arange(len(chosen)))
    return log, y[chosen], source or name


def _kept(book: Journal, plan: dict[str, Any]) -> Foresight:
    found = book.found(plan)
    if found is None:
        raise KeyError(json.dumps(plan))
    return found


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:12]


def _short(number: Any) -> Any:
    return float(f"{number:.6g}") if isinstance(number, float) else number
