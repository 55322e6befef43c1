"""Settings of a learner chosen by what they predict of kinematics that were not learned.

Each trial teaches a new learner the used samples of one or several flights, less those that are
left out (`left_out`), and predicts the latter with weights that stay; its score is that of these
predictions (`prediction_score`). Optuna draws the trials over the ranges of the settings' record
(`search`). Neglected: the luck of the initial weights, which are those of one seed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import xarray as xr

from patagium.arguments import Progress, checked
from patagium.arrays import brief, find_gaps
from patagium.errors import LogError, ParameterError, ShapeError, check_names
from patagium.learning.learners.registry import LEARNERS, make_learner
from patagium.learning.models.memory import measured_inputs
from patagium.learning.models.network import Network
from patagium.learning.models.registry import network_options
from patagium.learning.samples import samples
from patagium.learning.settings import Alternatives
from patagium.learning.stream import Samples, used_samples
from patagium.learning.tuning.left_out import Kinematics, LeftOut, kinematics_of, left_out
from patagium.learning.tuning.prediction_score import Flown, PredictionScore, judged_trial, moving
from patagium.learning.tuning.search import (
    DrawnTrial,
    SearchSpace,
    TrialJournal,
    pool,
    search,
    search_space,
)
from patagium.learning.tuning.settings_file import LearnerSettings, NetworkSettings, Settings
from patagium.learning.wingbeats import duration
from patagium.limits import LEAST_TRIALS
from patagium.sensing.logs.table import LogTable
from patagium.simulation import air_of
from patagium.version import __version__
from patagium.whole_file import locked

MOST_WEIGHTS = 400
"""Larger networks are tried with covariance blocks of one neuron only, unless others are given."""
SHOWN = 10
"""Number of trials that the file of settings lists."""
_SHOWN_SCORES = (
    *("crps", "left_out_crps", "left_out_nmse", "left_out_coverage"),
    *("nmse_second_half", "coverage_second_half"),
)
_PAUSE = 1.0  # s, between flights that are learned one after the other
Flight = xr.Dataset | LogTable
_Exam: TypeAlias = tuple[Network, Flown, LeftOut]


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
    """Settings that predict best what was left out.

    Attributes:
        best: Best settings, as a file holds them.
        trials: All trials, the chosen one first, the others by their score.
        network: Network of the best settings, of those given.
        rule: What was left out and how it was chosen, in words.
    """

    best: Settings
    trials: tuple[Trial, ...]
    network: Network
    rule: str
    __repr__ = brief

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


@checked
def tune(
    flight: Flight | Sequence[Flight],
    network: Network | Sequence[Network],
    *,
    every: int = 100,
    trials: int = 64,
    learner: str = "extended",
    covariance: Sequence[Any] | None = None,
    settings: Mapping[str, Any] | None = None,
    seed: int = 0,
    hold_out: Sequence[Flight] | Mapping[str, Flight] = (),
    horizon: float | str | None = None,
    jobs: int | None = None,
    journal: str | Path | None = None,
    source: str = "",
    progress: Progress | None = None,
) -> Tuned:
    """Settings of a learner that predict kinematics best that it has not learned.

    What is left out, and so decides, are other flights (`hold_out`), else wingbeats of other
    kinematics within the flights, else their second half; see `left_out`. A trial that diverges
    there, or errs more than zero or the weights before any sample, is refused. The result depends
    on the seed, not on the number of processes.

    Args:
        flight: Record with q, v, a, u1, or a table; or several, learned one after the other.
        network: Network that learns; several that differ in their hidden layers are alternatives,
            of one kind or of several. Each is judged by the force that it learns.
        every: 100 to use one sample in 100. The settings found are for that rate.
        trials: Number of settings to try, at least 8.
        learner: "cubature" or "extended".
        covariance: Structures to try, as files hold them: "full", "layer" or "node";
            None: all of them, or "node" where a network has more than 400 weights.
        settings: Settings that are not searched over their ranges, by name: a plain value as
            files hold it, or `Alternatives`.
        seed: Seed of the search and of the initial weights.
        hold_out: Flights that no trial learns and all are judged on, or these by their names.
        horizon: Time for which weights stay when they are judged, such as "100ms" or seconds,
            where nothing else can be left out; None: over the second half of the flight.
        jobs: Number of processes; None: one for each core.
        journal: File that keeps each trial as it ends; a search that was stopped goes on from it.
        source: Name of the flights in the file of settings.
        progress: Function called with the number of trials done and of all trials.

    Raises:
        ParameterError: If a number is out of its range, or no output moves.
        ShapeError: If the network does not fit the flight.
        LogError: If the journal is of another question, or every trial was refused.
        OutputError: If the journal cannot be written, or another process writes it.
    """
    if trials < LEAST_TRIALS:
        raise ParameterError("trials", f"at least {LEAST_TRIALS}", trials)
    networks = _several("network", network)
    for one in networks:
        network_options(str(one.describe()["kind"]))  # one that no file can name is refused
    flights = _several("flight", flight)
    chosen = dict(settings or {})
    if covariance is not None:
        chosen["covariance"] = Alternatives(tuple(covariance))
    ahead = None if horizon is None else duration("horizon", horizon)
    others = hold_out.items() if isinstance(hold_out, Mapping) else [("", one) for one in hold_out]
    every_flight = [*flights, *(one for _, one in others)]
    airs = [air_of(one) for one in every_flight if isinstance(one, xr.Dataset)]
    for k, air in enumerate(airs):  # a network knows one
        if (air.wind, air.density) != (airs[0].wind, airs[0].density):
            known, found = (f"{one.wind} m/s at {one.density:.4g} kg/m^3" for one in (airs[0], air))
            raise LogError(f"flight {k + 1}", f"wind as in the first, {known}", found)
    exams = [_exam(flights, one, every, others, ahead, source) for one in networks]
    problem = _problem(exams, learner, chosen, seed, every)
    with nullcontext() if journal is None else locked(journal):
        workers, book = partial(pool, jobs), TrialJournal(problem.question(), journal)
        return problem.tuned(_scored_trials(problem, trials, workers, book, progress))


def _several(name: str, given: Any) -> tuple[Any, ...]:
    """One or several, as a tuple."""
    found = tuple(given) if isinstance(given, Sequence | np.ndarray) else (given,)
    if not found:
        raise ParameterError(name, "at least one", 0)
    return found


def _scored_trials(
    problem: _Problem,
    trials: int,
    workers: Callable[[], Any],
    book: TrialJournal,
    progress: Progress | None,
) -> list[tuple[DrawnTrial, PredictionScore]]:
    """Trials of a search and their scores; those that the journal has are not scored again."""
    from joblib import delayed

    distributions = problem.space.distributions()
    with ExitStack() as stack:
        opened: list[Any] = []

        def judge(batch: Sequence[DrawnTrial]) -> list[float]:
            left = [trial for trial in batch if trial.number not in book.scores]
            if left and not opened:
                opened.append(stack.enter_context(workers()))
            calls = (delayed(judged_trial)(*problem.call(trial)) for trial in left)
            for trial, score in zip(left, opened[0](calls) if left else (), strict=True):
                book.keep(trial, distributions, score)
                if progress is not None:
                    progress(trial.number, trials)
            return [book.scores[trial.number].score for trial in batch]

        found = search(distributions, trials, problem.seed, judge)
    if progress is not None:
        progress(trials, trials)
    return [(trial, book.scores[trial.number]) for trial in found]


@dataclass(frozen=True)
class _Problem:
    """Problem that all trials share.

    Attributes:
        space: Settings to try.
        seed: Seed of the search and of the initial weights.
        every: One sample in so many is used.
        exams: Networks by their hidden layers, each with the flights that it learns, as one, and
            the samples that are left out.
    """

    space: SearchSpace
    seed: int
    every: int
    exams: dict[tuple[int, ...], _Exam]

    def question(self) -> dict[str, Any]:
        """Question that the trials of a journal answer, as JSON values."""
        exams = list(self.exams.values())
        described = [network.describe() for network, _, _ in exams]
        _, flown, left_out = exams[0]
        kinds = ", ".join(dict.fromkeys(one["kind"] for one in described))
        space = json.dumps([str(sorted(self.space.searched.items())), self.space.fixed])
        judged = [
            part.tobytes()
            for _, _, judged_by in exams
            for fold in judged_by.folds
            for part in (fold.learned, fold.judged, fold.flown.samples.x, fold.flown.y)
        ]
        return {
            "patagium": __version__,
            "flight": flown.name,
            "samples": f"{len(flown.used)} of digest "
            + _digest(b"".join(k.samples.x.tobytes() + k.y.tobytes() for _, k, _ in exams)),
            "every": self.every,
            "left out": f"{left_out.rule} of digest {_digest(b''.join(judged))}",
            "network": f"{kinds} of digest {_digest(json.dumps(described).encode())}",
            "learner": self.space.kind,
            "settings": f"a space of digest {_digest(space.encode())}",
            "seed": self.seed,
        }

    def call(self, trial: DrawnTrial) -> tuple[Any, ...]:
        """Arguments of `judged_trial`, in a worker."""
        hidden, values = self.space.values(trial.parameters)
        network, flown, judged_by = self.exams[hidden]
        make = partial(make_learner, self.space.kind, network, values, self.seed)
        return make, flown, judged_by.folds

    def tuned(self, scored: Sequence[tuple[DrawnTrial, PredictionScore]]) -> Tuned:
        """Best of the trials, and all of them.

        Raises:
            LogError: If all were refused.

        References:
            Breiman et al. (1984), Classification and regression trees: the rule of one standard
            error.
        """
        found = [Trial(*self.space.values(one.parameters), score) for one, score in scored]
        tried = sorted(found, key=lambda trial: -trial.prediction.score)
        best = tried[0]
        _, flown, rule = self.exams[best.hidden]
        if not np.isfinite(best.prediction.score):
            raise LogError(
                flown.name,
                f"a trial that predicts what was left out ({rule.text})",
                f"that all {len(tried)} were refused; the first one: {best.prediction.reason}",
            )
        if rule.rule == "second half":
            one = best.prediction
            most = one.crps + (one.left_out_error if np.isfinite(one.left_out_error) else 0.0)
            as_good = (trial for trial in tried if trial.prediction.crps <= most)
            best = min(as_good, key=lambda trial: trial.prediction.moved)
            tried = [best, *(trial for trial in tried if trial is not best)]
        network, flown, _ = self.exams[best.hidden]
        outputs = np.array(network.output_names)
        scores = {name: _short(one) for name, one in best.prediction.describe().items()}
        settings = Settings(
            flight=flown.name,
            every=self.every,
            network=NetworkSettings.of(network),
            learner=LearnerSettings(kind=self.space.kind, seed=self.seed, **best.values),
            prediction={**scores, "outputs": outputs[flown.scored.any(axis=0)].tolist()},
            search={
                "rule": rule.text,
                "trials": len(tried),
                "refused": sum(not np.isfinite(trial.prediction.score) for trial in tried),
                "patagium": __version__,
            },
            trials=[trial.describe() for trial in tried[:SHOWN]],
        )
        return Tuned(settings, tuple(tried), network, rule.text)


def _problem(
    exams: list[_Exam],
    kind: str,
    settings: dict[str, Any],
    seed: int,
    every: int,
) -> _Problem:
    """Networks, their exams and the search space."""
    by_hidden, networks = {one[0].hidden: one for one in exams}, [one[0] for one in exams]
    if len(by_hidden) != len(exams):
        raise ParameterError("network", "networks with different hidden layers", list(by_hidden))
    check_names("learner", [kind], LEARNERS)
    if max(one.size for one in networks) > MOST_WEIGHTS:
        settings.setdefault("covariance", Alternatives(("node",)))
    if any(hasattr(one, "own_misfit") for one in networks):  # which excludes the noise's search
        settings = {"measurement_std": None, "noise_estimation": None} | settings
    y, scored = exams[0][1].y, exams[0][1].scored
    std, measured = np.zeros(y.shape[1]), np.isfinite(y).any(axis=0)
    std[measured] = np.nanstd(y[:, measured], axis=0)
    std[~(std > 1e-9 * std.max())] = np.median(std[scored.any(axis=0)])  # of those that move
    space = search_space(kind, list(by_hidden), std.tolist(), settings)
    return _Problem(space, seed, every, by_hidden)


def _exam(
    flights: Sequence[Flight],
    network: Network,
    every: int,
    others: Iterable[tuple[str, Flight]],
    ahead: float | None,
    source: str,
) -> _Exam:
    """A network, the samples of flights that it learns, and those that are left out."""
    held_out = [_used(one, network, every, name)[0] for name, one in others]
    parts = [_used(one, network, every, "") for one in flights]
    flown = _joined([one for one, _ in parts], source)
    half = len(flown.used) // 2
    for one, late in ((flown, flown.scored[half:]), *((one, one.scored) for one in held_out)):
        if not late.any():
            expected = "an output that moves in the second half of the samples used"
            raise ParameterError("flight", expected, f"{len(one.used)} samples of {one.name}")
    return network, flown, left_out(flown, [one for _, one in parts], held_out, ahead)


def _used(flight: Flight, network: Network, every: int, source: str) -> tuple[Flown, Kinematics]:
    """Samples used of a flight, with those between them where the network has a memory."""
    if isinstance(flight, LogTable):
        time, x, y, gaps, name = flight.time, flight.x, flight.y, flight.gaps, flight.source
    else:
        time, x, y, _ = samples(flight, network)
        gaps = find_gaps(time)
        if len(time) < flight.sizes["time"]:  # a motion without the stretches that are not known
            flight = flight.sel(time=time)
        name = f"a flight of {flight.attrs.get('robot_name', 'a robot')}"
    seen, sees = x.shape[1], measured_inputs(network)
    if y.shape[1] != network.outputs or seen != sees:
        raise ShapeError(
            "network",
            f"{seen} inputs, {y.shape[1]} outputs",
            f"{sees} inputs, {network.outputs} outputs",
        )
    gaps = np.asarray(gaps, np.int64)
    chosen = used_samples(y, every, gaps)
    log, used = Samples(time, x, y, gaps), chosen
    if sees == network.inputs:
        log, used = Samples(time[chosen], x[chosen], y[chosen], gaps[:0]), np.arange(len(chosen))
    alive = moving(y[chosen], getattr(network, "output_scale", 1.0))
    flown = Flown(log, used, alive, source or name)
    return flown, kinematics_of(flight, time, gaps, chosen)


def _joined(flights: Sequence[Flown], name: str) -> Flown:
    """Flights one after the other as one; memory begins anew with each."""
    if len(flights) == 1:
        return replace(flights[0], name=name or flights[0].name)
    begin, count, parts = 0.0, 0, []
    for one in flights:
        log = one.samples
        first = log.gaps if not count else np.concatenate([[0], log.gaps])
        time = begin + log.time - log.time[0]
        parts.append((time, log.x, log.y, first + count, one.used + count, one.scored))
        begin, count = begin + float(log.time[-1] - log.time[0]) + _PAUSE, count + len(time)
    time, x, y, gaps, used, scored = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Flown(
        Samples(time, x, y, gaps), used, scored, name or ", ".join(k.name for k in flights)
    )


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:12]


def _short(number: Any) -> Any:
    return float(f"{number:.6g}") if isinstance(number, float) else number
