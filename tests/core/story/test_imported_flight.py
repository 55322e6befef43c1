"""A flight as another program would have logged it: imported, learned from, and streamed."""

import json
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

import patagium as pt
from patagium.cli.main import run
from patagium.errors import FlightError, LogError
from patagium.live.packets import flight_packets
from patagium.sensing import training_data
from patagium.sensing.logs.record import LogRecord
from patagium.simulation import air_of, robot_of
from patagium.viewer.replay import replay_content

PARTS = ("q", "v", "a", "u1")
LEARN = ("--network", "strip", "--prior-std", "0.3", "--measurement-std", "3e-4",
         "--spread", "1.7", "--json")  # fmt: skip


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    robot = pt.load_robot("aerobat")
    aero = pt.QuasiSteady(robot, pt.Air(density=1.225, wind=(-3.0, 0.0, 0.0)))
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    return pt.simulate(robot, aero, gait, duration=0.05, time_step=1e-4)


@pytest.fixture
def log(flight: xr.Dataset, tmp_path: Path) -> Path:
    """The flight in degrees and milliseconds, and a mapping that says so."""
    table, channels = {"ms": 1e3 * flight["time"].to_numpy()}, []
    for part in PARTS:
        for dof, length in zip(flight["dof"].values, flight["dof_unit"].values, strict=True):
            turns = length == "rad" and part != "u1"
            values = flight[part].sel(dof=dof).to_numpy()
            table[f"{part}_{dof}"] = np.degrees(values) if turns else values
            unit = {"q": "", "v": "/s", "a": "/s^2"}.get(part, "")
            written = ("deg" if turns else "m") + unit
            force = "N" if length == "m" else "N m"
            channels.append(
                {"column": f"{part}_{dof}", "name": f"{part}.{dof}",
                 "unit": force if part == "u1" else written}
            )  # fmt: skip
    pd.DataFrame(table).to_parquet(tmp_path / "log.parquet")
    words = {
        "time": {"column": "ms", "unit": "ms"},
        "robot": "aerobat",
        "channels": channels,
        "air": {"wind": [-3, 0, 0]},
    }
    (tmp_path / "map.yaml").write_text(json.dumps(words), encoding="utf-8")
    return tmp_path / "log.parquet"


def say(*words: object) -> None:
    with pytest.raises(SystemExit) as left:
        run([str(word) for word in words])
    assert left.value.code in (0, None)


def test_a_flight_comes_back_and_is_learned_from(
    flight: xr.Dataset, log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, native = log.with_name("out.nc"), log.with_name("native.nc")
    say("import", log, "--map", log.with_name("map.yaml"), "-o", out)
    with LogRecord(out) as record:
        assert record.is_flight
        back = record.flight()
    for part in PARTS:
        scale = np.abs(flight[part]).max().item()
        np.testing.assert_allclose(back[part], flight[part], rtol=1e-12, atol=1e-12 * scale)
    capsys.readouterr()
    pt.save_flight(flight, native)
    worst, mapped = [], (log, "--mapping", log.with_name("map.yaml"))
    for words in ((out,), (native,), mapped):  # the last is imported on the way
        say("identify", *words, *LEARN, "--every", "10")
        worst.append(json.loads(capsys.readouterr().out)["nmse_worst"])
    assert worst[0] == worst[2]
    assert worst[0] == pytest.approx(worst[1], rel=1e-3)  # stamps are whole nanoseconds
    say("check", *mapped, "--json")
    assert json.loads(capsys.readouterr().out)["a flight"]


def test_forces_where_no_motor_is_need_not_be_in_a_log(log: Path) -> None:
    """A free body has none: files to learn from and to stream are those of a log with zeros."""
    file = log.with_name("map.yaml")
    words = json.loads(file.read_text(encoding="utf-8"))
    whole = pt.import_log(log, file, log.with_name("whole.nc")).path
    rows = pd.read_csv(pt.import_log(log, file, log.with_name("whole.csv")).path, comment="#")
    base = {f"u1.{name}" for name in ("x", "y", "z", "roll", "pitch", "yaw")}
    words["channels"] = [one for one in words["channels"] if one["name"] not in base]
    file.write_text(json.dumps(words), encoding="utf-8")
    less = pt.import_log(log, file, log.with_name("less.nc"))
    assert any(text.text.startswith("taken as zero") for text in less.findings)
    assert not any("never moves" in text.text for text in less.findings)
    for part in PARTS:
        assert np.array_equal(pt.load_log(less.path)[part], pt.load_log(whole)[part])
    again = pd.read_csv(pt.import_log(log, file, log.with_name("less.csv")).path, comment="#")
    pd.testing.assert_frame_equal(again[rows.columns], rows, check_dtype=False)
    still = pd.read_parquet(log)
    bound = [one for one in still if one[:2] in ("q_", "v_") and f"u1.{one[2:]}" in base]
    assert len(bound) == 12
    still.assign(**dict.fromkeys(bound, 0.0)).to_parquet(log.with_name("held.parquet"))
    held = pt.import_log(log.with_name("held.parquet"), file, log.with_name("held.nc"))
    assert any("never moves" in text.text for text in held.findings)
    words["channels"] = [one for one in words["channels"] if one["name"] != "u1.left_plunge"]
    file.write_text(json.dumps(words), encoding="utf-8")
    with LogRecord(pt.import_log(log, file, log.with_name("less.nc")).path) as record:
        assert not record.is_flight and not base & set(record.labels)


@pytest.mark.parametrize("every", [1, 3])
def test_a_torque_that_is_missing_costs_no_other_force(
    log: Path, every: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All samples were left out, or refused."""
    table, out = pd.read_parquet(log), tmp_path / "out.nc"
    table.loc[::every, "u1_left_plunge"] = np.nan
    table.to_parquet(log)
    say("import", log, "--map", log.with_name("map.yaml"), "-o", out)
    found = pt.load_log(out)
    lost = np.isnan(found["u1"].sel(dof="left_plunge"))
    assert found.sizes["time"] == len(table) and lost.sum() == lost[::every].size
    scores = pt.identify(found, every=5).scores["nmse_second_half"]
    assert scores["z"] < 0.02 and scores["right_plunge"] < 0.02
    assert np.isnan(scores["left_plunge"]) == (every == 1)
    capsys.readouterr()
    say("stream", out, "--json")
    assert json.loads(capsys.readouterr().out)["learned"] > 0.9 * len(table)


def test_an_imported_flight_is_shown(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The page shows the aerodynamic force and moment on the robot; a log has no strips."""
    out, page = tmp_path / "out.nc", tmp_path / "out.html"
    say("import", log, "--map", log.with_name("map.yaml"), "-o", out)
    say("view", out, "-o", page)
    assert "cycles" not in capsys.readouterr().out and page.stat().st_size > 1e5
    shown, loaded = replay_content(pt.load_log(out)), pt.load_log(out)
    force = training_data(loaded)[2]
    assert shown.arrows is not None and shown.arrows.force is None
    assert "on strips" not in " ".join(shown.notes)  # the notes told of arrows on strips
    np.testing.assert_allclose(shown.arrows.total, force[:: len(force) // len(shown.time), :3])
    assert "Wind at first: (-3, 0, 0)" in "".join(shown.notes)
    loaded["u1"][::2, 6] = np.nan
    loaded["u1"][:, 7] = np.nan
    part = replay_content(loaded)
    assert len(part.time) == len(loaded.time) // 2
    assert str(loaded.dof.values[7]) not in [
        one.name for one in part.series if "force" in one.group
    ]
    words = json.loads(log.with_name("map.yaml").read_text(encoding="utf-8"))
    words["channels"] = [one for one in words["channels"] if one["name"][:2] == "q."]
    log.with_name("map.yaml").write_text(json.dumps(words), encoding="utf-8")
    say("import", log, "--map", log.with_name("map.yaml"), "-o", out)
    with pytest.raises(SystemExit):
        run(["view", str(out)])
    assert f"patagium motion {out} --robot ROBOT" in capsys.readouterr().err


def test_an_imported_flight_is_streamed(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mapping, facts = log.with_name("map.yaml"), []
    for out in ("out.nc", "out.csv", "still.csv"):
        file = log.with_name(out)
        say("import", log, "--map", mapping, "-o", file)
        words = ["--robot", "aerobat"] if file.suffix == ".csv" else []  # a log carries its robot
        verbs = ("stream --robot ROBOT",) if words else ("identify", "motion")
        following = ", or ".join(f"patagium {verb} {file}" for verb in verbs)
        assert capsys.readouterr().out.endswith(f"Next: {following}\n")
        kept = file.with_suffix(".stream.nc")
        calm = ["--wind", "0,0,0", "--density", "1.1"] * (out == "still.csv")  # they override it
        say("stream", file, *words, *calm, "--idle", "0.2", "--record", kept, *LEARN)
        said = capsys.readouterr()
        facts.append(json.loads(said.out))
        air = pt.Air(density=1.1) if calm else pt.Air(wind=(-3.0, 0.0, 0.0))
        assert air_of(pt.load_log(kept)) == air
        assert ("the text states wind (-3.0, 0.0, 0.0) m/s" in said.err) == bool(calm)
    assert facts[0]["samples"] == facts[1]["samples"] > 490
    assert facts[0]["nmse"]["z"] == pytest.approx(facts[1]["nmse"]["z"], rel=1e-6)
    assert facts[0]["nmse"]["z"] < 0.5 * facts[2]["nmse"]["z"]
    assert "wind" not in str(pt.sensing.inspect_log(log.with_name("out.csv")).findings)
    say("identify", log.with_name("out.nc"), *LEARN[:-1], "--every", "50")
    model = log.with_name("model.json")
    assert capsys.readouterr().out.endswith(f"Next: patagium evaluate {model} ANOTHER.nc\n")
    with pytest.raises(SystemExit):
        run(["stream", str(log.with_name("out.csv"))])
    assert "--robot: expected a preset or a robot file" in capsys.readouterr().err


def test_the_air_that_a_mapping_states_is_kept_without_a_robot(tmp_path: Path) -> None:
    """A robot that is named afterwards, as by `motion --robot`, flew in still air."""
    table = {"t": np.arange(9) / 100, "a": np.zeros(9), "x": np.arange(9.0)}
    pd.DataFrame(table).to_csv(tmp_path / "a.csv", index=False)
    channels = [{"column": "x", "name": "x", "unit": "m"}]
    words = {"time": {"column": "t"}, "channels": channels, "air": {"density": 1.1}}
    (tmp_path / "map.yaml").write_text(json.dumps(words), encoding="utf-8")
    pt.import_log(tmp_path / "a.csv", tmp_path / "map.yaml", tmp_path / "a.nc")
    assert air_of(pt.load_log(tmp_path / "a.nc")) == pt.Air(density=1.1)


def test_an_imported_flight_is_sent_with_its_accelerations(
    flight: xr.Dataset, log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It went as raw samples of encoders and cameras, without the v and a that it has."""
    out = log.with_name("out.nc")
    say("import", log, "--map", log.with_name("map.yaml"), "-o", out)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(5.0)
        say("send", out, f"udp://127.0.0.1:{listener.getsockname()[1]}", "--rate", "1e5")
        first = np.frombuffer(listener.recv(1 << 16), "<f8")[2:]
    assert '--density 1.225 --wind "-3,0,0"' in capsys.readouterr().err  # of the stream
    expected = flight_packets(flight)[0]
    np.testing.assert_allclose(first, expected, rtol=1e-9, atol=1e-9)


def test_python_learns_from_an_imported_flight_as_from_the_flight(
    flight: xr.Dataset, log: Path
) -> None:
    out = pt.import_log(log, log.with_name("map.yaml"), log.with_name("out.nc")).path
    back, worst = pt.load_log(out), []
    assert set(back["q"].dims) == {"time", "dof"} and "findings" in back.attrs
    for one in (back, flight):
        air = air_of(one)
        assert air.wind == (-3.0, 0.0, 0.0)
        network = pt.StripNetwork(robot_of(one), (4,), air=air)
        learner = pt.CubatureLearner(network, prior_std=0.3, measurement_std=3e-4, spread=1.7)
        worst.append(pt.identify(one, learner, every=10).scores["nmse_worst"])
    assert worst[0] == pytest.approx(worst[1], rel=1e-3)  # stamps are whole nanoseconds


def test_each_loader_names_the_other(flight: xr.Dataset, log: Path, tmp_path: Path) -> None:
    out = pt.import_log(log, log.with_name("map.yaml"), tmp_path / "out.nc").path
    with pytest.raises(FlightError, match="imported log, which `pt.load_log` reads"):
        pt.load_flight(out)
    pt.save_flight(flight, tmp_path / "native.nc")
    with pytest.raises(LogError, match="flight, which `pt.load_flight` reads"):
        pt.load_log(tmp_path / "native.nc")


@pytest.mark.parametrize("aero", [(), ("--aero", "delaurier")])
def test_numbers_of_the_air_are_estimated_from_an_imported_flight(
    aero: tuple[str, ...], log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = log.with_name("out.nc")
    say("import", log, "--map", log.with_name("map.yaml"), "-o", out)
    name = "polar.lift_amplitude" if not aero else "lift_slope"
    say("identify", out, "--estimate", f"{name}=0.5", *aero, "--measurement-std", "1e-3",
        "--every", "10", "--json")  # fmt: skip
    said = capsys.readouterr()
    assert ("quasi-steady" in said.err) is not bool(aero)  # what was chosen is said
    facts = json.loads(said.out[said.out.index("\n{") :])
    assert np.isfinite(facts["nmse_worst"])


def test_the_program_runs_as_a_module() -> None:
    words = [sys.executable, "-m", "patagium", "--version"]
    said = subprocess.run(words, capture_output=True, text=True, check=True)
    assert said.stdout.startswith("patagium ")


def test_rates_of_a_flight_that_are_not_its_changes_are_told(tmp_path: Path) -> None:
    """They were learned without a word, in vectors, in short logs and without gravity yet later."""
    (tmp_path / "brick.yaml").write_text(
        "{name: brick, gravity: 9.81, bodies: {body: {floating: true, mass: 0.05, "
        "shape: {type: box, size: [0.1, 0.06, 0.04]}}}}"
    )
    robot = pt.load_robot(tmp_path / "brick.yaml")
    time, names = 1e-3 * np.arange(2000), list(robot.dof_names)
    size, beat = np.array([0.1, 0.0, 0.1, 0.1, 0.2, 0.1]), 2 * np.pi * np.arange(1, 7)
    turn = np.outer(time, beat)
    q, v, a = size * np.sin(turn), size * beat * np.cos(turn), -size * beat**2 * np.sin(turn)
    q[:, 0], v[:, 0], q[:, 4] = q[:, 0] + 5.0 * time, v[:, 0] + 5.0, q[:, 4] + 0.2
    body, felt = v.copy(), a + 9.81 * np.eye(6)[2]
    body[:, 0], body[:, 2] = (
        np.cos(q[:, 4]) * v[:, 0] - np.sin(q[:, 4]) * v[:, 2],
        np.sin(q[:, 4]) * v[:, 0] + np.cos(q[:, 4]) * v[:, 2],
    )
    along = a.copy()
    along[:, :3] = Rotation.from_euler("ZYX", q[:, :2:-1]).apply(a[:, :3], inverse=True)
    noise = 1e-3 * np.random.default_rng(0).normal(size=q.shape)
    cases = {"": (q + noise, v, a), "v.z": (q, body, a), "a.z": (q, v, felt)}
    cases["a.x"] = (q + 1e-3 * noise, v + 1e-2 * noise, along)  # gravity taken out
    tried = [(wrong, vectors) for wrong in cases for vectors in (False, True)]
    for wrong, vectors in tried:
        parts, rows = cases[wrong], 2000 if vectors else 500
        heads = [f"{part}.{name}" for part in "qva" for name in names]
        table = np.hstack([time[:, None], *parts])[:rows]
        pd.DataFrame(table, columns=["t", *heads]).to_csv(tmp_path / "log.csv", index=False)
        turned = {name: "rad" for name in names[3:]}
        ends = {"q": "", "v": "/s", "a": "/s^2"}
        channels = [
            {"column": one, "unit": turned.get(one[2:], "m") + ends[one[0]], "name": one}
            for one in heads
            if not (vectors and one[2:] in "xyz")
        ]
        channels += [
            {"column": [f"{part}.{k}" for k in "xyz"], "unit": f"m{ends[part]}"}
            | {"frame": "flu", "name": part}
            for part in ends
            if vectors
        ]
        words = {"time": {"column": "t"}, "robot": "brick.yaml", "channels": channels}
        (tmp_path / "map.yaml").write_text(json.dumps(words), encoding="utf-8")
        found = pt.import_log(
            tmp_path / "log.csv", tmp_path / "map.yaml", tmp_path / f"{wrong}o.nc"
        )
        told = [one.text for one in found.findings if one.kind == "rates"]
        assert bool(told) == bool(wrong) and all(wrong in one for one in told[:1]), (wrong, told)
        assert not any("found no" in one.text for one in found.findings)  # of vectors, untrue
