"""A gait that is steered: continuous, its derivatives exact, never beyond what was asked for."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

import patagium as pt
from patagium.errors import ParameterError, ShapeError
from patagium.robot import preset_names
from patagium.robot.model import Actuator
from patagium.simulation.gaits import check_gait
from patagium.simulation.steered_gait import SteeredGait

PRESET = pt.load_robot("aerobat")
ROBOT = replace(PRESET, actuators={})  # answers as gaits do where no file says more
FREE = (-np.inf, np.inf)


def with_actuators(robot=ROBOT, **limits):
    """The robot with ranges, rates and response times of commands, by their names."""
    names = ("range", "rate_limit", "response_time")
    free = dict(zip(names, (FREE, np.inf, None), strict=True))
    return replace(
        robot,
        actuators={name: Actuator("", cost=1.0, **free | given) for name, given in limits.items()},
    )


def a_gait():
    phase, offset = {"elbow": 0.7}, {"plunge": 0.1}
    return pt.gaits.sinusoidal(
        ROBOT, frequency=5.0, plunge=0.5, elbow=0.3, phase=phase, offset=offset
    )


def on_its_way():
    """Asked for while the last answer is still under way."""
    robot = with_actuators(
        elbow_offset={"response_time": 0.1}, frequency={"rate_limit": 20.0},
        plunge_amplitude={"rate_limit": 3.0},
    )  # fmt: skip
    gait = SteeredGait(robot, a_gait())
    gait.command(0.2, {"frequency": 8.0, "amplitude": 1.3, "left_plunge_phase": 0.4})
    gait.command(0.31, {"frequency": 3.0, "right_plunge_amplitude": 0.2, "elbow_offset": -0.2})
    gait.command(0.35, {"frequency": 6.0, "amplitude": 1.0, "left_plunge_offset": 0.1})
    return gait


def both(frequency: float, amplitude: float) -> dict[str, float]:
    return {"frequency": frequency, "amplitude": amplitude}


@pytest.mark.parametrize("own", [a_gait(), pt.gaits.linkage(ROBOT, frequency=7.0)])
def test_unsteered_it_is_the_gait_to_the_last_bit(own):
    times = np.linspace(0.0, 3.0, 1001)
    for part in ("position", "velocity", "acceleration"):
        found = getattr(SteeredGait(ROBOT, own).motion(times), part)
        np.testing.assert_array_equal(found, getattr(own.motion(times), part))
    assert SteeredGait(ROBOT, own).period == own.period


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
    for time in (0.2, 0.31, 0.35):
        sides = gait.motion([np.nextafter(time, 0.0), time])
        for part in (sides.position, sides.velocity, sides.acceleration):
            scale = np.abs(part).max()
            assert np.abs(part[1] - part[0]).max() < 1e-11 * scale  # rounding


def test_times_in_any_order_give_what_each_gives_alone():
    gait = on_its_way()
    times = np.array([0.9, -0.1, 0.2, 0.33, np.nan, 0.36, 0.0, 0.31])
    together = gait.motion(times)
    for k, time in enumerate(times):
        alone = gait.motion(time)
        for name in ("position", "velocity", "acceleration"):
            several, one = getattr(together, name)[k], getattr(alone, name)[0]
            assert np.allclose(several, one, rtol=1e-12, atol=1e-12, equal_nan=True)  # rounding
    assert len(gait.motion([]).position) == 0


def test_it_settles_where_it_was_asked_to_and_stays_between():
    gait = SteeredGait(ROBOT, a_gait())
    gait.command(0.1, both(12.0, 0.5))
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
    assert (
        SteeredGait(ROBOT, a_gait()).largest_amplitudes.min(initial=np.inf) == np.inf
    )  # its file has no limits
    gait = SteeredGait(limited, a_gait())
    most = gait.largest_amplitudes.min(initial=np.inf)
    assert most == pytest.approx(0.7 / 0.5, rel=1e-5)  # plunge, about 0.1; 2000 times
    gait.command(0.0, both(5.0, most))
    assert gait.limited == 0
    gait.command(3.0, both(5.0, 2.0) | {"plunge_offset": 0.5})
    assert gait.limited == 1
    position = gait.motion(np.linspace(0.0, 6.0, 20001)).position
    assert position.min() >= -0.65 and position.max() <= 0.8 + 1e-6
    assert position.max() > 0.8 - 1e-4


def test_a_command_moves_the_joints_it_names_and_no_other():
    gait, own = SteeredGait(ROBOT, a_gait()), a_gait()
    gait.command(0.0, {"left_plunge_amplitude": 0.5, "elbow_offset": 0.2, "right_elbow_phase": 1.0})
    times = 2.0 + np.linspace(0.0, 0.2, 101)
    away = gait.motion(times).position - gait.mean
    alone = own.motion(times).position - gait.mean
    ahead = own.motion(times + 1.0 / (2 * np.pi * 5.0)).position - gait.mean
    place = {name: k for k, name in enumerate(gait.joints)}
    expected = alone.copy()
    expected[:, place["left_plunge"]] *= 0.5
    expected[:, place["right_elbow"]] = ahead[:, place["right_elbow"]]
    for joint in ("left_elbow", "right_elbow"):
        expected[:, place[joint]] += 0.2
    # ten wingbeats after the command exp(-80) of it is left
    np.testing.assert_allclose(away, expected, atol=1e-12)


def test_the_amplitude_of_a_joint_is_a_factor_as_described():
    """An amplitude, which is a factor, could be read as an angle [rad]."""
    assert "`plunge_amplitude` (over the gait's own) [1]" in " ".join(SteeredGait.__doc__.split())
    gait, own = SteeredGait(ROBOT, a_gait()), a_gait()
    gait.command(0.0, {"plunge_amplitude": 0.3})
    time, place = np.linspace(4.0, 4.2, 201), gait.joints.index("left_plunge")
    sizes = [np.ptp(one.motion(time).position[:, place]) for one in (gait, own)]
    assert sizes[0] == pytest.approx(0.3 * sizes[1], rel=1e-9)


def test_a_joint_s_own_command_counts_before_its_pair_s_in_any_order():
    given = {"left_plunge_amplitude": 0.5, "plunge_amplitude": 0.6, "amplitude": 0.7}
    for names in permutations(given):
        gait = SteeredGait(ROBOT, a_gait())
        gait.command(0.0, {name: given[name] for name in names})
        joints = ("left_plunge", "right_plunge", "left_elbow")
        assert [gait.commanded(f"{joint}_amplitude") for joint in joints] == [0.5, 0.6, 0.7]


def test_what_cannot_be_is_refused():
    gait = SteeredGait(ROBOT, a_gait())
    gait.command(0.5, both(5.0, 1.0))
    wrong = (
        (0.4, 5.0, 1.0),
        (0.6, 0.0, 1.0),
        (0.6, 5.0, -0.1),
        (np.nan, 5.0, 1.0),
        (1.0, 5.0, np.nan),
    )
    for time, *values in wrong:
        with pytest.raises(ParameterError):
            gait.command(time, both(*values))
    for name in ("plunge", "feather_amplitude", "tail_offset", "plunge_speed", "offset"):
        with pytest.raises(ParameterError, match="amplitude, <joint>_offset of left_plunge"):
            gait.command(0.6, {name: 1.0})
    for given in ((0.6, [("frequency", 5.0)]), ("now", both(5.0, 1.0)), (0.6, {1: 5.0})):
        with pytest.raises(ParameterError):
            gait.command(*given)
    for name in (["frequency"], 1, None):
        with pytest.raises(ParameterError, match="name"):
            gait.limits(name)
    with pytest.raises(ParameterError, match="time"):
        gait.motion("now")
    with pytest.raises(ShapeError, match="time"):
        gait.motion([[0.0, 0.1]])
    still = SteeredGait(ROBOT, pt.gaits.still(ROBOT))
    with pytest.raises(ParameterError, match="<joint>_offset"):
        still.command(0.0, {"frequency": 3.0})
    still.command(0.0, {"feather_offset": 0.1})
    assert still.motion([1.0]).position[0, list(still.joints).index("left_feather")] == 0.1
    check_gait(ROBOT, gait)
    json.dumps(gait.describe())


def test_a_rate_limit_holds_and_the_command_arrives():
    robot = with_actuators(frequency={"rate_limit": 4.0}, plunge_offset={"rate_limit": 0.5})
    gait = SteeredGait(robot, a_gait())
    gait.command(0.1, {"frequency": 9.0, "plunge_offset": 0.3})
    gait.command(0.3, {"frequency": 7.0})  # turned back while the ramp is under way
    times = np.linspace(0.0, 3.0, 30001)
    frequency = np.array([gait.command_at(float(t))[0] for t in times])
    assert np.abs(np.diff(frequency) / np.diff(times)).max() <= 4.0 + 1e-6  # rounding over 1e-4 s
    assert np.abs(np.diff(frequency) / np.diff(times)).max() > 3.9
    assert frequency.max() <= 7.0 + 1e-12 and frequency[-1] == pytest.approx(7.0, abs=1e-9)
    other = SteeredGait(robot, a_gait())
    other.command(0.1, {"plunge_offset": 0.3})
    away = other.motion(times).position - a_gait().motion(times).position
    drift = np.abs(np.diff(away[:, list(gait.joints).index("left_plunge")])) / np.diff(times)
    assert 0.45 < drift.max() <= 0.5 + 1e-6
    assert gait.commanded("plunge_offset") == 0.3 and gait.period == pytest.approx(1 / 7)


def test_a_range_holds_in_the_units_of_the_joint():
    robot = with_actuators(
        frequency={"range": (4.0, 7.0)}, plunge_amplitude={"range": (0.4, 0.6)},
        elbow_offset={"range": (-0.1, 0.2)}, plunge_offset={"range": (0.0, 0.15)},
    )  # fmt: skip
    gait = SteeredGait(robot, a_gait())
    assert gait.largest_amplitudes.min(initial=np.inf) == pytest.approx(
        1.2, rel=1e-5
    )  # extremes of 2000 samples
    gait.command(0.0, {"frequency": 9.0, "amplitude": 2.0, "plunge_offset": 1.0})
    assert gait.limited == 1 and gait.commanded("frequency") == 7.0
    assert gait.commanded("plunge_amplitude") == pytest.approx(1.2, rel=1e-5)
    assert gait.commanded("elbow_amplitude") == 2.0
    assert gait.commanded("plunge_offset") == pytest.approx(0.05, abs=1e-9)  # over its mean of .1
    for name, limits, own in (
        ("frequency", (6.0, 9.0), "5 "),
        ("left_plunge_amplitude", (0.6, 0.9), "0.5 "),
        ("plunge_offset", (-0.2, 0.0), "0.1 "),
        ("elbow_phase", (0.1, 0.5), "0 "),
    ):
        with pytest.raises(ParameterError, match=rf"actuators.{name}.range.*the gait's {own}"):
            SteeredGait(with_actuators(**{name: {"range": limits}}), a_gait())
    still = with_actuators(frequency={"range": (4.0, 7.0)}, plunge_amplitude={"range": (0.4, 0.6)})
    SteeredGait(still, pt.gaits.still(still))  # nothing flaps that could be out of range


def test_actuators_of_the_presets_hold_their_cruise():
    for name in preset_names():
        robot = pt.load_robot(name)
        if robot.actuators:
            gait = SteeredGait(robot, pt.gaits.cruise(robot))
            for command in robot.actuators:
                gait.command(0.0, {command: gait.commanded(command)})
            assert gait.limited == 0
            beat = robot.actuators.get("frequency")  # a glider has none
            if beat is not None:
                assert gait.describe()["response_time"][0] == beat.response_time


AERO, START = pt.QuasiSteady(ROBOT, pt.Air()), ROBOT.velocities(x=3.0)


def flown(pieces, commands=None):
    flying = pt.Simulator(ROBOT, AERO, a_gait(), duration=0.2, time_step=1e-4, v=START)
    for piece in pieces:
        flying.advance(piece)
        if commands is not None and flying.time == pytest.approx(0.1):
            flying.command(commands)
    return flying.flight()


def test_a_flight_in_pieces_is_the_flight():
    whole = pt.simulate(ROBOT, AERO, a_gait(), duration=0.2, time_step=1e-4, v=START)
    parts = flown([1, 7, 992, 333, 2000])
    for name in whole.data_vars:
        np.testing.assert_array_equal(parts[name].values, whole[name].values)
    assert parts.attrs["outcome"] == "COMPLETED" and pt.simulation.gait_period(parts) == 0.2


def test_a_flight_follows_what_is_commanded(tmp_path):
    flight = flown([1000, 1000], both(9.0, 0.6))
    plunge = flight["q"].sel(dof="left_plunge").values
    rate = flight["v"].sel(dof="left_plunge").values
    slope = np.gradient(plunge, 1e-4)
    assert np.abs(slope - rate)[1:-1].max() < 1e-3  # second differences at 1e-4 s
    before = flown([2000])["q"].sel(dof="left_plunge").values
    np.testing.assert_array_equal(plunge[:1001], before[:1001])
    assert np.abs(plunge - before).max() > 0.05
    assert flight.attrs["energy_audit"] < 1e-6
    again = pt.load_flight(pt.save_flight(flight, tmp_path / "flight.nc"))
    assert list(again["command_name"].values) == ["frequency", "amplitude"]
    np.testing.assert_array_equal(again["command"].values[[0, 999, 1000, 2000], 0], [5, 5, 9, 9])
    assert pt.simulation.gait_period(again) == pytest.approx(1 / 9)


def test_a_flight_leaves_the_steered_gait_that_it_is_given_as_it_was():
    """The flight commanded the caller's own object, so that the next one obeyed it too."""
    gait, options = SteeredGait(ROBOT, a_gait()), dict(duration=0.05, time_step=5e-4, v=START)
    gait.command(0.0, {"plunge_offset": 0.1})
    faster = options | {"controller": lambda time, state: {"frequency": 9.0}}
    first, second = (pt.simulate(ROBOT, AERO, gait, **faster) for _ in range(2))
    assert first.identical(second)
    assert gait.commanded("frequency") == pytest.approx(5.0)
    flying = pt.Simulator(ROBOT, AERO, gait, **options)
    flying.command({"frequency": 9.0})
    assert flying.steered.commanded("frequency") == pytest.approx(9.0)
    assert flying.steered.commanded("plunge_offset") == gait.commanded("plunge_offset") == 0.1


def test_a_controller_is_a_loop_of_steps():
    """`simulate` with a controller, and `step` by hand, are the same flight to the last bit."""
    calls = []

    def controller(time, state):
        calls.append(time)
        return {"feather_offset": 0.3 * state.position("pitch"), "frequency": 5.0 + time}

    options = dict(duration=0.1, time_step=1e-3, control_period=0.01, v=START)
    flight = pt.simulate(ROBOT, AERO, a_gait(), controller=controller, **options)
    np.testing.assert_allclose(calls, 0.01 * np.arange(10), atol=1e-12)  # rounding of the times
    flying = pt.Simulator(ROBOT, AERO, a_gait(), **options)
    while flying.time < 0.1 - 1e-9:
        state = flying.step(controller(flying.time, flying.state))
    for name in flight.data_vars:
        np.testing.assert_array_equal(flight[name].values, flying.flight()[name].values)
    assert state.velocity("x") == flight.v.sel(dof="x").values[-1]
    for wrong in ("position", "velocity"):
        with pytest.raises(ParameterError, match="left_plunge"):
            getattr(state, wrong)("tail")


def test_feedback_holds_the_pitch():
    """A tail that answers pitch and its rate holds an ornithopter that falls without."""
    robot = pt.load_robot("ornithopter")
    gait = pt.gaits.sinusoidal(robot, frequency=4.0, plunge=0.5, offset={"elevation": -0.1})

    def hold(time, state):
        pitch, rate = state.position("pitch"), state.velocity("pitch")
        return {"elevation_offset": 0.8 * pitch + 0.1 * rate}

    found = {}
    for name, controller in (("free", None), ("held", hold)):
        flight = pt.simulate(
            robot, pt.QuasiSteady(robot, pt.Air()), gait, duration=2.0, time_step=1e-3,
            v=robot.velocities(x=6.0), controller=controller,
        )  # fmt: skip
        found[name] = np.abs(flight.q.sel(dof="pitch").values).max()
    assert found["free"] > 0.6 and found["held"] < 0.3  # rad; measured .79 and .24


def test_a_command_that_is_wrong_ends_the_flight_with_its_name():
    for commands in ({"tail_offset": 1.0}, {"plunge_offset": np.nan}):
        with pytest.raises(ParameterError, match=r"tail_offset|plunge_offset"):
            pt.simulate(
                ROBOT, AERO, a_gait(), duration=0.1, time_step=1e-3,
                controller=lambda time, state, commands=commands: commands,
            )  # fmt: skip
    with pytest.raises(ParameterError, match="control_period"):
        pt.simulate(ROBOT, AERO, a_gait(), duration=0.1, time_step=1e-3, control_period=0.01)
