"""A fourth-order integrator keeps its order while a plate tumbles through the switches."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from patagium.aerodynamics import Aerodynamics, QuasiSteady, SmoothPolar
from patagium.aerodynamics.local_flow import strip_motions
from patagium.dynamics.equations import forward
from patagium.robot import Robot
from patagium_lab.published.aerodynamics import Published

START = np.array([0.0, 0.0, 0.0, 0.3, 0.5, 0.1, 2.0, 0.3, -1.0, 1.0, 8.0, 0.5])
DURATION, COARSE, FINE, REFERENCE = 1.0, 1000, 8000, 32000


@pytest.mark.parametrize("polar", [None, SmoothPolar()])
def test_error_of_runge_kutta_falls_with_the_fourth_power(
    plate: Robot, polar: SmoothPolar | None
) -> None:
    path = tumble(QuasiSteady(plate) if polar is None else QuasiSteady(plate, polar=polar))
    reference = path(REFERENCE)
    forward_speed = _forward_speed(plate, reference)
    assert (np.diff(np.sign(forward_speed)) != 0).sum() >= 3  # it does pass the switch
    errors = [np.abs(path(n)[:, -1] - reference[:, -1]).max() for n in (COARSE, FINE)]
    order = np.log2(errors[0] / errors[1]) / np.log2(FINE / COARSE)
    assert order > 3.8  # chaos between the two makes it uneven, not lower


def test_hard_switches_lose_the_order(plate: Robot) -> None:
    path = tumble(Published(plate, errors=()))
    reference = path(REFERENCE)
    assert np.abs(path(FINE)[:, -1] - reference[:, -1]).max() > 1e-4


def tumble(aero: Aerodynamics) -> Callable[[int], np.ndarray]:
    """Path of the free plate by the classical Runge-Kutta method, as a function of steps."""
    x, step = ca.SX.sym("x", 12), ca.SX.sym("step")
    q, v = x[:6], x[6:]
    parameters = ca.SX(ca.DM(aero.parameters))
    air = aero.expressions(aero.robot, q, v, ca.SX(0, 1), ca.SX.zeros(3), parameters)
    rate = ca.Function(
        "rate", [x], [ca.vertcat(v, forward(aero.robot, q, v, air.generalized_force))]
    )
    k1 = rate(x)
    k2 = rate(x + step / 2 * k1)
    k3 = rate(x + step / 2 * k2)
    k4 = rate(x + step * k3)
    advance = ca.Function("advance", [x, step], [x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
    return lambda n: np.asarray(advance.mapaccum(n)(START, DURATION / n))


def _forward_speed(robot: Robot, path: np.ndarray) -> np.ndarray:
    x = ca.SX.sym("x", 12)
    flow = ca.Function("flow", [x], [strip_motions(robot, x[:6], x[6:], ca.SX.zeros(3))[0].forward])
    return np.asarray(flow.map(path.shape[1])(path)).ravel()
