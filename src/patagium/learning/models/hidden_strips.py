"""Forces on strips as a strip network with memory knows them.

Neglected: robots of which no body, or several, float.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from patagium.learning.models.hidden import HiddenStripNetwork

Array = NDArray[np.float64]


def strip_forces(network: HiddenStripNetwork, x: Array, weights: Array) -> Array | None:
    """What each strip adds to the force along x, y, z, (N, m, 3) [N]; None if none floats.

    Args:
        network: The network.
        x: Inputs, (N, n_x).
        weights: (n,).
    """
    floating = [body.floating_dofs for body in network.robot.bodies if body.floating_dofs]
    if len(floating) != 1:
        return None
    readout, sections = network.sections(x, weights)
    shape = len(x), len(network.robot.strips), -1
    along = readout[:, list(floating[0][:3])].reshape(shape[0], 3, *shape[1:])
    return np.asarray(np.einsum("nksc,nsc->nsk", along, sections.reshape(shape)))
