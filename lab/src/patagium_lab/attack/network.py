"""The dense network that is put under stress, and whether a learner's covariance survived.

It is scaled by what is known before a flight. Neglected: what a flight would tell of the scales.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np

from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.models.dense import DenseNetwork
from patagium_lab.reproduction.cases import FLIGHT_CASES, make_network


def dense_network(hidden: Sequence[int]) -> DenseNetwork:
    """State of the corrected robot in, generalized forces of the air out.

    Args:
        hidden: Neurons of its hidden layers.
    """
    scales = cast(DenseNetwork, make_network(FLIGHT_CASES["corrected"], "inputs"))
    return DenseNetwork(
        scales.inputs,
        hidden,
        scales.output_names,
        input_center=scales.input_center,
        input_scale=scales.input_scale,
        output_scale=scales.output_scale,
    )


def is_definite(learner: CubatureLearner) -> bool:
    """Whether the covariance of the weights has a Cholesky factor, each weight in its own scale.

    Args:
        learner: Any structure, few weights.
    """
    covariance = learner.covariance
    scale = np.sqrt(np.diagonal(covariance))
    try:
        np.linalg.cholesky(covariance / np.outer(scale, scale))
    except np.linalg.LinAlgError:
        return False
    return True
