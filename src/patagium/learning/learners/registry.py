"""Registry of the learners: a learner from its description or its file.

This module stands above the learners: none of them imports it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from os.path import commonprefix
from pathlib import Path
from typing import Any

from patagium.arguments import checked
from patagium.errors import LogError, check_names
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.learners.state_file import read_state
from patagium.learning.models.dense import SCALES
from patagium.learning.models.registry import in_air, network_from_description, steady_air
from patagium.learning.settings import FilterSettings, settings_from
from patagium.reading import made_again

LEARNERS: dict[str, type[FilterLearner]] = {
    learner.kind: learner for learner in (CubatureLearner, ExtendedLearner)
}
"""Learners by kind."""
_FROM_DATA = (*SCALES, "attached", "terms")
_LONGEST = 60  # characters of a value in a message


def make_learner(kind: str, network: Any, settings: Any, seed: int = 0) -> FilterLearner:
    """New learner of a network; its settings a record, or plain values as a file holds them.

    Raises:
        ParameterError: If the kind is unknown, or a setting is missing, out of its range, or not of
            this learner.
    """
    learner = _of_kind(kind)
    record = settings_from(kind, settings) if isinstance(settings, Mapping) else settings
    return learner(network, record, seed=seed)


@checked
def learner_from_description(description: Mapping[str, Any]) -> FilterLearner:
    """Learner of a description, before any sample.

    Args:
        description: Network and settings, as `describe()` gives them.

    Raises:
        ParameterError: If the network is missing, a kind or a setting is unknown, or a number
            out of its range.
    """
    values = {k: value for k, value in description.items() if k not in ("kind", "found")}
    learner = _of_kind(str(description.get("kind")))
    network, seed = values.pop("network", {}), values.pop("seed", 0)
    settings = FilterSettings.from_description(values)
    return learner(network_from_description(network), settings, seed=seed)


@checked
def load_learner(path: str | Path, like: Learner | None = None) -> FilterLearner:
    """Learner that `save` kept: it goes on as the one that was saved would have.

    Args:
        path: File.
        like: Learner that must be described alike, but for centers, scales and what else the
            first samples told of its network; steady wind and density become those of `like`.
            None: any.

    Raises:
        LogError: If there is no such file, it is damaged, of another version, or describes
            another learner.
    """
    description, state = read_state(path)
    air = None if like is None else steady_air(like.network)
    if air is not None:
        description |= {"network": in_air(description["network"], air)}
    with made_again(f"{path}: the learner"):
        learner = learner_from_description(description)
    difference = None if like is None else first_difference(learner.describe(), like.describe())
    if difference is not None:
        raise LogError(f"{path}: of another learner: {difference}")
    with made_again(f"{path}: the learner"):
        learner.resume(state)
        return learner


def first_difference(found: Mapping[str, Any], expected: Mapping[str, Any]) -> str | None:
    """First setting that differs, in words; what the data told may differ.

    Returns:
        The setting, expected and found; None where there is no difference.
    """
    ours, theirs = (_flat(json.loads(json.dumps(one))) for one in (expected, found))
    for name in (*ours, *theirs):
        if name.rpartition(".")[2] in _FROM_DATA or name.startswith("found."):
            continue
        if name not in ours or name not in theirs or ours[name] != theirs[name]:
            pair = [repr(values.get(name, "no such setting")) for values in (ours, theirs)]
            start = max(0, len(commonprefix(pair)) - _LONGEST // 3)
            said = (_short(text, start) for text in pair)
            return "{}: expected {}, found {}".format(name, *said)
    return None


def _of_kind(kind: str) -> type[FilterLearner]:
    """Class of the learners of a kind.

    Raises:
        ParameterError: If it is unknown.
    """
    check_names("learner", [kind], LEARNERS, "of kind")
    return LEARNERS[kind]


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings by dotted names."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = value
    return flat


def _short(text: str, start: int) -> str:
    """Part of a long text near the place where it differs from another."""
    return text if len(text) <= _LONGEST else f"...{text[start : start + _LONGEST]}..."
