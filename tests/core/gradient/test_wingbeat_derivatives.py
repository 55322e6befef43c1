"""The wingbeat map is the simulator's, and its derivatives are those of differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.robots import FLAPPER

import patagium as pt
from patagium.control import wingbeat
from patagium.control.gait_family import gait_family
from patagium.control.orbit import Frame
from patagium.control.wingbeat import FlightMap
from patagium.errors import ParameterError, ShapeError

STEPS = 60
STEP = 1e-6
"""Step of central differences: truncation 1e-12 of third derivatives, rounding 1e-16 / 1e-6."""
NAMES = (
    *("frequency", "plunge_amplitude", "plunge_offset", "feather_phase_difference"),
    *("plunge_cosine_2", "feather_sine_3_difference"),
)


class Case:
    """A robot, its air, a gait and a start, of which one can be changed."""

    def __init__(self, folder, attitude, air, inert):
        file = folder / "flapper.yaml"
        file.write_text(FLAPPER)
        self.robot = pt.load_robot(str(file)).with_attitude(attitude)
        self.make, self.inert = getattr(pt, air), inert
        self.gait = pt.gaits.sinusoidal(
            self.robot, frequency=6.0, plunge=0.5, feather=0.3, phase={"feather": 1.5}
        )
        self.family = gait_family(self.robot, self.gait, NAMES)
        self.v = self.robot.velocities(x=6.0, pitch=0.3, roll=0.1)
        self.air = pt.Air(wind=(0.5, 0.2, 0.1))

    def map(self, robot=None, parameters=("body.mass", "density"), work=True, air=None):
        robot = robot or self.robot
        aero = self.make(robot, air or self.air)
        added = pt.AddedMass(robot, aero.air) if self.inert else None
        return FlightMap(robot, aero, added, parameters, work)

    def rows(self, change=0.0):
        return self.family.rows(self.family.neutral + change, STEPS, self.air)

    def start(self, flight):
        q = self.robot.coordinates()
        places = flight.moving - 6
        return np.r_[q[:places], self.v[:6], np.zeros(flight.size - flight.moving)]


@pytest.fixture(
    scope="module",
    params=[("euler", "QuasiSteady", False), ("euler", "LiftingLine", False),
            ("quaternion", "DeLaurier", True)],
    ids=["quasi-steady", "lifting line", "quaternion, lags and added mass"],
)  # fmt: skip
def case(request, tmp_path_factory):
    return Case(tmp_path_factory.mktemp("robot"), *request.param)


def test_the_map_is_the_simulators(case):
    flight_map = case.map()
    aero = case.make(case.robot, case.air)
    flight = pt.simulate(
        case.robot,
        aero,
        case.gait,
        duration=1 / 6.0,
        time_step=1 / 6.0 / STEPS,
        v=case.v,
        added_mass=pt.AddedMass(case.robot, aero.air) if case.inert else None,
    )
    found = flight_map.fly(case.start(flight_map)[None], case.rows()).ends[0]
    q, v = flight.q.values[-1], flight.v.values[-1]
    expected = np.r_[q[: flight_map.moving - 6], v[:6]]
    # rounding of 240 rates
    np.testing.assert_allclose(found[: flight_map.moving], expected, atol=1e-13)
    np.testing.assert_allclose(found[-1], flight.joint_work.values[-1], atol=1e-13)
    assert np.abs(found).max() > 0.5 and abs(found[-1]) > 1e-3


def test_derivatives_are_those_of_differences(case):
    flight_map = case.map()
    start, rows = case.start(flight_map), case.rows()
    found = flight_map.fly(start[None], rows)

    def ends(x=0.0, p=0.0, robot=None):
        return (case.map(robot) if robot else flight_map).fly(start[None] + x, case.rows(p)).ends[0]

    for k in range(flight_map.size):
        e = STEP * (np.arange(flight_map.size) == k)
        expected = (ends(x=e) - ends(x=-e)) / (2 * STEP)
        np.testing.assert_allclose(found.by_state[0, :, k], expected, atol=5e-8)
    for k in range(len(NAMES)):
        e = STEP * (np.arange(len(NAMES)) == k)
        expected = (ends(p=e) - ends(p=-e)) / (2 * STEP)
        np.testing.assert_allclose(found.by_parameter[0, :, k], expected, atol=5e-8)
        assert np.abs(expected).max() > 1e-3
    heavy, light = (case.robot.with_parameters({"body.mass": 0.1 + e}) for e in (STEP, -STEP))
    expected = (ends(robot=heavy) - ends(robot=light)) / (2 * STEP)
    np.testing.assert_allclose(found.by_parameter[0, :, -2], expected, atol=5e-8)
    assert np.abs(expected).max() > 0.1
    dense, thin = (
        case.map(air=replace(case.air, density=1.225 + e)).fly(start[None], rows).ends[0]
        for e in (STEP, -STEP)
    )
    expected = (dense - thin) / (2 * STEP)  # that of the added mass's density was left out
    np.testing.assert_allclose(found.by_parameter[0, :, -1], expected, atol=5e-8)
    assert np.abs(expected).max() > 0.1


def test_segments_follow_each_other(case):
    flight_map, rows = case.map(), case.rows()
    whole = flight_map.fly(case.start(flight_map)[None], rows)
    starts = [case.start(flight_map)]
    for _ in range(3):  # what is flown of wrong starts beside the right ones does not matter
        guess = np.array([*starts, *[starts[-1]] * (4 - len(starts))])
        starts.append(flight_map.fly(guess, rows).ends[len(starts) - 1])
    parts = flight_map.fly(np.array(starts), rows)
    np.testing.assert_allclose(parts.ends[-1], whole.ends[0], atol=1e-12)
    by_state = np.eye(flight_map.size)
    by_parameter = np.zeros_like(whole.by_parameter[0])
    for a, b in zip(parts.by_state, parts.by_parameter, strict=True):
        by_state, by_parameter = a @ by_state, a @ by_parameter + b
    np.testing.assert_allclose(by_state, whole.by_state[0], atol=1e-11)
    np.testing.assert_allclose(by_parameter, whole.by_parameter[0], atol=1e-11)


def test_the_kernel_is_its_python(case, monkeypatch):
    flight_map, rows = case.map(), case.rows()
    starts = np.tile(case.start(flight_map), (3, 1)) + 0.01 * np.arange(3)[:, None]
    found = flight_map.fly(starts, rows)
    monkeypatch.setattr(wingbeat, "load_kernel", lambda name: None)
    expected = case.map().fly(starts, rows)
    for name in ("ends", "by_state", "by_parameter"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-12)


def test_other_numbers_of_the_air_compile_nothing(case, capfd):
    case.map()
    capfd.readouterr()
    case.map(case.robot.with_parameters({"body.mass": 0.11}))
    case.air = pt.Air(density=1.1, wind=(0.5, 0.2, 0.1))
    case.map()
    case.air = pt.Air(wind=(0.5, 0.2, 0.1))
    assert "compiling" not in capfd.readouterr().err


def test_gaits_of_a_family_are_what_steering_gives(case):
    from patagium.simulation.steered_gait import SteeredGait

    values = {"frequency": 6.5, "plunge_amplitude": 1.1, "plunge_offset": 0.05}
    steered = SteeredGait(case.robot, case.gait)
    steered.command(0.0, {**values, "left_feather_phase": 0.1, "right_feather_phase": -0.1})
    found = case.family.gait(np.array([*values.values(), 0.2, 0.0, 0.0]))
    beat = found.period
    late = 40 * beat + np.linspace(0.0, beat, 17)  # the answer to the command is over
    lag = steered.answers[-1].own(late[:1])[0] * 6.0 / 6.5
    expected = steered.motion(late)
    shifted = found.motion(late - late[0] + float(lag))
    np.testing.assert_allclose(shifted.position, expected.position, atol=1e-9)
    np.testing.assert_allclose(shifted.acceleration, expected.acceleration, atol=1e-5)


def test_a_wing_that_is_still_answers_its_amplitude(case):
    """The derivative by an amplitude of zero was zero, so that no glide began to flap."""
    family = gait_family(case.robot, case.gait, ("plunge_amplitude",))
    still, flapping = (family.rows([size], STEPS, case.air) for size in (0.0, 1.0))
    expected = flapping.table - still.table  # the joints are linear in the amplitude
    np.testing.assert_allclose(still.slopes[:, 0], expected[:, :-3], atol=1e-10)
    assert np.abs(expected).max() > 100


def test_a_gust_has_no_derivative_by_frequency(case):
    """The derivative by frequency left out that another part of a gust is met."""
    air = pt.Air(gust=pt.air.OneMinusCosineGust((0.0, 0.0, 1.5), 0.02, 0.03))
    with pytest.raises(ParameterError, match="air without a gust"):
        case.family.rows(case.family.neutral, STEPS, air)
    family = gait_family(case.robot, case.gait, ("plunge_amplitude",))
    assert family.rows(family.neutral, STEPS, air).table[:, -1].max() > 1.0


def test_what_the_map_refuses(case, tmp_path):
    flight_map = case.map()
    with pytest.raises(ShapeError, match="states"):
        flight_map.fly(np.zeros((1, 3)), case.rows())
    with pytest.raises(ParameterError, match="states"):
        flight_map.fly("all", case.rows())
    neutral, air = case.family.neutral, pt.Air()
    for values, steps in ((neutral, 0), (neutral, 10**9), (0.0 * neutral, 40)):
        with pytest.raises(ParameterError, match="values and steps"):
            case.family.rows(values, steps, air)
    with pytest.raises(ShapeError, match="values"):
        case.family.rows(neutral[1:], 40, air)
    with pytest.raises(ParameterError, match="divides"):
        flight_map.fly(np.tile(case.start(flight_map), (7, 1)), case.rows())
    with pytest.raises(ParameterError, match="parameters"):
        case.map(parameters=("mass of the moon",))
    with pytest.raises(ParameterError, match="floating"):
        FlightMap(pt.load_robot("ur5e"), pt.QuasiSteady(pt.load_robot("ur5e")))
    for wrong in ("plunge", "tail_offset", "frequency_difference", "amplitude_difference"):
        with pytest.raises(ParameterError, match="plunge"):
            gait_family(case.robot, case.gait, (wrong,))


@pytest.mark.usefixtures("interpreted")
def test_a_beat_that_begins_at_another_heading_ends_there_too(tmp_path):
    """States that are vectors in the world turn along: to rounding, with induced velocities too."""
    file = tmp_path / "flapper.yaml"
    file.write_text(FLAPPER)
    robot = pt.load_robot(str(file))
    gait = pt.gaits.sinusoidal(robot, frequency=6.0, plunge=0.5, feather=0.3)
    family = gait_family(robot, gait, ("frequency",))
    aero = pt.air.Inflow(pt.QuasiSteady(robot))
    flight_map = FlightMap(robot, aero)
    frame, rows = Frame(flight_map.names), family.rows(family.neutral, 40, pt.Air())
    start = 0.3 * np.random.default_rng(1).normal(size=(1, flight_map.size))
    start[0, [flight_map.names.index(name) for name in ("x", "y", "z", "yaw")]] = 0.0
    flown = flight_map.fly(start, rows)
    yaw, step = frame.generators(start[0])[:, 3], 1e-6
    turned = [flight_map.fly(start + sign * step * yaw, rows).ends[0] for sign in (1, -1)]
    seen = [frame.seen(end)[0][frame.kept] for end in turned]
    np.testing.assert_allclose((seen[0] - seen[1]) / (2 * step), 0.0, atol=1e-8)
    moved = frame.seen(flown.ends[0])[1] @ flown.by_state[0] @ yaw
    np.testing.assert_allclose(moved[frame.kept], 0.0, atol=1e-10)  # rounding
