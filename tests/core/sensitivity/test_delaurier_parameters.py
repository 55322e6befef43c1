"""Every parameter of DeLaurier's strips moves lift or drag, and to the right side."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from patagium.aerodynamics import Air, DeLaurier
from patagium.aerodynamics.model import aero_functions
from patagium.robot import load_robot

# sign of d(lift)/dp and d(drag)/dp: attached at 8 degrees, and in the band of stall
SIDES = {
    "density": (8.0, 1, 1),
    "lift_slope": (8.0, 1, None),
    "zero_lift_angle": (8.0, -1, None),
    "suction_efficiency": (8.0, 1, -1),
    "friction_drag": (8.0, None, 1),
    "stall_angle": (23.0, None, -1),
    "stall_width": (23.0, None, None),
    "crossflow_drag": (60.0, 1, 1),
    "ground": (8.0, 1, None),
}


class Wing:
    """The aerobat sinking at an incidence, its memory grown."""

    def __init__(self) -> None:
        self.aero = DeLaurier(load_robot("aerobat"), Air(ground=-0.1), zero_lift_angle=-0.02)
        self.functions = aero_functions(self.aero)

    def forces(self, degrees: float, parameters: np.ndarray, state: np.ndarray | None = None):
        angle, robot = np.radians(degrees), self.aero.robot
        v = robot.coordinates(x=4 * np.cos(angle), z=-4 * np.sin(angle))
        z = np.full(10, 4 * np.sin(angle)) if state is None else state
        inputs = [np.zeros(14), v, z, np.zeros(3), robot.parameters, parameters]
        return np.asarray(ca.DM(self.functions[1](*inputs)[0])), angle

    def lift_and_drag(self, degrees: float, parameters: np.ndarray) -> np.ndarray:
        forces, angle = self.forces(degrees, parameters)
        x, _, z = forces.sum(axis=1)
        return np.array(
            [z * np.cos(angle) + x * np.sin(angle), z * np.sin(angle) - x * np.cos(angle)]
        )


@pytest.fixture(scope="module")
def wing() -> Wing:
    return Wing()


@pytest.mark.parametrize("name", list(SIDES))
def test_every_parameter_moves_lift_or_drag_to_its_side(wing: Wing, name: str) -> None:
    assert set(SIDES) == set(wing.aero.parameter_names)
    degrees, *sides = SIDES[name]
    parameters = wing.aero.parameters
    base = wing.lift_and_drag(degrees, parameters)
    larger = 0.99 if name == "ground" else 1.01  # it is below zero
    parameters[wing.aero.parameter_names.index(name)] *= larger
    changes = wing.lift_and_drag(degrees, parameters) - base
    change_of = changes if name != "zero_lift_angle" else -changes  # it is negative
    assert np.abs(changes).max() > 1e-6  # of some tenths of a newton
    for change, side in zip(change_of, sides, strict=True):
        assert side is None or np.sign(change) == side


def test_every_lag_moves_its_own_strip_only(wing: Wing) -> None:
    parameters, z = wing.aero.parameters, np.zeros(10)
    base, _ = wing.forces(3.0, parameters, z)
    for k in range(10):
        moved = z.copy()
        moved[k] = 0.1
        change = np.abs(wing.forces(3.0, parameters, moved)[0] - base).max(axis=0)
        assert change[k] > 1e-6
        assert not np.delete(change, k).any()


def test_every_number_of_the_strips_moves_the_generalized_force(wing: Wing) -> None:
    robot, parameters = wing.aero.robot, wing.aero.parameters
    v, z = robot.coordinates(x=4.0, z=-0.5), np.full(10, 0.4)

    def force(numbers: np.ndarray) -> np.ndarray:
        return np.asarray(wing.functions[0](np.zeros(14), v, z, np.zeros(3), numbers, parameters))

    base = force(robot.parameters)
    for k, name in enumerate(robot.parameter_names):
        if "wing[" in name:
            numbers = robot.parameters
            numbers[k] *= 1.01
            assert np.abs(force(numbers) - base).max() > 1e-7, name
