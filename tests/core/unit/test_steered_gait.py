"""A gait that is steered: continuous, its derivatives exact, never beyond what was asked for."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import Polynomial

import patagium as pt
from patagium.errors import ParameterError
from patagium.simulation.gaits import check_gait
from patagium.simulation.simulator import Simulator
from patagium.simulation.steered_gait import largest_amplitude, steerable_gait

ROBOT = pt.load_robot("aerobat")


def a_gait():
    phase, offset = {"elbow": 0.7}, {"plunge": 0.1}
    return pt.gaits.sinusoidal(
        ROBOT, frequency=5.0, plunge=0.5, elbow=0.3, phase=phase, offset=offset
    )


def on_its_way():
    """Asked for while the last answer is still under way."""
    gait = steerable_gait(a_gait())
    for time, frequency, amplitude in ((0.2, 8.0, 1.3), (0.31, 3.0, 0.2), (0.35, 6.0, 1.0)):
        gait = gait.command(time, frequency, amplitude)
    return gait


@pytest.mark.parametrize("own", [a_gait(), pt.gaits.linkage(ROBOT, frequency=7.0)])
def test_unsteered_it_is_the_gait_to_the_last_bit(own):
    times = np.linspace(0.0, 3.0, 1001)
    for part in ("position", "velocity", "acceleration"):
        found = getattr(steerable_gait(own).motion(times), part)
        np.testing.assert_array_equal(found, getattr(own.motion(times), part))
    assert steerable_gait(own).period == own.period


def test_velocities_and_accelerations_are_derivatives():
    gait, step = on_its_way(), 1e-5
    for time in (0.1, 0.23, 0.32, 0.347, 0.36, 0.7):
        at = time + step * np.arange(-2, 3)
        motion = gait.motion(at)
        for what, rate in (("position", "velocity"), ("velocity", "acceleration")):
            values = getattr(motion, what)
            for joint in range(values.shape[1]):
                slope = Polynomial.fit(at - time, values[:, joint], 4).deriv()(0.0)
                # fourth order: error of the differences is their rounding, 1e-16 / step
                assert slope == pytest.approx(getattr(motion, rate)[2, joint], abs=3e-8 / 1e-2)


def test_position_velocity_and_acceleration_go_on_where_it_is_asked():
    gait = on_its_way()
    for piece in gait.pieces[1:]:
        sides = gait.motion([np.nextafter(piece.time, 0.0), piece.time])
        for part in (sides.position, sides.velocity, sides.acceleration):
            scale = np.abs(part).max()
            assert np.abs(part[1] - part[0]).max() < 1e-11 * scale  # rounding


def test_it_settles_where_it_was_asked_to_and_stays_between():
    gait = steerable_gait(a_gait()).command(0.1, 12.0, 0.5)
    times = np.linspace(0.1, 2.0, 2000)
    seen = np.array([gait.command_at(float(t)) for t in times])
    assert (np.diff(seen[:, 0]) >= 0).all() and (np.diff(seen[:, 1]) <= 0).all()
    assert seen[0] == pytest.approx((5.0, 1.0))
    assert gait.command_at(0.1 + 0.25)[0] == pytest.approx(12.0, rel=0.01)  # within about a beat
    assert seen[-1] == pytest.approx((12.0, 0.5), rel=1e-12)
    late = gait.motion(1.5 + np.linspace(0, 1 / 12, 200)).position
    joint = list(gait.joints).index("left_plunge")
    assert late[:, joint].max() - late[:, joint].min() == pytest.approx(0.5, rel=1e-3)  # 200 times
    assert gait.period == pytest.approx(1 / 12)
    again = gait.motion(1.5 + np.array([0.0, gait.period]))
    np.testing.assert_allclose(again.position[1], again.position[0], atol=1e-6)


def test_the_limits_of_the_joints_are_kept():
    count = len(ROBOT.lower)
    limited = replace(ROBOT, lower=(-0.65,) * count, upper=(0.8,) * count)
    gait = steerable_gait(a_gait())
    assert largest_amplitude(ROBOT, gait) == np.inf  # its file has no limits
    most = largest_amplitude(limited, gait)
    assert most == pytest.approx(0.7 / 0.5, rel=1e-5)  # plunge, about 0.1; 2000 times
    at_most = gait.command(0.0, 5.0, most)
    position = at_most.motion(np.linspace(0.0, 3.0, 20001)).position
    assert position.min() >= -0.65 and position.max() <= 0.8 + 1e-6
    assert position.max() > 0.8 - 1e-4


def test_what_cannot_be_is_refused():
    gait = steerable_gait(a_gait()).command(0.5, 5.0, 1.0)
    for words in ((0.4, 5.0, 1.0), (0.6, 0.0, 1.0), (0.6, 5.0, -0.1), (np.nan, 5.0, 1.0)):
        with pytest.raises(ParameterError):
            gait.command(*words)
    with pytest.raises(ParameterError, match="one that moves"):
        steerable_gait(pt.gaits.still(ROBOT))
    check_gait(ROBOT, gait)
    json.dumps(gait.describe())


def flown(pieces, steer=None):
    gait = steerable_gait(a_gait())
    aero, start = pt.QuasiSteady(ROBOT, pt.Air()), ROBOT.velocities(x=3.0)
    flying = Simulator(ROBOT, aero, gait, duration=0.2, time_step=1e-4, v=start)
    for piece in pieces:
        flying.advance(piece)
        if steer is not None and flying.time == pytest.approx(0.1):
            gait = gait.command(flying.time, *steer)
            flying.steer(gait)
    return flying.flight()


def test_a_flight_in_pieces_is_the_flight():
    aero, start = pt.QuasiSteady(ROBOT, pt.Air()), ROBOT.velocities(x=3.0)
    whole = pt.simulate(ROBOT, aero, a_gait(), duration=0.2, time_step=1e-4, v=start)
    parts = flown([1, 7, 992, 333, 2000])
    for name in whole.data_vars:
        np.testing.assert_array_equal(parts[name].values, whole[name].values)
    assert parts.attrs["outcome"] == "COMPLETED" and pt.simulation.gait_period(parts) == 0.2


def test_a_flight_follows_what_is_asked_for():
    flight = flown([1000, 1000], (9.0, 0.6))
    plunge = flight["q"].sel(dof="left_plunge").values
    rate = flight["v"].sel(dof="left_plunge").values
    slope = np.gradient(plunge, 1e-4)
    assert np.abs(slope - rate)[1:-1].max() < 1e-3  # second differences at 1e-4 s
    before = flown([2000])["q"].sel(dof="left_plunge").values
    np.testing.assert_array_equal(plunge[:1001], before[:1001])
    assert np.abs(plunge - before).max() > 0.05
    assert flight.attrs["energy_audit"] < 1e-6
    assert json.loads(flight.attrs["gait"])["asked"][-1]["frequency"] == 9.0


def test_a_gait_that_would_jump_is_refused():
    aero = pt.QuasiSteady(ROBOT, pt.Air())
    flying = Simulator(ROBOT, aero, a_gait(), duration=0.2, time_step=1e-4)
    flying.advance(300)
    with pytest.raises(ParameterError, match="a jump of"):
        flying.steer(pt.gaits.sinusoidal(ROBOT, frequency=6.0, plunge=0.5))
