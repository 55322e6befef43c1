"""Algorithm 1 of the paper in NumPy, line by line, each line one array expression.

Every sample draws 2 n points twice, forms the predicted covariance from the first, sends the
second through the network and factorizes the covariance twice: order n^3. Neglected:
everything the lines would allow to be left out, such as moments of points that are known
beforehand; `square_root="cholesky"` of the learner leaves it out.

References:
    Ghanem, Bicer, Erdogmus & Ramezani, Efficient modeling of morphing wing flight using
    neural networks and cubature rules, Algorithm 1.
"""

from __future__ import annotations

import numpy as np

from patagium.arrays import Array
from patagium.learning.models.dense import DenseNetwork


class Algorithm1:
    """Mean and covariance of the weights of a dense network, as the paper writes them.

    Args:
        network: Whose weights are estimated.
        std: Standard deviations of the weights to begin with, (n,).
        noise: Variances of the measurement, R, (n_y,) [y^2].

    Attributes:
        mean: Weights, (n,) [1].
        covariance: P, (n, n) [1].
    """

    def __init__(self, network: DenseNetwork, std: Array, noise: Array) -> None:
        self.mean: Array = network.initial(0)
        self.covariance: Array = np.diag(std**2)
        self._network, self._measurement_noise = network, np.diag(noise)
        self._process_noise = np.zeros((network.size, network.size))

    def update(self, x: Array, y: Array) -> Array:
        """Learn one sample; gives the innovation, (n_y,).

        Args:
            x: Input, (n_x,) [units of x].
            y: Measurement, (n_y,) [unit of y].
        """
        points = self._points(self.mean, self.covariance)
        count = len(points)
        mean = points.mean(axis=0)
        predicted = points.T @ points / count - np.outer(mean, mean) + self._process_noise
        points = self._points(mean, predicted)
        outputs = self._outputs(x, points)
        guess = outputs.mean(axis=0)
        total = outputs.T @ outputs / count - np.outer(guess, guess) + self._measurement_noise
        cross = points.T @ outputs / count - np.outer(mean, guess)
        gain = cross @ np.linalg.inv(total)
        self.mean = mean + gain @ (y - guess)
        self.covariance = predicted - gain @ total @ gain.T
        return np.asarray(y - guess)

    @staticmethod
    def _points(mean: Array, covariance: Array) -> Array:
        """W +- sqrt(n) S e_i, (2 n, n)."""
        steps = np.sqrt(len(mean)) * np.linalg.cholesky(covariance).T
        return np.concatenate([mean + steps, mean - steps])

    def _outputs(self, x: Array, points: Array) -> Array:
        """The network at one x and many weights, (2 n, n_y)."""
        network, start = self._network, 0
        layer = np.broadcast_to(
            (x - network.input_center) / network.input_scale, (len(points), len(x))
        )
        widths = network.perceptron.widths
        for number, (below, above) in enumerate(zip(widths, widths[1:], strict=False)):
            if number:
                soft = network.perceptron.activation == "softplus"
                layer = np.log1p(np.exp(layer)) if soft else np.tanh(layer)
            middle, end = start + below * above, start + (below + 1) * above
            matrices = points[:, start:middle].reshape(-1, above, below)
            layer = np.matmul(matrices, layer[:, :, None])[:, :, 0] + points[:, middle:end]
            start = end
        return np.asarray(network.output_center + network.output_scale * layer)
