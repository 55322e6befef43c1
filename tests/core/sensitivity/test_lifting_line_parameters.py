"""Every parameter of air with memory moves the force or the memory, and to the right side."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from patagium.aerodynamics import Air, LiftingLine, Section
from patagium.aerodynamics.indicial import ONE_STATE
from patagium.aerodynamics.model import aero_functions
from patagium.robot import load_robot

# sign of d(lift)/dp and d(drag)/dp of a wing partly stalled at 34 degrees, memory half grown
LIFT_AND_DRAG = {
    "density": (1, 1),
    "surface_constant": (-1, None),
    "lags.lift[0]": (-1, None),
    "lags.circulation[0]": (None, None),
    "section.lift_slope": (1, None),
    "section.zero_lift_angle": (-1, None),
    "section.profile_drag": (None, 1),
    "section.stall_begins": (None, None),
    "section.stall_complete": (None, None),
    "section.stalled.lift_offset": (1, 0),
    "section.stalled.lift_amplitude": (1, 0),
    "section.stalled.lift_rate": (1, 0),
    "section.stalled.lift_phase": (-1, 0),
    "section.stalled.drag_offset": (0, 1),
    "section.stalled.drag_amplitude": (0, -1),
    "section.stalled.drag_rate": (0, 1),
    "section.stalled.drag_phase": (0, -1),
    "ground": (1, None),
}


class Wing:
    """The aerobat sinking at an incidence, its parameters as inputs."""

    def __init__(self) -> None:
        section = Section(zero_lift_angle=-0.02)
        self.aero = LiftingLine(
            load_robot("aerobat"), Air(ground=-0.1), lags=ONE_STATE, section=section
        )
        self.functions = {function.name(): function for function in aero_functions(self.aero)}
        self.direction = np.array([np.cos(0.6), -np.sin(0.6)])

    def __call__(self, name: str, parameters: np.ndarray, robot: np.ndarray | None = None):
        x, z = 4.0 * self.direction
        v = self.aero.robot.coordinates(x=x, z=z)
        given = self.aero.robot.parameters if robot is None else robot
        inputs = [np.zeros(14), v, np.full(10, 0.7), np.zeros(3), given, parameters]
        result = self.functions[name](*inputs)
        return np.asarray(result[0] if isinstance(result, tuple) else result)

    def lift_and_drag(self, parameters: np.ndarray) -> np.ndarray:
        force = self("strips", parameters).sum(axis=1)[[0, 2]]
        across = np.array([-self.direction[1], self.direction[0]])
        return np.array([force @ across, -force @ self.direction])


@pytest.fixture(scope="module")
def wing() -> Wing:
    return Wing()


def test_every_parameter_moves_lift_or_drag_to_its_side(wing: Wing) -> None:
    parameters = wing.aero.parameters
    base = wing.lift_and_drag(parameters)
    rate = wing("state_derivative", parameters)
    for k, name in enumerate(wing.aero.parameter_names):
        moved = parameters.copy()
        moved[k] += 0.01 * abs(moved[k])
        if name == "lags.rate[0]":
            assert (np.abs(wing("state_derivative", moved)) > np.abs(rate)).all()
            continue
        changes = wing.lift_and_drag(moved) - base
        assert np.abs(changes).max() > 1e-7, name  # of some tenths of a newton
        for change, side in zip(changes, LIFT_AND_DRAG[name], strict=True):
            if side is not None:
                assert (np.sign(change) if abs(change) > 1e-9 else 0) == side, name


def test_every_number_of_the_strips_moves_the_generalized_force(wing: Wing) -> None:
    robot, base = wing.aero.robot, wing("generalized_force", wing.aero.parameters)
    names = [name for name in robot.parameter_names if "wing[" in name]
    assert len(names) == 4 * len(robot.strips)  # x, y of the quarter chord, chord, width
    for name in names:
        numbers = robot.parameters
        numbers[robot.parameter_names.index(name)] *= 1.01
        force = wing("generalized_force", wing.aero.parameters, numbers)
        assert np.abs(force - base).max() > 1e-7, name


def test_every_lag_moves_the_force_of_its_strip_and_of_its_neighbors(wing: Wing) -> None:
    robot, parameters = wing.aero.robot, wing.aero.parameters
    v = robot.coordinates(x=4.0, z=-0.3)
    functions = wing.functions["strips"]
    z = np.zeros(10)

    def forces(state: np.ndarray) -> np.ndarray:
        arguments = [np.zeros(14), v, state, np.zeros(3), robot.parameters, parameters]
        return np.asarray(ca.DM(functions(*arguments)[0]))[2]

    base = forces(z)
    for k in range(10):
        moved = z.copy()
        moved[k] = 0.1
        change = forces(moved) - base
        assert (np.abs(change) > 1e-9).all()  # all strips feel each other
