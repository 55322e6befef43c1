"""Name space of the air: density, wind and gusts, models of the force, polars, sections."""

from patagium.aerodynamics import *  # noqa: F403
from patagium.aerodynamics import __all__ as __all__
from patagium.errors import suggest_names

suggest_names(__name__)
