"""The predictive controller: its model is the simulator's, and no sample that is wrong moves it."""

from __future__ import annotations

import pickle
from copy import deepcopy
from types import SimpleNamespace

import numpy as np
import pytest
from tests.robots import FLAPPER

import patagium as pt
from patagium.control import LinearRegulator
from patagium.control.predictive import OrbitModel, PredictiveController
from patagium.control.wingbeat import FlightMap
from patagium.errors import ParameterError
from patagium.robot import load_robot_text
from patagium.simulation.simulator import FlightState
from patagium.simulation.steered_gait import SteeredGait

ACTUATORS = """actuators:
  frequency: {range: [3, 8], response_time: 0.15 s}
  plunge_amplitude: {range: [10 deg, 40 deg], rate_limit: 200 deg/s}
  left_feather_offset: {range: [-20 deg, 20 deg], cost: 2}
  plunge_phase: {range: [-1, 1]}
"""
COMMANDS = ("frequency", "plunge_amplitude", "left_feather_offset", "plunge_phase")
ROBOT = load_robot_text(FLAPPER.replace("9.81 m/s^2", "0") + ACTUATORS)
AERO = pt.QuasiSteady(ROBOT, pt.Air(density=1e-9))  # momentum is conserved: every beat repeats
GAIT = pt.gaits.sinusoidal(ROBOT, frequency=5.0, plunge=0.4, feather=0.2, phase={"feather": 1.0})


def an_orbit(gait=GAIT, robot=ROBOT, aero=AERO):
    """Orbit without forces: any state without rotation that the wings' recoil does not turn."""
    flight = FlightMap(robot, aero)
    state = np.zeros((1, flight.size))
    state[0, flight.names.index("velocity of x")] = 3.0
    return SimpleNamespace(map=flight, gait=gait, states=state, steps=200)


@pytest.fixture(scope="module")
def orbit():
    """That orbit, its pitch rate such that recoil turns nothing on the whole."""
    found = an_orbit()
    place = found.map.names.index("velocity of pitch")
    for _ in range(3):  # the drift is linear in the rate, nearly
        v = ROBOT.velocities(x=3.0, pitch=found.states[0, place])
        flight = pt.simulate(ROBOT, AERO, GAIT, duration=0.2, time_step=1e-3, v=v)
        found.states[0, place] -= flight.q.sel(dof="pitch").values[-1] * GAIT.frequency
    return found


def test_its_model_is_the_simulator_near_the_orbit(orbit):
    """Every command moves the flight as the linear model says, to second order."""
    model = OrbitModel(orbit, COMMANDS)
    start = dict(zip(orbit.map.names, orbit.states[0], strict=True))
    v = ROBOT.velocities(x=3.0, pitch=start["velocity of pitch"])
    for place, name in enumerate(COMMANDS):
        errors = []
        for size in (2e-2, 1e-2):
            departure, inputs, given = np.zeros(model.size), np.zeros((1, len(COMMANDS))), []

            def controller(time, state, size=size, given=given, name=name, model=model):
                own = model.steered.neutral[model.places[COMMANDS.index(name)]]
                value = own + size * (1 if len(given) < 7 else -0.5)
                given.append(value - own)
                return {name: value / model.steered.scale(name)}

            flight = pt.simulate(
                ROBOT, AERO, GAIT, duration=0.28, time_step=1e-3, v=v, controller=controller,
                control_period=model.period,
            )  # fmt: skip
            for k, value in enumerate(given):
                inputs[0, place] = value
                departure = model.predict(k, departure[None], inputs).ends[0]
            end = np.concatenate([flight.q.values[-1], flight.v.values[-1]])
            passive = [ROBOT.dof_names.index(n.removeprefix("velocity of ")) for n in model.names]
            shift = [ROBOT.dof * n.startswith("velocity of ") for n in model.names]
            state = end[np.array(passive) + shift]
            steered = OrbitModel(orbit, COMMANDS)
            for k, value in enumerate(given):
                own = steered.steered.neutral[steered.places[place]]
                steered.steered.command(
                    k * model.period, {name: (value + own) / steered.steered.scale(name)}
                )
            found = steered.departure(14, state, 14 * model.period)
            errors.append(np.abs(found - departure).max() / np.abs(departure).max())
        # quadratic: half the step errs by half as much, relative to it
        assert errors[1] < 0.05 and errors[1] < 0.65 * errors[0], (name, errors)


BIRD_COMMANDS = ("frequency", "plunge_amplitude", "elevation_offset", "rudder_offset")


def test_a_command_of_two_joints_keeps_the_actuators_of_both(orbit):
    """A command of two joints had the limits of the first; one side of a pair had no cost."""
    sides = """  left_feather_offset: {range: [-20 deg, 20 deg], cost: 2}
  right_feather_offset: {range: [-10 deg, 30 deg], rate_limit: 50 deg/s, response_time: 0.1 s}
"""
    pair = ACTUATORS.replace("left_feather_offset", "feather_offset")
    own = "\n".join(k for k in ACTUATORS.splitlines() if "feather" not in k) + "\n" + sides
    paired, apart = (load_robot_text(FLAPPER.replace("9.81 m/s^2", "0") + k) for k in (pair, own))
    steered = SteeredGait(apart, GAIT)
    ends = np.radians((-10.0, 20.0, 50.0))
    np.testing.assert_allclose(steered.limits("feather_offset"), ends, rtol=1e-12)  # rounding
    with pytest.raises(ParameterError, match="answer equally fast.*'feather_offset'"):
        OrbitModel(an_orbit(robot=apart), ("frequency", "feather_offset"))
    assert SteeredGait(paired, GAIT).costs.sum() == 2 * 2.0 + len(steered.costs) - 2


@pytest.fixture(scope="module")
def cruise(ornithopter_orbit):
    return ornithopter_orbit


def test_a_sample_that_is_wrong_leaves_the_last_command(cruise):
    controller, robot = PredictiveController(cruise, BIRD_COMMANDS), cruise.robot
    period, start = controller.model.period, cruise.start()
    q, v = start["q"], start["v"]
    assert set(controller(0.0, FlightState(robot, 0.0, q, v))) == set(BIRD_COMMANDS)
    wrong = v.copy()
    wrong[2] = np.nan
    assert controller(period, None) == {}
    assert controller(2 * period, FlightState(robot, 0.0, q, v)) == {}
    assert controller(3 * period, FlightState(robot, 3 * period, q, wrong)) == {}
    assert controller(4 * period, FlightState(robot, np.nan, q, v)) == {}
    assert controller.held == {"missing": 1, "late": 2, "not finite": 1}
    assert "held at 4 samples: 2 late, 1 missing, 1 not finite" in controller.report()
    found = controller(5 * period, FlightState(robot, 5 * period, q, v))
    assert set(found) == set(BIRD_COMMANDS) and all(map(np.isfinite, found.values()))
    assert PredictiveController(cruise, BIRD_COMMANDS).report() == "Every sample was answered."


def test_memory_does_not_grow_with_the_flight(cruise):
    # Every command was kept: 1.4 GB an hour at 150 Hz.
    controller, robot = LinearRegulator(cruise, BIRD_COMMANDS), cruise.robot
    q, v = cruise.start()["q"], cruise.start()["v"]
    for k in range(60):
        controller(k * controller.period, FlightState(robot, k * controller.period, q, v))
    steered, beat = controller.model.steered, controller.model.parts * controller.period
    assert len(steered.answers) <= 2 * controller.model.parts + 2
    now = 59 * controller.period
    assert np.isfinite(steered.motion(now - np.linspace(0.0, 2.0, 9) * beat).position).all()
    both = np.isnan(steered.motion([0.0, now]).position)
    assert both[0].all() and not both[1].any()


def copied(controller):
    return pickle.loads(pickle.dumps(controller))


@pytest.mark.parametrize("copy", [copied, deepcopy])
def test_a_copy_goes_on_bit_for_bit_on_its_own(cruise, copy):
    # A predictive controller could not be sent to another process: its program holds addresses.
    controller, robot = PredictiveController(cruise, BIRD_COMMANDS), cruise.robot
    period, start, rng = controller.model.period, cruise.start(), np.random.default_rng(0)

    def samples(k):
        return FlightState(robot, k * period, start["q"], start["v"] + rng.normal(size=robot.dof))

    for k in range(12):  # beyond a beat: inverses of each phase are kept
        controller(k * period, samples(k))
    other = copy(controller)
    for k in range(12, 24):
        sample = samples(k)
        assert controller(k * period, sample) == other(k * period, sample)
    assert not np.shares_memory(controller.iteration.program["u"], other.iteration.program["u"])


def test_commands_keep_ranges_and_rates(cruise):
    controller = PredictiveController(cruise, BIRD_COMMANDS, limits={"velocity of z": (-0.1, 0.1)})
    period, robot, seen = controller.model.period, cruise.robot, []
    rng, start = np.random.default_rng(0), cruise.start()
    for k in range(30):
        q, v = start["q"].copy(), start["v"].copy()
        q[[robot.index(n) for n in ("z", "roll", "pitch", "yaw")]] += rng.normal(size=4)
        v[[robot.index(n) for n in ("y", "pitch")]] += rng.normal(size=2) * [1, 5]
        seen.append(controller(k * period, FlightState(robot, k * period, q, v)))
    assert not controller.held
    plunge = cruise.gait.motion(np.linspace(0, cruise.period, 1001)).position
    joints = [robot.dof_names[k] for k in robot.actuated]
    half_strokes = {"plunge_amplitude": np.ptp(plunge, axis=0).max() / 2}  # of the gait's own
    for name in BIRD_COMMANDS:
        own = robot.actuators[name]
        found = np.array([one[name] for one in seen]) * half_strokes.get(name, 1.0)
        if name.endswith("_offset"):  # from the gait's own mean
            found += cruise.gait.motion(np.zeros(1)).position[0][joints.index(name[:-7])]
        slack = 1e-6 * (own.range[1] - own.range[0])
        assert found.min() >= own.range[0] - slack and found.max() <= own.range[1] + slack
        assert np.abs(np.diff(found)).max() <= own.rate_limit * period + slack
    assert np.ptp([one["frequency"] for one in seen]) > 1  # it does something
    assert controller.model.steered.limited == 0  # nothing was left to the gait to cut


def test_a_limit_may_have_one_side(cruise):
    robot, start, name, found = cruise.robot, cruise.start(), "velocity of z", []
    v = start["v"] + 0.2 * (np.array(robot.dof_names) == "z")
    sample = FlightState(robot, 0.0, start["q"], v)
    for limits in ({name: (None, 0.1)}, {name: (-5.0, 0.1)}, {name: (-5.0, None)}, {}):
        controller = PredictiveController(cruise, BIRD_COMMANDS, limits=limits)
        found.append(np.array(list(controller(0.0, sample).values())))
    assert found[0] == pytest.approx(found[1], abs=1e-6)  # the tolerance of the program
    assert found[2] == pytest.approx(found[3], abs=1e-6)
    assert np.abs(found[0] - found[3]).max() > 0.01


def test_slow_modes_are_held_and_what_grows_is_told(cruise):
    """The slowest closed-loop mode of the first two takes some 500 and 900 beats to settle."""
    loose = dict.fromkeys(("z", "yaw", "roll", "pitch"), 2.0)
    commands = ("frequency", "elevation_offset", "rudder_offset")
    regulator = LinearRegulator(cruise, commands, tolerable=loose)
    assert 0.98 < np.sort(np.abs(regulator.multipliers))[-2] < 0.99  # one is neutral: y
    assert np.isfinite(PredictiveController(cruise, commands, parts=1).gains).all()
    with pytest.raises(ParameterError, match="mode that grows.*a multiplier of 1.07. remains"):
        LinearRegulator(cruise, commands[:1])


def test_what_cannot_be_controlled_is_refused(orbit):
    with pytest.raises(ParameterError, match="tail_offset"):
        PredictiveController(orbit, ("tail_offset",))
    with pytest.raises(ParameterError, match="a range of every command"):
        PredictiveController(orbit, ("feather_amplitude",))
    with pytest.raises(ParameterError, match="velocity of pitch"):
        PredictiveController(orbit, COMMANDS, tolerable={"height": 1.0})
    turning = an_orbit()
    turning.states[0, turning.map.names.index("velocity of roll")] = 0.5
    with pytest.raises(ParameterError, match="returns after a beat"):
        PredictiveController(turning, COMMANDS)
