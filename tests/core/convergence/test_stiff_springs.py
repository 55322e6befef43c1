"""Springs that answer faster than a step: order of the implicit steps, energy, and refusals."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from tests.robots import FLAPPER

import patagium as pt
from patagium.robot import Robot, load_robot_text
from patagium.simulation.flight_summary import flight_summary
from patagium.simulation.implicit_steps import LobattoStep

STEP = 1e-4
LIMIT = 2.828 / STEP
"""Fastest oscillation at which classic Runge-Kutta steps of 1e-4 s are stable [rad/s]."""


def sprung(stiffness: float) -> Robot:
    """Flapper whose wings feather against a spring [N m/rad]."""
    joint = "{name: left_feather, axis: y, limits: [-60 deg, 60 deg]}"
    spring = f"passive: true, stiffness: {stiffness!r} N m/rad, rest: 5 deg"
    assert joint in FLAPPER
    return load_robot_text(
        FLAPPER.replace(
            joint, f"{{name: left_feather, axis: y, {spring}, damping: 1e-4 N m s/rad}}"
        )
    )


def stiff(share: float) -> Robot:
    """Flapper whose springs swing at a multiple of the limit of the steps."""
    soft = sprung(1.0)
    matrix = pt.Dynamics(soft).mass_matrix(soft.coordinates())
    place = soft.dof_names.index("left_feather")
    return sprung(float((share * LIMIT) ** 2 / np.linalg.inv(matrix)[place, place]))


def flown(robot: Robot, time_step: float):
    gait = pt.gaits.sinusoidal(robot, frequency=6.0, plunge=0.6)
    rest = robot.coordinates(left_feather=np.radians(5), right_feather=np.radians(5))
    return pt.simulate(
        robot, pt.QuasiSteady(robot), gait, duration=0.1, time_step=time_step,
        q=rest, v=robot.velocities(x=5.0),
    )  # fmt: skip


def test_a_spring_twenty_times_too_stiff_is_integrated_to_the_order_of_the_steps():
    robot = stiff(20.0)
    flights = [flown(robot, STEP * k) for k in (4, 2, 1, 0.5)]
    for flight in flights[:3]:
        assert flight.attrs["stepping"] == "partitioned Lobatto IIIC"
        exchanged = np.abs(flight["air_work"].values).max()
        assert np.abs(flight["energy_residual"].values).max() < 1e-8 * exchanged
    ends = [flight.q.sel(dof=["x", "z", "pitch"]).values[-1] for flight in flights]
    errors = [np.abs(end - ends[-1]).max() for end in ends[:3]]
    assert errors[2] < 1e-10
    for coarse, fine in pairwise(errors):
        assert coarse / fine > 8  # third order at least; measured: fourth


def test_implicit_and_short_explicit_steps_give_the_same_flight():
    robot = stiff(1.5)
    implicit, explicit = flown(robot, STEP), flown(robot, STEP / 10)
    assert implicit.attrs["stepping"] != explicit.attrs["stepping"] == "partitioned RK4"
    difference = np.abs(implicit.q - explicit.q[::10].values).max("time")
    assert difference.max() < 1e-7  # springs swing by 5e-8 rad, which steps of 1e-4 s do not follow
    assert difference.sel(dof=["x", "y", "z", "roll", "pitch", "yaw"]).max() < 2e-9


def test_a_swing_too_fast_for_the_step_fades_and_the_audit_tells():
    robot = stiff(20.0)
    gait = pt.gaits.sinusoidal(robot, frequency=6.0, plunge=0.6)
    flight = pt.simulate(
        robot, pt.QuasiSteady(robot), gait, duration=0.01, time_step=STEP,
        q=robot.coordinates(), v=robot.velocities(x=5.0),
    )  # fmt: skip
    angle = flight.q.sel(dof="left_feather").values
    assert angle[0] == 0 and angle[-1] == pytest.approx(np.radians(5), abs=1e-6)
    assert 0.1 < flight.attrs["energy_audit"] < 1  # the energy of the deflected spring is lost
    assert "energy audit is" in " ".join(flight_summary(flight)["warnings"])


HINGE = """
name: hinge
gravity: 0
bodies:
  wing:
    joints: [{name: hinge, axis: y, passive: true, stiffness: 1 N m/rad}]
    mass: 1 g
    center_of_mass: [3 cm, 0, 0]
    shape: {type: point}
"""


@pytest.mark.parametrize(
    ("damping", "steps", "stepping"),
    [(0.0, 2000, "RK4"), (1.9e-5, 800, "RK4"), (1e-3, 400, "RK4"), (1.0, 400, "Lobatto IIIC")],
)
def test_the_chosen_step_keeps_a_swing_and_does_not_follow_what_only_fades(
    damping, steps, stepping
):
    """sqrt(1 N m/rad / (1 g (3 cm)^2)) = 1054 rad/s; damped by 0, 1, 53 and 53000 %."""
    text = HINGE.replace("1 N m/rad", f"1 N m/rad, damping: {damping}")
    robot = load_robot_text(text)
    flight = pt.simulate(robot, pt.QuasiSteady(robot), pt.gaits.still(robot), duration=0.4, q=[0.1])
    assert flight.attrs["stepping"] == f"partitioned {stepping}"
    assert flight.sizes["time"] - 1 == steps
    if not damping:
        energy = (flight["kinetic_energy"] + flight["potential_energy"]).values
        assert energy[-1] > 0.99 * energy[0]
        assert flight.attrs["energy_audit"] < 1e-4


def test_a_rate_that_is_not_finite_gives_a_state_that_is_not():
    step = LobattoStep()
    for broken in (np.nan, np.inf):
        found = step(lambda x, place, b=broken: x * b, np.ones(2), 0, STEP)
        assert np.isnan(found).all()


def test_a_rate_that_jumps_is_no_obstacle():
    """x' = -1e4 arctan(1e4 x) from 1 is at rest before the step of 1e-4 s ends."""
    found = LobattoStep()(lambda x, place: -1e4 * np.arctan(1e4 * x), np.ones(1), 0, STEP)
    assert abs(found[0]) < 0.1  # Newton's method without damping swings over it


def test_an_implicit_step_that_does_not_converge_says_so(monkeypatch):
    monkeypatch.setattr(LobattoStep, "_search", lambda *given: None)
    with pytest.raises(pt.errors.SimulationFailed) as failed:
        flown(stiff(20.0), STEP)
    said = "step 1 of 1000: the implicit step did not converge; shorten the time step to "
    assert said in str(failed.value) and "answers at" not in str(failed.value)
