"""The air of the published experiment, with its errors switchable one by one.

For comparison only: as published the air pushes a robot that moves backward and
drives the stroke it should damp. Neglected: as in the quasi-steady model, and
signs are hard, so that forces jump.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.local_flow import StripMotion, strip_motions
from patagium.aerodynamics.model import Aerodynamics
from patagium.aerodynamics.polars import DickinsonPolar
from patagium.aerodynamics.strip_loads import AeroExpressions, StripLoad, assemble
from patagium.errors import ParameterError
from patagium.robot.model import Robot

PUBLISHED_ERRORS = ("sign", "backwards_drag", "factor", "polar", "midchord")
PUBLISHED_FACTOR = 5.0


@dataclass(frozen=True)
class Published(Aerodynamics):
    """Blade elements as in the published experiment.

    With v = (v_x, v_z) the velocity of mid-chord relative to the air, forward and
    normal, b = atan2(v_z, |v_x|), L and D = 1/2 rho A |v|^2 times 5 C_L(b), 5 C_D(b):

        F_x = -L sin b - D cos b,    F_z = L cos b - D sin b,

    at a quarter chord ahead of mid-chord if v_x >= 0, else behind. The errors in it:

    - "sign": incidence b where it must be -b;
    - "backwards_drag": no sign of v_x on F_x, so drag pushes a wing that moves backward;
    - "factor": 5 on both coefficients;
    - "polar": a fit for 0 to 90 degrees taken at negative incidence as it stands, where
      it must be C_L(|a|) sgn(a), C_D(|a|);
    - "midchord": velocity of mid-chord where it must be that of the force point.

    Without any of them the equations are those of `QuasiSteady`, signs not smoothed.

    Args:
        robot: The machine.
        air: Density, wind and gusts.
        errors: Names of the errors to keep; all by default.

    Raises:
        ParameterError: If an error is not one of `PUBLISHED_ERRORS`.
    """

    robot: Robot
    air: Air = field(default_factory=Air)
    errors: Iterable[str] = PUBLISHED_ERRORS

    name = "published"

    def __post_init__(self) -> None:
        errors = frozenset([self.errors] if isinstance(self.errors, str) else self.errors)
        if not errors <= set(PUBLISHED_ERRORS):
            raise ParameterError("errors", f"among {', '.join(PUBLISHED_ERRORS)}", set(errors))
        object.__setattr__(self, "errors", errors)

    @property
    def state_size(self) -> int:
        """No states of its own."""
        return 0

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the model's parameters, in the order of `parameters`."""
        polar = (f"polar.{name}" for name in DickinsonPolar().parameter_names)
        return ("density", *polar, *(f"errors.{name}" for name in PUBLISHED_ERRORS))

    @property
    def parameters(self) -> NDArray[np.float64]:
        """Values of the model's parameters, (n_c,); 1 for an error that is kept, 0 for others."""
        kept = [float(name in self.errors) for name in PUBLISHED_ERRORS]
        return np.array([self.air.density, *DickinsonPolar().parameters, *kept])

    def describe(self) -> dict[str, Any]:
        """Description from which the model is made again for a robot, as JSON values."""
        return {"model": self.name, "air": self.air.describe(), "errors": sorted(self.errors)}

    def expressions(
        self, robot: Robot, q: ca.SX, v: ca.SX, state: ca.SX, wind: ca.SX, parameters: ca.SX
    ) -> AeroExpressions:
        """Equations of the model; see `Aerodynamics.expressions`."""
        motions = strip_motions(robot, q, v, wind)
        loads = [self._load(motion, parameters) for motion in motions]
        return assemble(robot, q, loads, ca.SX(0, 1))

    def _load(self, motion: StripMotion, parameters: ca.SX) -> StripLoad:
        strip, kept = motion.strip, self._kept(parameters)
        direction = hard_sign(motion.forward)
        ahead = (direction - 1.0) * (strip.chord / 4)
        measured_ahead = _either(kept["midchord"], -strip.chord / 4, ahead)
        v_x, v_z = motion.forward, motion.normal_ahead(measured_ahead)
        flow_angle = ca.atan2(v_z, ca.fabs(v_x))
        incidence = _either(kept["sign"], flow_angle, -flow_angle)
        lift, drag = self._coefficients(incidence, parameters)
        speed = ca.sqrt(v_x * v_x + v_z * v_z)
        mass_flow = parameters[0] * strip.width * strip.chord * speed / 2
        along_sign = _either(kept["backwards_drag"], 1.0, direction)
        return StripLoad(
            motion=motion,
            forward=-along_sign * mass_flow * (lift * v_z + drag * ca.fabs(v_x)),
            normal=mass_flow * (lift * ca.fabs(v_x) - drag * v_z),
            ahead=ahead,
            effective_angle_of_attack=incidence,
        )

    def _coefficients(self, incidence: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
        fit, kept, numbers = DickinsonPolar(), self._kept(parameters), parameters[1:]
        factor = _either(kept["factor"], PUBLISHED_FACTOR, 1.0)
        side = _either(kept["polar"], 1.0, hard_sign(incidence))
        size = side * incidence
        return factor * side * fit.lift(size, numbers), factor * fit.drag(size, numbers)

    def _kept(self, parameters: ca.SX) -> dict[str, ca.SX]:
        """1 for each error that is kept, 0 for others, by name: parameters, so that all share code.

        Compiling each set of errors anew would take longer than all of their flights.
        """
        count = len(PUBLISHED_ERRORS)
        return dict(zip(PUBLISHED_ERRORS, ca.vertsplit(parameters[-count:]), strict=True))


def _either(kept: ca.SX, wrong: Any, right: Any) -> ca.SX:
    """An expression with an error, or the right one: exactly, where `kept` is 1 or 0."""
    return kept * wrong + (1.0 - kept) * right


def hard_sign(x: Any) -> Any:
    """Sign of x with 1 at zero: a jump, as in the published experiment.

    Args:
        x: Expression, scalar.
    """
    return ca.if_else(x >= 0, 1.0, -1.0)


def published_air(robot: Robot, air: Air, errors: Iterable[str] = PUBLISHED_ERRORS) -> Published:
    """Published air for a robot, as a plugin of `patagium.air_models`.

    Args:
        robot: The machine.
        air: Density, wind and gusts.
        errors: Names of the errors to keep.

    Raises:
        ParameterError: If an error is not one of `PUBLISHED_ERRORS`.
    """
    return Published(robot, air, errors=frozenset(errors))
