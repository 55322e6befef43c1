"""Names that were removed, and what takes their place."""

from __future__ import annotations

_DEFAULT = "the default, which errs less"
_LAGS = "the default, which has lags where flow is attached"
_SQUARES = "which is least squares where the network is linear in its weights"
REMOVED = {
    **dict.fromkeys(("FlowNetwork", "HiddenFlowNetwork"), f"LinearStripNetwork, {_DEFAULT}"),
    **dict.fromkeys(("flow", "hidden_flow"), f"linear_strip, {_DEFAULT}"),
    "HiddenStripNetwork": f"LinearStripNetwork, {_LAGS}",
    "hidden_strip": f"linear_strip, {_LAGS}",
    "LowRank": 'covariance="layer", which errs less',
    "low rank": "layer, which errs less",
    "wind": "gust with a length_time and stays: true",
    "WindEvent": "GustEvent(..., stays=True)",
    "identify_table": "identify, which takes tables too",
    "evaluate_table": "evaluate, which takes tables too",
    **dict.fromkeys(("momentum_force", "MomentumObserver"), "inverse_dynamics_force"),
    **dict.fromkeys(("Kalman", "Spline", "SavitzkyGolay"), "estimate_motion, which has a smoother"),
    "GradientLearner": f"ExtendedLearner, {_DEFAULT}",
    "gradient": f"extended, {_DEFAULT}",
    "LinearLearner": f"ExtendedLearner, {_SQUARES}",
    "linear": f"the extended filter, {_SQUARES}",
    "residual network": "None: LinearStripNetwork learns what physics leaves, and errs less",
}
"""What takes the place of what was removed, by class and by kind."""
