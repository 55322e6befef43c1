"""Tables as rigs write them: units without a space, decimal commas, wraps, footers."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import patagium as pt
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
    np.testing.assert_allclose(log["h"].values, expected, atol=1e-6)


def test_a_shaft_that_goes_round_stays_within_its_turn(tmp_path: Path) -> None:
    k = np.arange(500)
    text = "t,h\n" + "".join(f"{0.01 * i},{(10.0 * i + 5.0) % 360.0}\n" for i in k)
    words = {"time": TIME, "channels": [{"column": "h", "unit": "deg"}]}
    found = imported(tmp_path, text, words)
    angle = np.degrees(column(found.path, "h"))
    np.testing.assert_allclose(angle, (10.0 * k + 5.0) % 360.0, atol=1e-9)


def test_joints_of_a_sensor_log_are_unwrapped() -> None:
    robot = pt.load_robot("yeo-wing")
    model = EncoderModel(Encoder(rate=100.0), robot)
    angle = np.linspace(-0.5, 0.5, 50)[:, None] * [1.0, -1.0]
    angle[20] = np.nan
    reading = xr.Dataset({"position": (("time", "joint"), angle % (2 * np.pi))})
    np.testing.assert_allclose(model.rows(reading), angle, atol=1e-12)
