"""Does a model of the air that relearns in flight bring a changed robot back to its orbit?"""

from types import SimpleNamespace

import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics.description import aero_from_description
from patagium.air import LearnedAir, QuasiSteady, SmoothPolar
from patagium.control import (
    AdaptiveController,
    AirWeights,
    LinearRegulator,
    NoisyState,
    PredictiveController,
    WingLossEvent,
)
from patagium.control.adaptation import TRIAL, Departures, Disturbance, _Beat
from patagium.errors import ParameterError, ShapeError
from patagium.simulation.simulator import FlightState

COMMANDS = (
    *("left_plunge_amplitude", "right_plunge_amplitude"),
    *("left_feather_offset", "right_feather_offset", "feather_amplitude"),
)
TOLERABLE = {"yaw": 0.4, "roll": 0.3, "pitch": 0.3, "velocity of y": 1.0}
FIRM = {
    **{"z": 0.1, "roll": 0.1, "pitch": 0.3, "yaw": 0.1},
    **{"velocity of x": 0.25, "velocity of y": 1.0, "velocity of z": 1.0},
    **{f"velocity of {name}": 10.0 for name in ("roll", "pitch", "yaw")},
}
BEATS = 40


@pytest.fixture(scope="module")
def orbit():
    robot = pt.load_robot("aerobat")
    return pt.trim(robot, QuasiSteady(robot, polar=SmoothPolar()))


def test_learned_air_is_its_model_with_strips_scaled_and_a_wrench_added(orbit):
    robot, draw = orbit.robot, np.random.default_rng(3)
    q, v = robot.coordinates(roll=0.2, pitch=-0.4, left_plunge=0.3), draw.normal(size=robot.dof)
    plain = LearnedAir(orbit.aero).generalized_force(q, v)
    model = orbit.aero.generalized_force(q, v)
    np.testing.assert_allclose(plain, model, rtol=1e-12, atol=1e-15)
    weights = np.array(LearnedAir(orbit.aero).weights)
    weights[4], weights[-3:] = 0.3, [0.01, 0.03, 2e-4]
    narrow = robot.with_parameters({"left_wing[4].width": 0.3 * float(robot.strips[4].width)})
    lesser = QuasiSteady(narrow, polar=SmoothPolar()).generalized_force(q, v)
    more = LearnedAir(orbit.aero, weights).generalized_force(q, v) - lesser
    side = -np.sin(0.2) * 0.03  # across the heading, of a force in body axes: pitch, then roll
    assert more[1] == pytest.approx(side, rel=1e-9)
    assert np.linalg.norm(more[:3]) == pytest.approx(np.linalg.norm(weights[-3:-1]), rel=1e-9)
    assert np.abs(more[6:]).max() < 1e-15  # the joints carry none of it


def test_learned_air_is_made_again_from_its_description(orbit):
    weights = np.linspace(0.5, 1.0, len(orbit.robot.strips) + 3)
    model = LearnedAir(orbit.aero, weights)
    again = aero_from_description(orbit.robot, model.describe())
    assert again == model
    np.testing.assert_array_equal(again.parameters[-13:], weights)


@pytest.mark.parametrize(
    ("weights", "error"),
    [(np.ones(3), ShapeError), (np.full(13, np.nan), ParameterError)],
)
def test_weights_that_are_none_are_refused(orbit, weights, error):
    with pytest.raises(error, match="weights"):
        LearnedAir(orbit.aero, weights)


def test_weights_are_the_minimum_of_forgotten_squares():
    draw, stds = np.random.default_rng(0), np.array([0.5, 0.2, 2.0])
    learner, kept = AirWeights(np.ones(3), stds, memory=4.0), 0.75
    beats = [(draw.normal(size=(7, 3)), draw.normal(size=7)) for _ in range(5)]
    for slopes, measured in beats:
        learner.learn(slopes, measured)
    age = kept ** np.arange(4, -1, -1)
    rows = np.vstack([*(a**0.5 * h for a, (h, _) in zip(age, beats, strict=True))])
    told = np.concatenate([a**0.5 * y for a, (_, y) in zip(age, beats, strict=True)])
    prior = np.diag(1 / stds)  # never forgotten
    found = np.linalg.lstsq(np.vstack([rows, prior]), np.r_[told, 1 / stds], rcond=None)[0]
    np.testing.assert_allclose(learner.weights, found, rtol=1e-10)


def test_a_prior_that_changes_after_it_was_given_changes_no_weights():
    prior, stds = np.ones(3), np.ones(3)
    mine, other = (AirWeights(p, s, memory=4.0) for p, s in ((prior, stds), (prior + 0, stds + 0)))
    prior[:] = stds[:] = 7.0
    for learner in (mine, other):
        learner.learn(np.ones((2, 3)), np.zeros(2))
    assert np.array_equal(mine.weights, other.weights)
    assert np.array_equal(mine.stds, other.stds)


def test_what_is_forgotten_tells_nothing_any_more():
    draw, learner = np.random.default_rng(0), AirWeights(np.ones(3), np.ones(3), memory=4.0)
    for _ in range(5):
        slopes = draw.normal(size=(7, 3))
        learner.learn(slopes, slopes @ np.array([2.0, 0.5, 1.0]))
    assert learner.better
    learner.forget(1.0)
    np.testing.assert_allclose(learner.weights, learner.prior, rtol=1e-12)
    assert not learner.better  # errors of before belong to the robot of before


@pytest.mark.parametrize(
    ("name", "given", "error"),
    [
        ("learn", (np.ones((3, 2)), np.ones(4)), ShapeError),
        ("learn", (np.ones((3, 5)), np.ones(3)), ShapeError),
        ("learn", (np.full((3, 2), np.nan), np.ones(3)), ParameterError),
        ("learn", (np.full((3, 2), 1e200), np.ones(3)), ParameterError),
        ("learn", (np.ones((3, 2)), np.ones(3), 0.5), ParameterError),
        ("forget", (1.5,), ParameterError),
        ("differ", (np.ones(3),), ShapeError),
    ],
)
def test_a_beat_that_is_none_teaches_the_weights_nothing(name, given, error):
    learner = AirWeights([1.0, 2.0], [1.0, 0.5], 10.0)
    with pytest.raises(error):
        getattr(learner, name)(*given)
    np.testing.assert_array_equal(learner.weights, learner.prior)
    learner.learn([[1.0, 1.0]], [4.0])
    assert np.isfinite(learner.weights).all() and learner.weights.sum() > 3.0


@pytest.mark.parametrize(
    ("prior", "stds"),
    [([np.nan, 1.0], [1.0, 1.0]), ([1.0, 1.0], [1e-200, 1.0]), ([1.0, 1.0], [1.0])],
)
def test_a_prior_that_is_none_is_refused(prior, stds):
    with pytest.raises((ParameterError, ShapeError)):
        AirWeights(prior, stds, 10.0)


def flown(orbit, controller, robot, beats=BEATS):
    """Mean height and heading of the last five beats [m, rad]."""
    start = {name: value for name, value in orbit.start().items() if name != "aero_state"}
    period = controller.period
    flight = pt.simulate(
        robot, QuasiSteady(robot, polar=SmoothPolar()), orbit.gait, duration=10 * beats * period,
        time_step=period / 24, control_period=period, controller=controller, **start,
    )  # fmt: skip
    return [float(flight.q.sel(dof=name)[-1200:].mean()) for name in ("z", "yaw")]


def damaged(robot):
    """Robot 3 % too heavy whose left wing lost most of its outer fifth."""
    mass, width = float(robot.bodies[0].mass), float(robot.strips[4].width)
    return robot.with_parameters({"body.mass": 1.06 * mass, "left_wing[4].width": 0.2 * width})


def test_damaged_robot_comes_back_to_height_and_heading(orbit):
    robot, beats = damaged(orbit.robot), 60
    words = {"tolerable": FIRM, "change_cost": 0.0}
    fixed = flown(orbit, LinearRegulator(orbit, COMMANDS, **words), robot, beats)
    controller = AdaptiveController(LinearRegulator(orbit, COMMANDS, **words))
    learned = flown(orbit, controller, robot, beats)
    assert abs(learned[0]) < 0.02 and abs(fixed[0]) < 0.02  # m: the regulator alone does that
    assert abs(learned[1]) < 0.5 * abs(fixed[1])  # .04 and .17 rad
    assert controller.learner.better and controller.counts["moved"] >= 1
    outer, inner = controller.learner.weights[[4, 9]]
    assert outer < 0.6 < inner  # 0.2 and 1: what the damage was
    assert "moved" in controller.report()


def test_predictive_controller_takes_what_was_learned(orbit):
    law = PredictiveController(orbit, COMMANDS, tolerable=FIRM)
    controller = AdaptiveController(law)
    flown(orbit, controller, damaged(orbit.robot), beats=35)  # until the error is no gust
    assert controller.counts["moved"] >= 1 and not controller.held
    model, program = law.model, law.iteration.program
    assert model.neutral[0] > 1.1 * model.neutral[1]  # the cut wing beats more
    np.testing.assert_allclose(program["lower"][0] + model.neutral, [e[0] for e in law.ends])


def test_samples_that_are_none_are_not_learned(orbit):
    controller = AdaptiveController(LinearRegulator(orbit, COMMANDS, tolerable=TOLERABLE))
    for k in range(21):
        assert controller(k * controller.period, None) == {}
    assert controller.counts == {"without samples": 2}
    assert controller.held == {"missing": 21}


@pytest.mark.parametrize("law", [LinearRegulator, PredictiveController])
def test_late_and_unknown_samples_hold_the_command_and_teach_nothing(orbit, law):
    controller = AdaptiveController(law(orbit, COMMANDS, tolerable=TOLERABLE))
    start = orbit.start()
    for k in range(21):
        time, q, v = k * controller.period, start["q"].copy(), start["v"].copy()
        late = 0.1 if k % 2 else 0.0
        (q if k % 4 == 0 else v)[2] = 0.0 if late else np.nan
        assert controller(time, FlightState(orbit.robot, time - late, q, v)) == {}
    assert controller.held == {"late": 10, "not finite": 11}
    assert controller.counts == {"without samples": 2}
    assert "10 late, 11 not finite" in controller.report()
    np.testing.assert_array_equal(controller.learner.weights, controller.learner.prior)
    assert "never followed" not in controller.report()
    controller.counts["kept"] += 3
    assert controller.report().endswith("never followed; what it saw may be gusts.")


def test_weights_without_an_orbit_leave_the_last_one(orbit):
    controller = AdaptiveController(LinearRegulator(orbit, COMMANDS, tolerable=TOLERABLE))
    weightless = np.zeros(13)
    before = controller.controller.model
    assert not controller.use(weightless, 10)
    assert controller.counts == {"not found": 1} and controller.orbit is orbit
    assert controller.controller.model is before
    assert "never followed; its first orbit: " in controller.report()
    pauses = [controller.use(weightless, 10) or controller._pause for _ in range(4)]
    assert pauses == [0, 1, 2, 4]  # searches that fail again wait


def test_what_cannot_be_adapted_is_refused(orbit):
    law = LinearRegulator(orbit, COMMANDS, tolerable=TOLERABLE)
    with pytest.raises(ParameterError, match="memory"):
        AdaptiveController(law, memory=1.0)
    alike = SimpleNamespace(**{k: getattr(orbit, k) for k in ("map", "gait", "steps", "states")})
    with pytest.raises(ParameterError, match="controller: expected one along an orbit of pt.trim"):
        AdaptiveController(LinearRegulator(alike, COMMANDS, tolerable=TOLERABLE))


def test_the_design_is_the_orbit_of_the_controller(orbit):
    """With an orbit of another leg nothing was learned; with that of another robot it failed."""
    with pytest.raises(TypeError):
        AdaptiveController(LinearRegulator(orbit, COMMANDS, tolerable=TOLERABLE), orbit)
    controller = AdaptiveController(LinearRegulator(orbit, COMMANDS, tolerable=TOLERABLE))
    assert controller.orbit is orbit


@pytest.mark.parametrize(
    ("air", "told"),
    [
        (lambda _: 3, "air: expected a model of the air such as"),
        (lambda _: pt.QuasiSteady(pt.load_robot("ornithopter")), "aero: expected .* aerobat"),
        (lambda orbit: pt.DeLaurier(orbit.robot), "air: expected air without states"),
        (lambda orbit: LearnedAir(orbit.aero), "model: expected a model without learned in it"),
    ],
)
def test_air_that_is_none_of_the_robot_is_not_taken(orbit, air, told):
    """It was taken, and broke the flight at the end of a beat."""
    controller = AdaptiveController(LinearRegulator(orbit, COMMANDS, tolerable=TOLERABLE))
    with pytest.raises(ParameterError, match=told):
        controller.take(air(orbit))
    assert controller._air is orbit.aero


def test_a_robot_without_gravity_learns_as_on_earth(orbit):
    """Deviations of the wrench were shares of a weight of zero: `learn: true` was refused."""
    robot = orbit.robot.with_parameters({"gravity": 0.0})
    afloat = pt.trim(robot, QuasiSteady(robot, polar=SmoothPolar()), start=orbit)
    laws = (LinearRegulator(one, COMMANDS, tolerable=TOLERABLE) for one in (afloat, orbit))
    own, usual = (AdaptiveController(law).learner.stds for law in laws)
    np.testing.assert_allclose(own, usual, rtol=1e-3)  # 9.81 of the file, 9.80665


@pytest.mark.parametrize("wing", ["left_wing", "right_wing"])
def test_a_wing_cut_in_flight_is_found_and_taken_over(orbit, wing):
    law = LinearRegulator(orbit, COMMANDS, tolerable=TOLERABLE)
    controller, share, beat = AdaptiveController(law), 0.3, orbit.period
    cut = WingLossEvent(time=5.4 * beat, wing=wing, share=share)
    flight = pt.fly(
        orbit.robot, QuasiSteady(orbit.robot), controller, orbit=orbit, duration=25 * beat,
        events=[cut], sensors=NoisyState({"yaw": 5e-3, "velocity of roll": 0.02}),
    )  # fmt: skip
    assert controller.counts["cut of a wing found"] == 1
    assert controller.counts["beyond the model"] == 0  # the beat that holds the cut tells it
    found = controller.orbit.robot
    wings = ("left_wing", "right_wing")
    widths = {w: sum(s.width for s in found.strips if s.wing == w) for w in wings}
    whole = sum(s.width for s in orbit.robot.strips if s.wing == wing)
    assert widths[wing] == pytest.approx((1 - share) * whole, rel=0.03)  # of noise and polar
    assert max(widths.values()) == pytest.approx(whole, rel=1e-12)  # the other wing is whole
    assert "1 cut of a wing found" in flight.attrs["controller"]


@pytest.mark.parametrize("seed", range(3))
def test_noise_that_surprises_is_no_cut(orbit, seed):
    """Noise of 0.3 rad/s is somewhat more than what passes, and some cut takes a part of it."""
    law = LinearRegulator(orbit, COMMANDS, tolerable=TOLERABLE)
    controller, draw = AdaptiveController(law), np.random.default_rng(seed)
    robot, model = orbit.robot, law.model
    for k in range(61):
        state = dict(zip(model.names, model.course.along(k), strict=True))
        state["velocity of roll"] += draw.standard_normal(2) @ [0.3 * (k > 40), 0.02]
        moving = {n.rpartition(" ")[2]: x for n, x in state.items() if n.startswith("vel")}
        still = {name: x for name, x in state.items() if not name.startswith("vel")}
        q, v = robot.coordinates(**still), robot.velocities(**moving)
        controller(k * law.period, FlightState(robot, k * law.period, q, v))
    assert controller.counts["beyond the model"] >= 1
    assert controller.counts["cut of a wing found"] == 0


def test_the_way_to_another_orbit_is_not_learned(orbit):
    law = LinearRegulator(orbit, COMMANDS, tolerable=FIRM)
    controller, beat = AdaptiveController(law), orbit.period
    cut = WingLossEvent(time=5.4 * beat, wing="right_wing", share=0.3)
    pt.fly(
        orbit.robot, QuasiSteady(orbit.robot), controller, orbit=orbit, duration=12 * beat,
        events=[cut], sensors=NoisyState({"yaw": 5e-3, "velocity of roll": 0.02}),
    )  # fmt: skip
    assert controller.counts["moved"] == 1  # to the orbit of the cut robot, and no further
    np.testing.assert_array_equal(controller.weights, controller.learner.prior)


def test_a_cut_late_in_a_beat_is_not_taken_for_usual(orbit):
    law = LinearRegulator(orbit, COMMANDS, tolerable=TOLERABLE)
    controller, beat = AdaptiveController(law), orbit.period
    cut = WingLossEvent(time=5.9 * beat, wing="right_wing", share=0.3)
    pt.fly(orbit.robot, orbit.aero, controller, orbit=orbit, duration=9 * beat, events=[cut])
    assert controller.counts["cut of a wing found"] == 1
    former, found = (
        sum(s.width for s in one.robot.strips if s.wing == "right_wing")
        for one in (orbit, controller.orbit)
    )
    assert found == pytest.approx(0.7 * former, rel=0.03)


def test_heading_goes_on_on_another_orbit(orbit):
    law = LinearRegulator(orbit, COMMANDS, tolerable=TOLERABLE)
    controller, before = AdaptiveController(law), law.model
    weights = np.array(controller.weights)
    weights[3:5] = 0.5  # a left wing that carries less: yaw is no longer mirrored in a beat
    assert controller.use(weights, 10)
    model, beat = law.model, range(10, 10 + before.parts)
    yaw = model.names.index("yaw")
    own = np.mean([state[yaw] for state in controller.orbit.states])
    mean, former = (np.mean([one.course.along(k)[yaw] for k in beat]) for one in (model, before))
    assert abs(own) > 5e-3  # where the orbit was found
    assert mean == pytest.approx(former, abs=0.1 * abs(own))  # means of 40 and of 10 samples


def test_what_no_cut_explains_is_not_learned(orbit):
    law = LinearRegulator(orbit, COMMANDS, tolerable=TOLERABLE)
    controller, draw = AdaptiveController(law), np.random.default_rng(0)
    robot, model = orbit.robot, law.model
    for k in range(81):
        state = dict(zip(model.names, model.course.along(k), strict=True))
        state["velocity of roll"] += 5.0 * draw.standard_normal() * (k > 40)
        moving = {n.rpartition(" ")[2]: x for n, x in state.items() if n.startswith("vel")}
        still = {name: x for name, x in state.items() if not name.startswith("vel")}
        q, v = robot.coordinates(**still), robot.velocities(**moving)
        controller(k * law.period, FlightState(robot, k * law.period, q, v))
        if k == 40:
            before = controller.learner.weights.copy()
    assert controller.counts["beyond the model"] == 4
    assert controller.counts["cut of a wing found"] == 0
    np.testing.assert_array_equal(controller.learner.weights, before)


def test_gusts_that_last_make_beats_tell_little(rng: np.random.Generator) -> None:
    """First-order noise of correlation .9: a mean over n of it has (1 + .9) / (1 - .9) / n."""
    disturbance, value, stated = Disturbance(), np.zeros(3), []
    for _ in range(2000):
        value = 0.9 * value + np.sqrt(1 - 0.9**2) * rng.standard_normal(3)
        disturbance.take(0.5 + value)
        stated.append(disturbance.variance)
    expected = (1 + 0.9) / (1 - 0.9)
    # a running mean of 50 beats takes a part of what is so slow with it
    assert 0.4 * expected < np.median(stated[200:]) < 1.5 * expected


def test_an_error_that_stays_is_no_disturbance() -> None:
    disturbance, stated = Disturbance(), []
    for _ in range(200):
        disturbance.take(np.array([0.5, -2.0]))
        stated.append(disturbance.variance)
    first, last = stated[0], stated[-1]
    assert np.all(first > 0.05 * np.array([0.5, 2.0]) ** 2)  # the first beat may be a gust
    assert np.all(last < 0.1 * first)


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9, 0.97])
def test_gusts_without_constant_part_are_no_error_of_the_model(correlation: float) -> None:
    taken = 0
    for seed in range(40):
        draw, disturbance = np.random.default_rng(seed), Disturbance()
        value, stays = draw.standard_normal(6), False
        for _ in range(60):
            fresh = draw.standard_normal(6)
            value = correlation * value + np.sqrt(1 - correlation**2) * fresh
            disturbance.take(value)
            stays |= disturbance.stays
        taken += stays
    # with as many degrees of freedom as beats that differ 0, 0, 0 and 1; without end 0, 3, 21, 36
    assert taken <= 2


def test_an_error_among_gusts_is_known_in_time(rng: np.random.Generator) -> None:
    disturbance = Disturbance()
    assert not disturbance.stays
    for _ in range(30):
        disturbance.take(1.0 + rng.standard_normal(6))
    assert disturbance.stays


def test_a_ripple_that_repeats_does_not_set_the_weights(orbit):
    controller = AdaptiveController(LinearRegulator(orbit, COMMANDS))
    draw, prior = np.random.default_rng(0), controller.learner.prior
    slopes, ripple = 0.1 * draw.normal(size=(10, 6, 13)), draw.normal(size=(10, 6))
    for _ in range(50):  # beats whose means vary as in gusts, and tell nothing
        missed = ripple - ripple.mean(axis=0) + draw.normal(size=6)
        beat = _Beat(slopes, slopes @ prior + missed)
        controller.learner.learn(*controller._whitened(beat))
    # as white noise it moves them by .17 to .41 (seeds 0 to 4), as it repeats by .005 to .009
    assert np.abs(controller.learner.weights - prior).max() < 0.03


def test_a_bird_at_the_limit_of_its_amplitude_beats_faster_in_thin_air():
    robot = pt.load_robot("ornithopter")
    orbit = pt.trim(robot)
    law = LinearRegulator(orbit, tuple(robot.actuators))
    controller = AdaptiveController(law)
    weights = np.array(controller.weights)
    weights[: len(robot.strips)] = 0.94
    assert controller.use(weights, 10)
    assert controller.orbit.gait.frequency > 1.01 * orbit.gait.frequency
    assert law.period == pytest.approx(controller.orbit.period / 10)


def test_weights_that_are_not_followed_any_more_are_counted(orbit):
    controller = AdaptiveController(LinearRegulator(orbit, COMMANDS, tolerable=TOLERABLE))
    weights = np.array(controller.weights)
    weights[:5] = 0.9
    assert controller.use(weights, 0)
    flown(orbit, controller, orbit.robot, beats=3)  # the design model was right
    assert controller.counts["without weights"] == 1
    np.testing.assert_array_equal(controller.weights, controller.learner.prior)
    assert "1 without weights" in controller.report()


def test_weights_that_do_harm_are_left_for_longer_each_time() -> None:
    tracking, pauses = Departures(), list[int]()
    for _ in range(20):
        assert not tracking.take(1.0, followed=False)
    for _ in range(3):
        told = [tracking.take(2.1, followed=True) for _ in range(TRIAL)]
        assert told == [False] * (TRIAL - 1) + [True]  # one bad beat is not enough
        pauses.append(tracking.pause)
        for _ in range(tracking.pause):
            assert not tracking.take(1.0, followed=False)
        assert tracking.pause == 0
    assert pauses == [20, 40, 80]
    coming = Departures()
    for _ in range(20):
        coming.take(1.0, followed=False)
    away = [10.0 * 0.8**k for k in range(30)]  # the jump of the reference, on the way to it
    assert not any(coming.take(one, followed=True) for one in away)
    better = Departures()
    flown = [better.take(1.9 if followed else 1.0, followed) for followed in [False, True] * 30]
    assert not any(flown)
