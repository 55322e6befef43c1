"""Slopes of a grey box for its numbers, through its memory too, against differences."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics.polars import table_function
from patagium.aerodynamics.trailing_vortices import horseshoe_function
from patagium.learning.models.memory import network_inputs
from patagium.native import load_functions
from patagium.robot import Robot

CHOSEN = [0, 9, 14, 22, 39]
AIR = pt.Air(wind=(-5.0, 0.2, 0.1))
ESTIMATE = {
    "density": 0.1,
    "surface_constant": 5.0,
    "lags.rate[0]": 0.02,
    "lags.lift[0]": 0.05,
    "lags.circulation[0]": 0.1,
    "section.lift_slope": 0.5,
    "section.zero_lift_angle": 0.05,
    "section.profile_drag": 0.01,
    "section.stall_begins": 0.01,
    "section.stalled.lift_amplitude": 0.1,
    "wing[0].chord": 0.01,
    "wing[1].width": 0.01,
    "wing[0].quarter_chord.x": 0.005,
    "wing.mass": 0.001,
    "wing.center_of_mass.y": 0.01,
    "gravity": 0.5,
    "wind.z": 0.3,
    "added_mass.factor": 0.2,
}


@pytest.fixture(scope="module")
def robot(one_wing: Callable[..., Robot]) -> Robot:
    return one_wing("name: plunge, axis: x", "name: feather, axis: [0, -0.8, 0.6]")


@pytest.fixture(scope="module")
def grey(robot: Robot) -> pt.GreyBox:
    early = pt.air.Section(stall_begins=0.05)
    lags = pt.air.Indicial((0.25,), (0.5,), (0.8,))
    aero = pt.LiftingLine(robot, AIR, lags=lags, section=early)
    return pt.GreyBox(aero, ESTIMATE, pt.AddedMass(robot, AIR))


def log(samples: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Time and [q, v, a] of a wing that flaps, stalls now and then, and feathers."""
    time = np.linspace(0.0, 0.2, samples)
    turn = 30 * time[:, None] + [0.3, 1.7]
    size = np.array([0.8, 0.3])
    return time, np.hstack(
        [size * np.sin(turn), 30 * size * np.cos(turn), -900 * size * np.sin(turn)]
    )


def test_slopes_are_those_of_a_memory_that_was_always_at_other_weights(grey: pt.GreyBox) -> None:
    """dy/dW through lags from the first sample on, their steady start included."""
    time, x = log()
    weights = 0.3 * np.random.default_rng(0).normal(size=grey.size)

    def ends(w: np.ndarray) -> np.ndarray:
        return grey.evaluate(network_inputs(grey, w, time, x)[CHOSEN], w)

    row = network_inputs(grey, weights, time, x)[CHOSEN]
    exact = np.array([grey.linearized(grey.encode_one(k), weights)[1] for k in row])
    shifts = 1e-5 * np.eye(grey.size)
    found = np.array([(ends(weights + h) - ends(weights - h)) / 2e-5 for h in shifts])
    found = np.moveaxis(found, 0, -1)
    scale = np.abs(exact).max(axis=(0, 1))
    assert (scale > 1e-6).all()  # every number moves something
    assert (np.abs(found - exact).max(axis=(0, 1)) < 1e-6 * scale + 1e-9).all()  # step squared


def test_the_derivative_of_an_inner_call_has_a_kernel() -> None:
    """Horseshoes and tables have one, along all their inputs, as CasADi has them."""
    shoes, table = horseshoe_function((2, 1)), table_function(4, 1)

    def build() -> list[ca.Function]:
        made = []
        for name, callee in (("of_shoes", shoes), ("of_table", table)):
            x = ca.SX.sym("x", sum(callee.numel_in(k) for k in range(callee.n_in())))
            d, parts, start = ca.SX.sym("d", x.numel()), [], 0
            for k in range(callee.n_in()):
                shape = callee.size_in(k)
                parts.append(ca.reshape(x[start : start + callee.numel_in(k)], *shape))
                start += callee.numel_in(k)
            y = ca.vertcat(*[ca.vec(out) for out in callee.call(parts, False, True)])
            slope = ca.densify(ca.jtimes(y, x, d))
            made.append(ca.Function(name, [x, d], [slope], ["x", "d"], ["slope"]))
        return made

    functions = load_functions("derivatives of inner calls", build, label="derivatives")
    draw = np.random.default_rng(3)
    for name, function in functions.items():
        count = function.size_in[0][0]
        x, d = draw.uniform(0.2, 1.0, size=(2, 20, count))
        if name == "of_table":
            x[:, :5] = [1.3, 0.0, 1.0, 2.0, 3.0]
        expected = np.array(
            [np.asarray(function.expression(*k)).ravel() for k in zip(x, d, strict=True)]
        )
        assert np.isfinite(expected).all()
        single = np.array([function(*k) for k in zip(x, d, strict=True)]).reshape(20, -1)
        many = function.batch(x, d).reshape(20, -1)
        for found in (single, many):
            assert np.allclose(found, expected, rtol=1e-10, atol=1e-12)  # rounding
