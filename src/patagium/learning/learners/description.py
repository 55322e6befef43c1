"""Learners from what they say of themselves, and how two of them differ.

Neglected: what they have learned; see `learner_file`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from os.path import commonprefix
from typing import TYPE_CHECKING, Any

from patagium.errors import ParameterError
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.gradient import GradientLearner
from patagium.learning.learners.linear import LinearLearner
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.models.network import network_from_description
from patagium.learning.settings import ChangeDetection, NoiseEstimation, Screening, structure_from

if TYPE_CHECKING:
    from patagium.learning.learners.file import Resumable

_SCALES = ("input_center", "input_scale", "output_center", "output_scale")
_FILTERS: dict[str, Callable[..., Resumable]] = {
    "cubature": CubatureLearner,
    "extended": ExtendedLearner,
}
_KINDS = (*_FILTERS, "gradient", "linear")
_OPTIONS: dict[str, Callable[..., object]] = {
    "change_detection": ChangeDetection,
    "noise_estimation": NoiseEstimation,
    "screening": Screening,
}
_LONGEST = 60  # characters of a value in a message


def learner_from_description(description: Mapping[str, Any]) -> Resumable:
    """The learner of `describe()`, before any sample.

    Args:
        description: What a learner says of itself.

    Raises:
        KeyError: If the network is missing.
        ParameterError: If its kind is unknown or a number out of its range.
        TypeError: If a setting is missing or unknown.
    """
    values = {name: value for name, value in description.items() if name != "kind"}
    kind, network = description.get("kind"), values.pop("network")
    if kind == "linear":
        base = {k: v for k, v in network.items() if k not in ("features", "seed")}
        features = {k: network[k] for k in ("features", "seed")}
        return LinearLearner(DenseNetwork.from_description(base), **features, **values)
    if kind == "gradient":
        return GradientLearner(network_from_description(network), **values)
    make = _FILTERS.get(str(kind))
    if make is None:
        raise ParameterError("learner", f"of kind {', '.join(_KINDS)}", kind)
    for name, option in _OPTIONS.items():
        if values.get(name) is not None:
            values[name] = option(**values[name])
    values["covariance"] = structure_from(values["covariance"])
    return make(network_from_description(network), **values)


def first_difference(found: Mapping[str, Any], expected: Mapping[str, Any]) -> str | None:
    """In words, the first setting that differs; centers and scales may.

    Args:
        found: What a learner says of itself.
        expected: What another does.

    Returns:
        The setting, expected and found; None where there is no difference.
    """
    ours, theirs = _flat(json.loads(json.dumps(expected))), _flat(found)
    for name in (*ours, *theirs):
        if name.rpartition(".")[2] in _SCALES:
            continue
        if name not in ours or name not in theirs or ours[name] != theirs[name]:
            pair = [repr(values.get(name, "no such setting")) for values in (ours, theirs)]
            start = max(0, len(commonprefix(pair)) - _LONGEST // 3)
            said = (_short(text, start) for text in pair)
            return "{}: expected {}, found {}".format(name, *said)
    return None


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
    """What of a long text is near the place where it differs from another."""
    return text if len(text) <= _LONGEST else f"...{text[start : start + _LONGEST]}..."
