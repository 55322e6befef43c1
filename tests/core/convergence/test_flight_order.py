"""The integrator's measured order is the claimed order, works and all."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt


@pytest.fixture(scope="module")
def end_of_flight():
    robot = pt.load_robot("aerobat")
    aero = pt.QuasiSteady(robot, pt.Air(wind=(-0.5, 0.2, 0.1)))
    gait = pt.gaits.sinusoidal(
        robot, frequency=5.0, plunge=0.4, feather=0.1, left_elbow=0.1, phase={"feather": 1.0}
    )

    def fly(time_step):
        flight = pt.simulate(
            robot,
            aero,
            gait,
            duration=0.1,
            time_step=time_step,
            q=robot.coordinates(pitch=0.1, roll=0.05),
            v=robot.coordinates(x=4.0),
        )
        works = [flight[k].values[-1] for k in ("joint_work", "air_work", "damping_work")]
        return np.concatenate([flight.q.values[-1], flight.v.values[-1], works])

    return fly


def test_the_order_is_four(end_of_flight):
    exact = end_of_flight(6.25e-6)
    steps = [2e-4, 1e-4, 5e-5]
    errors = [np.abs(end_of_flight(step) - exact).max() for step in steps]
    slopes = np.log2(np.divide(errors[:-1], errors[1:]))
    # from above: pitch damping is stiff (1,700 per s), the asymptotic range begins at 1e-4 s
    assert np.all(np.abs(slopes - 4.0) < 0.25), (errors, slopes)
