"""Learning a network's weights by backpropagation, one step a sample: the paper's rival.

Adam on the squared error, each output in units of its own scale. It has no covariance
of the weights; the interval it predicts is the running mean square of its innovations.
Neglected: mini-batches other than the sample and those replayed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, Bools
from patagium.errors import Outcome
from patagium.learning.filters.screening import Screen
from patagium.learning.learners.learner import as_input, diverged, found_part
from patagium.learning.models.network import Encoding, Network
from patagium_lab.rivals.rival_learner import RivalLearner

LEARNING_RATE = 0.01
"""Step of Adam that nobody states, in the unit of the weights [1]."""
_MEAN_DECAY, _SQUARE_DECAY, _SMALL = 0.9, 0.999, 1e-8  # Kingma & Ba's constants
_SCATTER_DECAY = 0.99
_MEMORY = 4096  # samples kept for replay


class GradientLearner(RivalLearner):
    """Adam over the weights of a network, one step a sample, with or without replay.

    g = sum over the sample and those replayed of (y(W) - y)' A^-2 dy/dW, A the running
    root mean square of each output, so that large outputs do not drown small ones.

    Args:
        network: Network whose weights are learned.
        learning_rate: Step of Adam, in the unit of the weights [1]; None: `LEARNING_RATE`.
        replay: Number of earlier samples that join each step, drawn evenly from the last 4096.
        seed: Seed of the weights to start from and of the draws.

    References:
        Kingma & Ba (2015), Adam: A method for stochastic optimization.
    """

    def __init__(
        self,
        network: Network,
        *,
        learning_rate: float | None = None,
        replay: int = 0,
        seed: int = 0,
    ) -> None:
        super().__init__(network, Screen(np.ones(network.outputs), network))
        self._given_rate, self._replay, self._seed = learning_rate, replay, seed
        self._rate = learning_rate or LEARNING_RATE
        self._weights = network.initial(seed)
        self._mean = np.zeros(network.size)
        self._square = np.zeros(network.size)
        self._scatter = np.zeros((network.outputs, network.outputs))
        self._power = np.zeros(network.outputs)
        self._memory: list[tuple[Encoding, Array]] = []
        self._draw = np.random.default_rng(seed)

    @property
    def weights(self) -> Array:
        """The estimate W, (n,) [1]."""
        return self._weights.copy()

    covariance = variances = None  # of the weights there is none

    def predict(self, x: ArrayLike) -> tuple[Array, Array]:
        """Measurement at x, and the running mean square of the innovations.

        Args:
            x: Input, (n_x,) [units of x].

        Returns:
            Mean, (n_y,), and covariance, (n_y, n_y); NaN before the first update.

        Raises:
            ShapeError: If x has another shape.
        """
        mean = self._network(as_input(self._network, x), self._weights)
        if self.count == 0:
            return mean, np.full_like(self._scatter, np.nan)
        return mean, self._scatter / (1 - _SCATTER_DECAY**self.count)

    def _learn(self, x: Array, y: Array, kept: Bools) -> Array:
        encoding = self._network.encode_one(x)
        measured = np.where(kept, y, self._network(x, self._weights))
        power = _decayed(self._power, measured**2, _SQUARE_DECAY)
        scale = np.sqrt(power / (1 - _SQUARE_DECAY ** (self.count + 1)))
        scale = np.maximum(scale, 1e-6 * scale.max(initial=0.0)) + 1e-300
        innovation, slope = self._slope(encoding, measured, scale)
        for number in self._drawn():
            slope = slope + self._slope(*self._memory[number], scale)[1]
        mean = _decayed(self._mean, slope, _MEAN_DECAY)
        square = _decayed(self._square, slope**2, _SQUARE_DECAY)
        step = self.count + 1
        unbiased = np.sqrt(square / (1 - _SQUARE_DECAY**step)) + _SMALL
        weights = self._weights - self._rate * (mean / (1 - _MEAN_DECAY**step)) / unbiased
        if not (np.isfinite(weights).all() and np.isfinite(innovation).all()):
            raise diverged(Outcome.NOT_FINITE, self.count, x, measured)
        self._weights, self._mean, self._square, self._power = weights, mean, square, power
        self._scatter = _decayed(self._scatter, np.outer(innovation, innovation), _SCATTER_DECAY)
        if self._replay:
            self._keep(encoding, measured.copy())
        return innovation

    def describe(self) -> dict[str, Any]:
        """Kind, network and settings of the learner as JSON values, without the weights."""
        given = {
            "kind": "gradient",
            "network": self._network.describe(),
            "learning_rate": self._given_rate,
            "replay": self._replay,
            "seed": self._seed,
        }
        return given | found_part({} if self._given_rate else {"learning_rate": LEARNING_RATE})

    def _slope(self, encoding: Encoding, y: Array, scale: Array) -> tuple[Array, Array]:
        """Innovation, (n_y,), and derivative of half its scaled square for W, (n,)."""
        guess, jacobian = self._network.linearized(encoding, self._weights)
        innovation = y - guess
        return innovation, -(innovation / scale**2) @ jacobian

    def _drawn(self) -> list[int]:
        count = min(self._replay, len(self._memory))
        return self._draw.choice(len(self._memory), count, replace=False).tolist() if count else []

    def _keep(self, encoding: Encoding, y: Array) -> None:
        if len(self._memory) < _MEMORY:
            self._memory.append((encoding, y))
        else:
            self._memory[self.count % _MEMORY] = (encoding, y)


def _decayed(average: Array, new: Array, decay: float) -> Array:
    return decay * average + (1 - decay) * new
