"""Settings of a learner as a file: what was chosen, for which flight, on what evidence.

A YAML file that `tune` writes and a person may read and change. What it says of the search is
evidence, and not used again. Neglected: the scales of a dense network, which are taken anew
from the flight or table that is learned.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, PositiveInt, ValidationError, model_validator

from patagium.errors import LogError
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.models.network import Network
from patagium.learning.tuning.knobs import KNOBS, LearnerKind, keywords
from patagium.whole_file import write_whole

_HEAD = """\
# Settings of a learner, found by `patagium tune`; taken by
#   patagium identify FILE --settings THIS_FILE
# where options given beside it count more. The log likelihood is that of the innovations.
"""


class NetworkSettings(BaseModel):
    """The network the settings are for.

    Attributes:
        kind: "strip", "hidden_strip", "flow", "hidden_flow" or "dense".
        hidden: Neurons of each hidden layer.
        activation: What a neuron does to its sum.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["strip", "hidden_strip", "flow", "hidden_flow", "dense"]
    hidden: tuple[PositiveInt, ...]
    activation: Literal["softplus", "tanh"] = "softplus"


class LearnerSettings(BaseModel):
    """The learner: its kind, the seed of its weights, and the knobs of `knobs.KNOBS`.

    Attributes:
        kind: "cubature" or "extended".
        seed: Of the weights to start from.
    """

    model_config = ConfigDict(extra="allow", frozen=True)

    kind: LearnerKind = "cubature"
    seed: int = 0

    @model_validator(mode="after")
    def _known(self) -> LearnerSettings:
        known = {knob.name: knob for knob in KNOBS if self.kind in knob.learners}
        for name, value in self.values.items():
            if name not in known:
                raise ValueError(f"{name}: expected one of {', '.join(known)}")
            known[name].check(value)
        for name in ("prior_std", "measurement_std"):
            if name not in self.values:
                raise ValueError(f"{name}: expected, but not there")
        return self

    @property
    def values(self) -> dict[str, Any]:
        """The knobs by name, plain as the file holds them."""
        return dict(self.model_extra or {})


class Settings(BaseModel):
    """What a learner is made of, and how it was found.

    Attributes:
        format: Of the file.
        flight: What was learned to find it, in words.
        every: One sample in so many was used.
        network: The network.
        learner: The learner.
        foresight: Log likelihood and more of this learner over the flight; evidence only.
        search: How it was searched for; evidence only.
        trials: The best trials; evidence only.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["patagium settings 1"] = "patagium settings 1"
    flight: str = ""
    every: PositiveInt
    network: NetworkSettings
    learner: LearnerSettings
    foresight: Annotated[dict[str, Any], Field(default_factory=dict)]
    search: Annotated[dict[str, Any], Field(default_factory=dict)]
    trials: Annotated[list[dict[str, Any]], Field(default_factory=list)]

    def made(self, network: Network) -> FilterLearner:
        """A learner with these settings that has learned nothing yet.

        Args:
            network: The network whose weights it learns.
        """
        return make_learner(network, self.learner.kind, self.learner.seed, self.learner.values)

    def save(self, path: str | Path) -> Path:
        """Write the file, whole or not at all.

        Args:
            path: The file, replaced if it exists.
        """
        words = self.model_dump(mode="json")
        text = yaml.dump(words, sort_keys=False, default_flow_style=None, width=96)
        return write_whole(path, _HEAD + text)


def load_settings(path: str | Path) -> Settings:
    """Settings from a file.

    Args:
        path: A YAML file.

    Raises:
        LogError: If it cannot be read, or does not say what is needed: where in the file,
            what was expected, what was found.
    """
    file = Path(path)
    try:
        words = yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as problem:
        raise LogError(f"{file}: cannot be read: {problem.strerror}") from problem
    except (yaml.YAMLError, UnicodeDecodeError) as problem:
        raise LogError(f"{file}: expected YAML, found: {problem}") from problem
    try:
        return Settings.model_validate(words)
    except ValidationError as problem:
        raise LogError("\n".join(_line(str(file), error) for error in problem.errors())) from None


def make_learner(
    network: Network, kind: LearnerKind, seed: int, values: dict[str, Any]
) -> FilterLearner:
    """A learner from plain values.

    Args:
        network: Whose weights.
        kind: "cubature" or "extended".
        seed: Of the weights to start from.
        values: By name of the knob.
    """
    make = CubatureLearner if kind == "cubature" else ExtendedLearner
    return make(network, seed=seed, **keywords(values))


def _line(source: str, error: Any) -> str:
    where = ".".join(str(part) for part in error["loc"]) or "file"
    words = error["msg"].removeprefix("Value error, ")
    if error["type"] == "extra_forbidden":
        return f"{source}: {where}: unknown key"
    if error["type"] == "missing":
        return f"{source}: {where}: expected, but not there"
    if error["type"] == "value_error":
        return f"{source}: {where}: {words}"
    return f"{source}: {where}: {words}, found {error['input']!r}"
