"""pytagi: a network whose weights are Gaussian and independent, inferred in closed form.

Layers and widths as our dense network, inputs and outputs scaled alike; ReLU, since it has no
softplus, and its own draw of weights to start from. Single precision, one thread. Neglected:
its batches; it forgets nothing.
"""

from __future__ import annotations

from importlib import import_module
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.arrays import Array
from patagium.errors import ParameterError
from patagium.learning.models.dense import DenseNetwork


class PytagiNetwork:
    """`pytagi.nn.Sequential` of linear layers, taught one sample at a time.

    Args:
        network: The dense network whose shape and scales it takes.
        gain: Scales the deviation of weights and biases before any sample.
        measurement_std: Standard deviation of the measurement, scalar or (n_y,) [as y].
        seed: Seed of the first weights.

    Raises:
        ParameterError: If the network is not dense.
    """

    def __init__(
        self, network: DenseNetwork, *, gain: float, measurement_std: ArrayLike, seed: int = 0
    ) -> None:
        if not isinstance(network, DenseNetwork):
            raise ParameterError("network", "a dense network", network)
        nn = import_module("pytagi.nn")

        self.network = network
        import_module("pytagi").manual_seed(seed)
        layers: list[object] = []
        for below, above in pairwise(network.perceptron.widths):
            layers += [nn.ReLU()] if layers else []
            layers.append(nn.Linear(below, above, gain_weight=gain, gain_bias=gain))
        self._net = nn.Sequential(*layers)
        self._net.set_threads(1)
        self._updater = nn.OutputUpdater(self._net.device)
        std = np.asarray(measurement_std, float) / network.output_scale
        self._noise = (std**2).astype(np.float32)

    def update(self, x: Array, y: Array) -> None:
        """Learn one sample, x (n_x,), y (n_y,)."""
        self._net(self._scaled(x))
        measured = (y - self.network.output_center) / self.network.output_scale
        self._updater.update(
            output_states=self._net.output_z_buffer,
            mu_obs=measured.astype(np.float32),
            var_obs=self._noise,
            delta_states=self._net.input_delta_z_buffer,
        )
        self._net.backward()
        self._net.step()

    def predict(self, x: Array) -> Array:
        """y of many x by the present weights, (N, n_y)."""
        # one by one: larger batches than those it was taught with corrupt its memory
        found = np.array([np.array(self._net(one)[0], float) for one in self._scaled(x)])
        return np.asarray(self.network.output_center + self.network.output_scale * found)

    def std(self, x: Array) -> Array:
        """Predicted standard deviation of a measurement at x, noise included, (n_y,)."""
        _, variance = self._net(self._scaled(x))
        total = np.asarray(variance, float) + self._noise
        return np.asarray(self.network.output_scale * np.sqrt(total))

    def _scaled(self, x: Array) -> NDArray[np.float32]:
        scaled = (x - self.network.input_center) / self.network.input_scale
        return np.asarray(scaled, np.float32)
