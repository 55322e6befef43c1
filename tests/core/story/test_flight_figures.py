"""Figures of a flight: all of them, in every size, vectors where vectors were asked for."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
import xarray as xr
from matplotlib.figure import Figure

import patagium as pt
from patagium.cli import words
from patagium.cli.main import run
from patagium.errors import ParameterError
from patagium.learning.model_file import save_model
from patagium.report.style import LOOKS, figures_for, styled, width
from patagium.robot import load_robot_text
from patagium.viewer.flight_figures import flight_figures


@pytest.fixture(scope="module")
def flight() -> Iterator[xr.Dataset]:
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)
    aero = pt.QuasiSteady(robot, pt.Air())
    start = robot.coordinates(x=3.0)
    yield pt.simulate(robot, aero, gait, duration=0.45, time_step=1e-3, v=start)


@pytest.mark.parametrize("look", LOOKS)
def test_letters_and_widths_are_those_of_the_place(look: str, flight: xr.Dataset) -> None:
    figures = flight_figures(flight, look)
    assert set(figures) == {"robot", "flight", "strips", "wingbeat"}
    for figure in figures.values():
        assert figure.get_figwidth() == LOOKS[look].width
        sizes = [axes.yaxis.label.get_fontsize() for axes in figure.axes]
        assert sizes == pytest.approx([9.0 * LOOKS[look].letters] * len(sizes))
    with figures_for(look):  # texts without a size of their own were scaled as lines
        text = styled(lambda: Figure().text(0, 0, "text").get_fontsize())()
    assert text == pytest.approx(9.0 * LOOKS[look].letters)
    assert width() == LOOKS["page"].width  # as before


def test_a_flight_of_one_beat_has_no_wingbeat_figure(flight: xr.Dataset) -> None:
    short = flight.isel(time=slice(0, 150))
    assert "wingbeat" not in flight_figures(short)


def test_a_robot_without_wings_has_no_figure_of_strips() -> None:
    """Figures of a robot without wings ended in an IndexError."""
    brick = "{floating: true, mass: 10 g, shape: {type: box, size: [1 cm, 2 cm, 3 cm]}}"
    robot = load_robot_text(f"{{name: brick, gravity: 9.8 m/s^2, bodies: {{brick: {brick}}}}}")
    air, gait = pt.QuasiSteady(robot, pt.Air()), pt.gaits.still(robot)
    fallen = pt.simulate(robot, air, gait, duration=0.02, time_step=1e-3)
    assert set(flight_figures(fallen)) == {"robot", "flight"}


def test_an_unknown_place_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"page, phone, paper, slides.*found 'wall'"):
        with figures_for("wall"):
            pass


def test_the_verb_writes_them_with_the_learned_forces(
    flight: xr.Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, model = tmp_path / "flight.nc", tmp_path / "model.json"
    pt.save_flight(flight, path)
    network = pt.StripNetwork(pt.load_robot("aerobat"), hidden=(4,))
    learner = pt.ExtendedLearner(network, prior_std=0.3, measurement_std=3e-4)
    pt.identify(flight, learner, every=10)
    save_model(model, learner)
    with pytest.raises(SystemExit) as left:
        run(["figures", str(path), "--for", "paper", "--model", str(model), "--json"])
    assert left.value.code == 0
    files = json.loads(capsys.readouterr().out)
    assert set(files) == {"robot", "flight", "strips", "wingbeat", "forces"}
    for file in files.values():
        assert Path(file).parent == tmp_path / "flight"
        assert Path(file).read_bytes().startswith(b"%PDF")


def test_a_joint_that_slides_is_drawn_in_meters(flight: xr.Dataset) -> None:
    slid = flight.copy()
    slid["dof_unit"] = flight["dof_unit"].copy()
    slid["dof_unit"].loc["left_plunge"] = "m"
    panels = {
        (one.get_title(loc="left"), one.get_ylabel()): [line.get_ydata() for line in one.lines]
        for one in flight_figures(slid)["flight"].axes
    }
    (way,) = panels["Joints", "[m]"]
    assert way.max() == pytest.approx(0.5, rel=1e-3)
    assert ("Joints", "[deg]") not in panels  # nothing turns
    turned = [one.get_ylabel() for one in flight_figures(flight)["flight"].axes]
    assert turned.count("[m]") == 1


def test_a_report_says_which_outputs_it_does_not_draw(flight: xr.Dataset, tmp_path: Path) -> None:
    network = pt.StripNetwork(pt.load_robot("aerobat"), hidden=(4,))
    learner = pt.ExtendedLearner(network, prior_std=0.3, measurement_std=3e-4)
    result = pt.identify(flight, learner, every=10)
    loud = 14 - len(result.scores["silent"])
    result.report(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text("utf-8")
    assert loud == 11 and page.count("Scores of the other 5 outputs are in the table.</fig") == 2


def test_figures_tell_how_far_they_are(
    flight: xr.Dataset,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(words, "BETWEEN_LINES", 0.0)
    path = tmp_path / "flight.nc"
    pt.save_flight(flight, path)
    with pytest.raises(SystemExit) as left:
        run(["figures", str(path), "--format", "png"])
    assert left.value.code == 0
    assert "Drawing flight.nc: 100% after" in capsys.readouterr().err


def test_a_figure_that_fails_costs_no_other(
    flight: xr.Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, folder = tmp_path / "flight.nc", tmp_path / "flight"
    pt.save_flight(flight.isel(time=slice(0, 50)), path)
    (folder / "robot.png").mkdir(parents=True)
    with pytest.raises(SystemExit) as left:
        run(["figures", str(path), "--format", "png", "--json"])
    said = capsys.readouterr()
    assert left.value.code == 2 and "not saved: robot.png; all else was" in said.err
    assert set(json.loads(said.out)) == {"flight", "strips"}
    assert (folder / "strips.png").is_file()
