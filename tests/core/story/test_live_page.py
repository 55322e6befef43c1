"""The live page: a browser sees and steers a flight; a learner with a page learns as without one.

The browser part writes its screenshots to $PATAGIUM_ARTEFACTS, or the test's own folder.
"""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.cli import live as live_words
from patagium.cli.main import run
from patagium.errors import ParameterError
from patagium.live.loop import Rhythm, Status, follow, summary
from patagium.live.packets import Intake
from patagium.live.pipeline import Pipeline
from patagium.live.sender import flight_packets
from patagium.live.sources import PacketQueue
from patagium.live.tally import Tally
from patagium.viewer import live_view
from patagium.viewer.live_flight import LiveFlight, flight_subject
from patagium.viewer.live_frames import Subject
from patagium.viewer.live_mailbox import Mailbox

from ...chromium import PATIENCE, Chromium, found

pytest.importorskip("viser", reason="viser is not installed: pip install 'patagium[viewer]'")

LEARN = {"prior_std": 0.3, "measurement_std": 3e-4, "spread": 1.7}
SETTINGS = f"""
every: 2
network: {{kind: strip, hidden: [4]}}
learner: {json.dumps({"kind": "cubature", **LEARN})}
"""
FLY = ("--frequency", "5 Hz", "--plunge", "0.6", "--speed", "3 m/s", "--time-step", "1e-3")
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


@pytest.fixture(scope="module")
def flight():
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    air, start = pt.QuasiSteady(robot, pt.Air()), robot.velocities(x=3.0)
    return pt.simulate(robot, air, gait, duration=0.4, time_step=1e-4, v=start)


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
        said = next(iter(self._process.stderr))
        assert "(loopback: this machine alone)" in said
        self.address = re.findall(r"http://127\.0\.0\.1:\d+", said)[0]

    def end(self) -> str:
        self._process.send_signal(signal.SIGINT)
        out, err = self._process.communicate(timeout=2 * PATIENCE)
        assert self._process.returncode == 0, err
        return out

    def stop(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.communicate()


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


@pytest.fixture
def artefacts(tmp_path: Path) -> Path:
    folder = Path(os.environ.get("PATAGIUM_ARTEFACTS", tmp_path))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def test_a_browser_sees_a_flight_and_steers_it(
    browser: Chromium, program: Program, artefacts: Path
) -> None:
    browser.go(program.address)

    def words() -> str:
        return str(browser.ask(NUMBERS))

    until(words, lambda said: number_of(said, "Frames drawn") > 5)
    browser.ask("document.querySelector('.mantine-Notification-closeButton')?.click()")
    pictures = []
    for count in range(3):
        flown = number_of(words(), "Time")
        until(words, lambda said, last=flown: number_of(said, "Time") > last + 0.1)
        dots = np.array(browser.ask(COLORS), np.uint8).reshape(-1, 4)
        assert len(np.unique(dots[:, :3], axis=0)) > 20  # one if blank, a few with a grid alone
        pictures.append(dots)
        browser.screenshot(artefacts / f"live-{count}.png")
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
        "(() => { const b = document.querySelectorAll('[role=slider]')[1].parentElement"
        ".getBoundingClientRect(); return [b.left + b.width / 4, b.top + b.height / 2]; })()"
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
    browser.screenshot(artefacts / "live-steered.png")

    program.end()
    assert [k for k in browser.complaints if HARMLESS not in k and "WebSocket" not in k] == []
    inner = ("data:", "blob:", program.address, program.address.replace("http", "ws"))
    assert [u for u in browser.requests if not u.startswith(inner)] == []
    flown = pt.load_flight(program.flight)
    asked = json.loads(flown.attrs["gait"])["asked"]
    assert asked[0]["frequency"] == 5.0 and asked[-1]["frequency"] == 7.0
    assert 0.45 < asked[-1]["amplitude"] < 0.6
    assert flown.attrs["outcome"] == "COMPLETED"
    assert flown.attrs["energy_audit"] < 1e-2  # fourth order, in steps of 1 ms
    late_time = flown["time"].values[-1] - flown["time"].values < 1.0
    plunge = flown["q"].sel(dof="left_plunge").values[late_time]
    beats = np.diff(np.flatnonzero(np.diff(np.sign(plunge)) > 0)) * 1e-3
    assert 1 / beats.mean() == pytest.approx(7.0, rel=0.01)  # of a few beats, in steps of 1 ms
    assert np.ptp(plunge) == pytest.approx(1.2 * asked[-1]["amplitude"], rel=0.01)


def a_pipeline() -> Pipeline:
    robot = pt.load_robot("aerobat")
    return Pipeline(pt.CubatureLearner(pt.StripNetwork(robot, (4,)), **LEARN), robot)


def learned(packets: Any, pipeline: Pipeline, view: Any = None, at_half: Any = None) -> Any:
    """The stream as `patagium stream` learns it, beside a page or not."""
    status, intake = Status(Tally(14, 500.0)), Intake()
    queue = PacketQueue(len(packets), packets.shape[1], intake)
    queue.put(packets, waits=False)
    queue.close()
    sink, rhythms = None, ()
    if view is not None:
        shown = live_words.beside_stream(view, pipeline, status, intake)
        sink, rhythms = live_words.Several(shown.sinks), shown.rhythms
    if at_half is not None:
        rhythms = (*rhythms, Rhythm(0.0, at_half))
    follow(queue, pipeline, status, threading.Event(), sink=sink, rhythms=rhythms)
    return summary(status, queue, pipeline)


def test_a_learner_with_a_page_learns_the_same_and_outlives_it(
    flight: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_view, "PERIOD", 0.0)  # a frame a call: more than there ever are
    packets = flight_packets(flight)
    alone = a_pipeline()
    facts = learned(packets, alone)
    network = alone.learner.network
    subject = Subject(alone.robot, network.output_names, network, "a test")
    beside, orphan = a_pipeline(), a_pipeline()
    with live_view.LiveView(subject, "127.0.0.1", 0) as view:
        beside_facts = learned(packets, beside, view)
        sent = view.letters.sent
        assert sent > 1
        process = view._process
        orphan_facts = learned(packets, orphan, view, process.kill)
        process.join()
        assert view.letters.sent > sent
        live_words.tell_if_ended(view, "the learner goes on")
    for pipeline, told in ((beside, beside_facts), (orphan, orphan_facts)):
        np.testing.assert_array_equal(pipeline.learner.weights, alone.learner.weights)
        np.testing.assert_array_equal(pipeline.learner.covariance, alone.learner.covariance)
        names = ("samples", "learned", "dropped", "lost", "nmse_mean", "coverage_in_all")
        assert {k: told[k] for k in names} == {k: facts[k] for k in names}
    assert facts["samples"] == len(packets)
    assert capsys.readouterr().err.count("the live view ended") == 1


class Unserved:
    """A live view without a process: what it is sent can be read."""

    host, port, address = "127.0.0.1", 1, "http://127.0.0.1:1"
    loopback = True
    command = None
    opened: list[Any] = []

    def __init__(self, subject: Subject, host: str, port: int) -> None:
        self.subject, self.letters = subject, Mailbox(subject.layout, 64)
        self.opened.append(self)

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def problem(self) -> None:
        return None


def test_the_command_streams_beside_a_page(
    flight: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    log, record = tmp_path / "log.csv", tmp_path / "stream.nc"
    columns = ",".join(column.name for column in a_pipeline().columns)
    np.savetxt(log, flight_packets(flight)[:300], delimiter=",", header=columns, comments="")
    words = ["stream", str(log), "--robot", "aerobat", "--hidden", "4", "--idle", "0.2"]
    words += ["--prior-std", "0.3", "--measurement-std", "3e-4", "--json"]
    monkeypatch.setattr(live_view, "LiveView", Unserved)
    with pytest.raises(SystemExit) as left:
        run([*words, "--live", "--record", str(record)])
    assert left.value.code == 0
    said = capsys.readouterr()
    assert "The live view is at http://127.0.0.1:1 (loopback: this machine alone)" in said.err
    assert json.loads(said.out)["samples"] == 300
    last = Unserved.opened.pop().letters.take()[-1]
    with xr.open_dataset(record) as kept:
        assert last["samples"] == kept.sizes["time"] == 300
        for name in ("q", "v", "measurement", "prediction", "std"):
            np.testing.assert_array_equal(last[name], kept[name].values[-1])
    assert last["coverage"] == json.loads(said.out)["coverage"]


def test_what_cannot_be_shown_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fly = ["simulate", "aerobat", *FLY, "--duration", "0.1", "-o", str(tmp_path / "flight.nc")]
    dense = tmp_path / "dense.yaml"
    dense.write_text(SETTINGS.replace("strip", "dense"))

    def refusal(*words: str) -> str:
        with pytest.raises(SystemExit) as left:
            run([*fly, *words])
        assert left.value.code == 2
        return capsys.readouterr().err

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        said = refusal("--live", "--live-address", address)
    assert "live address: expected an address of this machine with a port that is free" in said
    assert address in said
    assert "HOST:PORT such as" in refusal("--live", "--live-address", "8080")
    assert "--live with it" in refusal("--live-address", address)
    assert "--live with it" in refusal("--settings", str(dense))
    assert "network of wings" in refusal("--live", "--settings", str(dense))
    monkeypatch.setattr(live_view, "find_spec", lambda name: None)
    assert "pip install 'patagium[viewer]'" in refusal("--live")
    assert not (tmp_path / "flight.nc").exists()


class Blind:
    """A page that nobody looks at; what it is sent is kept."""

    def __init__(self) -> None:
        self.command: Any = None
        self.letters = self
        self.seen: list[dict[str, Any]] = []

    def put(self, letter: dict[str, Any]) -> None:
        self.seen.append(letter)


def test_a_flight_that_breaks_down_is_told_and_flown_again() -> None:
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    aero = pt.QuasiSteady(robot, pt.Air())
    from patagium.simulation.simulator import Simulator

    begun = []

    def start(moves: Any) -> Simulator:
        begun.append(moves)
        pitch = 1.5 if len(begun) == 1 else 0.0  # near where Euler angles end
        q, v = robot.coordinates(pitch=pitch), robot.velocities(x=3.0, pitch=20.0 * (pitch > 0))
        return Simulator(robot, aero, moves, duration=0.3, time_step=1e-3, q=q, v=v)

    view, stop = Blind(), threading.Event()
    subject = flight_subject(robot, gait, None)
    assert subject.steering is not None and subject.steering.frequency == pytest.approx(5.0)
    flying = LiveFlight(start, robot, gait, 1e-3, view, subject)  # type: ignore[arg-type]

    def look() -> None:
        if view.seen and view.seen[-1]["ended"]:
            assert "R flies again" in view.seen[-1]["words"].decode()
            view.command = {"frequency": 8.0, "amplitude": 0.5, "paused": False, "resets": 1}

    flight = flying.fly(stop, look)
    assert len(begun) == 2 and any(letter["ended"] for letter in view.seen)
    assert flight.attrs["outcome"] == "COMPLETED" and flight.sizes["time"] == 301
    assert json.loads(flight.attrs["gait"])["frequency"] == 8.0
    assert view.seen[-1]["words"] == b"The flight is over."


def test_a_page_elsewhere_says_who_can_reach_it(capsys: pytest.CaptureFixture[str]) -> None:
    class Elsewhere(Unserved):
        host, loopback = "0.0.0.0", False

    robot = pt.load_robot("aerobat")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(live_view, "LiveView", Elsewhere)
        with live_words.opened(Subject(robot, robot.dof_names, None, "a robot"), "0.0.0.0:1"):
            pass
    assert "whoever reaches this machine can watch and steer" in capsys.readouterr().err
    with pytest.raises(ParameterError, match="HOST:PORT"):
        live_words._host_and_port("localhost")
    assert live_words._host_and_port("[::1]:80") == ("::1", 80)
