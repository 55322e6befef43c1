"""Settings of a learner chosen by the likelihood of its predictions.

Each trial teaches a new learner the used samples of a flight; its score is the likelihood of the
innovations over the second half, when the learner has settled. Optuna draws the trials over
the ranges of the settings' record (`search`). Neglected: the luck of the initial weights,
which are those of one seed; flights other than the one given.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.errors import LogError, ParameterError, ShapeError
from patagium.learning.identify import samples
from patagium.learning.learners.registry import FILTER_LEARNERS, make_learner
from patagium.learning.models.memory import measured_inputs
from patagium.learning.models.network import Network
from patagium.learning.settings import Alternatives
from patagium.learning.stream import used_samples
from patagium.learning.tuning.likelihood import (
    LogSamples,
    PredictionScore,
    moving,
    score_predictions,
)
from patagium.learning.tuning.search import (
    DrawnTrial,
    SearchSpace,
    TrialJournal,
    pool,
    search,
    search_space,
)
from patagium.learning.tuning.settings_file import LearnerSettings, NetworkSettings, Settings
from patagium.sensing.logs.table import LogTable
from patagium.version import __version__

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

MOST_WEIGHTS = 400
"""Larger networks are tried with covariance blocks of one neuron only, unless others are given."""
SHOWN = 10
"""Number of trials that the file of settings lists."""
_SHOWN_SCORES = ("log_likelihood_second_half", "nmse_second_half", "coverage_second_half")


class SearchOptions(TypedDict, total=False):
    """Options of `tune` that say where a search runs and what it keeps, not what it finds.

    Attributes:
        jobs: Number of processes; None: one for each core.
        cluster: Address of a Dask scheduler whose workers do the work instead.
        journal: File that keeps each trial as it ends; a search that was stopped goes on
            from it.
        source: Name of the flight in the file of settings.
        progress: Function called with the number of trials done and of all trials.
    """

    jobs: int | None
    cluster: str | None
    journal: str | Path | None
    source: str
    progress: Progress | None


@dataclass(frozen=True)
class Trial:
    """Settings that were tried, and their score.

    Attributes:
        hidden: Neurons of each hidden layer of the network.
        values: Settings of the learner, plain, by name.
        prediction: Score of its predictions.
    """

    hidden: tuple[int, ...]
    values: dict[str, Any]
    prediction: PredictionScore

    def describe(self) -> dict[str, Any]:
        """Trial as JSON-able values, scores of six digits."""
        found = self.prediction.describe()
        scores = {name: _short(found[name]) for name in _SHOWN_SCORES}
        return {**scores, "hidden": list(self.hidden), **self.values}


@dataclass(frozen=True)
class Tuned:
    """Settings that predicted a flight best.

    Attributes:
        best: Best settings, as a file holds them.
        trials: All trials, the best first.
        network: Network of the best settings, of those given.
    """

    best: Settings
    trials: tuple[Trial, ...]
    network: Network

    def learner(self, network: Network | None = None) -> Any:
        """New learner with the best settings.

        Args:
            network: Network whose weights it learns; None: the one it was tuned with.
        """
        return self.best.made(self.network if network is None else network)

    def save(self, path: str | Path) -> Path:
        """Write the settings for `patagium identify --settings`.

        Args:
            path: YAML file, replaced if it exists.
        """
        return self.best.save(path)


def tune(
    flight: xr.Dataset | LogTable,
    network: Network | Sequence[Network],
    *,
    every: int = 100,
    trials: int = 64,
    learner: str = "cubature",
    covariance: Sequence[Any] | None = None,
    settings: Mapping[str, Any] | None = None,
    seed: int = 0,
    **options: Unpack[SearchOptions],
) -> Tuned:
    """Settings of a learner that predict a flight best, by the likelihood of the innovations.

    The result depends on the seed, not on the number of processes.

    Args:
        flight: Record with q, v, a, u1, or a table.
        network: Network that learns; several that differ in their hidden layers are alternatives.
        every: 100 to use one sample in 100. The settings found are for that rate.
        trials: Number of settings to try.
        learner: "cubature" or "extended".
        covariance: Structures to try, as files hold them: "full", "layer", "node" or
            {"rank": r}; None: the first three, or "node" where a network has more than 400
            weights.
        settings: Settings that are not searched over their ranges, by name: a plain value as
            files hold it, or `Alternatives`.
        seed: Seed of the search and of the initial weights.
        **options: `jobs`, `cluster`, `journal`, `source` and `progress`; see `SearchOptions`.

    Raises:
        ParameterError: If a number is out of its range, no output moves, or dask.distributed
            is not installed and a cluster is given.
        ShapeError: If the network does not fit the flight.
        LogError: If the journal is of another question, or every trial diverged.
        TypeError: If there is no such option.
    """
    unknown = sorted(set(options) - set(SearchOptions.__annotations__))
    if unknown:
        raise TypeError(f"tune() got an unexpected keyword argument {unknown[0]!r}")
    networks = tuple(network) if isinstance(network, Sequence) else (network,)
    chosen = dict(settings or {})
    if covariance is not None:
        chosen["covariance"] = Alternatives(tuple(covariance))
    source = options.get("source", "")
    problem = _problem(flight, networks, every, learner, chosen, seed, source)
    book = TrialJournal(problem.question(), options.get("journal"))
    drawn = _scored_trials(
        problem,
        book,
        trials,
        options.get("progress"),
        lambda: pool(options.get("jobs"), options.get("cluster")),
    )
    return problem.tuned([(trial, book.scores[trial.number]) for trial in drawn])


def _scored_trials(
    problem: _Problem,
    book: TrialJournal,
    trials: int,
    progress: Progress | None,
    workers: Callable[[], Any],
) -> list[DrawnTrial]:
    """Trials of a search, all scored; those that the journal has are not scored again."""
    from joblib import delayed

    distributions = problem.space.distributions()
    with ExitStack() as stack:
        opened: list[Any] = []

        def judge(batch: Sequence[DrawnTrial]) -> list[float]:
            left = [trial for trial in batch if trial.number not in book.scores]
            if left and not opened:
                opened.append(stack.enter_context(workers()))
            calls = (delayed(_try)(*problem.call(trial)) for trial in left)
            for trial, score in zip(left, opened[0](calls) if left else (), strict=True):
                book.keep(trial, distributions, score)
                if progress is not None:
                    progress(trial.number, trials)
            return [book.scores[trial.number].score for trial in batch]

        found = search(distributions, trials, problem.seed, judge)
    if progress is not None:
        progress(trials, trials)
    return found


@dataclass(frozen=True)
class _Problem:
    """Problem that all trials share.

    Attributes:
        networks: Networks by their hidden layers.
        space: Settings to try.
        seed: Seed of the search and of the initial weights.
        every: One sample in so many is used.
        log: Samples used, and those between them where the network has a memory.
        y: Measurements of the samples used, (N, n_y) [unit of y].
        scored: Measurements that count, (N, n_y) [unit of y].
        source: Name of the flight.
    """

    networks: dict[tuple[int, ...], Network]
    space: SearchSpace
    seed: int
    every: int
    log: LogSamples
    y: Array
    scored: NDArray[np.bool_]
    source: str

    def question(self) -> dict[str, Any]:
        """Question that the trials of a journal answer, as JSON values."""
        described = next(iter(self.networks.values())).describe()
        seen = self.log.x.tobytes() + self.y.tobytes()
        rest = {key: value for key, value in described.items() if key != "hidden"}
        space = json.dumps([str(sorted(self.space.searched.items())), self.space.fixed])
        return {
            "patagium": __version__,
            "flight": self.source,
            "samples": f"{len(self.y)} of digest {_digest(seen)}",
            "every": self.every,
            "network": f"{described['kind']} of digest {_digest(json.dumps(rest).encode())}",
            "learner": self.space.kind,
            "settings": f"a space of digest {_digest(space.encode())}",
            "seed": self.seed,
        }

    def call(self, trial: DrawnTrial) -> tuple[Any, ...]:
        """Arguments of `_try` for a trial."""
        hidden, values = self.space.values(trial.parameters)
        network = self.networks[hidden]
        return network, self.space.kind, self.seed, values, self.log, self.y, self.scored

    def tuned(self, scored: Sequence[tuple[DrawnTrial, PredictionScore]]) -> Tuned:
        """Best of the trials, and all of them.

        Raises:
            LogError: If all diverged.
        """
        found = [Trial(*self.space.values(one.parameters), score) for one, score in scored]
        tried = sorted(found, key=lambda trial: -trial.prediction.score)
        best = tried[0]
        if not np.isfinite(best.prediction.score):
            raise LogError(
                f"{self.source}: expected a trial that learns, found that all diverged; the "
                f"first one: {best.prediction.reason}"
            )
        network = self.networks[best.hidden]
        described, outputs = network.describe(), np.array(network.output_names)
        scores = {name: _short(one) for name, one in best.prediction.describe().items()}
        settings = Settings(
            flight=self.source,
            every=self.every,
            network=NetworkSettings(
                kind=described["kind"], hidden=best.hidden, activation=described["activation"]
            ),
            learner=LearnerSettings(kind=self.space.kind, seed=self.seed, **best.values),
            prediction={**scores, "outputs": outputs[self.scored.any(axis=0)].tolist()},
            search={
                "trials": len(tried),
                "diverged": sum(not np.isfinite(trial.prediction.score) for trial in tried),
                "patagium": __version__,
            },
            trials=[trial.describe() for trial in tried[:SHOWN]],
        )
        return Tuned(settings, tuple(tried), network)


def _problem(
    flight: xr.Dataset | LogTable,
    networks: tuple[Network, ...],
    every: int,
    kind: str,
    settings: dict[str, Any],
    seed: int,
    source: str,
) -> _Problem:
    """Samples, networks and search space of a flight.

    Raises:
        ParameterError: If the networks or the settings are not as they should be, or no output
            moves.
        ShapeError: If the network does not fit the flight.
    """
    by_hidden = {one.hidden: one for one in networks}
    if len(by_hidden) != len(networks) or not networks:
        raise ParameterError("network", "networks with different hidden layers", list(by_hidden))
    if kind not in FILTER_LEARNERS:
        raise ParameterError("learner", f"one of {', '.join(FILTER_LEARNERS)}", kind)
    log, y, name = _used(flight, networks[0], every, source)
    seen, sees = log.x.shape[1], measured_inputs(networks[0])
    if y.shape[1] != networks[0].outputs or seen != sees:
        raise ShapeError(
            "network",
            f"{seen} inputs, {y.shape[1]} outputs",
            f"{sees} inputs, {networks[0].outputs} outputs",
        )
    scored = moving(y)
    if not scored[len(y) // 2 :].any():
        expected = "an output that moves in the second half of the samples used"
        raise ParameterError("flight", expected, f"{len(y)} samples")
    if max(one.size for one in networks) > MOST_WEIGHTS:
        settings.setdefault("covariance", Alternatives(("node",)))
    std = np.nanstd(y, axis=0)  # of outputs that never move: the middle of the others
    std[~(std > 1e-9 * std.max())] = np.median(std[scored.any(axis=0)])
    space = search_space(kind, list(by_hidden), std.tolist(), settings)
    return _Problem(by_hidden, space, seed, every, log, y, scored, name)


def _try(
    network: Network,
    kind: str,
    seed: int,
    values: dict[str, Any],
    log: LogSamples,
    y: Array,
    scored: NDArray[np.bool_],
) -> PredictionScore:
    """Score of one trial, in a worker."""
    return score_predictions(make_learner(kind, network, values, seed), log, y, scored)


def _used(
    flight: xr.Dataset | LogTable, network: Network, every: int, source: str
) -> tuple[LogSamples, Array, str]:
    """Samples used, with those between them where the network has a memory; y; their name."""
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


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:12]


def _short(number: Any) -> Any:
    return float(f"{number:.6g}") if isinstance(number, float) else number
