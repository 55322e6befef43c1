"""Scaling the quaternion to length one after each step costs the integrator no order."""

from __future__ import annotations

import numpy as np

import patagium as pt


def test_the_order_is_four_through_a_tumble(glider):
    """In air too thin to matter: the narrow switches of a section would hide the order."""
    robot = glider("quaternion")
    aero = pt.QuasiSteady(robot, pt.Air(density=1e-9))
    gait = pt.gaits.sinusoidal(robot, frequency=6.0, left_plunge=0.3, right_plunge=0.28)

    def end(steps):
        flight = pt.simulate(
            robot, aero, gait, duration=0.3, time_step=0.3 / steps,
            q=robot.coordinates(pitch=-0.8), v=robot.velocities(roll=40.0, pitch=-25.0, yaw=10.0),
        )  # fmt: skip
        return np.concatenate([flight[k].values[-1].ravel() for k in ("q", "v", "joint_work")])

    exact = end(6400)
    errors = [np.abs(end(steps) - exact).max() for steps in (100, 200, 400)]
    slopes = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(np.abs(slopes - 4.0) < 0.02), (errors, slopes)  # the range of h^4 is reached
