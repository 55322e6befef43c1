"""Every parameter of the air moves the force, and to the right side."""

from __future__ import annotations

import functools

import casadi as ca
import numpy as np
import pytest

from patagium.aerodynamics import (
    Aerodynamics,
    Air,
    DickinsonPolar,
    QuasiSteady,
    ReynoldsPolar,
    SmoothPolar,
)
from patagium.aerodynamics.model import aero_functions
from patagium.robot import load_robot
from patagium_lab.published.aerodynamics import Published

# sign of d(lift)/dp and d(drag)/dp at 29 degrees of incidence, nose rising
EXPECTED = {
    "density": (1, 1),
    "polar.lift_offset": (1, 0),
    "polar.lift_amplitude": (1, 0),
    "polar.lift_rate": (1, 0),
    "polar.lift_phase": (-1, 0),
    "polar.drag_offset": (0, 1),
    "polar.drag_amplitude": (0, -1),
    "polar.drag_rate": (0, 1),
    "polar.drag_phase": (0, -1),
    "polar.zero_lift_drag": (0, 1),
    "polar.drag_rise": (0, 1),
    "polar.viscosity": (-1, -1),  # at Re = 27,000; below some 1000 it adds drag
    "rotational_coefficient": (1, 0),
    "errors.sign": (-1, 0),
    "errors.backwards_drag": (0, 0),  # the robot flies forward
    "errors.factor": (1, 1),
    "errors.polar": (0, 0),  # its incidence is positive
    "errors.midchord": (1, 1),
}
MODELS = {
    "dickinson": lambda robot: QuasiSteady(robot, polar=DickinsonPolar()),
    "smooth": lambda robot: QuasiSteady(robot, polar=SmoothPolar()),
    "reynolds": lambda robot: QuasiSteady(robot, polar=ReynoldsPolar()),
    "rotational": lambda robot: QuasiSteady(robot, rotational=True),
    "published": lambda robot: Published(robot, errors=()),
}
INCIDENCE, SPEED, RISE = 0.5, 4.0, 2.0


@pytest.fixture(scope="module", params=list(MODELS))
def aero(request: pytest.FixtureRequest) -> Aerodynamics:
    model: Aerodynamics = MODELS[request.param](load_robot("aerobat"))
    return model


def lift_and_drag(aero: Aerodynamics, robot_parameters: np.ndarray, parameters: np.ndarray):
    """Total lift and drag of the level robot that sinks at an incidence, and Q."""
    robot = aero.robot
    direction = np.array([np.cos(INCIDENCE), -np.sin(INCIDENCE)])
    x, z = SPEED * direction
    # so that the quarter chord, 25 mm ahead of the origin and 7.5 mm above, moves at (x, z)
    v = robot.coordinates(x=x + RISE * 0.0075, z=z - RISE * 0.025, pitch=-RISE)
    inputs = [np.zeros(robot.dof), v, np.zeros(0), np.zeros(3), robot_parameters, parameters]
    functions = _functions(aero)
    force = np.asarray(functions["strips"](*inputs)[0]).sum(axis=1)
    lift = force[[0, 2]] @ [-direction[1], direction[0]]
    turned = robot.coordinates(left_plunge=0.3, right_elbow=-0.2, left_feather=0.1, yaw=0.4)
    q_force = functions["generalized_force"](turned, v, *inputs[2:])
    return lift, -force[[0, 2]] @ direction, np.asarray(q_force).ravel()


def test_every_parameter_moves_lift_or_drag_to_its_side(aero: Aerodynamics) -> None:
    base = lift_and_drag(aero, aero.robot.parameters, aero.parameters)
    assert base[0] > 0
    assert base[1] > 0
    for k, name in enumerate(aero.parameter_names):
        moved = aero.parameters.copy()
        moved[k] = 1.0 if name.startswith("errors.") else 1.01 * moved[k]  # kept or not
        lift, drag, _ = lift_and_drag(aero, aero.robot.parameters, moved)
        expected = EXPECTED.get(name, (1, 0))  # smooth: lift_amplitude
        for change, side in zip((lift - base[0], drag - base[1]), expected, strict=True):
            # 1 % of a parameter moves a force of 0.1 N by 1e-5 or more; rounding is 1e-16
            assert (np.sign(change) if abs(change) > 1e-9 else 0) == side, name


def test_every_number_of_the_strips_moves_the_generalized_force(aero: Aerodynamics) -> None:
    robot = aero.robot
    base = lift_and_drag(aero, robot.parameters, aero.parameters)[2]
    moved_names = [name for name in robot.parameter_names if "wing[" in name]
    assert len(moved_names) == 4 * len(robot.strips)  # x, y of the quarter chord, chord, width
    for name in moved_names:
        parameters = robot.parameters
        parameters[robot.parameter_names.index(name)] *= 1.01
        force = lift_and_drag(aero, parameters, aero.parameters)[2]
        assert np.abs(force - base).max() > 1e-7, name


def test_wind_moves_the_force_along_every_axis(aero: Aerodynamics) -> None:
    robot = aero.robot
    q, v = robot.coordinates(left_plunge=0.3, right_plunge=0.2), robot.coordinates(x=3.0, z=-1.0)
    base = aero.generalized_force(q, v)
    for axis in range(3):
        wind = np.zeros(3)
        wind[axis] = 0.3
        given = type(aero)(robot, Air(wind=tuple(wind)), *_options(aero))
        assert np.abs(given.generalized_force(q, v) - base).max() > 1e-4


def _options(aero: Aerodynamics) -> tuple:
    if isinstance(aero, QuasiSteady):
        return aero.polar, aero.rotational
    return (aero.errors,)  # type: ignore[attr-defined]


@functools.cache
def _functions(aero: Aerodynamics) -> dict[str, ca.Function]:
    """Robot and air parameters are inputs here, so that one build serves all of them."""
    return {function.name(): function for function in aero_functions(aero)}
