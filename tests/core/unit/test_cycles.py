"""Statistics of wingbeats: closed forms, momentum, and what a load cell reads."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.cli.main import run
from patagium.errors import FlightError, ParameterError
from patagium.simulation.flight_summary import flight_summary

STEP, BEATS = 5e-4, 4


@pytest.fixture(scope="module")
def held() -> Iterator[xr.Dataset]:
    robot = pt.load_robot("aerobat")
    air = pt.Air(wind=(-3.0, 0.0, 0.0))
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)
    yield pt.simulate(
        robot,
        pt.LiftingLine(robot, air),
        gait,
        duration=BEATS * 0.2,
        time_step=STEP,
        mount=pt.mounts.fixed(),
        added_mass=pt.AddedMass(robot, air),
    )


def test_a_load_cell_reads_the_air_and_the_rate_of_the_wings_momentum(held: xr.Dataset) -> None:
    statistics = pt.cycle_statistics(held, phases=200)
    time, momentum = held["time"].values, held["momentum"].values
    rate = np.gradient(momentum[:, 2], time)
    stamps = 0.2 + 0.2 * statistics["phase"].values
    expected = statistics["lift"] - np.mean(
        [np.interp(stamps + 0.2 * k, time, rate) for k in range(BEATS - 1)], axis=0
    )
    scale = np.abs(expected).max().item()
    # the derivative by differences: of order (2 pi f n dt)^2 / 6 with a few harmonics n
    np.testing.assert_allclose(statistics["mount_lift"], expected, atol=1e-3 * scale)
    # the wings' momentum returns, so that it has no mean: the trapezoid of a smooth cycle
    assert statistics["mount_lift"].mean() == pytest.approx(
        statistics["lift"].mean().item(), abs=1e-4 * scale
    )


@pytest.mark.parametrize(
    ("quantity", "units", "factor"),
    [("u1", "mN or mN m", 1e3), ("q", "m or deg", np.degrees(1.0)), ("time", "ms", 1e3)],
)
def test_a_flight_that_states_other_units_is_refused(
    held: xr.Dataset, quantity: str, units: str, factor: float
) -> None:
    """Mean power was 1000 times too large, and numbers were learned of such forces."""
    stated = (held[quantity] * factor).assign_attrs(units=units)
    other = (
        held.assign_coords(time=stated) if quantity == "time" else held.assign({quantity: stated})
    )
    sensors = [pt.sensors.presets.as5600()]
    for use in (
        pt.cycle_statistics,
        pt.identify,
        pt.training_data,
        lambda flight: pt.sense(flight, sensors),
        lambda flight: pt.sensor_log(flight[["q", "v", "a", "u1"]]),
    ):
        with pytest.raises(FlightError, match=rf"{quantity}: expected \[.*found \[{units}\]"):
            use(other)
    silent = other.copy()
    silent[quantity].attrs.pop("units")
    pt.training_data(silent)  # of what does not say so, arithmetic drops the units


def test_cycles_of_a_settled_wing_repeat(held: xr.Dataset) -> None:
    statistics = pt.cycle_statistics(held, skip=2)
    assert statistics.attrs["cycles"] == BEATS - 2
    lift = statistics["lift"]
    # lags of the wake still fade a little, two beats in
    assert statistics["lift_spread"].max() < 0.02 * np.abs(lift).max()
    mean, scale = statistics.attrs["mean_lift"], np.abs(lift).max().item()
    assert statistics["lift_by_cycle"].values == pytest.approx(mean, abs=0.02 * scale)


def test_a_fall_in_thin_air_gives_known_numbers() -> None:
    robot = pt.load_robot("aerobat")
    flight = pt.simulate(
        robot,
        pt.QuasiSteady(robot, pt.Air(density=1e-12)),
        pt.gaits.still(robot),
        duration=0.2,
        time_step=1e-4,
        v=robot.coordinates(x=3.0),
    )
    statistics = pt.cycle_statistics(flight, period=0.05, skip=0).attrs
    falling = 9.8 * 0.05 * (np.arange(4) + 0.5)  # mean of each beat, in the sum over samples
    speed = np.hypot(3.0, falling).mean()
    assert statistics["cycles"] == 4
    assert statistics["airspeed"] == pytest.approx(speed, rel=1e-9)
    assert abs(statistics["mean_lift"]) < 1e-11  # the air's share
    assert statistics["cost_of_transport"] == pytest.approx(
        statistics["mean_positive_power"] / (0.02 * 9.8 * speed), abs=1e-12
    )


def test_no_joint_spends_what_another_one_gives_back() -> None:
    """Their sum was taken first, so that one drove another: 10 % too little for a dragonfly."""
    robot = pt.load_robot("dragonfly")
    flight = pt.simulate(robot, duration=0.2)
    powers = (flight["u1"] * flight["v"]).values
    means = pt.cycle_statistics(flight, period=0.05, skip=0).attrs
    wanted = np.maximum(powers, 0.0).sum(axis=1).mean()
    assert means["mean_positive_power"] == pytest.approx(wanted, rel=0.01)  # samples of a beat
    assert np.maximum(powers.sum(axis=1), 0.0).mean() < 0.95 * wanted


def test_means_are_those_of_the_samples_whatever_the_points_of_a_curve() -> None:
    """Means over cycles were taken at the points of the curve: two points doubled the power."""
    flight = pt.simulate(pt.load_robot("aerobat"), duration=1.1)
    few, many = (pt.cycle_statistics(flight, phases=n) for n in (2, 100))
    assert few.attrs == many.attrs and (few["lift_by_cycle"] == many["lift_by_cycle"]).all()
    ends = many.attrs["period"] * np.arange(1, 2 + many.attrs["cycles"])
    work = np.interp(ends, flight["time"], flight["joint_work"])
    wanted = np.diff(work) / many.attrs["period"]
    assert many["power_by_cycle"].values == pytest.approx(wanted, rel=1e-3)  # of the trapezoid
    assert many.attrs["mean_power"] == pytest.approx(wanted.mean(), rel=1e-3)


def test_the_airspeed_is_that_of_the_beats_that_count() -> None:
    """The airspeed of a bird that slows down was that of the whole flight, despite `skip`."""
    robot = pt.load_robot("ornithopter")
    aero, gait = pt.QuasiSteady(robot), pt.gaits.cruise(robot)
    given = {"duration": 1.2, "time_step": 2e-3, "v": robot.velocities(x=9.0)}
    flight = pt.simulate(robot, aero, gait, **given)
    for skip in (0, 3):
        found = pt.cycle_statistics(flight, skip=skip).attrs
        own = []
        for k in range(skip, skip + found["cycles"]):
            late = abs(flight.time - (k + 0.5) * found["period"]) <= found["period"] / 2
            stamps, way = flight.time.values[late.values], flight.momentum.values[late.values]
            own.append(np.linalg.norm(np.trapezoid(way, stamps, axis=0)) / np.ptp(stamps))
        # beats begin between samples: a step of 100 at most is counted otherwise
        assert found["airspeed"] == pytest.approx(np.mean(own) / robot.mass, rel=1e-3)


def test_airspeed_is_a_mean_over_time_as_forces_are() -> None:
    """Samples that stand closer in one half of a wingbeat made that half count for more."""
    robot = pt.load_robot("ornithopter")
    aero, gait = pt.QuasiSteady(robot), pt.gaits.cruise(robot)
    flight = pt.simulate(robot, aero, gait, duration=1.0, v=robot.velocities(x=9.0))
    late = np.flatnonzero(flight.time.values % 0.2 < 0.1)
    uneven = flight.isel(time=np.union1d(late, np.arange(0, flight.sizes["time"], 8)))
    even, found = (pt.cycle_statistics(f).attrs["airspeed"] for f in (flight, uneven))
    # the trapezoid of an eighth of the samples; counted by samples it was 2.7 % apart
    assert found == pytest.approx(even, rel=1e-3)


def test_a_turn_is_flown_along_its_own_way(held: xr.Dataset) -> None:
    """A circle had no airspeed, and its thrust was that along the mean of all its ways."""
    still = held.assign(added_mass_force=0 * held["added_mass_force"])
    angle = np.radians(20.0) * held["time"].values / 0.2
    c, s, zero = np.cos(angle), np.sin(angle), 0 * angle
    turn = np.array([[c, -s, zero], [s, c, zero], [zero, zero, zero + 1]])
    turned = {
        name: (still[name].dims, np.einsum("ijt,t...j->t...i", turn, still[name].values))
        for name in ("wind", "momentum", "strip_force")
    }
    straight, found = (pt.cycle_statistics(f, skip=0) for f in (still, still.assign(turned)))
    chord = np.sin(np.radians(10.0)) / np.radians(10.0)  # of a beat over its arc
    # the trapezoid of 400 steps; the wings' own motion, which is not turned as a whole
    assert found.attrs["airspeed"] == pytest.approx(3.0 * chord, rel=1e-3)
    by_cycle = [each["thrust_by_cycle"].values[1:-1] for each in (found, straight)]
    # the middles of three chords lie on no line: 20 degrees cubed, over 64, of the side force
    scale = np.abs(straight["thrust"]).max().item()
    np.testing.assert_allclose(*by_cycle, atol=1e-3 * scale)


def test_lift_scales_with_the_density_and_thrust_turns_with_the_way(held: xr.Dataset) -> None:
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)

    def fly(density: float, heading: float) -> xr.Dataset:
        wind = (-3.0 * np.cos(heading), -3.0 * np.sin(heading), 0.0)
        aero = pt.QuasiSteady(robot, pt.Air(density=density, wind=wind))
        flight = pt.simulate(
            robot,
            aero,
            gait,
            duration=0.45,
            time_step=1e-3,
            mount=pt.mounts.fixed(),
            q=robot.coordinates(yaw=heading),
        )
        return pt.cycle_statistics(flight)

    once, twice, turned = fly(1.0, 0.0), fly(2.0, 0.0), fly(1.0, 1.0)
    np.testing.assert_allclose(twice["lift"], 2 * once["lift"], rtol=1e-9)  # rounding
    # the same flight seen from elsewhere: rounding
    np.testing.assert_allclose(turned["thrust"], once["thrust"], atol=1e-9)
    assert once.attrs["mean_lift_gram_force"] == pytest.approx(
        once.attrs["mean_lift"] / 9.80665e-3, rel=1e-12
    )


@pytest.mark.usefixtures("interpreted")
def test_a_wing_without_a_floating_body_has_its_added_mass_counted() -> None:
    robot = pt.load_robot("yeo-wing")
    air = pt.Air(wind=(-2.9, 0.0, 0.0))
    gait = pt.gaits.sinusoidal(robot, frequency=3.3, **{robot.dof_names[0]: 0.4})
    flight = pt.simulate(
        robot,
        pt.LiftingLine(robot, air),
        gait,
        duration=0.7,
        time_step=1e-3,
        added_mass=pt.AddedMass(robot, air),
    )
    with_it = pt.cycle_statistics(flight)
    without = pt.cycle_statistics(flight.assign(added_mass_force=0 * flight["added_mass_force"]))
    assert np.abs(with_it["lift"] - without["lift"]).max() > 0.05 * np.abs(with_it["lift"]).max()


def test_the_summary_counts_the_force_of_the_air_as_cycles_do(held: xr.Dataset) -> None:
    pushed = held.assign(added_mass_force=held["added_mass_force"] + 0.5 * (held["dof"] == "z"))
    more = pt.cycle_statistics(pushed).mean_lift - pt.cycle_statistics(held).mean_lift
    shares = [flight_summary(flight)["force_over_weight"] for flight in (held, pushed)]
    robot = pt.load_robot("aerobat")
    weight = robot.gravity * sum(float(body.mass) for body in robot.bodies)
    assert more == pytest.approx(0.5) and shares[1] - shares[0] == pytest.approx(0.5 / weight)


def test_a_wing_that_hovers_on_a_fixed_root_is_told_of_the_air_it_throws_down() -> None:
    robot = pt.load_robot("yeo-wing")
    gait = pt.gaits.sinusoidal(robot, frequency=3.3, **{robot.dof_names[0]: 0.4})
    flight = pt.simulate(robot, pt.QuasiSteady(robot), gait, duration=1 / 3.3, time_step=1 / 330)
    assert flight_summary(flight)["warnings"][0].startswith("It hovers")
    meets_it = pt.air.WindShear(pt.air.Inflow(pt.QuasiSteady(robot)))
    flight.attrs["aero"] = json.dumps(meets_it.describe())
    dims, still = flight["aero_state"].dims, np.zeros((len(flight["time"]), meets_it.state_size))
    flight = flight.drop_dims(dims[1:]).assign(aero_state=(dims, still))
    assert not any("It hovers" in one for one in flight_summary(flight)["warnings"])


def test_wings_that_fly_circles_do_not_hover() -> None:
    """Eight wingbeats through air that turns around once in their second half."""
    robot = pt.load_robot("yeo-wing")
    gait = pt.gaits.sinusoidal(robot, frequency=3.3, **{robot.dof_names[0]: 0.4})
    flight = pt.simulate(robot, pt.QuasiSteady(robot), gait, duration=8 / 3.3, time_step=1 / 330)
    turned = 2 * np.pi * 3.3 / 4 * flight["time"].to_numpy()
    wind = np.stack([np.cos(turned), np.sin(turned), 0 * turned], axis=1)
    for speed, hovers in ((0.0, True), (3.0, False)):  # the fastest strip moves at 1 m/s
        flown = flight.assign(wind=(("time", "axis"), speed * wind))
        assert any("hovers" in one for one in flight_summary(flown)["warnings"]) == hovers
    names = [f"induced velocity of {axis}" for axis in "xyz"]
    aero = pt.air.Inflow(pt.QuasiSteady(robot))
    states = np.zeros((len(turned), aero.state_size))
    states[:, [aero.state_names.index(name) for name in names]] = 0.0, 0.0, -1.0
    flight = flight.drop_dims("lag", errors="ignore").assign(aero_state=(("time", "lag"), states))
    flight.attrs["aero"] = json.dumps(aero.describe())
    for speed, sinks in ((0.0, True), (3.0, False)):
        flown = flight.assign(wind=(("time", "axis"), speed * wind + (0.0, 0.0, 0.9)))
        assert any("vortex" in one for one in flight_summary(flown)["warnings"]) == sinks


@pytest.mark.usefixtures("interpreted")
def test_wingbeats_with_a_gap_in_time_are_left_out() -> None:
    """They were averaged along a straight line through their gap."""
    robot = pt.load_robot("yeo-wing")
    gait = pt.gaits.sinusoidal(robot, frequency=2.5, **{robot.dof_names[0]: 0.4})
    flight = pt.simulate(robot, pt.QuasiSteady(robot), gait, duration=2.4, time_step=0.004)
    cut = flight.isel(time=np.r_[0:240, 320:601])  # in the third and the fourth of six
    sound, found = pt.cycle_statistics(flight, skip=0), pt.cycle_statistics(cut, skip=0)
    assert (found.cycles, found.cut_cycles, sound.cycles, sound.cut_cycles) == (4, 2, 6, 0)
    kept = sound["power_by_cycle"][[0, 1, 4, 5]]
    np.testing.assert_allclose(found["power_by_cycle"], kept, rtol=1e-9)  # rounding
    assert found.mean_power == pytest.approx(float(kept.mean()), rel=1e-9)
    edge = pt.cycle_statistics(flight.isel(time=np.r_[0:201, 301:601]), skip=0)
    assert (edge.cycles, edge.cut_cycles) == (4, 2)  # a beat from 200 to 300 and a step of the next
    with pytest.raises(FlightError, match="a wingbeat without a gap in time, found 1"):
        pt.cycle_statistics(flight.isel(time=np.r_[0:50, 60:101]), skip=0)


@pytest.mark.parametrize(
    ("arguments", "problem", "words"),
    [
        ({"period": -1.0}, ParameterError, "period"),
        ({"period": 1e-320}, ParameterError, "more than the time between two samples"),
        ({"skip": 40}, FlightError, "41 wingbeats"),
        ({"phases": 1}, ParameterError, "points"),
    ],
)
def test_what_cannot_be_averaged_is_refused(
    held: xr.Dataset, arguments: dict[str, float], problem: type[Exception], words: str
) -> None:
    with pytest.raises(problem, match=words):
        pt.cycle_statistics(held, **arguments)  # type: ignore[arg-type]


def test_the_verb_writes_a_table_and_a_figure(
    held: xr.Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, table, figure = (tmp_path / name for name in ("f.nc", "beat.csv", "beat.svg"))
    pt.save_flight(held, path)
    with pytest.raises(SystemExit) as left:
        run(["cycles", str(path), "--table", str(table), "--figure", str(figure), "--json"])
    assert left.value.code == 0
    told = json.loads(capsys.readouterr().out)
    assert told["mean_lift"] == pytest.approx(pt.cycle_statistics(held).attrs["mean_lift"])
    head, *rows = table.read_text().splitlines()
    assert head.startswith("phase,lift,lift_spread") and len(rows) == 100
    assert figure.read_text().lstrip().startswith("<?xml")


def test_power_of_samples_that_are_missing_is_missing(held: xr.Dataset) -> None:
    """Not that of the joints that are left, nor none."""
    lost = held.assign(u1=held["u1"].where((held["time"] < 0.3) | (held["dof"] != "left_plunge")))
    found = pt.cycle_statistics(lost, skip=0)
    assert np.isnan(found.attrs["mean_power"]) and np.isnan(found["power_by_cycle"].values[2])
    assert (
        found["power_by_cycle"].values[0] == pt.cycle_statistics(held, skip=0)["power_by_cycle"][0]
    )


def test_wingbeats_of_a_steered_gait_are_as_long_as_they_were_steered() -> None:
    # All had the period that was commanded last: mean lift of a steady flight 5 % off.
    robot = replace(pt.load_robot("aerobat"), actuators={})
    aero = pt.QuasiSteady(robot, pt.Air(wind=(-4.0, 0.0, 0.0)))
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)
    held = {"mount": pt.mounts.fixed(), "time_step": 5e-4}

    def faster(time: float, state: object) -> dict[str, float]:
        return {"frequency": 5.0 if time < 1.0 else 6.0}

    flight = pt.simulate(robot, aero, gait, duration=2.0, controller=faster, **held)
    plunge = flight["q"].sel(dof="left_plunge").to_numpy()
    tops = [k for k in range(1, len(plunge) - 1) if plunge[k - 1] < plunge[k] >= plunge[k + 1]]
    passed = flight["wingbeats"].to_numpy()[tops]
    assert np.allclose(passed - passed[0], np.arange(len(tops)), atol=6e-3)  # to a sample
    cycles = pt.cycle_statistics(flight, skip=0)
    assert cycles.cycles == int(flight["wingbeats"][-1]) == 10
    slow = pt.cycle_statistics(pt.simulate(robot, aero, gait, duration=1.0, **held), skip=0)
    first = cycles["lift_by_cycle"][:5]
    assert np.allclose(first, slow["lift_by_cycle"], rtol=1e-9)
    assert flight_summary(flight)["frequency"] == pytest.approx(6.0, rel=0.02)
