"""Pictures and pages from plain arrays: what a result shows of itself.

It knows nothing of robots, flights or learners, so that any layer above may draw.
"""

from patagium.names import offer_names

__all__ = offer_names(__name__)
