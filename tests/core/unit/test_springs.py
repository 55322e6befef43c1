"""Springs of joints: the oscillator in closed form, energy, units, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from tests.robots import FLAPPER

import patagium as pt
from patagium.errors import ParameterError, RobotFileError
from patagium.robot import load_robot_text

PENDULUM = """
name: pendulum
gravity: 0
bodies:
  arm:
    joints:
      - {name: hinge, axis: y, passive: true, stiffness: 0.2 N m/rad, rest: 0.3 rad}
    mass: 0.1 kg
    center_of_mass: [0.2, 0, 0]
    shape: {type: box, size: [0.4 m, 0.01 m, 0.01 m]}
"""
PASSIVE = FLAPPER.replace(
    "{name: left_feather, axis: y, limits: [-60 deg, 60 deg]}",
    "{name: left_feather, axis: y, passive: true, stiffness: 0.002 N m/deg, rest: 5 deg,"
    " damping: 1e-4 N m s/rad}",
)


@pytest.mark.usefixtures("interpreted")
def test_a_sprung_pendulum_swings_as_in_closed_form():
    robot = load_robot_text(PENDULUM)
    inertia = pt.Dynamics(robot).mass_matrix(np.zeros(1))[0, 0]
    rate, air = np.sqrt(0.2 / inertia), pt.Air(density=1e-12)
    period, errors = 2 * np.pi / rate, []
    for steps in (50, 100):
        flight = pt.simulate(
            robot, pt.QuasiSteady(robot, air), pt.gaits.still(robot),
            duration=2 * period, time_step=period / steps, q=[0.5],
        )  # fmt: skip
        expected = 0.3 + 0.2 * np.cos(rate * flight["time"].to_numpy())
        errors.append(np.abs(flight.q.values[:, 0] - expected).max())
    assert errors[1] < 1e-5  # of .2 rad: (2 pi / 100)^5 / 120 a step, 200 steps
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.2)  # fourth order


@pytest.mark.usefixtures("interpreted")
def test_gravity_and_springs_are_the_gradient_of_the_potential():
    robot = load_robot_text(PASSIVE)
    dynamics, rng = pt.Dynamics(robot), np.random.default_rng(0)
    q, step = rng.normal(size=robot.dof), 1e-6
    slope = [
        (dynamics.potential_energy(q + step * way) - dynamics.potential_energy(q - step * way))
        / (2 * step)
        for way in np.eye(robot.dof)
    ]
    np.testing.assert_allclose(dynamics.gravity(q), slope, atol=1e-8)  # rounding over the step


def test_a_passive_wing_keeps_the_balance_of_energy_and_its_spring_turns_it():
    robot = load_robot_text(PASSIVE)
    assert robot.stiffness[robot.index("right_feather")] == pytest.approx(np.degrees(0.002))
    assert robot.rest[robot.index("right_feather")] == pytest.approx(np.radians(5))
    gait, turned = pt.gaits.sinusoidal(robot, frequency=6.0, plunge=0.6), []
    for stiffness in (np.degrees(0.002), np.degrees(0.02)):
        names = {f"{side}_feather.stiffness": stiffness for side in ("left", "right")}
        stiff = robot.with_parameters(names)
        flight = pt.simulate(
            stiff, pt.QuasiSteady(stiff), gait, duration=0.5, time_step=1e-4,
            v=stiff.velocities(x=5.0),
        )  # fmt: skip
        exchanged = np.abs(flight["air_work"].values).max()
        assert np.abs(flight["energy_residual"].values).max() < 1e-8 * exchanged
        feather = flight.q.sel(dof="left_feather").values
        np.testing.assert_allclose(feather, flight.q.sel(dof="right_feather"), atol=1e-9)
        turned.append(np.ptp(feather[2500:]))
    assert turned[0] > 3 * turned[1] > 0


def test_passive_springs_start_at_rest():
    robot = load_robot_text(PASSIVE)
    assert robot.resting == pytest.approx(
        {f"{side}_feather": np.radians(5) for side in ("left", "right")}
    )
    flight = pt.simulate(robot, pt.QuasiSteady(robot), pt.gaits.still(robot), duration=1e-3)
    np.testing.assert_allclose(flight.q.sel(dof="left_feather")[0], np.radians(5))
    assert load_robot_text(FLAPPER).resting == {}


def test_a_driven_joint_pays_for_its_spring():
    plain = load_robot_text(FLAPPER)
    sprung = load_robot_text(
        FLAPPER.replace("limits: [-60 deg, 60 deg]}", "limits: [-60 deg, 60 deg], stiffness: 0.1}")
    )
    gait = pt.gaits.sinusoidal(plain, frequency=6.0, plunge=0.6, feather=0.2)
    flights = [
        pt.simulate(r, pt.QuasiSteady(r), gait, duration=0.1, time_step=5e-4)
        for r in (plain, sprung)
    ]
    more = flights[1].u1 - flights[0].u1
    for name in ("left_plunge", "right_feather"):
        np.testing.assert_allclose(more.sel(dof=name), 0.1 * flights[1].q.sel(dof=name), atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("stiffness: 0.2 N m/rad", "stiffness: -1", "not negative"),
        ("stiffness: 0.2 N m/rad, ", "", "a stiffness where there is a rest"),
        ("0.2 N m/rad", "0.2 N/m", "stiffness"),
        (
            "rest: 0.3 rad",
            "rest: 50 deg, limits: [-40 deg, 40 deg]",
            "rest: .*-40 to 40 deg",
        ),
        ("rest: 0.3 rad", "limits: [10 deg, 40 deg]", "rest: .*10 to 40 deg, found 0 deg"),
    ],
)
def test_springs_that_are_none_are_refused(old, new, words):
    with pytest.raises(RobotFileError, match=words):
        load_robot_text(PENDULUM.replace(old, new))


def test_a_driven_joint_may_have_a_preload_beyond_its_limits():
    text = PENDULUM.replace("passive: true, ", "").replace("rest", "limits: [-0.1, 0.1], rest")
    assert load_robot_text(text).rest == (0.3,)


@pytest.mark.parametrize("name", ["hinge.rest", "hinge.damping"])
def test_a_zero_cannot_be_estimated_and_the_message_says_why(name):
    """It said that this was no number of the robot, and meant another."""
    robot = load_robot_text(FLAPPER.replace("axis: y, limits", "axis: y, stiffness: 1, limits"))
    name = name.replace("hinge", "left_feather")
    assert robot.with_parameters({name: 0.1})
    with pytest.raises(ParameterError, match="is not 0 in the robot's file .*a first guess there"):
        pt.GreyBox(pt.QuasiSteady(robot), {name: 0.1})


def test_springs_go_along_onto_an_arm():
    arm, robot = pt.load_robot("ur5e"), load_robot_text(PASSIVE)
    composed = robot.mounted_on(arm, "tool")
    place = composed.index("left_feather")
    assert composed.stiffness[place] == pytest.approx(np.degrees(0.002))
    assert not any(composed.stiffness[: arm.dof])
