"""The first hour: commands without options, an own robot, each at the first try."""

from __future__ import annotations

import io
import re
import shlex
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import patagium as pt
from patagium.cli.main import run
from patagium.cli.words import show_table
from patagium.report import Table
from patagium.robot import load_robot, preset_names, write_template
from patagium.sensing.logs.mapping import load_mapping
from patagium.simulation.flight_summary import flight_summary

BARE = (
    "simulate aerobat",
    "identify flight.nc",
    "view flight.nc --model model.json",
    "cycles",
    "figures",
    "robots --new",
    "identify",
    "view",
)
WRITTEN = (
    *("flight.nc", "model.json", "flight.html", None, "flight/robot.pdf", "my_robot.yaml"),
    *("model.json", "flight.html"),
)


def _said(words: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as left:
        run(shlex.split(words))
    said = capsys.readouterr()
    assert not left.value.code, said.err
    return said.out


def test_commands_without_options_work_at_the_first_try(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for words, file in zip(BARE, WRITTEN, strict=True):
        began = time.monotonic()
        said = _said(words, capsys)
        assert time.monotonic() - began < 60.0, words  # 15 s warm, and the compiler when cold
        assert said.splitlines()[-1].startswith("Next: "), said
        assert file is None or (tmp_path / file).stat().st_size > 1_000


@pytest.mark.parametrize("verb", ["identify", "view", "cycles", "figures"])
def test_a_verb_without_a_flight_says_how_to_make_one(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as left:
        run([verb])
    assert left.value.code == 2
    made = "flight.nc: expected a flight, found none; make it: patagium simulate aerobat"
    assert made in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("columns", [60, 80])
def test_a_narrow_terminal_cuts_no_number_and_no_name(
    columns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    heads = ["output", *(f"mean square error {k} [1]" for k in range(4))]
    rows = [[f"left_mediolateral_{k}", 1.23e-9, 4.56e-10, 0.789, None] for k in range(2)]
    shown = _Terminal()
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setenv("TERM", "dumb")
    monkeypatch.setattr("sys.stdout", shown)
    show_table(Table(heads, rows))
    with pytest.raises(SystemExit):
        run(["robots"])
    said = shown.getvalue()
    assert "…" not in said
    for word in ("left_mediolateral_0", "1.23×10⁻⁹", "4.56×10⁻¹⁰", "0.789", *preset_names()):
        assert re.search(rf"(^|\s){word}(\s|$)", said, re.MULTILINE), word
    assert columns == 60 or max(map(len, said.splitlines()[:-1])) <= 80


def test_every_command_that_comes_next_is_one_of_those_that_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    said = _said("robots --new own", capsys)
    (draw, fly) = re.findall(r"patagium ([^,\n]+)", said.splitlines()[-1])
    assert "own" in _said(draw, capsys) and (tmp_path / "own.png").is_file()
    assert "lifting lines" in _said("check own.yaml", capsys)
    assert "COMPLETED" in _said(fly, capsys)
    assert "Intervals about right" in _said("identify flight.nc", capsys)


def test_a_log_is_brought_to_a_model_by_what_comes_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    time = np.arange(0.0, 4.0, 0.01)
    columns = np.column_stack([time, np.sin(5 * time), 0.2 * np.sin(5 * time) ** 3])
    np.savetxt("log.csv", columns, delimiter=",", header="t [s],angle [rad],lift [N]", comments="")
    shown = _said("inspect log.csv", capsys)
    *_, begun = shown.partition("A map.yaml to begin from (-o map.yaml writes it):\n")
    mapping = begun.partition("Next: ")[0]
    last = _said("inspect log.csv -o map.yaml", capsys).splitlines()[-1]
    assert Path("map.yaml").read_text() == mapping
    said = _said(last.partition("then patagium ")[2], capsys)
    (learn,) = re.findall(r"patagium ([^,\n]+)", said.splitlines()[-1])  # no channels for motion
    assert learn == "identify log.nc" and "NMSE" in _said(learn, capsys)


def test_a_mapping_to_begin_from_has_all_fields_with_forces_as_outputs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names = "time_ms,Fx_N,stroke_deg,pitch_deg,airspeed_mps,rate_hz,Mx_Nm,lift_force"
    values = np.random.default_rng(0).normal(size=(200, 8))
    values[:, 0] = 2.0 * np.arange(200)
    np.savetxt("rig.csv", values, delimiter=",", header=names, comments="")
    _said("inspect rig.csv -o map.yaml", capsys)
    mapping = load_mapping("map.yaml")
    assert mapping.time.column == "time_ms" and mapping.time.unit == "ms"
    assert [(one.column, one.unit) for one in mapping.inputs] == [
        ("stroke_deg", "deg"), ("pitch_deg", "deg"), ("airspeed_mps", "m/s"), ("rate_hz", "Hz")
    ]  # fmt: skip
    assert [(one.column, one.unit) for one in mapping.outputs] == [
        ("Fx_N", "N"), ("Mx_Nm", "N m"), ("lift_force", "1")
    ]  # fmt: skip
    for clock in ("t", "time_s"):
        names = f"{clock},ax_g,acc_z_g,gx_dps,mass_g,left_s,fx_n,roll_deg"
        np.savetxt("unit.csv", values, delimiter=",", header=names, comments="")
        Path("unit.yaml").unlink(missing_ok=True)
        _said("inspect unit.csv -o unit.yaml", capsys)
        mapping = load_mapping("unit.yaml")
        assert mapping.time.column == clock and mapping.time.unit == "s"
        units = [one.unit for one in mapping.inputs]
        assert units == ["g_0", "g_0", "deg/s", "1", "1", "deg"]
    with pytest.raises(SystemExit):
        run(["inspect", "rig.csv", "-o", "map.yaml"])
    assert "--output: expected a file that is not there yet" in capsys.readouterr().err


def test_a_mapping_to_begin_from_imports_arrays_with_clocks_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """At the rate of the fastest: a lower one would fold what is faster."""
    monkeypatch.chdir(tmp_path)
    fast, slow = 0.002 * np.arange(600), 0.005 * np.arange(240)
    unit = {"t": fast, "gyro": np.sin(9 * fast)}
    savemat("rig.mat", {"unit": unit, "cell": {"t": slow, "fz": np.cos(9 * slow)}})
    topics = "--topic 'table of 600 rows' --topic 'table of 240 rows'"
    last = _said(f"inspect rig.mat {topics} -o map.yaml", capsys).splitlines()[-1]
    assert load_mapping("map.yaml").time.rate == 500.0
    _said(f"{last.partition('then patagium ')[2]} -o log.nc", capsys)
    log = pt.load_log("log.nc")
    for name, wave in (("unit.gyro", np.sin), ("cell.fz", np.cos)):
        np.testing.assert_allclose(log[name], wave(9 * log.time), atol=3e-4)  # linear between


def test_the_file_of_a_new_robot_flies_and_is_never_written_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    file = write_template("swift")
    robot = load_robot(file)  # a RobotFileWarning would be an error
    assert robot.name == "swift" and robot.cruise is not None
    # Pennycuick (1968), J. Exp. Biol. 49, 527: a pigeon of .4 kg flies on with 10.5 W, sprints with
    # 20.4 W and glides 5.9 m a meter at best; wings of the default air glide 1.9 m at best
    _said(f"simulate {file.name}", capsys)
    facts = flight_summary(pt.load_flight("flight.nc"))
    mass = sum(body.mass for body in robot.bodies)
    assert 10.5 / 0.4 < facts["joint_power"] / mass < 20.4 / 0.4 * 5.9 / 1.9
    assert abs(facts["climb_rate"]) < 0.1 * facts["speed"] and not facts["warnings"]
    file.write_text("mine")
    for name, expected in (
        ("swift", "a file that is not there yet"),
        ("swift.yaml", "a file that is not there yet"),
        ("hawk", "a name that no preset has"),
        ("7up", "a name of at most 40 letters"),
    ):
        with pytest.raises(SystemExit):
            run(["robots", "--new", name])
        assert f"--new: expected {expected}" in capsys.readouterr().err
    assert file.read_text() == "mine"
    assert not Path("hawk.yaml").exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("simulate aerobat --duration -1", "--duration: expected a positive number of seconds"),
        ("simulate aerobat --time-step 0", "--time-step: expected a positive number of seconds"),
        ("simulate aerobat --duration 0.1 -o -", "--output: expected the name of a file, found"),
        ("tune flight.nc --trials 2", "--trials: expected a value greater than or equal to 8"),
        ("identify flight.nc --horizon 5s", "--horizon: expected less than the 0.1 s of the log"),
        ("export flight.nc -o x.csv", "--output: expected a file of the kind .mcap or .rrd (a tab"),
        ("send flight.nc udp://no.such.host.invalid:9000", "target: expected a host that is known"),
        ("evaluate model.json hawk.nc", "outputs of the model: expected coordinates of robot 'haw"),
    ],
)
def test_errors_name_the_option_and_what_to_do(
    words: str,
    told: str,
    short: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """They named arguments of Python (time_step, out), a file named - was written, and so on."""
    monkeypatch.chdir(short)
    with pytest.raises(SystemExit) as left:
        run(shlex.split(words))
    assert left.value.code == 2
    assert f"patagium: {told}" in capsys.readouterr().err
    assert not (short / "-").exists()


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with flights of two robots, and a model of the first."""
    folder = tmp_path_factory.mktemp("short")
    for name, file in (("hawk", "hawk.nc"), ("aerobat", "flight.nc")):
        robot = pt.load_robot(name)
        gait = pt.gaits.cruise(robot)
        options = {"duration": 0.1, "time_step": 2e-4, "v": robot.coordinates(x=5.0)}
        flight = pt.simulate(robot, pt.QuasiSteady(robot), gait, **options)
        pt.save_flight(flight, folder / file)
    pt.identify(flight).learner.save(folder / "l.state")
    pt.learning.save_model(folder / "model.json", pt.load_learner(folder / "l.state"))
    return folder
