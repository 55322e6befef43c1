from patagium.aerodynamics import *  # noqa: F403

__all__: list[str]
