"""Names that were removed, and what takes their place."""

from __future__ import annotations

from patagium.errors import ParameterError

_DEFAULT = "the default, which errs less"
_SQUARES = "which is least squares where the network is linear in its weights"
_REMOVED = {
    **dict.fromkeys(("FlowNetwork", "HiddenFlowNetwork"), f"LinearStripNetwork, {_DEFAULT}"),
    **dict.fromkeys(("flow", "hidden_flow"), f"linear_strip, {_DEFAULT}"),
    "LowRank": 'covariance="layer", which errs less',
    "low rank": "layer, which errs less",
    "wind": "gust with a length_time and stays: true",
    "GradientLearner": f"ExtendedLearner, {_DEFAULT}",
    "gradient": f"extended, {_DEFAULT}",
    "LinearLearner": f"ExtendedLearner, {_SQUARES}",
    "linear": f"the extended filter, {_SQUARES}",
    "residual network": "None: LinearStripNetwork learns what physics leaves, and errs less",
}
"""What takes the place of what was removed, by class and by kind."""


def refuse_removed(where: str, name: object) -> None:
    """Error of something that was removed; nothing for any other name.

    Raises:
        ParameterError: If it was removed; the message says what to take in its place.
    """
    if isinstance(name, str) and name in _REMOVED:
        raise ParameterError(where, f"{_REMOVED[name]} ({name} was removed)", name)
