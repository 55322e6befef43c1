"""A run whose step was too long is told so; one that left its range by itself is not."""

from __future__ import annotations

import re
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from tests.robots import FLAPPER

import patagium as pt
from patagium.errors import Outcome, SimulationFailed
from patagium.native import load_functions
from patagium.robot import load_robot_text
from patagium.simulation.runge_kutta import Equations, integrate
from patagium.simulation.state_limits import diagnose_step, growth, longest_stable_step

STEP = 0.01


def run_of(stiffness, damping, time_step=STEP, steps=2000):
    """A mass of 1 kg on a spring and a damper, and what is said of how its run ended."""
    state, row, k = ca.SX.sym("x", 2), ca.SX.sym("row", 2), ca.SX.sym("k", 2)
    none = ca.SX.sym("none", 2)
    rate = ca.vertcat(state[1], -k[0] * state[0] - k[1] * state[1])
    functions = load_functions(
        "a mass on a spring, for tests",
        lambda: [
            ca.Function("rate", [state, row, k, none], [rate]),
            ca.Function("record", [state, row, k, none], [state, row]),
        ],
        label="mass on a spring",
        many_only=["record"],
    )
    equations = Equations(
        functions["rate"], functions["record"], None, ("x", "row"),
        (np.array([stiffness, damping]), np.zeros(2)), np.full(2, -1e3), np.full(2, 1e3),
    )  # fmt: skip

    def rows(time):
        return np.zeros((len(time), 2))

    run = integrate(equations, np.array([1.0, 0.0]), rows, steps, time_step)
    cause = diagnose_step(
        equations, lambda samples, n: samples["x"][n], run.samples, rows, run.steps, steps,
        time_step,
    )  # fmt: skip
    return run, cause


@pytest.mark.parametrize(
    ("stiffness", "damping", "longest"),
    [
        (1.0, 400.0, 2.785 / 400.0),  # real axis of the stability region
        (1e5, 1e-6, 2.828 / np.sqrt(1e5)),  # imaginary axis
    ],
)
def test_a_stiff_damper_or_spring_is_named_with_the_longest_step(stiffness, damping, longest):
    run, cause = run_of(stiffness, damping)
    assert run.outcome is not Outcome.COMPLETED
    assert 0.9 * longest < cause.longest < 1.005 * longest  # two digits, rounded down
    again, _ = run_of(stiffness, damping, cause.longest)
    assert again.outcome is Outcome.COMPLETED


@pytest.mark.parametrize(("stiffness", "damping"), [(1.0, -20.0), (-900.0, 0.0), (900.0, -5.0)])
def test_a_motion_that_grows_by_itself_is_not_called_so(stiffness, damping):
    run, cause = run_of(stiffness, damping)
    assert run.outcome is Outcome.LIMIT_REACHED and cause is None


def test_growth_of_a_step_is_that_of_the_scheme():
    z = np.array([-0.5 + 0.2j])
    k1 = z
    k2 = z * (1 + k1 / 2)
    k3 = z * (1 + k2 / 2)
    k4 = z * (1 + k3)
    assert growth(z)[0] == pytest.approx(abs(1 + (k1 + 2 * k2 + 2 * k3 + k4) / 6)[0], rel=1e-14)
    assert longest_stable_step(np.array([-1.0 + 0j]), 10.0) == pytest.approx(2.785, rel=6e-3)


def test_a_flight_with_a_stiff_damper_is_told_the_step_it_takes():
    robot = pt.load_robot("aerobat")
    damped = replace(robot, damping=tuple(10 * d for d in robot.damping), source="")
    aero, gait = pt.QuasiSteady(damped), pt.gaits.sinusoidal(damped, frequency=5.0, plunge=0.4)
    forward = damped.velocities(x=4.0)
    with pytest.raises(SimulationFailed, match="velocity of pitch") as caught:
        pt.simulate(damped, aero, gait, duration=0.2, time_step=1e-3, v=forward)
    assert caught.value.outcome is Outcome.STEP_TOO_LONG
    assert caught.value.flight.attrs["outcome"] == "STEP_TOO_LONG"
    longest = float(re.search(r"shorten the time step to (\S+) s", str(caught.value))[1])
    assert 1e-5 < longest < 1e-3
    steps = int(np.ceil(0.2 / longest))
    pt.simulate(damped, aero, gait, duration=0.2, time_step=0.2 / steps, v=forward)


def test_a_chosen_step_that_proves_too_long_is_shortened_but_not_under_a_controller():
    """The controller was called from the start again, with what it kept of the broken flight."""
    passive = "passive: true, damping: 1e-7 N m s/rad, limits"
    text = FLAPPER.replace("left_feather, axis: y, limits", f"left_feather, axis: y, {passive}")
    text = text.replace("mass: 4 g", "mass: 20 mg")
    text = text.replace("leading: 2 cm, trailing: -6", "leading: 0 cm, trailing: -8")
    robot, called = load_robot_text(text), []
    air = pt.Air(gust=pt.air.RampGust((-20.0, 0.0, 0.0), start=0.25, length_time=0.05))
    aero, gait = pt.QuasiSteady(robot, air), pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.0)
    given = {"duration": 0.3, "mount": pt.mounts.fixed(), "q": robot.coordinates(pitch=-0.1)}
    flight = pt.simulate(robot, aero, gait, **given)
    assert flight.attrs["time_step"] < 5e-4  # a 400th of the beat
    with pytest.raises(SimulationFailed, match="shorten the time step to"):
        pt.simulate(robot, aero, gait, controller=lambda t, _: called.append(t), **given)
    assert called[0] == 0.0 and np.all(np.diff(called) > 0)


@pytest.mark.usefixtures("interpreted")
def test_a_flight_the_air_drives_out_of_range_is_not_called_so():
    robot = replace(pt.load_robot("aerobat"), damping=(0.0,) * 14, source="")
    pushing = replace(pt.QuasiSteady(robot), air=pt.Air(wind=(0.0, 0.0, 3.0)))
    with pytest.raises(SimulationFailed) as caught:
        pt.simulate(
            robot, pushing, pt.gaits.still(robot), duration=2.0, time_step=1e-4,
            v=robot.velocities(x=4.0, pitch=5.0),
        )  # fmt: skip
    assert caught.value.outcome is Outcome.LIMIT_REACHED
