"""Tables as rigs write them: units without a space, decimal commas, wraps, footers."""

import json
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.cli.main import run
from patagium.errors import LogError
from patagium.sensing.logs.mapping import conversion, parse_mapping
from patagium.sensing.logs.sensor_log import sensor_log
from patagium.sensing.motion.sensor_streams import EncoderModel
from patagium.sensing.sensors import Encoder

TIME = {"column": "t", "unit": "s"}


def imported(folder: Path, text: str, words: dict[str, Any], name: str = "log.csv") -> Any:
    (folder / name).write_text(text, encoding="utf-8")
    return pt.import_log(folder / name, parse_mapping(words), folder / "out.nc")


def column(log: Path, name: str) -> Any:
    return pt.load_log(log)[name].values


@pytest.mark.parametrize(
    ("unit", "factor", "si"),
    [
        *((unit, 1.0, "N m") for unit in ("Nm", "N m", "N.m", "N·m")),
        *((unit, 1e-3, "N m") for unit in ("mNm", "Nmm", "mN.m", "N mm")),
        ("kNm", 1e3, "N m"),
        ("Nm/rad", 1.0, "kg m^2/rad/s^2"),
        ("1/Nm", 1.0, "s^2/kg/m^2"),
        *((unit, 1.0, "m/s^2") for unit in ("m/s2", "m/s²", "m/s^2")),
        *((unit, 1.0, "rad/s^2") for unit in ("rad/s2", "rad/s²")),
        ("nm", 1e-9, "m"),
        ("0.02 deg", 0.02 * np.pi / 180, "rad"),  # an encoder behind a gear of 50
        ("2.5e-1 mN", 2.5e-4, "N"),
    ],
)
def test_units_are_read_as_rigs_write_them(unit: str, factor: float, si: str) -> None:
    assert conversion(unit, None, "here") == (pytest.approx(factor, rel=1e-12), si)


def test_a_coordinate_in_a_unit_of_another_dimension_is_refused(tmp_path: Path) -> None:
    text = "t,torque\n" + "".join(f"{0.01 * k},{np.sin(k)}\n" for k in range(50))
    words = {"time": TIME, "robot": "yeo-wing",
             "channels": [{"column": "torque", "unit": "g", "name": "u1.left_plunge"}]}  # fmt: skip
    with pytest.raises(LogError, match=r"u1\.left_plunge: expected a unit of .* such as 'N m'"):
        imported(tmp_path, text, words)
    words.pop("robot")
    imported(tmp_path, text, words)
    with pytest.raises(LogError, match=r"u1\.left_plunge: expected a quantity in N m, found .*kg"):
        sensor_log(tmp_path / "out.nc", "yeo-wing")


@pytest.mark.parametrize(
    ("mark", "quote", "points"),
    [("\t", "", False), (",", '"', False), (";", "", False), (";", "", True), ("\t", "", True)],
)
def test_decimal_commas_are_found_column_by_column(
    mark: str, quote: str, points: bool, tmp_path: Path
) -> None:
    k = np.arange(300)
    t, x, y = 0.01 * k, 0.4 * np.sin(0.1 * k), np.cos(0.1 * k)
    lines = [mark.join(("t", "x", "y", "n"))]
    for row in zip(t, x, y, k, strict=True):
        cells = [f"{number:.6f}" for number in row[:3]]
        cells = [cell if points and i == 2 else cell.replace(".", ",")
                 for i, cell in enumerate(cells)]  # fmt: skip
        lines.append(mark.join(f"{quote}{cell}{quote}" for cell in (*cells, str(row[3]))))
    words = {"time": TIME, "channels": [{"column": name, "unit": "1"} for name in "xyn"]}
    found = imported(tmp_path, "\n".join([*lines, ""]), words)
    assert found.samples == 300
    for name, expected in (("x", x), ("y", y), ("n", k)):
        np.testing.assert_allclose(column(found.path, name), expected, atol=1e-6)
    channels = pt.sensing.inspect_log(tmp_path / "log.csv").topics[0].channels
    assert [one.name for one in channels] == ["t", "x", "y", "n"]


@pytest.mark.parametrize("clock", ["{:.2f}", "{:.0f}"])
@pytest.mark.parametrize("pattern", ["[{}; {}; {}]", "[{} {} {}]", "{} {} {}", "[{}, {}, {}]"])
def test_lists_with_decimal_commas_are_not_twice_as_long(
    pattern: str, clock: str, tmp_path: Path
) -> None:
    """Each number with a decimal comma was read as two integers."""
    rows = np.random.default_rng(0).normal(size=(50, 3)).round(4)
    rows[3] = 0.0, 1.0, -2.0
    lines = [f'{clock.format(k)};"{pattern.format(*map(str, row))}"' for k, row in enumerate(rows)]
    text = "\n".join(["t;acc", *lines, ""]).replace(".", ",")
    words = {"column": "acc", "unit": "m/s^2", "frame": "flu", "name": "a"}
    found = imported(tmp_path, text, {"time": TIME, "channels": [words]})
    np.testing.assert_allclose(column(found.path, "a"), rows, atol=1e-12)


@pytest.mark.parametrize("kind", ["attitude", "vector"])
def test_a_longer_list_is_no_vector_and_no_attitude(kind: str, tmp_path: Path) -> None:
    """The first four of seven numbers of a pose, x, y, z, qx, were read as its quaternion."""
    rows = "".join(f'{k},"[1, 2, 3, 0, 0, 0.6, 0.8]"\n' for k in range(50))
    attitude = {"order": "xyzw", "frame": "nwu", "body": "flu", "name": "a"}
    words = attitude if kind == "attitude" else {"unit": "m", "frame": "nwu", "name": "a"}
    mapping = {"time": TIME, "channels": [{"column": "pose", **words}]}
    with pytest.raises(LogError, match=r"found pose\[0\],.* pose\[6\]; a list of names takes"):
        imported(tmp_path, f"t,pose\n{rows}", mapping)
    places = (3, 4, 5, 6) if kind == "attitude" else (0, 1, 2)
    mapping["channels"][0]["column"] = [f"pose[{k}]" for k in places]  # type: ignore[index]
    found = imported(tmp_path, f"t,pose\n{rows}", mapping)
    last = column(found.path, "a")[:, -1]
    np.testing.assert_allclose(last, 0.6 if kind == "attitude" else 3.0, atol=1e-12)


@pytest.mark.parametrize("rate", [None, "33 Hz"])
@pytest.mark.parametrize("low", [0.0, -180.0])
def test_an_encoder_that_wraps_leaves_no_jump(low: float, rate: str | None, tmp_path: Path) -> None:
    k = np.arange(200_000)  # of several blocks
    middle = -10.0 if low == 0 else 170.0
    angle = np.where(k < 70_000, middle, middle + 30.0 * np.sin(1e-3 * (k - 70_000)))
    rows = np.column_stack([0.01 * k, (angle - low) % 360.0 + low])
    np.savetxt(tmp_path / "log.csv", rows, fmt="%.6f", delimiter=",", header="t,h", comments="")
    words = {"time": {**TIME, **({"rate": rate} if rate else {})},
             "channels": [{"column": "h", "unit": "deg"}]}  # fmt: skip
    pt.import_log(tmp_path / "log.csv", parse_mapping(words), tmp_path / "out.nc")
    log = pt.load_log(tmp_path / "out.nc")
    expected = np.radians(np.interp(log.time.values, rows[:, 0], angle))
    turns = np.rint((log["h"].values - expected) / (2 * np.pi))
    np.testing.assert_allclose(log["h"].values, expected + 2 * np.pi * turns[0], atol=1e-6)


def test_a_shaft_that_goes_round_goes_on(tmp_path: Path) -> None:
    k = np.arange(500)
    text = "t,h\n" + "".join(f"{0.01 * i},{(10.0 * i + 5.0) % 360.0}\n" for i in k)
    words = {"time": TIME, "channels": [{"column": "h", "unit": "deg"}]}
    found = imported(tmp_path, text, words)
    angle = np.degrees(column(found.path, "h"))
    np.testing.assert_allclose(angle, 10.0 * k + 5.0, atol=1e-9)


def test_joints_of_a_sensor_log_are_unwrapped() -> None:
    robot = pt.load_robot("yeo-wing")
    model = EncoderModel(Encoder(rate=100.0), robot)
    angle = np.linspace(-0.5, 0.5, 50)[:, None] * [1.0, -1.0]
    angle[20] = np.nan
    reading = xr.Dataset({"position": (("time", "joint"), angle % (2 * np.pi))})
    np.testing.assert_allclose(model.rows(reading), angle, atol=1e-12)


ROWS = "".join(f"{0.01 * k:.2f},{np.sin(k):.5f},{np.cos(k):.5f}\n" for k in range(300))
PLAIN = {"time": TIME, "channels": [{"column": name, "unit": "1"} for name in "xy"]}


@pytest.mark.parametrize("count", [300, 5])
@pytest.mark.parametrize("end", ["\nEnd of data\nMean,0,0\n", "Max,1,1", "# done\n\n"])
def test_rows_of_text_at_the_end_are_left_out_and_told(
    end: str, count: int, tmp_path: Path
) -> None:
    rows = "".join(ROWS.splitlines(keepends=True)[:count])
    found = imported(tmp_path, f"t,x,y\n{rows}{end}", PLAIN)
    assert found.samples == count
    assert any("rows of text at the end are left out" in note for note in found.notes)
    topic = pt.sensing.inspect_log(tmp_path / "log.csv").topics[0]
    assert topic.stamps == "t" and topic.rows == count


def test_a_column_that_turns_to_text_is_no_end_of_the_table(tmp_path: Path) -> None:
    rows = "".join(f"{3 + 0.01 * k:.2f},lost,1\n" for k in range(30))
    with pytest.raises(LogError, match="column x: expected numbers, found 'lost' in row 301"):
        imported(tmp_path, f"t,x,y\n{ROWS}{rows}", PLAIN)


def template(path: Path, *words: str) -> str:
    """Mapping that `inspect` writes to begin from."""
    mapping = path.with_suffix(".yaml")
    with pytest.raises(SystemExit) as left:
        run(["inspect", str(path), *words, "-o", str(mapping)])
    assert left.value.code in (0, None)
    return mapping.read_text("utf-8")


def test_the_mapping_to_begin_from_names_calendar_stamps(tmp_path: Path) -> None:
    rows = "".join(f"2026-03-01 12:00:00.{k:03d},{np.sin(k)},{np.cos(k)}\n" for k in range(300))
    (tmp_path / "log.csv").write_text(f"Time,x,y\n{rows}")
    assert 'time: {column: "Time"}' in template(tmp_path / "log.csv")
    found = pt.import_log(tmp_path / "log.csv", tmp_path / "log.yaml", tmp_path / "out.nc")
    assert found.samples == 300


def test_the_mapping_to_begin_from_asks_for_the_rate_of_rows_without_time(tmp_path: Path) -> None:
    rows = "".join(f"01.03.2026 12h00m00.{k:03d}s,{np.sin(k)},1\n" for k in range(300))
    (tmp_path / "log.csv").write_text(f"Time,x,y\n{rows}")
    (warning,) = [
        one.text
        for one in pt.sensing.inspect_log(tmp_path / "log.csv").findings
        if one.level == "warning"
    ]
    assert "column 'Time' cannot be read" in warning and "ISO 8601" in warning
    words = template(tmp_path / "log.csv")
    assert 'time: {restamp: "??? Hz"}  # rate of the rows' in words
    with pytest.raises(LogError, match=r"time.restamp: expected a rate such as .* '\?\?\? Hz'"):
        pt.import_log(tmp_path / "log.csv", tmp_path / "log.yaml", tmp_path / "out.nc")
    (tmp_path / "log.yaml").write_text(words.replace("??? Hz", "1 kHz"))
    found = pt.import_log(tmp_path / "log.csv", tmp_path / "log.yaml", tmp_path / "out.nc")
    assert found.samples == 300


def test_columns_without_a_number_are_not_in_the_mapping_to_begin_from(tmp_path: Path) -> None:
    rows = "".join(f"{0.01 * k},{np.sin(k)},,{np.cos(k)},\n" for k in range(300))
    (tmp_path / "log.csv").write_text(f"t,x,empty,y,\n{rows}")
    topic = pt.sensing.inspect_log(tmp_path / "log.csv").topics[0]
    assert [one.name for one in topic.channels] == ["t", "x", "empty", "y"]
    words = template(tmp_path / "log.csv")
    assert "empty" not in words and '""' not in words
    found = pt.import_log(tmp_path / "log.csv", tmp_path / "log.yaml", tmp_path / "out.nc")
    assert found.samples == 300


def test_g_of_an_acceleration_is_gravity(tmp_path: Path) -> None:
    rows = "".join(f"{0.01 * k},{np.sin(k)},{1 + 0.1 * np.cos(k)}\n" for k in range(300))
    text = f"t,ax [g],acc.z [g]\n{rows}"
    words = {"time": TIME, "channels": [{"column": "ax", "unit": "g"}]}
    found = imported(tmp_path, text, words)
    assert any("say [g_0], the mapping [g]" in one.text for one in found.findings)
    units = [one.unit for one in pt.sensing.inspect_log(tmp_path / "log.csv").topics[0].channels]
    assert units == ["", "g_0", "g_0"]
    words = {"time": TIME, "channels": [{"column": "m", "unit": "g"}]}
    assert not imported(tmp_path, f"t,m [g],z\n{rows}", words).findings


@pytest.mark.parametrize(("order", "warned"), [("wxyz", True), ("xyzw", False)])
def test_an_order_that_contradicts_the_names_is_told(
    order: str, warned: bool, tmp_path: Path
) -> None:
    rows = "".join(
        f"{0.01 * k},0,0,{np.sin(0.01 * k):.9f},{np.cos(0.01 * k):.9f}\n" for k in range(300)
    )
    words = {"time": TIME, "channels": [
        {"column": ["qx", "qy", "qz", "qw"], "order": order, "frame": "nwu", "body": "flu",
         "name": "attitude"}]}  # fmt: skip
    found = imported(tmp_path, f"t,qx,qy,qz,qw\n{rows}", words)
    assert warned == any("order: wxyz" in one.text for one in found.findings)


def test_commas_of_thousands_are_refused(tmp_path: Path) -> None:
    rows = "".join(f'{k},"{900 + k:,}",1\n' for k in range(300))
    with pytest.raises(LogError, match="column x: expected numbers, found '1,000'"):
        imported(tmp_path, f"t,x,y\n{rows}", PLAIN)


def test_decimal_commas_above_rows_of_text_are_read(tmp_path: Path) -> None:
    rows = ROWS.replace(",", ";").replace(".", ",")
    found = imported(tmp_path, f"t;x;y\n{rows}End\n", PLAIN)
    assert found.samples == 300
    np.testing.assert_allclose(column(found.path, "x"), np.sin(np.arange(300)), atol=1e-5)


def test_only_a_name_of_time_is_in_milliseconds(tmp_path: Path) -> None:
    heads = {"airspeed_ms": "", "delay_ms": "ms", "Vz_mm_s": "mm/s", "az_ms2": "m/s^2",
             "alpha_degrees": "deg", "lift_gf": "gf", "motor rpm": "rpm",
             "batt_mV": "mV"}  # fmt: skip
    rows = "".join(f"{10 * k},{','.join(str(1500 + k) for _ in heads)}\n" for k in range(100))
    (tmp_path / "log.csv").write_text(f"t_ms,{','.join(heads)}\n{rows}")
    found = pt.sensing.inspect_log(tmp_path / "log.csv")
    assert {one.name: one.unit for one in found.topics[0].channels} == {"t_ms": "ms", **heads}
    notes = [one.text for one in found.findings if one.kind == "unit" and one.level == "note"]
    assert notes == ["no unit found for: airspeed_ms; taken as a plain number"]
    assert 'column: "airspeed_ms", unit: "1"' in template(tmp_path / "log.csv")
    assert not [one for one in found.findings if "rpm" in one.where]


def test_a_constant_column_is_noted_and_zero_has_no_sign(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,x [m]\n" + "".join(f"{k / 100},-0.0\n" for k in range(99)))
    found = pt.sensing.inspect_log(tmp_path / "log.csv").findings
    assert [(one.kind, one.text) for one in found] == [("constant", "never changes from 0")]


@pytest.mark.parametrize(
    ("head", "unit"),
    [
        *(("millis", "ms"), ("micros", "µs"), ("time_millis", "ms"), ("sec", "s")),
        *(("Seconds", "s"), ("elapsed", "s"), ("elapsed_ms", "ms")),
    ],
)
def test_names_of_time_of_other_kinds_are_read(head: str, unit: str, tmp_path: Path) -> None:
    """Rows were counted, and the time was an input of the mapping to begin from."""
    (tmp_path / "log.csv").write_text(
        f"{head},gyro\n" + "".join(f"{k},{k % 3}\n" for k in range(9))
    )
    line = template(tmp_path / "log.csv").splitlines()[0]
    assert line.startswith(f'time: {{column: "{head}", unit: "{unit}"}}')
    (tmp_path / "other.csv").write_text("zeit,millions,gyro\n1,1,1\n2,2,3\n3,3,4\n")
    assert template(tmp_path / "other.csv").splitlines()[0].endswith("{column: NAME, unit: s}")


def test_a_column_named_ts_states_no_seconds(tmp_path: Path) -> None:
    """A column named ts was read as a time t in seconds, against the mapping."""
    words = {"time": {"column": "ts", "unit": "ms"}, "channels": [{"column": "x", "unit": "1"}]}
    found = imported(tmp_path, "ts,x\n" + "".join(f"{5 * k},{k % 7}\n" for k in range(99)), words)
    assert not found.findings and found.duration == pytest.approx(0.49)
    line = template(tmp_path / "log.csv").splitlines()[0]
    assert line.startswith('time: {column: "ts", unit: "s"}  # ') and line.endswith("ms?")


def test_a_doubted_unit_of_time_is_doubted_in_the_mapping_to_begin_from(tmp_path: Path) -> None:
    """It said `unit: s` of stamps in milliseconds, and only a finding above it asked."""
    (tmp_path / "log.csv").write_text(
        "timestamp,a\n" + "".join(f"{10 * k},{k}\n" for k in range(9))
    )
    line = template(tmp_path / "log.csv").splitlines()[0]
    assert line.startswith('time: {column: "timestamp", unit: "s"}  # ') and line.endswith("ms?")


@pytest.mark.parametrize(
    ("unit", "duration", "told"), [(None, 8.97, False), ("min", 8.97, False), ("s", 0.1495, True)]
)
def test_stamps_are_in_the_unit_that_the_file_states(
    unit: str | None, duration: float, told: bool, tmp_path: Path
) -> None:
    """Minutes of a header were taken for seconds, with nothing suspicious."""
    rows = "".join(f"{0.0005 * k},{np.sin(0.1 * k)}\n" for k in range(300))
    time = {"column": "t"} | ({"unit": unit} if unit else {})
    words = {"time": time, "channels": [{"column": "y", "unit": "deg"}]}
    found = imported(tmp_path, f"t [min],y [deg]\n{rows}", words)
    assert found.duration == pytest.approx(duration)
    assert (
        any("the file states [min], the mapping [1 s]" in one.text for one in found.findings)
        == told
    )


def test_each_clock_of_a_file_has_its_own_unit(tmp_path: Path) -> None:
    """The mapping that `inspect` writes had the stamps of all arrays in the unit of the first."""
    clocks = {"enc": ("ms", 5.0, "angle", np.sin), "cell": ("s", 0.002, "fz", np.cos)}
    with netCDF4.Dataset(tmp_path / "log.h5", "w") as file:
        for name, (unit, step, value, wave) in clocks.items():
            group = file.createGroup(name)
            time = step * np.arange(2000 / step if unit == "ms" else 2 / step)
            group.createDimension("n", len(time))
            seconds = 1e-3 * time if unit == "ms" else time
            for key, held in (("t", time), (value, wave(9 * seconds))):
                group.createVariable(key, "f8", "n")[:] = held
            group["t"].units = unit
    template(tmp_path / "log.h5")
    found = pt.import_log(tmp_path / "log.h5", tmp_path / "log.yaml", tmp_path / "out.nc")
    assert not [one for one in found.findings if one.level == "warning"]
    log = pt.load_log(found.path)
    begin = float(log["time"][0]) if found.duration > 1.9 else np.nan
    assert begin == pytest.approx(0.0, abs=0.01)
    for name, wave in (("enc.angle", np.sin), ("cell.fz", np.cos)):
        np.testing.assert_allclose(log[name], wave(9 * log["time"]), atol=2e-3)  # linear between


@pytest.mark.parametrize(
    "head",
    [
        "Time (Seconds),a [%],b [#],c [?],d [on]",
        "t,a [-],F [N]",
        "t,x",
        "t,x,,",
        "Time (Seconds),a",
    ],
)
def test_a_mapping_to_begin_from_is_no_mapping_that_is_refused(head: str, tmp_path: Path) -> None:
    """Units that YAML reads otherwise or that are none, one column and one without a name."""
    count = head.count(",")
    rows = "".join(f"{0.01 * k}" + f",{np.sin(k)}" * count + "\n" for k in range(99))
    (tmp_path / "log.csv").write_text(f"{head}\n{rows}")
    template(tmp_path / "log.csv")
    found = pt.import_log(tmp_path / "log.csv", tmp_path / "log.yaml", tmp_path / "out.nc")
    assert found.samples == 99 and found.duration == pytest.approx(0.98)


def test_columns_of_two_tables_have_names_of_their_own_in_the_mapping_to_begin_from(
    tmp_path: Path,
) -> None:
    """Both tables of a Vicon export have a column Frame, and the mapping used that name twice."""
    plate = "Devices\n1000\nFrame,Fx\n,N\n" + "".join(f"{k},{np.sin(k)}\n" for k in range(400))
    poses = "Trajectories\n100\nFrame,X\n,mm\n" + "".join(f"{k},{k}\n" for k in range(40))
    (tmp_path / "log.csv").write_text(f"{plate}\n{poses}")
    words = template(tmp_path / "log.csv", "--topic", "Devices", "--topic", "Trajectories")
    assert 'field: "Frame", unit: "1", name: "Devices Frame"}' in words
    found = pt.import_log(tmp_path / "log.csv", tmp_path / "log.yaml", tmp_path / "out.nc")
    assert found.samples > 300


def test_forces_in_any_unit_are_outputs_of_the_mapping_to_begin_from(tmp_path: Path) -> None:
    """Forces in mN, kN, gf or N cm were among the inputs."""
    units = ["mN", "kN", "gf", "lbf", "N cm", "mN m"]
    head = ",".join(f"c{k} [{unit}]" for k, unit in enumerate(units))
    rows = "".join(f"{k},{np.sin(k)}" + f",{np.cos(k)}" * len(units) + "\n" for k in range(300))
    (tmp_path / "log.csv").write_text(f"t [ms],angle [deg],{head}\n{rows}")
    inputs, _, outputs = template(tmp_path / "log.csv").partition("outputs:")
    assert "angle" in inputs and all(f'unit: "{unit}"}}' in outputs for unit in units)


def test_a_constant_pose_tells_nothing_of_the_stamps(tmp_path: Path) -> None:
    """The pose of a tilted stand was said to have stamps that are uncertain by 0.1 s."""
    body = "{floating: true, mass: 0.03, shape: {type: box, size: [0.06, 0.02, 0.02]}}"
    (tmp_path / "stand.yaml").write_text(
        f"{{name: stand, gravity: 9.81, bodies: {{stand: {body}}}}}"
    )
    pose = {"frame": "flu", "body": "flu", "order": "rpy", "unit": "deg", "name": "attitude"}
    words = {
        "time": TIME,
        "robot": str(tmp_path / "stand.yaml"),
        "channels": [
            {"column": ["px", "py", "pz"], "unit": "m", "frame": "flu", "name": "position"},
            {"column": ["roll", "pitch", "yaw"], **pose},
        ],
    }
    rows = "".join(f"{0.002 * k:.3f},0,0,0,8,-12,25\n" for k in range(2500))
    found = imported(tmp_path, f"t,px,py,pz,roll,pitch,yaw\n{rows}", words)
    motion = pt.estimate_motion(sensor_log(found.path))
    assert [one["jitter"] for one in json.loads(motion.findings)["noise"]] == [0.0, 0.0]


@pytest.mark.parametrize(("turn", "hertz"), [(360, 500), (360, 1000), (4096, 500)])
@pytest.mark.parametrize("stated", [True, False])
def test_an_encoder_that_wraps_before_a_gear_needs_its_turn(
    stated: bool, turn: int, hertz: int, tmp_path: Path
) -> None:
    """The joint of 35 deg was wrong by 36 deg, without a word at 500 Hz."""
    time = np.arange(0, 2, 1 / hertz)
    angle = np.radians(35) * np.sin(6 * np.pi * time)
    raw = np.mod(np.degrees(angle) * 50 * turn / 360 + turn / 9, turn)
    raw = np.where(turn == 4096, np.floor(raw), raw)
    lines = [f"{t:.6f},{n:.9f}" for t, n in zip(time, raw, strict=True)]
    words = {"column": "motor", "unit": f"{360 / turn / 50:.12f} deg", "offset": turn / 9}
    words |= {"turn": turn} if stated else {}
    mapping = {"time": TIME, "channels": [{**words, "name": "q.left_plunge"}]}
    found = imported(tmp_path, "\n".join(["t,motor", *lines, ""]), mapping)
    told = [one.text for one in found.findings if one.kind == "jump"]
    off = np.abs(column(found.path, "q.left_plunge") - angle).max()
    if stated:  # to one count of the encoder behind the gear, or to the digits of the text
        assert not told and off < np.radians(360 / 50 / 4096 if turn == 4096 else 1e-9)
        del lines[100:110]
        gone = imported(tmp_path, "\n".join(["t,motor", *lines, ""]), mapping)
        assert any("in a gap are not counted" in one.text for one in gone.findings)
    else:
        assert len(told) == 1 and "its `turn`" in told[0]


def test_drop_outs_and_steps_of_an_encoder_are_no_wraps(tmp_path: Path) -> None:
    time, draw = 0.002 * np.arange(1000), np.random.default_rng(0)
    dropped = np.where(np.isin(np.arange(1000) % 97, [5, 6]), 0.0, 40 + 30 * np.sin(20 * time))
    switched = 30 * np.sign(np.sin(20 * time)) + 0.1 * draw.normal(size=1000)
    for numbers in (dropped, switched):
        rows = [f"{t:.3f},{n:.9f}" for t, n in zip(time, numbers, strict=True)]
        words = {"time": TIME, "channels": [{"column": "a", "unit": "0.1 deg"}]}
        found = imported(tmp_path, "\n".join(["t,a", *rows, ""]), words)
        assert not any("wraps" in one.text for one in found.findings)


def test_a_vector_in_grams_and_a_turn_of_a_vector_are_refused() -> None:
    """Accelerations in `g`, which is a gram, were taken; `motion` then missed the accelerometer."""
    words = {"column": ["x", "y", "z"], "unit": "g", "frame": "flu", "name": "force"}
    with pytest.raises(LogError, match=r"unit: no vector is a mass: expected g_0 .* or gf"):
        parse_mapping({"time": TIME, "channels": [words]})
    with pytest.raises(LogError, match="turn: expected a single number, no vector"):
        parse_mapping({"time": TIME, "channels": [{**words, "unit": "deg/s", "turn": 360}]})
