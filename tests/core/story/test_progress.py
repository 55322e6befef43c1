"""Progress of a verb is seen on a terminal and, as lines, where there is none."""

from __future__ import annotations

import pytest

import patagium as pt
from patagium.cli import words
from patagium.cli.main import run

MAPPING = """
time: {column: t, unit: s}
inputs: [{column: a, unit: "1", range: [0, 7]}]
outputs: [{column: b, unit: "1", range: [0, 5]}]
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("progress")
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)
    flight = pt.simulate(robot, pt.QuasiSteady(robot, pt.Air()), gait, duration=0.4, time_step=1e-3)
    flight.to_netcdf(folder / "flight.nc")
    rows = "\n".join(f"{0.001 * k},{k % 7},{k % 5}" for k in range(200))
    (folder / "table.csv").write_text(f"t,a,b\n{rows}\n")
    (folder / "table.yaml").write_text(MAPPING)
    return folder


@pytest.mark.parametrize("how", ["flight", "noise between samples", "table", "tune"])
def test_identify_and_tune_tell_how_far_they_are(how, files, monkeypatch, capsys):
    monkeypatch.setattr(words, "BETWEEN_LINES", 0.0)
    monkeypatch.chdir(files)  # where tune writes its settings
    told = ["--prior-std", "0.3", "--measurement-std", "0.1"]
    if how == "tune":
        pytest.importorskip("optuna")
        told = ["--trials", "8", "--jobs", "1", "--every", "10"]
    elif how == "table":
        told += ["--mapping", str(files / "table.yaml")]
    elif how == "noise between samples":
        told += ["--prior-share", "1e-5"]
    verb = "tune" if how == "tune" else "identify"
    log = files / ("table.csv" if how == "table" else "flight.nc")
    with pytest.raises(SystemExit) as ended:
        run([verb, str(log), *told])
    assert ended.value.code == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if "% after" in line]
    assert lines and "100% after" in lines[-1]
