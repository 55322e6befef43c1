"""DeLaurier's strips as an object: the same protocol as any model, descriptions, refusals."""

from __future__ import annotations

import json

import casadi as ca
import numpy as np
import pytest

from patagium.aerodynamics import Air, DeLaurier
from patagium.aerodynamics.description import aero_from_description
from patagium.aerodynamics.model import aero_functions, compile_aero
from patagium.errors import ParameterError
from patagium.learning.models.physical import unit_of
from patagium.robot import Robot, load_robot
from patagium.simulation import gaits, load_flight, save_flight, simulate


@pytest.fixture(scope="module")
def aerobat() -> Robot:
    return load_robot("aerobat")


def test_compiled_code_is_the_virtual_machine_and_batch_is_one_by_one(
    aerobat: Robot, rng: np.random.Generator
) -> None:
    aero = DeLaurier(aerobat, zero_lift_angle=-0.03)
    q, v = rng.normal(scale=0.4, size=(11, 14)), rng.normal(scale=3.0, size=(11, 14))
    z, wind = rng.normal(size=(11, aero.state_size)), rng.normal(size=(11, 3))
    constants, compiled = (aerobat.parameters, aero.parameters), compile_aero(aero)
    for function in aero_functions(aero):
        many = compiled[function.name()].batch(q, v, z, wind, *constants)
        many = many if isinstance(many, tuple) else (many,)
        for k in range(11):
            one = function.call([q[k], v[k], z[k], wind[k], *constants])
            for got, want in zip(many, one, strict=True):
                want = np.array(want)
                want = want.ravel() if want.shape[1] == 1 else want
                assert np.allclose(got[k], want.reshape(got[k].shape), rtol=1e-12, atol=1e-12)


def test_derivatives_are_finite_and_those_of_differences(
    aerobat: Robot, rng: np.random.Generator
) -> None:
    aero = DeLaurier(aerobat)
    sizes = [14, 14, aero.state_size, 3, len(aero.parameters)]
    x = ca.SX.sym("x", sum(sizes))
    parts = ca.vertsplit(x, np.concatenate([[0], np.cumsum(sizes)]).tolist())
    air = aero.expressions(aerobat, *parts)
    output = ca.vertcat(air.generalized_force, air.state_derivative)
    function = ca.Function("f", [x], [output])
    jacobian = ca.Function("j", [x], [ca.jacobian(output, x)])
    rest = np.concatenate([np.zeros(28 + aero.state_size + 3), aero.parameters])
    assert np.isfinite(np.asarray(jacobian(rest))).all()
    for scale in (0.05, 3.0):  # inside the switch, and beyond
        point = rest.copy()
        point[:28] = rng.normal(scale=scale, size=28)
        exact, shifts = np.asarray(jacobian(point)), 1e-6 * np.eye(len(point))
        numeric = np.array(
            [np.asarray(function(point + s) - function(point - s)).ravel() / 2e-6 for s in shifts]
        ).T
        assert np.allclose(exact, numeric, rtol=1e-5, atol=3e-6 * max(1.0, np.abs(exact).max()))


def test_a_flight_carries_its_lags_and_its_model(aerobat: Robot, tmp_path) -> None:
    aero = DeLaurier(aerobat, Air(wind=(-3.0, 0.0, 0.0)))
    gait = gaits.sinusoidal(aerobat, frequency=5.0, plunge=0.4)
    flight = simulate(aerobat, aero, gait, duration=0.05, time_step=1e-3)
    assert flight["aero_state"].shape == (51, 10)
    assert np.abs(flight["aero_state"].values[-1]).max() > 0.1
    assert np.abs(flight["circulation"].values[-1]).max() > 0.0
    file = save_flight(flight, tmp_path / "flight.nc")
    again = load_flight(tmp_path / "flight.nc" if file is None else file)
    assert np.array_equal(again["aero_force"], flight["aero_force"])


def test_a_description_makes_the_same_model(aerobat: Robot) -> None:
    aero = DeLaurier(aerobat, Air(density=1.1), suction_efficiency=0.9, stall_angle=0.3)
    again = aero_from_description(aerobat, json.loads(json.dumps(aero.describe())))
    assert again == aero
    assert np.array_equal(again.parameters, aero.parameters)
    words = aero.describe()
    del words["stall_angle"]
    with pytest.raises(ParameterError, match="delaurier"):
        aero_from_description(aerobat, words)


@pytest.mark.parametrize(
    ("name", "value"),
    [("lift_slope", -1.0), ("suction_efficiency", 1.1), ("zero_lift_angle", np.nan),
     ("stall_width", 0.5), ("stall_angle", 0.0), ("crossflow_drag", np.inf)],
)  # fmt: skip
def test_what_cannot_be_is_refused(aerobat: Robot, name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=name.split("_")[0]):
        DeLaurier(aerobat, **{name: value})


def test_numbers_by_wing_are_those_of_each(aerobat: Robot) -> None:
    q, v = aerobat.coordinates(), aerobat.velocities(x=4.0)
    wings = {strip.wing for strip in aerobat.strips if strip.wing.startswith("left_")}
    one = DeLaurier(aerobat, zero_lift_angle=-0.05, friction_drag=0.03)
    each = DeLaurier(aerobat, zero_lift_angle=dict.fromkeys(wings, -0.05), friction_drag=0.03)
    assert np.array_equal(each.generalized_force(q, v), one.generalized_force(q, v))
    assert aero_from_description(aerobat, json.loads(json.dumps(each.describe()))) == each
    assert {unit_of(name, aerobat) for name in each.numbers if name.startswith("zero")} == {"rad"}
    flat = DeLaurier(aerobat, friction_drag=0.03)
    names = {strip.wing: None for strip in aerobat.strips}
    mixed = DeLaurier(aerobat, zero_lift_angle={w: 0.05 * (w in wings) for w in names},
                      friction_drag=0.03)  # fmt: skip
    left = np.array([strip.wing in wings for strip in aerobat.strips])
    forces = [model.strips(q, v)["strip_force"] for model in (mixed, flat)]
    assert np.array_equal(forces[0][~left], forces[1][~left])
    assert (forces[0][left, 2] < forces[1][left, 2]).all()
    with pytest.raises(ParameterError, match="zero_lift_angle by wing"):
        DeLaurier(aerobat, zero_lift_angle={"fin": 0.0})
    with pytest.raises(ParameterError, match="friction_drag"):
        DeLaurier(aerobat, friction_drag=dict.fromkeys(wings, -1.0))
