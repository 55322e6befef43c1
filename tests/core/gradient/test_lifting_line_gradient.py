"""Derivatives of air with memory: AD, through the inner call too, against differences."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from patagium.aerodynamics import LiftingLine
from patagium.aerodynamics.indicial import ONE_STATE
from patagium.robot import Robot, load_robot


class Gradient:
    """Force and rate of the lags as a function of x = [q, v, state, wind, parameters]."""

    def __init__(self, robot: Robot) -> None:
        self.aero = LiftingLine(robot, lags=ONE_STATE)
        sizes = [robot.dof, robot.dof, self.aero.state_size, 3, len(self.aero.parameters)]
        x = ca.SX.sym("x", sum(sizes))
        parts = ca.vertsplit(x, np.concatenate([[0], np.cumsum(sizes)]).tolist())
        air = self.aero.expressions(robot, *parts)
        output = ca.vertcat(air.generalized_force, air.state_derivative)
        self.output = ca.Function("output", [x], [output])
        self.jacobian = ca.Function("jacobian", [x], [ca.jacobian(output, x)])

    def point(self, q: np.ndarray, v: np.ndarray, state: np.ndarray) -> np.ndarray:
        return np.concatenate([q, v, state, np.zeros(3), self.aero.parameters])

    def differences(self, x: np.ndarray, step: float = 1e-6) -> np.ndarray:
        shifts = step * np.eye(x.size)
        ahead = [np.asarray(self.output(x + shift)).ravel() for shift in shifts]
        behind = [np.asarray(self.output(x - shift)).ravel() for shift in shifts]
        return (np.array(ahead) - np.array(behind)).T / (2 * step)


@pytest.fixture(scope="module")
def gradient() -> Gradient:
    return Gradient(load_robot("aerobat"))


POINTS = {
    "at rest": {},
    "zero incidence": {"x": 3.0},
    "sinking": {"z": -2.0},
    "inside the switch": {"x": 0.05, "z": 0.04, "pitch": 1.0},
    "at its seam": {"x": 0.1, "z": -0.1},
    "stalled": {"x": 3.0, "z": -1.5, "left_plunge": -5.0},
    "backward": {"x": -3.0, "z": 1.0, "left_plunge": 9.0},
    "along the span": {"y": 2.0},
}


@pytest.mark.parametrize("point", list(POINTS))
def test_derivatives_are_finite_and_those_of_differences(gradient: Gradient, point: str) -> None:
    v = gradient.aero.robot.coordinates(**POINTS[point])
    x = gradient.point(np.full(14, 0.1), v, np.full(10, 0.2))
    exact = np.asarray(gradient.jacobian(x))
    assert np.isfinite(exact).all()
    # rounding over the step, and third derivatives near rest times its square
    scale = max(1.0, np.abs(exact).max())
    assert np.allclose(exact, gradient.differences(x), rtol=1e-5, atol=3e-6 * scale)


def test_derivatives_at_random_states(gradient: Gradient, rng: np.random.Generator) -> None:
    for _ in range(3):
        q, v = rng.normal(scale=0.4, size=14), rng.normal(scale=3.0, size=14)
        x = gradient.point(q, v, rng.normal(size=10))
        exact = np.asarray(gradient.jacobian(x))
        scale = max(1.0, np.abs(exact).max())
        assert np.allclose(exact, gradient.differences(x), rtol=1e-5, atol=3e-6 * scale)
