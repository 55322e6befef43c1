"""The live page: a learner with a page learns as without one. A browser is in `tests/lab`."""

from __future__ import annotations

import http.client
import json
import socket
import threading
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.cli import live as live_words
from patagium.cli.main import run
from patagium.errors import ParameterError
from patagium.live.loop import Counters, Rhythm, Status, follow, summary
from patagium.live.packets import Intake, flight_packets
from patagium.live.pipeline import Pipeline
from patagium.live.sources import PacketQueue
from patagium.viewer import live_view
from patagium.viewer.live_flight import LiveFlight, flight_subject
from patagium.viewer.live_frames import Mailbox, Subject

pytest.importorskip("viser", reason="viser is not installed: pip install 'patagium[viewer]'")

LEARN = {"prior_std": 0.3, "measurement_std": 3e-4, "spread": 1.7}
SETTINGS = f"""
every: 2
network: {{kind: strip, hidden: [4]}}
learner: {json.dumps({"kind": "cubature", **LEARN})}
"""
BEAT = ("--gait", "sinusoidal", "--frequency", "5 Hz", "--plunge", "0.6")
FLY = (*BEAT, "--speed", "3 m/s", "--time-step", "1e-3")


@pytest.fixture(scope="module")
def flight():
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    air, start = pt.QuasiSteady(robot, pt.Air()), robot.velocities(x=3.0)
    return pt.simulate(robot, air, gait, duration=0.4, time_step=1e-4, v=start)


def a_pipeline() -> Pipeline:
    robot = pt.load_robot("aerobat")
    return Pipeline(pt.CubatureLearner(pt.StripNetwork(robot, (4,)), **LEARN), robot)


def learned(packets: Any, pipeline: Pipeline, view: Any = None, at_half: Any = None) -> Any:
    """The stream as `patagium stream` learns it, beside a page or not."""
    status, intake = Status(Counters(14, 500.0)), Intake()
    queue = PacketQueue(len(packets), packets.shape[1], intake)
    queue.put(packets, waits=False)
    queue.close()
    sinks, rhythms = (), ()
    if view is not None:
        shown = live_words.beside_stream(view, pipeline, status, intake)
        sinks, rhythms = shown.sinks, shown.rhythms
    if at_half is not None:
        rhythms = (*rhythms, Rhythm(0.0, at_half))
    follow(queue, pipeline, status, threading.Event(), sinks=sinks, rhythms=rhythms)
    return summary(status, queue, pipeline)


def answer(port: int, path: str) -> int:
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as asking:
        asking.request("GET", path)
        return asking.getresponse().status


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
        assert sent > 1 and view.loopback
        place, token = view.address.rsplit("/", 1)
        assert place == f"http://127.0.0.1:{view.port}" and len(token) == 43  # 256 bits
        assert [answer(view.port, path) for path in (f"/{token}", "/")] == [200, 403]
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


def test_an_interval_that_is_wide_at_first_does_not_flatten_the_force() -> None:
    from patagium.viewer.live_page import LivePlots

    robot = pt.load_robot("aerobat")
    plots: Any = LivePlots.__new__(LivePlots)
    plots._subject = SimpleNamespace(outputs=("z",), network=object(), robot=robot)
    time, force, std = np.arange(50.0), np.sin(np.arange(50.0)), np.full(50, 0.01)
    std[0] = 100.0
    plots._trace = np.column_stack([time, force, force, std])
    _, measured, _, low, high = plots._lines("z")
    assert max(high.max(), -low.min()) < 4 * np.abs(measured).max()  # it was 196 N
    np.testing.assert_allclose((high - low)[1:], 2 * 1.96 * 0.01, rtol=1e-3)


def test_plots_of_a_learner_that_has_not_begun_have_limits() -> None:
    """A first value of NaN, from which uPlot took its limits, left plots empty.

    Rows of the flight before stood among those of the next.
    """
    from patagium.viewer.live_page import LivePlots

    robot = pt.load_robot("aerobat")
    subject: Any = SimpleNamespace(outputs=("z",), network=object(), robot=robot)
    plots = LivePlots(MagicMock(), subject, MagicMock())
    charts = plots._plots[0], plots._error, plots._coverage = [MagicMock() for _ in range(3)]
    time, force = np.r_[9.0, np.arange(3.0)], np.array([5.0, 1.0, 2.0, 3.0])
    guess = np.array([5.0, np.nan, 2.5, np.inf])
    letter = {"trace": np.column_stack([time, force, guess, 0.1 * guess]), "traced": 4, "time": 2.0}
    for score in (np.nan, 0.1):
        plots.add(letter | {"nmse": score, "coverage": score})
    plots.draw()
    for chart in charts:
        assert all(np.isfinite(line[0]) and not np.isinf(line).any() for line in chart.data)
    assert plots._plots[0].data[0].max() == 2.0
    plots._scores[:, 1:] = np.nan
    plots.draw()
    assert np.isfinite([line[0] for line in plots._error.data]).all()


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
    assert "expected one of this machine with a free port (--live-address HOST:PORT)" in said
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
    assert "not encrypted: whoever has it can watch and steer" in capsys.readouterr().err
    with pytest.raises(ParameterError, match="HOST:PORT"):
        live_words._host_and_port("localhost")
    assert live_words._host_and_port("[::1]:80") == ("::1", 80)
