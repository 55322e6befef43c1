"""Networks by the kind that their descriptions name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from patagium.errors import ParameterError
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.models.flow import FlowNetwork
from patagium.learning.models.grey_box import GreyBox
from patagium.learning.models.hidden_flow import HiddenFlowNetwork
from patagium.learning.models.hidden_strip import HiddenStripNetwork
from patagium.learning.models.linear import LinearNetwork
from patagium.learning.models.network import Network
from patagium.learning.models.strip import StripNetwork

_KINDS: tuple[Any, ...] = (
    *(DenseNetwork, LinearNetwork, StripNetwork, HiddenStripNetwork),
    *(FlowNetwork, HiddenFlowNetwork, GreyBox),
)


def network_from_description(description: Mapping[str, Any]) -> Network:
    """The network of `describe()`.

    Args:
        description: What `describe` of a network gave.

    Raises:
        ParameterError: If its kind is unknown, or a key is missing or unknown.
        RobotFileError: If the text of its robot does not describe one.
    """
    kinds = {kind.kind: kind for kind in _KINDS}
    kind = kinds.get(str(description.get("kind")))
    if kind is None:
        raise ParameterError("network", f"of kind {', '.join(kinds)}", description.get("kind"))
    if kind is GreyBox:
        return GreyBox.from_description(description, network_from_description)
    network: Network = kind.from_description(description)
    return network
