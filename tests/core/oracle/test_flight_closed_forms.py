"""Flights with a closed form: free fall, a still robot on its stand, a flapped plate."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.dynamics import Dynamics

NO_AIR = 1e-30  # density [kg/m^3]


@pytest.fixture(scope="module")
def robot():
    return pt.load_robot("aerobat")


def vacuum(robot):
    return pt.QuasiSteady(robot, pt.Air(density=NO_AIR))


def weight(robot):
    return robot.gravity * sum(body.mass for body in robot.bodies)


def test_free_fall_is_a_parabola(robot):
    start = robot.coordinates(x=1.0, y=-2.0, z=10.0)
    velocity = robot.coordinates(x=3.0, y=0.5, z=2.0)
    flight = pt.simulate(
        robot, vacuum(robot), pt.gaits.still(robot), duration=0.5, time_step=5e-4,
        q=start, v=velocity,
    )  # fmt: skip
    time = flight.time.values[:, None]
    expected = start[:3] + velocity[:3] * time - [0.0, 0.0, robot.gravity / 2] * time**2
    # exact for Runge-Kutta: rounding of 1,000 steps
    np.testing.assert_allclose(flight.q.values[:, :3], expected, atol=1e-12)
    assert np.abs(flight.q.values[:, 3:]).max() < 1e-12
    assert flight.attrs["energy_audit"] < 1e-12


@pytest.mark.parametrize("attitude", [{}, {"roll": 0.4, "pitch": -0.7, "yaw": 2.0}])
def test_a_still_robot_rests_its_weight_on_the_mount(robot, attitude):
    q = robot.coordinates(x=1.0, y=2.0, z=3.0, **attitude)
    flight = pt.simulate(
        robot, vacuum(robot), pt.gaits.still(robot), duration=1e-2, time_step=1e-3, q=q,
        mount=pt.mounts.fixed(),
    )  # fmt: skip
    center = Dynamics(robot).center_of_mass(q)
    force = np.array([0.0, 0.0, weight(robot)])
    wrench = np.concatenate([force, np.cross(center, force)])
    # a few hundred roundings of numbers of order one
    np.testing.assert_allclose(flight.mount_wrench.values[-1], wrench, atol=1e-13)
    assert np.array_equal(flight.q.values, np.tile(q, (11, 1)))
    assert np.abs(flight.mount_work.values).max() == 0.0


def test_a_flapping_plate_pulls_on_its_stand_as_newton_says():
    """Root reaction of a wing flapped about its root: rate of momentum less weight and air.

    m z'' of its center of mass c = 0.1 m out, both wings mirrored: z = 2 c sin(phi).
    """
    robot = pt.load_robot("yeo-wing")
    aero = pt.QuasiSteady(robot, pt.Air(wind=(-2.9, 0.0, 0.0)))
    gait = pt.gaits.sinusoidal(robot, frequency=3.3, plunge=0.38)
    flight = pt.simulate(robot, aero, gait, duration=0.3, time_step=1e-3)
    plunge = robot.index("left_plunge")
    phi, rate, turn = (flight[k].values[:, plunge] for k in ("q", "v", "a"))
    mass, arm = robot.bodies[0].mass, robot.bodies[0].center_of_mass[1]
    lift = flight.strip_force.values[:, :, 2].sum(axis=1)
    rise = 2 * mass * arm * (turn * np.cos(phi) - rate**2 * np.sin(phi))
    force = flight.mount_wrench.values[:, 2]
    expected = rise + weight(robot) - lift
    np.testing.assert_allclose(force, expected, atol=1e-13)  # roundings of newtons
    drag = flight.strip_force.values[:, :, 0].sum(axis=1)
    np.testing.assert_allclose(flight.mount_wrench.values[:, 0], -drag, atol=1e-13)
    assert flight.attrs["mount"] == "fixed"
    assert not flight.mount_force.values.any()  # no coordinate of the robot's is held
    assert flight.attrs["momentum_audit"] < 1e-8  # fourth order at 1e-3 s
