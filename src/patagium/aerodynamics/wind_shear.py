"""Wind that grows with height: the power law and the logarithmic law of the boundary layer.

It is put on any model of the air, whose strips then meet the wind, gusts included, at their own
height. Neglected: the turn of the wind with height, that gusts grow less with height than the mean
wind does, and shear in the air that `AddedMass` carries.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from patagium.aerodynamics.local_flow import quarter_chord
from patagium.aerodynamics.on_model import OnModel
from patagium.aerodynamics.strip_loads import AeroExpressions
from patagium.arguments import check_fields
from patagium.dynamics.kinematics import body_poses
from patagium.errors import positive
from patagium.robot.model import Robot

LOWEST = 0.01
"""Height below which a law is rounded off, over the reference height or the roughness [1]."""


@dataclass(frozen=True)
class WindShear(OnModel):
    """Model of the air in a wind that depends on the height h above the ground.

    The wind of the air is that at the reference height H; a strip meets it times

        (h/H)^exponent,   or   ln(1 + h/z0) / ln(1 + H/z0)   where a roughness z0 is given.

    The 1 keeps the logarithmic law at zero on the ground; where h is a hundred times z0 it changes
    the wind by less than .3 %. The power law is rounded off near the ground: with 1/7 the wind
    is 2.7 % larger at H/100, 7 % at H/200, and 47 % of that at H on the ground. The ground is
    that of the air, or at z = 0.

    Args:
        model: Model of the air under this one.
        reference_height: H [m].
        exponent: Exponent of the power law; 1/7 over open land.
        roughness: Roughness length z0 of the logarithmic law [m]; None: the power law.

    Raises:
        ParameterError: If a number is not finite and positive, or the model has shear already.

    References:
        Stull (1988), An Introduction to Boundary Layer Meteorology, ch. 9.
    """

    reference_height: float = 10.0
    exponent: float = 1 / 7
    roughness: float | None = None

    name = "wind_shear"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(self)
        for name in ("reference_height", "exponent"):
            positive(name, getattr(self, name))
        if self.roughness is not None:
            positive("roughness", self.roughness, "a positive length [m], or None")

    @property
    def structure(self) -> str:
        """Text of what shapes the equations, numbers aside: part of a compiled function's key."""
        law = "power" if self.roughness is None else "logarithm"
        return f"{self.name} {law} on {self.model.key}"

    @property
    def own_parameters(self) -> dict[str, float]:
        """Numbers of the law by name [m, 1]."""
        names = "reference_height", "exponent" if self.roughness is None else "roughness"
        return {f"wind_shear.{name}": getattr(self, name) for name in names}

    def expressions(
        self, robot: Robot, q: ca.SX, v: ca.SX, state: ca.SX, wind: ca.SX, parameters: ca.SX
    ) -> AeroExpressions:
        """Equations of the model; see `Aerodynamics.expressions`."""
        names, own = self.model.parameter_names, len(self.model.parameter_names)
        ground = parameters[names.index("ground")] if "ground" in names else 0.0
        poses, winds = body_poses(robot, q), []
        for i, strip in enumerate(robot.strips):
            height = quarter_chord(poses, strip)[2] - ground
            met = wind[:, i] if wind.shape[1] > 1 else wind
            winds.append(met * self._share(height, parameters[own], parameters[own + 1]))
        given = ca.horzcat(*winds) if winds else wind
        air = self.model.expressions(robot, q, v, state, given, parameters[:own])
        return replace(air, wind=given)

    def _share(self, height: Any, reference: Any, number: Any) -> Any:
        """Wind at a height over that at the reference height [1]."""
        least = LOWEST * (reference if self.roughness is None else number)
        above = (height + ca.sqrt(height * height + least * least)) / 2
        if self.roughness is None:
            return (above / reference) ** number
        return ca.log(1.0 + above / number) / ca.log(1.0 + reference / number)
