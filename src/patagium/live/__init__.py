"""The loop of a running robot: packets, streams, and the pipeline from a packet to an update."""

from patagium.names import offer_names

__all__ = offer_names(__name__)
