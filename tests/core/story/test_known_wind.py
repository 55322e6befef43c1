"""Learning, import, measured forces and forecasts in a recorded wind that changes."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import patagium as pt
from patagium.errors import FlightError, LogError, ShapeError
from patagium.sensing.force.air_force import packet_columns

from ...spoken import Speak

GUST = pt.air.DrydenGust((0.6, 0.6, 0.6), (1.0, 1.0, 0.5), airspeed=4.0, seed=1)


def flown(gust: object, **given: object) -> xr.Dataset:
    """Flight of an Aerobat that is held, or that flies freely where options say so."""
    robot = pt.load_robot("aerobat")
    aero = pt.QuasiSteady(robot, pt.Air(wind=(-4.0, 0.0, 0.0), gust=gust))  # type: ignore[arg-type]
    gait = pt.gaits.sinusoidal(robot, frequency=8.0, plunge=0.6)
    options = {"duration": 0.6, "time_step": 1e-3, "mount": pt.mounts.fixed(), **given}
    return pt.simulate(robot, aero, gait, **options)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def gusty() -> xr.Dataset:
    return flown(GUST)


def worst(result: pt.learning.Identification) -> float:
    return float(result.scores["nmse_second_half_worst"])


def test_the_force_in_a_gust_is_learned_as_in_a_steady_wind(gusty: xr.Dataset) -> None:
    known = pt.identify(gusty)
    assert "as the flight has it" in known.scores["chosen"]["wind"]
    unknown = pt.identify(gusty.drop_vars("wind"))
    assert "its changes are errors" in unknown.scores["chosen"]["wind"]
    # the air has no memory, and the default network holds its polar: nothing is left
    assert worst(known) < 1e-6 < 1e-2 < worst(unknown)
    still = flown(None)
    assert worst(pt.evaluate(still, known.model)) < 1e-4
    assert worst(pt.evaluate(gusty, pt.identify(still).model)) < 1e-3


def test_numbers_of_a_model_are_estimated_in_a_known_gust(
    gusty: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, speak: Speak
) -> None:
    """The model holds the steady wind alone, without the gust at the first sample."""
    monkeypatch.chdir(tmp_path)
    pt.save_flight(gusty, "flight.nc")
    said = speak("identify", "flight.nc", "--estimate", "polar.lift_amplitude=0.5", "--json")
    scores = json.loads(said[1])
    assert scores["nmse_second_half_worst"] < 1e-12  # the model is the truth
    assert scores["chosen"]["wind"] == "as the flight has it at each sample"


def test_a_gust_that_travels_is_known_by_its_mean_over_the_wings() -> None:
    flight = flown(pt.air.TravelingGust(GUST, (-1.0, 0.0, 0.0), 4.0))
    assert worst(pt.identify(flight)) < 0.01 * worst(pt.identify(flight.drop_vars("wind")))


@pytest.fixture(scope="module")
def free() -> xr.Dataset:
    start = {"v": pt.load_robot("aerobat").velocities(x=4.0), "mount": pt.mounts.free()}
    gust = pt.air.OneMinusCosineGust((-1.0, 0.0, 1.0), 0.1, 0.8)
    return flown(gust, duration=1.0, **start)


def test_a_forecast_of_a_free_flight_holds_the_wind(free: xr.Dataset) -> None:
    errors = [
        pt.identify(one, horizons="20ms").scores["forecast_20ms_nmse_second_half_worst"]
        for one in (free, free.drop_vars("wind"))
    ]
    assert errors[0] < 0.1 * errors[1]  # the gust changes by a twentieth in 20 ms


def table_of(flight: xr.Dataset, path: Path) -> dict[str, object]:
    """Write a flight with its wind as text, and give the mapping of its columns."""
    columns, channels = {"t": flight["time"].values}, []
    for one in packet_columns(pt.load_robot("aerobat"))[1:]:
        part, _, name = one.name.partition(".")
        columns[one.name] = flight[part].sel(dof=name).values
        channels.append({"column": one.name, "unit": one.unit})
    down = [f"wind_{axis}" for axis in "ned"]
    for name, values, sign in zip(down, flight["wind"].values.T, (1, -1, -1), strict=True):
        columns[name] = sign * values
    pd.DataFrame(columns).to_csv(path, index=False)
    wind = {"column": down, "unit": "m/s", "frame": "ned", "name": "wind"}
    time = {"column": "t", "unit": "s"}
    return {"robot": "aerobat", "time": time, "channels": [*channels, wind]}


def test_a_log_with_the_wind_in_it_needs_no_other_word(
    free: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    mapping = table_of(free, Path("log.csv"))
    Path("map.yaml").write_text(json.dumps(mapping), "utf-8")
    told = pt.import_log("log.csv", "map.yaml", "log.nc").findings
    assert not [one for one in told if one.kind == "wind"]
    log = pt.load_log("log.nc")
    np.testing.assert_allclose(log["wind"], free["wind"], atol=1e-12)  # digits of the text
    assert worst(pt.identify(log)) < 1e-4 < 1e-2 < worst(pt.identify(log.drop_vars("wind")))
    mapping["channels"][-1] = {"column": "wind_n", "unit": "m/s", "name": "wind.x"}  # type: ignore[index]
    Path("map.yaml").write_text(json.dumps(mapping | {"air": {"wind": [0, 1, 2]}}), "utf-8")
    told = pt.import_log("log.csv", "map.yaml", "log.nc").findings
    assert not [one for one in told if one.kind == "wind"]
    one = pt.load_log("log.nc")["wind"].values
    np.testing.assert_allclose(one[:, 0], free["wind"].values[:, 0], atol=1e-12)
    assert np.array_equal(one[:, 1:], np.tile([1.0, 2.0], (len(one), 1)))
    names = [{"column": f"wind_{axis}", "unit": "m/s"} for axis in "ned"]
    mapping["channels"][-1:] = names  # type: ignore[index]
    Path("map.yaml").write_text(json.dumps(mapping), "utf-8")
    told = pt.import_log("log.csv", "map.yaml", "log.nc").findings
    assert any("needs `name: wind` (a vector, with `frame`)" in one.text for one in told)


def test_one_component_in_a_table_without_a_robot_is_a_column_as_any_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    time = 0.01 * np.arange(100)
    pd.DataFrame({"t": time, "fan": np.cos(time), "lift": time}).to_csv("log.csv", index=False)
    words = {
        "time": {"column": "t", "unit": "s"},
        "inputs": [{"column": "fan", "unit": "m/s", "name": "wind.x"}],
        "outputs": [{"column": "lift", "unit": "N"}],
    }
    Path("map.yaml").write_text(json.dumps(words), "utf-8")
    log = pt.load_log(pt.import_log("log.csv", "map.yaml", "log.nc").path)
    np.testing.assert_allclose(log["wind.x"], np.cos(time), atol=1e-12)  # digits of the text
    assert "wind" not in log


def test_a_wind_that_cannot_be_read_is_refused(gusty: xr.Dataset) -> None:
    lost = gusty.copy(deep=True)
    lost["wind"][40, 1] = np.nan
    with pytest.raises(LogError, match=r"wind: expected finite numbers.*t = 0\.04 s"):
        pt.identify(lost)
    lost["wind"] = gusty["wind"].assign_attrs(units="km/h")
    with pytest.raises(FlightError, match=r"wind: expected \[m/s\], found \[km/h\]"):
        pt.identify(lost)
    lost["wind"] = gusty["wind"].isel(axis=0)
    with pytest.raises(FlightError, match=r"wind: expected \(time, axis\) in m/s"):
        pt.identify(lost)


def test_the_force_does_not_depend_on_how_fast_the_base_moves(free: xr.Dataset) -> None:
    """Packets may have velocities relative to the wind, as `docs/stream.md` says."""
    moved = free.copy(deep=True)
    base = moved["v"].sel(dof=["x", "y", "z"])
    moved["v"].loc[{"dof": ["x", "y", "z"]}] = base - moved["wind"].values
    force, other = (pt.sensing.training_data(one)[2] for one in (free, moved))
    np.testing.assert_allclose(other, force, atol=1e-12 * np.abs(force).max())  # rounding


@pytest.mark.parametrize("inputs", [[], ["v.x", "q.pitch"]])
def test_inputs_that_the_network_does_not_have_are_refused(
    gusty: xr.Dataset, inputs: list[str]
) -> None:
    with pytest.raises(ShapeError, match="inputs: expected as many as the network sees, 42, found"):
        pt.identify(gusty, inputs=inputs)


def test_measured_forces_know_the_wind_of_their_log(gusty: xr.Dataset) -> None:
    robot = pt.load_robot("aerobat")
    time, x, y = pt.sensing.training_data(gusty)
    q, v = np.split(x, 2, axis=1)
    change = gusty["wind"].values - [-4.0, 0.0, 0.0]
    errors = {}
    for gust in (pt.air.RecordedGust(time, change), None):
        air = pt.Air(wind=(-4.0, 0.0, 0.0), gust=gust)
        spread = np.tile(1e-8 * np.eye(robot.dof), (len(time), 1, 1))
        a = gusty["a"].values
        forces = pt.sensing.ForceSamples(time, q, v, y, spread, robot, "a test", a, air)
        errors[gust is None] = worst(pt.identify(forces))
    assert errors[False] < 1e-4 < 1e-2 < errors[True]


def test_a_sensor_log_takes_the_wind_along() -> None:
    robot, time = pt.load_robot("aerobat"), 0.01 * np.arange(20)
    wind = np.column_stack([-4 + np.sin(time), np.cos(time), 0 * time])
    log = xr.Dataset(
        {
            "wind": (("time", "axis"), wind, {"units": "m/s"}),
            "q.left_plunge": ("time", np.sin(time), {"units": "rad"}),
        },
        coords={"time": time},
        attrs={"air": json.dumps({"wind": [-4.0, 0.0, 0.0]})},
    )
    air = pt.sensor_log(log, robot).air
    np.testing.assert_allclose(air.wind_at(time), wind, atol=1e-15)  # rounding
    assert pt.sensor_log(log.drop_vars("wind"), robot).air.gust is None


def test_a_robot_that_nothing_moves_through_the_air_is_told_so(
    one_wing: Callable[..., pt.Robot],
) -> None:
    """The wind of its log was left out without a word."""
    robot, time = one_wing("name: flap, axis: x"), 0.01 * np.arange(300)
    wind = np.column_stack([-4 + np.sin(time), 0 * time, 0 * time])
    flap = np.sin(9 * time)
    log = xr.Dataset(
        {
            "wind": (("time", "axis"), wind, {"units": "m/s"}),
            "q.flap": ("time", flap, {"units": "rad"}),
        },
        coords={"time": time},
        attrs={"air": json.dumps({"wind": [-4.0, 0.0, 0.0]})},
    )
    air = pt.sensor_log(log, robot).air
    np.testing.assert_allclose(air.wind_at(time), wind, atol=1e-15)  # rounding
    columns = [one[:, None] for one in (flap, 9 * np.cos(9 * time), flap)]
    spread, a = np.tile(1e-8 * np.eye(1), (300, 1, 1)), -81 * flap[:, None]
    forces = pt.sensing.ForceSamples(time, *columns, spread, robot, "a test", a, air)
    told = pt.identify(forces).scores["chosen"]["wind"]
    assert "its changes are errors of the network, because no body of one_wing is floating" in told


def test_a_model_does_not_hold_the_wind_of_the_log_it_learned() -> None:
    """Model files grew with their log, by all of its wind."""
    air = pt.Air(wind=(-4.0, 0.0, 0.0), gust=pt.air.RecordedGust([0.0, 1.0], np.ones((2, 3))))
    robot = pt.load_robot("aerobat")
    for network in (pt.learning.LinearStripNetwork(robot, air), pt.StripNetwork(robot, air=air)):
        assert network.describe()["air"] == pt.Air(wind=(-4.0, 0.0, 0.0)).describe()
    blades = pt.QuasiSteady(robot, air)
    carried = pt.air.AddedMass(robot, air)
    for model in (blades, pt.air.Inflow(blades)):
        grey = pt.GreyBox(model, {"polar.lift_amplitude": 0.5}, carried)
        assert grey.model.air == grey.added_mass.air == pt.Air(wind=(-4.0, 0.0, 0.0))
