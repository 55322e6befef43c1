"""Kinds of files, and what readers of another kind say."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.cli.words import no_robot
from patagium.errors import FlightError, LogError, PatagiumError, shown
from patagium.netcdf_file import kind_of, write_netcdf
from patagium.sensing.force.air_force import recorded


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    learner = pt.ExtendedLearner(pt.DenseNetwork(1, (), ("y",)), prior_std=1.0, measurement_std=1.0)
    pt.learning.save_model(tmp_path / "model.json", learner)
    learner.save(tmp_path / "l.state")
    (tmp_path / "robot.yaml").write_text("name: bird\nwings: []\n")
    (tmp_path / "map.yaml").write_text("time: {column: t}\ninputs: []\n")
    write_netcdf(tmp_path / "kept.nc", xr.Dataset(attrs={"scores": json.dumps({})}))
    write_netcdf(tmp_path / "stream.nc", xr.Dataset(attrs={"format": "patagium stream 1"}))
    write_netcdf(tmp_path / "motion.nc", xr.Dataset({"force_std": ("time", np.zeros(3))}))
    return tmp_path


KINDS = {
    "model.json": "a learned model",
    "l.state": "a learner's state",
    "robot.yaml": "a robot; fly it first: patagium simulate",
    "map.yaml": "a mapping",
    "kept.nc": "predictions",
    "stream.nc": "a record of `patagium stream`",
    "motion.nc": "a motion with forces",
}
LOGS = ("stream.nc", "motion.nc")


@pytest.mark.parametrize("name", KINDS)
def test_each_reader_names_the_kind_of_another_file(name: str, folder: Path) -> None:
    file, kind = folder / name, KINDS[name]
    assert kind_of(file).startswith(kind)
    readers = {"model.json": pt.load_model, "l.state": pt.load_learner}
    for reader in (pt.load_flight, pt.load_model, pt.load_learner, pt.load_log):
        if readers.get(name) is reader or (name in LOGS and reader is pt.load_log):
            continue
        with pytest.raises(PatagiumError) as refused:
            reader(file)
        assert kind in str(refused.value), reader
    if name not in LOGS:
        with pytest.raises(LogError, match=f"expected a flight or log, found {kind}"):
            no_robot(file)


def test_other_files_have_no_kind(tmp_path: Path) -> None:
    (tmp_path / "a.nc").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    (tmp_path / "a.csv").write_text("t,patagium model 2\n")
    for name in ("a.nc", "a.csv", "none.nc", "."):
        assert kind_of(tmp_path / name) == ""


def test_a_record_of_a_stream_is_learned_like_a_flight(tmp_path: Path) -> None:
    robot = pt.load_robot("yeo-wing")
    t, n = 0.01 * np.arange(200), robot.dof
    wave = np.sin(20.0 * t)[:, None] * np.ones(n)
    parts = {"q": 0.1 * wave, "v": wave, "a": 20.0 * wave, "u1": 0.0 * wave}
    record = xr.Dataset(
        {name: (("time", "dof"), values) for name, values in parts.items()},
        {"time": t, "dof": list(robot.dof_names)},
        {"format": "patagium stream 1", "robot": robot.source, "robot_name": robot.name},
    )
    write_netcdf(tmp_path / "stream.nc", record)
    with pytest.raises(FlightError, match=r"a record of .* which `pt.load_log` reads"):
        pt.load_flight(tmp_path / "stream.nc")
    learner = pt.ExtendedLearner(
        pt.DenseNetwork(2 * n, (), robot.dof_names), prior_std=1.0, measurement_std=1.0
    )
    result = pt.identify(pt.load_log(tmp_path / "stream.nc"), learner, every=5)
    assert result.scores["updates"] == 40


def test_what_was_found_is_named_in_plain_words() -> None:
    robot = pt.load_robot("yeo-wing")
    aero, gait = pt.QuasiSteady(robot), pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)
    with pytest.raises(PatagiumError, match=r"such as robot\.coordinates.* found 'a dict'"):
        pt.simulate(robot, aero, gait, duration=0.1, v={"left_plunge": 3.0})
    empty = xr.Dataset({"q": (("time", "dof"), np.zeros((3, robot.dof)))}, {"time": np.arange(3.0)})
    with pytest.raises(FlightError, match=r"the quantity `a` over \(time, dof\)"):
        recorded(empty, "a", robot)
    with pytest.raises(
        PatagiumError, match=r"every: expected a whole number such as 2, found 2\.0"
    ):
        pt.identify(empty, every=2.0)  # type: ignore[arg-type]
    long = {"__module__": "patagium.x", "__repr__": lambda _: 100 * "x"}
    assert shown(type("Identification", (), long)()) == "an Identification"
