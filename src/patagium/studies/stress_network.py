"""The dense network that is put under stress, scaled by what is known before a flight.

Neglected: what a flight would tell of the scales.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from patagium.identification.dense import DenseNetwork
from patagium.studies.reproduction_subjects import SUBJECTS, make_network


def dense_network(hidden: Sequence[int]) -> DenseNetwork:
    """State of the corrected robot in, generalized forces of the air out.

    Args:
        hidden: Neurons of its hidden layers.
    """
    scales = cast(DenseNetwork, make_network(SUBJECTS["corrected"], "inputs"))
    return DenseNetwork(
        scales.inputs,
        hidden,
        scales.output_names,
        input_center=scales.input_center,
        input_scale=scales.input_scale,
        output_scale=scales.output_scale,
    )
