"""The replay page: its numbers are the computation's, and a browser shows and plays them.

The browser part writes its screenshots to $PATAGIUM_ARTEFACTS, or the test's own folder.
"""

from __future__ import annotations

import base64
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

import patagium as pt
from patagium.cli.main import run
from patagium.errors import LogError, ParameterError, ShapeError
from patagium.learning import Identification
from patagium.robot import load_robot_text
from patagium_lab.reproduction.flights import corrected_flight

from ...chromium import Chromium, found

SIZE = (760, 420)
LARGEST = 3_000_000


class Subject(NamedTuple):
    flight: xr.Dataset
    result: Identification
    page: Path


@pytest.fixture(scope="module")
def subject(tmp_path_factory: pytest.TempPathFactory) -> Subject:
    flight = corrected_flight(2.0)
    network = pt.StripNetwork(pt.load_robot("aerobat"), hidden=(8, 8))
    learner = pt.CubatureLearner(network, prior_std=0.3, measurement_std=3e-4, spread=1.7)
    result = pt.identify(flight, learner, every=100)
    page = tmp_path_factory.mktemp("replay") / "flight.html"
    return Subject(flight, result, pt.replay(flight, page, predicted=result.learner))


def content(page: Path) -> dict[str, Any]:
    text = page.read_text("utf-8")
    found = re.search(r'<script id="flight" type="application/json">(.*?)</script>', text, re.S)
    assert found is not None
    words: dict[str, Any] = json.loads(found[1])
    return words


def numbers(packed: dict[str, Any]) -> NDArray[np.float64]:
    raw = base64.b64decode(packed["base64"])
    return np.frombuffer(raw, f"<{packed['kind']}").astype(float).reshape(packed["shape"])


def nearest(flight: xr.Dataset, time: NDArray[np.float64]) -> xr.Dataset:
    return flight.sel(time=time, method="nearest")


def test_wing_tips_on_the_page_are_those_of_the_dynamics(subject: Subject) -> None:
    words = content(subject.page)
    dynamics = pt.Dynamics(pt.load_robot("aerobat"))
    time, origin = numbers(words["time"]), numbers(words["origin"])
    position, quaternion = numbers(words["position"]), numbers(words["quaternion"])
    q = nearest(subject.flight, time)["q"].values
    assert [mark["name"] for mark in words["marks"]] == ["left_wing", "right_wing"]
    for mark in words["marks"]:
        b, offset = mark["body"], np.array(mark["offset"])
        turn = Rotation.from_quat(quaternion[:, b])
        seen = origin + position[:, b] + turn.apply(offset)
        tip = dynamics.point(words["bodies"][b], offset)
        truth = np.array([tip.position(one) for one in q])
        assert np.abs(seen - truth).max() < 1e-6  # m


def test_a_flight_of_two_seconds_is_small_and_needs_nothing_else(subject: Subject) -> None:
    text = subject.page.read_text("utf-8")
    assert subject.page.stat().st_size < LARGEST
    assert len(numbers(content(subject.page)["time"])) > 100 * 2.0 * 5.9  # frames a wingbeat
    assert not re.search(r"""<(?:link|img|iframe)|\s(?:src|href)\s*=|@import|\burl\(http""", text)
    assert "Permission is hereby granted" in text  # the license of three.js travels along


def test_forces_on_the_page_are_those_recorded_and_learned(subject: Subject) -> None:
    words = content(subject.page)
    shown = nearest(subject.flight, numbers(words["time"]))
    arrows = words["arrows"]
    force = shown["strip_force"].values
    np.testing.assert_allclose(numbers(arrows["force"]), force, atol=1e-6 * np.abs(force).max())
    series = {one["name"]: one for one in words["series"] if one["unit"].startswith("N")}
    guess = numbers(arrows["predicted"]).sum(axis=1)
    for k, name in enumerate("xyz"):
        # the sum over strips is the generalized force along x, y, z, to single precision
        np.testing.assert_allclose(guess[:, k], numbers(series[name]["predicted"]), atol=1e-6)
        truth = shown["aero_force"].sel(dof=name).values
        np.testing.assert_allclose(numbers(series[name]["values"]), truth, atol=1e-6)
    center = pt.Dynamics(pt.load_robot("aerobat")).batch.center_of_mass(shown["q"].values)
    np.testing.assert_allclose(
        numbers(arrows["center"]), center - numbers(words["origin"]), atol=1e-7
    )
    error = np.abs(numbers(series["z"]["predicted"]) - numbers(series["z"]["values"]))
    assert error[len(error) // 2 :].mean() < 0.05 * np.abs(force.sum(axis=1)[:, 2]).max()


def test_what_interpolation_costs_is_said(subject: Subject) -> None:
    text = subject.page.read_text("utf-8")
    said = re.search(r"(\d+) of 20001 samples \(one in (\d+).*?at most ([\d.e-]+) mm", text, re.S)
    assert said is not None
    assert int(said[1]) == len(range(0, 20001, int(said[2])))
    assert 0 < float(said[3]) < 0.1


def test_an_identification_is_shown_as_it_foresaw(subject: Subject, tmp_path: Path) -> None:
    page = pt.replay(subject.flight, tmp_path / "a.html", predicted=subject.result, end=0.2)
    words = content(page)
    series = next(one for one in words["series"] if one["name"] == "z")
    record = nearest(subject.result.prediction, numbers(words["time"]))
    expected = record["prediction"].sel(output="z").values
    np.testing.assert_allclose(numbers(series["predicted"]), expected, atol=1e-6)
    assert numbers(words["time"])[-1] == pytest.approx(0.2)
    assert words["arrows"]["predicted"] is not None
    subject.result.save(tmp_path / "kept.nc")
    from patagium.learning.result import load_identification

    kept = load_identification(tmp_path / "kept.nc")
    words = content(pt.replay(subject.flight, tmp_path / "b.html", predicted=kept, end=0.1))
    assert words["arrows"]["predicted"] is None and words["arrows"]["predicted_total"] is not None


def test_the_default_network_shows_the_force_on_each_strip(
    subject: Subject, tmp_path: Path
) -> None:
    flight = subject.flight.isel(time=slice(0, 5000, 5))
    result = pt.identify(flight)
    arrows = content(pt.replay(flight, tmp_path / "a.html", predicted=result))["arrows"]
    force, guess = numbers(arrows["force"]), numbers(arrows["predicted"])
    # it has learned for half a second that its air has no added mass: 7e-4 measured
    assert np.abs(guess - force).max() < 0.02 * np.abs(force).max()


def test_a_network_without_strips_shows_force_and_moment_of_the_whole(
    subject: Subject, tmp_path: Path
) -> None:
    flight = subject.flight.isel(time=slice(0, 2000, 5))
    robot = pt.load_robot("aerobat")
    network = pt.DenseNetwork(robot.state_size, (4,), robot.dof_names)
    learner = pt.CubatureLearner(network, prior_std=0.3, measurement_std=0.01)
    result = pt.identify(flight, learner, every=10)
    for predicted in (learner, result):
        words = content(pt.replay(flight, tmp_path / "a.html", predicted=predicted))
        arrows = words["arrows"]
        series = {k["name"]: k for k in words["series"] if k["unit"].startswith("N")}
        assert arrows["predicted"] is None and arrows["moment"] is not None
        total, std = numbers(arrows["predicted_total"]), numbers(arrows["std"])
        for k, name in enumerate("xyz"):
            # the same numbers, to single precision
            expected = numbers(series[name]["predicted"])
            np.testing.assert_allclose(total[:, k], expected, rtol=1e-6)
            said = numbers(series[name]["std"])
            np.testing.assert_allclose(std[:, k], said, rtol=1e-6)
        assert std.min() > 0.0099  # no surer than what it learned from
        force, guess = numbers(arrows["moment"]), numbers(arrows["predicted_moment"])
        assert force.shape == guess.shape and np.isfinite(guess).all()
    checked = result.prediction["predicted_std"].sel(output="z")
    at = checked["check_time"].values[[20, -1]]
    time = numbers(words["time"])
    shown = numbers(series["z"]["std"])[[int(np.abs(time - t).argmin()) for t in at]]
    np.testing.assert_allclose(shown, checked.values[[20, -1]], rtol=1e-5)
    assert "95 % intervals" in (tmp_path / "a.html").read_text("utf-8")


def test_what_does_not_fit_is_refused(subject: Subject, tmp_path: Path) -> None:
    short = subject.flight.isel(time=slice(0, 500))
    with pytest.raises(LogError, match="predictions: expected those of this flight"):
        pt.replay(short, tmp_path / "a.html", predicted=subject.result)
    with pytest.raises(ParameterError, match="two samples"):
        pt.replay(short, tmp_path / "a.html", start=1.0)
    other = pt.StripNetwork(pt.load_robot("aerobat-beta"), hidden=(4,))
    stranger = pt.CubatureLearner(other, prior_std=0.3, measurement_std=3e-4)
    with pytest.raises(ShapeError, match="strips of the model"):
        pt.replay(short, tmp_path / "a.html", predicted=stranger)
    assert list(tmp_path.iterdir()) == []


def test_the_command_writes_a_page_beside_the_flight(
    subject: Subject, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pt.save_flight(subject.flight.isel(time=slice(0, 400)), tmp_path / "short.nc")
    with pytest.raises(SystemExit) as left:
        run(["view", str(tmp_path / "short.nc"), "--start", "10 ms", "--title", "A <short> one"])
    assert left.value.code in (0, None)
    assert "short.html" in capsys.readouterr().err
    text = (tmp_path / "short.html").read_text("utf-8")
    assert "<h1>A &lt;short&gt; one</h1>" in text
    assert numbers(content(tmp_path / "short.html")["time"])[0] == pytest.approx(0.01)


ARM = """
name: arm
gravity: 9.8 m/s^2
bodies:
  base:
    mass: 1 kg
    joints: [{name: turn, axis: z}]
    shape: {type: box, size: [10 cm, 10 cm, 4 cm]}
  ball:
    parent: base
    at: [0, 0, -5 cm]
    joints: [{name: swing, axis: y, passive: true}]
    mass: 0.1 kg
    center_of_mass: [0, 0, -30 cm]
    inertia: {xx: 1 g m^2, yy: 1 g m^2, zz: 1 g m^2}
"""


@pytest.fixture(scope="module")
def wingless(tmp_path_factory: pytest.TempPathFactory) -> Path:
    robot = load_robot_text(ARM)
    gait = pt.gaits.sinusoidal(robot, frequency=1.0, turn=0.5)
    aero, start = pt.QuasiSteady(robot, pt.Air()), robot.coordinates(swing=0.5)
    flight = pt.simulate(robot, aero, gait, duration=0.5, time_step=1e-3, q=start)
    return pt.replay(flight, tmp_path_factory.mktemp("arm") / "arm.html")


def test_a_robot_without_wings_is_shown_with_what_moves(wingless: Path) -> None:
    words = content(wingless)
    assert words["arrows"] is None and words["marks"] == []
    shown = [(one["group"], one["name"]) for one in words["series"] if one["shown"]]
    assert shown == [("Coordinates", "turn"), ("Coordinates", "swing")]
    assert [(one["kind"], one["body"]) for one in words["solids"]] == [("box", 0), ("capsule", 1)]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    if found() is None:
        pytest.skip("no Chromium on this machine")
    profile = tmp_path_factory.mktemp("chromium")
    with Chromium(profile, *SIZE) as opened:
        yield opened


@pytest.fixture
def artefacts(tmp_path: Path) -> Path:
    folder = Path(os.environ.get("PATAGIUM_ARTEFACTS", tmp_path))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


DRAWN = "new Promise((f) => requestAnimationFrame(() => requestAnimationFrame(() => f(true))))"
MOVED = """new Promise((f) => {
  const look = () => (replay.drawn > BEFORE ? f(true) : requestAnimationFrame(look));
  look();
})"""
COLORS = """(() => {
  const copy = document.createElement("canvas"), view = document.getElementById("view");
  copy.width = copy.height = 48;
  const pen = copy.getContext("2d", { willReadFrequently: true });
  pen.drawImage(view, 0, 0, view.width, view.height, 0, 0, 48, 48);
  const dots = pen.getImageData(0, 0, 48, 48).data, seen = new Set();
  for (let i = 0; i < dots.length; i += 4) seen.add(dots.slice(i, i + 3).join());
  return seen.size;
})()"""
CURSOR = """(() => {
  const canvas = document.querySelector(".plot canvas"), wide = canvas.width;
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [wide, 1];
  const pen = copy.getContext("2d", { willReadFrequently: true });
  pen.drawImage(canvas, 0, 6, wide, 1, 0, 0, wide, 1); // above all dots
  const row = pen.getImageData(0, 0, wide, 1).data;
  let blue = 0, moment = 0;
  for (let i = 0; i < wide; i++) {
    const [red, green, bluish, solid] = row.slice(4 * i, 4 * i + 4);
    if (red > 60 || green > 130 || bluish < 110) continue;
    [blue, moment] = [blue + solid, moment + solid * (i + 0.5)];
  }
  return moment / blue;
})()"""


def test_a_browser_plays_the_page_from_disk_without_network(
    subject: Subject, browser: Chromium, artefacts: Path
) -> None:
    browser.go(f"{subject.page.as_uri()}#play=0&t=0.1")
    browser.ask(DRAWN)
    words = content(subject.page)
    time = numbers(words["time"])
    dynamics = pt.Dynamics(pt.load_robot("aerobat"))

    for t in (0.25, 0.9, 1.7):
        frame = int(np.abs(time - t).argmin())
        browser.ask(f"replay.seek({float(time[frame])!r})")
        browser.ask(DRAWN)
        assert browser.ask("replay.drawn") == time[frame]
        assert browser.ask(COLORS) > 20  # a blank canvas has one, an empty grid a few
        mark = words["marks"][0]
        tip = dynamics.point(words["bodies"][mark["body"]], mark["offset"])
        q = nearest(subject.flight, time[frame : frame + 1])["q"].values[0]
        seen = np.array(browser.ask("replay.mark(0)"))
        assert np.abs(seen - tip.position(q)).max() < 1e-6  # m
        cursors = browser.ask("replay.cursors()")
        assert len(cursors) == 5
        assert max(abs(one["time"] - time[frame]) for one in cursors) < 1e-9
        assert browser.ask(CURSOR) == pytest.approx(cursors[0]["x"], abs=0.6)  # pixel
        browser.screenshot(artefacts / f"replay-{t:g}.png")

    frame = int(np.abs(time - 0.5).argmin())
    browser.ask(f"replay.seek({float(time[frame])!r})")
    browser.press("ArrowRight")
    assert browser.ask("replay.time") == time[frame + 1]
    browser.press("ArrowLeft")
    browser.press("ArrowLeft")
    assert browser.ask("replay.time") == time[frame - 1]
    browser.press("ArrowRight", shift=True)
    assert browser.ask("replay.time") == pytest.approx(time[frame - 1] + words["period"])
    speed = browser.ask("replay.speed")
    browser.press("ArrowDown")
    assert browser.ask("replay.speed") < speed
    for _ in range(9):
        browser.press("ArrowDown")
    assert browser.ask("replay.speed") == 1 / 200
    browser.press("l")
    begin, end = browser.ask("replay.loop")
    assert end - begin == pytest.approx(words["period"])
    browser.press("l")
    browser.press("c")
    assert browser.ask("replay.following") is False

    before = browser.ask("replay.time")
    browser.press(" ")
    assert browser.ask("replay.playing") is True
    browser.ask(MOVED.replace("BEFORE", repr(before)))
    browser.press(" ")
    assert browser.ask("replay.playing") is False
    stopped = browser.ask("replay.time")
    browser.ask(DRAWN)
    assert browser.ask("replay.time") == browser.ask("replay.drawn") == stopped

    place = browser.ask(
        "(() => { const b = document.getElementById('scrub').getBoundingClientRect();"
        " return [b.left + b.width / 2, b.top + b.height / 2]; })()"
    )
    browser.click(*place)
    middle = (time[0] + time[-1]) / 2
    assert browser.ask("replay.time") == pytest.approx(middle, abs=0.02)

    if "PATAGIUM_ARTEFACTS" in os.environ:  # docs/replay.png
        browser.size(1240, 720)
        browser.go(f"{subject.page.as_uri()}#play=0&t=0.53")
        browser.ask(DRAWN)
        still = browser.screenshot(artefacts / "replay.png")
        Image.open(still).quantize(192).save(still, optimize=True)
        browser.size(*SIZE)
    assert browser.complaints == []
    assert [u for u in browser.requests if not u.startswith(("file:", "data:", "blob:"))] == []


def test_the_ground_follows_a_fall_and_buttons_leave_the_robot_visible(
    browser: Chromium, artefacts: Path, tmp_path: Path
) -> None:
    robot = pt.load_robot("aerobat")
    fall = pt.simulate(
        robot, pt.QuasiSteady(robot, pt.Air()), pt.gaits.still(robot), duration=1.0, time_step=1e-3
    )
    assert fall["q"].sel(dof="z").values[-1] < -1.0
    page = pt.replay(fall, tmp_path / "fall.html")
    for width in (1000, 390):
        browser.size(width, 700, touch=width == 390)
        for when in (0.0, 0.5, 1.0):
            browser.go(f"{page.as_uri()}#play=0&t={when}")
            browser.ask(DRAWN)
            reach = np.linalg.norm(content(page)["marks"][0]["offset"])
            assert 0 < browser.ask("replay.height") < 10 * reach
        boxes = [
            browser.ask(f"document.querySelector('{one}').getBoundingClientRect().toJSON()")
            for one in ("#view", "#stage nav", "#stage header")
        ]
        view, nav, header = boxes
        assert nav["top"] >= view["bottom"] or nav["bottom"] <= view["top"]
        assert width > 820 or header["bottom"] <= view["top"] + 1
    browser.screenshot(artefacts / "replay-fall-phone.png")
    assert browser.complaints == []


def test_two_flights_are_overlaid(subject: Subject, browser: Chromium, artefacts: Path) -> None:
    flight = subject.flight.isel(time=slice(0, 6000, 5))
    other = flight.assign(q=flight["q"] + 0.05 * (flight["dof"] == "y"))
    page = subject.page.with_name("both.html")
    with pytest.raises(ParameterError, match="predicted"):
        pt.replay(flight, page, predicted=subject.result, beside={"shifted": other})
    words = content(pt.replay(flight, page, beside={"shifted": other}))
    assert words["names"] == ["this flight", "shifted"]
    series = {one["name"]: one for one in words["series"] if one["group"] == "Coordinates"}
    apart = numbers(series["y"]["predicted"]) - numbers(series["y"]["values"])
    np.testing.assert_allclose(apart, 0.05, atol=1e-6)  # single precision
    browser.size(*SIZE)
    browser.go(f"{page.as_uri()}#play=0&t=0.3")
    browser.ask(DRAWN)
    time = numbers(words["other"]["time"])
    at = np.abs(time - 0.3).argmin()
    np.testing.assert_allclose(
        browser.ask("replay.other"), numbers(words["other"]["origin"])[at], atol=1e-6
    )
    browser.screenshot(artefacts / "replay-two.png")
    assert browser.complaints == []


def test_the_page_fits_a_phone_and_a_robot_without_wings(
    subject: Subject, wingless: Path, browser: Chromium, artefacts: Path
) -> None:
    browser.size(390, 700, touch=True)
    browser.go(f"{subject.page.as_uri()}#play=0&t=0.545")
    browser.ask(DRAWN)
    assert browser.ask("document.documentElement.scrollWidth") <= 390
    assert browser.ask("document.getElementById('view').clientHeight") > 300
    high = browser.ask("document.getElementById('play').getBoundingClientRect().height")
    assert high >= 40  # a finger
    browser.screenshot(artefacts / "replay-phone.png")
    browser.size(*SIZE)
    browser.go(wingless.as_uri())
    browser.ask(MOVED.replace("BEFORE", "0.0"))  # plays by itself
    assert browser.ask(COLORS) > 20
    assert browser.complaints == []
