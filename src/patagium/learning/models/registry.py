"""Networks by the kind that their descriptions name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from patagium.aerodynamics import Air
from patagium.arguments import checked
from patagium.errors import ParameterError, check_names
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.models.grey_box import GreyBox
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.learning.models.network import Network
from patagium.learning.models.strip import StripNetwork

_KINDS: dict[str, Any] = {
    network.kind: network for network in (DenseNetwork, StripNetwork, LinearStripNetwork, GreyBox)
}
_OWN = frozenset(_KINDS)
_Kind = TypeVar("_Kind", bound=type[Network])


def register_network(network: _Kind) -> _Kind:
    """Class decorator that lets learners and models of an own network be read from files.

    Args:
        network: Class with a text `kind` and `from_description`, the inverse of `describe`.

    Raises:
        ParameterError: If a network of the package has the kind.
    """
    kind = str(getattr(network, "kind", ""))
    if not kind or kind in _OWN:
        raise ParameterError("kind of the network", "a text of its own", kind)
    _KINDS[kind] = network
    return network


def network_options(kind: str) -> tuple[str, ...]:
    """Arguments that only networks of a kind have; none of a dense one.

    Raises:
        ParameterError: If the kind is unknown.
    """
    check_names("kind", [kind], _KINDS)
    return tuple(getattr(_KINDS[kind], "options", ()))


@checked
def network_from_description(description: Mapping[str, Any]) -> Network:
    """The network of `describe()`.

    Args:
        description: What `describe` of a network gave.

    Raises:
        ParameterError: If its kind is unknown, or a key is missing or unknown.
        RobotFileError: If the text of its robot does not describe one.
    """
    kind = _KINDS.get(str(description.get("kind")))
    if kind is None:
        raise ParameterError("network", f"of kind {', '.join(_KINDS)}", description.get("kind"))
    network: Network = kind.from_description(description)
    return network


def steady_air(network: Network) -> Air | None:
    """Air with the wind and density that a network is given; None if it needs none."""
    own: Air | None = getattr(getattr(network, "model", network), "air", None)
    return own


def in_air(description: Any, air: Air) -> Any:
    """Description of a network whose models of the air have the steady wind and density of `air`.

    What the weights mean is relative to both, so that they stay.
    """
    if not isinstance(description, Mapping):
        return description
    steady = {"wind": air.wind, "density": air.density, "gust": None}
    return {k: {**v, **steady} if k == "air" else in_air(v, air) for k, v in description.items()}
