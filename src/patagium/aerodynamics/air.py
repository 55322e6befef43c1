"""The air a robot flies in: density, uniform wind, gusts.

The wind is the same everywhere; so is a gust at one time, unless it travels
(`TravelingGust`). The ground, where there is one, is a level plane. World axes. Neglected: shear
(`WindShear` adds it to a model), obstacles, compressibility.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics.gusts import Gust, TravelingGust, gust_from_description, triple
from patagium.aerodynamics.named_descriptions import field_values, from_field_values
from patagium.arguments import check_fields
from patagium.arrays import Array, real_array
from patagium.errors import ParameterError, ShapeError, finite, positive


@dataclass(frozen=True)
class Air:
    """Density and velocity of the air.

    wind(t) = steady wind + gust(t); of a gust that travels, gust(p, t).

    Args:
        density: Density [kg/m^3].
        wind: Steady velocity of the air, world axes, (3,) [m/s]; a head wind of
            3 m/s on a robot that looks along x is (-3, 0, 0).
        gust: Velocity added to the steady wind, or None.
        ground: Height of the ground, world z [m]; None: there is none within reach.

    Raises:
        ParameterError: If the density is not positive, or the wind or the ground not finite.
        ShapeError: If the wind is not (3,).
    """

    density: float = 1.225
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gust: Gust | None = None
    ground: float | None = None

    def __post_init__(self) -> None:
        positive("density", self.density, "a positive number [kg/m^3]")
        if self.ground is not None:
            object.__setattr__(self, "ground", finite("ground", self.ground))
        object.__setattr__(self, "density", float(self.density))
        object.__setattr__(self, "wind", triple("wind", self.wind))
        check_fields(self)

    @property
    def ground_parameters(self) -> dict[str, float]:
        """Height of the ground as a parameter of models of the air [m]; empty without one."""
        return {} if self.ground is None else {"ground": self.ground}

    @property
    def traveling(self) -> TravelingGust | None:
        """The gust, if it is one that travels."""
        return self.gust if isinstance(self.gust, TravelingGust) else None

    def require_uniform(self, name: str) -> None:
        """Refuse a gust that travels, and ground, where the air is taken to be alike everywhere.

        Args:
            name: Of the argument that carries the air, for the message.

        Raises:
            ParameterError: If the gust travels, or there is ground.
        """
        if self.traveling is not None:
            raise ParameterError(name, "air without a gust that travels", self.gust)
        if self.ground is not None:
            raise ParameterError(name, "air without ground", self.ground)

    def wind_at(self, time: ArrayLike) -> Array:
        """Velocity of the air, at the origin of a gust that travels, world axes, (N, 3) [m/s].

        Args:
            time: Times, (N,) [s].

        Raises:
            ShapeError: If `time` is not (N,).
        """
        wind = self.uniform_wind_at(time)
        if self.traveling is None:
            return wind
        return wind + self.traveling.velocity_at(np.asarray(time, float))

    def uniform_wind_at(self, time: ArrayLike) -> Array:
        """Part of the air's velocity that is the same everywhere, world axes, (N, 3) [m/s].

        Args:
            time: Times, (N,) [s].

        Raises:
            ShapeError: If `time` is not (N,).
        """
        times = real_array("time", time)
        if times.ndim != 1:
            raise ShapeError("time", "(N,)", times.shape)
        wind = np.tile(self.wind, (times.size, 1))
        if self.gust is None or self.traveling is not None:
            return wind
        return wind + self.gust.velocity_at(times)

    def describe(self) -> dict[str, Any]:
        """Description from which the object can be made again, as JSON-able values."""
        values = field_values(self)
        del values["ground"]
        return values | self.ground_parameters


def air_from_description(description: Mapping[str, Any]) -> Air:
    """The air of `Air.describe()`.

    Raises:
        ParameterError: If a key is missing or unknown.
    """
    values = {"ground": None, **description}  # there where there is ground
    if values.get("gust") is not None:
        values["gust"] = gust_from_description(values["gust"])
    return from_field_values("air", Air, values)
