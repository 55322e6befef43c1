"""The motion filter in C against that in NumPy; an autopilot against its parts in Python."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from tests.own_learner import OwnLearner

import patagium as pt
from patagium.control import LinearRegulator, driving_noise
from patagium.errors import FilterDiverged, LogError, ParameterError, ShapeError
from patagium.live import Autopilot
from patagium.native import compiler_name
from patagium.sensing import MotionTracker
from patagium.simulation.simulator import FlightState

pytestmark = pytest.mark.skipif(compiler_name() is None, reason="needs a C compiler")
P = pt.sensors.presets
TURNED = ((0.0, -0.6, 0.8), (1.0, 0.0, 0.0), (0.0, 0.8, 0.6))
COMMANDS = ("frequency", "plunge_amplitude", "elevation_offset", "rudder_offset")
UNIT = replace(P.icm_42688_p("body", rate=500.0), position=(0.02, 0.01, 0.0), orientation=TURNED)
CAMERA = replace(P.prime_x_13("body"), position=(0.0, 0.03, 0.01), orientation=TURNED)


def tracked(orbit, sensors, count=None, compiled=True, log=None):
    """Tracker after so many samples of a flight along an orbit."""
    log = pt.sense(orbit.flight(beats=2), sensors) if log is None else log
    tracker = MotionTracker(orbit.robot, log.sensors, driving_noise(orbit), memory=0.03)
    for part in tracker.parts if not compiled else ():
        part.filter.compiled = None
    for name, time, row in log.samples()[:count]:
        tracker.push(name, time, row)
    return tracker


def learning(robot):
    return pt.Pipeline(pt.ExtendedLearner(pt.StripNetwork(robot)), robot)


@pytest.fixture(scope="module")
def orbit():
    return pt.trim(pt.load_robot("ornithopter"))


@pytest.fixture(scope="module")
def log(orbit):
    return pt.sense(orbit.flight(beats=2), [UNIT, P.as5600(rate=500.0), CAMERA])


# Rounding of some hundred updates: entries of a root differ by 1e-13 of the largest.
CLOSE = {"rtol": 1e-9, "atol": 1e-9}


@pytest.mark.parametrize("body", ["body", "left_wing"])
def test_the_filter_in_c_is_that_in_numpy(orbit, body):
    unit = replace(UNIT, body=body)  # one on a wing links its joints with the body
    sensors = [unit, P.as5600(rate=500.0), CAMERA, replace(CAMERA, name="other", body="body")]
    log = pt.sense(orbit.flight(beats=2), sensors)
    one, other = (tracked(orbit, sensors, compiled=way, log=log) for way in (True, False))
    assert all(part.filter.compiled is not None for part in one.parts)
    for found, expected in zip(vars(one.now()).values(), vars(other.now()).values(), strict=True):
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * scale)
    times = np.linspace(*one.span, 7)
    past = other.past(times)
    np.testing.assert_allclose(one.past(times), past, rtol=1e-7, atol=1e-9 * np.abs(past).max())


def test_a_turn_by_half_and_a_jump_are_those_of_numpy(orbit, log):
    """Cameras that show the body turned by half a turn: far, so that slopes are taken again."""
    first = tracked(orbit, [], 40, True, log), tracked(orbit, [], 40, False, log)
    camera = CAMERA.name
    stamp = float(first[0].span[1]) + 1e-3
    for tracker in first:
        tracker.push(camera, stamp, [1.0, 0.2, -0.3, 0.0, 0.6, 0.0, 0.8])
    found, expected = (tracker.now() for tracker in first)
    np.testing.assert_allclose(np.exp(1j * found.q), np.exp(1j * expected.q), atol=1e-6)
    np.testing.assert_allclose(found.v, expected.v, rtol=1e-6, atol=1e-6)
    with pytest.raises(FilterDiverged, match="raise their std"):
        first[0].push(camera, stamp + 1e-3, [1e300, -1e300, 1e300, 1.0, 0.0, 0.0, 0.0])


@pytest.mark.filterwarnings("ignore:LinearRegulator. called after")  # ticks are samples' arrivals
def test_an_autopilot_is_its_parts(orbit, log):
    """Samples that come late, values and samples that are missing, two kinds of intervals."""
    robot, count = orbit.robot, 40
    flown = orbit.flight(beats=2)
    trackers = [tracked(orbit, [], count, True, log) for _ in range(2)]
    pipelines = [learning(robot) for _ in range(2)]
    regulators = [LinearRegulator(orbit, COMMANDS) for _ in range(2)]
    autopilot = Autopilot(trackers[0], regulators[0], pipelines[0], every=3)
    rng = np.random.default_rng(3)
    delays = {CAMERA.name: 0.0042, UNIT.name: 0.0, P.as5600().name: 0.0}
    given = [(one[1] + delays[one[0]], *one) for one in log.samples()[count:]]
    rows = []
    for arrival, name, stamp, row in sorted(given, key=lambda one: one[:2]):
        tick = np.full(autopilot.places["forces"].stop, np.nan)
        tick[0] = arrival
        row = np.where(rng.random(len(row)) < 0.03, np.nan, row)
        tick[autopilot.places[name]] = np.r_[stamp, row]
        place = min(np.searchsorted(flown["time"].values, arrival), len(flown["time"]) - 1)
        tick[autopilot.places["forces"]] = flown["u1"].values[place]
        rows.append(tick)
    found = autopilot.run(rows)
    regulator, due, learned = regulators[1], 0.0, 0
    for k, row in enumerate(rows):
        for name in delays:
            stamp, *values = row[autopilot.places[name]]
            if np.isfinite(stamp):
                trackers[1].push(name, stamp, values)
        now = trackers[1].now(max(row[0], trackers[1].span[1]))
        np.testing.assert_allclose(found.motion[k], [now.q, now.v, now.a], **CLOSE)
        if k % 3 == 0:
            forces = row[autopilot.places["forces"]]
            record = pipelines[1].step(np.concatenate([row[:1], now.q, now.v, now.a, forces]))
            for name in ("prediction", "std", "measurement", "outcome"):
                mine = getattr(found.learned, name)[k // 3]
                # rounding of accelerations of 1e3 rad/s^2, learned from
                np.testing.assert_allclose(mine, getattr(record, name)[0], rtol=1e-6, atol=1e-6)
            learned += int(record.outcome[0] == 0)
        assert found.commanded[k] == (row[0] >= due - 1e-9)
        if found.commanded[k]:
            regulator(row[0], FlightState(robot, row[0], now.q, now.v))
            due = (round(row[0] / regulator.period) + 1) * regulator.period
        scale = [regulator.model.steered.scale(name) for name in COMMANDS]
        wanted = (regulator.before + regulator.model.neutral) / scale
        np.testing.assert_allclose(found.commands[k], wanted, rtol=1e-9, atol=1e-12)
    assert len(found.learned) == -(-len(rows) // 3)
    assert learned > 20 and found.commanded.sum() > 15  # both did something
    assert np.ptp(found.commands, axis=0).min() > 0.0
    assert autopilot.counts == {"late": 0, "refused": 0, "raised": 0, "held": 0}
    assert pipelines[0].learner.events == pipelines[1].learner.events
    np.testing.assert_allclose(
        pipelines[0].learner.weights, pipelines[1].learner.weights, rtol=1e-5, atol=1e-6
    )


def test_what_cannot_be_weighed_is_left_out_and_counted(orbit, log):
    tracker = tracked(orbit, [], 40, True, log)
    autopilot = Autopilot(tracker, LinearRegulator(orbit, COMMANDS))
    now = tracker.span[1] + 1e-3
    wild = [now, 1e300, -1e300, 1e300, 1.0, 0.0, 0.0, 0.0]
    before = autopilot.step(now, {})
    after = autopilot.step(now, {CAMERA.name: wild})
    assert autopilot.counts["refused"] == 1
    np.testing.assert_allclose(after.motion, before.motion, rtol=1e-9, atol=1e-9)
    old = [now - 1.0, *np.zeros(3), 1.0, 0.0, 0.0, 0.0]
    autopilot.step(now, {CAMERA.name: old})
    assert autopilot.counts["late"] == 1
    for stamp in (now + 1.0, 1e300, np.inf):  # not yet taken: a later sample would end the filter
        wrong = autopilot.step(now, {CAMERA.name: [stamp, *np.zeros(3), 1.0, 0.0, 0.0, 0.0]})
        np.testing.assert_array_equal(wrong.motion, after.motion)
    assert autopilot.counts["refused"] == 4
    lost = [now, *np.full(7, np.nan)]
    np.testing.assert_array_equal(autopilot.step(now, {CAMERA.name: lost}).motion, after.motion)


def test_a_motion_that_is_no_number_holds_the_last_commands(orbit, log):
    tracker = tracked(orbit, [], 40, True, log)
    autopilot = Autopilot(tracker, LinearRegulator(orbit, COMMANDS))
    first = autopilot.step(tracker.span[1], {})
    later = autopilot.step(1e300, {})
    assert first.commanded.all() and not later.commanded.any()
    np.testing.assert_array_equal(later.commands, first.commands)
    assert autopilot.counts["held"] == 1


def test_a_wild_time_ends_nothing(orbit, log):
    """A time that goes back or far ahead; the same in one call of many rows and in many calls."""
    tracker = tracked(orbit, [], 40, True, log)
    begin = tracker.span[1]
    autopilots = [Autopilot(tracker, LinearRegulator(orbit, COMMANDS)) for _ in range(3)]
    right = begin + 1e-3 * np.arange(20)
    times = np.insert(right, 5, [right[4] + 1e6, right[4] - 0.01])
    rows = np.full((len(times), autopilots[0].places["forces"].stop), np.nan)
    rows[:, 0] = times
    whole = autopilots[0].run(rows)
    steps = np.vstack([autopilots[1].step(time, {}).rows for time in times])
    np.testing.assert_array_equal(whole.rows[:, :-1], steps[:, :-1])
    assert autopilots[0].counts == {"late": 1, "refused": 0, "raised": 0, "held": 1}
    assert autopilots[1].counts == autopilots[0].counts
    undisturbed = autopilots[2].run(rows[np.isin(times, right)])
    others = np.delete(whole.rows, [5, 6], 0)
    np.testing.assert_array_equal(others[:, :-1], undisturbed.rows[:, :-1])
    np.testing.assert_array_equal(whole.commands[5:7], whole.commands[[4, 4]])
    assert not whole.commanded[5:7].any()
    autopilots[2].run(np.full((2, rows.shape[1]), np.nan))
    assert autopilots[2].counts["late"] == 2
    late = [autopilots[0].step(begin + 5.0 + 1e-3 * k, {}) for k in range(11)]
    assert np.isfinite(late[-1].motion).all() and not np.isfinite(late[0].motion).any()


@pytest.mark.filterwarnings("ignore:LinearRegulator. called after")  # ticks are samples' arrivals
def test_an_autopilot_goes_on_where_its_parts_stand(orbit, log):
    """In the middle of ramps, with a camera that is late and outliers that count as loud."""
    rng, delays = np.random.default_rng(0), {CAMERA.name: 0.0042}
    samples = [
        (stamp + delays.get(name, 0.0), name, stamp, row * (1.5 if rng.random() < 0.1 else 1.0))
        for name, stamp, row in log.samples()[40:]
    ]
    tracker, regulator = tracked(orbit, [], 40, True, log), LinearRegulator(orbit, COMMANDS)
    autopilots, due, commanded = [], 0.0, 0
    scale = [regulator.model.steered.scale(name) for name in COMMANDS]
    for k, (time, name, stamp, row) in enumerate(sorted(samples, key=lambda one: one[0])):
        tracker.push(name, stamp, row)
        now, given = tracker.now(max(time, tracker.span[1])), time >= due - 1e-9
        ticks = [one.step(time, {name: [stamp, *row]}) for one in autopilots]
        if given:
            regulator(time, FlightState(orbit.robot, time, now.q, now.v))
            due = (round(time / regulator.period) + 1) * regulator.period
        wanted = (regulator.before + regulator.model.neutral) / scale
        for tick in ticks:
            assert tick.commanded[0] == given
            commanded += given
            np.testing.assert_allclose(tick.motion[0], [now.q, now.v, now.a], **CLOSE)
            np.testing.assert_allclose(tick.commands[0], wanted, rtol=1e-9, atol=1e-12)
        if k in (140, 150, 155) or given and 160 < k < 180:
            lasting = regulator.model.steered.answers[-1]
            assert (lasting.time + lasting.lasting > time).any()  # of the ramps
            autopilots.append(Autopilot(tracker, regulator))
    assert commanded > 20 and len(autopilots) > 3
    assert tracker.raised > 0 and tracker.late == 0


def test_a_heading_counts_but_for_whole_turns(orbit, log):
    """The tracker's yaw is within half a turn; that of a straight leg after turns is beyond it."""
    tracker, found = tracked(orbit, [], 40, True, log), []
    now = tracker.now()
    for turns in (0, 1):
        regulator = LinearRegulator(orbit, COMMANDS)
        regulator.model.course.heading = 2 * np.pi * turns
        found.append(Autopilot(tracker, regulator).step(now.time, {}).commands[0])
        given = regulator(now.time, FlightState(orbit.robot, now.time, now.q, now.v))
        found.append(list(given.values()))
    for one in found:  # rounding of a sine of whole turns, times gains of some ten
        np.testing.assert_allclose(one, found[0], rtol=1e-9, atol=1e-12)


def test_a_loop_goes_on_after_a_gap(orbit, log):
    """Two ticks have one time, as two sensors of one rate have: none was believed ever again."""
    tracker = tracked(orbit, [], 40, True, log)
    autopilot, begin = Autopilot(tracker, LinearRegulator(orbit, COMMANDS)), tracker.span[1]
    times = np.repeat(begin + 0.05 + 1e-3 * np.arange(40), 2)  # the memory is .03 s
    given = [bool(autopilot.step(time, {}).commanded[0]) for time in times]
    assert sum(given) > 1 and autopilot.counts["held"] == 18


def test_a_clock_that_is_set_ahead_costs_a_moment(orbit, log):
    """The estimate was extrapolated over the jump, to positions of 1e70 m."""
    tracker, late = tracked(orbit, [], 0, True, log), {CAMERA.name: CAMERA.delay}
    samples = [
        (name, stamp, stamp - late.get(name, 0.0), row) for name, stamp, row in log.samples()
    ]
    tracker.memory = 0.1  # s, as by default
    for name, _, true, row in samples[:40]:
        tracker.push(name, true, row)
    autopilots = [Autopilot(tracker, LinearRegulator(orbit, COMMANDS)) for _ in range(2)]
    away = []
    for k, (name, stamp, true, row) in enumerate(samples[40:]):
        jumps = zip(autopilots, (0.0, 1e3 * (k >= 250)), strict=True)
        ticks = [one.step(stamp + jump, {name: [true + jump, *row]}) for one, jump in jumps]
        away.append(np.abs(ticks[1].motion[0, 0] - ticks[0].motion[0, 0]).max())
    assert max(away[:250]) == 0.0
    assert np.nanmax(away) < 10.0  # m, rad: wings that go on through a memory of .1 s
    assert max(away[330:]) < 0.01  # some deviations of the encoders' noise
    assert autopilots[1].counts | {"held": 0} == autopilots[0].counts


def test_a_time_without_end_is_never_believed(orbit, log):
    """Nanoseconds in place of seconds, where the number of an interval is none any more."""
    tracker = tracked(orbit, [], 40, True, log)
    autopilot = Autopilot(tracker, LinearRegulator(orbit, COMMANDS))
    ticks = [autopilot.step(1e17 * (1 + 0.01 * k), {}) for k in range(20)]
    assert not any(tick.commanded[0] for tick in ticks) and autopilot.counts["held"] == 20
    assert autopilot.step(tracker.span[1], {}).commanded[0]


def test_parts_that_do_not_go_together_are_refused(orbit, log):
    regulator = LinearRegulator(orbit, COMMANDS)
    tracker = tracked(orbit, [], 40, True, log)
    with pytest.raises(LogError, match="expected samples pushed to it"):
        Autopilot(tracked(orbit, [], 0, True, log), regulator)
    with pytest.raises(ParameterError, match="every: expected a number of ticks, 1 or more"):
        Autopilot(tracker, regulator, every=0)
    other = pt.load_robot("aerobat")
    with pytest.raises(ParameterError, match="the same robot in all parts, with Euler"):
        Autopilot(tracker, regulator, learning(other))
    slow = pt.Pipeline(OwnLearner(pt.StripNetwork(orbit.robot)), orbit.robot)
    with pytest.raises(ParameterError, match="pipeline: expected a compiled pipeline"):
        Autopilot(tracker, regulator, slow)
    faster = LinearRegulator(orbit, COMMANDS)
    faster.model.pace = 1.1
    with pytest.raises(ParameterError, match="at the frequency of the gait itself"):
        Autopilot(tracker, faster)
    tracker.shifts = {CAMERA.name: 0.1}
    with pytest.raises(ParameterError, match="a tracker without clock shifts"):
        Autopilot(tracker, regulator)
    autopilot = Autopilot(tracked(orbit, [], 40, True, log), regulator)
    with pytest.raises(ParameterError, match="samples: expected those of"):
        autopilot.step(1.0, {"gps": [1.0, 2.0]})
    with pytest.raises(ShapeError, match=CAMERA.name):
        autopilot.step(1.0, {CAMERA.name: [1.0, 2.0]})
    with pytest.raises(ShapeError, match="rows"):
        autopilot.run(np.zeros((2, 3)))


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_copy_is_refused(orbit, log, again):
    """A shallow one moved the original, which then counted its samples as late."""
    autopilot = Autopilot(tracked(orbit, [], 40, True, log), LinearRegulator(orbit, COMMANDS))
    with pytest.raises(ParameterError, match=r"copy: expected another Autopilot\(tracker, reg"):
        again(autopilot)


def test_arguments_of_a_wrong_kind_are_told(orbit, log):
    autopilot = Autopilot(tracked(orbit, [], 40, True, log), LinearRegulator(orbit, COMMANDS))
    with pytest.raises(ParameterError, match="time: expected"):
        autopilot.step("now", {})
    with pytest.raises(ParameterError, match="samples: expected"):
        autopilot.step(1.0, [1.0])
    with pytest.raises(ParameterError, match=CAMERA.name):
        autopilot.step(1.0, {CAMERA.name: "seen"})
    with pytest.raises(ParameterError, match="rows: expected"):
        autopilot.run("all")
    with pytest.raises(ParameterError, match="tracker: expected"):
        Autopilot("tracker", LinearRegulator(orbit, COMMANDS))
