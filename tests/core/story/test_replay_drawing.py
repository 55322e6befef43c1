"""How the replay page draws: fewer dots where frames come late, all of them at rest."""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray
from PIL import Image

import patagium as pt
from patagium.errors import ParameterError
from patagium.viewer import film as films

from ...chromium import Chromium, found

SCRIPTS = files("patagium.report").joinpath("replay")


def script(name: str) -> str:
    return SCRIPTS.joinpath(name).read_text("utf-8")


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    aero, start = pt.QuasiSteady(robot, pt.Air()), robot.coordinates(x=3.0)
    return pt.simulate(robot, aero, gait, duration=0.4, time_step=2e-4, v=start)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    if found() is None:
        pytest.skip("no Chromium on this machine")
    with Chromium(tmp_path_factory.mktemp("chromium"), 500, 360) as opened:
        yield opened


def test_late_frames_cost_dots_and_quick_ones_bring_them_back(browser: Chromium) -> None:
    said = browser.ask(f"""(() => {{ {script("pace.js")}
      const pace = new Pace(), shares = [], heed = (gap, times) => {{
        for (let k = 0; k < times; k++) pace.heed(gap);
        shares.push(pace.share);
      }};
      heed(16, 50); heed(33.4, 200); heed(90, 200); heed(5000, 5); heed(12, 1500);
      const patience = pace.patience;
      heed(90, 20);
      return [shares, patience, pace.patience, COARSEST];
    }})()""")
    (quick, screen, late, hidden, again, tried), patience, longer, coarsest = said
    assert quick == screen == 1.0  # a screen that shows thirty a second is not late
    assert late == hidden == coarsest and again == 1.0
    assert tried < 1.0 and longer > patience  # finer was too much: it waits longer


def test_thinned_paths_stay_within_their_tolerance(browser: Chromium) -> None:
    t = np.linspace(0.0, 12.0, 1500)
    points = np.stack([3 * t, np.sin(9 * t), np.cos(5 * t)], axis=1)
    kept = browser.ask(f"""(() => {{ {script("paths.js")}
      return thinned(new Float32Array({json.dumps(points.ravel().tolist())}), 0.01);
    }})()""")
    assert kept[0] == 0 and kept[-1] == len(t) - 1 and len(kept) < 0.5 * len(t)
    away = max(_distance(points[a : b + 1]).max() for a, b in zip(kept, kept[1:], strict=False))
    assert 0.001 < away < 0.01 + 1e-5  # single precision of 36 m


def _distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of points from the straight line between the first and the last."""
    chord = points[-1] - points[0]
    along = chord / np.linalg.norm(chord)
    offsets = points - points[0]
    part = np.clip(offsets @ along, 0.0, np.linalg.norm(chord))
    return np.linalg.norm(offsets - part[:, None] * along, axis=1)


def test_at_rest_the_robot_is_drawn_with_all_dots(
    flight: xr.Dataset, browser: Chromium, tmp_path: Path
) -> None:
    page = pt.replay(flight, tmp_path / "flight.html")
    browser.go(f"{page.as_uri()}#play=0&t=0.2")
    resting = """new Promise((f) => {
      const look = () => (replay.pace.atRest ? f(true) : requestAnimationFrame(look));
      look();
    })"""
    browser.ask(resting)
    dots, wide = browser.ask(
        "[(v) => v.width, (v) => v.clientWidth].map((f) => f(document.getElementById('view')))"
    )
    assert dots >= wide  # twice as many where the processor draws
    browser.ask("replay.seek(0.3)")
    browser.ask(resting)
    assert browser.ask("replay.drawn") == pytest.approx(0.3)
    browser.press("?")
    assert browser.ask("document.getElementById('keyboard').open") is True
    browser.press(" ")  # keys of the page sleep while its help is open: this closes it
    browser.ask("document.getElementById('keyboard').close()")
    assert browser.ask("replay.playing") is False
    for key, button in {"f": "forces", "o": "total", "t": "trail", "c": "follow"}.items():
        pressed = f"document.getElementById('{button}').getAttribute('aria-pressed')"
        before = browser.ask(pressed)
        browser.press(key)
        assert browser.ask(pressed) != before
    unnamed = """[...document.querySelectorAll("button, input, select, canvas, summary")].filter(
      (one) => !(one.textContent.trim() || one.title || one.labels?.length
        || one.getAttribute("aria-label") || one.getAttribute("aria-hidden"))
      ).map((one) => one.outerHTML)"""
    assert browser.ask(unnamed) == []  # each control says what it is
    browser.size(390, 700, touch=True)
    place = """(() => { const b = document.getElementById("play").getBoundingClientRect();
      return [b.left + b.width / 2, b.top + b.height / 2]; })()"""
    x, y = browser.ask(place)
    point = [{"x": x, "y": y}]
    browser.send("Input.dispatchTouchEvent", type="touchStart", touchPoints=point)
    browser.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    moving = """new Promise((f) => {
      const look = () => (replay.playing ? f(true) : requestAnimationFrame(look));
      look();
    })"""
    assert browser.ask(moving) is True  # a finger on the button
    browser.size(500, 360)
    assert browser.complaints == []


@pytest.mark.parametrize("kind", ["gif", "mp4"])
def test_a_film_has_its_pictures_and_the_robot_stays_in_them(
    flight: xr.Dataset, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(films, "PICTURES", 3)
    path, told = tmp_path / f"flight.{kind}", []
    if kind == "mp4" and find_spec("imageio_ffmpeg") is None:
        with pytest.raises(ParameterError, match=r"patagium\[film\]"):
            films.film(flight, path)
        assert not path.exists()
        return
    films.film(flight, path, start=0.1, end=0.3, progress=lambda done, total: told.append(done))
    assert told == [1, 2, 3]
    if kind == "mp4":
        assert path.read_bytes()[4:8] == b"ftyp"
        return
    with Image.open(path) as film:
        assert film.n_frames == 3 and film.info["loop"] == 0
        edge = np.array(film.convert("RGB"))[[0, -1]]
        wing = np.abs(edge.astype(int) - [159, 192, 216]).max(axis=-1) < 12
        assert not wing.any()


def test_a_film_of_another_kind_is_refused(flight: xr.Dataset, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="gif or"):
        films.film(flight, tmp_path / "flight.webm")
