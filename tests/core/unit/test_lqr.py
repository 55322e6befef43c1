"""Regulators: what they promise of the beat, the simulator does."""

from __future__ import annotations

import re

import numpy as np
import pytest
from tests.robots import FLAPPER

import patagium as pt
from patagium.control import LinearRegulator, PredictiveController
from patagium.control.gait_family import symmetric_parameters
from patagium.control.predictive import periodic_riccati
from patagium.errors import ParameterError
from patagium.robot import load_robot_text
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
    with pytest.warns(UserWarning, match=r"grow .* a beat; .* gains of each part"):
        averaged = LinearRegulator(orbit, COMMANDS, **words)
    assert np.ptp(averaged.gains, axis=0).max() < 1e-8
    grows = np.abs(averaged.multipliers).max()
    assert grows > 1.01
    early, late = (flown(orbit, averaged, beats, 1e-4) for beats in (40, 80))
    assert late / early == pytest.approx(grows**40, rel=0.3)  # other modes are not yet gone


@pytest.fixture(scope="module")
def lagging():
    """Orbit in air with lag states, and its commands."""
    shift = "{range: [-50 deg, 50 deg]}"
    ranges = {"frequency": "{range: [3 Hz, 40 Hz]}", "plunge_amplitude": "{range: [1 deg, 80 deg]}"}
    ranges |= {"left_feather_offset": shift, "right_feather_offset": shift}
    actuators = "".join(f"  {name}: {one}\n" for name, one in ranges.items())
    robot = load_robot_text(f"{FLAPPER}actuators:\n{actuators}")
    gait = pt.gaits.sinusoidal(
        robot, frequency=9.0, plunge=0.6, feather=0.3, phase={"feather": 1.5}
    )
    free = symmetric_parameters(robot, gait)
    return pt.trim(robot, pt.LiftingLine(robot), gait, climb=None, steps=80, free=free), [*ranges]


def test_multipliers_are_those_of_the_flight_whose_lags_are_not_measured(lagging):
    """Multipliers used gains of unmeasured lags: 4.56, where departures grew 4.71 times."""
    orbit, commands = lagging
    with pytest.warns(UserWarning, match=r"grow .* a beat; .* gains of each part"):
        averaged = LinearRegulator(orbit, commands, parts=10, averaged=True)
    along_z, flights = np.array(orbit.robot.dof_names) == "z", []
    for away in (0.0, 1e-10):
        start = orbit.start()
        start["v"] = start["v"] + away * along_z
        flight = orbit.flight(beats=4, controller=averaged, control_period=averaged.period, **start)
        flights.append(flight.v.values[:: orbit.steps])
    away = np.linalg.norm(flights[1] - flights[0], axis=1)
    assert away[-1] / away[-2] == pytest.approx(np.abs(averaged.multipliers).max(), rel=1e-3)


def test_gains_of_lags_that_are_not_measured_are_zero(lagging):
    """Controllers had gains for lag states of the air, which are never measured."""
    orbit, commands = lagging
    names = {"x", *orbit.robot.dof_names, *(f"velocity of {k}" for k in orbit.robot.dof_names)}
    held = [LinearRegulator(orbit, commands), PredictiveController(orbit, commands)]
    for one in held:
        lags = [name not in names for name in orbit.names if name != "x"]
        assert sum(lags) > 0 and not one.gains[:, :, : len(lags)][..., lags].any()
    sizes, expected = (np.sort(np.abs(one.multipliers))[::-1][:8] for one in held)
    assert sizes == pytest.approx(expected, abs=1e-6)  # rates are free: both are one law


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
