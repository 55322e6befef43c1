"""Every number of a measured section and of the stall delay moves the force or the states."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from patagium.aerodynamics import LiftingLine, QuasiSteady, StallDelay, measured_section
from patagium.aerodynamics.indicial import ONE_STATE
from patagium.aerodynamics.model import aero_functions
from patagium.robot import load_robot

DEGREES = np.array([-90.0, -30.0, -10.0, 0.0, 10.0, 14.0, 20.0, 40.0, 90.0])
LIFT = np.array([0.0, -0.6, -0.7, 0.05, 0.9, 1.0, 0.7, 1.1, 0.0])
DRAG = np.array([1.3, 0.7, 0.05, 0.01, 0.02, 0.06, 0.3, 1.0, 1.3])
MOMENT = np.array([0.3, 0.2, 0.01, -0.03, -0.04, -0.05, -0.12, -0.25, -0.35])


@pytest.fixture(scope="module")
def section():
    return measured_section(np.radians(DEGREES), LIFT, DRAG, MOMENT)


def outputs(aero, functions, angle: float, parameters: np.ndarray) -> np.ndarray:
    """Forces and rates of a wing at an incidence, half separated."""
    count = len(aero.robot.strips)
    wash = np.full(count, 4.0 * np.sin(angle))
    z = np.concatenate([0.5 * wash, 0.9 * wash, np.repeat([0.5, 0.1], count)])[: aero.state_size]
    v = np.zeros(aero.robot.dof)
    v[0], v[2] = 4.0 * np.cos(angle), -4.0 * np.sin(angle)
    inputs = [np.zeros(aero.robot.dof), v, z, np.zeros(3), aero.robot.parameters, parameters]
    return np.concatenate(
        [
            np.array(ca.densify(f(*inputs)[0] if k == 1 else f(*inputs))).ravel()
            for k, f in enumerate(functions)
        ]
    )


@pytest.mark.parametrize("kind", ["lifting line", "quasi-steady"])
def test_every_parameter_moves_forces_or_rates_at_its_incidence(section, kind: str) -> None:
    robot = load_robot("aerobat")
    aero = LiftingLine(robot, lags=ONE_STATE, section=section, stall_delay=StallDelay())
    if kind == "quasi-steady":
        aero = QuasiSteady(robot, polar=section.stalled)
    functions, parameters = aero_functions(aero), aero.parameters
    # near every knot and between, where its neighbors matter too
    angles = np.radians([-85.0, -60.0, -25.0, -7.0, 2.0, 8.0, 13.0, 17.0, 30.0, 60.0, 86.0])
    base = [outputs(aero, functions, angle, parameters) for angle in angles]
    for k, name in enumerate(aero.parameter_names):
        moved = parameters.copy()
        moved[k] += 1e-3 * (1.0 + abs(moved[k]))
        changes = [
            np.abs(outputs(aero, functions, angle, moved) - b).max()
            for angle, b in zip(angles, base, strict=True)
        ]
        assert max(changes) > 1e-6, name


def test_longer_delays_slow_the_states_down(section) -> None:
    robot = load_robot("aerobat")
    delays = (
        StallDelay(),
        StallDelay(pressure=3.4),
        StallDelay(separation=6.0),
        StallDelay(vortex=12.0),
    )
    rates = []
    for delay in delays:
        aero = LiftingLine(robot, lags=ONE_STATE, section=section, stall_delay=delay)
        every = outputs(aero, aero_functions(aero), 0.3, aero.parameters)[-30:]
        rates.append(np.abs(every.reshape(3, 10)))
    assert np.allclose(rates[1][0], rates[0][0] / 2) and np.allclose(rates[1][1], rates[0][1])
    assert np.allclose(rates[2][1], rates[0][1] / 2) and np.allclose(rates[2][0], rates[0][0])
    assert np.allclose(rates[3][2], rates[0][2] / 2) and np.allclose(rates[3][:2], rates[0][:2])
