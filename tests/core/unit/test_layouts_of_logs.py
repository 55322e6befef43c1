"""Logs as laboratories write them: the right numbers, or a refusal that names item and remedy."""

import base64
import csv
import re
import zlib
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import netCDF4
import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml
from numpy.typing import NDArray
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from patagium.cli.main import run
from patagium.errors import LogError
from patagium.robot import load_robot_text
from patagium.sensing.logs.files import table_files
from patagium.sensing.logs.files.channels import Request
from patagium.sensing.logs.files.opening import open_log
from patagium.sensing.logs.importing.findings import StampSurvey, stamp_findings
from patagium.sensing.logs.importing.import_log import import_log, read_table
from patagium.sensing.logs.importing.inspection import inspect_log
from patagium.sensing.logs.importing.restamp import restamped
from patagium.sensing.logs.mapping import parse_mapping
from patagium.sensing.logs.record import LogRecord, load_log
from patagium.sensing.logs.sensor_log import sensor_log

Array = NDArray[np.float64]
Words = dict[str, Any]
Draw = np.random.Generator


def turn(t: Array) -> Rotation:
    """Attitude of a body that yaws and rolls."""
    zero = np.zeros_like(t)
    return Rotation.from_euler("ZYX", np.column_stack([0.5 * t, zero, 0.4 * np.sin(2 * t)]))


def quaternion(t: Array) -> Array:
    found = turn(t).as_quat()[:, [3, 0, 1, 2]]
    return np.asarray(found * np.where(found[:, :1] < 0, -1, 1))


def rate(t: Array) -> Array:
    return np.column_stack([np.sin(5 * t), 2 * np.cos(3 * t), 0.5 + 0 * t])


def lift(t: Array) -> Array:
    return np.asarray(3 + np.sin(4 * t))[:, None]


class Case(NamedTuple):
    """A log, its mapping, and what an import must say.

    Attributes:
        log: The file.
        words: The mapping.
        right: Truth of each quantity as a function of time.
        error: Largest difference from it.
        refused: Words of the refusal: the item and the remedy.
        warned: Words of the only kind of warning.
    """

    log: Path
    words: Words
    right: dict[str, Callable[[Array], Array]] = {}
    error: float = 2e-8  # stamps are whole nanoseconds, changes up to 10 a second
    refused: tuple[str, ...] = ()
    warned: tuple[str, ...] = ()


Make = Callable[[Path, Draw], Case]
ATTITUDE: Words = {"column": "R", "order": "matrix", "frame": "nwu", "body": "flu", "name": "a"}
RATE: Words = {"column": "g", "unit": "rad/s", "frame": "flu", "name": "rate"}
LIFT: Words = {"column": "f", "unit": "N", "name": "lift"}
COLUMN: Words = {"column": "t", "unit": "s"}


def mapped(*columns: Words, **time: Any) -> Words:
    return {"time": {**COLUMN, **time}, "channels": list(columns)}


def clock(draw: Draw, count: int = 300, step: float = 0.01) -> Array:
    return float(draw.uniform(0, 5)) + step * np.arange(count)


# ---------------------------------------------------------------- arrays of unequal length (MAT)


def unequal(own: str, rated: bool, folder: Path, draw: Draw) -> Case:
    """A structure at 100 Hz and one at another rate, which names its stamps or not."""
    t, other = clock(draw), clock(draw, 700, 1 / 230)
    other += t[0] - other[0]
    cell = {"t": other, "f": lift(other)}
    held = {"imu": {"t": t, "g": rate(t)}, "cell": cell, "note": "wing 3", "gain": 2.0}
    savemat(folder / "log.mat", held)
    forces = {**LIFT, "column": "cell.f", **({"stamp": own} if own else {})}
    words = mapped({**RATE, "column": "imu.g"}, forces, column="imu.t")
    if rated:
        words["time"]["rate"] = "230 Hz"
    case = Case(folder / "log.mat", words, {"rate": rate, "lift": lift}, error=1e-3)  # linear
    if not own:
        return case._replace(refused=("cell.f", "stamp: cell.t", "rate"))
    return case if rated else case._replace(refused=("time: expected rate", "imu.t", "cell.t"))


def alone(folder: Path, draw: Draw) -> Case:
    """The shorter of two arrays alone, with its own stamps."""
    t, other = clock(draw), clock(draw, 120, 0.02)
    savemat(folder / "log.mat", {"t": t, "g": rate(t), "tf": other, "f": lift(other)})
    words = mapped(LIFT, column="tf")
    return Case(folder / "log.mat", words, {"lift": lift})


# ------------------------------------------------------------------------- rotation matrices


def matrices(layout: str, folder: Path, draw: Draw) -> Case:
    t = clock(draw)
    held = turn(t).as_matrix()
    words = dict(ATTITUDE)
    if layout == "(3,3,N)":
        held = np.moveaxis(held, 0, 2)
    elif layout == "(N,9)":
        held = held.reshape(-1, 9)
    elif layout == "(N,9) by columns":
        held, words["inverted"] = held.transpose(0, 2, 1).reshape(-1, 9), True
    elif layout == "world in body":
        held, words["inverted"] = held.transpose(0, 2, 1), True
    case = Case(folder / "log.mat", mapped(words), {"a": quaternion})
    if layout == "scaled":
        held = 1.1 * held
    elif layout == "mirrored":
        held = held * np.array([1, 1, -1])
    if layout in ("scaled", "mirrored"):
        remedy = ("a: expected rotation matrices", "determinant", "scaled or mirrored")
        case = case._replace(refused=remedy)
    if layout == "rounded":
        case, held = case._replace(error=0.01), held.round(2)
    if layout == "some broken":
        held[draw.choice(len(t), 20, replace=False)] = 7.0
        case = case._replace(warned=("20 of 300 rows are no rotation matrix", "left out"))
        case = case._replace(error=2e-3)  # between the rows beside those left out
    savemat(folder / "log.mat", {"t": t, "R": held})
    return case


def nine_columns(pattern: str, first: int, folder: Path, draw: Draw) -> Case:
    t = clock(draw)
    table: dict[str, Array] = {"t": t}
    for i in range(3):
        for j in range(3):
            table[pattern.format(i + first, j + first, k=3 * i + j)] = turn(t).as_matrix()[:, i, j]
    pd.DataFrame(table).to_csv(folder / "log.csv", index=False)
    return Case(folder / "log.csv", mapped(ATTITUDE), {"a": quaternion})


# ----------------------------------------------------------------------------- text lists


def lists(pattern: str, folder: Path, draw: Draw, *, damage: str = "") -> Case:
    """A column of lists beside a column of numbers."""
    t = clock(draw)
    cells = [pattern.format(*row) for row in rate(t).tolist()]
    if damage == "ragged":
        cells[200] = "[1.0, 2.0]"
    elif damage == "text":
        cells[250] = "[1.0, lost, 2.0]"
    elif damage == "empty":
        cells[40:60] = [""] * 20
    with (folder / "log.csv").open("w", newline="") as file:
        if damage == "bare":
            rows = zip(t.tolist(), cells, lift(t)[:, 0].tolist(), strict=True)
            file.write("t,g,f\n" + "".join(f"{a!r},{b},{c!r}\n" for a, b, c in rows))
        else:
            writer = csv.writer(file, delimiter=";" if damage == "semicolons" else ",")
            writer.writerow(["t", "g [rad/s]", "f"])
            writer.writerows(zip(t.tolist(), cells, lift(t)[:, 0].tolist(), strict=True))
    case = Case(folder / "log.csv", mapped(RATE, LIFT), {"rate": rate, "lift": lift})
    remedies = {
        "ragged": ("column g", "expected a list of 3 numbers", "row 201", "mend or remove"),
        "text": ("column g", "expected a list of 3 numbers", "row 251", "mend or remove"),
        "bare": ("expected 3 entries a line", "in quotes"),
    }
    case = case._replace(refused=remedies.get(damage, ()))
    return case._replace(warned=("20 of 300 rows",)) if damage == "empty" else case


def list_of_lists(folder: Path, draw: Draw) -> Case:
    t = clock(draw)
    cells = [str(row) for row in turn(t).as_matrix().tolist()]
    pd.DataFrame({"t": t, "R": cells}).to_csv(folder / "log.csv", index=False)
    return Case(folder / "log.csv", mapped(ATTITUDE), {"a": quaternion})


def parquet_lists(nested: bool, folder: Path, draw: Draw) -> Case:
    t = clock(draw)
    held = turn(t).as_matrix().tolist() if nested else rate(t).tolist()
    pytest.importorskip("pyarrow")
    pd.DataFrame({"t": t, "x": held, "who": "me"}).to_parquet(folder / "log.parquet")
    words = {**(ATTITUDE if nested else RATE), "column": [f"x[{k}]" for k in range(9)] if nested
             else "x"}  # fmt: skip
    right: dict[str, Callable[[Array], Array]] = {"a": quaternion} if nested else {"rate": rate}
    return Case(folder / "log.parquet", mapped(words), right)


# ------------------------------------------------------------------------------ preambles


def preamble(lines: list[str], folder: Path, draw: Draw, *, skip: int | None = None,
             units: str = "", mark: str = ",", head: str = "") -> Case:  # fmt: skip
    """Lines before the names, and perhaps a line of units below them."""
    t = clock(draw)
    rows = np.column_stack([t, rate(t), lift(t)]).tolist()
    text = "".join(f"{line}\n" for line in lines)
    text += head + mark.join(["t", "gx", "gy", "gz", "f"]) + "\n" + (f"{units}\n" if units else "")
    text += "".join(mark.join(map(repr, row)) + "\n" for row in rows)
    (folder / "log.csv").write_text(text)
    words = mapped({**RATE, "column": ["gx", "gy", "gz"]}, LIFT)
    if skip is not None:
        words["skip_rows"] = skip
    case = Case(folder / "log.csv", words, {"rate": rate, "lift": lift})
    return (
        case if skip in (None, len(lines)) else case._replace(refused=("more in row", "skip_rows"))
    )


def unnamed(folder: Path, draw: Draw) -> Case:
    t = clock(draw)
    np.savetxt(folder / "log.csv", np.column_stack([t, lift(t)]), delimiter=",")
    return Case(folder / "log.csv", mapped(LIFT), refused=("line of names", "write one above"))


LABVIEW = ["LabVIEW Measurement", "Operator,me", "Date,2024-01-01", "Channels,5", "", "Test,7"]


# -------------------------------------------------------------------- duplicates and jitter


def repeated(share: float, key: str | None, folder: Path, draw: Draw) -> Case:
    """Rows that repeat a stamp with other numbers, the right ones first or last."""
    t = clock(draw)
    table = pd.DataFrame({"t": t, "f": lift(t)[:, 0]})
    again = table.sample(frac=share, replace=share > 1, random_state=1)
    again["f"] = 99.0
    wrong_first = key == "keep-last"
    both = [again, table] if wrong_first else [table, again]
    both = pd.concat(both).sort_values("t", kind="stable")
    both.to_csv(folder / "log.csv", index=False)
    words = mapped(LIFT, **({"duplicates": key} if key else {}))
    case = Case(folder / "log.csv", words, {"lift": lift})
    if key is None:
        if share > 1:
            return case._replace(refused=("repeat a stamp", "duplicates: keep-first", "restamp"))
        return case._replace(warned=("with the stamp of the one before", "keep-last", "restamp"))
    return case


def jittered(kind: str, folder: Path, draw: Draw) -> Case:
    """Rows sampled at 100 Hz whose stamps tell when they were written."""
    sampled = clock(draw, 600)
    late = draw.uniform(-0.004, 0.004, 600)
    if kind == "burst":
        late[300:310] += np.linspace(0.2, 0.11, 10)  # the logger waited, then wrote ten rows
    given: Any = "100 Hz"
    stamps, kept = sampled + late, np.ones(600, bool)
    if kind == "lost rows":
        kept[200:217] = False
    elif kind == "rounded":
        stamps = np.round(sampled, 1)
    elif kind == "another rate":
        given = "90 Hz"
    elif kind == "far off":
        given = "1 kHz"
    elif kind == "with duplicates":
        stamps[1::2] = stamps[::2]
    pd.DataFrame({"t": stamps, "f": lift(sampled)[:, 0]})[kept].to_csv(
        folder / "log.csv", index=False, float_format="%.9f"
    )
    words = mapped(LIFT, restamp=given)
    if kind == "no stamps":
        words = mapped(LIFT, restamp=given, column="")
        return Case(folder / "log.csv", words, {"lift": lambda t: lift(t + sampled[0])})
    # the first stamp is known as well as the median of the jitter, 4 ms at most, and steps
    # of 0.1 s are known to half of that
    error = 4 * (0.051 if kind == "rounded" else 0.0051 if kind == "with duplicates" else 0.001)
    case = Case(folder / "log.csv", words, {"lift": lift}, error=error)
    if kind in ("another rate", "far off"):
        return case._replace(refused=("expected rows", "apart on average; say `restamp: ", "leave"))
    if kind == "lost rows":
        return case._replace(warned=("1 step(s) longer", "the longest 0.18 s", "not bridged"))
    return case


def two_streams(named: bool, folder: Path, draw: Draw) -> Case:
    t, other = clock(draw), clock(draw, 700, 1 / 230)
    other += t[0] - other[0]
    jitter = draw.uniform(-0.001, 0.001, 700)
    savemat(folder / "log.mat", {"t": t, "g": rate(t), "tf": other + jitter, "f": lift(other)})
    words = mapped(RATE, {**LIFT, "stamp": "tf"}, rate="230 Hz",
                   restamp={"tf": 230.0} if named else "230 Hz")  # fmt: skip
    case = Case(folder / "log.mat", words, {"rate": rate, "lift": lift}, error=2e-3)
    return case if named else case._replace(refused=("restamp", "a rate for each stream", "tf"))


# ------------------------------------------------------------- axes, ranges, wrenches, robots


def hover(t: Array, down: bool, size: float) -> Array:
    """Specific force of a body that hovers, z up or down."""
    sway = 0.05 * np.column_stack([np.sin(9 * t), np.cos(7 * t), np.sin(11 * t)])
    up = size * (sway + np.array([0.0, 0.0, 1.0]))
    return np.asarray(up * np.array([1, -1, -1]) if down else up)


def labelled(down: bool, frame: str, unit: str, folder: Path, draw: Draw) -> Case:
    """Specific force of a hover with z up or down, and a frame that says either."""
    t, size = clock(draw), 9.80665 if unit == "m/s^2" else 1.0
    force = hover(t, down, size)
    pd.DataFrame({"t": t, "a.x": force[:, 0], "a.y": force[:, 1], "a.z": force[:, 2]}).to_csv(
        folder / "log.csv", index=False
    )
    words = mapped({"column": "a", "unit": unit, "frame": frame, "name": "force"})
    case = Case(folder / "log.csv", words)
    if down == (frame == "frd"):
        return case._replace(right={"force": lambda t: hover(t, False, 9.80665)}, error=1e-7)
    return case._replace(warned=("feels 1 g up", "frd", "upside down"))


def ranged(reach: float, vector: bool, folder: Path, draw: Draw) -> Case:
    t = clock(draw)
    savemat(folder / "log.mat", {"t": t, "g": rate(t), "f": lift(t)})
    words = {**RATE, "range": [-reach, reach]} if vector else {**LIFT, "range": [0, reach]}
    case = Case(folder / "log.mat", mapped(words), {"rate": rate} if vector else {"lift": lift})
    beyond = reach < (2 if vector else 4)
    remedy = ("leave the stated range", "what the quantity can reach")
    return case._replace(warned=remedy) if beyond else case


def wrench(zero: bool, folder: Path, draw: Draw) -> Case:
    """A load cell under the robot, its zero not at zero, with the force of the robot on it."""
    t, tare = clock(draw), np.array([0.4, -1.2, 8.0]) if zero else np.zeros(3)
    shown = -rate(t) * np.array([1, -1, -1]) + tare
    names = ["Fx (N)", "Fy (N)", "Fz (N)"]
    table = pd.DataFrame(shown, columns=names).assign(**{"Time (s)": t})
    moments = 1e3 * (rate(t) * np.array([1, -1, -1]) + tare)
    table = table.assign(**dict(zip(("Tx", "Ty", "Tz"), moments.T, strict=True)))
    table.to_csv(folder / "log.csv", index=False)
    force = {"column": ["Fx", "Fy", "Fz"], "unit": "N", "frame": "frd", "negated": True,
             "name": "cell.force", "range": [-10, 10]}  # fmt: skip
    moment = {"column": ["Tx", "Ty", "Tz"], "unit": "N mm", "frame": "frd", "name": "cell.moment"}
    if zero:
        force["offset"], moment["offset"] = tare.tolist(), (1e3 * tare).tolist()
    words = mapped(force, moment, column="Time")
    return Case(folder / "log.csv", words, {"cell.force": rate, "cell.moment": rate}, error=2e-8)


WING = """
name: one-wing
gravity: 9.81 m/s^2
bodies:
  body:
    floating: true
    mass: 20 g
    inertia: {xx: 4e-5 kg m^2, yy: 4e-5 kg m^2, zz: 4e-5 kg m^2}
  wing:
    parent: body
    joints: [{name: flap, axis: x}]
    mass: 1 g
    center_of_mass: [0, 10 cm, 0]
    inertia: {xx: 1e-6 kg m^2, yy: 1e-6 kg m^2, zz: 1e-6 kg m^2}
wings:
  - name: left
    segments:
      - body: wing
        strips: 2
        stations:
          - {span: 0 cm, leading: 2 cm, trailing: -2 cm}
          - {span: 20 cm, leading: 2 cm, trailing: -2 cm}
"""
DOFS = ("x", "y", "z", "roll", "pitch", "yaw", "flap")


def flown(kind: str, folder: Path, draw: Draw) -> Case:
    """A flight of a robot in a file beside the mapping."""
    t = clock(draw)
    (folder / "robots").mkdir()
    (folder / "robots" / "wing.yaml").write_text(WING)
    table, columns = {"t": t}, []
    for part in ("q", "v", "a", "u1"):
        for k, dof in enumerate(DOFS):
            if kind == "no joint" and (part, dof) == ("q", "flap"):
                continue
            length = "m" if k < 3 else "rad"
            unit = {"q": "", "v": "/s", "a": "/s^2"}.get(part)
            written = ("N" if k < 3 else "N m") if unit is None else length + unit
            still = kind == "joint at rest" and dof == "flap"
            turn, order = (k + 1) * t, {"v": 1, "a": 2}.get(part, 0)  # of the derivative
            value = (k + 1) ** order * np.sin(turn + order * np.pi / 2)
            table[f"{part}_{dof}"] = 0 * t if still else value
            columns.append({"column": f"{part}_{dof}", "unit": written, "name": f"{part}.{dof}"})
    pd.DataFrame(table).to_csv(folder / "log.csv", index=False)
    words = {**mapped(*columns), "robot": "robots/wing.yaml"}
    case = Case(folder / "log.csv", words, {"q.roll": lambda t: np.sin(4 * t)[:, None]})
    if kind == "no file":
        words["robot"] = "robots/wings.yaml"
        return case._replace(refused=("robot", "path from the mapping file", "wings.yaml"))
    if kind != "measured":
        return case._replace(warned=("flap", "strips are pointless", "--network dense"))
    return case


CASES: dict[str, Make] = {
    "mat unequal, own stamps": partial(unequal, "cell.t", True),
    "mat unequal, no own stamps": partial(unequal, "", True),
    "mat unequal, no rate": partial(unequal, "cell.t", False),
    "mat unequal, the shorter alone": alone,
    **{f"mat matrices {layout}": partial(matrices, layout) for layout in (
        "(N,3,3)", "(3,3,N)", "(N,9)", "(N,9) by columns", "world in body", "scaled", "mirrored",
        "rounded", "some broken",
    )},
    **{f"csv matrix {pattern.format(first, first, k=0)}": partial(nine_columns, pattern, first)
       for pattern, first in (("R{}{}", 1), ("R{}{}", 0), ("R_{}{}", 1), ("R.{}{}", 0),
                              ("R[{}][{}]", 0), ("R[{k}]", 0), ("R_{k}", 0))},
    **{f"csv lists {pattern}": partial(lists, pattern) for pattern in (
        "[{}, {}, {}]", "({},{},{})", "[{} {} {}]", "{} {} {}", "[{}; {}; {}]",
    )},
    **{f"csv lists, {damage}": partial(lists, "[{}, {}, {}]", damage=damage) for damage in (
        "ragged", "text", "empty", "bare", "semicolons",
    )},
    "csv list of lists": list_of_lists,
    "parquet lists": partial(parquet_lists, False),
    "parquet lists of lists": partial(parquet_lists, True),
    "preamble found": partial(preamble, LABVIEW),
    "preamble stated": partial(preamble, LABVIEW, skip=6),
    "preamble misstated": partial(preamble, LABVIEW, skip=2),
    "preamble of one line": partial(preamble, ["# written by me"]),
    "preamble of numbers": partial(preamble, ["rate,500", "gain,2.5", "date,20240101", "1,2"]),
    "preamble with tabs": partial(preamble, ["my file", "x\ty"], mark="\t"),
    "preamble of a spreadsheet": partial(
        preamble, ["My log,,,,", "Operator,me,you,them,us", "Rate,500,,,", ",,,,"]),
    "preamble above spaces": partial(preamble, ["my file", "# 500 Hz"], mark=" "),
    "preamble above semicolons": partial(preamble, ["a,b,c,d,e", "x"], mark=";"),
    "names after a sign, spaces": partial(preamble, [], mark=" ", head="# "),
    "no names": unnamed,
    "names after a sign": partial(preamble, [], head="# "),
    "line of units": partial(preamble, LABVIEW, units="s,rad/s,rad/s,rad/s,N"),
    "line of units in brackets": partial(preamble, [], units="[s],[rad/s],[rad/s],[rad/s],[N]"),
    **{f"duplicates {share} {key}": partial(repeated, share, key) for share, key in (
        (0.3, None), (0.3, "keep-first"), (0.3, "keep-last"), (4.0, None), (4.0, "keep-first"),
        (4.0, "keep-last"),
    )},
    **{f"restamp, {kind}": partial(jittered, kind) for kind in (
        "jitter", "burst", "lost rows", "rounded", "another rate", "far off", "with duplicates",
        "no stamps",
    )},
    **{f"z {'down' if down else 'up'}, labelled {frame} [{unit}]": partial(
        labelled, down, frame, unit) for down, frame, unit in (
        (True, "flu", "m/s^2"), (True, "frd", "m/s^2"), (False, "frd", "g_0"),
        (False, "flu", "g_0"), (True, "nwu", "g_0"),
    )},
    **{f"range {reach} of a {'vector' if vector else 'number'}": partial(ranged, reach, vector)
       for reach, vector in ((2.0, True), (1.5, True), (4.0, False), (3.5, False))},
    "wrench": partial(wrench, False),
    "wrench with its zero": partial(wrench, True),
    **{f"flight, {kind}": partial(flown, kind)
       for kind in ("measured", "no joint", "joint at rest", "no file")},
    "restamp of one of two streams": partial(two_streams, True),
    "restamp of an unnamed stream": partial(two_streams, False),
}  # fmt: skip


def seeded(name: str) -> Draw:
    return np.random.default_rng(sum(name.encode()))


@pytest.mark.parametrize("name", CASES)
def test_layouts(name: str, tmp_path: Path) -> None:
    """The right numbers, or a refusal with the remedy; `inspect` lists what is there."""
    case = CASES[name](tmp_path, seeded(name))
    mapping, out = tmp_path / "map.yaml", tmp_path / "out.nc"
    mapping.write_text(yaml.safe_dump(case.words), encoding="utf-8")
    inspect_log(case.log)
    if case.refused:
        with pytest.raises(LogError) as refusal:
            import_log(case.log, mapping, out)
        missing = [words for words in case.refused if words not in str(refusal.value)]
        assert not missing, str(refusal.value)
        assert not out.exists()
        return
    found = import_log(case.log, mapping, out)
    with LogRecord(out) as record:
        time = record.time() + int(record._file.time_origin_ns) * 1e-9
        for label, truth in case.right.items():
            names = tuple(one for one in record.labels if one.rpartition(".")[0] == label)
            values = record.values(names or (label,))
            if label == "a":  # of either sign
                values = values * np.sign((values * truth(time)).sum(axis=1))[:, None]
            np.testing.assert_allclose(values, truth(time), atol=case.error, rtol=0)
    warnings = [one.text for one in found.findings if one.level == "warning"]
    assert bool(case.warned) == bool(warnings), warnings
    assert all(words in text for text in warnings for words in case.warned), warnings


LATE: dict[str, Callable[[Array, Draw], Array]] = {
    "one stall": lambda t, draw: np.where((t > 2) & (t < 2.1), 2.1, t),
    "latency": lambda t, draw: np.maximum.accumulate(t + draw.exponential(1e-3, len(t))),
    **{f"blocks of {size}": partial(lambda size, t, draw: np.floor(t / size) * size, 1e-3 * size)
       for size in (16, 64, 100, 128, 200)},
    "blocks of 256": lambda t, draw: t[np.minimum(np.arange(len(t)) | 255, len(t) - 1)],
}  # fmt: skip


@pytest.mark.parametrize(("kind", "lost"), [*((kind, 0) for kind in LATE), ("one stall", 30)])
def test_rows_that_are_written_late_are_not_lost(kind: str, lost: int) -> None:
    """Stalls, blocks and latency were taken for lost rows, and the true rate was refused."""
    rows = np.delete(np.arange(6000), slice(4000, 4000 + lost))
    stamps = np.rint(1e9 * LATE[kind](1e-3 * rows, seeded(kind))).astype(np.int64)
    found, words = restamped(stamps, 1000.0, 3.0, "log")
    assert (f"{lost} row(s) as lost in 1 gap" if lost else "and none as lost") in words
    np.testing.assert_array_equal(np.diff(found), np.diff(rows) * 10**6)


@pytest.mark.parametrize(
    ("rows", "rate"), [(1, "1000 Hz"), (7, "1000 Hz"), (200, "1000 Hz"), (600, "RATE")]
)
def test_the_rate_to_restamp_by_counts_rows_of_whole_stamps(rows: int, rate: str) -> None:
    """The proposed rate was too high: 1005 Hz for rows of 1000 Hz, and nan Hz for one stamp."""
    survey = StampSurvey()
    for block in np.array_split(np.arange(600) // rows * rows * 10**6, 4):
        survey.add(block)
    words = [one.text for one in stamp_findings("log", survey, 3.0, written=False)]
    assert all(f"`restamp: {rate}` if" in one for one in words) and bool(words) == (rows > 1)


@pytest.mark.parametrize("shared", [1, 5])
def test_the_rate_to_restamp_by_holds_where_a_clock_was_set_back(shared: int) -> None:
    """Rows of both clocks were divided by the time of the later stamps: 167 Hz for 100 Hz."""
    time = np.arange(6000) // shared * shared * 10**7
    time[3000:] -= 24 * 10**9
    time[100] = time[99]
    survey = StampSurvey()
    for block in np.array_split(time, 7):
        survey.add(block)
    words = [one.text for one in stamp_findings("log", survey, 3.0, written=False)]
    rates = [float(one) for text in words for one in re.findall("restamp: (.*) Hz", text)]
    assert len(rates) == 2 and rates == pytest.approx([100.0, 100.0], rel=0.01)


@pytest.mark.parametrize("rate", [95.0, 98.0, 99.0, 103.0])
def test_rows_of_a_slower_rate_are_not_taken_for_lost_ones(rate: float) -> None:
    """Rows that came late counted as lost: 98.95 Hz was proposed for 98 Hz, 96.9 for 95."""
    rng = seeded("slower")
    stamps = np.maximum.accumulate(np.arange(10000) / rate + rng.exponential(0.02, 10000))
    with pytest.raises(LogError, match="say `restamp: ") as told:
        restamped(np.rint(1e9 * stamps).astype(np.int64), 100.0, 3.0, "log")
    found = float(re.findall("`restamp: (.*) Hz", str(told.value))[0])
    assert found == pytest.approx(rate, rel=3e-4)  # three steps over the log are no drift


def test_a_wrong_rate_is_answered_with_the_right_one(tmp_path: Path) -> None:
    case = CASES["restamp, far off"](tmp_path, seeded("rate"))
    with pytest.raises(LogError) as refusal:
        import_log(case.log, parse_mapping(case.words), tmp_path / "out.nc")
    said = re.search(r"restamp: ([0-9.]+) Hz", str(refusal.value))
    assert said is not None and float(said[1]) == pytest.approx(100.0, rel=1e-3)
    again = mapped(LIFT, restamp=f"{said[1]} Hz")
    import_log(case.log, parse_mapping(again), tmp_path / "out.nc")


def test_nothing_is_omitted_by_inspect(tmp_path: Path) -> None:
    """Every entry of a file is a number with statistics, or is listed with a reason."""
    t = np.arange(50) / 100
    held = {"t": t, "z": t + 1j, "who": "me", "one": 1.0, "deep": np.zeros((2, 2, 2, 50)),
            "wide": np.zeros((100, 70)), "short": t[:20]}  # fmt: skip
    savemat(tmp_path / "log.mat", held)
    found = inspect_log(tmp_path / "log.mat")
    placed = {one.name for topic in found.topics for one in topic.channels}
    reasons = {name: why for topic in found.topics for name, why in topic.unplaced.items()}
    assert {"t", "short", "wide[0]", "wide[63]"} <= placed
    assert set(reasons) == {"z", "who", "one", "deep", "wide"}
    assert "complex" in reasons["z"] and "70 columns" in reasons["wide"]


def test_inspect_goes_on_without_a_column_that_turns_to_text(tmp_path: Path) -> None:
    table = pd.DataFrame({"t": np.arange(400) / 100, "f": 1.0, "g": 2.0}).astype(object)
    table.loc[350, "f"] = "lost"  # below the lines that are looked at first
    table.to_csv(tmp_path / "log.csv", index=False)
    (topic,) = inspect_log(tmp_path / "log.csv").topics
    assert [one.name for one in topic.channels] == ["t", "g"] and topic.rows == 400
    assert "found 'lost' in row 351" in topic.unplaced["f"]


def test_a_message_lists_what_is_no_number(recordings: Any, tmp_path: Path) -> None:
    bag = recordings.ros2(tmp_path / "bag")
    topics = {one.name: one for one in inspect_log(bag).topics}
    assert topics["/joints"].unplaced["effort"] == "a list that is empty in the first message"
    assert set(topics["/joints"].unplaced) == {"effort", "name[left_plunge]", "name[right_plunge]"}


def test_a_preamble_is_no_matter_for_a_plain_table(tmp_path: Path) -> None:
    case = CASES["preamble found"](tmp_path, seeded("plain"))
    words: Words = {"time": COLUMN, "inputs": [{"column": "gx", "unit": "rad/s"}],
                    "outputs": [LIFT]}  # fmt: skip
    table = read_table(case.log, parse_mapping(words))
    assert table.x.shape == (300, 1) and not len(table.gaps)


def test_microseconds_of_a_slow_ulog_topic_are_no_alarm(recordings: Any, tmp_path: Path) -> None:
    """Topics every ten seconds: the format, and no person, says that stamps are microseconds."""
    log = recordings.ulog(tmp_path / "log.ulg", 60, 10_000_000_000)
    assert not [one for one in inspect_log(log).findings if one.level == "warning"]
    words: Words = {"channels": [{"topic": "imu", "field": "gyro", "frame": "frd",
                                  "unit": "rad/s"}]}  # fmt: skip
    assert not import_log(log, parse_mapping(words), tmp_path / "out.nc").findings
    words["time"] = {"column": "timestamp", "unit": "s"}  # of a person, and wrong
    found = import_log(log, parse_mapping(words), tmp_path / "out.nc").findings
    assert {one.kind for one in found} == {"unit of time", "unit"}
    words["time"] = {"column": "timestamp"}  # in the unit of the format
    assert not import_log(log, parse_mapping(words), tmp_path / "out.nc").findings


@pytest.mark.parametrize(("unit", "kinds"), [("m/s^2", set()), ("m/s", set()), ("N", {"unit"})])
def test_a_twist_may_hold_accelerations(
    unit: str, kinds: set[str], recordings: Any, tmp_path: Path
) -> None:
    bag = recordings.ros2(tmp_path / "bag")
    words = {"channels": [{"topic": "/velocity", "field": "twist.linear", "frame": "nwu",
                           "unit": unit}]}  # fmt: skip
    found = import_log(bag, parse_mapping(words), tmp_path / "out.nc").findings
    assert {one.kind for one in found} == kinds


@pytest.mark.parametrize(
    ("head", "unit"),
    [("Zeit [ms]", 1e3), ("Temps [s]", 1.0), ("time_boot_ms", 1e3), ("time/s", 1.0),
     ("time in us", 1e6), ("Time [min]", 1 / 60), ("delay [ms]", None), ("zeit", None)],
)  # fmt: skip
def test_a_first_column_with_a_unit_of_time_is_time(
    head: str, unit: float | None, tmp_path: Path
) -> None:
    time = np.arange(0.0, 2.0, 0.01)
    rows = np.column_stack([time * (unit or 1.0), np.sin(time)])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=";", header=f"{head};lift [N]", comments="")
    (topic,) = inspect_log(tmp_path / "log.csv").topics
    assert topic.stamps == ("rows" if unit is None else head)
    assert unit is None or (topic.rate, topic.duration) == pytest.approx((100.0, 1.99))


def test_an_index_column_without_a_name_is_no_matter(tmp_path: Path) -> None:
    pd.DataFrame({"t": np.arange(50) / 100, "f": 1.0 * np.arange(50)}).to_csv(tmp_path / "log.csv")
    import_log(tmp_path / "log.csv", parse_mapping(mapped(LIFT)), tmp_path / "out.nc")
    with LogRecord(tmp_path / "out.nc") as record:
        np.testing.assert_array_equal(record.values(("lift",))[:, 0], np.arange(50))


def test_a_table_that_cannot_be_read_is_listed_with_the_remedy(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,g,f\n0,[1,2,3],4\n1,[2,3,4],5\n")
    (topic,) = inspect_log(tmp_path / "log.csv").topics
    assert "expected 3 entries a line" in topic.problem and "in quotes" in topic.problem


def test_sensors_are_found_in_a_log_that_is_a_flight(tmp_path: Path) -> None:
    case = CASES["flight, measured"](tmp_path, seeded("flight"))
    mapping = tmp_path / "map.yaml"
    mapping.write_text(yaml.safe_dump(case.words), encoding="utf-8")
    path = import_log(case.log, mapping, tmp_path / "out.nc").path
    for log in (path, load_log(path)):
        found = sensor_log(log)
        assert list(found.readings) == ["cameras of body", "encoders", "joint forces"]
        flap = found.readings["encoders"]["position"].to_numpy()[:, 0]
        with LogRecord(path) as record:
            np.testing.assert_array_equal(flap, record.values(("q.flap",))[:, 0])


def test_text_logs_of_ardupilot_are_answered_with_the_command(tmp_path: Path) -> None:
    (tmp_path / "7.log").write_text("FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n")
    with pytest.raises(LogError, match="mavlogdump.py --format mat --mat_file log.mat 7.log"):
        inspect_log(tmp_path / "7.log")


def test_ranges_are_checked_in_a_plain_table(tmp_path: Path) -> None:
    told: list[Any] = []
    pd.DataFrame({"t": np.arange(50) / 100, "g": 5.0, "f": 1.0}).to_csv(tmp_path / "log.csv")
    words: Words = {"time": COLUMN, "inputs": [{**RATE, "range": [-2, 2], "frame": None}],
                    "outputs": [{**LIFT, "range": [0, 1]}]}  # fmt: skip
    read_table(tmp_path / "log.csv", parse_mapping(words), told.extend)
    beyond = [one for one in told if one.kind == "range"]
    assert [one.where for one in beyond] == ["rate"] and "50 of 50 rows leave" in beyond[0].text


def test_the_reason_is_in_the_refusal_of_what_is_no_number(tmp_path: Path) -> None:
    pd.DataFrame({"t": np.arange(50) / 100, "f": "high"}).to_csv(tmp_path / "log.csv")
    with pytest.raises(LogError, match="'f' cannot be read as numbers: text such as 'high'"):
        import_log(tmp_path / "log.csv", parse_mapping(mapped(LIFT)), tmp_path / "out.nc")


H5PY = zlib.decompress(
    base64.b85decode(
        "c-rgqaB<`1lHy|K;9!7(|4?896*7Q|pWSp+%-_Q$h>4+sNeEdX3~(_qFfuT(@h|`>#*)oYZEOM{K5KG*X<o^"
        "GMyQw|NQ|wxB(Wql<unsir91;6keTRw3+x1-1&ksL3`~rSjI2;O7|krgz$mC-&j4|~1A_@SgUNqppghoZ%v>"
        "Bmmoqa$B^fke25(>(a^UA)o}C24f`@?-82k*75EeiQ0}W^xaKQ}R!7yY&^yzi4C<zNAw6G8rVqn2c-#ltSwG"
        "7-0JRr$<x6GWJu*96wR0d>IK{POtR}5TO^oABZXBY*eU=)l3(!d3K2>k#`zkt#o>_LSZs0f4<Zx9v$o1|J4"
    )
)
"""HDF5 file as h5py writes it: `t`, and 0, 1, 65535, 65535, 2 as `count` and as `stated`, whose
_FillValue is 1."""


@pytest.mark.parametrize("writer", ["h5py", "MATLAB", "netCDF"])
def test_values_that_netcdf_fills_with_are_numbers_in_hdf5(writer: str, tmp_path: Path) -> None:
    """A converter at its limit, 65535 in 16 bits, was taken for a missing number."""
    path = tmp_path / ("log.mat" if writer == "MATLAB" else "log.h5")
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512, b"\0") * (writer == "MATLAB") + H5PY)
    if writer == "netCDF":
        with netCDF4.Dataset(path, "w") as file:
            file.createDimension("t", 5)
            file.createVariable("t", "f8", ("t",))[:] = 0.25 * np.arange(5)
            file.createVariable("count", "u2", ("t",))[:2] = [0, 1]
            file["count"][4] = 2
            file.createVariable("stated", "u2", ("t",), fill_value=1)[:] = [0, 1, 65535, 65535, 2]
    with closing(open_log(path)) as log:
        (block,) = log.blocks((Request("", log.topics[""].base, ("count", "stated")),))
    top = np.nan if writer == "netCDF" else 65535
    expected = [[0, 1, top, top, 2], [0, np.nan, 65535, 65535, 2]]
    np.testing.assert_array_equal(block.values.T, expected)


CELLS = zlib.decompress(
    base64.b85decode(
        "c-rgqaB<`1lHy_j0S*oZ76t(ZWbhvf7<ke6P>=wn8KHCslwQFE6K4d=NkGK~q2{Bj3kh;{1*!gz24MC?us~=Ih"
        "EXsQfrqPO05}~$`5I9A1QV*d5-6RTTToI7q?L<O(~6ZD7?M+Sa*C1CsR5DpGBU72^f1Eskd(~G2oYd~s)NzYKz"
        "Wdipn^R#tvWE6a5I?vXNIZc0LwEmF)>2YGsHY*Mgta9pE022sKE#>*hA<CQ2GUw{$L;M=kLM@EKOkf{s0?lIq?"
        "F@=ir3U3NUeQ{5HZ$rv<F|)xpXM1?Hih?im@_@TNal@@ImlKLM~(0eBcV5J-0$*ib_j0(clKp!V?s*&GbMjv+p"
        "dPVum81y;?76w-`n^#B7y0G+}Id;Nl*z6jMX3%Ew>m(ltKQNO@)g9az6x<s^e?m=<-WhF6xlUu(`;KG*A2Y3Af"
        "t4A2&`Lcm?G_BGiouQZC%+Pcs4lNULr>h@4*h|hCgE~B5=?DP6s$xL"
    )
)
"""HDF5 file with `t`, five quarters of a second, and cells and an empty array as MATLAB has them:
references into the group #refs#, and the two sizes."""


def test_cells_and_empty_arrays_of_matlab_are_told(tmp_path: Path) -> None:
    """Cells of 7.3 were absent without a word; the sizes of an empty array were two numbers."""
    path = tmp_path / "log.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512, b"\0") + CELLS)
    (table,) = inspect_log(path).topics
    assert [one.name for one in table.channels] == ["t"] and table.rows == 5
    assert "empty array" in table.unplaced["empty"] and "cells" in table.unplaced["#refs#"]


@pytest.mark.parametrize("timed", [True, False])
def test_arrays_without_stamps_are_not_in_the_mapping_beside_others(
    timed: bool, tmp_path: Path
) -> None:
    """Gains beside the samples became the output, with `rows`, which is no column, as stamp."""
    t = 0.005 * np.arange(300)
    held = {"t" if timed else "x": t, "y": np.sin(t), "gains": np.arange(3.0)}
    savemat(tmp_path / "log.mat", held)
    words = tmp_path / "map.yaml"
    with pytest.raises(SystemExit) as left:
        run(["inspect", str(tmp_path / "log.mat"), "-o", str(words)])
    assert left.value.code in (0, None)
    written = words.read_text("utf-8").replace("??? Hz", "200 Hz")  # as it asks for
    assert "gains" not in written and ("200 Hz" in written)
    words.write_text(written, "utf-8")
    assert import_log(tmp_path / "log.mat", words, tmp_path / "log.nc").samples == 300


@pytest.mark.parametrize("matlab", [False, True])
def test_arrays_in_groups_of_hdf5_are_columns(matlab: bool, tmp_path: Path) -> None:
    """As h5py and MATLAB 7.3 write them, MATLAB with its axes reversed behind a head of its own."""
    t = 0.01 * np.arange(300)
    turned = np.stack([np.sin(t), np.cos(t), 0.5 * t], axis=1)
    path = tmp_path / ("log.mat" if matlab else "log.h5")
    with netCDF4.Dataset(path, "w") as file:
        group = file.createGroup("imu")
        for size in (1, 3, 300):
            file.createDimension(f"d{size}", size)
        dims = {"t": ("d1", "d300"), "gyro": ("d3", "d300")}
        for name, values in {"t": t[:, None], "gyro": turned}.items():
            held = dims[name] if matlab else dims[name][::-1]
            column = group.createVariable(name, "f8", held)
            column[:] = values.T if matlab else values
            column.units = {"t": "s", "gyro": "rad/s"}[name]
        file.createVariable("note", str, ("d1",))[:] = np.array(["wing 3"], object)
    if matlab:
        path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512, b"\0") + path.read_bytes())
    words = parse_mapping(mapped({**RATE, "column": "imu.gyro"}, column="imu.t"))
    log = load_log(import_log(path, words, tmp_path / "log.nc").path)
    np.testing.assert_allclose(log["rate"].values, turned, atol=1e-9)  # ns of stamps
    seen = inspect_log(path).topics[0]
    assert "note" in seen.unplaced
    assert {one.name: one.unit for one in seen.channels}["imu.gyro[0]"] == "rad/s"
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(LogError, match=r"save\(" if matlab else "savemat"):
        inspect_log(path)


@pytest.mark.parametrize(
    "written", ["%H:%M:%S.%f", "%m/%d/%Y %I:%M:%S.%f %p", "%Y-%m-%dT%H:%M:%S.%f"]
)
def test_times_of_the_day_go_on_after_midnight(
    written: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They were no time at all, and the rows had to be restamped."""
    monkeypatch.setattr(table_files, "BLOCK", 40)
    t = 0.01 * np.arange(300) + 1e-3 * np.arange(300) % 3e-3  # uneven, so that no rate will do
    stamps = pd.Timestamp("2026-03-01 23:59:58.5") + pd.to_timedelta((1e6 * t).round(), unit="us")
    table = pd.DataFrame({"Time": stamps.strftime(written), "f [N]": lift(t).ravel()})
    table.to_csv(tmp_path / "log.csv", index=False)
    words = parse_mapping({"time": {"column": "Time"}, "channels": [LIFT]})
    log = load_log(import_log(tmp_path / "log.csv", words, tmp_path / "log.nc").path)
    np.testing.assert_allclose(log["time"].values, t, atol=1e-6)  # digits of the stamps
    np.testing.assert_allclose(log["lift"].values, lift(t).ravel(), rtol=1e-12)


def test_names_of_labview_are_found_above_lines_without_a_comment(tmp_path: Path) -> None:
    """The name Comment, without values, made another line of the header the line of names."""
    head = (
        "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\n***End_of_Header***\t\n\t\n"
    )
    head += "Channels\t2\t\t\nSamples\t300\t300\t\nY_Unit_Label\tN\tNewton Meters\t\n"
    head += "***End_of_Header***\t\t\t\nX_Value\tFz\tMx\tComment\n"
    rows = [f"{0.01 * k:.6f}\t{np.sin(k):.6f}\t{np.cos(k):.6f}\n" for k in range(300)]
    rows[7] = rows[7].replace("\n", "\tthe motor starts\n")
    (tmp_path / "log.lvm").write_text(head + "".join(rows).replace(".", ","), encoding="utf-8")
    columns = [{"column": "Fz", "unit": "N"}, {"column": "Mx", "unit": "N m"}]
    words = parse_mapping(mapped(*columns, column="X_Value"))
    log = load_log(import_log(tmp_path / "log.lvm", words, tmp_path / "log.nc").path)
    assert log.sizes["time"] == 300
    np.testing.assert_allclose(log["Fz"], np.sin(np.arange(300)), atol=1e-6)


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16", "utf-8-sig"])
def test_names_in_the_encodings_of_windows_are_read(encoding: str, tmp_path: Path) -> None:
    """LabVIEW and Excel on Windows write degrees in their own code pages."""
    rows = "".join(f"{k / 100:.2f};{k % 7},5\n".replace(".", ",") for k in range(100))
    (tmp_path / "log.lvm").write_text(f"Zeit [s];Winkel [°]\n{rows}", encoding=encoding)
    topic = inspect_log(tmp_path / "log.lvm").topics[0]
    assert topic.stamps == "Zeit [s]" and topic.channels[1].unit == "°"
    assert (topic.channels[1].low, topic.channels[1].high) == (0.5, 6.5)


@pytest.mark.parametrize("ids", [("A1", "B2"), ("1", "2")])
def test_an_export_of_motive_says_what_its_columns_are(
    ids: tuple[str, str], tmp_path: Path
) -> None:
    """Two columns without a name, or ids that are numbers, hid the line of names."""
    head = [
        "Format Version,1.23,Capture Frame Rate,100.0,Length Units,Meters",
        "",
        ",Type" + 8 * ",Rigid Body" + 4 * ",Marker",
        ",Name" + 8 * ",bird" + 4 * ",bird:1",
        ",ID" + 8 * f",{ids[0]}" + 4 * f",{ids[1]}",
        "," + 4 * ",Rotation" + 3 * ",Position" + ",Error" + 3 * ",Position" + ",Quality",
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z,",
    ]
    rows = [f"{k},{k / 100},0,0,0,1,{k},2,3,0.1,{k},5,6,1" for k in range(100)]
    (tmp_path / "log.csv").write_text("\n".join([*head, *rows]) + "\n")
    seen = inspect_log(tmp_path / "log.csv")
    assert seen.topics[0].rows == 100 and seen.topics[0].rate == pytest.approx(100.0)
    (note,) = [one for one in seen.notes if one.startswith("the lines above")]
    first, second = ("" if one.isdigit() else f" {one}" for one in ids)
    assert f"X, Y, Z, W: 'Rigid Body bird{first} Rotation'" in note
    assert f"X.2, Y.2, Z.2: 'Marker bird:1{second} Position'" in note


def test_markers_above_an_export_of_vicon_are_told(tmp_path: Path) -> None:
    head = ["Trajectories", "100", ",,wing:tip,,,wing:root,,", "Frame,Sub Frame,X,Y,Z,X,Y,Z"]
    rows = [f"{k},0,{k},2,3,{k},5,6" for k in range(100)]
    text = "\n".join([*head, ",,mm,mm,mm,mm,mm,mm", *rows]) + "\n"
    (tmp_path / "log.csv").write_text(text)
    notes = " ".join(inspect_log(tmp_path / "log.csv").notes)
    assert "X, Y, Z: 'wing:tip'; X.1, Y.1, Z.1: 'wing:root'" in notes


def test_tables_of_a_vicon_export_are_topics_with_their_rates(tmp_path: Path) -> None:
    plate = ["Devices", "1000", ",,Plate - Force,,", "Frame,Sub Frame,Fx,Fy,Fz", ",,N,N,N"]
    plate += [f"{1 + k // 10},{k % 10},{np.sin(0.01 * k):.12f},0.1,-0.2" for k in range(400)]
    poses = ["Trajectories", "100", ",,bird:nose,,", "Frame,Sub Frame,X,Y,Z", ",,mm,mm,mm"]
    poses += [f"{1 + k},0,{k},2,3" for k in range(40)]
    file = tmp_path / "log.csv"
    for parts in ((plate, poses), (poses, plate)):
        file.write_text("\r\n\r\n".join("\r\n".join(part) for part in parts) + "\r\n")
        rates = {one.name: (one.rows, one.rate) for one in inspect_log(file).topics}
        assert rates["Devices"] == (400, pytest.approx(1000.0))
        assert rates["Trajectories"] == (40, pytest.approx(100.0))
        words = {
            "time": {"rate": "1000 Hz"},
            "channels": [
                {"topic": "Devices", "field": "Fx", "unit": "N"},
                {"topic": "Trajectories", "field": "X", "unit": "mm", "name": "nose"},
            ],
        }
        import_log(file, parse_mapping(words), tmp_path / f"{parts[0][0]}.nc")
        log = load_log(tmp_path / f"{parts[0][0]}.nc")
        time = log.time.values
        assert np.allclose(log["Fx"], np.sin(10.0 * time), atol=1e-9)
        assert np.allclose(log["nose"], 0.1 * time)


@pytest.mark.parametrize(("named", "timed"), [(True, False), (False, True), (False, False)])
def test_an_export_of_qualisys_without_names(named: bool, timed: bool, tmp_path: Path) -> None:
    head = ["NO_OF_FRAMES\t40", "NO_OF_MARKERS\t2", "FREQUENCY\t200", "TIME_STAMP\t2024-03-05\t9.1"]
    head += ["MARKER_NAMES" + "\tnose\ttail" * named, "TRAJECTORY_TYPES\tMeasured\tMeasured"]
    rows = [f"{k + 1}\t{k / 200}\t" * timed + f"{k}.0\t1\t2\t{k}.5\t4\t5" for k in range(40)]
    (tmp_path / "log.tsv").write_text("\n".join([*head, *rows]) + "\n")
    found = inspect_log(tmp_path / "log.tsv")
    (topic,) = found.topics
    last = "tail X" if named else "marker 2 X"
    (column,) = [one for one in topic.channels if one.name == last]
    assert topic.rows == 40 and (column.low, column.high) == (0.5, 39.5)
    assert any("no line of names" in note for note in found.notes)


def test_a_second_robot_or_command_of_a_joint_is_refused_by_name() -> None:
    """The position of one robot went with the attitude of the other, and a command for an angle."""
    robot = load_robot_text(
        "{name: arm, gravity: 0, bodies: {arm: {parent: world, joints: [{name: turn, axis: x}], "
        "mass: 1, shape: {type: box, size: [0.1, 0.1, 0.1]}}}}"
    )
    time = 0.01 * np.arange(100)
    turned = ("time", np.sin(time), {"units": "rad"})
    log = xr.Dataset({"command.turn": turned, "encoder.turn": turned}, {"time": time})
    with pytest.raises(LogError, match=r"encoder\.turn: expected one .* found command\.turn, too"):
        sensor_log(log, robot)
    place = (("time", "axis"), np.zeros((100, 3)), {"units": "m"})
    poses = {
        "one.position": place,
        "two.attitude": (("time", "quaternion"), quaternion(time), {"units": "1"}),
        "two.position": place,
    }
    with pytest.raises(LogError, match=r"two\.position: expected one .* leave out of the mapping"):
        sensor_log(xr.Dataset(poses, {"time": time}), robot)
