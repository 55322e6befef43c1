"""Models of the air learned from samples: settings, models, filters, learners, scores, tuning."""

from patagium.names import offer_names

__all__ = offer_names(__name__)
