"""Course of orbits that turn: departures, controllers along them, routes of several legs."""

from __future__ import annotations

import re
from functools import reduce

import numpy as np
import pytest

import patagium as pt
from patagium import control
from patagium.control.course import Course
from patagium.control.predictive import OrbitModel
from patagium.errors import ParameterError
from patagium.simulation.simulator import FlightState

STEERING = tuple(
    f"{side}_{name}"
    for name in ("plunge_amplitude", "feather_offset")
    for side in ("left", "right")
)


@pytest.fixture(scope="module")
def aerobat():
    return pt.load_robot("aerobat")


@pytest.fixture(scope="module")
def turn(aerobat):
    """Turn in which the robot slips sideways by a fifth of its speed."""
    free = ("frequency", "feather_offset", "feather_offset_difference")
    return pt.trim(aerobat, turn_rate=0.5, free=free)


@pytest.fixture(scope="module")
def straight(aerobat):
    return pt.trim(aerobat, free=("frequency", "feather_offset"))


def state_after(flight, model):
    """State of a model at the end of a flight."""
    size, names = len(model.robot.dof_names), model.robot.dof_names
    end = np.concatenate([flight.q.values[-1], flight.v.values[-1]])
    places = [names.index(n.removeprefix("velocity of ")) + size * n.startswith("vel")
              for n in model.names]  # fmt: skip
    return end[places]


def turned(model, state, angle):
    """State that has gone on by an angle along the circle of a model's course."""
    course, found = model.course, state.copy()
    center = np.array([course.center.real, course.center.imag])
    cosine, sine = np.cos(angle), np.sin(angle)
    matrix = np.array([[cosine, -sine], [sine, cosine]])
    for k, pair in enumerate(course.pairs):
        found[pair] = matrix @ (state[pair] - (k == 0) * center) + (k == 0) * center
    found[course.yaw] += angle
    return found


def test_departures_from_a_turn_are_those_of_the_linear_model(turn, rng):
    """Two beats without feedback, from any departure, also along x and of the heading."""
    model, robot = OrbitModel(turn, ("frequency",)), turn.robot
    beat = reduce(lambda done, way: way @ done, model.by_state)[: len(model.kept)]
    start, way = turn.start(), rng.uniform(-1, 1, len(model.names))
    errors = []
    for size in (1e-2, 5e-3):
        q, v = start["q"].copy(), start["v"].copy()
        for name, part in zip(model.names, size * way, strict=True):
            vector = v if name.startswith("vel") else q
            vector[robot.index(name.removeprefix("velocity of "))] += part
        expected = np.zeros(model.size)
        expected[: len(model.kept)] = model.course.apart(0, turn.states[0] + size * way)[model.kept]
        for _ in range(2):
            expected[: len(model.kept)] = beat @ expected
        flight = turn.flight(beats=2, q=q, v=v)
        found = model.course.apart(2 * model.parts, state_after(flight, model))[model.kept]
        scale = np.abs(expected).max()
        errors.append(np.abs(found - expected[: len(model.kept)]).max() / scale)
    # quadratic: half the step errs by half as much, relative to it
    assert errors[0] < 0.1 and errors[1] < 0.6 * errors[0]


def test_a_flight_that_is_late_is_compared_where_it_is(turn):
    model = OrbitModel(turn, ("frequency",))
    course, state = model.course, model.course.along(37)
    for angle in (-0.4, 2.0, -2.5):  # of more than a half circle nobody can tell
        late = turned(model, state, angle)
        late[course.yaw] += 2 * np.pi  # a tracker knows no whole turns
        before = course.lead
        course.catch_up(37, late)
        assert np.abs(course.apart(37, late)).max() < 1e-12
        assert course.lead == pytest.approx(before + angle, abs=1e-12)
        np.testing.assert_allclose(
            course.along(37)[:6], turned(model, state, angle)[:6], atol=1e-12
        )
        course.lead = before
    course.catch_up(37, np.full_like(state, np.nan))
    assert course.lead == before


def test_a_flight_that_crabs_and_is_late_is_on_its_line():
    """Ahead was along x alone: late by 1 m, and at an angle, a flight was moved off its line."""
    names = ("x", "y", "z", "yaw", "velocity of x", "velocity of y")
    states = np.array([[0.25 * k, 0.1 * k, 0.0, 0.0, 5.0, 2.0] for k in range(5)])
    course = Course(names, states)
    late = course.along(6) - 1.3 * np.array([0.25, 0.1, 0.0, 0.0, 0.0, 0.0])
    course.catch_up(6, late)
    assert np.abs(course.apart(6, late)[1:]).max() < 1e-12


def test_a_hover_has_no_way_ahead():
    """Its way of 1e-17 m made y of x, by any factor up to one."""
    names = ("x", "y", "z", "yaw", "velocity of x", "velocity of y")
    states = np.zeros((5, 6))
    states[-1, :3] = 2.6e-17, -1.9e-17, 0.02
    course = Course(names, states)
    assert course.stands and not course.ahead.any()
    away = np.array([0.5, 0.2, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(course.apart(6, course.along(6) + away), away, atol=1e-15)


@pytest.mark.parametrize(
    ("kind", "angle"),
    [(control.LinearRegulator, 2.1 * np.pi), (control.PredictiveController, 0.5 * np.pi)],
)
def test_a_turn_is_flown_round_and_round(turn, kind, angle):
    """Pushed off, and through more than a circle; the circle is held where y costs."""
    law = kind(turn, ("frequency", *STEERING), tolerable={"y": 0.1})
    robot, q = turn.robot, turn.start()["q"].copy()
    q[[robot.index(name) for name in ("z", "yaw")]] += 0.1
    beats = round(angle / law.model.course.turn)
    flight = pt.fly(
        robot, pt.QuasiSteady(robot), law, orbit=turn, duration=beats * turn.period, q=q,
        time_step=turn.period / 120,
    )  # fmt: skip
    assert flight.attrs["outcome"] == "COMPLETED"
    assert flight.q.sel(dof="yaw").values[-1] > 0.95 * angle
    model = law.model
    away = model.course.apart(beats * model.parts, state_after(flight, model))
    # steps of twice the length of the orbit's, and what is left of .1
    assert np.abs(away).max() < 5e-3
    off = (flight["estimate"] - flight["reference"]).sel(state=["x", "y", "z", "yaw"]).values
    assert np.abs(off[-200:]).max() < 5e-3


def test_a_learning_controller_keeps_the_turn(turn):
    law = control.LinearRegulator(turn, STEERING)
    adaptive = control.AdaptiveController(law)
    weights = np.array(adaptive.weights)
    weights[:5] = 0.95
    before = law.model.course
    assert adaptive.use(weights, 30)
    assert adaptive.orbit.turn_rate == pytest.approx(turn.turn_rate, rel=1e-6)
    means = [
        np.mean([course.along(k) for k in range(30, 40)], axis=0)
        for course in (before, law.model.course)
    ]
    places = [before.names.index(name) for name in ("x", "y", "z", "yaw")]
    np.testing.assert_allclose(means[0][places], means[1][places], atol=1e-9)


def test_a_route_goes_straight_turns_and_goes_straight(aerobat, straight):
    begin = {"gait": straight.gait, "speed": straight.speed, "free": STEERING, "start": straight}
    bend = pt.trim(aerobat, turn_rate=0.6, **begin)
    times = 10 * straight.period, 30 * straight.period
    law = control.LinearRegulator(straight, ("frequency", *STEERING))
    route = control.Route(law, {times[0]: bend, times[1]: straight})
    true = control.off_nominal(aerobat, 0.02, 3)
    flights = [
        pt.fly(
            true, pt.QuasiSteady(true), route, orbit=straight, duration=50 * straight.period,
            time_step=straight.period / 240,
        )
        for _ in range(2)
    ]  # fmt: skip
    flight = flights[0]
    assert flight.q.equals(flights[1].q)  # a second flight begins anew
    assert "Legs begun: 2 of 2." in flight.attrs["controller"]
    yaw = flight.q.sel(dof="yaw")
    # twenty beats of .6 rad/s; masses are 2 % off, and the bank takes a beat or two
    assert float(yaw[-1]) == pytest.approx(0.6 * 20 * straight.period, abs=0.05)
    # the heading of the first leg settles .01 beside the course, for masses are unlike
    assert np.ptp(yaw.values[-1200:]) < 0.03 and np.ptp(yaw.values[:2400]) < 0.03
    assert np.abs(flight.q.sel(dof="z").values).max() < 0.05
    way = np.hypot(*np.diff(flight.q.sel(dof=["x", "y"]).values[[-1200, -1]], axis=0)[0])
    assert way / (1199 * straight.period / 240) == pytest.approx(straight.speed, rel=0.05)


def test_a_leg_of_another_frequency_is_flown_at_its_own(ornithopter_orbit):
    """A bird at the limit of its amplitude, which flies faster only with a higher frequency."""
    first, robot = ornithopter_orbit, ornithopter_orbit.robot
    commands = ("frequency", "plunge_amplitude", "elevation_offset", "rudder_offset")
    begin = {"gait": first.gait, "speed": first.speed + 0.4, "start": first}
    assert not pt.trim(robot, free=commands[1:], **begin).found
    fast = pt.trim(robot, free=commands, **begin)
    own, law = (control.LinearRegulator(orbit, commands) for orbit in (fast, first))
    law.follow(fast, fast.parameters, 30)
    expected, found = (np.sort(np.abs(one.multipliers)) for one in (own, law))
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert law.period == pytest.approx(fast.period / 10)
    begun = 30 * first.period / 10
    assert law.model.time(37) == pytest.approx(begun + 7 * law.period)
    assert law.model.number(begun + 7.3 * law.period) == 37

    route = control.Route(control.LinearRegulator(first, commands), {1.0: fast, 5.0: first})
    flight = pt.fly(robot, pt.QuasiSteady(robot), route, orbit=first, duration=8.0)
    off = (flight.estimate - flight.reference).sel(state=["z", "pitch", "velocity of z"])
    time = flight.control_time
    for begin, end, period in ((0.0, 1.0, first.period), (4.0, 5.0, fast.period)):
        part = (time >= begin) & (time < end)
        assert float(time[part].diff("control_time").mean()) == pytest.approx(period / 10, 1e-3)
    # the way to the leg takes some seconds; as a lag of .2 beats it would be .2 off
    late = ((time > 4.0) & (time < 5.0)) | (time > 7.0)
    assert np.abs(off.values[late]).max() < 0.05
    again = pt.fly(robot, pt.QuasiSteady(robot), route, orbit=first, duration=1.2)
    once = flight.q.sel(time=again.time)  # which had the period of the last leg at first
    np.testing.assert_array_equal(again.q.values[: len(once)], once.values)
    again = control.Route(control.LinearRegulator(first, commands), {1.0: fast, 5.0: first})
    steps = round(8.0 / first.time_step) * first.time_step
    other = first.flight(controller=again, duration=steps)
    for name in ("z", "pitch"):  # instants of calls are rounded to longer steps
        a, b = (float(one.q.sel(dof=name)[-1]) for one in (flight, other))
        assert a == pytest.approx(b, abs=5e-3)


@pytest.mark.parametrize("change", [{"speed": 6.4}, {"turn_rate": 0.6}])
def test_a_late_sample_is_taken_to_the_present_along_its_leg(
    aerobat, straight, ornithopter_orbit, change
):
    """A late sample was brought up along the first orbit, whatever the leg's beat and heading."""
    first, commands = straight, ("frequency", *STEERING)
    if "speed" in change:
        first = ornithopter_orbit
        commands = ("frequency", "plunge_amplitude", "elevation_offset", "rudder_offset")
    begin = {"gait": first.gait, "speed": first.speed, "start": first, "free": commands}
    leg, period = pt.trim(first.robot, **(begin | change)), first.period
    route = control.Route(control.LinearRegulator(first, commands), {2 * period: leg})
    flight = pt.fly(
        first.robot, first.aero, route, orbit=first, duration=24 * period,
        time_step=period / 240, sensors=control.NoisyState(delay=0.1 * period),
    )  # fmt: skip
    late = flight.estimate[-20:].rename(state="dof")
    body = ["x", "y", "roll", "pitch", "yaw"]
    for name, prefix, most in (("q", "", 0.01), ("v", "velocity of ", 0.3)):
        true = flight[name].sel(dof=body).interp(time=late.control_time)
        known = late.sel(dof=[prefix + one for one in body])
        assert np.abs(known.values - true.values).max() < most  # .14 and 4.7 along the first orbit


def test_legs_that_cannot_be_flown_are_named(aerobat, straight, turn, ornithopter_orbit):
    law = control.LinearRegulator(straight, ("frequency", *STEERING))
    found = pt.trim(aerobat, gait=straight.gait, free=("frequency", "feather_offset"), speed=4.45)
    for legs, told in (
        ({2.0: turn}, r"^legs: 2 s: .* \(trim\(gait=orbit.gait\)\)"),
        ({2.0: found}, "^legs: 2 s: free: expected of frequency, left_p.* 'feather_offset'"),
        ({2.0: ornithopter_orbit}, "^legs: 2 s: expected an orbit of aerobat, found 'ornithopter'"),
        ({2.0: straight, 1.0: straight}, "^legs: expected rising times"),
        ({0.0: straight}, "^legs: expected rising times"),
    ):
        with pytest.raises(ParameterError, match=told):
            control.Route(law, legs)


@pytest.mark.parametrize(("name", "bend"), [("y", True), ("yaw", True), ("velocity of z", False)])
def test_limits_that_a_leg_cannot_keep_are_refused_before_the_flight(aerobat, straight, name, bend):
    """They were checked on the first orbit alone: a turn of .6 rad/s flew 1.0 with one of y."""
    begin = {"gait": straight.gait, "speed": straight.speed, "start": straight}
    to = {"turn_rate": 0.6} if bend else {"climb": -0.6}
    leg = pt.trim(aerobat, free=("frequency", *STEERING), **begin, **to)
    first = OrbitModel(straight, ("frequency",)).course.states
    most = np.abs(first[:, straight.names.index(name)]).max() if not bend else 0.5
    limits = {name: (-0.5 if bend else most - 0.05, most + 0.05)}
    law = control.PredictiveController(straight, ("frequency", *STEERING), limits=limits)
    told = f"expected a state that the orbit .* '{name}'" if bend else f"{name}: .* the orbit's"
    with pytest.raises(ParameterError, match=f"^legs: 2 s: limits: {told}"):
        control.Route(law, {1.0: straight, 2.0: leg})


def test_a_limit_of_y_is_one_across_the_line_of_the_orbit(straight):
    """It was about the origin of the world, which another line leaves ever further."""
    law = control.PredictiveController(
        straight, ("frequency", *STEERING), limits={"y": (-0.5, 0.5), "z": (-2.0, 9.0)}
    )
    course, program = law.model.course, law.iteration.program
    course.origin, course.heading = np.array([3.0, 5.0, 1.0]), 0.3
    names = [law.model.names[k] for k in law.model.kept]
    for first in (0, 1007):
        law.answer(first, np.zeros(law.model.size), np.zeros(len(law.ends)))
        y, z = (program["least"][:, names.index(name)] for name in ("y", "z"))
        np.testing.assert_allclose(y, -0.5, atol=1e-9)  # an orbit without side force
        assert np.abs(z + 3.0).max() < 0.1  # heights are the world's; less than a stroke moves it


def test_a_command_that_ends_at_its_range_is_given(aerobat, straight):
    """A program keeps ranges to rounding: an amplitude of -1e-12 ended the flight."""
    commands, limits = ("frequency", *STEERING), {"velocity of z": (-0.3, 0.3)}
    law = control.PredictiveController(straight, commands, limits=limits)
    law.answer = lambda *given: law.low - law.model.neutral - 1e-12
    start = straight.start()
    found = law(0.0, FlightState(aerobat, 0.0, start["q"], start["v"]))
    scales = [law.model.steered.scale(name) for name in commands]
    np.testing.assert_allclose(list(found.values()), law.low / scales, rtol=1e-15)  # of a product
    assert found["left_plunge_amplitude"] == 0.0


@pytest.mark.filterwarnings("ignore:LinearRegulator. called after")  # ticks are samples' stamps
def test_an_autopilot_flies_a_turn_as_the_regulator_does(turn):
    from patagium.live import Autopilot
    from patagium.native import compiler_name

    if compiler_name() is None:
        pytest.skip("needs a C compiler")
    presets, robot = pt.sensors.presets, turn.robot
    log = pt.sense(turn.flight(beats=6), [presets.as5600(), presets.prime_x_13("body")])
    laws = [control.LinearRegulator(turn, ("frequency", *STEERING)) for _ in range(2)]
    trackers = [
        pt.sensing.MotionTracker(robot, log.sensors, control.driving_noise(turn)) for _ in range(2)
    ]
    samples = log.samples()
    while not trackers[0].started:
        name, stamp, row = samples.pop(0)
        for tracker in trackers:
            tracker.push(name, stamp, row)
    autopilot = Autopilot(trackers[0], laws[0])
    answered = 0
    for name, stamp, row in samples:
        tick = autopilot.step(stamp, {name: [stamp, *row]})
        trackers[1].push(name, stamp, row)
        now = trackers[1].now(max(stamp, trackers[1].span[1]))
        if tick.commanded[0]:
            laws[1](stamp, FlightState(robot, stamp, now.q, now.v))
            answered += 1
            scale = [laws[1].model.steered.scale(one) for one in laws[1].model.commands]
            wanted = (laws[1].before + laws[1].model.neutral) / scale
            np.testing.assert_allclose(tick.commands[0], wanted, rtol=1e-9, atol=1e-11)
    assert answered > 30 and abs(laws[1].model.course.lead) > 1e-6


def test_a_slow_turn_of_a_fast_beat_is_a_turn():
    """A turn of less than 1e-4 rad a beat was refused, as motion that is not periodic."""
    names = ("x", "y", "z", "yaw", "velocity of x", "velocity of y")
    for turn in (7e-5, 2e-6):
        angles = turn * np.linspace(0.0, 1.0, 5)
        way = 0.1 * (np.exp(1j * angles) - 1.0) / (1j * turn)
        along = 10.0 * np.exp(1j * angles)
        rows = (way.real, way.imag, 0 * angles, angles, along.real, along.imag)
        course = Course(names, np.column_stack(rows))
        assert course.turn == pytest.approx(turn)
        end = course.along(4 * 1000)  # 1000 beats
        assert end[3] == pytest.approx(1000 * turn)
        assert end[5] == pytest.approx(10.0 * np.sin(1000 * turn))
        circle = 0.1 * (np.exp(1000j * turn) - 1.0) / (1j * turn)
        assert complex(*end[:2]) == pytest.approx(circle, abs=1e-6)


def test_what_is_no_course_is_refused(turn):
    names = ("x", "y", "z", "yaw", "velocity of x", "velocity of y")
    spot = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.3, 0.0, 0.0]])
    with pytest.raises(ParameterError, match="^orbit: .*found 'a turn on the spot, of radius 0 m'"):
        Course(names, spot)
    faster = np.array([[0.0, 0.0, 0.0, 0.0, 1.0, 0.0], [0.1, 0.0, 0.0, 0.0, 1.1, 0.0]])
    with pytest.raises(
        ParameterError, match="returns after a beat.*'velocity of x changes by 0.1'"
    ):
        Course(names, faster)
    told = re.escape("limits: expected a state that the orbit brings back, such as z")
    with pytest.raises(ParameterError, match=told):
        control.PredictiveController(turn, ("frequency", *STEERING), limits={"yaw": (-1.0, 1.0)})


def test_a_plan_has_legs(aerobat):
    from patagium.cli.plan import Plan, prepared

    legs = [
        {"time": 0.6, "turn_rate": 0.6},
        {"time": 1.2, "speed": 4.5},
        {"time": 1.8, "turn_rate": 0},
    ]
    given = {
        "robot": "aerobat",
        "controller": {"type": "regulator", "commands": ["frequency", *STEERING]},
        "legs": legs, "events": [], "duration": 2.4, "time_step": 4e-4,
    }  # fmt: skip
    ready = prepared(Plan.model_validate(given))
    orbits = list(ready.controller.legs.values())
    assert [round(one.turn_rate, 9) for one in orbits] == [0.6, 0.6, 0.0]
    assert orbits[0].speed == pytest.approx(ready.orbit.speed, abs=1e-9)
    assert [one.speed for one in orbits[1:]] == pytest.approx([4.5, 4.5], abs=1e-9)
    assert "From 1.2 s on: 4.5 m/s, climb 0 m/s, turn 0.6 rad/s" in ready.words
    flight = ready.fly()
    assert "Legs begun: 3 of 3." in flight.attrs["controller"]
    assert float(flight.q.sel(dof="yaw")[-1]) == pytest.approx(0.72, abs=0.08)  # as above
    learning = given | {"controller": {**given["controller"], "learn": True}}
    with pytest.raises(ParameterError, match="^legs: expected a controller that does not learn"):
        prepared(Plan.model_validate(learning))
