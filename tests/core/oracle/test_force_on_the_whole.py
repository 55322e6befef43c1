"""Force and moment of the air on the whole robot, from generalized forces, against the strips."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.dynamics.dynamics import poses_at
from patagium.simulation import robot_of
from patagium.viewer.replay import total_force

pytestmark = pytest.mark.usefixtures("interpreted")


def _flown(attitude: Literal["euler", "quaternion"] = "euler") -> xr.Dataset:
    robot = pt.load_robot("aerobat").with_attitude(attitude)
    speed = np.zeros(robot.dof)
    speed[:6] = (3.0, 0.5, 0.0, -1.5, 0.3, 2.0)
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6, left_feather=0.2)
    aero = pt.QuasiSteady(robot, pt.Air())
    return pt.simulate(robot, aero, gait, duration=0.15, time_step=5e-4, v=speed)


@pytest.mark.parametrize("attitude", ["euler", "quaternion"])
def test_force_and_moment_are_those_of_the_strips(
    attitude: Literal["euler", "quaternion"],
) -> None:
    flight = _flown(attitude)
    robot = robot_of(flight)
    q = flight["q"].values
    position, rotation = poses_at(robot, q)
    center = pt.Dynamics(robot).batch.center_of_mass(q)
    whole = total_force(
        robot,
        tuple(robot.dof_names),
        flight["aero_force"].values,
        q,
        rotation[:, 0],
        center - position[:, 0],
    )
    assert whole is not None and whole[1] is not None
    force, point = flight["strip_force"].values, flight["strip_point"].values
    np.testing.assert_allclose(whole[0], force.sum(axis=1), atol=1e-12)
    expected = np.cross(point - center[:, None], force).sum(axis=1)
    scale = np.abs(expected).max(axis=0)
    assert (scale > 1e-4).all()  # about every axis
    np.testing.assert_allclose(whole[1], expected, atol=1e-11)  # rounding


def test_parts_of_the_force_tell_what_they_can() -> None:
    robot = pt.load_robot("aerobat")
    q, turn, arm = np.zeros((2, robot.dof)), np.stack([np.eye(3)] * 2), np.zeros((2, 3))
    some = total_force(robot, ("x", "y", "z"), np.ones((2, 3)), q, turn, arm)
    assert some is not None and some[1] is None
    assert total_force(robot, ("x", "pitch"), np.ones((2, 2)), q, turn, arm) is None
    fixed = pt.load_robot("yeo-wing")
    assert total_force(fixed, tuple(fixed.dof_names), np.ones((2, fixed.dof)), q, turn, arm) is None
