"""Trials of a search: drawn by Optuna in batches, and kept in its journal as they end.

A trial depends on the seed, its number and the batches before its own: not on the processes that
share the work, nor on where an earlier search was stopped. Neglected: two searches that write
to one journal at the same time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from patagium.errors import LogError, ParameterError
from patagium.learning.tuning.likelihood import PredictionScore
from patagium.whole_file import write_whole

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution

LEAST_TRIALS = 8
BATCH = 8
"""Trials that are drawn at a time."""
STARTUP = 24
"""Trials that are drawn at random before the scores guide the draws."""
_NUMBER, _SCORE = "number", "prediction score"


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

    The file is a journal of Optuna, which its tools can read.

    Args:
        question: What all trials have in common, JSON-able.
        path: File; None: the scores are kept in memory only.

    Attributes:
        scores: Scores of the trials by their numbers.

    Raises:
        LogError: If the file is no journal, or of another question.
    """

    def __init__(self, question: Mapping[str, Any], path: str | Path | None = None) -> None:
        optuna = _optuna()
        try:
            storage = None if path is None else _storage(Path(path))
            if storage is not None and optuna.get_all_study_names(storage):
                self._study = optuna.load_study(study_name=None, storage=storage)
            else:
                self._study = optuna.create_study(storage=storage, direction="maximize")
        except (AttributeError, KeyError, TypeError, ValueError) as problem:
            raise LogError(f"{path}: expected a journal of Optuna, found: {problem}") from problem
        before = self._study.user_attrs
        question = {**question, "optuna": optuna.__version__}
        if before:
            _check_question(path, before, question)
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

        Args:
            trial: The trial.
            distributions: Distributions of its parameters, by name.
            score: Its score.
        """
        self.scores[trial.number] = score
        self._study.add_trial(
            _optuna().create_trial(
                params=trial.parameters,
                distributions=dict(distributions),
                user_attrs={_NUMBER: trial.number, _SCORE: score.describe()},
                value=score.score,
            )
        )


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

    Raises:
        ParameterError: If the trials are too few.

    References:
        Bergstra et al. (2011), Algorithms for hyper-parameter optimization, NIPS 24; Akiba et
        al. (2019), Optuna: a next-generation hyperparameter optimization framework, KDD.
    """
    if trials < LEAST_TRIALS:
        raise ParameterError("trials", f"at least {LEAST_TRIALS}", trials)
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
    """The library Optuna, which speaks of warnings only.

    Raises:
        ParameterError: If it is not installed.
    """
    try:
        optuna = import_module("optuna")
    except ImportError:
        install = "Optuna to be installed: pip install 'patagium[tune]'"
        raise ParameterError("tune", install, "none") from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna


def _storage(path: Path) -> Any:
    """Journal of Optuna in a file; a last line that a crash cut short is dropped."""
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

    if path.exists():
        whole = path.read_bytes()
        end = whole.rfind(b"\n") + 1
        if end < len(whole):
            write_whole(path, whole[:end])
    lock = JournalFileOpenLock(str(path), grace_period=3)  # s, after a crash
    return JournalStorage(JournalFileBackend(str(path), lock_obj=lock))


def _check_question(
    path: str | Path | None, found: Mapping[str, Any], asked: Mapping[str, Any]
) -> None:
    """Refuse the journal of another question.

    Raises:
        LogError: If something differs.
    """
    for name in sorted({*asked, *found}):
        if found.get(name) != asked.get(name):
            raise LogError(
                f"{path}: expected the trials of this question, found those of another: {name} "
                f"was {found.get(name)!r}, is {asked.get(name)!r}; name another result (--out) "
                "to ask anew, or delete the journal"
            )
