"""Search space of the settings, taken from their record, as Optuna's distributions.

Numbers have three digits: more would be noise. Neglected: ranges that depend on each other.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from patagium.errors import ParameterError
from patagium.learning.settings import Alternatives, LogRange, settings_from, settings_of

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution

HIDDEN = "hidden"
"""Name of the hidden layers among the parameters of a trial."""
_ON = " on"  # after the name of a setting: whether it is switched on


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
    chosen: dict[str, LogRange | Alternatives] = {
        name: space for name, space in ranges.items() if space is not None and name not in settings
    }
    chosen |= {name: one for name, one in settings.items() if isinstance(one, Alternatives)}
    if not chosen:
        raise ParameterError("settings", "at least one setting that is searched", dict(settings))
    chosen[HIDDEN] = Alternatives(tuple(hidden))
    fixed = {name: one for name, one in settings.items() if not isinstance(one, Alternatives)}
    return SearchSpace(kind, chosen, fixed, output_std)


def _rounded(number: float) -> float:
    return float(f"{number:.3g}")
