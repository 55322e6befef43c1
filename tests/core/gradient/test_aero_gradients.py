"""Derivatives of the air's force: AD against differences, also where signs switch."""

from __future__ import annotations

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
from patagium.robot import load_robot

MODELS = {
    "dickinson": {"polar": DickinsonPolar()},
    "smooth": {"polar": SmoothPolar()},
    "reynolds": {"polar": ReynoldsPolar()},
    "rotational": {"polar": DickinsonPolar(), "rotational": True},
}


class Gradient:
    """Generalized force as a function of x = [q, v, wind, parameters], and its Jacobian."""

    def __init__(self, aero: Aerodynamics) -> None:
        n, count = aero.robot.dof, len(aero.parameters)
        x = ca.SX.sym("x", 2 * n + 3 + count)
        q, v, wind, parameters = ca.vertsplit(x, [0, n, 2 * n, 2 * n + 3, 2 * n + 3 + count])
        force = aero.expressions(aero.robot, q, v, ca.SX(0, 1), wind, parameters).generalized_force
        self.force = ca.Function("force", [x], [force])
        self.jacobian = ca.Function("jacobian", [x], [ca.jacobian(force, x)])
        self.hessian = ca.Function("hessian", [x], [ca.jacobian(ca.gradient(ca.sum1(force), x), x)])
        self.aero, self.dof = aero, n

    def point(self, q: np.ndarray, v: np.ndarray, wind: tuple[float, ...]) -> np.ndarray:
        return np.concatenate([q, v, wind, self.aero.parameters])

    def differences(self, x: np.ndarray, step: float = 1e-5) -> np.ndarray:
        columns = []
        for k in range(x.size):
            shift = np.zeros(x.size)
            shift[k] = step * min(1.0, abs(x[k]) or 1.0)  # a viscosity is of the step's own size
            ahead, behind = np.asarray(self.force(x + shift)), np.asarray(self.force(x - shift))
            columns.append((ahead - behind).ravel() / (2 * shift[k]))
        return np.stack(columns, axis=-1)


@pytest.fixture(scope="module", params=list(MODELS))
def gradient(request: pytest.FixtureRequest) -> Gradient:
    return Gradient(QuasiSteady(load_robot("aerobat"), Air(), **MODELS[request.param]))


def speeds(**values: float) -> np.ndarray:
    return load_robot("aerobat").coordinates(**values)


POINTS = {
    "at rest": (np.zeros(14), np.zeros(14), (0.0, 0.0, 0.0)),
    "at rest in wind": (np.zeros(14), np.zeros(14), (-3.0, 0.0, 0.0)),
    "side wind along the span": (np.zeros(14), np.zeros(14), (0.0, 2.0, 0.0)),
    "zero incidence": (np.zeros(14), speeds(x=3.0), (0.0, 0.0, 0.0)),
    "forward to backward": (np.zeros(14), speeds(z=-2.0), (0.0, 0.0, 0.0)),
    "inside the switch": (np.zeros(14), speeds(x=0.05, z=0.04, pitch=1.0), (0.0, 0.0, 0.0)),
    "at its seam": (np.zeros(14), speeds(x=0.1, z=-0.1), (0.0, 0.0, 0.0)),
    "backward": (np.full(14, 0.2), speeds(x=-3.0, z=1.0, left_plunge=9.0), (0.0, 0.0, 0.0)),
}


@pytest.mark.parametrize("point", list(POINTS))
def test_derivatives_are_finite_and_those_of_differences(gradient: Gradient, point: str) -> None:
    x = gradient.point(*POINTS[point])
    exact = np.asarray(gradient.jacobian(x))
    assert np.isfinite(exact).all()
    assert np.isfinite(np.asarray(gradient.hessian(x))).all()
    differences = gradient.differences(x)
    # third derivatives inside the 0.1 m/s switch reach 1e4 N s^3/m^3: step^2 of them
    assert np.allclose(exact, differences, rtol=1e-5, atol=2e-6 * max(1.0, np.abs(exact).max()))


def test_derivatives_at_random_states(gradient: Gradient, rng: np.random.Generator) -> None:
    for _ in range(3):
        q, v = rng.normal(scale=0.4, size=14), rng.normal(scale=3.0, size=14)
        x = gradient.point(q, v, tuple(rng.normal(size=3)))
        exact = np.asarray(gradient.jacobian(x))
        assert np.allclose(exact, gradient.differences(x), rtol=1e-5, atol=1e-6)
