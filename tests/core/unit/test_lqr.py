"""Regulators: what they promise of the beat, the simulator does."""

from __future__ import annotations

import re

import numpy as np
import pytest

import patagium as pt
from patagium.control import LinearRegulator
from patagium.control.predictive import periodic_riccati
from patagium.errors import ParameterError
from patagium.simulation import FlightState

COMMANDS = ("frequency", "elevation_offset", "rudder_offset")


@pytest.fixture(scope="module")
def orbit():
    return pt.trim(pt.load_robot("ornithopter"), speed=6.0)


def flown(orbit, controller, beats, size):
    """Roll and pitch off the orbit after some beats, from a small departure [rad]."""
    start, robot = orbit.start(), orbit.robot
    q = start["q"].copy()
    q[robot.index("roll")] += size
    q[robot.index("pitch")] += size / 2
    feedback = {"controller": controller, "control_period": orbit.period / 10}
    flight = orbit.flight(beats=beats, q=q, **(feedback if controller else {}))
    end = flight.q.sel(dof=["roll", "pitch", "z"]).values[-1]
    return np.abs(end - start["q"][[robot.index(k) for k in ("roll", "pitch", "z")]]).max()


def test_a_periodic_regulator_keeps_an_unstable_orbit(orbit):
    assert not pt.control.floquet(orbit).stable
    regulator = LinearRegulator(orbit, COMMANDS, change_cost=0.0)
    sizes = np.sort(np.abs(regulator.multipliers))[::-1]
    assert sizes[0] == pytest.approx(1.0, abs=1e-6)  # the way along y, which costs nothing
    assert sizes[1] < 0.95
    assert len(sizes) > len(orbit.names)  # the lags of the commands are states
    without, with_feedback = flown(orbit, None, 40, 0.01), flown(orbit, regulator, 40, 0.01)
    assert with_feedback < 0.03 * without
    assert regulator.report() == "Every sample was answered."


def test_commands_that_stand_at_an_end_of_their_range_are_told(orbit):
    """The report of a flight 20 m below its orbit said only "Every sample was answered."."""
    regulator, robot, start = LinearRegulator(orbit, COMMANDS), orbit.robot, orbit.start()
    q = start["q"].copy()
    q[robot.index("z")] -= 20.0
    for k in range(40):
        time = k * regulator.period
        regulator(time, FlightState(robot, time, q, start["v"]))
    share = regulator.limited["elevation_offset"] / 40
    assert share > 0.5 and f"elevation_offset in {share:.0%}" in regulator.report()
    regulator(0.0, FlightState(robot, 0.0, start["q"], start["v"]))
    assert not regulator.limited and regulator.report() == "Every sample was answered."


def test_changes_that_cost_leave_room_for_larger_departures(orbit):
    """Free ones ask for more within a beat than actuators follow, and lose the height."""
    firm, default = (LinearRegulator(orbit, COMMANDS, change_cost=cost) for cost in (0.0, 1.0))
    sizes = np.sort(np.abs(default.multipliers))[::-1]
    assert sizes[0] == pytest.approx(1.0, abs=1e-6) and sizes[1] < 0.98
    assert flown(orbit, default, 30, 0.3) < 0.5 < 2.0 < flown(orbit, firm, 30, 0.3)


def test_no_actuator_is_asked_for_more_than_its_rate_and_range(orbit):
    regulator = LinearRegulator(orbit, COMMANDS)
    low, high, rate = np.array(regulator.ends).T
    far = np.full(regulator.model.size, 0.3)
    given = [np.zeros(3)]
    for k in range(30):
        given.append(regulator.answer(k, far, given[-1]))
    given = np.array(given)
    assert (np.abs(np.diff(given, axis=0)) <= rate * regulator.period * (1 + 1e-12)).all()
    inside = np.array([low, high]) - regulator.model.neutral
    assert (inside[0] <= given).all() and (given <= inside[1]).all()
    assert (given == inside[0]).any() or (given == inside[1]).any()


def test_free_changes_are_the_regulator_without_commands_in_force(orbit):
    """K = [K of u = -K x, 1], by the Riccati equation of the model alone."""
    regulator = LinearRegulator(orbit, COMMANDS, change_cost=0.0)
    model = regulator.model
    costs = regulator.state_cost, regulator.input_cost
    _, alone = periodic_riccati(model.by_state, model.by_input, *costs)
    size = np.abs(alone).max()
    assert np.abs(regulator.gains[:, :, : model.size] - alone).max() < 1e-6 * size  # sweeps end
    assert np.abs(regulator.gains[:, :, model.size :] - np.eye(len(COMMANDS))).max() < 1e-6


def test_a_cost_of_changes_below_zero_is_refused(orbit):
    with pytest.raises(ParameterError, match="change_cost"):
        LinearRegulator(orbit, COMMANDS, change_cost=-1.0)


def test_an_averaged_regulator_says_where_it_fails_and_does(orbit):
    words = {"averaged": True, "change_cost": 0.0}
    with pytest.warns(UserWarning, match=r"grow .* a beat under the averaged gain"):
        averaged = LinearRegulator(orbit, COMMANDS, **words)
    assert np.ptp(averaged.gains, axis=0).max() < 1e-8
    grows = np.abs(averaged.multipliers).max()
    assert grows > 1.01
    early, late = (flown(orbit, averaged, beats, 1e-4) for beats in (40, 80))
    assert late / early == pytest.approx(grows**40, rel=0.3)  # other modes are not yet gone


def test_a_controller_says_what_it_commands(orbit):
    told = repr(LinearRegulator(orbit, COMMANDS))
    assert re.fullmatch(
        r"<LinearRegulator of \S+: frequency, elevation_offset, rudder_offset each \S+ s>", told
    )


def test_a_controller_that_is_called_at_another_period_warns(orbit):
    regulator, start = LinearRegulator(orbit, COMMANDS), orbit.start()
    flight = pt.Simulator(
        orbit.robot, orbit.aero, regulator.model.steered, duration=orbit.period,
        control_period=1.5 * regulator.period, time_step=regulator.period / 50, **start,
    )  # fmt: skip
    flight.step(regulator(flight.time, flight.state))
    with pytest.warns(UserWarning, match="control_period"):
        regulator(flight.time, flight.state)


def test_a_command_that_is_none_is_refused(orbit):
    with pytest.raises(ParameterError, match="tail_offset"):
        LinearRegulator(orbit, ("tail_offset",))
