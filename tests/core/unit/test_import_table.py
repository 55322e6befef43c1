"""Tables of other programs: CSV, Parquet, MAT, and what is wrong with their stamps and units."""

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import patagium as pt
from patagium.errors import FlightError, LogError, OutputError, ParameterError
from patagium.sensing import read_table
from patagium.sensing.logs.files import opening
from patagium.sensing.logs.files.channels import Request, StampSource
from patagium.sensing.logs.files.opening import open_log
from patagium.sensing.logs.files.table_files import CsvFile
from patagium.sensing.logs.importing.import_log import Imported, import_log
from patagium.sensing.logs.importing.inspection import inspect_log
from patagium.sensing.logs.mapping import parse_mapping
from patagium.sensing.logs.record import LogRecord, is_log
from patagium.sensing.motion.encoder_faults import dropped_out, jumps_of

from ...spoken import Speak

WORDS: dict[str, Any] = {
    "time": {"column": "t", "unit": "ms"},
    "inputs": [
        {"column": ["gx", "gy", "gz"], "unit": "deg/s", "frame": "frd", "name": "rate",
         "range": [-100, 200]},
        {"column": "throttle", "unit": "1", "range": [0, 1000], "offset": 100},
    ],
    "outputs": [{"column": "fz", "unit": "g_0", "name": "lift", "range": [0, 2]}],
}  # fmt: skip


def frame(count: int = 300, **changes: Any) -> pd.DataFrame:
    k = np.arange(count)
    columns = {
        "t": 1000.0 + 2.0 * k,
        "gx": 10.0 * np.sin(0.05 * k),
        "gy": 5.0 + k * 0.01,
        "gz": -3.0 + np.cos(0.1 * k),
        "throttle": 200 + k,
        "fz": 1.0 + 0.1 * np.sin(0.2 * k),
    }
    return pd.DataFrame({**columns, **changes})


def written(folder: Path, table: pd.DataFrame, kind: str = "csv") -> Path:
    path = folder / f"log.{kind}"
    if kind == "csv":
        table.to_csv(path, index=False)
    elif kind == "csv.gz":
        table.to_csv(path, index=False, compression="gzip")
    elif kind == "parquet":
        pytest.importorskip("pyarrow", reason="Parquet needs the extra patagium[logs]")
        table.to_parquet(path)
    else:
        from scipy.io import savemat

        savemat(path, {name: table[name].to_numpy() for name in table})
    return path


def brought(path: Path, words: dict[str, Any] = WORDS) -> Imported:
    return import_log(path, parse_mapping(words), path.parent / "out.nc")


def kinds(found: Imported) -> set[str]:
    return {one.kind for one in found.findings if one.level == "warning"}


@pytest.mark.parametrize("kind", ["csv", "csv.gz", "parquet", "mat"])
def test_each_kind_of_table_gives_the_same_log(kind: str, tmp_path: Path) -> None:
    table = frame()
    found = brought(written(tmp_path, table, kind))
    assert found.samples == 300 and is_log(found.path) and kinds(found) == set()
    with LogRecord(found.path) as record:
        log = record.table()
    np.testing.assert_allclose(log.time, 2e-3 * np.arange(300), atol=1e-12)
    rates = np.radians(np.column_stack([table["gx"], -table["gy"], -table["gz"]]))
    np.testing.assert_allclose(log.x[:, :3], rates, rtol=1e-12)
    np.testing.assert_allclose(log.y[:, 0], 9.80665 * table["fz"], rtol=1e-12)
    assert log.input_names == ("rate.x", "rate.y", "rate.z", "throttle")
    assert log.input_units == ("rad/s",) * 3 + ("1",) and log.output_units == ("m/s^2",)
    # a turned axis swaps the ends of its range
    np.testing.assert_allclose(np.degrees(log.input_range[1]), [-200, 100])
    np.testing.assert_allclose(log.input_range[3], [-100, 900])


def test_a_mapping_of_old_gives_what_it_gave(tmp_path: Path) -> None:
    words = {
        "time": {"column": "t", "unit": "ms"},
        "inputs": [{"column": "throttle", "unit": "1"}],
        "outputs": [{"column": "fz", "unit": "g_0"}],
    }
    path = written(tmp_path, frame())
    with LogRecord(brought(path, words).path) as record:
        ours = record.table()
    table = read_table(path, parse_mapping(words))
    np.testing.assert_allclose(ours.time, table.time, atol=1e-9)
    np.testing.assert_array_equal(ours.x, table.x)
    np.testing.assert_array_equal(ours.y, table.y)
    assert ours.output_units == table.output_units and ours.input_names == table.input_names


def test_a_table_is_read_through_any_mapping(tmp_path: Path) -> None:
    path, told = written(tmp_path, frame()), []
    table = read_table(path, parse_mapping(WORDS), told.append)
    assert table.x.shape == (300, 4) and len(told) == 1


def test_an_imported_log_is_a_table_without_its_mapping(tmp_path: Path) -> None:
    path = written(tmp_path, frame())
    found, direct = brought(path).path, read_table(path, parse_mapping(WORDS))
    table = read_table(found)
    np.testing.assert_array_equal(table.y, direct.y)
    assert table.input_names == direct.input_names and table.source == str(found)
    with pytest.raises(ParameterError, match="mapping"):
        read_table(path)
    with pytest.raises(LogError, match=r"none.csv: .*no such file"):
        read_table(tmp_path / "none.csv")
    with pytest.raises(FlightError, match="read_table"):
        pt.identify(pt.load_log(found))


def test_bad_stamps_are_told_and_left_out(tmp_path: Path) -> None:
    stamps = frame()["t"].to_numpy().copy()
    stamps[50] = stamps[49]
    stamps[80] -= 30.0
    stamps[100:] += 500.0
    stamps[120] = stamps[119] + 0.05
    stamps[200] = np.nan
    found = brought(written(tmp_path, frame(t=stamps)))
    assert kinds(found) == {
        "duplicate stamps", "backward stamps", "near-duplicate stamps", "gap", "missing stamps",
    }  # fmt: skip
    assert found.samples == 297
    texts = {one.kind: one.text for one in found.findings}
    assert texts["gap"].startswith("1 step(s)") and "0.502 s" in texts["gap"]
    assert "by up to 0.028 s" in texts["backward stamps"]
    with LogRecord(found.path) as record:
        assert len(record.table().gaps) == 1


def test_a_rate_makes_an_even_time_base_and_bridges_no_gap(tmp_path: Path) -> None:
    stamps = frame()["t"].to_numpy().copy()
    stamps[100:] += 50.0
    words = {**WORDS, "time": {**WORDS["time"], "rate": 1000, "start": 0.01, "end": 0.4}}
    found = brought(written(tmp_path, frame(t=stamps)), words)
    with LogRecord(found.path) as record:
        log = record.table()
    steps = np.diff(log.time)
    assert found.left_out == 51 and log.time[-1] == pytest.approx(0.39)
    assert sorted(set(np.round(steps, 9))) == [0.001, 0.052]
    source = np.interp(log.time + 0.01, (stamps - stamps[0]) * 1e-3, 100.0 + np.arange(300))
    np.testing.assert_allclose(log.x[:, 3], source, atol=1e-9)


def test_a_stamp_years_away_costs_no_time_in_its_gap(tmp_path: Path) -> None:
    stamps = frame()["t"].to_numpy().copy()
    stamps[100:] += 1e11  # ms; at 1 kHz a gap of 10^11 samples
    words = {**WORDS, "time": {**WORDS["time"], "rate": 1000}}
    told: list[tuple[int, int]] = []
    path = written(tmp_path, frame(t=stamps))
    found = import_log(
        path, parse_mapping(words), tmp_path / "log.nc", progress=lambda *one: told.append(one)
    )
    assert found.samples == 2 * 300 - 2 and len(told) < 20  # 2 kHz bridges 2 ms in each half
    with LogRecord(found.path) as record:
        time = record.table().time
    assert np.diff(time).max() == pytest.approx(1e8 + 0.002, abs=1e-6)  # s
    assert np.sort(np.diff(time))[-2] == pytest.approx(0.001, abs=1e-6)


def test_angles_go_the_short_way_round(tmp_path: Path) -> None:
    heading = (170.0 + np.arange(300)) % 360.0
    heading = np.where(heading > 180, heading - 360, heading)
    words = {
        "time": {"column": "t", "unit": "ms", "rate": "1 kHz"},
        "channels": [{"column": "h", "unit": "deg", "name": "heading"}],
    }
    found = brought(written(tmp_path, frame(h=heading)), words)
    with LogRecord(found.path) as record:
        turned = record.values(("heading",))[:, 0]
    assert np.abs(np.diff(turned) - np.radians(0.5)).max() < 1e-9


def test_missing_numbers_are_told_and_left_out(tmp_path: Path) -> None:
    lift = frame()["fz"].to_numpy().copy()
    lift[[20, 21, 90]] = np.nan
    found = brought(written(tmp_path, frame(fz=lift)))
    assert kinds(found) == {"missing numbers"} and found.samples == 297
    with pytest.raises(LogError, match="lift: expected finite numbers, found none"):
        brought(written(tmp_path, frame(fz=np.full(300, np.nan))))


@pytest.mark.parametrize("rate", [{}, {"rate": "500 Hz"}])
def test_an_output_that_is_missing_costs_the_others_nothing(
    rate: dict[str, str], tmp_path: Path
) -> None:
    table = frame(drag=np.sin(0.1 * np.arange(300)))
    table.loc[20:29, "fz"] = np.nan  # drag alone is known
    table.loc[40, ["fz", "drag"]] = np.nan  # nothing to learn
    table.loc[60, "gy"] = np.nan  # no input
    drag = {"column": "drag", "unit": "N"}
    words = {**WORDS, "time": WORDS["time"] | rate, "outputs": [*WORDS["outputs"], drag]}
    found = brought(written(tmp_path, table), words)
    assert found.samples == 298 and found.left_out == 2
    with LogRecord(found.path) as record:
        log = record.table()
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(log.y[:, 0])), np.arange(20, 30))
    np.testing.assert_allclose(log.y[:, 1], table["drag"].drop([40, 60]))
    assert np.isfinite(log.x).all()


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("", []),
        ("-999", ["-999 stands 31 time(s), far from all other"]),
        ("-999 deg", ["-999 stands 4 time(s), far from all other"]),
        ("clipped", ["at the end of its numbers, -0.1:", "at the end of its numbers, 0.1:"]),
        ("held", ["change every 10 samples"]),
        ("counts", []),
    ],
)
def test_numbers_that_a_recorder_made_are_asked_for(
    tmp_path: Path, fault: str, words: list[str]
) -> None:
    """A mark of missing forces was learned (NMSE 1.0), as were clipped and held ones, silently."""
    time, rng = 0.01 * np.arange(1200), np.random.default_rng(5)
    lift = 0.3 * np.sin(4 * np.pi * time) * (1 + 0.2 * np.sin(0.5 * time))
    lift += 1e-3 * rng.normal(size=1200)
    if fault == "-999":
        lift[300:331] = -999.0
    elif fault == "clipped":
        lift = np.clip(lift, -0.1, 0.1)
    elif fault == "held":
        lift = lift[np.arange(1200) // 10 * 10]
    elif fault == "counts":
        lift = 0.005 * np.round(lift / 0.005)
    angle, turned = np.sin(4 * np.pi * time), "deg" if "deg" in fault else "rad"
    if turned == "deg":  # unwrapped first, it was 81
        angle = np.where(np.isin(np.arange(1200), [100, 300, 301, 555]), -999.0, 90 * angle)
    columns = np.column_stack([time, angle, lift])
    path, mapping = tmp_path / "log.csv", tmp_path / "map.yaml"
    header = f"t [s],angle [{turned}],lift [N]"
    np.savetxt(path, columns, delimiter=",", header=header, comments="")
    mapping.write_text(
        f"about: x\ntime: {{column: t, unit: s}}\ninputs: [{{column: angle, unit: {turned}}}]\n"
        "outputs: [{column: lift, unit: N}]\n"
    )
    found = [one.text for one in pt.import_log(path, mapping, tmp_path / "log.nc").findings]
    assert len(found) == len(words), found
    assert all(word in text for word, text in zip(words, found, strict=True)), found
    told = inspect_log(path).findings  # before a mapping
    assert [one.text for one in told] == found and {one.level for one in told} <= {"note"}


@pytest.mark.parametrize("most", [39.2, None])
def test_an_inertial_unit_that_clips_is_told(tmp_path: Path, most: float | None) -> None:
    """Clipped specific forces made forces that no interval held, and nothing was told."""
    time, rng = 0.002 * np.arange(2000), np.random.default_rng(3)
    force = np.array([0.0, 0.0, 9.81]) + 40 * np.sin(30 * time)[:, None] * np.array([0.5, 0, 1])
    rows = force + 0.05 * rng.normal(size=force.shape)
    rows = rows if most is None else np.clip(rows, -most, most)
    path, mapping = tmp_path / "log.csv", tmp_path / "map.yaml"
    header = "t [s],acc_x [m/s^2],acc_y [m/s^2],acc_z [m/s^2]"
    columns = np.column_stack([time, rows])
    np.savetxt(path, columns, delimiter=",", header=header, comments="")
    mapping.write_text(
        "about: x\ntime: {column: t, unit: s}\noutputs: [{name: m, column: acc_x, unit: m/s^2}]\n"
        "inputs: [{name: imu.specific_force, column: [acc_x, acc_y, acc_z], unit: m/s^2,"
        " frame: flu}]\n"
    )
    told = [one.where for one in pt.import_log(path, mapping, tmp_path / "log.nc").findings
            if one.kind == "clipped"]  # fmt: skip
    assert set(told) == ({"imu.specific_force"} if most else set())
    seen = [one.where for one in inspect_log(path).findings if one.kind == "clipped"]
    assert set(seen) == ({"acc_z [m/s^2]"} if most else set())


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("", ""),
        ("lost", ""),
        ("wraps", ""),
        ("steps", ""),
        ("reset", "jumps 1 time(s), such as from"),
        ("dropouts", "time(s), such as from 0 to 0.59"),
        ("brief", "jumps 8 time(s), such as from"),
        ("held", "change every 10 samples"),
        ("stop", ""),
        ("stuck", "1 time(s), such as"),
        ("end", "at the end of its numbers, 0.4:"),
    ],
)
def test_an_encoder_that_jumps_or_holds_is_told(tmp_path: Path, fault: str, words: str) -> None:
    """Jumps of an encoder, by a counter reset or a lost signal, are not motion of the joint."""
    time, rng = 0.002 * np.arange(3000), np.random.default_rng(2)
    angle = 0.6 * np.sin(6 * np.pi * time) / (1 + np.exp(8 - 8 * time))
    truth = angle
    angle = angle + 3e-4 * rng.normal(size=3000)
    kept = np.ones(3000, bool)
    if fault == "lost":
        kept[2000:2080] = False
    elif fault == "wraps":
        angle %= 2 * np.pi
    elif fault == "steps":  # positions of a polar, held in turn
        angle = 0.02 * (np.arange(3000) // 50) + 3e-4 * rng.normal(size=3000)
    elif fault == "reset":
        angle[1500:] += 0.5
    elif fault == "dropouts":
        angle[600::60] = 0.0
    elif fault == "brief":  # of 3, 6, 10 and 40 samples, whose steps back hid those away
        for begin, count in ((910, 3), (1320, 6), (1630, 10), (2100, 40)):
            angle[begin : begin + count] = -1.5
    elif fault == "held":
        angle = angle[np.arange(3000) // 10 * 10]
    elif fault == "stuck":
        angle[1500:1590] = angle[1500]
    elif fault == "stop":  # it is slow before it stands
        angle = 4e-3 * np.round(0.5 * np.tanh(3 * angle) / 4e-3)
    elif fault == "end":
        angle = np.minimum(angle, 0.4)
    path, mapping = tmp_path / "log.csv", tmp_path / "map.yaml"
    columns = np.column_stack([time, angle])[kept]
    np.savetxt(path, columns, delimiter=",", header="t [s],turn [rad]", comments="")
    (tmp_path / "arm.yaml").write_text(
        "{name: arm, gravity: 0, bodies: {arm: {parent: world, joints: [{name: turn, axis: x}], "
        "mass: 1, shape: {type: box, size: [0.1, 0.1, 0.1]}}}}"
    )
    mapping.write_text(
        f"about: x\nrobot: {tmp_path / 'arm.yaml'}\ntime: {{column: t, unit: s}}\n"
        "channels: [{column: turn, unit: rad, name: q.turn}]\n"
    )
    told = pt.import_log(path, mapping, tmp_path / "log.nc").findings
    found = [one.text for one in told if one.kind in ("jump", "held", "clipped")]
    assert bool(found) == bool(words) and all(words in one for one in found), found
    if fault in ("", "dropouts", "brief"):
        motion = pt.estimate_motion(pt.sensor_log(tmp_path / "log.nc"))
        known = motion.known.values
        wrong = motion.q.values[known, 0] - np.interp(motion.time[known], time, truth)
        assert known.all() and np.abs(wrong).max() < (2e-2 if fault == "brief" else 1e-3)
        std = np.sqrt(motion.covariance.values[known, 0, 0])
        assert np.abs(wrong / std).max() < 6  # of white noise of 3e-4
        assert ("jumps and jumps back" in motion.findings) == bool(fault)


def test_clean_motion_of_any_shape_does_not_jump(rng: np.random.Generator) -> None:
    """Steps at the ends of a log were taken for jumps, of noise and of joints that stop."""
    for k in range(400):
        beat, count = rng.uniform(5, 100), int(rng.integers(300, 900))
        wave = 2 * np.pi * (np.arange(count) / beat + rng.random())
        angle = np.sin(wave) + rng.uniform(0, 0.5) * np.sin(2 * wave + 6 * rng.random())
        shapes = angle, np.arcsin(np.sin(wave)), np.clip(angle, -0.3, 0.6), np.tanh(4 * angle)
        angle = shapes[k % 4]
        angle = angle + rng.choice([0.0, 3e-3]) * rng.standard_normal(count)
        step = rng.choice([1e-9, 1e-3, 0.05])
        angle = step * np.round(angle / step)
        assert not len(jumps_of(angle)[0]) and not dropped_out(angle).any(), (k, beat, step)


@pytest.mark.parametrize(
    ("speeds", "stated", "words"),
    [((5, 5), 5, ""), ((5, 5), 0, "is 5 m/s in the mean"), ((4, 7), 5, "changes by 1.5 m/s")],
)
def test_a_wind_that_is_not_the_stated_one_is_told(
    tmp_path: Path, speeds: tuple[float, float], stated: float, words: str
) -> None:
    """One wind is taken for all of a flight; the tunnel's own column contradicted it silently."""
    time, rng = 0.002 * np.arange(2000), np.random.default_rng(1)
    tunnel = np.repeat(speeds, 1000) + 0.1 * rng.normal(size=2000)
    path, mapping = tmp_path / "log.csv", tmp_path / "map.yaml"
    table = pd.DataFrame({"t": time, "turn": np.sin(9 * time), "tunnel": tunnel})
    table.to_csv(path, index=False)
    mapping.write_text(
        f"robot: aerobat\ntime: {{column: t, unit: s}}\nair: {{wind: [-{stated}, 0, 0]}}\n"
        "channels:\n  - {column: turn, unit: rad, name: q.left_plunge}\n"
        "  - {column: tunnel, unit: m/s}\n"
    )
    told = pt.import_log(path, mapping, tmp_path / "log.nc").findings
    found = [one.text for one in told if one.kind == "wind"]
    assert len(found) == bool(words) and all(words in one for one in found), found


@pytest.mark.parametrize("layout", ["synchronised", "events", "same stamps"])
def test_columns_filled_in_turn_have_samples_of_their_own(tmp_path: Path, layout: str) -> None:
    """Rows of another sensor were missing numbers, so that nine samples of ten or all were lost."""
    steps = {"theta": 1e-3, "lift": 2e-3, "z": 1e-2}
    late = 0.7e-3 if layout == "events" else 0.0
    parts = [
        pd.DataFrame({"__time": (t := np.arange(0, 2, step) + k * late / 2), name: np.sin(9 * t)})
        for k, (name, step) in enumerate(steps.items())
    ]
    table = pd.concat(parts).sort_values("__time", kind="stable")
    if layout == "synchronised":
        table = table.groupby("__time", as_index=False).first()
    path = written(tmp_path, table)
    inputs = [{"column": name, "unit": "rad"} for name in ("theta", "z")]
    outputs = [{"column": "lift", "unit": "N"}]
    time = {"column": "__time", "unit": "s"}
    words = {"time": time, "inputs": inputs, "outputs": outputs}
    with pytest.raises(LogError, match=r"theta 1000 Hz, z 100 Hz, lift 500 Hz"):
        brought(path, words)
    log = pt.load_log(brought(path, {**words, "time": time | {"rate": "1 kHz"}}).path)
    assert log.sizes["time"] > 1980
    truth = np.sin(9 * (log.time + np.ceil(1e3 * late) * 1e-3))  # the stamps are those of theta
    for name in steps:
        np.testing.assert_allclose(log[name], truth, atol=2e-3 if name == "z" else 1e-4)
        assert log[name].attrs["step_in_log"] == pytest.approx(steps[name])
    seen = {one.name: one for one in inspect_log(path).topics}
    assert {name: round(1 / one.rate, 6) for name, one in seen.items()} == steps
    assert not any(channel.missing for one in seen.values() for channel in one.channels)


def test_the_mapping_that_inspect_writes_imports_columns_of_plotjuggler(
    tmp_path: Path, speak: Speak
) -> None:
    """Names that begin with a slash were refused, with their units in them."""
    parts = []
    for name, step in (("/wing/plunge [rad]", 1e-3), ("/cell/lift [N]", 2e-3)):
        time = np.arange(0, 2, step)
        parts.append(pd.DataFrame({"__time": time, name: np.sin(9 * time)}))
    path, mapping = written(tmp_path, pd.concat(parts).sort_values("__time")), tmp_path / "own.yaml"
    assert speak("inspect", path, "-o", mapping).code == 0
    log = pt.load_log(pt.import_log(path, mapping, tmp_path / "log.nc").path)
    assert [*log.data_vars] == ["wing/plunge", "cell/lift"] and log.sizes["time"] > 1980


def test_columns_of_a_second_clock_stay_on_it_beside_columns_filled_in_turn(tmp_path: Path) -> None:
    """Quantities of the second stamps were taken for those of the first, and lost their places."""
    parts = []
    for name, step in (("theta", 1e-3), ("lift", 2e-3)):
        time = np.arange(0, 2, step)
        parts.append(pd.DataFrame({"t": time, "late": time + 0.5, name: np.sin(9 * time)}))
    table = pd.concat(parts).sort_values("t", kind="stable")
    table["heave"] = np.cos(9 * table["late"])
    words = {
        "time": {"column": "t", "unit": "s", "rate": "500 Hz"},
        "inputs": [{"column": "theta", "unit": "rad"}],
        "outputs": [{"column": "lift", "unit": "N"}],
        "channels": [{"stamp": "late", "column": "heave", "unit": "m"}],
    }
    table = table.drop_duplicates("t", keep="last")
    log = pt.load_log(brought(written(tmp_path, table), words).path)
    for name, found in (("theta", np.sin), ("lift", np.sin), ("heave", np.cos)):
        np.testing.assert_allclose(log[name], found(9 * (log.time + 0.501)), atol=1e-3)  # theta's


@pytest.mark.parametrize("turns", [False, True])
def test_the_column_of_stamps_may_be_a_quantity_too(tmp_path: Path, turns: bool) -> None:
    """A time column that was also a quantity raised ValueError, or got another column's values."""
    table = pd.DataFrame({"t": (t := 0.01 * np.arange(200)), "x": np.sin(t), "y": 100 + t})
    if turns:
        table.loc[::2, "x"] = np.nan
        table.loc[1::2, "y"] = np.nan
    units = {"t": "s", "x": "m", "y": "m"}
    columns = [{"column": name, "unit": unit} for name, unit in units.items()]
    columns[0]["name"] = "clock"
    time = {"column": "t", "unit": "s"} | ({"rate": "50 Hz"} if turns else {})
    found = brought(written(tmp_path, table), {"time": time, "channels": columns})
    log = pt.load_log(found.path)
    start = log["clock"].to_numpy()[0]
    np.testing.assert_allclose(log["clock"], log.time + start, atol=1e-9)
    np.testing.assert_allclose(log["y"], 100 + log["clock"], atol=1e-9)
    np.testing.assert_allclose(log["x"], np.sin(log["clock"]), atol=1e-4)  # linear in 20 ms


def test_outputs_that_skip_rows_stay_beside_their_inputs(tmp_path: Path) -> None:
    """A force measured in every second row, with inputs in all rows, needs no resampling."""
    table = frame()
    table.loc[1::2, "fz"] = np.nan
    assert brought(written(tmp_path, table)).samples == 150


def test_a_column_of_text_is_refused_by_its_words(tmp_path: Path) -> None:
    """The message names the text that is no number, not a missing column."""
    path, mapping = tmp_path / "log.csv", tmp_path / "map.yaml"
    rows = [f"{0.01 * k},{k},1.{k}D-01" for k in range(100)]
    path.write_text("\n".join(["t [s],angle [rad],lift [N]", *rows]))
    mapping.write_text(
        "about: x\ntime: {column: t, unit: s}\ninputs: [{column: angle, unit: rad}]\n"
        "outputs: [{column: lift, unit: N}]\n"
    )
    with pytest.raises(LogError, match="'lift' cannot be read as numbers: text such as '1.0D-01'"):
        pt.import_log(path, mapping, tmp_path / "log.nc")


@pytest.mark.parametrize("first", [1.7e9, 5000.0])
@pytest.mark.parametrize(("unit", "count"), [("ms", 1000), ("µs", 10**6), ("ns", 10**9)])
def test_dates_and_times_since_boot_without_a_unit(
    unit: str, count: int, first: float, tmp_path: Path
) -> None:
    """Each row was said to have no stamp, and the advice to say ns made the log too short."""
    stamps = np.round((first + 0.005 * np.arange(300)) * count).astype(np.int64)
    path = written(tmp_path, frame(t=stamps))
    seen = {one.kind: one.text for one in inspect_log(path).findings}
    assert f"perhaps {unit}?" in seen["unit of time"] and "missing stamps" not in seen
    for wrong in {"s", "ms", "µs", "ns"} - {unit}:
        words = {**WORDS, "time": {"column": "t", "unit": wrong}}
        try:
            doubts = [one.text for one in brought(path, words).findings]
        except LogError as refused:  # beyond 146 years
            doubts = [str(refused)]
        # a time since boot may be one of a faster log: no date tells
        assert any(f"perhaps {unit}?" in one for one in doubts) or first < 1e6
    assert brought(
        path, {**WORDS, "time": {"column": "t", "unit": unit}}
    ).duration == pytest.approx(1.495)


def test_days_of_spreadsheets_and_matlab(tmp_path: Path) -> None:
    """Days were asked whether they are seconds, and those of MATLAB had no stamp at all."""
    days = {**WORDS, "time": {"column": "t", "unit": "d"}}
    for first in (45321.51234, 739321.51234):
        table = frame(t=first + 0.005 * np.arange(300) / 86400)
        path = written(tmp_path, table)
        seen = {one.kind: one.text for one in inspect_log(path).findings}
        assert "perhaps d (days" in seen["unit of time"]
        log = pt.load_log(brought(path, days).path)
        np.testing.assert_allclose(log.time, 0.005 * np.arange(300), atol=1e-5)
    path = written(tmp_path, frame(t=np.round(45321.5 + 0.005 * np.arange(300) / 86400, 6)))
    with pytest.raises(LogError, match=r"perhaps d \(days"):
        brought(path, {**WORDS, "time": {"column": "t", "unit": "s"}})


def test_the_unit_of_time_is_doubted(tmp_path: Path) -> None:
    words = {**WORDS, "time": {"column": "t", "unit": "s", "start": None}}
    stamps = 1e5 * np.arange(300)
    found = brought(written(tmp_path, frame(t=stamps)), words)
    assert "unit of time" in kinds(found)


def test_time_that_runs_back_for_most_of_the_log_is_refused(tmp_path: Path) -> None:
    stamps = frame()["t"].to_numpy().copy()
    stamps[100:] -= 10_000.0
    with pytest.raises(LogError, match="200 of 300 rows do not come after.*9.998 s"):
        brought(written(tmp_path, frame(t=stamps)))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.csv"]


def test_a_result_that_cannot_be_written_is_refused_by_name(tmp_path: Path) -> None:
    log = written(tmp_path, frame())
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match=r"file/out\.nc: cannot be written"):
        import_log(log, parse_mapping(WORDS), tmp_path / "file" / "out.nc")


def test_several_streams_need_a_time_base(tmp_path: Path) -> None:
    table = frame(t2=frame()["t"] + 1.0)
    words = {
        **WORDS,
        "channels": [{"column": "gx", "unit": "deg/s", "stamp": "t2", "name": "late"}],
    }
    path = written(tmp_path, table)
    with pytest.raises(LogError, match=r"expected rate \(such as 200 Hz\) or like.*500"):
        brought(path, words)
    found = brought(path, {**words, "time": {**WORDS["time"], "rate": "500 Hz"}})
    with LogRecord(found.path) as record:
        early, late = record.values(("rate.x", "late")).T
    # the base has the stamps of the later stream: the other is halfway between samples
    np.testing.assert_allclose((late[1:] + late[:-1]) / 2, early[:-1], atol=1e-12)


def test_a_wrong_column_names_the_closest(tmp_path: Path) -> None:
    words = {**WORDS, "outputs": [{"column": "f_z", "unit": "N"}]}
    with pytest.raises(
        LogError, match=r"outputs.0: expected 'f_z', but the file holds .*fz; if .* `skip_rows`"
    ):
        brought(written(tmp_path, frame()), words)
    with pytest.raises(LogError, match="time.column: expected the column with stamps"):
        brought(written(tmp_path, frame()), {**WORDS, "time": {}})


def test_semicolons_decimal_commas_and_units_in_headers(tmp_path: Path) -> None:
    table = frame().rename(columns={"t": "t [ms]", "fz": "fz [m/s^2]"})
    path = tmp_path / "log.csv"
    table.to_csv(path, index=False, sep=";", decimal=",")
    found = brought(path)
    assert found.samples == 300
    assert any("the file or its definitions say [m/s^2]" in one.text for one in found.findings)


def test_calendar_time_stamps_a_table(tmp_path: Path) -> None:
    stamps = pd.Timestamp("2026-05-04T12:00:00.5") + pd.to_timedelta(2 * np.arange(300), "ms")
    path = written(tmp_path, frame(t=stamps))
    assert inspect_log(path).topics[0].rate == pytest.approx(500.0, rel=0.01)
    with LogRecord(brought(path).path) as record:
        np.testing.assert_allclose(record.time(), 2e-3 * np.arange(300), atol=1e-12)


def test_a_registered_reader_is_found_by_ending_and_by_first_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opening, "_SINGLE", dict(opening._SINGLE))
    monkeypatch.setattr(opening, "_MAGIC", dict(opening._MAGIC))
    (tmp_path / "log.wing").write_bytes(b"RECORDS\n" + frame().to_csv(index=False).encode())
    with pytest.raises(LogError, match="found a name that ends in '.wing'"):
        brought(tmp_path / "log.wing")

    def read(path: Path) -> CsvFile:
        table = path.with_suffix(".csv")
        table.write_bytes(path.read_bytes().partition(b"\n")[2])
        return CsvFile(table)

    opening.register_reader(".wing", read, b"RECORDS")
    assert brought(tmp_path / "log.wing").samples == 300
    renamed = (tmp_path / "log.wing").rename(tmp_path / "log.bin")
    assert inspect_log(renamed).topics[0].rows == 300


@pytest.mark.parametrize("ending", [".txt", ".CSV", ".bag", ".csv.gz", "rec", ".tar.rec", ".", ""])
def test_a_reader_of_no_ending_of_its_own_is_refused(ending: str) -> None:
    """A reader for an ending such as .txt was never called, or replaced that of CSV files."""
    with pytest.raises(ParameterError, match="^ending: expected one suffix"):
        opening.register_reader(ending, CsvFile)


def test_the_ending_of_an_own_reader_may_be_in_capitals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file reader registered with the ending ".REC" in capitals was never called."""
    monkeypatch.setattr(opening, "_SINGLE", dict(opening._SINGLE))
    for _ in range(2):  # twice, as in a notebook
        opening.register_reader(".REC", CsvFile)
    frame().to_csv(tmp_path / "log.Rec", index=False)
    assert inspect_log(tmp_path / "log.Rec").topics[0].rows == 300


def test_a_log_is_inspected_without_a_mapping(tmp_path: Path) -> None:
    stamps = frame()["t"].to_numpy().copy()
    stamps[100:] += 500.0
    table = frame(t=stamps).rename(columns={"t": "time_ms"})
    table.loc[7, "gx"] = np.nan
    facts = inspect_log(written(tmp_path, table))
    topic = facts.topics[0]
    assert topic.rows == 300 and topic.rate == pytest.approx(500.0, rel=0.01)
    assert topic.gaps == 1 and topic.longest == pytest.approx(0.502)
    by_name = {channel.name: channel for channel in topic.channels}
    assert by_name["gx"].missing == 1
    assert by_name["throttle"].low == 200 and by_name["throttle"].high == 499
    assert {one.kind for one in facts.findings} == {"gap", "missing numbers", "unit"}


def test_rows_without_a_structure_are_missing_numbers_not_zero(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow", reason="Parquet needs the extra patagium[logs]")
    from pyarrow import parquet

    rows = {"t": [0.0, 1.0, 2.0], "imu": [{"gyro": {"x": 3.0}}, None, {"gyro": {"x": 5.0}}]}
    parquet.write_table(pyarrow.table(rows), tmp_path / "log.parquet")
    with closing(open_log(tmp_path / "log.parquet")) as log:
        assert set(log.topics[""].channels) == {"t", "imu.gyro.x"}
        (block,) = log.blocks((Request("", StampSource("column", "t", 1e9), ("imu.gyro.x",)),))
    np.testing.assert_array_equal(block.values[:, 0], [3.0, np.nan, 5.0])


def test_samples_of_the_rate_of_the_time_base_are_taken_as_they_are(tmp_path: Path) -> None:
    """Halfway between its samples an inertial unit's noise was smoothed to a seventh."""
    fast, slow = 0.001 + 0.005 * np.arange(400), 0.0035 + 0.01 * np.arange(200)
    noise = np.random.default_rng(2).normal(size=400)
    rows = pd.concat(
        [pd.DataFrame({"t": fast, "a": noise}), pd.DataFrame({"t": slow, "b": np.sin(slow)})]
    ).sort_values("t")
    rows.to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "map.yaml").write_text(
        "about: x\ntime: {column: t, unit: s, rate: 200 Hz}\ninputs: [{column: b, unit: rad}]\n"
        "outputs: [{column: a, unit: N}]\n"
    )
    pt.import_log(tmp_path / "log.csv", tmp_path / "map.yaml", tmp_path / "log.nc")
    with LogRecord(tmp_path / "log.nc") as record:
        found = record.table().y[:, 0]
    np.testing.assert_allclose(found, noise[1 : 1 + len(found)], atol=1e-5)  # stamps of whole ns


@pytest.mark.parametrize(("unit", "scale", "begin"), [("ms", 1e3, 0), ("ns", 1e9, 1_700_000_000)])
def test_a_second_clock_has_a_unit_of_its_own(
    unit: str, scale: float, begin: int, tmp_path: Path
) -> None:
    """A second clock in ms made the log 1000 times too long; one in ns was refused."""
    from scipy.io import savemat

    time, late = np.arange(0, 2, 0.002), np.arange(0, 1.5, 0.01)
    stamps = np.rint(late * scale).astype(np.int64) + begin * int(scale)
    path = tmp_path / "log.mat"
    cam = {"stamp": stamps, "x": np.sin(3 * late)}
    savemat(path, {"imu": {"t": time + begin, "gyro": np.cos(time)}, "cam": cam})
    words: dict[str, Any] = {
        "time": {"column": "imu.t", "unit": "s", "rate": "500 Hz"},
        "channels": [
            {"column": "imu.gyro", "unit": "rad/s"},
            {"column": "cam.x", "stamp": "cam.stamp", "unit": "m"},
        ],
    }
    try:
        assert "is its unit perhaps ms" in str(brought(path, words).findings)
    except LogError as problem:
        assert "unit perhaps ns?" in str(problem) and "{column: cam.stamp, unit" in str(problem)
    words["channels"][1]["stamp"] = {"column": "cam.stamp", "unit": unit}
    log = pt.load_log(brought(path, words).path)
    assert log.time.values[-1] == pytest.approx(1.49, abs=2e-3)  # of the last pose; a sample
    exact = np.sin(3 * log.time.values)
    np.testing.assert_allclose(log["cam.x"], exact, atol=2e-4)  # linear in 10 ms: (.03)^2 / 8
    words["channels"][1]["stamp"]["unit"] = "kg"
    with pytest.raises(LogError, match=r"time \(cam\.stamp\): expected a unit of \[time\]"):
        brought(path, words)


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat"])
@pytest.mark.parametrize(
    ("seconds", "parts", "name", "unit"),
    [
        ("header.stamp.sec", "header.stamp.nanosec", "header.stamp", 1),
        ("Secs", "Nsecs", "stamp", 1),
        ("tv_sec", "tv_usec", "tv", 1000),
    ],
)
def test_seconds_and_their_parts_of_two_columns_are_one_stamp(
    kind: str, seconds: str, parts: str, name: str, unit: int, tmp_path: Path, speak: Speak
) -> None:
    """A header of ROS in a table had stamps in whole seconds, and nanoseconds as an input."""
    k = np.arange(1500)
    stamps = 1_700_000_000_123_456_789 + 2_000_000 * k
    columns = {"x": np.sin(0.018 * k), seconds: stamps // 10**9, parts: stamps % 10**9 // unit}
    table = pd.DataFrame(columns)
    if kind == "csv":
        table[parts] = table[parts].astype(float).where(k != 700)  # one is missing
    path, mapping = written(tmp_path, table, kind), tmp_path / "own.yaml"
    assert speak("inspect", path, "-o", mapping).code == 0
    assert f'time: {{column: "{name}"}}' in mapping.read_text() and parts not in mapping.read_text()
    found = import_log(path, mapping, tmp_path / "out.nc")
    log = pt.load_log(found.path)
    assert found.samples == 1500 - (kind == "csv")
    np.testing.assert_allclose(log["x"], np.sin(9 * log.time), atol=1e-9)  # ns of rounding
    with pytest.raises(LogError, match=f"part of the stamps '{name}'"):
        brought(path, {"time": {"column": seconds}, "channels": [{"column": "x", "unit": "m"}]})
