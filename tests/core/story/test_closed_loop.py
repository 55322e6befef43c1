"""The loop closed: a flight that is recorded as any other, disturbed on its way."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics.description import aero_from_description
from patagium.control import (
    AdaptiveController,
    Estimate,
    Event,
    GustEvent,
    LinearRegulator,
    NoisyState,
    PayloadEvent,
    PredictiveController,
    StuckEvent,
    TrackedState,
    WingLossEvent,
    off_nominal,
)
from patagium.errors import ParameterError, SimulationFailed
from patagium.simulation.flight_summary import flight_summary
from patagium.simulation.simulator import FlightState

COMMANDS = ("frequency", "plunge_amplitude", "elevation_offset", "rudder_offset")
NOISE = NoisyState({"z": 0.002, "pitch": 0.005, "velocity of z": 0.02})


@pytest.fixture(scope="module")
def orbit(ornithopter_orbit):
    return ornithopter_orbit


def flown(orbit, controller=None, duration=1.0, **options):
    """Closed-loop flight of a machine 2 % off its file, in thinner air."""
    robot = off_nominal(orbit.robot, 0.02, 1)
    aero = pt.QuasiSteady(robot, pt.Air(density=1.2))
    chosen = controller or PredictiveController(orbit, COMMANDS)
    options = {"time_step": 5e-4, "sensors": NOISE, **options}
    return pt.fly(robot, aero, chosen, orbit=orbit, duration=duration, **options)


def test_the_flight_is_one_like_any_other_and_the_same_again(orbit, tmp_path):
    events = [
        GustEvent(time=0.1, velocity=(0.0, 0.0, 1.0), length_time=0.2),
        PayloadEvent(time=0.3, body="body", mass=0.01),
        WingLossEvent(time=0.5, wing="left_wing", share=0.05),
    ]
    flight = flown(orbit, events=events)
    assert flight.attrs["outcome"] == "COMPLETED"
    assert flight.attrs["energy_audit"] < 1e-9 and flight.attrs["momentum_audit"] < 1e-9
    assert flight.attrs["time_step"] <= 5e-4
    assert [one["time"] for one in json.loads(flight.attrs["events"])] == [0.1, 0.3, 0.5]
    assert "left_wing lost" in flight.attrs["events"]
    assert flight.attrs["held"] == "{}" and "Every sample" in flight.attrs["controller"]
    assert set(flight["command_name"].values) == set(COMMANDS)
    pt.save_flight(flight, tmp_path / "flight.nc")
    again = pt.load_flight(tmp_path / "flight.nc")
    same = flown(orbit, events=events)
    for name in ("q", "command", "estimate", "reference"):
        assert (again[name].values == same[name].values).all()
    assert (flown(orbit, events=events, seed=1)["q"].values != same["q"].values).any()
    assert pt.cycle_statistics(again, skip=0).sizes["phase"] > 1


def test_the_estimate_is_the_state_and_its_noise(orbit):
    flight = flown(orbit)
    true = flight["q"].interp(time=flight["control_time"].values)
    errors = flight["estimate"].sel(state="z").values - true.sel(dof="z").values
    assert 0.6 * 0.002 < errors.std() < 1.5 * 0.002  # 40 samples
    exact = flight["estimate"].sel(state="roll").values - true.sel(dof="roll").values
    assert np.abs(exact).max() < 1e-9
    off = flight["reference"].sel(state="z").values - flight["estimate"].sel(state="z").values
    assert np.abs(off).max() < 0.3


def test_a_machine_that_changes_keeps_its_state(orbit):
    """A payload pulls the flight down from its time on, and not before."""
    event = PayloadEvent(time=0.5, body="body", mass=0.1)
    without, loaded = (flown(orbit, events=events) for events in ([], [event]))
    apart = np.abs(without["q"].values - loaded["q"].values).max(axis=1)
    first = float(loaded["time"].values[np.argmax(apart > 0)])
    assert 0.5 < first < 0.502
    assert float(loaded.q.sel(dof="z")[-1]) < float(without.q.sel(dof="z")[-1]) - 0.05
    sample = int(np.searchsorted(loaded["time"].values, 0.5))
    near = loaded["v"].values[sample - 2 : sample + 3, orbit.robot.passive]
    assert np.abs(np.diff(near, axis=0)).max() < 0.1  # m/s, rad/s


def test_an_own_event_with_a_gust_and_a_change_does_both(orbit):
    """An event with a gust did not change the robot; NumPy numbers in events lost the flight."""

    @dataclass(frozen=True, kw_only=True)
    class IceInAGust(Event):
        mass: float

        def gust(self):
            return pt.air.RampGust((0.0, 0.0, 1.0), self.time, 0.01)

        def changed(self, robot, aero):
            iced = robot.with_parameters({"body.mass": float(self.mass)})
            return iced, aero_from_description(iced, aero.describe())

    body = orbit.robot.parameters[orbit.robot.parameter_names.index("body.mass")]
    heavier = np.float32(1.5 * body)
    flight = flown(orbit, events=[IceInAGust(time=0.02, mass=heavier)], duration=0.05)
    assert float(flight["mass"][-1] - flight["mass"][0]) > 0.1 * float(flight["mass"][0])
    assert flight["wind"].sel(axis="z").values[-1] == 1.0
    gust = GustEvent(time=0.02, velocity=(0.0, 0.0, 1.0), length_time=0.01)
    assert "mass" not in flown(orbit, events=[gust], duration=0.05)


def test_a_payload_on_one_side_rolls_the_machine(orbit):
    """The centre of mass of the body is zero in the file; it moves in the middle of the flight."""
    event = PayloadEvent(time=0.2, body="body", mass=0.03, position=(0.0, 0.2, 0.0))
    machine = orbit.robot, pt.QuasiSteady(orbit.robot), PredictiveController(orbit, COMMANDS)
    flight = pt.fly(*machine, orbit=orbit, duration=0.4, time_step=5e-4, events=[event])
    roll = flight.q.sel(dof="roll").values
    assert np.abs(roll[flight["time"].values <= 0.2]).max() < 1e-9
    assert roll[-1] < -0.01  # the left side goes down
    assert flight.attrs["energy_audit"] < 1e-9 and flight.attrs["momentum_audit"] < 1e-9


def test_the_reference_of_a_turn_goes_round():
    """It is the orbit, which a machine without disturbance flies."""
    aerobat = pt.load_robot("aerobat")
    free = ("frequency", "feather_offset", "feather_offset_difference")
    orbit = pt.trim(aerobat, turn_rate=0.3, free=free)

    class Still:
        period = orbit.period / 10

        def __call__(self, time, state):
            return {}

    flight = pt.fly(
        aerobat, pt.QuasiSteady(aerobat), Still(), orbit=orbit, duration=10 * orbit.period
    )
    apart = np.abs(flight["reference"].values - flight["estimate"].values)
    assert flight.q.sel(dof="yaw").values[-1] > 0.15
    assert apart.max() < 1e-3 * np.abs(flight["estimate"].values).max()


@pytest.mark.parametrize("kind", [PredictiveController, LinearRegulator])
def test_samples_that_are_missing_late_or_wrong_hold_the_last_command(orbit, kind):
    samples = []

    def broken(truth):
        samples.append(len(samples))
        q, v = truth.q[-1].copy(), truth.v[-1].copy()
        now = (len(truth.q) - 1) * truth.time_step
        if samples[-1] % 5 == 1:
            return None
        if samples[-1] % 5 == 2:
            q[0:] = np.nan
        time = now - 0.1 if samples[-1] % 5 == 3 else now
        return Estimate(FlightState(truth.robot, time, q, v), truth.a[-1])

    flight = flown(orbit, kind(orbit, COMMANDS), estimator=broken)
    count = flight.sizes["control_time"]
    held = json.loads(flight.attrs["held"])
    assert set(held) == {"missing", "not finite", "late"}
    assert sum(held.values()) == sum(k % 5 in (1, 2, 3) for k in range(count))
    assert "held" in flight.attrs["controller"]
    summary = flight_summary(flight)
    assert summary["held_samples"] == sum(held.values())
    assert any(f"{held['late']} late" in one for one in summary["warnings"])
    commands = flight["command"].values
    assert np.isfinite(commands).all()
    changes = np.flatnonzero(np.abs(np.diff(commands, axis=0)).max(axis=1) > 0)
    period = flight["control_time"].values[1] / flight.attrs["time_step"]
    assert {round(k / period) % 5 for k in changes[1:]} == {0, 4}


@pytest.mark.parametrize("kind", [PredictiveController, LinearRegulator])
def test_a_controller_starts_anew_with_each_flight(orbit, kind):
    given = {"sensors": NoisyState({"z": 0.002}, missing=0.2), "duration": 0.3}
    controller = kind(orbit, COMMANDS)
    first = flown(orbit, controller, **given)
    flown(orbit, controller, seed=1, **given)
    again = flown(orbit, controller, **given)
    for name in ("q", "command", "estimate"):
        assert np.array_equal(again[name].values, first[name].values, equal_nan=True)
    assert again.attrs["held"] == first.attrs["held"] != "{}"


def test_a_controller_that_learns_begins_each_flight_without_what_it_learned():
    robot = pt.load_robot("aerobat")  # which is compiled for other tests too
    orbit = pt.trim(robot, pt.QuasiSteady(robot, polar=pt.air.SmoothPolar()))
    wings = ("left_plunge_amplitude", "right_plunge_amplitude", "feather_amplitude")
    controller = AdaptiveController(LinearRegulator(orbit, wings))
    told = [
        (flown(orbit, controller, duration=0.6).attrs["controller"], controller.learner.weights)
        for _ in range(2)
    ]
    assert told[0][0] == told[1][0]
    assert np.array_equal(told[0][1], told[1][1]) and (told[0][1] != controller.learner.prior).any()
    assert repr(controller).startswith("<AdaptiveController around <LinearRegulator of aerobat")


def test_a_flight_of_one_sample_is_the_same_again(orbit):
    controller = LinearRegulator(orbit, COMMANDS)
    start = {"q": orbit.start()["q"] + 0.1 * np.eye(orbit.robot.dof)[orbit.robot.index("pitch")]}
    first, again = (flown(orbit, controller, duration=0.01, **start) for _ in range(2))
    assert np.array_equal(first["command"].values, again["command"].values)


def test_a_controller_that_learned_another_orbit_refuses_another_flight(orbit):
    controller = LinearRegulator(orbit, COMMANDS)
    flown(orbit, controller, duration=0.1)
    controller.follow(orbit, {}, 4)
    with pytest.raises(ParameterError, match="a new one for each flight"):
        flown(orbit, controller, duration=0.1)


def test_delay_and_loss_of_samples_are_those_asked_for(orbit):
    late = flown(orbit, sensors=NoisyState(delay=0.02))
    assert json.loads(late.attrs["held"]) == {"missing": 1}  # none has come at the start
    assert "no sample" not in late.attrs["message"]
    lossy = flown(orbit, sensors=NoisyState(missing=0.3), duration=2.0)
    share = json.loads(lossy.attrs["held"])["missing"] / lossy.sizes["control_time"]
    assert 0.15 < share < 0.45  # 80 samples


@pytest.mark.parametrize("kind", [PredictiveController, LinearRegulator])
def test_a_delayed_state_is_taken_to_the_present_along_the_orbit(orbit, kind):
    """A tenth of a beat, as docs/feedback.md says; the body swings by some cm/s meanwhile."""
    robot, start = orbit.robot, orbit.start()["q"]
    start[robot.index("pitch")] += 0.02
    flight = pt.fly(
        robot, pt.QuasiSteady(robot), kind(orbit, COMMANDS), orbit=orbit, duration=2.0, q=start,
        time_step=5e-4, sensors=NoisyState(delay=0.1 * orbit.period),
    )  # fmt: skip
    apart = flight["estimate"] - flight["reference"]
    assert 0.015 < np.nanmax(np.abs(apart.sel(state="pitch")[:3])) < 0.025
    assert np.abs(apart.sel(state="z")[-20:]).max() < 0.1
    still = pt.fly(
        robot, pt.QuasiSteady(robot), kind(orbit, COMMANDS), orbit=orbit, duration=0.3,
        time_step=5e-4, sensors=NoisyState(delay=0.1 * orbit.period),
    )  # fmt: skip
    apart = (still["estimate"] - still["reference"]).values[1:]
    assert np.abs(apart).max() < 2e-3  # of an orbit whose velocities swing by more than 1 m/s


def test_a_flight_without_an_answer_says_so(orbit):
    def old(truth):
        state = FlightState(truth.robot, -1.0, truth.q[-1], truth.v[-1])
        return Estimate(state, truth.a[-1])

    flight = flown(orbit, estimator=old, duration=0.3)
    assert flight.attrs["message"].endswith("; no sample was answered (late)")


def test_a_stuck_drive_holds_and_a_learner_is_told(orbit):
    class Counting:
        period = 0.002
        seen: list = []

        def learn(self, time, state, acceleration):
            self.seen.append((time, acceleration[2]))

    stuck = StuckEvent(time=0.3, command="rudder_offset", value=0.1)
    flight = flown(orbit, events=[stuck], learner=Counting())
    after = flight["command"].sel(command_name="rudder_offset").values[flight["time"] > 0.301]
    assert (after == 0.1).all()
    times, told = np.array(Counting.seen).T
    assert len(times) == pytest.approx(500, rel=0.03)  # whole steps
    a = flight["a"].sel(dof="z").values
    assert np.allclose(told, a[np.round(times / flight.attrs["time_step"]).astype(int)])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"events": [StuckEvent(time=0.1, command="tail_offset")]}, "tail_offset"),
        ({"events": [StuckEvent(time=9.0, command="frequency")]}, "within the flight of"),
        (  # flown at the end of the range, and told as 60 degrees
            {"events": [StuckEvent(time=0.1, command="rudder_offset", value=-1.0472)]},
            "stuck at -1.0472: value: expected at least -0.5236, as its range and its joints allow",
        ),
        ({"events": ["gust"]}, "Event such as"),
        ({"duration": -1.0}, "duration"),
        ({"orbit": None}, "Orbit such as"),
    ],
)
def test_what_cannot_be_flown_is_refused(orbit, options, said):
    given = {"orbit": orbit, "duration": 0.5, **options}
    controller = PredictiveController(orbit, COMMANDS)
    with pytest.raises(ParameterError, match=said):
        pt.fly(orbit.robot, orbit.aero, controller, **given)
    with pytest.raises(TypeError, match="did you mean seed"):
        pt.fly(orbit.robot, orbit.aero, controller, orbit=orbit, duration=0.5, sed=1)


def test_a_flight_that_breaks_is_kept(orbit):
    robot = orbit.robot
    down = {"q": robot.coordinates(pitch=1.3), "v": robot.velocities(x=4.0, pitch=10.0)}
    with pytest.raises(SimulationFailed) as failed:
        flown(orbit, duration=4.0, **down)
    kept = failed.value.flight
    assert kept.attrs["outcome"] == "LIMIT_REACHED" and "held" in kept.attrs
    assert 1 <= kept.sizes["control_time"] < 20 and kept["time"].values[-1] < 1.0
    assert flown(orbit, duration=4.0, throw=False, **down).identical(kept)


def test_a_tracker_of_sensors_is_good_enough_to_fly_with(orbit):
    """The newest sample, predicted to the present, errs less than the flight departs."""
    presets = pt.sensors.presets
    parts = [
        presets.icm_42688_p("body", rate=500.0),
        presets.as5600(rate=200.0),
        presets.prime_x_13("body", rate=120.0),
    ]
    flight = flown(orbit, sensors=TrackedState(parts), duration=0.4)
    assert json.loads(flight.attrs["held"]) == {"missing": 1}  # at the start
    places = np.round(flight["control_time"].values / flight.attrs["time_step"]).astype(int)
    true = np.hstack([flight["q"].values, flight["v"].values])[places[3:]]
    errors = np.sqrt(np.mean((flight["estimate"].values[3:] - true) ** 2, axis=0))
    names = list(flight["state"].values)
    for name, most in (("z", 5e-4), ("pitch", 5e-3), ("velocity of z", 0.02)):  # m, rad, m/s
        assert 0 < errors[names.index(name)] < most
    # what comes late is another time's: a smoother would be here
    smoothed = flight["q"].sel(dof="z").values[places[3:] - round(0.02 / 5e-4)]
    assert np.std(smoothed - true[:, names.index("z")]) > 20 * errors[names.index("z")]
    with pytest.raises(ParameterError, match="an Encoder or an Imu or a MotionCapture"):
        TrackedState([presets.nano17()])
    with pytest.raises(ParameterError, match="a name of its own"):
        TrackedState([parts[0], parts[0]])


def test_an_inertial_unit_that_saturates_on_the_orbit_is_refused(orbit):
    """Clipped readings were believed: an aerobat, 22 g, was tracked with errors of .3 m/s."""
    unit = pt.sensors.presets.icm_42688_p("body", rate=500.0)
    others = [pt.sensors.presets.as5600(rate=200.0), pt.sensors.presets.prime_x_13("body")]
    narrow = replace(unit, accelerometer_range=3.0)
    with pytest.raises(ParameterError, match=r"icm_42688_p.accelerometer_range: .*m/s\^2 at least"):
        flown(orbit, sensors=TrackedState([narrow, *others]), duration=0.1)
    with pytest.raises(ParameterError, match=r"gyroscope_range: .*rad/s at least"):
        turned = replace(unit, gyroscope_range=1e-3)
        flown(orbit, sensors=TrackedState([turned, *others]), duration=0.1)


def test_samples_in_the_loop_are_those_of_a_log(orbit):
    """What the tracker is given is what `sense` draws of the same flight with the same seed."""
    camera = pt.sensors.presets.prime_x_13("body")
    encoder = pt.sensors.presets.as5600(rate=200.0)
    from patagium.sensing.motion.motion_tracker import MotionTracker

    given = []
    push = MotionTracker.push

    def kept(self, name, stamp, values):
        given.append((name, stamp, values))
        push(self, name, stamp, values)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MotionTracker, "push", kept)
        flight = flown(orbit, sensors=TrackedState([camera, encoder]), duration=0.2, seed=7)
    log = pt.sense(flight, [camera, encoder], seed=7)
    rows = np.array([values for name, _, values in given if name == "as5600"])
    own = log["as5600"].position.values
    assert len(rows) > 30 and np.abs(rows - own[: len(rows)]).max() < 1e-9
    late = [time for name, time, _ in given if name == "prime_x_13"]
    assert late[-1] <= flight["control_time"].values[-1] - camera.delay + 1e-9


@pytest.mark.parametrize(("period", "refused"), [(10**30, True), (1e13, True), (1e9, False)])
def test_a_period_of_too_many_steps_is_refused_before_the_flight(orbit, period, refused):
    class Still:
        def __init__(self):
            self.period = period

        def __call__(self, time, state):
            return None

    if refused:
        with pytest.raises(ParameterError, match="period of the controller.*shorten it"):
            flown(orbit, Still(), duration=0.01)
    else:  # it is asked once
        assert len(flown(orbit, Still(), duration=0.01)["control_time"]) == 1
