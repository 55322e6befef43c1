"""Settings of a learner as a YAML file: network, learner, rate of samples, and the evidence.

`tune` writes the file, and a person may read and change it. What it says of the search is
evidence, and not used again. Neglected: the scales of a dense network, which are taken anew
from the flight or table that is learned.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import yaml
from pydantic import BaseModel, ConfigDict, Field, StrictInt, ValidationError, model_validator

from patagium.arguments import checked
from patagium.errors import check_names
from patagium.learning.learners.registry import make_learner
from patagium.learning.models.network import Network
from patagium.learning.models.registry import network_options
from patagium.learning.models.wing import WingNetwork
from patagium.learning.settings import settings_from, settings_of
from patagium.limits import YAML_TEXT
from patagium.reading import parsed_yaml, refused, text_of
from patagium.whole_file import write_whole

Count: TypeAlias = Annotated[StrictInt, Field(gt=0)]
_HEAD = """\
# Settings of a learner, found by `patagium tune`; taken by
#   patagium identify FILE --settings THIS_FILE
# where command-line options override it.
"""
_HIDDEN = "the neurons of each hidden layer, [] for linear_strip,"


class NetworkSettings(BaseModel):
    """Network that the settings are for.

    Attributes:
        kind: "linear_strip", "strip" or "dense"; or that of another network, for Python alone.
        hidden: Neurons of each hidden layer.
        activation: "softplus" or "tanh" of the hidden layers; None: that of the network.
        options: Other arguments of a network of wings by name, as its description holds them.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Annotated[str, Field(examples=["linear_strip"])]
    hidden: Annotated[tuple[Count, ...], Field(description=_HIDDEN, examples=["[]"])]
    activation: Literal["softplus", "tanh"] | None = None
    options: dict[str, Any] = Field(default_factory=dict)

    @classmethod
    def of(cls, network: Network) -> NetworkSettings:
        """Settings of a network; outputs that are all coordinates of its robot are not named."""
        own, said = {}, network.describe()
        if isinstance(network, WingNetwork):
            names = [*network.robot.dof_names]
            own = {name: said[name] for name in network.options if said[name] != names}
        activation = said.get("activation")
        return cls(kind=said["kind"], hidden=network.hidden, activation=activation, options=own)

    @model_validator(mode="after")
    def _known(self) -> NetworkSettings:
        known = network_options(self.kind)
        for name in self.options:
            check_names(name, [name], known, near=True)
        return self


class LearnerSettings(BaseModel):
    """Learner: its kind, the seed of its weights, and its settings by their names in the record.

    Attributes:
        kind: "cubature" or "extended".
        seed: Seed of the initial weights.
    """

    model_config = ConfigDict(extra="allow", frozen=True)

    kind: Literal["cubature", "extended"] = "extended"
    seed: StrictInt = 0

    @model_validator(mode="after")
    def _known(self) -> LearnerSettings:
        known = [one.name for one in settings_of(self.kind)]
        for name in self.values:
            check_names(name, [name], known, near=True)
        settings_from(self.kind, self.values)
        return self

    @property
    def values(self) -> dict[str, Any]:
        """Settings by name, plain as the file holds them."""
        return dict(self.model_extra or {})


class Settings(BaseModel):
    """Network and learner, and how they were found.

    Attributes:
        format: Format of the file.
        flight: Flight that they were found on, in words.
        every: One sample in so many was used.
        network: Network.
        learner: Learner.
        prediction: Score of this learner over the flight; evidence only.
        search: How it was searched for; evidence only.
        trials: The best trials; evidence only.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    format: Literal["patagium settings 1"] = "patagium settings 1"
    flight: str = ""
    every: Annotated[Count, Field(examples=[10])]
    network: Annotated[NetworkSettings, Field(examples=["{kind: linear_strip, hidden: []}"])]
    learner: Annotated[LearnerSettings, Field(examples=["{kind: extended, prior_std: 0.3}"])]
    prediction: Annotated[dict[str, Any], Field(default_factory=dict)]
    search: Annotated[dict[str, Any], Field(default_factory=dict)]
    trials: Annotated[list[dict[str, Any]], Field(default_factory=list)]

    def made(self, network: Network) -> Any:
        """New learner with these settings.

        Args:
            network: Network whose weights it learns.
        """
        learner = self.learner
        return make_learner(learner.kind, network, learner.values, learner.seed)

    def save(self, path: str | Path) -> Path:
        """Write the file, whole or not at all.

        Args:
            path: File, replaced if it exists.
        """
        words = self.model_dump(mode="json")
        text = yaml.dump(words, sort_keys=False, default_flow_style=None, width=96)
        return write_whole(path, _HEAD + text)


@checked
def load_settings(path: str | Path) -> Settings:
    """Settings from a file.

    Args:
        path: YAML file.

    Raises:
        LogError: If it cannot be read, or a value is missing or wrong: where in the file, what
            was expected, what was found.
    """
    file = Path(path)
    text = text_of(file, YAML_TEXT)
    words = parsed_yaml(text, str(file))
    try:
        return Settings.model_validate(words)
    except ValidationError as problem:
        raise refused(str(file), problem.errors(), Settings, text) from None
