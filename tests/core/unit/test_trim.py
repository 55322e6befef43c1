"""Trim: orbits that repeat in the simulator, conditions, refusals, and what is lacking."""

from __future__ import annotations

import copy
import json
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from tests.robots import FLAPPER, SPRUNG

import patagium as pt
from patagium.control import FlightMap, free_parameters, gait_family, trimming
from patagium.control.orbit import Frame
from patagium.control.trimming import Conditions, OrbitSearch, _not_found, state_sizes
from patagium.errors import ParameterError, ShapeError
from patagium.robot import load_robot_text, preset_text
from patagium.robot.model import Actuator
from patagium.robot.review import robot_warnings
from patagium.simulation import FlightState

from ...spoken import say


@pytest.fixture(scope="module")
def aerobat():
    return pt.load_robot("aerobat")


@pytest.fixture(scope="module")
def orbit(aerobat):
    return pt.trim(aerobat, speed=4.5)


def hinged_moth(s=1.0, *, turned=False):
    """Moth whose wings turn on springs, lengths and times s times, masses s^3 times.

    Its springs rest at 90 deg, or at zero of a frame that is turned by as much.
    """
    sweep = "{name: left_sweep, axis: -z, limits: [-85 deg, 85 deg]}"
    place = f"at: [0, {2 * s} mm, {10 * s} mm]"
    rest = "0 deg" if turned else "90 deg"
    feather = "{name: left_feather, axis: -y, passive: true, "
    feather += f"stiffness: {1e-4 * s**3} N m/rad, rest: {rest}}}"
    wing = f"{{parent: body, {place}, joints: [{sweep}, {feather}],"
    spar = ""
    if turned:
        spar = f"left_spar: {{parent: body, {place}, joints: [{sweep}], massless: true}}"
        wing = f"{{parent: left_spar, orientation: [0, -90 deg, 0], joints: [{feather}],"
    edges = f"leading: {4.5 * s} mm, trailing: {-13.5 * s} mm"
    return load_robot_text(f"""
name: moth
gravity: {9.81 / s} m/s^2
bodies:
  body: {{floating: true, mass: {s**3} g, center_of_mass: [0, 0, {-5 * s} mm],
    shape: {{type: cylinder, axis: z, radius: {5 * s} mm, length: {40 * s} mm}}}}
  {spar}
  left_wing: {wing} mass: {40 * s**3} mg, center_of_mass: [{-3.6 * s} mm, {22 * s} mm, 0],
    shape: {{type: plate, chord: {18 * s} mm, span: {50 * s} mm, thickness: {0.2 * s} mm}}}}
wings:
  - name: left_wing
    segments: [{{body: left_wing, strips: 3, stations: [
      {{span: {5 * s} mm, {edges}}}, {{span: {50 * s} mm, {edges}}}]}}]
mirror: [{{from: left, to: right}}]
cruise: {{frequency: {25 / s} Hz, amplitude: {{sweep: 60 deg}}, speed: 0 m/s}}
""")


def hovering(robot, gait=None):
    """Hover of a robot, in air without jumps and with the force of separated flow."""
    polar = pt.air.SmoothPolar()
    air = pt.air.Inflow(pt.QuasiSteady(robot, polar=polar, force_point="moving"))
    found = pt.trim(robot, air, gait, speed=0.0)
    assert found.found and found.residual <= 1e-12, found
    return found


def test_a_hinge_begins_at_the_rest_of_its_spring_whatever_the_zero_of_its_angle():
    """The search began at zero, a right angle off the rest, and found no hover that was there."""
    own, turned = (hovering(hinged_moth(turned=one)) for one in (False, True))
    assert own.values == pytest.approx(turned.values, abs=1e-7)
    k = own.names.index("left_feather")
    assert own.states[:, k] == pytest.approx(turned.states[:, k] + np.pi / 2, abs=1e-7)


def test_a_hover_is_found_from_a_gait_whose_inflow_is_far_from_rest():
    """The search began in air at rest, and stalled where the wings move a strong stream."""
    moth = hinged_moth()
    hovering(moth, pt.gaits.sinusoidal(moth, frequency=60.0, sweep=np.radians(60)))


HOVERER = """
name: hoverer
gravity: 9.81 m/s^2
bodies:
  body: {floating: true, mass: 15 g, shape: {type: box, size: [2 cm, 2 cm, 7 cm]}}
  left_wing:
    parent: body
    at: [0, 1 cm, 3 cm]
    joints: [{name: left_sweep, axis: -z}, {name: left_feather, axis: -y}]
    mass: 0.3 g
    center_of_mass: [-0.8 cm, 3.5 cm, 0]
    shape: {type: plate, axis: y, chord: 2.7 cm, span: 7.5 cm, thickness: 0.1 mm}
wings:
  - name: left_wing
    segments: [{body: left_wing, strips: 8, stations: [
      {span: 0 cm, leading: 0.4 cm, trailing: -2.0 cm},
      {span: 3 cm, leading: 0.4 cm, trailing: -2.6 cm},
      {span: 7.5 cm, leading: 0.4 cm, trailing: -1.6 cm}]}]
mirror: [{from: left, to: right}]
"""


def hoverer_at(frequency):
    """Tailless robot of 16 g that hovers, its gait at a frequency [Hz], and air with inflow."""
    robot = load_robot_text(HOVERER)
    turned = {"phase": {"feather": -np.pi / 2}, "offset": {"feather": np.pi / 2}}
    sweep, feather = np.radians([80, 50])
    gait = pt.gaits.sinusoidal(robot, frequency=frequency, sweep=sweep, feather=feather, **turned)
    return robot, pt.air.Inflow(pt.QuasiSteady(robot)), gait


def test_a_hover_with_inflow_follows_the_gait_that_the_search_begins_from():
    """The first search began in air at rest: 38.2, 37.6 and 30.3 Hz came of 20, 21 and 22 Hz."""
    found = [pt.trim(*hoverer_at(f), speed=0.0).values for f in (20.0, 21.0, 22.0)]
    middle = 0.5 * (found[0] + found[2])
    # the bend of the branch over 1 Hz: .02 of 23.8 Hz, 5e-4 of the other parameters
    assert found[1] == pytest.approx(middle, rel=2e-3, abs=2e-3)


def test_a_second_search_has_flights_of_its_own(monkeypatch):
    """It began with the budget that the first had spent, and ended at once."""
    searched, most = trimming._searched, 20  # flights; from air at rest it takes 12

    def spent(search, *given):
        first, found = search.points == 0 and not done, searched(search, *given)
        done.append(search.points)
        search.points = most + 1
        return (found[0], "stalled") if first else found

    done = []
    monkeypatch.setattr(trimming, "_POINTS", most)
    monkeypatch.setattr(trimming, "_searched", spent)
    assert pt.trim(*hoverer_at(22.0), speed=0.0).found and len(done) == 2


def test_a_machine_that_is_smaller_and_faster_has_the_same_hover():
    """Scales of the search were those of 8 Hz, and small machines stalled or hovered otherwise."""
    large, small = hovering(hinged_moth()), hovering(hinged_moth(0.2))
    sizes = np.where(np.array(large.family.names) == "frequency", 0.2, 1.0)
    assert small.values * sizes == pytest.approx(large.values, rel=1e-7, abs=1e-8)


def misfit(orbit, flight):
    """Largest change of the state over the flight, position and heading left out."""
    passive = [i for i in range(orbit.robot.dof) if i not in orbit.robot.actuated]
    states = np.column_stack([flight.q.values[:, passive], flight.v.values[:, passive]])
    frame = Frame(orbit.names[: states.shape[1]])
    ends = [frame.seen(states[k])[0][frame.kept] for k in (0, -1)]
    return np.abs(ends[1] - ends[0]).max()


def test_an_orbit_repeats_in_the_simulator(orbit):
    assert orbit.found and orbit.residual <= 1e-12
    flight = orbit.flight(beats=1)
    assert misfit(orbit, flight) <= 1e-12
    assert np.ptp(flight.q.sel(dof="pitch").values) > 1e-3  # it is no equilibrium
    assert misfit(orbit, orbit.flight(beats=20)) <= 1e-10  # of a stable flight
    moved = flight.q.values[-1] - flight.q.values[0]
    assert moved[0] / orbit.period == pytest.approx(4.5, rel=1e-12)
    assert abs(moved[2]) <= 1e-12


def test_a_search_tells_how_far_it_is(orbit):
    """A search that took minutes showed no progress."""
    told = []
    pt.trim(orbit.robot, start=orbit, climb=0.01, progress=lambda *each: told.append(each))
    flown = [done for done, _ in told]
    assert flown == [*range(1, len(told) + 1)] and {most for _, most in told} == {250}


def test_the_orbit_says_itself_in_ten_lines(orbit):
    text = repr(orbit)
    assert len(text.splitlines()) <= 10
    for word in ("m/s", "deg", "frequency", "Hz", "residual", "multipliers", "stable"):
        assert word in text


def test_results_are_compared_as_what_they_are_and_not_number_by_number(orbit):
    """The comparison of arrays has no single truth, and ended in an error."""
    again, modes = copy.copy(orbit), [pt.control.floquet(orbit) for _ in range(2)]
    assert orbit == orbit and orbit != again and modes[0] != modes[1]
    assert len({orbit, again, *modes}) == 4


def test_conditions_of_climb_and_turn_hold(aerobat):
    free = ("frequency", "feather_offset", "feather_offset_difference", "plunge_amplitude")
    orbit = pt.trim(aerobat, free=free, climb=0.2, turn_rate=0.3)
    assert orbit.found, orbit
    assert orbit.climb == pytest.approx(0.2, abs=1e-10)
    assert orbit.turn_rate == pytest.approx(0.3, abs=1e-10)
    flight = orbit.flight(beats=1)
    assert misfit(orbit, flight) <= 1e-11
    assert flight.q.sel(dof="yaw").values[-1] == pytest.approx(0.3 * orbit.period, abs=1e-11)
    assert abs(orbit.parameters["feather_offset_difference"]) > 1e-4


def test_a_turn_is_found_without_a_start_nearby():
    """The gait's own flight goes straight on; from there the search goes to the turn in parts."""
    ornithopter = pt.load_robot("ornithopter")
    orbit = pt.trim(ornithopter, speed=6.0, turn_rate=0.1)
    assert orbit.found, orbit
    assert orbit.turn_rate == pytest.approx(0.1, abs=1e-10)
    assert orbit.speed == pytest.approx(6.0, abs=1e-10)
    assert misfit(orbit, orbit.flight(beats=1)) <= 1e-11
    rows = orbit.along(orbit.period * np.arange(-2.0, 3.0))  # before the start it was anywhere
    ways = np.diff(rows[:, 0] + 1j * rows[:, 1])
    turned = np.full(3, np.exp(1j * orbit.turn_rate * orbit.period))
    np.testing.assert_allclose(ways[1:] / ways[:-1], turned, atol=1e-9)
    times = [0.0, 0.1]
    np.testing.assert_array_equal(orbit.along(times), orbit.along(np.array(times)))
    with pytest.raises(ShapeError, match="time: expected shape"):
        orbit.along(0.1)


def test_one_robot_hovers_and_glides_another(tmp_path):
    dragonfly = pt.load_robot("dragonfly")
    hover = pt.trim(dragonfly, speed=0.0)
    assert hover.found and hover.residual <= 1e-12
    assert misfit(hover, hover.flight(beats=1)) <= 1e-11
    moved = hover.segments.ends[-1][:3]
    assert np.abs(moved).max() < 1e-12
    hawk = pt.load_robot("hawk")
    glide = pt.trim(hawk, climb=None, free=("elevation_offset",))
    assert glide.found and glide.climb < -0.5 and glide.speed > 2.0
    assert np.ptp(glide.states[:, glide.names.index("pitch")]) < 1e-12


def test_a_hover_holds_its_place_and_goes_over_to_a_cruise():
    """No controller saw how far a hovering robot was from its place along x."""
    drives = {"plunge_amplitude": (0.1, 1.3), "feather_offset": (-0.7, 0.7)}
    actuators = {
        f"{side}_{pair}_{drive}": Actuator("rad", ends, 9.0, None, 1.0)
        for side in ("left", "right") for pair in ("fore", "hind") for drive, ends in drives.items()
    } | {"frequency": Actuator("Hz", (10.0, 30.0), 100.0, 0.06, 1.0)}  # fmt: skip
    robot, commands = replace(pt.load_robot("dragonfly"), actuators=actuators), tuple(actuators)
    hover = pt.trim(robot, speed=0.0)
    tolerable, start = {"x": 0.1, "y": 0.1}, hover.start()
    law = pt.control.LinearRegulator(hover, commands, tolerable=tolerable)
    assert np.abs(law.multipliers).max() < 0.95  # x and y are neutral where they cost nothing
    q = start["q"] + 0.5 * (np.array(robot.dof_names) == "x")
    away = law.model.departure(0, law.measured(FlightState(robot, 0.0, q, start["v"]), 0), 0.0)
    assert away[:2] == pytest.approx([0.5, 0.0], abs=1e-12)  # rounding; y was up to .087
    cruise = pt.trim(robot, gait=hover.gait, speed=1.0, free=commands, start=hover)
    size = law.model.size
    route = pt.control.Route(law, {1.0: cruise, 2.0: hover})
    assert route.model.size == size and route.model.course.stands
    with pytest.raises(ParameterError, match="^state: expected one of y, "):
        pt.control.LinearRegulator(cruise, commands, tolerable=tolerable)


def test_the_orbit_is_the_nearest_by_what_is_tolerable(orbit):
    robot, names = orbit.robot, orbit.names
    narrow = robot.with_parameters({"left_wing[4].width": 0.2 * float(robot.strips[4].width)})
    free = (
        *("left_plunge_amplitude", "right_plunge_amplitude"),
        *("left_feather_offset", "right_feather_offset", "feather_amplitude"),
    )
    measures = [
        {"roll": 0.1, "pitch": 0.1, "velocity of y": 0.1},
        {"velocity of y": 0.1},
        {"roll": 0.3, "pitch": 0.3, "velocity of y": 0.3},
    ]
    found = [
        pt.trim(narrow, gait=orbit.gait, free=free, speed=4.0, start=orbit, tolerable=one)
        for one in measures
    ]
    for own, tolerable in enumerate(measures):
        sizes = np.array([tolerable.get(k, 20.0 if "velocity" in k else 1.0) for k in names])
        sizes[[names.index(f"velocity of {k}") for k in "xz"]] = 3.0
        lengths = [
            np.linalg.norm(
                np.r_[
                    (one.states[0] - orbit.states[0]) / sizes,
                    (one.values - one.family.neutral) / 0.3,
                ]
            )
            for one in found
        ]
        assert lengths[own] < 1.001 * min(lengths)  # where the way back ends


def test_lag_states_are_on_the_orbit(tmp_path):
    file = tmp_path / "flapper.yaml"
    file.write_text(FLAPPER)
    robot = pt.load_robot(str(file))
    gait = pt.gaits.sinusoidal(
        robot, frequency=9.0, plunge=0.6, feather=0.3, phase={"feather": 1.5}
    )
    orbit = pt.trim(robot, pt.LiftingLine(robot), gait, climb=None, steps=80)
    assert orbit.found, orbit
    assert len(orbit.start()["aero_state"]) > 0
    flight = orbit.flight(beats=1)
    lags = flight.aero_state.values
    assert np.abs(lags[-1] - lags[0]).max() <= 1e-11
    assert np.abs(lags).max() > 1e-3


def test_an_attitude_may_be_prescribed(tmp_path):
    slides = "".join(f"{{name: {k}, type: prismatic, axis: {k}, passive: true}}, " for k in "xyz")
    joints = f"joints: [{slides}{{name: pitch, axis: y}}]"
    text = FLAPPER.replace("floating: true", joints)
    pitch = "pitch_offset: {range: [-30 deg, 30 deg]}"
    text += f"\nactuators: {{frequency: {{range: [5 Hz, 14 Hz]}}, {pitch}}}\n"
    robot = load_robot_text(text)
    gait = pt.gaits.sinusoidal(
        robot, frequency=9.0, plunge=0.6, feather=0.3, pitch=0.05, phase={"feather": 1.5}
    )
    orbit = pt.trim(robot, gait=gait, climb=None, steps=80, free=("frequency",))
    assert orbit.found and orbit.residual <= 1e-12
    assert misfit(orbit, orbit.flight(beats=1)) <= 1e-11
    stability = pt.control.floquet(orbit)
    assert len(stability.multipliers) == 3 and stability.neutral == pytest.approx(np.ones(3))
    assert "pitch -2.86 to 2.86 deg" in repr(orbit)  # .05 rad
    failed = pt.trim(robot, gait=gait, speed=40.0, climb=0.0, free=("frequency", "pitch_offset"))
    assert not failed.found
    with pytest.raises(ParameterError, match="attitude is prescribed"):
        pt.trim(robot, gait=gait, turn_rate=0.2)
    law = pt.control.LinearRegulator(orbit, ("frequency",))  # which asked for a yaw
    assert np.sort(np.abs(law.multipliers))[-2:] == pytest.approx([0.948, 1.0], abs=1e-3)  # y
    both = pt.control.LinearRegulator(orbit, ("frequency", "pitch_offset"))
    learning = pt.control.AdaptiveController(both)  # which asked for roll
    assert learning.use(learning.weights, 0)
    with pytest.raises(ParameterError, match="robot: expected a body that floats"):
        pt.control.optimize(robot, start=orbit)


def test_parameters_stop_at_limits():
    ornithopter = pt.load_robot("ornithopter")
    orbit = pt.trim(ornithopter, speed=7.0)
    assert orbit.found
    plunge = orbit.flight(beats=1).q.sel(dof="left_plunge").values
    assert plunge.min() >= ornithopter.lower[ornithopter.index("left_plunge")] - 1e-9
    assert orbit.parameters["plunge_amplitude"] == pytest.approx(1.0018, abs=1e-3)  # 45 deg


def test_a_search_that_leaves_the_limits_is_not_taken_to_its_end():
    # Six Newton steps in all; ten where the search without the limit goes on to its end.
    orbit = pt.trim(pt.load_robot("ornithopter"))
    assert orbit.found and orbit.residual <= 1e-12
    assert orbit.iterations <= 7


def test_what_lacks_is_said():
    failed = pt.trim(pt.load_robot("ornithopter"), free=("frequency",))
    assert not failed.found
    assert "moment_y" in failed.reason and "N m" in failed.reason  # no elevator, no pitch
    assert abs(failed.lacking["moment_y"]) > 1e-5
    assert "free" in failed.remedy and "remedy" in repr(failed)
    assert failed.residual > 1e-6


def test_what_lacks_is_the_force_that_is_missing_not_the_one_that_is_left_over():
    # The sign was the other way round: a bird that should fall faster lacked force upward.
    hawk = pt.load_robot("hawk")
    gait = pt.gaits.sinusoidal(hawk, frequency=2.0, sweep=0.05)
    failed = pt.trim(hawk, gait=gait, climb=-40.0, free=("elevation_offset",))
    assert not failed.found
    assert failed.lacking["force_z"] < -0.1
    assert f"{failed.lacking['force_z']:.2g} N of force_z" in failed.reason


def test_wings_that_are_held_need_no_frequency_and_no_amplitude():
    # An actuator of the frequency refused every glide: "frequency would need 10 Hz".
    bird = pt.load_robot("ornithopter")
    assert "frequency" in bird.actuators and "plunge_amplitude" in bird.actuators
    still = pt.gaits.still(bird, plunge=0.1)
    glide = pt.trim(bird, gait=still, climb=None, free=("elevation_offset",))
    assert glide.found and glide.climb < 0
    flight = glide.flight(beats=3.0)
    change = np.ptp(flight.v.sel(dof=["x", "z", "pitch"]).values, axis=0)
    assert change.max() <= 1e-9  # an equilibrium of the simulator
    commands = ("elevation_offset", "rudder_offset")
    multipliers = pt.control.LinearRegulator(glide, commands).multipliers
    assert np.abs(multipliers).max() <= 1 + 1e-6
    with pytest.raises(ParameterError, match="expected frequency, amplitude"):
        pt.control.LinearRegulator(glide, ("frequency",))


@pytest.mark.parametrize(
    ("tolerable", "said"),
    [
        ({"height": 0.1}, "tolerable: expected one of x, y, z, roll"),
        ({"zz": 1.0}, "of yaw, found 'zz'; did you mean z"),
        ({"z": 0.0}, "tolerable: z: expected a positive number, found 0.0"),
        ({"pitch": -1.0}, "tolerable: pitch: expected a positive number, found -1.0"),
    ],
)
def test_a_size_that_is_none_is_refused(aerobat, tolerable, said):
    # They were taken, and the answer was that without them.
    with pytest.raises(ParameterError, match=said):
        pt.trim(aerobat, speed=4.5, tolerable=tolerable)


def test_a_search_that_breaks_warns_of_nothing(aerobat):
    # NumPy's overflow stood before the answer.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not pt.trim(aerobat, speed=40.0).found


def test_an_orbit_of_another_robot_is_no_start(orbit):
    with pytest.raises(ParameterError, match="a gait of 'ornithopter', of the joints"):
        pt.trim(pt.load_robot("ornithopter"), start=orbit)


def test_a_search_from_an_orbit_stays_in_its_air(aerobat):
    # It went on in the default air.
    thick = pt.Air(density=1.3)
    added = pt.AddedMass(aerobat, thick, factor=0.1)
    start = pt.trim(aerobat, pt.QuasiSteady(aerobat, thick), added_mass=added)
    found = pt.trim(aerobat, start=start, speed=start.speed + 0.05)
    assert found.found and found.aero is start.aero and found.added_mass is added


def test_a_limit_is_told_in_digits_that_show_it_and_no_iterate_as_a_need():
    ornithopter = pt.load_robot("ornithopter")
    failed = pt.trim(ornithopter, speed=9.0)
    said = "none was found with frequency at a limit: its actuator gives 2 to 5.5 Hz"
    assert failed.reason.startswith(said)  # "would need frequency 8 Hz", of an iterate
    # Thrust, as on a stand at full stroke and frequency; nothing was named.
    assert "what the free parameters hardly reach is 0.0" in failed.reason
    assert "N of force_x" in failed.reason and 0.01 < failed.lacking["force_x"] < 0.1
    assert failed.remedy.startswith("widen that limit, ask for another speed")
    joint = ornithopter.index("left_plunge")
    family = gait_family(ornithopter, pt.gaits.cruise(ornithopter), ("frequency", "plunge_offset"))
    search = OrbitSearch(FlightMap(ornithopter, pt.QuasiSteady(ornithopter)), family, 240)
    over = search.excess(np.array([5.50003, 0.0]))
    assert over == "frequency would need 5.50003 Hz, and its actuator gives 2 to 5.5 Hz"
    top = pt.gaits.cruise(ornithopter).motion(np.arange(64) / 64 / 4.5).position[:, 0].max()
    over = search.excess(np.array([4.5, ornithopter.upper[joint] - top + 1e-5]))
    low, high = over.partition("go from ")[2].partition(" deg")[0].split(" to ")
    limit, unit = over.split(" ")[-2:]
    assert float(high) > float(limit) and unit == "deg" and float(low) < 0.0


def test_a_stroke_held_at_its_limit_stays_there_whatever_its_phase():
    # "would go from -45.0000001 to 44.9790765 deg": the greatest of 64 samples, and a hair beyond.
    ornithopter = pt.load_robot("ornithopter")
    strokes = ("plunge_amplitude", "plunge_phase", "plunge_offset")
    orbit = pt.trim(ornithopter, free=("frequency", *strokes, "elevation_offset"), speed=4.5)
    assert orbit.found
    flown = orbit.gait.motion(np.linspace(0.0, orbit.period, 5001)).position[:, 0]
    assert flown.min() == pytest.approx(np.radians(-45.0), abs=2e-7)
    assert misfit(orbit, orbit.flight(beats=1)) <= 1e-11


def test_no_phase_leaves_the_range_of_its_actuator(aerobat):
    # It came out at -0.22 rad, where the actuator gives 0.02 rad.
    actuators = {"feather_phase": Actuator("rad", (-0.02, 0.02), 5.0, 0.1, 1.0)}
    actuators |= {k: v for k, v in aerobat.actuators.items() if k != "frequency"}
    bounded = pt.trim(replace(aerobat, actuators=actuators))
    lead = dict(zip(bounded.family.names, bounded.values, strict=True))["feather_phase"]
    assert bounded.found and bounded.residual <= 1e-12
    assert lead == pytest.approx(-0.02, abs=1e-8)


def test_an_orbit_at_the_limit_of_an_actuator_is_one_for_controllers():
    """A trim went 1e-5 rad beyond the limit, and controllers refused its orbit."""
    bird = pt.load_robot("ornithopter")
    ranges = {"frequency": (2.0, 8.0), "plunge_amplitude": (0.2, 0.6)}
    narrow = {name: replace(bird.actuators[name], range=one) for name, one in ranges.items()}
    robot = replace(bird, actuators=dict(bird.actuators) | narrow)
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.55)
    trimmed = pt.trim(robot, gait=gait, speed=4.5)
    optimal = pt.control.optimize(robot, start=trimmed, speed=4.5, harmonics=1)
    for orbit in (trimmed, optimal.orbit):
        amplitude = np.ptp(orbit.family.swings(orbit.values)[-1], axis=0).max() / 2
        assert amplitude == pytest.approx(0.6, abs=2e-6)
        law = pt.control.LinearRegulator(orbit, tuple(robot.actuators))
        assert np.abs(law.multipliers).max() <= 1 + 1e-6


def test_a_start_that_breaks_is_a_reason(aerobat):
    gait = pt.gaits.sinusoidal(aerobat, frequency=19.0, plunge=3.0, feather=3.0, elbow=3.0)
    light = aerobat.with_parameters({"body.mass": 1e-6})
    robot = replace(light, actuators={})
    failed = pt.trim(robot, gait=gait, free=("frequency",), steps=40)
    assert not failed.found and failed.remedy


def test_segments_that_diverge_lead_nowhere_and_are_told(aerobat):
    # Without air a body falls as it likes: derivatives of the segments multiply beyond all
    # numbers, and the least squares of them ended with an error of NumPy.
    void = pt.QuasiSteady(aerobat, pt.Air(density=1e-300))
    failed = pt.trim(aerobat, void)
    assert not failed.found and "stalled" in failed.reason
    # An integer beyond 64 bits ended in a TypeError of NumPy.
    assert not pt.trim(aerobat, turn_rate=10**30).found


@pytest.mark.parametrize("name", ["speed", "climb"])
def test_a_speed_beyond_that_of_sound_is_refused(aerobat, name):
    # A search at 2**63 m/s took 48 s to find nothing.
    for seek in (pt.trim, pt.control.optimize):
        for value in (2**63, -341.0):
            with pytest.raises(ParameterError, match=f"^{name}: expected up to 340 m/s"):
                seek(aerobat, **{name: value})


def test_refusals(aerobat):
    with pytest.raises(ParameterError, match="at least 2"):
        pt.trim(aerobat, free=("frequency",), speed=4.0)
    with pytest.raises(ParameterError, match="^free: expected frequency"):
        pt.trim(aerobat, free=("tail_offset",))
    with pytest.raises(ParameterError, match="air at rest"):
        pt.trim(aerobat, pt.QuasiSteady(aerobat, pt.Air(wind=(1.0, 0.0, 0.0))))
    with pytest.raises(ParameterError, match="Euler"):
        pt.trim(aerobat.with_attitude("quaternion"))
    with pytest.raises(ParameterError, match="floating"):
        pt.trim(pt.load_robot("ur5e"))
    with pytest.raises(ParameterError, match="multiple of 40"):
        pt.trim(aerobat, steps=50)
    with pytest.raises(ParameterError, match="held joints glide"):
        pt.trim(pt.load_robot("hawk"))
    with pytest.raises(ParameterError, match="range that holds the gait"):
        pt.trim(aerobat, gait=pt.gaits.sinusoidal(aerobat, frequency=25.0, plunge=0.8))
    with pytest.raises(TypeError, match="mass"):
        pt.trim(aerobat, mass=3)


def test_a_turn_needs_no_more_than_its_rate(aerobat):
    for robot in (aerobat, pt.load_robot("dragonfly")):  # with actuators and without
        orbit = pt.trim(robot, turn_rate=0.3)
        assert orbit.found and orbit.turn_rate == pytest.approx(0.3, abs=1e-9)


def test_free_parameters_are_the_actuators(aerobat):
    gait = pt.gaits.cruise(aerobat)
    assert free_parameters(aerobat, gait, 0.3) == tuple(aerobat.actuators)
    assert set(free_parameters(aerobat, gait)) == {
        *("frequency", "plunge_amplitude", "feather_amplitude", "feather_offset")
    }
    dragonfly = pt.load_robot("dragonfly")
    assert "hind_plunge_phase" in free_parameters(dragonfly, pt.gaits.cruise(dragonfly))


def test_the_verb_finds_writes_and_says_what_next(tmp_path, capsys):
    file = tmp_path / "trimmed.nc"
    code, out, err = say(capsys, "trim", "aerobat", "-o", file, "--beats", 2)
    assert code == 0
    for word in ("frequency [Hz]", "speed [m/s]", "largest multiplier", "feather offset [deg]"):
        assert word in out
    assert "Modes" in out and "roll subsidence" in out and "doubles in [s]" in out
    assert "quasi-steady air; free: frequency" in err and "Next: patagium view" in err
    flight = pt.load_flight(file)
    assert flight.attrs["outcome"] == "COMPLETED"
    assert abs(flight.q.sel(dof="z").values[-1]) < 1e-9


def test_the_verb_names_the_air_that_flies(capsys):
    """It said quasi-steady air whatever the polar and the inflow were."""
    _, _, err = say(capsys, "trim", "aerobat", "--polar", "dickinson", "--inflow")
    assert "cruise, quasi-steady air, polar dickinson, inflow; free: " in err


def test_the_verb_says_what_lacks(capsys):
    code, out, err = say(capsys, "trim", "ornithopter", "--free", "frequency", "--json")
    assert code == 2 and "remedy" in err
    assert json.loads(out)["lacking"]["moment_y"] != 0
    code, out, err = say(capsys, "trim", "aerobat", "--free", "frequency", "--speed", 4)
    assert code == 2 and "at least 2" in err


@pytest.mark.parametrize("verb", ["trim", "optimize"])
def test_the_verbs_say_that_a_hover_lacks_inflow(capsys, verb):
    """Without induced velocity, lift in hover is up to twice too large; only `simulate` warned."""
    for speed, inflow, told in ((0, [], True), (0, ["--inflow"], False), (4, [], False)):
        code, _, err = say(capsys, verb, "aerobat", "--free", "none", "--speed", speed, *inflow)
        assert code == 2 and ("--inflow, or" in err) == told


def test_steps_of_a_slow_beat_are_fine_enough():
    robot = pt.load_robot("ornithopter")
    usual, fine = pt.trim(robot), pt.trim(robot, steps=1920)
    sizes = state_sizes(usual.names)
    # its polar changes sides within steps: about one part in ten thousand; RK4 alone is below 1e-6
    assert np.abs((usual.states - fine.states) / sizes).max() < 2e-4
    assert np.abs(usual.values - fine.values).max() < 5e-5


def test_stiff_springs_take_the_steps_that_they_ask_for():
    """Steps were 240 whatever was stiff, and the remedy was another gait or start."""
    damping, inertia = 0.04, 0.004 * (0.08**2 + 0.001**2) / 12
    spring = f"passive: true, stiffness: 30 N m/rad, damping: {damping} N m s/rad"
    feather = "axis: y, limits: [-60 deg, 60 deg]"
    robot = load_robot_text(FLAPPER.replace(feather, f"axis: y, {spring}"))
    gait = pt.gaits.sinusoidal(robot, frequency=8.0, plunge=0.6)
    found = pt.trim(robot, gait=gait, climb=None)
    longest = 2.785 / (damping / inertia)  # of classic Runge-Kutta, on the real axis
    assert found.steps == pytest.approx(2 / 8.0 / longest, rel=0.05)
    told = pt.trim(robot, gait=gait, climb=None, steps=240)
    assert not told.found and f"they ask for: steps={found.steps}," in told.remedy
    fine = pt.trim(robot, gait=gait, climb=None, steps=2 * found.steps)
    np.testing.assert_allclose(found.values, fine.values, atol=1e-5)


def test_a_parameter_at_its_limit_is_held_there_and_costs_no_flight(monkeypatch):
    flown, fly = [], FlightMap.fly
    monkeypatch.setattr(FlightMap, "fly", lambda *given: flown.append(1) or fly(*given))
    robot = pt.load_robot("ornithopter")
    found = pt.trim(robot)
    assert found.residual <= 1e-12 and len(flown) == 1 + found.iterations
    motion = found.gait.motion(np.linspace(0.0, found.period, 4001)).position
    k = robot.index("left_plunge")
    place = robot.actuated.index(k)
    assert motion[:, place].min() == pytest.approx(robot.lower[k], abs=1e-6)  # a joint's margin


def test_a_search_that_comes_to_the_vertical_says_so(aerobat, orbit):
    # Damping of Euler rates is stiff there: it said "hardly reach is 1.5e+70 N of force_z".
    search = OrbitSearch(FlightMap(aerobat, orbit.aero), orbit.family, orbit.steps)
    states = orbit.states.copy()
    states[:, orbit.names.index("pitch")] = -1.45
    at = search.point(orbit.states, orbit.values, Conditions())._replace(states=states)
    failed = _not_found(search, at, "stalled")
    assert "83 degrees from level" in failed.reason and " N of " not in failed.reason
    assert "flatter" in failed.remedy


def test_no_actuator_gives_an_amplitude_below_zero():
    """A hover was found with an amplitude of -.544 rad, which no command can give."""
    robot = pt.load_robot("ornithopter")
    family = gait_family(robot, pt.gaits.cruise(robot), ("plunge_amplitude",))
    search = OrbitSearch(FlightMap(robot, pt.QuasiSteady(robot)), family, 100)
    assert not search.excess(family.neutral)
    assert "would need plunge_amplitude -" in search.excess(-family.neutral)


def test_a_robot_without_fin_whose_sides_differ_is_told_so():
    """The remedy of a trim was an orbit nearby, which a robot without fin does not have."""
    heavy = "mass: 206 g\n    center_of_mass: [0, 0.000001 m, 0]"
    odd = load_robot_text(pt.load_robot("hawk").source.replace("mass: 206 g", heavy))
    failed = pt.trim(odd, climb=None, free=("elevation_offset",))
    assert "what the free parameters hardly reach is" in failed.reason
    assert "of moment_x" in failed.reason
    assert failed.remedy.startswith("if left and right differ, free a command that differs")


def test_a_robot_without_wings_is_refused_before_the_search():
    """No joint limit, which the failed search asked to widen, gives it air."""
    text = re.sub(r"(?s)\nwings:.*(?=\nmirror:)", "", preset_text("ornithopter"))
    robot = load_robot_text(text)
    assert robot_warnings(robot)[0].startswith("wings: there is no such section, so that no air")
    with pytest.raises(ParameterError, match="^robot: expected a robot whose file has a section w"):
        pt.trim(robot)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("plunge", "plunge_amplitude"),
        ("left_elbow", "left_elbow_offset"),
        ("frequncy", "frequency"),
    ],
)
def test_a_name_near_a_gait_parameter_is_answered_by_one_that_trim_takes(aerobat, name, meant):
    """It was answered by the name of a joint, also where that was what had been written."""
    gait = pt.gaits.cruise(aerobat)
    with pytest.raises(ParameterError, match=f"; did you mean {meant}[?]$"):
        gait_family(aerobat, gait, (name,))
    assert gait_family(aerobat, gait, (meant,)).names == (meant,)


def test_an_orbit_beyond_the_limits_of_a_passive_joint_is_not_handed_over():
    """Such an orbit was returned: wings turned by 33 deg on hinges limited to 3 deg."""
    free = pt.trim(load_robot_text(SPRUNG))
    turned = np.degrees(free.flight(beats=1).q.sel(dof="left_feather"))
    found = pt.trim(load_robot_text(SPRUNG.replace("[-45 deg, 45 deg]", "[-3 deg, 3 deg]")))
    least, most = re.search("go from (.*) to (.*) deg, and its limits", found.reason).groups()
    own = [turned.min().item(), turned.max().item()]
    # three digits of words, and a beat of 240 steps: 37 deg times (pi / 240)^2 / 2
    assert [float(least), float(most)] == pytest.approx(own, abs=0.06)
    assert found.reason.startswith("left_feather would") and "limits are -3 to 3" in found.reason
    assert found.remedy.startswith("stiffen its spring, widen that limit")
    assert found.beyond.values == pytest.approx(free.values, rel=1e-9)  # rounding of the search
    assert "beyond" not in found.summary()
