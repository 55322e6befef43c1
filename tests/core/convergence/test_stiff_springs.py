"""Springs that answer faster than a step: order of the implicit steps, energy, and refusals."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from tests.robots import FLAPPER

import patagium as pt
from patagium.robot import Robot, load_robot_text
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
        robot, pt.QuasiSteady(robot), gait, duration=0.01, time_step=STEP, v=robot.velocities(x=5.0)
    )
    angle = flight.q.sel(dof="left_feather").values
    assert angle[0] == 0 and angle[-1] == pytest.approx(np.radians(5), abs=1e-6)
    assert flight.attrs["energy_audit"] > 0.1  # the energy of the deflected spring is lost


def test_a_rate_that_is_not_finite_gives_a_state_that_is_not():
    step = LobattoStep()
    for broken in (np.nan, np.inf):
        found = step(lambda x, place, b=broken: x * b, np.ones(2), 0, STEP)
        assert np.isnan(found).all()
