"""Simulation at the door and at the end: refusals, the record's shape, runs that stop early."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from tests.robots import FLAPPER

import patagium as pt
from patagium.cli.main import run
from patagium.errors import Interrupted, Outcome, ParameterError, ShapeError, SimulationFailed
from patagium.robot import load_robot_text
from patagium.simulation import QUANTITIES
from patagium.simulation.flight_summary import flight_summary


@pytest.fixture(scope="module")
def robot():
    return pt.load_robot("aerobat")


@pytest.fixture(scope="module")
def aero(robot):
    return pt.QuasiSteady(robot)


@pytest.fixture(scope="module")
def gait(robot):
    return pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.4)


@pytest.fixture(scope="module")
def flight(robot, aero, gait):
    return pt.simulate(robot, aero, gait, duration=0.02, time_step=1e-4, v=robot.coordinates(x=4.0))


def test_every_quantity_is_there_with_its_dimensions_and_unit(robot, flight):
    sizes = {"time": 201, "dof": 14, "strip": 10, "axis": 3, "component": 6, "lag": 0}
    assert dict(flight.sizes) == sizes
    for name, kind in QUANTITIES.items():
        assert flight[name].dims == ("time", *kind.dims)
        assert flight[name].dtype == np.float64
        assert flight[name].attrs["units"] == (kind.units or "m/s")  # of lags, were there any
        assert np.isfinite(flight[name].values).all()
    assert tuple(flight.dof.values) == robot.dof_names
    assert flight.time.attrs["units"] == "s"
    assert flight.attrs["outcome"] == "COMPLETED"


def test_time_counts_steps_from_zero(flight):
    assert np.array_equal(flight.time.values, np.arange(201) * 1e-4)


def test_recorded_strips_are_the_models_own(aero, flight):
    k = 137
    strips = aero.strips(flight.q.values[k], flight.v.values[k])
    for name in ("strip_force", "strip_point", "angle_of_attack", "strip_airspeed"):
        # same formulas, compiled in another order
        np.testing.assert_allclose(flight[name].values[k], strips[name], rtol=1e-11, atol=1e-15)
    force = aero.generalized_force(flight.q.values[k], flight.v.values[k])
    np.testing.assert_allclose(flight.aero_force.values[k], force, rtol=1e-11, atol=1e-15)


def test_wind_of_the_air_is_recorded_and_felt(robot, gait, flight):
    gusty = pt.Air(
        wind=(-1.0, 0.5, 0.0), gust=pt.air.OneMinusCosineGust((0.0, 0.0, 2.0), 0.005, 0.01)
    )
    windy = pt.simulate(
        robot, pt.QuasiSteady(robot, gusty), gait, duration=0.02, time_step=1e-4,
        v=robot.coordinates(x=4.0),
    )  # fmt: skip
    np.testing.assert_allclose(windy.wind.values, gusty.wind_at(windy.time.values))
    assert windy.wind.values[100, 2] == pytest.approx(2.0)
    assert windy.v.values[-1, 2] > flight.v.values[-1, 2] + 0.01


def test_the_length_of_a_chunk_changes_nothing(robot, aero, gait, flight, monkeypatch):
    monkeypatch.setattr("patagium.simulation.runge_kutta.CHUNK", 7)
    seen = []
    again = pt.simulate(
        robot, aero, gait, duration=0.02, time_step=1e-4, v=robot.coordinates(x=4.0),
        progress=lambda done, steps: seen.append((done, steps)),
    )  # fmt: skip
    assert np.array_equal(again.v.values, flight.v.values)
    assert seen[0] == (7, 200) and seen[-1] == (200, 200) and len(seen) == 29


def test_a_flight_that_goes_on_cannot_be_changed_by_who_looks_at_it(robot, aero, gait, flight):
    simulator = pt.Simulator(
        robot, aero, gait, duration=0.02, time_step=1e-4, v=robot.coordinates(x=4.0)
    )
    with pytest.raises(ParameterError, match="steps: expected a whole number, zero or more"):
        simulator.advance(-1)  # told COMPLETED
    simulator.advance(50)
    so_far = simulator.flight()
    for name in ("q", "strip_force", "momentum"):
        with pytest.raises(ValueError, match="read-only"):
            so_far[name] *= 57.3
    simulator.fly()
    assert np.array_equal(simulator.flight().q.values, flight.q.values)
    simulator.flight()["q"] *= 57.3  # a flight that ended belongs to who has it


def test_means_are_over_whole_wingbeats_or_say_so(robot, aero, gait, flight):
    part = flight_summary(flight)
    assert part["means_over"] == "its second half; it is shorter than a wingbeat"
    assert part["frequency"] == pytest.approx(5.0) and not 0.7 < part["force_over_weight"] < 1.4
    assert not [k for k in part["warnings"] if "weight" in k]
    longer = pt.simulate(robot, aero, gait, duration=0.35, time_step=1e-3, v=robot.velocities(x=4))
    assert flight_summary(longer)["means_over"] == "its last wingbeat"
    last = longer.isel(time=slice(150, None))
    weight = robot.gravity * sum(body.mass for body in robot.bodies)
    lift = np.trapezoid(last["aero_force"].sel(dof="z")) / (last.sizes["time"] - 1) / weight
    assert flight_summary(longer)["force_over_weight"] == pytest.approx(float(lift), rel=1e-9)


def test_means_of_the_summary_are_over_whole_wingbeats_at_any_step(robot, aero, gait):
    """Where the step does not divide the beat they began at the next sample: 2 % of the power."""
    fixed = pt.mounts.fixed()
    options = {"duration": 0.413, "mount": fixed}
    one, fine = (pt.simulate(robot, aero, gait, time_step=k, **options) for k in (7e-3, 1e-3))
    power, exact = (flight_summary(each)["joint_power"] for each in (one, fine))
    assert power == pytest.approx(exact, rel=1e-3)  # 4 times the trapezoid's error at 29 samples


def test_a_start_of_a_joint_is_the_gaits_or_not_given(robot, aero, gait, flight):
    span = {"duration": 0.02, "time_step": 1e-4}
    own = {"left_plunge": float(gait.motion(np.zeros(1)).velocity[0, 0])}
    again = pt.simulate(robot, aero, gait, v=robot.velocities(x=4.0, **own), **span)
    assert own["left_plunge"] > 1 and again.equals(flight)
    with pytest.raises(ParameterError, match="q of left_plunge: .*its gait prescribes it .0 there"):
        pt.simulate(robot, aero, gait, q=robot.coordinates(left_plunge=1.0), **span)
    with pytest.raises(ParameterError, match="v of left_feather: .*, found 3.0"):
        pt.simulate(robot, aero, gait, v=robot.velocities(left_feather=3.0), **span)


def test_a_fixed_mount_holds_the_body_and_reports_the_force(robot, aero, gait):
    windy = pt.QuasiSteady(robot, pt.Air(wind=(-4.0, 0.0, 0.0)))
    q = robot.coordinates(z=1.0, pitch=0.2)
    held = pt.simulate(
        robot, windy, gait, duration=0.02, time_step=1e-4, q=q, mount=pt.mounts.fixed()
    )
    assert np.array_equal(held.q.values[:, :6], np.tile(q[:6], (201, 1)))
    assert not held.v.values[:, :6].any() and not held.a.values[:, :6].any()
    # world translation: the generalized force is the force
    np.testing.assert_array_equal(held.mount_force.values[:, :3], held.mount_wrench.values[:, :3])
    assert np.abs(held.mount_wrench.values[:, 2]).max() > 0.1
    assert held.attrs["mount"] == "fixed"
    assert held.attrs["momentum_audit"] < 1e-9  # fourth order at 1e-4 s


def test_a_robot_without_a_floating_body_cannot_fly_freely():
    wing = pt.load_robot("yeo-wing")
    still = pt.gaits.still(wing)
    with pytest.raises(ParameterError, match="no floating body"):
        pt.simulate(
            wing, pt.QuasiSteady(wing), still, duration=0.1, time_step=0.01, mount=pt.mounts.free()
        )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"time_step": 0.0}, "time_step"),
        ({"time_step": np.nan}, "time_step"),
        ({"duration": -1.0}, "duration"),
        ({"duration": 0.0205, "time_step": 1e-3}, "whole number of time steps"),
        ({"q": [0.0] * 13 + [np.nan]}, "right_feather"),
        ({"v": np.full(14, np.inf)}, "finite"),
        ({"q": np.eye(14)[4] * 1.56}, "pitch"),
        ({"q": np.eye(14)[4] * 10.0}, r"573 deg; are degrees meant\? np.radians\(10\)"),
        ({"v": np.eye(14)[0] * 400.0}, "velocity of x"),
    ],
)
def test_what_cannot_be_flown_is_refused_at_the_door(robot, aero, gait, change, words):
    with pytest.raises(ParameterError, match=words):
        pt.simulate(robot, aero, gait, **({"duration": 0.02, "time_step": 1e-4} | change))


def test_vectors_of_another_length_are_refused(robot, aero, gait):
    with pytest.raises(ShapeError, match=r"q: expected shape \(14,\), found \(6,\)"):
        pt.simulate(robot, aero, gait, duration=0.02, time_step=1e-4, q=np.zeros(6))


def test_a_fixed_mount_refuses_a_moving_start(robot, aero, gait):
    with pytest.raises(ParameterError, match="velocity of x.*wind"):
        pt.simulate(
            robot, aero, gait, duration=0.02, time_step=1e-4, mount=pt.mounts.fixed(),
            v=robot.coordinates(x=3.0),
        )  # fmt: skip


def test_air_or_gait_of_another_robot_is_refused(robot, aero, gait):
    wing = pt.load_robot("yeo-wing")
    with pytest.raises(ParameterError, match="aero"):
        pt.simulate(robot, pt.QuasiSteady(wing), gait, duration=0.02, time_step=1e-4)
    with pytest.raises(ParameterError, match="gait"):
        pt.simulate(robot, aero, pt.gaits.still(wing), duration=0.02, time_step=1e-4)


def tumbling(robot, aero, **options):
    still = pt.gaits.still(robot)
    spin = robot.coordinates(x=4.0, pitch=40.0)
    undamped = robot.with_parameters({"pitch.damping": 1e-9})
    return pt.simulate(undamped, aero, still, duration=0.2, time_step=1e-4, v=spin, **options)


def test_a_run_through_the_euler_singularity_stops_and_says_so(robot, aero):
    with pytest.raises(SimulationFailed) as caught:
        tumbling(robot, aero)
    failure = caught.value
    assert failure.outcome is Outcome.LIMIT_REACHED
    assert "pitch reached" in str(failure) and "stopped at t = 0.0" in str(failure)
    flight = failure.flight
    assert 100 < flight.sizes["time"] < 2001
    assert np.isfinite(flight.q.values).all()
    assert flight.attrs["outcome"] == "LIMIT_REACHED" and flight.attrs["message"] == str(failure)
    assert tumbling(robot, aero, throw=False).equals(flight)


def test_a_step_too_large_ends_as_a_value_that_names_the_quantity(robot, aero, gait):
    forward = robot.coordinates(x=4.0)
    flight = pt.simulate(robot, aero, gait, duration=2.0, time_step=5e-3, v=forward, throw=False)
    assert flight.attrs["outcome"] == "STEP_TOO_LONG"
    assert any(name in flight.attrs["message"] for name in ("pitch", "roll", "velocity"))
    assert 1 <= flight.sizes["time"] < 400
    assert np.isfinite(flight.v.values).all()


def test_a_robot_whose_source_tells_another_is_not_flown(robot, gait):
    """A flight of a robot changed by `replace` came back with the numbers of the former one."""
    other = replace(robot, gravity=2 * robot.gravity)
    with pytest.raises(ParameterError, match="robot: expected the robot that its source describes"):
        pt.Simulator(other, pt.QuasiSteady(other), gait, duration=0.1)
    heavy = robot.with_parameters({"gravity": 2 * robot.gravity})
    pt.Simulator(heavy, pt.QuasiSteady(heavy), gait, duration=0.1)


def test_numbers_that_are_not_finite_stop_the_run(robot, aero, gait):
    heavy = replace(robot, damping=tuple(1e300 if d else 0.0 for d in robot.damping), source="")
    flight = pt.simulate(
        heavy, aero, gait, duration=0.1, time_step=1e-4, throw=False,
        v=robot.coordinates(pitch=1.0),
    )  # fmt: skip
    assert flight.attrs["outcome"] == "NOT_FINITE"
    assert "became" in flight.attrs["message"] and "others" in flight.attrs["message"]
    assert flight.sizes["time"] == 1


def test_a_passive_joint_stops_the_run_at_its_limit(robot, aero, gait):
    lower = list(robot.lower)
    lower[robot.index("z")] = -0.001
    floor = replace(robot, lower=tuple(lower), source="")
    flight = pt.simulate(floor, aero, gait, duration=0.2, time_step=1e-4, throw=False)
    assert "z reached -0.001" in flight.attrs["message"]


def test_interrupting_is_possible_between_chunks(robot, aero, gait, monkeypatch):
    monkeypatch.setattr("patagium.simulation.runge_kutta.CHUNK", 10)

    def interrupt(done, steps):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pt.simulate(robot, aero, gait, duration=0.1, time_step=1e-4, progress=interrupt)


def test_an_interruption_hides_no_run_that_broke_or_is_complete(robot, aero, gait, monkeypatch):
    """A whole flight was `step 501 of 500: interrupted`, and a broken one had no cause."""

    def interrupt(done, steps):
        raise Interrupted

    words = dict(time_step=5e-3, v=robot.coordinates(x=4.0), throw=False, progress=interrupt)
    broken = pt.simulate(robot, aero, gait, duration=2.0, **words)
    assert broken.attrs["outcome"] == "STEP_TOO_LONG"
    words["time_step"] = 1e-3
    assert pt.simulate(robot, aero, gait, duration=0.02, **words).attrs["outcome"] == "COMPLETED"
    monkeypatch.setattr("patagium.simulation.runge_kutta.CHUNK", 10)
    early = pt.simulate(robot, aero, gait, duration=0.02, **words)
    assert early.attrs["outcome"] == "INTERRUPTED" and early.sizes["time"] == 11


def test_a_keyword_that_no_flight_has_is_refused_by_name(robot, aero, gait):
    with pytest.raises(TypeError, match="'addedmass', expected one of added_mass"):
        pt.simulate(robot, aero, gait, duration=1e-3, time_step=1e-3, addedmass=None)


@pytest.mark.parametrize("name", ["aerobat", "yeo-wing"])
def test_a_robot_alone_flies_its_cruise_as_the_command_does(name, tmp_path):
    robot, path = pt.load_robot(name), tmp_path / "flight.nc"
    with pytest.raises(SystemExit, match="0"):
        run(["simulate", name, "--duration", "0.05", "-o", str(path)])
    own, said = pt.simulate(robot, duration=0.05), pt.load_flight(path)
    assert own.attrs["time_step"] == said.attrs["time_step"]
    for quantity in ("q", "v", "a", "wind"):  # kept in double precision
        np.testing.assert_array_equal(own[quantity], said[quantity])


def test_what_is_given_takes_the_place_of_the_cruise(tmp_path):
    robot = pt.load_robot("aerobat")
    whole = pt.simulate(robot, v=robot.velocities(x=5.0), mount=pt.mounts.free())
    assert float(whole["time"][-1]) == pytest.approx(robot.cruise.duration)
    assert float(whole["v"][0, robot.index("x")]) == 5.0
    assert float(whole["q"][0, robot.index("pitch")]) == robot.cruise.pitch
    still = pt.simulate(robot, gait=pt.gaits.still(robot), duration=0.01)
    assert not still["v"][0].any()  # the start of the cruise belongs to its gait
    held = pt.simulate(robot, mount=pt.mounts.fixed(), duration=0.01)
    assert float(held["wind"][0, 0]) == -robot.cruise.speed
    with pytest.raises(ParameterError, match="a robot whose file has a section cruise"):
        pt.simulate(replace(robot, cruise=None))
    with pytest.raises(ParameterError, match="a robot with wings whose file"):
        pt.gaits.cruise(pt.load_robot("ur5e"))


def test_on_a_stand_the_air_meets_the_robot_as_in_the_cruise(tmp_path, capsys):
    """The wind of a stand was that of the cruise, the pitch was level: the force pointed down."""
    robot, path = pt.load_robot("aerobat"), tmp_path / "flight.nc"
    held = pt.simulate(robot, mount=pt.mounts.fixed(), duration=0.01)
    free = pt.simulate(robot, duration=0.01)
    np.testing.assert_allclose(held["strip_force"][0], free["strip_force"][0], rtol=1e-12)
    assert np.array_equal(held["q"][0], free["q"][0])
    with pytest.raises(SystemExit, match="0"):
        run(["simulate", "aerobat", "--mount", "fixed", "--duration", "0.01", "-o", str(path)])
    np.testing.assert_array_equal(pt.load_flight(path)["q"], held["q"])
    assert "in a wind of 4.08 m/s, pitch -30.5 deg" in capsys.readouterr().err


@pytest.mark.parametrize("again", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_simulator_goes_to_another_process_and_flies_on_alike(again):
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    for mount in (pt.mounts.free(), pt.mounts.fixed()):
        first = pt.Simulator(
            robot, pt.QuasiSteady(robot), gait, duration=0.06, time_step=1e-3, mount=mount
        )
        first.step({"frequency": 4.5})
        flights = []
        for one in (again(first), first):
            one.step({"plunge_offset": 0.05})
            one.change(robot.with_parameters({"body.mass": 0.012}), pt.QuasiSteady(robot))
            one.fly()
            flights.append(one.flight())
        xr.testing.assert_identical(*flights)


@pytest.mark.usefixtures("interpreted")
def test_weight_and_speed_are_those_of_the_mass_that_flies():
    """After a payload the airspeed of cycles was 30 % too fast, and the weight that of before."""
    robot = load_robot_text(FLAPPER)
    gait = pt.gaits.sinusoidal(robot, frequency=10.0)
    one = pt.Simulator(robot, pt.QuasiSteady(robot), gait, duration=0.3, time_step=1e-3)
    one.advance(50)
    body, mass = robot.bodies[0], robot.flying.mass
    heavier = robot.with_parameters({f"{body.name}.mass": body.mass + 0.5 * mass})
    one.change(heavier, pt.QuasiSteady(heavier))
    one.fly()
    flight = one.flight()
    assert flight["mass"].values[[49, 50, -1]] == pytest.approx([mass, 1.5 * mass, 1.5 * mass])
    beats = [flight.isel(time=slice(k, k + 101)) for k in (100, 200)]
    means = [np.trapezoid(one["momentum"], one["time"], axis=0) / 0.1 for one in beats]
    found = pt.cycle_statistics(flight, skip=1)
    speed = np.mean(np.linalg.norm(means, axis=1)) / (1.5 * mass)
    assert found.attrs["airspeed"] == pytest.approx(speed, rel=1e-9)
    last = flight.isel(time=slice(200, None))
    lift = np.trapezoid(last["strip_force"].sum("strip").sel(axis="z"), last["time"]) / 0.1
    weight = 1.5 * mass * robot.gravity
    assert flight_summary(flight)["force_over_weight"] == pytest.approx(lift / weight, rel=1e-9)


@pytest.mark.usefixtures("interpreted")
def test_a_gust_that_travels_meets_a_robot_of_one_strip():
    """Its record ended in a traceback of NumPy."""
    one = load_robot_text(FLAPPER.split("mirror:")[0])
    gust = pt.air.TravelingGust(
        pt.air.OneMinusCosineGust((0.0, 0.0, 1.0), 0.0, 0.01), (1.0, 0.0, 0.0), 5.0
    )
    aero = pt.QuasiSteady(one, pt.Air(gust=gust))
    gait = pt.gaits.sinusoidal(one, frequency=5.0)
    flown = pt.simulate(one, aero, gait, duration=0.01, time_step=1e-3)
    np.testing.assert_array_equal(flown["wind"], flown["strip_wind"][:, 0])
    assert flown["wind"].values.any()
