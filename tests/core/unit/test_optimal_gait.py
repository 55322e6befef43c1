"""Optimal gaits: less power than sinusoids, derivatives, limits, refusals, the verb."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.robots import FLAPPER, SPRUNG

import patagium as pt
from patagium.cli.optimize import _front
from patagium.control import optimal_gait
from patagium.control.gait_family import gait_family
from patagium.control.gait_program import TOLERANCE, GaitProgram, _limited, _linear_ranges
from patagium.control.optimal_gait import coefficients
from patagium.control.trimming import Conditions, OrbitSearch, Point
from patagium.control.wingbeat import FlightMap
from patagium.errors import ParameterError
from patagium.robot import load_robot_text
from patagium.robot.model import Actuator
from patagium.simulation.flight_summary import flight_summary

from ...spoken import refusing_stdout, say


@pytest.fixture(scope="module")
def ornithopter():
    return pt.load_robot("ornithopter")


@pytest.fixture(scope="module")
def best(ornithopter):
    return pt.control.optimize(ornithopter, speed=4.0, harmonics=2)


def test_harmonics_take_less_power_than_the_best_sinusoid(best):
    assert best.found, best
    assert best.residual <= TOLERANCE
    assert best.orbit.residual <= 1e-12
    assert best.orbit.speed == pytest.approx(4.0, rel=1e-10)
    assert abs(best.orbit.climb) <= 1e-10
    assert best.sinusoid.residual <= TOLERANCE
    assert best.sinusoid.orbit.speed == pytest.approx(4.0, rel=1e-10)
    assert best.sinusoid.power <= best.power_before * (1 + 1e-5)  # 1e-6 inside limits
    assert best.power <= 0.85 * best.sinusoid.power


def test_power_is_that_of_a_simulated_flight(best):
    flight = best.orbit.flight(beats=2)
    power = flight.joint_work.values[-1] / (2 * best.orbit.period)
    assert power == pytest.approx(best.power, rel=1e-9)  # rounding of a residual of 1e-12
    simulated, spent = best.powers
    assert simulated == pytest.approx(best.power, rel=1e-9)
    assert spent >= simulated


def test_the_gait_keeps_limits_between_samples(ornithopter, best):
    gait = best.orbit.gait
    plunge = gait.motion(np.linspace(0, gait.period, 4001)).position[:, 0]
    place = ornithopter.index("left_plunge")
    assert plunge.min() >= ornithopter.lower[place] - 1e-9
    assert plunge.max() <= ornithopter.upper[place] + 1e-9
    low, high = ornithopter.actuators["plunge_amplitude"].range
    assert low <= np.ptp(plunge) / 2 <= high
    assert any("left_plunge" in word for word in best.held)


def test_the_orbit_is_one_like_those_of_a_trim(best):
    assert len(pt.control.floquet(best.orbit).modes) > 3
    nearly = replace(best, orbit=replace(best.orbit, climb=7.5e-19))
    assert "climb 0 m/s" in repr(nearly)
    text = repr(best)
    assert len(text.splitlines()) <= 10
    for word in ("W", "J/m", "best sinusoid", "harmonics", "held by"):
        assert word in text
    assert best.summary()["saved_over_sinusoid"] >= 0.15


def test_derivatives_of_the_program_are_those_of_differences(ornithopter):
    robot = limited(ornithopter, torque=9.0, power=200.0)
    orbit = pt.trim(robot, free=("frequency", "elevation_offset"), speed=5.0)
    names = ("frequency", "plunge_phase", "plunge_sine_2", "elevation_offset", "elevation_cosine_1")
    family = gait_family(robot, orbit.gait, names)
    program = GaitProgram(family, orbit, "range", Conditions(0.0, 0.0, None))
    random = np.random.default_rng(0)
    z = program.begin + 1e-3 * random.normal(size=len(program.begin))
    free = np.ones(len(z), bool)
    for k in program.lateral:
        free[k : 41 * 12 : 12] = False
    z[~free] = 0.0
    step = 1e-6 * random.normal(size=len(z)) * free
    change = program.constraints(z + step) - program.constraints(z - step)
    np.testing.assert_allclose(2 * program.slopes(z) @ step, change, atol=1e-13)
    change = program.cost(z + step) - program.cost(z - step)
    assert 2 * program.gradient(z) @ step == pytest.approx(change, rel=1e-6)
    multipliers = random.normal(size=len(change := program.constraints(z)))

    def slope(at):
        return 0.7 * program.gradient(at) + program.slopes(at).T @ multipliers

    expected = (slope(z + step) - slope(z - step)) / 2e-6
    found = program.bends(z, 0.7, multipliers) @ step / 1e-6
    # forward differences of 1e-6 within, central ones outside
    size = np.abs(expected).max()
    np.testing.assert_allclose(found[free], expected[free], atol=2e-4 * size)


@pytest.mark.usefixtures("interpreted")
def test_a_joint_without_limits_stays_within_a_right_angle_of_its_own_mean():
    """The bounds were about zero, and a hover whose wings feather about 90 deg began beyond."""
    robot = load_robot_text(FLAPPER.replace(", limits: [-60 deg, 60 deg]", ""))
    gait = pt.gaits.sinusoidal(
        robot, frequency=9.0, plunge=0.6, feather=0.7, offset={"feather": np.pi / 2}
    )
    family = gait_family(robot, gait, ("plunge_sine_1", "feather_sine_1"))
    flight = FlightMap(robot, pt.QuasiSteady(robot))
    swings = _limited(flight, family, family.rows(family.neutral, 240, pt.Air()))
    bounds = dict(zip(swings.names, zip(swings.low, swings.high, strict=True), strict=True))
    assert bounds["left_feather"] == pytest.approx((0.0, np.pi))
    assert bounds["left_plunge"] == pytest.approx((-np.pi / 2, np.pi / 2))


def test_passive_joints_keep_their_limits():
    """They had none here: the best gait could not be flown, nor be sought from a trim beyond."""
    robot = load_robot_text(SPRUNG.replace("[-45 deg, 45 deg]", "[-45 deg, 18 deg]"))
    trimmed = pt.trim(robot, speed=2.6)
    assert "left_feather would go from" in trimmed.reason
    best = pt.control.optimize(robot, speed=2.6, harmonics=2, start=trimmed.beyond)
    assert best.held[-2:] == tuple(f"{k}_feather at its upper limit" for k in ("left", "right"))
    turned = np.degrees(best.orbit.flight(beats=1).q.sel(dof="left_feather").max().item())
    # up to what samples between 40 nodes add, which is taken off: 20 deg times (pi / 40)^2 / 2
    assert 18 - 0.07 < turned < 18


def test_more_power_than_before_is_noted(best):
    """It was told as optimal without a word."""
    worse = replace(best, power_before=0.9 * best.power)
    assert not best.note and "note" not in best.summary() and "note" not in repr(best)
    assert worse.summary()["note"] == worse.note and "more power than before" in repr(worse)


def test_named_parameters_are_the_least_power_of_a_trim(ornithopter):
    free = ("frequency", "plunge_amplitude", "plunge_offset", "elevation_offset")
    least = pt.control.optimize(ornithopter, speed=4.0, free=free)
    assert least.found and tuple(least.orbit.parameters) == free
    trimmed = pt.trim(ornithopter, speed=4.0, free=free)
    beat = trimmed.flight(beats=1)
    assert least.power < beat.joint_work.values[-1] / trimmed.period
    again = pt.control.optimize(ornithopter, speed=4.2, free=free, start=least.orbit)
    assert again.orbit.speed == pytest.approx(4.2) and again.residual <= TOLERANCE
    assert least.power_before < 1.2 * least.power and "power_before_W" in least.summary()
    # It was warned of more power than before, which is that of another speed.
    faster = pt.control.optimize(ornithopter, speed=5.5, free=free, start=least.orbit)
    assert faster.power > 1.001 * least.power and not faster.note
    assert "power_before_W" not in faster.summary() and "before" not in repr(faster)


def test_a_slower_best_beat_takes_the_steps_that_it_asks_for():
    """Half as fast as the start, 240 steps were unstable: it was found, and could not fly."""
    robot = pt.load_robot("aerobat")
    found = pt.control.optimize(robot, pt.QuasiSteady(robot), harmonics=1)
    assert found.found and found.orbit.steps > 240
    assert np.abs(pt.control.floquet(found.orbit).multipliers).max() < 1.0
    flight = found.orbit.flight(beats=3.0)
    np.testing.assert_allclose(flight["v"].values[-1], flight["v"].values[0], atol=1e-6)


def test_a_robot_that_is_not_symmetric_has_a_best_gait(ornithopter, best):
    """Every parameter was left out, as each moves such a flight sideways: a bare ValueError."""
    robot = ornithopter.with_parameters({"body.center_of_mass.y": 1e-4})
    found = pt.control.optimize(robot, speed=4.0, harmonics=1)
    assert found.found and found.residual <= TOLERANCE
    assert found.power == pytest.approx(best.sinusoid.power, rel=1e-3)
    rudder = found.orbit.gait.joints.index("rudder")
    assert found.orbit.gait.mean[rudder] == pytest.approx(2.7e-3, abs=2e-4)


def test_no_parameter_is_left_out_where_none_would_be_left(ornithopter):
    """A family of the rudder alone became one without parameters, which ends in a ValueError."""
    robot = replace(
        ornithopter, actuators={"rudder_offset": ornithopter.actuators["rudder_offset"]}
    )
    start = pt.trim(robot, speed=4.0, free=("frequency", "elevation_offset"))
    family = gait_family(robot, start.gait, ("rudder_offset",))
    assert optimal_gait._in_plane(family, start) is family  # noqa: SLF001


def test_a_phase_keeps_the_range_of_its_actuator():
    """Its lead came out at several times what the actuator gives, and nothing was said."""
    aerobat = pt.load_robot("aerobat")
    actuators = {"feather_phase": Actuator("rad", (-0.02, 0.02), 5.0, 0.1, 1.0)}
    robot, free = replace(aerobat, actuators=actuators), ("plunge_amplitude", "feather_offset")
    start = pt.trim(robot, free=free)
    found = pt.control.optimize(robot, speed=4.0, start=start, free=(*free, "feather_phase"))
    assert found.found and found.residual <= TOLERANCE
    assert abs(found.orbit.parameters["feather_phase"]) == pytest.approx(0.02, abs=1e-6)
    assert any("lead of left_feather at its" in one for one in found.held)


def test_an_amplitude_does_not_turn_over():
    """Amplitudes became negative, -3.96 of the gait's own: only the swing was held in its range."""
    aerobat = pt.load_robot("aerobat")
    actuators = {"feather_amplitude": Actuator("rad", (0.0, 1.2), 5.0, 0.1, 1.0)}
    robot, names = replace(aerobat, actuators=actuators), ("feather_amplitude", "feather_offset")
    ranges = _linear_ranges(gait_family(robot, pt.gaits.cruise(robot), names))
    turned, none, most = (ranges.ways @ (size, 0.3) for size in (-0.1, 0.0, 1e3))
    assert (turned < ranges.low).any()
    for inside in (none, most):
        assert ((ranges.low <= inside) & (inside <= ranges.high)).all()
    assert "amplitude of left_feather" in ranges.names


def test_the_summary_tells_the_swings_of_the_gait(best):
    """The summary gave parameters relative to an initial trim that it did not print."""
    facts, gait = best.summary(), best.orbit.gait
    position = gait.motion(gait.period * np.arange(512) / 512).position
    for k, joint in enumerate(gait.joints):
        told = facts[f"{joint}_least_rad"], facts[f"{joint}_most_rad"]
        assert told == pytest.approx((position[:, k].min(), position[:, k].max()), abs=1e-12)
    assert not [name for name in facts if "_sine_" in name or name.endswith("_offset_rad")]


def test_the_usual_parameters_are_those_of_actuators(ornithopter):
    names = coefficients(ornithopter, pt.gaits.cruise(ornithopter), 2)
    assert names == (
        *("frequency", "plunge_sine_1", "plunge_cosine_2", "plunge_sine_2"),
        *("elevation_offset", "rudder_offset"),
    )
    hawk = pt.load_robot("hawk")
    gait = pt.gaits.sinusoidal(hawk, frequency=2.0, sweep=0.1)
    assert coefficients(hawk, gait, 1) == ("frequency", "elevation_offset")


def test_a_side_of_a_beating_pair_is_kept_and_a_rudder_is_not(ornithopter, best):
    """All coefficients of wings that were no pair were left out, and 37 % more power was best."""
    names = ("frequency", "left_plunge_sine_1", "right_plunge_sine_1", "rudder_offset")
    family = gait_family(ornithopter, best.orbit.gait, names)
    assert optimal_gait._in_plane(family, best.orbit).names == names[:-1]


def test_a_front_has_gaits_and_sinusoids_at_each_speed(ornithopter, tmp_path, capsys):
    words = ("optimize", "ornithopter", "--front", "4,4.4", "--harmonics", "2")
    picture = tmp_path / "front.svg"
    code, out, err = say(capsys, *words, "--figure", picture)
    assert code == 0, err
    assert "best sinusoid [W]" in out and "saved [%]" in out
    assert picture.read_text().startswith("<?xml")
    with pytest.raises(ParameterError, match="at least 2"):
        pt.control.power_front(ornithopter, [4.0], harmonics=1)
    with pytest.raises(ParameterError, match="speeds: expected each speed once"):
        pt.control.power_front(ornithopter, [4.0, 4.4, 4.0])


def test_a_front_is_drawn_where_stdout_takes_nothing(best, tmp_path):
    """The picture was lost when printing the table failed."""
    picture = tmp_path / "front.svg"
    with refusing_stdout(pipe=False), pytest.raises(OSError, match="No space left"):
        _front([(4.0, best)], picture, as_json=False)
    assert picture.read_text("utf-8").startswith("<?xml")


def test_the_verb_writes_a_flight_and_a_gait_to_fly(ornithopter, tmp_path, capsys):
    flight, table = tmp_path / "best.nc", tmp_path / "best.csv"
    given = ("optimize", "ornithopter", "--speed", 4, "--harmonics", 1)
    code, out, err = say(capsys, *given, "-o", flight, "--gait", table, "--beats", 1)
    assert code == 0, err
    assert "Searching a trimmed flight" in err
    for word in ("power [W]", "kkt residual", "frequency [Hz]", "held by"):
        assert word in out
    flown = pt.load_flight(flight)
    gait = pt.gaits.from_csv(ornithopter, table)
    time = flown.time.values
    positions = flown.q.values[:, list(ornithopter.actuated)]
    np.testing.assert_allclose(gait.motion(time).position, positions, atol=1e-7)
    code, out, err = say(capsys, *given, "--front", "4,5")
    assert code == 2 and "--front" in err
    code, out, err = say(capsys, "optimize", "ornithopter", "--figure", "front.svg")
    assert code == 2 and "--figure" in err


def test_what_is_not_found_says_why(ornithopter):
    failed = pt.control.optimize(ornithopter, speed=30.0, harmonics=1)
    assert not failed.found and failed.reason and failed.remedy


def test_refusals(ornithopter, best):
    with pytest.raises(ParameterError, match="power, range, speed"):
        pt.control.optimize(ornithopter, goal="beauty")
    with pytest.raises(ParameterError, match="1 to 16"):
        pt.control.optimize(ornithopter, harmonics=0)
    with pytest.raises(ParameterError, match="range finds it"):
        pt.control.optimize(ornithopter, goal="range", speed=4.0)
    with pytest.raises(ParameterError, match="^free: expected frequency"):
        pt.control.optimize(ornithopter, free=("tail_sine_1", "frequency"))
    with pytest.raises(ParameterError, match="orbit of this robot"):
        pt.control.optimize(pt.load_robot("aerobat"), start=best.orbit)
    with pytest.raises(TypeError, match="mass"):
        pt.control.optimize(ornithopter, mass=1.0)


def test_a_start_in_another_air_is_refused(ornithopter, best):
    # The gait was that of the start's air and added mass, whatever was asked for.
    thin, added = pt.Air(density=0.9), pt.AddedMass(ornithopter)
    with pytest.raises(ParameterError, match="aero: expected that of start"):
        pt.control.optimize(ornithopter, pt.QuasiSteady(ornithopter, thin), start=best.orbit)
    with pytest.raises(ParameterError, match="added_mass: expected that of start"):
        pt.control.optimize(ornithopter, start=best.orbit, added_mass=added)
    with pytest.raises(ParameterError, match="steps, tolerable: expected those of start"):
        pt.control.optimize(ornithopter, start=best.orbit, steps=40)


def test_a_search_tells_its_iterations(ornithopter, best):
    told = []
    free = ("frequency", "plunge_sine_1", "elevation_offset")
    given = dict(speed=4.0, start=best.orbit, free=free)
    found = pt.control.optimize(ornithopter, progress=lambda *now: told.append(now), **given)
    assert found.found and len(told) >= 1 and told[-1][0] <= told[-1][1]
    assert [done for done, _ in told] == [*range(1, len(told) + 1)]


def test_a_front_flies_with_added_mass(ornithopter, monkeypatch):
    asked = []
    stop = type("", (), {"found": False})()
    monkeypatch.setattr(optimal_gait, "optimize", lambda *_, **given: asked.append(given) or stop)
    added = pt.AddedMass(ornithopter)
    pt.control.power_front(ornithopter, (4.0,), added_mass=added)
    assert asked[0]["added_mass"] is added


def test_a_front_keeps_the_gaits_whose_comparison_fails(best, monkeypatch):
    """A gait was thrown away where no sinusoid was found, and the next speed began anew."""
    asked, none = [], pt.control.optimize(best.orbit.robot, speed=30.0, harmonics=1)

    def optimize(_, *given, speed, harmonics, start=None, **more):
        asked.append((speed, harmonics, start))
        if harmonics == 1:
            return none if speed == 5.0 else best.sinusoid
        return best if speed == 4.0 else replace(best, sinusoid=None)

    monkeypatch.setattr(optimal_gait, "optimize", optimize)
    front = pt.control.power_front(best.orbit.robot, (4.0, 5.0, 6.0), harmonics=2)
    assert [one.found for _, one in front] == [True] * 3
    assert [one.sinusoid for _, one in front] == [best.sinusoid, None, best.sinusoid]
    begun = [start for _, harmonics, start in asked if harmonics == 1]
    assert begun == [best.sinusoid.orbit] * 2


def limited(robot, torque=1e6, power=1e6):
    """Robot whose wings' motors have a greatest torque [N m] and power [W]."""
    own = "limits: [-45 deg, 60 deg]"
    more = f"{own}, effort_limit: {torque} N m, power_limit: {power} W"
    return load_robot_text(robot.source.replace(own, more), robot.name)


@pytest.mark.parametrize(("torque", "power", "word"), [(10, 1e6, "N m"), (1e6, 180, "W")])
def test_torque_and_power_stay_within_what_the_motors_have(ornithopter, torque, power, word):
    robot = limited(ornithopter, torque, power)
    start = pt.trim(robot, speed=4.0)
    found = pt.control.optimize(robot, start.aero, speed=4.0, start=start)
    assert found.found and found.residual <= TOLERANCE
    flight, place = found.orbit.flight(beats=1), robot.index("left_plunge")
    effort, v = flight["u1"].values[:, place], flight["v"].values[:, place]
    before = start.flight(beats=1)["u1"].values[:, place]
    share = max(np.abs(effort).max() / torque, np.abs(effort * v).max() / power)
    # what segments hide is taken off again until a solution gains no more than this
    assert 0.999 < share <= 1 + 1e-5
    assert torque == 1e6 or np.abs(before).max() > torque
    told = [one for one in found.held if f"{min(torque, power)} {word}" in one]
    assert len(told) == 1 and "left_plunge at phase" in told[0]
    assert not any("of torque" in one or "of power" in one for one in flight_warnings(found))


def flight_warnings(found):
    return flight_summary(found.orbit.flight(beats=1))["warnings"]


def test_a_torque_that_is_too_small_is_told_with_its_limit(ornithopter):
    robot = limited(ornithopter, torque=3.0)
    start = pt.trim(robot, speed=4.0)
    failed = pt.control.optimize(robot, start.aero, speed=4.0, harmonics=1, start=start)
    assert not failed.found
    assert "3.63 times the limit of 3 N m of torque of left_plunge" in failed.reason
    assert "raise that limit" in failed.remedy


def test_a_beat_that_closes_within_the_tolerance_is_converged(ornithopter, monkeypatch):
    newton, free = OrbitSearch.newton, ("frequency", "plunge_amplitude", "elevation_offset")
    start = pt.trim(ornithopter, speed=4.0)
    given = {"speed": 4.0, "free": (*free, "plunge_offset"), "start": start}
    monkeypatch.setattr(OrbitSearch, "newton", lambda *given: (newton(*given)[0], "stalled"))
    assert pt.control.optimize(ornithopter, **given).found
    monkeypatch.setattr(Point, "residual", 1e-3)
    failed = pt.control.optimize(ornithopter, **given)
    assert "does not close: a misfit of 0.001" in failed.reason


def test_one_ctrl_c_ends_a_search(ornithopter, best, monkeypatch):
    """CasADi discards what Python code that it calls raises: the search went on to its end."""
    calls, flown = [], GaitProgram.constraints

    def pressed(program, z):
        calls.append(z)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return flown(program, z)

    monkeypatch.setattr(GaitProgram, "constraints", pressed)
    with pytest.raises(KeyboardInterrupt):
        pt.control.optimize(ornithopter, start=best.orbit, free=["frequency"])
    assert len(calls) == 4
