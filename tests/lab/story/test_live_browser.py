"""The live page in a browser: somebody sees a flight that learns, and steers it.

Screenshots are written to $PATAGIUM_ARTEFACTS where it is set: each takes as long as all the rest.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import patagium as pt

from ...chromium import PATIENCE, Chromium, found

pytest.importorskip("viser", reason="viser is not installed: pip install 'patagium[viewer]'")

LEARN = {"prior_std": 0.3, "measurement_std": 3e-4, "spread": 1.7}
SETTINGS = f"""
every: 2
network: {{kind: strip, hidden: [4]}}
learner: {json.dumps({"kind": "cubature", **LEARN})}
"""
BEAT = ("--gait", "sinusoidal", "--frequency", "5 Hz", "--plunge", "0.6")
FLY = (*BEAT, "--speed", "3 m/s", "--time-step", "1e-3")
WIDTH, HEIGHT = 1060, 600
COLORS = """(() => {
  const view = document.querySelector("canvas[data-engine]");
  const copy = document.createElement("canvas");
  copy.width = copy.height = 64;
  const pen = copy.getContext("2d", { willReadFrequently: true });
  pen.drawImage(view, 0, 0, view.width, view.height, 0, 0, 64, 64);
  return [...pen.getImageData(0, 0, 64, 64).data];
})()"""
NUMBERS = "document.getElementById('live-numbers')?.innerText ?? ''"
CHARTS = "Object.values(window.__viserTestpoints?.uplots ?? {})"
HARMLESS = "THREE.Clock: This module has been deprecated"  # of the library that viser uses


def until(ask: Any, wanted: Any, patience: float = 3 * PATIENCE) -> Any:
    """What is asked for, once it is as wanted; the machine may be busy."""
    limit = time.monotonic() + patience
    while not wanted(value := ask()):
        assert time.monotonic() < limit, f"still {value!r}"
        time.sleep(0.1)
    return value


def number_of(words: str, name: str) -> float:
    said = re.search(rf"{re.escape(name)}\s+(-?[\d.e+-]+)", words)
    return float(said[1]) if said else float("nan")


class Program:
    """`patagium simulate --live` as somebody starts it."""

    def __init__(self, folder: Path) -> None:
        self.flight = folder / "flight.nc"
        (folder / "settings.yaml").write_text(SETTINGS)
        words = ["simulate", "aerobat", *FLY, "--duration", "600", "-o", str(self.flight)]
        words += ["--live", "--live-address", "127.0.0.1:0"]
        words += ["--settings", str(folder / "settings.yaml")]
        program = "import sys; from patagium.cli.main import run; run(sys.argv[1:])"
        self._process = subprocess.Popen(
            [sys.executable, "-c", program, *words],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self._process.stderr is not None
        told = (line for line in self._process.stderr if "compiling" not in line)
        said = next(told)  # what is compiled first, from an empty cache, is told before
        assert "(loopback: this machine alone)" in said
        self.address = re.findall(r"http://127\.0\.0\.1:\d+/\S+", said)[0]

    def end(self) -> str:
        self._process.send_signal(signal.SIGINT)
        out, err = self._process.communicate(timeout=2 * PATIENCE)
        assert self._process.returncode == 0, err
        return out

    def stop(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.communicate()  # closes the pipes too, for a test that failed


@pytest.fixture
def program(tmp_path: Path) -> Iterator[Program]:
    started = Program(tmp_path)
    yield started
    started.stop()


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Chromium]:
    if found() is None:
        pytest.skip("no Chromium on this machine")
    with Chromium(tmp_path / "chromium", WIDTH, HEIGHT) as opened:
        yield opened


def picture(browser: Chromium, name: str) -> None:
    folder = os.environ.get("PATAGIUM_ARTEFACTS")
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        browser.screenshot(Path(folder) / name)


def test_a_browser_sees_a_flight_and_steers_it(browser: Chromium, program: Program) -> None:
    browser.size(WIDTH, HEIGHT, ratio=0.5)  # a quarter of the dots to draw without a graphics card
    browser.go(program.address)

    def words() -> str:
        return str(browser.ask(NUMBERS))

    until(words, lambda said: number_of(said, "Frames drawn") > 5)
    browser.ask("document.querySelector('.mantine-Notification-closeButton')?.click()")
    assert "move Frequency below" in words() and "Arrow of 0.1 N, strip" in words()
    pictures = []
    for count in range(3):
        flown = number_of(words(), "Time")
        until(words, lambda said, last=flown: number_of(said, "Time") > last + 0.1)
        dots = np.array(browser.ask(COLORS), np.uint8).reshape(-1, 4)
        assert len(np.unique(dots[:, :3], axis=0)) > 20  # one if blank, a few with a grid alone
        pictures.append(dots)
        picture(browser, f"live-{count}.png")
    assert (pictures[0] != pictures[1]).any() and (pictures[1] != pictures[2]).any()

    assert browser.ask(f"{CHARTS}.length") == 5  # three forces, error, coverage
    series = browser.ask(f"{CHARTS}[0].chart.data.map((k) => [...k])")
    time_shown, truth, guess, low, high = (np.array(k, float) for k in series)
    assert (np.diff(time_shown) > 0).all() and np.ptp(truth) > 0.1
    late = len(truth) // 2
    assert (low[late:] <= guess[late:]).all() and (guess[late:] <= high[late:]).all()
    assert 0 < number_of(words(), "Error (NMSE)") < 1
    assert 50 < number_of(words(), "In the 95 % interval") <= 100

    browser.ask("document.querySelectorAll('[role=slider]')[0].focus()")
    for _ in range(20):
        browser.press("ArrowRight")
    until(words, lambda said: number_of(said, "Wingbeat") == 7.0)
    half = browser.ask(
        "(() => { const e = document.querySelectorAll('[role=slider]')[1].parentElement;"
        " e.scrollIntoView({ block: 'center', behavior: 'instant' });"  # below the window's edge
        " const b = e.getBoundingClientRect();"
        " return [b.left + b.width / 4, b.top + b.height / 2]; })()"
    )
    browser.click(*half)  # a quarter of 200 %
    until(words, lambda said: re.search(r"amplitude 5\d%", said))

    browser.ask("document.activeElement.blur()")
    browser.press(" ")
    until(words, lambda said: "Paused." in said)
    paused = number_of(words(), "Time")
    browser.press("r")
    until(words, lambda said: number_of(said, "Time") < paused)
    browser.press(" ")
    until(words, lambda said: "Paused." not in said and number_of(said, "Time") > 1.5)
    first = f"{CHARTS}[0].chart.data.map((k) => [...k])"
    until(lambda: browser.ask(first), lambda lines: len(lines[0]) > 50 and np.ptp(lines[1]) > 0.1)
    picture(browser, "live-steered.png")
    assert "refused" not in words()  # the page sends nothing that its door does not know

    program.end()
    assert [k for k in browser.complaints if HARMLESS not in k and "WebSocket" not in k] == []
    inner = ("data:", "blob:", program.address, program.address.replace("http", "ws"))
    assert [u for u in browser.requests if not u.startswith(inner)] == []
    flown = pt.load_flight(program.flight)
    frequency = flown["command"].sel(command_name="frequency").values[-1]
    amplitude = flown["command"].sel(command_name="amplitude").values[-1]
    assert frequency == 7.0
    assert 0.45 < amplitude < 0.6
    assert flown.attrs["outcome"] == "COMPLETED"
    assert flown.attrs["energy_audit"] < 1e-2  # fourth order, in steps of 1 ms
    late_time = flown["time"].values[-1] - flown["time"].values < 1.0
    plunge = flown["q"].sel(dof="left_plunge").values[late_time]
    beats = np.diff(np.flatnonzero(np.diff(np.sign(plunge)) > 0)) * 1e-3
    assert 1 / beats.mean() == pytest.approx(7.0, rel=0.01)  # of a few beats, in steps of 1 ms
    assert np.ptp(plunge) == pytest.approx(1.2 * amplitude, rel=0.01)
