"""Search over the settings: space, trials drawn by Optuna and kept in its journal, processes.

The space is taken from the settings' record, as Optuna's distributions; numbers have three digits:
more would be noise. A trial depends on the seed, its number and the batches before its own: not on
the processes that share the work, nor on where an earlier search was stopped. Neglected: ranges
that depend on each other.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from patagium.errors import LogError, OutputError, ParameterError
from patagium.learning.settings import Alternatives, LogRange, settings_from, settings_of
from patagium.learning.tuning.prediction_score import PredictionScore
from patagium.reading import regular_file
from patagium.whole_file import write_whole

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution

HIDDEN = "hidden"
"""Name of the hidden layers among the parameters of a trial."""
_ON = " on"  # after the name of a setting: whether it is switched on
BATCH = 8
"""Trials that are drawn at a time."""
STARTUP = 24
"""Trials that are drawn at random before the scores guide the draws."""
_NUMBER, _SCORE = "number", "prediction score"


@dataclass(frozen=True)
class SearchSpace:
    """Settings that a search tries, and those that stay.

    Attributes:
        kind: Kind of the learner.
        searched: Range or alternatives by name of the setting; `HIDDEN` is the network's.
        fixed: Plain values of settings that are not searched, by name.
        output_std: Standard deviation of each output, (n_y,) [unit of y].
    """

    kind: str
    searched: Mapping[str, LogRange | Alternatives]
    fixed: Mapping[str, Any]
    output_std: Sequence[float]

    def distributions(self) -> dict[str, BaseDistribution]:
        """Distributions of the parameters of a trial, by name."""
        from optuna.distributions import CategoricalDistribution, FloatDistribution

        found: dict[str, BaseDistribution] = {}
        for name, space in self.searched.items():
            if isinstance(space, Alternatives):
                found[name] = CategoricalDistribution([json.dumps(v) for v in space.values])
                continue
            found[name] = FloatDistribution(space.low, space.high, log=True)
            if space.off is not None:
                found[name + _ON] = CategoricalDistribution([False, True])
        return found

    def values(self, parameters: Mapping[str, Any]) -> tuple[tuple[int, ...], dict[str, Any]]:
        """Hidden layers and plain values of the settings of a trial.

        Args:
            parameters: Parameters of a trial, by the names of `distributions`.
        """
        found: dict[str, Any] = dict(self.fixed)
        for name, space in self.searched.items():
            drawn = parameters[name]
            if isinstance(space, Alternatives):
                found[name] = json.loads(drawn)
            elif not parameters.get(name + _ON, True):
                found[name] = space.off
            elif space.per_output:
                numbers = [_rounded(drawn * one) for one in self.output_std]
                found[name] = numbers[0] if len(numbers) == 1 else numbers
            else:
                found[name] = 1.0 - _rounded(drawn) if space.one_minus else _rounded(drawn)
        return tuple(found.pop(HIDDEN)), found


def search_space(
    kind: str,
    hidden: Sequence[tuple[int, ...]],
    output_std: Sequence[float],
    settings: Mapping[str, Any],
) -> SearchSpace:
    """Search space of a learner.

    Args:
        kind: Kind of the learner.
        hidden: Hidden layers to try.
        output_std: Standard deviation of each output, (n_y,) [unit of y].
        settings: Settings that are not searched over the range of the record, by name: a plain
            value, or `Alternatives`.

    Raises:
        ParameterError: If the learner has no such setting, or a value is out of its range.
    """
    for name, value in settings.items():
        for one in value.values if isinstance(value, Alternatives) else (value,):
            settings_from(kind, {name: one})
    ranges = {one.name: one.metadata["meaning"].search for one in settings_of(kind)}
    searched = {k: one for k, one in ranges.items() if one is not None and k not in settings}
    searched |= {k: one for k, one in settings.items() if isinstance(one, Alternatives)}
    if not searched:
        raise ParameterError("settings", "at least one setting that is searched", dict(settings))
    fixed = {k: one for k, one in settings.items() if k not in searched}
    searched[HIDDEN] = Alternatives(tuple(hidden))
    return SearchSpace(kind, searched, fixed, output_std)


def _rounded(number: float) -> float:
    return float(f"{number:.3g}")


@contextmanager
def pool(jobs: int | None) -> Iterator[Any]:
    """Workers of joblib, processes of one thread each, which give results in order.

    Args:
        jobs: Number of processes; None: one for each core.

    Raises:
        ParameterError: If the jobs are below one.
    """
    from joblib import Parallel, cpu_count, parallel_config

    if jobs is not None and jobs < 1:
        raise ParameterError("jobs", "a whole number of at least 1", jobs)
    with parallel_config("loky", n_jobs=jobs or cpu_count(), inner_max_num_threads=1):
        yield Parallel(return_as="generator", batch_size=1)


class DrawnTrial(NamedTuple):
    """Trial that is to be scored.

    Attributes:
        number: Number of the trial, from 0.
        parameters: Parameters by name.
    """

    number: int
    parameters: dict[str, Any]


class TrialJournal:
    """Scores of the trials of one question, in memory or in a file.

    The file is a journal of Optuna, which its tools can read; one process at a time writes to it,
    see `whole_file.locked`.

    Args:
        question: What all trials have in common, JSON-able.
        path: File; None: the scores are kept in memory only.

    Attributes:
        scores: Scores of the trials by their numbers.

    Raises:
        LogError: If the file is no journal, or of another question.
        OutputError: If it cannot be written.
    """

    def __init__(self, question: Mapping[str, Any], path: str | Path | None = None) -> None:
        self._path = path
        with self._writing():
            optuna = _optuna()
            try:
                storage = None if path is None else _storage(Path(path))
                if storage is not None and optuna.get_all_study_names(storage):
                    self._study = optuna.load_study(study_name=None, storage=storage)
                else:
                    self._study = optuna.create_study(storage=storage, direction="maximize")
            except (AttributeError, KeyError, TypeError, ValueError) as problem:
                found = f"expected a journal of Optuna, found: {problem}"
                raise LogError(f"{path}: {found}") from problem
            before = self._study.user_attrs
            question = {**question, "optuna": optuna.__version__}
            for name in sorted({*question, *before}) if before else ():
                if before.get(name) != question.get(name):
                    raise LogError(
                        f"{path}: expected the trials of this question, found those of another: "
                        f"{name} was {before.get(name)!r}, is {question.get(name)!r}; name another "
                        "result (--out) to ask anew, or delete the journal"
                    )
            for name in (name for name in question if name not in before):
                self._study.set_user_attr(name, question[name])
            self.scores: dict[int, PredictionScore] = {}
            for trial in self._study.get_trials(deepcopy=False):
                kept = trial.user_attrs
                self.scores[kept[_NUMBER]] = PredictionScore.from_description(kept[_SCORE])

    def keep(
        self,
        trial: DrawnTrial,
        distributions: Mapping[str, BaseDistribution],
        score: PredictionScore,
    ) -> None:
        """Keep the score of a trial, on disk before this returns.

        Raises:
            OutputError: If the disk does not take it; the trials before are kept.
        """
        self.scores[trial.number] = score
        made = _optuna().create_trial(
            params=trial.parameters,
            distributions=dict(distributions),
            user_attrs={_NUMBER: trial.number, _SCORE: score.describe()},
            value=score.score,
        )
        with self._writing():
            self._study.add_trial(made)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as problem:
            if self._path is None or isinstance(problem, OutputError):
                raise
            raise OutputError(self._path, problem) from problem


def search(
    distributions: Mapping[str, BaseDistribution],
    trials: int,
    seed: int,
    judge: Callable[[Sequence[DrawnTrial]], Sequence[float]],
) -> list[DrawnTrial]:
    """Trials of a search by the tree-structured Parzen estimator, in the order they are drawn.

    Args:
        distributions: Distributions of the parameters, by name.
        trials: Number of trials.
        seed: Seed of the draws.
        judge: Scores of several trials, larger is better, in their order.

    References:
        Bergstra et al. (2011), Algorithms for hyper-parameter optimization, NIPS 24; Akiba et
        al. (2019), Optuna: a next-generation hyperparameter optimization framework, KDD.
    """
    optuna = _optuna()
    study = optuna.create_study(direction="maximize")
    drawn: list[DrawnTrial] = []
    for begin in range(0, trials, BATCH):
        study.sampler = optuna.samplers.TPESampler(
            seed=seed * 10_000 + begin,
            n_startup_trials=STARTUP,
            multivariate=True,
            constant_liar=True,
        )
        asked = [study.ask(dict(distributions)) for _ in range(min(BATCH, trials - begin))]
        batch = [DrawnTrial(one.number, one.params) for one in asked]
        for one, score in zip(asked, judge(batch), strict=True):
            study.tell(one, score)
        drawn += batch
    return drawn


def _optuna() -> Any:
    """The library Optuna, which speaks of warnings only."""
    try:
        optuna: Any = import_module("optuna")
    except ImportError:
        install = "Optuna to be installed: pip install 'patagium[tune]'"
        raise ParameterError("tune", install, "none") from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna


def _storage(path: Path) -> Any:
    """Journal of Optuna in a file; a last line that a crash cut short is dropped."""
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

    class Alone(JournalFileOpenLock):  # Optuna's lock stays behind on a disk that fails
        def acquire(self) -> bool:
            return True

        def release(self) -> None:
            pass

    if path.exists():
        whole = regular_file(path).read_bytes()
        end = whole.rfind(b"\n") + 1
        if end < len(whole):
            write_whole(path, whole[:end])
    return JournalStorage(JournalFileBackend(str(path), lock_obj=Alone(str(path))))
