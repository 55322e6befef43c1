"""Air models and polars of a user's own: what they must give, and what they may hold."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics.indicial import Relaxation
from patagium.aerodynamics.polars import _KINDS
from patagium.errors import ShapeError
from patagium.simulation import aero_of

ROBOT = pt.load_robot("aerobat")
STRIPS = len(ROBOT.strips)


@dataclass(frozen=True)
class Own(pt.QuasiSteady):
    """Air model with states, one expression of which is replaced."""

    other: tuple[str, Any] | None = None

    state_size = 2

    def expressions(self, *inputs: Any) -> Any:
        rates = ca.SX.zeros(2)
        air = replace(super().expressions(*inputs), state_derivative=rates)
        return replace(air, **dict([self.other])) if self.other else air


def fly(aero: Any) -> Any:
    return pt.simulate(ROBOT, aero, pt.gaits.cruise(ROBOT), duration=0.01, time_step=1e-3)


@pytest.mark.parametrize(
    ("name", "other", "said"),
    [
        ("state_derivative", ca.SX(0, 1), "(2, 1), found (0, 1)"),
        ("strip_force", ca.SX(STRIPS, 3), f"(3, {STRIPS}), found ({STRIPS}, 3)"),
        ("strip_point", ca.SX(3, 1), f"(3, {STRIPS}), found (3, 1)"),
        ("generalized_force", ca.SX(6, 1), f"({ROBOT.dof}, 1), found (6, 1)"),
        ("angle_of_attack", ca.SX(1, STRIPS), f"({STRIPS}, 1), found (1, {STRIPS})"),
        ("power", ca.SX(3, 1), "(1, 1), found (3, 1)"),
        ("memory", Relaxation(ca.SX(2, 1), ca.SX(1, 1)), "(2, 1), found (1, 1)"),
    ],
)
def test_expressions_of_another_shape_are_refused(name: str, other: Any, said: str) -> None:
    """Missing derivatives of states corrupted memory; transposed strip forces were mixed up."""
    field = "target" if name == "memory" else name
    for use in (fly, lambda aero: aero.generalized_force(ROBOT.coordinates(), ROBOT.velocities())):
        with pytest.raises(ShapeError) as refusal:
            use(Own(ROBOT, other=(name, other)))
        assert str(refusal.value) == f"aero Own: {field}: expected shape {said}"


def test_names_of_states_are_as_many_as_states(monkeypatch: pytest.MonkeyPatch) -> None:
    """A model with fewer names than states was accepted."""
    monkeypatch.setattr(Own, "state_names", ("one",), raising=False)
    with pytest.raises(ShapeError, match="state_names"):
        fly(Own(ROBOT))


@pytest.mark.usefixtures("interpreted")
def test_numbers_of_numpy_are_recorded() -> None:
    """A flight in air with a parameter of type np.float64 failed when its record was written."""

    @pt.air.register_polar
    @dataclass(frozen=True)
    class Foil(pt.air.Polar):
        name: ClassVar[str] = "foil of NumPy"
        slope: float = 4.0

        def coefficients(self, flow: Any, parameters: Any) -> tuple[Any, Any]:
            return parameters[0] * ca.sin(flow.angle_of_attack) * flow.forward_sign, 0.1

    class Described(pt.QuasiSteady):
        def describe(self) -> dict[str, Any]:
            return super().describe() | {"rotational": np.bool_(False)}

    gust = pt.air.RampGust((0.0, 0.0, 1.0), 0.001, np.float32(0.5))
    try:
        flight = fly(Described(ROBOT, pt.Air(gust=gust), polar=Foil(np.float32(2.5))))
        aero = aero_of(flight)
    finally:
        _KINDS.remove(Foil)
    assert aero.polar == Foil(2.5) and aero.air.gust == replace(gust, length_time=0.5)
