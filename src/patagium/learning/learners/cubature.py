"""Cubature Kalman filter over the weights of a network.

The weights are the state of a filter, W_{k+1} = W_k + noise, y = network(x, W) + noise;
no derivative of the network is needed. Points, mean and covariance: `spread`.
Neglected: correlation of the measurement noise in time; mixed second derivatives.
"""

from __future__ import annotations

from patagium.learning.learners.filter_learner import FilterLearner


class CubatureLearner(FilterLearner, kind="cubature"):
    """Square-root cubature Kalman filter over the weights of a network.

    Before each sample P <- (1 - prior_share) P / forgetting_factor + prior_share P0 + Q,
    Q = diag(process_std^2). The points W +- kappa S e_i, P = S S', give mean and
    covariance of y and, with a sample,

        W <- W + S Z P_yy^-1 (y - mean),    P <- P - S Z P_yy^-1 Z' S',

    and W goes 1 - sqrt(1 - prior_share) of the way back to where it began.

    `covariance` says what is kept of P (cost of an update, memory in numbers; k weights a
    neuron, b a layer):

    - "full": all of it; n^2 (n_y + 8), n^2 / 2. Noise between samples adds h^3 / 6 +
      h^2 (n - h) / 2 with h weights before the last layer, and P itself is kept in place of S:
      definite to rounding.
    - "layer": one block a layer; the same with the sum of b^2 in place of n^2.
    - "node": one block a neuron; 2 n k, n k / 2 where at most one linear layer follows, about
      n n_y (k + 2 n_y) further from the outputs; noise between samples adds n k^2 / 3.

    `square_root="transform"` carries S itself, lower triangular, through the update: compiled,
    positive definite by construction. Its points are those of the Cholesky factor, so with
    "full" it equals Algorithm 1 of the paper but for rounding. `"cholesky"` is Algorithm 1 to
    rounding: P is carried, full, and factorized at every sample (order n^3).

    Forgetting alone makes P grow without bound along what the samples do not excite; with
    prior_share alone it never exceeds P0.

    Args:
        network: Network whose weights are learned.
        settings: Record of settings; None: the defaults. Single settings override it:
        {settings}
        seed: Seed of the weights to start from.

    Raises:
        ParameterError: If a setting is unknown or out of its range, or "cholesky" is not of "full".
        ShapeError: If a standard deviation has another shape.

    References:
        Arasaratnam & Haykin (2009), Cubature Kalman filters, IEEE TAC 54(6); Puskorius &
        Feldkamp (1991), Decoupled extended Kalman filter training, IJCNN.
    """

    @property
    def spread(self) -> float:
        """kappa, distance of the points in standard deviations."""
        return self._numbers.rule.spread
