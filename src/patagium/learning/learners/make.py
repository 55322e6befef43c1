"""New learners by their kind, above the learners: none of them imports this module."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from patagium.errors import ParameterError
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.gradient import GradientLearner
from patagium.learning.learners.linear import LinearLearner
from patagium.learning.settings import settings_from, settings_of

LEARNERS: dict[str, Any] = {
    "cubature": CubatureLearner,
    "extended": ExtendedLearner,
    "gradient": GradientLearner,
    "linear": LinearLearner,
}
"""Learners by kind; the settings of each are those of `patagium.learning.settings.RECORDS`."""


def make_learner(kind: str, network: Any, settings: Any, seed: int = 0) -> Any:
    """New learner of a network.

    Args:
        kind: Kind of the learner, a key of `LEARNERS`.
        network: Network whose weights it learns.
        settings: Record of its settings, or plain values by name as a file holds them.
        seed: Seed of the initial weights.

    Raises:
        ParameterError: If the kind is unknown, or a setting is missing, out of its range, or not
            of this learner.
    """
    if kind not in LEARNERS:
        raise ParameterError("learner", f"of kind {', '.join(LEARNERS)}", kind)
    record = settings_from(kind, settings) if isinstance(settings, Mapping) else settings
    known = {"prior_std"} if not np.isnan(network.own_prior).any() else set()
    values: dict[str, Any] = {}
    for one in settings_of(kind):
        value = getattr(record, one.name)
        if value is None and one.metadata["meaning"].needed and one.name not in known:
            raise ParameterError(one.name, f"a number for the {kind} learner", None)
        values[one.name] = value
    return LEARNERS[kind](network, seed=seed, **values)
