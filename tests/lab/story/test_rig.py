"""The rig on a short flight: logs written and read back, air learned from them, a page of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from patagium.cli.main import run
from patagium.errors import ParameterError
from patagium.learning import load_learner
from patagium.report import cell_text
from patagium.robot import load_robot
from patagium.sensing import load_sensor_log
from patagium_lab.rig.learning import SOURCES
from patagium_lab.rig.page import RESULTS, page
from patagium_lab.rig.plan import CELL, LIMIT_CASES, MOTORS, RigPlan, carriers, instruments
from patagium_lab.rig.run import run as run_rig
from patagium_lab.study import write_study
from patagium_lab.targets import verdict

SECTIONS = (
    "The rig",
    "Targets",
    "Clocks, delays and motion",
    "Errors against noise",
    "Force by force",
    "What limits the measured force",
    "As a load-cell laboratory reports it",
    "What was known beside the logs",
)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three wingbeats of a robot of few strips, one noise, a load cell in time and late."""
    folder = tmp_path_factory.mktemp("rig")
    machine = folder / "few.yaml"
    machine.write_text(load_robot("aerobat").source.replace("strips: 5", "strips: 2"))
    limits = (LIMIT_CASES[0].name, LIMIT_CASES[-2].name)
    plan = RigPlan(str(machine), noise=(1.0,), eights=0.3, unseen_beats=2, limits=limits, workers=0)
    told: list[float] = []
    report, results = write_study(
        folder / "out", plan, run_rig, page, lambda _, part: told.append(part)
    )
    results.only(RESULTS).write(folder / "results.md")
    assert report == folder / "out" / "report.html"
    assert told == sorted(told) and told[-1] == 1.0
    return folder / "out"


@pytest.fixture(scope="module")
def metrics(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "metrics.json").read_text())
    return found


def test_the_page_of_results_has_the_targets_and_what_was_found(
    out: Path, metrics: dict[str, Any]
) -> None:
    text = (out.parent / "results.md").read_text("utf-8")
    assert [title for title in RESULTS if f"\n## {title}\n" not in text] == []
    for row in metrics["targets"]:
        cells = [row["target"], row["limit"], cell_text(row["found"]), verdict(row["met"])]
        assert f"| {' | '.join(cells)} |" in text
    assert "`patagium study rig`, 0.3 eights" in text


def test_a_log_teaches_what_the_truth_is(metrics: dict[str, Any]) -> None:
    (row,) = metrics["noise"]
    assert row["noise"] == 1.0 and tuple(row["sources"]) == SOURCES
    for clock in row["clocks"]:
        assert abs(clock["error"]) < 1e-3 < abs(clock["true"]) or clock["instrument"] == "wing_unit"
    for source in row["sources"].values():
        # a second half of 150 samples after 75 that were learned
        assert source["worst"] < 0.02 and source["mean"] < 0.005
        assert source["unseen"]["path and gait"]["worst"] < 0.1
        assert 0.7 < source["coverage"] <= 1.0
    assert row["sources"]["load cell"]["measured"] == ["x", "y", "z", "roll", "pitch", "yaw"]
    assert len(row["sources"]["inverse dynamics"]["measured"]) == 14


def test_what_is_learned_is_closer_than_what_was_measured(metrics: dict[str, Any]) -> None:
    for source in metrics["noise"][0]["sources"].values():
        loud = {"y", "z", "roll"}  # where clocks and encoders are felt
        learned = max(source["by_coordinate"][name] for name in loud)
        assert learned < source["measured_worst"]


def test_a_late_load_cell_spoils_the_force(metrics: dict[str, Any]) -> None:
    right, late = metrics["limits"]
    assert "clocks known" in right["case"] and late["case"] == "load cell 1 ms late"
    # the arm hardly moved to the side yet: encoders rule the worst force, the delay comes on top
    assert late["load cell"] > 1.05 * right["load cell"]


def test_a_laboratory_reports_the_true_wingbeat(metrics: dict[str, Any]) -> None:
    true, measured = metrics["cycles"]["truth"], metrics["cycles"]["measured"]
    assert measured["mean_lift"] == pytest.approx(true["mean_lift"], abs=2e-3)  # N: .2 gf
    assert measured["mean_power"] == pytest.approx(true["mean_power"], rel=0.05)
    assert measured["airspeed"] == pytest.approx(true["airspeed"], rel=0.02)


def test_logs_and_models_are_files_of_their_own(out: Path, metrics: dict[str, Any]) -> None:
    log = load_sensor_log(out / "logs" / "noise_1.nc")
    assert not log.truth and log.mount == "arm"
    assert set(log.readings) == {row["name"] for row in metrics["instruments"]}
    assert log.sensors["encoders"].clock_offset == 0.0  # a laboratory does not know it
    for source in SOURCES:
        learner = load_learner(out / "models" / f"noise_1_{source.replace(' ', '_')}.learner")
        assert learner.count == metrics["noise"][0]["sources"][source]["stream"]["updates"]
    names = {path.name for path in (out / "truth").iterdir()}
    assert names == {"learned.nc", *(f"unseen_{n}.nc" for n in ("gait", "path", "path_and_gait"))}


def test_the_page_shows_every_section_and_target(out: Path, metrics: dict[str, Any]) -> None:
    page = (out / "report.html").read_text()
    assert 'href="flight.html"' in page  # beside it, wherever both are moved
    assert (out / "flight.html").stat().st_size < 3e6
    for title in SECTIONS:
        assert title in page
    for row in metrics["targets"]:
        assert cell_text(row["found"]) in page
    assert page.count("data:image/png") == 5
    assert "http" not in page.replace("http://www.w3.org", "")


def test_instruments_fit_the_robot() -> None:
    robot = load_robot("aerobat")
    assert carriers(robot) == ("body", "left_humerus")
    sensors = {s.name: s for s in instruments(RigPlan(), robot, 0.1)}
    motors: Any = sensors[MOTORS]
    assert motors.force_per_current * motors.range == pytest.approx(0.15)  # half again as much
    assert CELL in sensors
    with pytest.raises(ParameterError, match="one floating body with joints on it"):
        carriers(load_robot("ur5e"))


@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        ({"noise": ()}, "noise"),
        ({"noise": (1.0, 1.0)}, "noise"),
        ({"noise": (-1.0,)}, "noise"),
        ({"speed": 0.0}, "speed"),
        ({"wind": np.nan}, "wind"),
        ({"unseen_beats": 1}, "unseen_beats"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(wrong: dict[str, Any], name: str) -> None:
    with pytest.raises(ParameterError, match=name):
        RigPlan(**wrong)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--noise", "1,loud"], "numbers such as 0,1,2,4"),
        (["--speed", "9 m/s"], "path"),
        (["--robot", "hawk"], "hawk"),
    ],
)
def test_what_the_rig_cannot_do_is_said_in_a_sentence(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        run(["rig", "--out", str(tmp_path / "out"), *words])
    told = capsys.readouterr().err
    assert left.value.code == 2 and said in told and "Traceback" not in told
