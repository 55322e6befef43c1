"""A robot in flight and a learner beside it: over loopback, through a pipe, from a growing file."""

from __future__ import annotations

import json
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.cli import stream as cli_stream
from patagium.cli.main import run
from patagium.learning import LinearStripNetwork, load_learner
from patagium.learning.tuning.settings_file import LearnerSettings, NetworkSettings, Settings
from patagium.live import loop, record, sources
from patagium.live.loop import Counters, Rhythm, Status, follow, summary
from patagium.live.packets import DatagramPackets, Intake, datagrams, flight_packets, send_packets
from patagium.live.pipeline import Pipeline, Records
from patagium.live.record import StreamFile
from patagium.live.sources import (
    DatagramSource,
    PacketQueue,
    TextSource,
    start_reading,
)
from patagium.sensing.force.air_force import packet_columns
from patagium.whole_file import locked

COUNT = 2000
LEARN = ("--prior-std", "0.3", "--measurement-std", "3e-4", "--spread", "1.7")


@pytest.fixture(scope="module")
def flight():
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    air, start = pt.QuasiSteady(robot, pt.Air()), robot.coordinates(x=3.0)
    return pt.simulate(robot, air, gait, duration=COUNT * 1e-4, time_step=1e-4, v=start)


@pytest.fixture(scope="module")
def packets(flight):
    return flight_packets(flight)[:COUNT]


def test_a_line_has_no_rate_before_there_is_one(pipeline):
    status = Status(Counters(pipeline.learner.network.outputs, 100.0))
    status.counters.samples = 1
    assert "nan/s" not in cli_stream.live_line(status, Intake(), pipeline)


@pytest.fixture
def pipeline():
    robot = pt.load_robot("aerobat")
    network = pt.StripNetwork(robot, (4,))
    return Pipeline(
        pt.CubatureLearner(network, prior_std=0.3, measurement_std=3e-4, spread=1.7),
        robot,
    )


def names_of(pipeline):
    return [column.name for column in packet_columns(pipeline.robot)]


def text_of(packets):
    names = [column.name for column in packet_columns(pt.load_robot("aerobat"))]
    lines = [",".join(names), *(",".join(map(repr, row)) for row in packets.tolist())]
    return ("\n".join(lines) + "\n").encode()


def learned_from(source, pipeline, sinks=(), rhythms=(), most=None, room=COUNT):
    queue, stop = PacketQueue(room, 57, Intake()), threading.Event()
    status = Status(Counters(14, 500.0))
    reader = start_reading(source, queue, stop)
    follow(queue, pipeline, status, stop, sinks=sinks, rhythms=rhythms, most=most)
    stop.set()
    queue.close()
    reader.join(5.0)
    assert not reader.is_alive()
    return summary(status, queue, pipeline)


def weights_after(packets):
    robot = pt.load_robot("aerobat")
    network = pt.StripNetwork(robot, (4,))
    learner = pt.CubatureLearner(network, prior_std=0.3, measurement_std=3e-4, spread=1.7)
    Pipeline(learner, robot).run(packets)
    return learner.weights


def test_every_packet_over_loopback_is_learned_or_counted(packets, pipeline, tmp_path):
    source = DatagramSource(57, "127.0.0.1", 0, idle=1.0)
    target = ("127.0.0.1", source.port)
    messages = list(datagrams(packets, 1.0, 4))
    messages.insert(10, messages[9])  # comes twice
    messages.insert(20, b"noise")
    messages.insert(30, messages[29][:-8])  # cut
    missing = messages.pop(40)

    def send():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
            for number, message in enumerate(messages):
                port.sendto(message, target)
                if number % 16 == 0:
                    time.sleep(2e-3)

    sender, shown = threading.Thread(target=send), []
    sender.start()
    sink = StreamFile(tmp_path / "stream.nc", pipeline)
    facts = learned_from(source, pipeline, [sink], (Rhythm(0.0, lambda: shown.append(1)),))
    sender.join()
    sink.close(facts)
    lost = (len(missing) - 16) // (57 * 8)
    assert lost == 4
    assert (facts["lost"], facts["repeated"], facts["bad_rows"], facts["dropped"]) == (4, 4, 2, 0)
    assert facts["samples"] == facts["learned"] == facts["received"] == COUNT - 4
    assert facts["gaps"] == 1
    assert len(shown) > 1
    kept = np.delete(packets, np.arange(148, 152), axis=0)
    with xr.open_dataset(tmp_path / "stream.nc") as record:
        np.testing.assert_array_equal(record["time"], kept[:, 0])
        np.testing.assert_array_equal(record["q"], kept[:, 1:15])
        np.testing.assert_array_equal(record["u1"], kept[:, 43:])
        np.testing.assert_allclose(
            pt.training_data(record)[2], record["measurement"], atol=1e-12
        )  # rounding
        assert np.isfinite(record["prediction"]).all() and not record["outcome"].any()
        assert json.loads(record.attrs["summary"])["lost"] == 4
    # the same calls in blocks of other sizes
    np.testing.assert_array_equal(pipeline.learner.weights, weights_after(kept))


def test_what_found_no_room_is_counted(packets, pipeline):
    source = DatagramSource(57, "127.0.0.1", 0, idle=0.5)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        for message in datagrams(packets[:100], 1.0, 50):
            port.sendto(message, ("127.0.0.1", source.port))
    queue = PacketQueue(30, 57, Intake())
    reader = start_reading(source, queue, threading.Event())
    reader.join(10.0)  # nobody takes anything meanwhile
    status = Status(Counters(14, 500.0))
    follow(queue, pipeline, status, threading.Event())
    facts = summary(status, queue, pipeline)
    assert (facts["received"], facts["samples"], facts["dropped"]) == (100, 30, 70)


def test_a_flight_is_sent_in_its_own_time(flight, pipeline):
    source = DatagramSource(57, "127.0.0.1", 0)
    began = time.monotonic()
    part = flight.isel(time=slice(0, 400))
    sender = threading.Thread(
        target=send_packets, args=(part, ("127.0.0.1", source.port)), kwargs={"rate": 4000.0}
    )
    sender.start()
    facts = learned_from(source, pipeline, most=300)
    sender.join()
    assert facts["samples"] == 300
    assert time.monotonic() - began > 300 / 4000.0


def test_still_thin_air_is_told_without_a_wind(tmp_path, capsys, pipeline):
    robot = pipeline.robot
    thin = pt.QuasiSteady(robot, pt.Air(density=1.1))
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    file = tmp_path / "thin.nc"
    pt.save_flight(pt.simulate(robot, thin, gait, duration=0.02, time_step=1e-3), file)
    with pytest.raises(SystemExit, match="0"):
        run(["send", str(file), "udp://127.0.0.1:9"])
    said = capsys.readouterr().err
    assert "packets hold no density 1.1 kg/m^3" in said and "wind" not in said
    with pytest.raises(SystemExit, match="2"):
        run(["stream", str(file)])
    assert f"patagium send {file} udp://" in " ".join(capsys.readouterr().err.split())


def test_what_a_mount_gives_is_not_learned_as_the_force_of_the_air(tmp_path, capsys, pipeline):
    robot, file = pipeline.robot, tmp_path / "held.nc"
    aero = pt.QuasiSteady(robot, pt.Air(wind=(-3.0, 0.0, 0.0)))
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    held = pt.simulate(robot, aero, gait, duration=0.02, time_step=1e-4, mount=pt.mounts.fixed())
    pt.save_flight(held, file)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(("127.0.0.1", 0))
        port.settimeout(10.0)
        with pytest.raises(SystemExit, match="0"):
            run(["send", str(file), f"udp://127.0.0.1:{port.getsockname()[1]}", "--rows", "50"])
        messages = [port.recv(50_000) for _ in range(5)]
    assert "packets hold no wind" in capsys.readouterr().err
    reader = DatagramPackets(57, Intake())
    found = pipeline.run(np.concatenate([reader.take(one) for one in messages])).measurement
    np.testing.assert_allclose(found, held.aero_force.values, atol=1e-9)


def test_a_pipe_is_learned_to_its_end(packets, pipeline):
    out, into = os.pipe()
    lines = text_of(packets).split(b"\n")
    lines[50] = b"what is this"

    def write():
        with os.fdopen(into, "wb") as pipe:
            pipe.write(b"\n".join(lines))

    writer = threading.Thread(target=write)
    writer.start()
    facts = learned_from(TextSource(names_of(pipeline), pipe=out), pipeline, room=64)
    writer.join()
    os.close(out)
    assert (facts["samples"], facts["bad_rows"], facts["dropped"]) == (COUNT - 1, 1, 0)
    expected = weights_after(np.delete(packets, 49, axis=0))
    np.testing.assert_array_equal(pipeline.learner.weights, expected)


def test_a_pipe_that_falls_silent_ends(packets, pipeline):
    """`--idle` was ignored, so that a hung writer held the stream for ever."""
    out, into = os.pipe()
    os.write(into, text_of(packets[:50]))
    writer = threading.Timer(60.0, os.close, [into])
    writer.start()
    source = TextSource(names_of(pipeline), pipe=out, idle=0.2)
    assert learned_from(source, pipeline)["samples"] == 50
    assert writer.is_alive()  # it did not wait for the end of the text
    writer.cancel()
    os.close(into)
    os.close(out)
    assert sources.source_of("-", names_of(pipeline), idle=0.2)._idle == 0.2


def test_a_file_that_grows_is_followed(packets, pipeline, tmp_path):
    path, text = tmp_path / "log.csv", text_of(packets)
    cut = len(text) // 3  # in the middle of a line
    path.write_bytes(text[:cut])

    def write():
        time.sleep(0.2)
        with path.open("ab") as file:
            file.write(text[cut:])

    writer = threading.Thread(target=write)
    writer.start()
    facts = learned_from(TextSource(names_of(pipeline), path, idle=0.6), pipeline)
    writer.join()
    assert facts["samples"] == COUNT and facts["bad_rows"] == 0
    np.testing.assert_array_equal(pipeline.learner.weights, weights_after(packets))


def test_a_file_that_is_cut_is_read_anew(packets, pipeline, tmp_path):
    """Rows of a log that began anew were missing without a word, up to the old one's length."""
    path, names = tmp_path / "log.csv", names_of(pipeline)
    path.write_bytes(text_of(packets[:100]) + b"1,2")
    queue, stop = PacketQueue(COUNT, len(names), Intake(), pipeline.robot), threading.Event()
    reader = start_reading(TextSource(names, path, idle=5.0), queue, stop)
    for begin, end in ((0, 100), (100, 150)):
        if begin:
            path.write_bytes(text_of(packets[begin:end]))  # shorter than what was read
        found = np.empty((0, len(names)))
        while len(found) < end - begin and reader.is_alive():
            found = np.concatenate([found, queue.take(COUNT, 0.1)])
        np.testing.assert_array_equal(found, packets[begin:end])
    stop.set()
    reader.join(10.0)
    assert queue.notes == [f"Warning: {path} was cut, and is read anew"]
    assert queue.intake.examples == ["line 102: the text ends within it"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_interrupted_it_writes_what_it_has(packets, tmp_path, number):
    log, record, model = (tmp_path / name for name in ("log.csv", "stream.nc", "model.json"))
    log.write_bytes(text_of(packets))
    words = ["stream", str(log), "--robot", "aerobat", "--hidden", "4", *LEARN]
    words += ["--record", str(record), "--model", str(model), "--json"]
    words += ["--state", str(tmp_path / "state"), "--autosave", "0.1"]
    program = "import sys; from patagium.cli.main import run; run(sys.argv[1:])"
    process = subprocess.Popen(
        [sys.executable, "-c", program, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    assert process.stderr is not None
    assert any(" samples, " in line for line in process.stderr)  # it has begun
    process.send_signal(number)
    if number == signal.SIGHUP:
        process.send_signal(number)  # a terminal that is closed may send more than one
    out, _ = process.communicate(timeout=300)
    assert process.returncode == 0
    samples = json.loads(out)["samples"]
    assert 0 < samples <= COUNT
    with xr.open_dataset(record) as kept:
        np.testing.assert_array_equal(kept["time"], packets[:samples, 0])
    assert json.loads(model.read_text())["source"].endswith("log.csv")
    kept_files = ["log.csv", "model.json", "state", "stream.nc"]
    assert sorted(p.name for p in tmp_path.iterdir()) == kept_files
    np.testing.assert_array_equal(
        load_learner(tmp_path / "state").weights, weights_after(packets[:samples])
    )


def test_a_stream_goes_on_where_the_last_one_stood(packets, tmp_path, capsys):
    log, state = tmp_path / "log.csv", tmp_path / "learner.state"
    words = ["stream", str(log), "--robot", "aerobat", "--hidden", "4", *LEARN, "--idle", "0.1"]
    for part in (packets[:150], packets[150:400]):
        log.write_bytes(text_of(part))
        with pytest.raises(SystemExit) as left:
            run([*words, "--state", str(state)])
        assert left.value.code == 0
    assert "150 samples learned before" in capsys.readouterr().err
    learner = load_learner(state)
    assert learner.count == 400
    np.testing.assert_array_equal(learner.weights, weights_after(packets[:400]))


def test_a_network_with_memory_goes_on_where_it_stood(packets, tmp_path, capsys):
    log, words = tmp_path / "log.csv", ["stream", "", "--robot", "aerobat", "--idle", "0.1"]
    words[1] = str(log)
    words += ["--settings", str(tmp_path / "attached.yaml"), "--json"]
    network = NetworkSettings.of(LinearStripNetwork(pt.load_robot("aerobat"), attached=True))
    Settings(every=1, network=network, learner=LearnerSettings()).save(tmp_path / "attached.yaml")
    for state, part in (("a", packets[:20]), ("a", packets[20:50]), ("b", packets[:50])):
        log.write_bytes(text_of(part))
        with pytest.raises(SystemExit) as left:
            run([*words, "--state", str(tmp_path / state)])
        assert left.value.code == 0
        assert json.loads(capsys.readouterr().out)["memory_resets"] == 0
    pieces, whole = (load_learner(tmp_path / state) for state in "ab")
    assert whole.count == 50
    np.testing.assert_array_equal(pieces.weights, whole.weights)


def test_options_reach_the_learner(packets, tmp_path, capsys):
    log, record = tmp_path / "log.csv", tmp_path / "stream.nc"
    log.write_bytes(text_of(packets[:100]))
    words = ["stream", str(log), "--robot", "aerobat", "--hidden", "4", *LEARN, "--idle", "0.1"]
    words += ["--covariance", "node", "--dtype", "float32", "--outlier-std", "6"]
    words += ["--noise-memory", "500", "--change-window", "10", "--change-reference", "200"]
    words += ["--false-alarm-rate", "1e-6", "--samples", "80", "--record", str(record)]
    with pytest.raises(SystemExit) as left:
        run(words)
    assert left.value.code == 0
    assert "samples" in capsys.readouterr().out
    with xr.open_dataset(record) as kept:
        assert kept.sizes["time"] == 80
        learner = json.loads(kept.attrs["learner"])
    assert (learner["covariance"], learner["dtype"]) == ("node", "float32")
    assert learner["screening"]["outlier_std"] == 6.0
    assert learner["noise_estimation"]["memory"] == 500
    assert learner["change_detection"]["window"] == 10


def test_what_was_learned_before_reading_failed_is_kept(packets, tmp_path, capsys, monkeypatch):
    log, record = tmp_path / "log.csv", tmp_path / "stream.nc"
    log.write_bytes(text_of(packets[:100]))

    class Unplugged(TextSource):
        def read(self, queue, stop):
            super().read(queue, stop)
            raise OSError(5, "Input/output error", str(log))

    monkeypatch.setattr(sources, "TextSource", Unplugged)
    words = ["stream", str(log), "--robot", "aerobat", "--hidden", "4", *LEARN, "--idle", "0.1"]
    with pytest.raises(SystemExit) as left:
        run([*words, "--record", str(record)])
    said = capsys.readouterr()
    assert left.value.code == 2 and said.err.endswith("log.csv: Input/output error\n")
    with xr.open_dataset(record) as kept:
        assert kept.sizes["time"] == 100


@pytest.fixture
def told(packets, tmp_path):
    """Words of a stream with a state and a model, and what it wrote to stderr and left with."""
    (tmp_path / "log.csv").write_bytes(text_of(packets[:600]))
    words = ["stream", str(tmp_path / "log.csv"), "--robot", "aerobat", "--hidden", "4", *LEARN]
    words += ["--idle", "0.1", "--state", str(tmp_path / "state")]
    return [*words, "--model", str(tmp_path / "model.json")]


def test_a_recording_that_fails_costs_neither_learner_nor_model(packets, told, tmp_path):
    """In a process of its own, since HDF5 never closes a file that it cannot write to the end."""
    program = "from patagium.live import record; record._AT_ONCE = 100; import sys;"
    program += "from patagium.cli.main import run; run(sys.argv[1:])"
    said = subprocess.run(
        [sys.executable, "-c", program, *told, "--record", str(tmp_path / "stream.nc"), "--json"],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000)),  # B
        capture_output=True, text=True,
    )  # fmt: skip
    assert said.returncode == 2
    assert said.stderr.count("stream.nc: cannot be written: File too large; free space") == 1
    assert said.stderr.endswith("patagium: not saved: recording; all else was\n")
    assert json.loads(said.stdout)["samples"] == 600
    assert {p.name for p in tmp_path.iterdir()} == {"log.csv", "state", "model.json"}
    kept = load_learner(tmp_path / "state")
    np.testing.assert_array_equal(kept.weights, weights_after(packets[:600]))


def test_a_record_ends_whole_before_the_disk_is_full(told, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(record, "_AT_ONCE", 100)
    room = iter([True, True, True])
    monkeypatch.setattr(StreamFile, "_has_room", lambda self: next(room, False))
    monkeypatch.setattr(loop, "BLOCK", 100)
    with pytest.raises(SystemExit) as left:
        run([*told, "--record", str(tmp_path / "stream.nc"), "--json"])
    assert left.value.code == 2
    assert "recording: " in (said := capsys.readouterr().err) and "nearly full" in said
    with xr.open_dataset(tmp_path / "stream.nc") as kept:
        assert kept.sizes["time"] == json.loads(kept.attrs["summary"])["recorded"] == 300
    assert (tmp_path / "state").exists()


def test_outputs_that_cannot_be_printed_or_saved_cost_no_other(told, packets, tmp_path):
    told[-1] = "/dev/full"
    program = "import sys; from patagium.cli.main import run; run(sys.argv[1:])"
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-c", program, *told]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
        silent = subprocess.run(command, stdout=full, stderr=full)
    assert done.returncode == silent.returncode == 2
    assert done.stderr.endswith("patagium: not saved: model, summary; all else was\n")
    assert "patagium: summary: stdout: cannot be written: No space left" in done.stderr
    assert "Traceback" not in done.stderr
    assert load_learner(tmp_path / "state").count == 1200


def run_to_its_end(words):
    with pytest.raises(SystemExit) as left:
        run(words)
    assert left.value.code in (0, None)


@pytest.mark.parametrize("name", ["state", "stream.nc"])
def test_a_state_and_a_record_have_one_stream_at_a_time(name, told, tmp_path, capsys):
    """Of two streams with one record, that which ended last replaced the other's."""
    with locked(tmp_path / name), pytest.raises(SystemExit) as left:
        run([*told, "--record", str(tmp_path / "stream.nc")])
    assert left.value.code == 2
    assert f"{name}: cannot be written: process {os.getpid()} " in (said := capsys.readouterr().err)
    assert "end that process, or name another file" in said
    assert [p.name for p in tmp_path.iterdir()] == ["log.csv"]


def test_a_stream_without_a_packet_leaves_the_files_of_the_one_before(told, tmp_path, capsys):
    """An empty record and the untrained prior replaced those of a night, with exit code 0."""
    log, record, model = (tmp_path / name for name in ("log.csv", "stream.nc", "model.json"))
    words = [word for word in told if word not in ("--state", str(tmp_path / "state"))]
    words += ["--record", str(record), "--samples", "50"]
    record.write_bytes(b"of an evening before")
    run_to_its_end(words)
    said = capsys.readouterr().err
    assert (
        "The record of 50 samples is in" in said and said.count("in place of the one before") == 1
    )
    before = record.read_bytes(), model.read_bytes()
    log.write_bytes(text_of(np.empty((0, 57))))
    with pytest.raises(SystemExit, match="2"):
        run(words)
    said = " ".join(capsys.readouterr().err.split())
    assert "stream.nc: expected packets to record, found none; nothing is written" in said
    assert said.endswith("not saved: recording, model; all else was")
    assert (record.read_bytes(), model.read_bytes()) == before
    assert sorted(one.name for one in tmp_path.iterdir()) == ["log.csv", "model.json", "stream.nc"]


def test_only_a_sender_with_the_key_is_learned_from(flight, packets, tmp_path, capsys, monkeypatch):
    saved, key = tmp_path / "flight.nc", tmp_path / "key"
    pt.save_flight(flight.isel(time=slice(0, 200)), saved)
    key.write_text("a key that nobody knows\n")
    key.chmod(0o600)
    listening = DatagramSource.__init__

    def listen(self, *words, **options):
        listening(self, *words, **options)
        target = ("127.0.0.1", self.port)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            for message in datagrams(packets[:7], 1.0):
                stranger.sendto(message, target)
        with pytest.raises(SystemExit) as left:
            words = [str(saved), f"udp://127.0.0.1:{self.port}", "--rate", "1e5"]
            run(["send", *words, "--key-file", str(key)])
        assert left.value.code == 0

    monkeypatch.setattr(DatagramSource, "__init__", listen)
    words = ["stream", "udp://0.0.0.0:0", "--robot", "aerobat", "--hidden", "4", *LEARN, "--json"]
    with pytest.raises(SystemExit) as left:
        run([*words, "--idle", "0.5", "--key-file", str(key)])
    assert left.value.code == 0
    said = capsys.readouterr()
    assert "listened for at 0.0.0.0, beyond this machine: only those with the tag" in said.err
    assert "patagium: not used: datagram: its tag is missing or not that of the key" in said.err
    facts = json.loads(said.out)
    assert (facts["samples"], facts["unauthenticated"], facts["lost"]) == (200, 7, 0)


@pytest.mark.parametrize("block", [1, 300])
def test_time_flown_is_that_of_packets_in_order(packets, pipeline, block):
    """Time flown counted steps after a late packet twice, and a wrong stamp for ever."""
    sent = packets[:300].copy()
    sent[150, 0] = 1e9
    sent = np.insert(sent, 60, sent[10], axis=0)
    status = Status(Counters(14, 500.0))
    for begin in range(0, len(sent), block):
        part = sent[begin : begin + block]
        status.count(part, pipeline.run(part))
    step = packets[1, 0] - packets[0, 0]
    assert status.flown == pytest.approx(299 * step, abs=12 * step)
    assert status.gaps == 1


@pytest.mark.parametrize("block", [1, 20, 512])
def test_gaps_do_not_depend_on_the_size_of_the_calls(block):
    """Gaps in a block were judged by one median step: 25 packet by packet, none by hundreds."""
    stamps = np.r_[np.arange(800) * 2e-4, 0.16 + np.arange(200) * 2e-3]  # 5 kHz, then 500 Hz
    status, rows = Status(Counters(14, 500.0)), np.zeros((len(stamps), 3 * 14 + 4))
    for begin in range(0, len(stamps), block):
        part = slice(begin, begin + block)
        status.count(stamps[part, None], Records(rows[part]))
    assert status.gaps == 25  # half of the 50 steps of the median
    assert status.flown == pytest.approx(stamps[-1])  # rounding; ten usual steps are no less


def test_a_record_of_a_stream_is_sent_and_clocks_that_jump_do_not_stop_it(
    packets, pipeline, tmp_path, capsys, monkeypatch
):
    sent, file = packets[:60].copy(), tmp_path / "stream.nc"
    sent[40:, 0] += 1e9
    sink = StreamFile(file, pipeline)
    sink.append(sent, pipeline.run(sent))
    sink.close({})
    with pytest.raises(SystemExit, match="2"):
        run(["stream", str(file)])
    assert f"it is sent: patagium send {file} udp://" in " ".join(capsys.readouterr().err.split())
    waits: list[float] = []
    monkeypatch.setattr(time, "sleep", waits.append)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(("127.0.0.1", 0))
        port.settimeout(10.0)
        with pytest.raises(SystemExit, match="0"):
            run(["send", str(file), f"udp://127.0.0.1:{port.getsockname()[1]}", "--rows", "60"])
        with pytest.raises(SystemExit, match="0"):
            run(["send", str(file), f"udp://127.0.0.1:{port.getsockname()[1]}"])
        got = DatagramPackets(57, Intake()).take(port.recv(50_000))
    np.testing.assert_array_equal(got, sent)
    assert 0.9 < max(waits) < 1.1  # s; a step counts one at most
    for address in ("udp://127.0.0.1:0", "udp://255.255.255.255:9000"):
        with pytest.raises(SystemExit, match="2"):
            run(["send", str(file), address])
        words = " ".join(capsys.readouterr().err.split())
        assert "target: expected an address of one machine" in words and address in words


def test_a_record_keeps_little_in_memory(pipeline, tmp_path):
    """Caches of its variables grew to hundreds of MB with the record."""
    kept = StreamFile(tmp_path / "stream.nc", pipeline)
    caches = [one.get_var_chunk_cache()[0] for one in kept._file.variables.values()]
    kept.discard()
    over_time = len(kept._parts) + 7
    assert sum(size <= 1 << 20 for size in caches) >= over_time


@pytest.mark.parametrize("fault", ["doubled", "late", "not a number", "leap", "reset"])
def test_a_record_with_one_bad_packet_is_used(packets, pipeline, tmp_path, fault):
    """One such packet made the whole record useless; only what it spoils is left out."""
    bad, left = packets[:300].copy(), 1
    if fault == "doubled":
        bad = np.insert(bad, 100, bad[99], axis=0)
    elif fault == "late":
        bad = np.insert(bad, 100, bad[50], axis=0)
    elif fault == "not a number":
        bad[100, 3] = np.nan
    elif fault == "leap":
        bad[100, 0] = 1e9
    else:
        bad[200:, 0], left = bad[:100, 0], 100
    record = StreamFile(tmp_path / "stream.nc", pipeline)
    record.append(bad, pipeline.run(bad))
    file = record.close({})
    with pytest.warns(UserWarning, match=rf"{left} of {len(bad)} samples are left out"):
        log = pt.load_log(file)
    time, x, y = pt.training_data(log)
    assert len(time) == len(bad) - left and (np.diff(time) > 0).all()
    assert np.isfinite(x).all() and np.isfinite(y).all()
    assert pt.replay(log, tmp_path / "page.html").is_file()


def test_the_air_is_that_of_the_log_and_of_the_options(packets, tmp_path, capsys):
    windy = pt.simulate(
        pt.load_robot("aerobat"), duration=0.02, time_step=1e-4,
        aero=pt.QuasiSteady(pt.load_robot("aerobat"), pt.Air(1.1, (-2.0, 0.0, 0.0))),
    )  # fmt: skip
    log = pt.sense(windy, [pt.sensors.presets.as5600(rate=1000.0)])
    file = pt.sensing.save_sensor_log(log, tmp_path / "log.nc")
    for robot in (None, "aerobat"):
        assert cli_stream._robot_and_air(str(file), robot)[1] == pt.Air(1.1, (-2.0, 0.0, 0.0))
    text, flown = tmp_path / "text.csv", pt.save_flight(windy, tmp_path / "flight.nc")
    text.write_bytes(text_of(packets))
    dense = ("--network", "dense", "--hidden", "4", "--scale-by", flown)
    with pytest.raises(SystemExit) as left:
        run([str(k) for k in ("stream", text, "--robot", "aerobat", *dense, "--density", "1.1")])
    assert left.value.code == 2 and "--density, --wind" in capsys.readouterr().err


def test_refusals_are_one_sentence(tmp_path, capsys):
    log = tmp_path / "log.csv"
    log.write_text("time,q.x\n1,2\n")
    taken = socket.create_server(("127.0.0.1", 0))
    address = f"127.0.0.1:{taken.getsockname()[1]}"
    raw = tmp_path / "raw.csv"
    raw.write_text("time,imu.specific_force.x\n0,1\n")
    for words, found in (
        ([str(log)], "expected a header with the columns"),
        ([str(raw)], "expected the line `# sensors {...}` before it, or a header"),
        ([str(log), "--network", "dense"], "--scale-by: expected a flight"),
        ([str(log), "--change-window", "0"], "--change-window: expected a number of at least 1"),
        ([str(log), "--learner", "extended", "--spread", "9"], "--spread: expected nothing"),
        (["udp://127.0.0.1"], "udp://ADDRESS:PORT"),
        (["udp://127.0.0.1:0", "--key-file", "none"], "--key-file: expected a file"),
        ([str(tmp_path / "none.csv")], "found no such file"),
    ):
        with pytest.raises(SystemExit) as left:
            run(["stream", *words, "--robot", "aerobat", *LEARN, "--idle", "0.1"])
        said = capsys.readouterr().err.strip().splitlines()
        assert left.value.code == 2
        assert found in said[-1]
    assert sorted(Path(p).name for p in tmp_path.iterdir()) == ["log.csv", "raw.csv"]
    with taken, pytest.raises(SystemExit):
        words = ["stream", "udp://127.0.0.1:0", "--robot", "aerobat", *LEARN]
        run([*words, "--live", "--live-address", address])
    said = capsys.readouterr().err
    assert "a free port (--live-address HOST:PORT)" in said and "Listening" not in said


def test_packets_in_degrees_are_told_once():
    robot = pt.load_robot("ornithopter")
    radians = np.zeros((50, len(packet_columns(robot))))
    degrees, column = radians.copy(), 1 + robot.index("left_plunge")
    radians[:, column], degrees[:, column] = 0.5, np.rad2deg(0.5)
    for rows, count in ((degrees, 1), (radians, 0)):
        queue = PacketQueue(100, rows.shape[1], Intake(), robot)
        queue.put(rows, waits=False)
        for _ in range(2):
            queue.take(25, 0.1)
        assert len(queue.notes) == count
        assert not count or "q.left_plunge reaches 28.65 rad" in queue.notes[0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rows, n: rows, ""),
        (
            lambda rows, n: rows * np.r_[1e3, np.ones(4 * n)],
            "v.left_plunge is 1e+03 times as fast as q",
        ),
        (lambda rows, n: rows * np.r_[np.ones(1 + n), np.full(n, 57.3), np.ones(2 * n)], "is 57.3"),
        (lambda rows, n: rows * np.r_[np.ones(1 + 2 * n), np.zeros(n), np.ones(n)], "a is zero"),
        (lambda rows, n: rows * 1e200, ""),
        (lambda rows, n: np.where(rows, np.nan, np.nan), ""),
    ],
)
def test_stamps_and_rates_in_other_units_are_told(packets, change, words):
    robot = pt.load_robot("aerobat")
    changed = change(packets[:1000:10], robot.dof)
    queue = PacketQueue(100, changed.shape[1], Intake(), robot)
    queue.put(changed, waits=False)
    while len(queue.take(7, 0.0)):
        pass
    assert (words in "".join(queue.notes)) if words else not queue.notes


def test_the_first_packets_are_compared_now_and_then_and_no_longer(packets, monkeypatch):
    # Each packet of the first thousand had all before it compared again: two milliseconds each.
    looked = []
    monkeypatch.setattr(
        sources, "packet_doubts", lambda robot, rows: looked.append(len(rows)) or []
    )
    queue = PacketQueue(2000, packets.shape[1], Intake(), pt.load_robot("aerobat"))
    queue.put(np.resize(packets, (1200, packets.shape[1])), waits=False)
    for _ in range(1200):
        queue.take(1, 0.0)
    assert looked == [*range(1, 1000, 50)]


def test_no_patience_ends_a_file_at_its_end(packets, tmp_path):
    path = tmp_path / "log.csv"
    names = [str(one.name) for one in packet_columns(pt.load_robot("aerobat"))]
    rows = "\n".join(",".join(map(repr, row.tolist())) for row in packets[:3])
    path.write_text(f"{','.join(names)}\n{rows}\n")
    queue, stop = PacketQueue(10, len(names), Intake()), threading.Event()
    reading = threading.Thread(target=TextSource(names, path, idle=0.0).read, args=(queue, stop))
    reading.start()
    reading.join(10.0)
    stop.set()
    assert len(queue.take(10, 1.0)) == 3 and not reading.is_alive()
