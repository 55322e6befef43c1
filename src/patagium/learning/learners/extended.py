"""Extended Kalman filter over the weights of a network, the paper's rival.

The network is linearized at the estimate, H = dy/dW by reverse accumulation through
the perceptron. Neglected: curvature of the network over the spread of its weights.
"""

from __future__ import annotations

from patagium.learning.learners.filter_learner import FilterLearner


class ExtendedLearner(FilterLearner, kind="extended"):
    """Extended Kalman filter over the weights of a network.

    Before each sample P <- (1 - prior_share) P / forgetting_factor + prior_share P0 + Q; then
    with H = dy/dW at W, P_yy = H P H' + R, W <- W + P H' P_yy^-1 (y - y(W)),
    P <- P - P H' P_yy^-1 H P; of that, what `covariance` keeps. Its square root is carried; with
    noise between samples, "full" and "layer" carry P itself, in as much time. Compiled for networks
    of a perceptron, others are in NumPy. Cost and memory of "full" are
    of order n^2, of "layer" of the sum of its blocks' squares, of "node", in NumPy, as of "full".

    Args:
        network: Network whose weights are learned.
        settings: Record of settings; None: the defaults. Single settings override it:
        {settings}
        seed: Seed of the weights to start from.

    Raises:
        ParameterError: If a setting is unknown or out of its range.
        ShapeError: If a standard deviation has another shape.

    References:
        Singhal & Wu (1989), Training multilayer perceptrons with the extended Kalman
        algorithm, NIPS 1.
    """
