from patagium.dynamics.dynamics import Dynamics as Dynamics
from patagium.dynamics.dynamics import Point as Point

__all__: list[str]
