"""Flights in other tools: what is written is read back by the readers of these tools."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from mcap.reader import make_reader

import patagium as pt
from patagium.cli.main import run
from patagium.errors import LogError, ParameterError
from patagium.sensing.logs.files.message_files import getter
from patagium.sensing.logs.importing.inspection import inspect_log
from patagium.viewer.export import body_frames, export, topics_of


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    robot = pt.load_robot("aerobat")
    gait, aero = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6), pt.QuasiSteady(robot)
    start = robot.coordinates(x=3.0)
    return pt.simulate(robot, aero, gait, duration=0.1, time_step=1e-3, v=start)


def read(path: Path) -> tuple[dict[str, list[tuple[int, dict]]], dict[str, dict], dict[str, str]]:
    """Messages and schemas by topic, and the metadata."""
    messages: dict[str, list[tuple[int, dict]]] = {}
    schemas = {}
    with path.open("rb") as file:
        reader = make_reader(file)
        about = {k: v for one in reader.iter_metadata() for k, v in one.metadata.items()}
        for schema, channel, message in reader.iter_messages():
            assert schema.encoding == "jsonschema" and channel.message_encoding == "json"
            schemas[channel.topic] = json.loads(schema.data)
            row = message.log_time, json.loads(message.data)
            messages.setdefault(channel.topic, []).append(row)
    return messages, schemas, about


def test_a_flight_is_read_back_as_it_was(flight: xr.Dataset, tmp_path: Path) -> None:
    record = flight.copy()
    record["u1"] = record["u1"].copy()
    record["u1"][3, 6] = np.nan
    messages, schemas, about = read(export(record, tmp_path / "flight.mcap"))
    assert about["robot"] == flight.attrs["robot"]
    for name in ("q", "v", "aero_force"):
        names = [str(one) for one in flight["dof"].values]
        rows = [[row[key] for key in names] for _, row in messages[f"/{name}"]]
        np.testing.assert_allclose(rows, flight[name], rtol=1e-11, atol=1e-12)  # 12 digits
        assert list(schemas[f"/{name}"]["properties"]) == names
    seconds = np.array([time for time, _ in messages["/q"]]) * 1e-9
    np.testing.assert_allclose(seconds, flight["time"], atol=1e-9)
    assert messages["/u1"][3][1]["left_plunge"] is None  # JSON has no nan
    strip = flight["strip_force"].isel(time=50, strip=3).values
    label = str(flight["strip"].values[3]) if "strip" in flight.coords else "3"
    said = messages["/strip_force"][50][1]
    np.testing.assert_allclose([said[f"{label}/{axis}"] for axis in "xyz"], strip, rtol=1e-11)
    units = {name: schemas[f"/{name}"]["properties"] for name in ("q", "v", "aero_force")}
    for name, (slides, turns) in {"q": ("m", "rad"), "aero_force": ("N", "N m")}.items():
        assert units[name]["x"]["description"] == slides
        assert units[name]["roll"]["description"] == turns
    assert units["v"]["roll"]["description"] == "rad/s"
    wrench = [one["description"] for one in schemas["/mount_wrench"]["properties"].values()]
    assert wrench == ["N"] * 3 + ["N m"] * 3
    frame = messages["/tf"][50][1]["transforms"][0]
    place, turn = body_frames(flight)["body"]
    assert frame["child_frame_id"] == "body"
    np.testing.assert_allclose([frame["translation"][k] for k in "xyz"], place[50])
    np.testing.assert_allclose([frame["rotation"][k] for k in "xyzw"], turn[50])


def test_a_clock_that_was_reset_is_refused(flight: xr.Dataset, tmp_path: Path) -> None:
    late = flight.isel(time=[0, 2, 1, *range(3, 50)])
    assert len(read(export(late, tmp_path / "late.mcap"))[0]["/q"]) == 50
    first = flight.assign_coords(time=flight["time"] + 100.0)
    both = xr.concat([first, flight], "time")
    with pytest.raises(LogError, match=f"clock reset by .* cut it at sample {len(first.time)}"):
        export(both, tmp_path / "both.mcap")
    assert not (tmp_path / "both.mcap").exists()


def test_times_without_motion_have_no_frames(flight: xr.Dataset, tmp_path: Path) -> None:
    """One missing coordinate ended in a LinAlgError."""
    record, lost = flight.copy(deep=True), [3, 4, 50]
    record["q"][lost, 6] = [np.nan, np.inf, np.nan]
    messages, _, _ = read(export(record, tmp_path / "holes.mcap"))
    assert [k for k, (_, row) in enumerate(messages["/q"]) if row["left_plunge"] is None] == lost
    frames = {time: row for time, row in messages["/tf"]}
    kept = [one for k, one in enumerate(messages["/q"]) if k not in lost]
    assert list(frames) == [time for time, _ in kept]
    for time, row in kept:
        place = frames[time]["transforms"][0]["translation"]
        assert place["x"] == pytest.approx(row["x"], abs=1e-11)  # 12 digits
    record["q"][:] = np.nan
    assert "/tf" not in read(export(record, tmp_path / "none.mcap"))[0]


def test_what_has_times_of_its_own_goes_along(flight: xr.Dataset, tmp_path: Path) -> None:
    """What a controller knew and wanted was left out without a word."""
    robot = pt.load_robot("aerobat")
    states = [*robot.coordinate_names, *(f"velocity of {name}" for name in robot.dof_names)]
    time, wanted = np.array([-0.01, 0.015, 0.05]), np.arange(3.0 * len(states)).reshape(3, -1)
    dims, units = ("control_time", "state"), {"units": "m, rad, 1 or per s"}  # as of `fly`
    record = flight.assign_coords(control_time=time, state=states)
    record["reference"] = (dims, wanted, units)
    messages, schemas, _ = read(export(record, tmp_path / "loop.mcap"))
    stamps = [stamp for stamp, _ in messages["/reference"]]
    assert stamps == [0, 25_000_000, 60_000_000] and messages["/q"][0][0] == 10_000_000
    np.testing.assert_array_equal([[*row.values()] for _, row in messages["/reference"]], wanted)
    told = {k: one["description"] for k, one in schemas["/reference"]["properties"].items()}
    assert list(told) == states
    assert told["x"] == "m" and told["left_plunge"] == "rad" and told["velocity of x"] == "m/s"
    with (tmp_path / "loop.mcap").open("rb") as file:
        order = [
            one.log_time for _, _, one in make_reader(file).iter_messages(log_time_order=False)
        ]
    assert order == sorted(order)


def test_dimensions_in_another_order_lose_nothing(flight: xr.Dataset, tmp_path: Path) -> None:
    """Coordinates and forces were left out, and frames of as many samples as coordinates wrong."""
    record = flight.isel(time=slice(0, flight.sizes["dof"]))
    straight = read(export(record, tmp_path / "straight.mcap"))
    turned = record.transpose("dof", "time", ...)
    assert read(export(turned, tmp_path / "turned.mcap"))[:2] == straight[:2]


def test_names_with_a_percent_sign_stay(tmp_path: Path) -> None:
    """A name with %s differed between the messages and their schema."""
    values = ("time", "output"), [[1.0, 2.0], [np.nan, 3.0]]
    coords = {"time": [0.0, 1.0], "output": ["lift %span", "%d"], "unit": ("output", ["N", "m"])}
    record = xr.Dataset({"prediction": values}, coords)
    messages, schemas, _ = read(export(record, tmp_path / "named.mcap"))
    assert messages["/prediction"][0][1] == {"lift %span": 1.0, "%d": 2.0}
    assert messages["/prediction"][1][1] == {"lift %span": None, "%d": 3.0}
    told = {k: one["description"] for k, one in schemas["/prediction"]["properties"].items()}
    assert told == {"lift %span": "N", "%d": "m"}  # units of predictions were empty


def test_predictions_go_with_it(flight: xr.Dataset, tmp_path: Path) -> None:
    pt.save_flight(flight, tmp_path / "flight.nc")
    result = pt.identify(flight)
    pt.learning.save_model(tmp_path / "model.json", result.learner)
    words = ["export", str(tmp_path / "flight.nc"), "-o", str(tmp_path / "flight.mcap")]
    with pytest.raises(SystemExit) as left:
        run([*words, "--model", str(tmp_path / "model.json")])
    assert left.value.code == 0
    messages, _, _ = read(tmp_path / "flight.mcap")
    assert set(messages["/prediction"][0][1]) == set(flight["dof"].values)
    said = [row["z"] for _, row in messages["/prediction"]]
    seen = [row["z"] for _, row in messages["/measurement"]]
    assert np.var(np.subtract(said, seen)) < 0.1 * np.var(seen)  # learned, from 100 samples
    alone, _, _ = read(export(result.prediction, tmp_path / "alone.mcap"))
    assert len(alone["/prediction"]) == len(flight["time"]) and "/tf" not in alone


def test_what_cannot_be_written_is_told(
    flight: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ParameterError, match="a file of the kind .mcap or .rrd"):
        export(flight, tmp_path / "flight.bag")
    with pytest.raises(LogError, match="quantities over time, found none"):
        export(xr.Dataset({"time": [0.0]}), tmp_path / "flight.mcap")
    with pytest.raises(LogError, match="expected samples, found none"):
        export(flight.isel(time=slice(0, 0)), tmp_path / "flight.mcap")
    timeless = flight.assign_coords(time=flight["time"].where(flight["time"] > 0))
    with pytest.raises(LogError, match="expected times, found nan"):
        export(timeless, tmp_path / "flight.mcap")
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    with pytest.raises(ParameterError, match=r"rerun: pip install 'patagium\[rerun\]'"):
        export(flight, tmp_path / "flight.rrd")
    assert not list(tmp_path.iterdir())


def test_what_is_exported_is_read_with_all_its_rows(flight: xr.Dataset, tmp_path: Path) -> None:
    """Keys that hold dots, as of a covariance, made no row, and no word was said."""
    covariance = xr.DataArray(np.ones((len(flight["time"]), 2)), dims=("time", "pair"))
    pairs = flight.assign(covariance=covariance).assign_coords(pair=["q.x/q.x", "q.x/q.z"])
    path = tmp_path / "pairs.mcap"
    get = getter("data.q.x/q.z")
    assert get({"data": {"q.x/q.z": 2.0}}) == 2.0 and get({"data": {"q": {"x/q.z": 3.0}}}) == 3.0
    with pytest.raises(KeyError):
        get({"data": {"q.x/q.y": 1.0}})
    topics = {one.name: one.rows for one in inspect_log(export(pairs, path)).topics}
    assert topics["/covariance"] == len(flight["time"])


def test_states_of_the_air_have_their_names_and_units() -> None:
    """States of the air were all said to have the unit 1."""
    robot = pt.load_robot("aerobat")
    for aero, units in (
        (pt.DeLaurier(robot), "m/s"),
        (pt.air.Inflow(pt.DeLaurier(robot)), "m/s or 1"),
        (pt.LiftingLine(robot, stall_delay=pt.air.StallDelay()), "m/s or 1"),
    ):
        flight = pt.simulate(robot, aero, duration=0.002, time_step=1e-3)
        assert flight["aero_state"].attrs["units"] == units
        topic = next(one for one in topics_of(flight) if one.name == "aero_state")
        assert topic.labels == aero.state_names and topic.units == aero.state_units
    assert topic.units[-20:] == ("1",) * 20 and topic.units[-21] == "m/s"  # ten strips


def test_rerun_is_given_every_number_with_its_name(
    flight: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stand-in that keeps what it is given: the package has 500 MB and is not in the lock."""
    sent: dict = {}
    logged: dict = {}

    class Recording:
        def __init__(self, name: str) -> None:
            assert name == "patagium"

        def save(self, path: Path) -> None:
            path.write_bytes(b"RRF2")

        def log(self, name: str, what: object, static: bool) -> None:
            assert static
            logged[name] = what

        def send_columns(self, name: str, indexes: list, columns: object) -> None:
            sent[name] = indexes[0], columns

        def flush(self) -> None: ...

        def disconnect(self) -> None: ...

    keep = SimpleNamespace(columns=lambda **given: given)
    library = SimpleNamespace(
        RecordingStream=Recording,
        TimeColumn=lambda name, duration: np.asarray(duration),
        SeriesLines=lambda names: names,
        Scalars=keep,
        Transform3D=keep,
        TransformAxes3D=lambda length: length,
    )
    monkeypatch.setitem(__import__("sys").modules, "rerun", library)
    export(flight, tmp_path / "flight.rrd")
    time, given = sent["v"]
    np.testing.assert_array_equal(time, flight["time"])
    np.testing.assert_array_equal(given["scalars"], flight["v"])
    names = flight["dof"].values
    assert [word.split(" [")[0] for word in logged["v"]] == list(names)
    assert logged["v"][:1] + logged["v"][3:4] == ["x [m/s]", "roll [rad/s]"]
    origins, axes = body_frames(flight)["body"]
    np.testing.assert_array_equal(sent["world/body"][1]["translation"], origins)
    np.testing.assert_array_equal(sent["world/body"][1]["quaternion"], axes)


def test_rerun_takes_it_where_it_is_installed(flight: xr.Dataset, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    path = export(flight, tmp_path / "flight.rrd")
    assert path.stat().st_size > 10_000 and path.read_bytes()[:3] == b"RRF"
