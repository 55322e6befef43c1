"""The command line as a person meets it: help, answers, refusals, exit codes."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import patagium as pt
from patagium.cli import trim
from patagium.cli.estimates import orbit_air
from patagium.cli.main import app, run
from patagium.cli.options import netcdf
from patagium.errors import RobotFileError
from patagium.learning.identify import identify
from patagium.sensing.logs.importing.import_log import read_table
from patagium.sensing.logs.mapping import load_mapping

from ...spoken import Speak, refusing_stdout

VERBS = (
    *("simulate", "trim", "optimize", "fly", "cycles", "figures", "view", "export", "inspect"),
    *("import", "motion", "identify"),
    *("tune", "evaluate", "stream", "send", "robots", "check", "cache"),
)
SCREEN = 30
"""Lines of a terminal, and of the first screen of help."""
FLY = ("--duration", "0.05", "--time-step", "1e-4")
BEAT = ("--gait", "sinusoidal", "--frequency", "5 Hz", "--plunge", "30 deg")
LEARN = ("--prior-std", "0.3", "--measurement-std", "3e-4", "--spread", "1.7")


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("flight") / "flight.nc"
    with pytest.raises(SystemExit):
        run(["simulate", "aerobat", *BEAT, *FLY, "--speed", "3 m/s", "-o", str(path), "--json"])
    return path


def test_every_verb_is_there() -> None:
    shown = tuple(one.name for one in app.registered_commands if not one.hidden)
    assert shown == VERBS


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself_with_examples(verb: str, speak: Speak) -> None:
    answer = speak(verb, "--help")
    assert answer.code == 0
    assert "Examples:" in answer.out
    assert f"patagium {verb}" in answer.out.partition("Examples:")[2]


@pytest.mark.parametrize("verb", VERBS)
def test_the_first_screen_of_help_is_enough_for_the_usual_work(
    verb: str, speak: Speak, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "90")
    lines = speak(verb, "--help").out.splitlines()
    start = next(k for k, line in enumerate(lines) if "─ Options ─" in line)
    end = next(k for k, line in enumerate(lines) if k > start and line.startswith("╰"))
    assert end < SCREEN, "\n".join(lines[: end + 1])


@pytest.mark.parametrize("verb", VERBS)
def test_help_names_every_option_briefly_and_describes_all_where_asked(
    verb: str, speak: Speak, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    whole, brief = speak(verb, "--help-all").out, speak(verb, "--help").out
    described = set(re.findall(r"^│ (?:\*  | {3})?(--[\w-]+)", whole, re.MULTILINE))
    assert described <= set(re.findall(r"--[\w-]+", brief)), verb
    assert len(brief.splitlines()) <= 60  # two screens; simulate had 268 lines
    panels = len(re.findall(r"^╭", whole, re.MULTILINE))
    assert ("which --help-all describes" in brief) == (panels > 2)
    assert "which --help-all describes" not in whole


def test_help_is_quick() -> None:
    """The help imports no large library, because imports take most of its time."""
    heavy = ("numpy", "scipy", "casadi", "xarray", "matplotlib", "pandas", "joblib", "pydantic")
    code = (
        "import sys\nfrom patagium.cli.main import run\ntry:\n    run(['--help'])\n"
        f"except SystemExit:\n    print('loaded', sorted(set({heavy!r}) & set(sys.modules)))"
    )
    answer = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
    assert answer.stdout.decode().rstrip().endswith("loaded []")


def test_version(speak: Speak) -> None:
    assert speak("--version").out.strip() == f"patagium {pt.__version__}"


def test_robots_lists_the_presets(speak: Speak) -> None:
    found = json.loads(speak("robots", "--json").out)
    assert [one["robot"] for one in found] == [
        "aerobat", "aerobat-beta", "aerobat-published", "dragonfly", "hawk", "ornithopter",
        "ur5e", "yeo-wing",
    ]  # fmt: skip
    assert found[0]["mass [kg]"] == pytest.approx(0.02, rel=1e-9)  # science.md: 20 g
    text = speak("robots").out
    assert "aerobat-beta" in text and "mass [kg]" in text


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_robots_draws(ending: str, tmp_path: Path, speak: Speak) -> None:
    picture = tmp_path / f"robot.{ending}"
    assert speak("robots", "aerobat-beta", "--draw", picture).code == 0
    lost = speak("robots", "aerobat-beta", "--draw", picture / "x.png", "--json")
    assert lost.code == 2 and "x.png: cannot be written" in lost.err
    assert picture.read_bytes()[:5] in (b"\x89PNG\r", b"<?xml")


def test_simulate_keeps_the_flight_it_was_asked_for(flight: Path) -> None:
    kept = pt.load_flight(flight)
    assert kept.attrs["robot_name"] == "aerobat"
    assert float(kept["v"].sel(dof="x")[0]) == 3.0
    assert float(kept["time"][-1]) == pytest.approx(0.05, rel=1e-12)  # rounding
    rate = float(kept["v"].sel(dof="left_plunge")[0])
    assert rate == pytest.approx(2 * np.pi * 5.0 * np.radians(30.0), rel=1e-12)  # rounding


def test_simulate_understands_units_as_it_does_si(tmp_path: Path, speak: Speak) -> None:
    words = {
        "units": ("--frequency", "0.005 kHz", "--plunge", "30 deg", "--wind", "-7.2,0,0 km/hour"),
        "si": ("--frequency", "5", "--plunge", str(np.radians(30.0)), "--wind", "-2,0,0"),
    }
    ends = []
    for name, said in words.items():
        path = tmp_path / f"{name}.nc"
        answer = speak(
            "simulate", "aerobat", *said, "--duration", "5 ms", "--time-step", "1e-4", "-o", path,
            "--amplitude", "left_feather=0.1", "--phase", "left_feather=90 deg",
            "--offset", "elbow=-0.2",
        )  # fmt: skip
        assert answer.code == 0, answer.err
        ends.append(pt.load_flight(path)["q"].values[-1])
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-9, atol=1e-12)  # rounding of units
    assert ends[0][6] != 0.0


SLIDING = """
name: foil
gravity: 0 m/s^2
bodies:
  foil:
    joints: [{name: heave, type: prismatic, axis: z}, {name: pitch, axis: y}]
    mass: 1 kg
    shape: {type: plate, chord: 10 cm, span: 60 cm, thickness: 8 mm}
"""


def test_the_amplitude_and_mean_of_a_joint_that_slides_are_lengths(
    tmp_path: Path, speak: Speak
) -> None:
    """The amplitude of a sliding joint was an angle: 5 cm was refused, and 5 deg flew 87 mm."""
    robot, file = tmp_path / "foil.yaml", tmp_path / "f.nc"
    robot.write_text(SLIDING)
    fly = ("simulate", robot, *FLY, "-o", file)
    sizes = ("--amplitude", "heave=5 cm", "--amplitude", "pitch=10 deg", "--phase", "heave=90 deg")
    answer = speak(*fly, "--frequency", "1", *sizes, "--offset", "heave=1 cm")
    assert answer.code == 0, answer.err
    start = pt.load_flight(file)["q"].values[0]
    np.testing.assert_allclose(start, [0.06, 0.0], rtol=0, atol=1e-12)  # rounding
    for words in (("--amplitude", "heave=5 deg"), ("--offset", "heave=5 deg")):
        wrong = speak(*fly, "--frequency", "1", *words)
        assert wrong.code == 2 and f"{words[0]} heave: expected a length such as" in wrong.err
    assert "with --amplitude heave='5 cm'" in speak(*fly).err


def test_numbers_of_the_cruise_that_are_given_again_change_nothing(
    tmp_path: Path, speak: Speak
) -> None:
    """One word of the gait threw away the rest of the cruise, its speed and its pitch."""
    file, flights = tmp_path / "f.nc", []
    for words in (
        (), ("--plunge", "0.855"), ("--feather", "0.462"), ("--frequency", "11"),
        ("--amplitude", "left_plunge=0.855", "--phase", "right_feather=1.713"),
        ("--offset", "feather=-0.321", "--speed", "4.08", "--pitch", "-0.533"),
    ):  # fmt: skip
        answer = speak("simulate", "aerobat", *words, *FLY, "-o", file)
        assert answer.code == 0 and "Chosen for aerobat: its cruise, 11 Hz" in answer.err
        assert ("at 4.08 m/s, pitch -30.5 deg" in answer.err) == ("--speed" not in words)
        flights.append(pt.load_flight(file))
    for other in flights[1:]:
        for name in ("q", "v", "a"):
            np.testing.assert_array_equal(flights[0][name], other[name])
    assert speak("simulate", "aerobat", "--plunge", "0.4", *FLY, "-o", file).code == 0
    less = pt.load_flight(file)["v"].sel(dof=["x", "left_plunge", "left_feather"])[0].values
    whole = flights[0]["v"].sel(dof=["x", "left_plunge", "left_feather"])[0].values
    np.testing.assert_allclose(less, whole * [1.0, 0.4 / 0.855, 1.0], rtol=1e-12)  # rounding


def test_a_cruise_of_held_joints_takes_other_means(tmp_path: Path, speak: Speak) -> None:
    """Such a cruise was refused for want of a frequency once a mean was given."""
    fly = ("simulate", "hawk", "--duration", "0.01", "-o", tmp_path / "f.nc")
    answer = speak(*fly, "--offset", "elevation=5 deg", "--speed", "8")
    assert "Chosen for hawk: the rest of its cruise, joints held, pitch 11.5 deg" in answer.err
    flight, own = pt.load_flight(tmp_path / "f.nc"), pt.load_robot("hawk").cruise
    start = [float(flight["q"].sel(dof=name)[0]) for name in ("elevation", "pitch")]
    assert start == [np.radians(5.0), own.pitch] and float(flight["v"].sel(dof="x")[0]) == 8.0
    for lone in (("--frequency", "4"), ("--amplitude", "elevation=0.1")):
        assert "'5 Hz', with --amplitude left_sweep='30 deg'" in speak(*fly, *lone).err


@pytest.mark.parametrize(
    "words",
    [
        ("--gait", "linkage", "--frequency", "5", "--mount", "fixed", "--wind", "-3,0,0 m/s"),
        ("--gait", "still", "--pitch", "-5 deg", "--speed", "3", "--aero", "delaurier"),
    ],
)
def test_simulate_other_gaits_and_mounts(
    words: tuple[str, ...], tmp_path: Path, speak: Speak
) -> None:
    path, figure = tmp_path / "f.nc", tmp_path / "f.svg"
    robot = "aerobat-beta" if "linkage" in words else "aerobat"
    answer = speak("simulate", robot, *words, *FLY, "-o", path, "--figure", figure, "--json")
    assert answer.code == 0, answer.err
    assert json.loads(answer.out)["outcome"] == "COMPLETED"
    assert figure.stat().st_size > 1_000


def test_simulate_with_the_inertia_of_the_air(tmp_path: Path, speak: Speak) -> None:
    path = tmp_path / "flight.nc"
    words = ("simulate", "aerobat", *BEAT, *FLY, "--added-mass", "0.85", "-o", path, "--json")
    assert speak(*words).code == 0
    assert np.abs(pt.load_flight(path).added_mass_force.values).max() > 1e-3


def test_simulate_keeps_what_was_flown_before_it_broke_down(tmp_path: Path, speak: Speak) -> None:
    path = tmp_path / "broken.nc"
    answer = speak(
        "simulate", "aerobat", "--gait", "still", "--pitch", "85 deg", "--speed", "50",
        "--duration", "1", "--time-step", "1e-3", "-o", path,
    )  # fmt: skip
    assert answer.code == 2
    kept = tmp_path / "broken.partial.nc"
    assert "pitch" in answer.err and str(kept) in answer.err and not path.exists()
    assert 0.0 <= float(pt.load_flight(kept)["time"][-1]) < 1.0


def test_buoyancy_is_told_of_orbits_and_of_flights_that_break(
    tmp_path: Path, speak: Speak, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only flights that ended said that buoyancy is not modeled; trims never did."""
    words = ("--density", "998", "--time-step", "1e-2", "--duration", "0.1")
    answer = speak("simulate", "aerobat", *words, "-o", tmp_path / "b.nc")
    assert answer.code == 2 and answer.err.count("patagium: Buoyancy is not modeled") == 1
    heavy = pt.load_robot("aerobat")
    for robot, density, told in (
        (heavy, 998.0, True), (heavy, 1.2, False),
        (heavy.with_parameters({"gravity": 0.0}), 998.0, False),
    ):  # fmt: skip
        orbit_air("quasi-steady", robot, None, False, density, hovers=False)
        assert ("Buoyancy is not modeled" in capsys.readouterr().err) == told


def test_check_says_what_a_good_file_holds(flight: Path, speak: Speak) -> None:
    held = json.loads(speak("check", flight, "--json").out)
    assert held["kind"] == "flight"
    assert held["energy_audit"] < 1e-6  # acceptance of the corrected flight
    assert json.loads(speak("check", "aerobat", "--json").out)["kind"] == "robot"
    seen = pt.sense(pt.load_flight(flight), [pt.sensors.presets.as5600()])
    sensors = pt.sensing.save_sensor_log(seen, flight.with_name("sensors.nc"))
    assert json.loads(speak("check", sensors, "--json").out)["kind"] == "sensor log"
    plan = flight.with_name("plan.yaml")
    plan.write_text(
        "robot: ornithopter\nevents: [{type: payload, time: 1 s, body: body, mass: 1 g}]"
    )
    told = json.loads(speak("check", plan, "--json").out)
    assert (told["kind"], told["robot"], told["events"]) == ("plan", "ornithopter", ["payload"])
    model = flight.with_name("model.json")
    pt.learning.save_model(model, pt.ExtendedLearner(pt.DenseNetwork(2, (3,), ("lift",))))
    told = json.loads(speak("check", model, "--json").out)
    assert told["kind"] == "model" and "(lift), 13 weights" in told["network"]


def test_identify_then_evaluate_a_flight(flight: Path, tmp_path: Path, speak: Speak) -> None:
    model, page, kept = tmp_path / "m.json", tmp_path / "r.html", tmp_path / "p.nc"
    answer = speak(
        "identify", flight, *LEARN, "--every", "5", "--model", model, "--report", page,
        "--predictions", kept, "--json",
    )  # fmt: skip
    assert answer.code == 0, answer.err
    scores = json.loads(answer.out)
    assert scores["updates"] == 101
    assert page.stat().st_size > 10_000 and kept.is_file()
    assert 'href="r-replay.html"' in page.read_text("utf-8")
    assert (tmp_path / "r-replay.html").is_file()
    assert speak("view", flight, "--predictions", kept, "-o", tmp_path / "v.html").code == 0
    refused = speak("view", flight, "--predictions", kept, "--model", model)
    assert refused.code == 2 and "either a model or predictions" in refused.err
    frozen = speak("evaluate", model, flight, "--json")
    assert frozen.code == 0, frozen.err
    after = json.loads(frozen.out)
    assert after["updates"] == 0 and after["frozen"]
    said = speak("evaluate", model, flight, "--report", page).out
    assert "none learned" in said and "predicted with frozen weights" in said
    assert f"one measured sample in {after['every']}, held" in said and "used" not in said
    assert "Silent, and left out" in said
    assert "before the sample was used" not in page.read_text("utf-8")
    assert after["nmse"]["z"] < scores["nmse"]["z"]  # it has now seen this flight


@pytest.mark.parametrize(
    "words",
    [
        ("--network", "dense", "--hidden", "6", "--spread", "1.5", *LEARN[:4]),
        ("--network", "dense", "--learner", "extended", *LEARN[:4]),
        ("--network", "strip", "--hidden", "6", *LEARN[:4]),
    ],
)
def test_identify_with_every_learner(
    words: tuple[str, ...], flight: Path, tmp_path: Path, speak: Speak
) -> None:
    """The extended filter learns where no learner is named, the cubature filter by its spread."""
    model = tmp_path / "m.json"
    answer = speak("identify", flight, *words, "--every", "20", "--model", model, "--json")
    assert answer.code == 0, answer.err
    assert json.loads(answer.out)["updates"] == 26
    unnamed = "cubature" if "--spread" in words else "extended"
    kind = words[words.index("--learner") + 1] if "--learner" in words else unnamed
    assert json.loads(model.read_text("utf-8"))["learner"]["kind"] == kind
    assert speak("evaluate", model, flight).code == 0


@pytest.mark.parametrize(
    ("option", "word"),
    [("network", "round"), ("learner", "kalman"), ("covariance", "diagonal"), ("covariance", "20")],
)
def test_a_word_that_an_option_does_not_know_is_told(
    flight: Path, speak: Speak, option: str, word: str
) -> None:
    answer = speak("identify", flight, f"--{option}", word)
    assert answer.code == 2 and f"found {word!r}" in answer.err


MAPPING = """
time: {column: t, unit: s}
inputs: [{column: throttle, unit: "1", range: [0, 1]}]
outputs: [{column: lift, unit: N, range: [-2, 2]}]
"""


@pytest.fixture
def log(tmp_path: Path) -> tuple[Path, Path]:
    t = np.arange(200) * 0.01
    throttle = 0.5 + 0.5 * np.sin(12.0 * t)
    rows = np.column_stack([t, throttle, throttle**2])
    table, mapping = tmp_path / "log.csv", tmp_path / "columns.yaml"
    np.savetxt(table, rows, delimiter=",", header="t,throttle,lift", comments="")
    mapping.write_text(MAPPING)
    return table, mapping


def test_identify_then_evaluate_a_table(
    log: tuple[Path, Path], tmp_path: Path, speak: Speak
) -> None:
    table, mapping = log
    model = tmp_path / "m.json"
    words = ("--mapping", mapping, *LEARN, "--every", "1", "--hidden", "4", "--model", model)
    answer = speak("identify", table, *words, "--json")
    assert answer.code == 0, answer.err
    assert "no gap" in answer.err
    assert json.loads(answer.out)["nmse_second_half_worst"] < 0.1  # it learned a parabola
    said = speak("identify", table, *words[:-2]).out
    beside = table.with_name("model.json")
    following = f"Next: patagium evaluate {beside} ANOTHER.csv --mapping {mapping}"
    assert said.splitlines()[-1] == following and beside.is_file()
    assert speak("evaluate", model, table, "--mapping", mapping).code == 0
    assert "200" in speak("check", table, "--mapping", mapping).out


def test_a_table_without_settings_is_learned_as_in_python(
    log: tuple[Path, Path], speak: Speak
) -> None:
    table, mapping = log
    told = json.loads(speak("identify", table, "--mapping", mapping, "--json").out)
    meant = identify(read_table(table, load_mapping(mapping))).scores
    assert told["nmse_second_half"] == meant["nmse_second_half"]
    assert told["chosen"] == meant["chosen"] and "memory" in told["chosen"]
    words = ("identify", table, "--mapping", mapping, "--prior-share", "1e-3", "--json")
    assert json.loads(speak(*words).out)["chosen"]["memory"].endswith("prior_share 0.001")


def test_naming_a_default_of_a_table_turns_no_other_off(
    log: tuple[Path, Path], speak: Speak
) -> None:
    """`--hidden 8,8`, which is the default, switched off forgetting and the model's least error."""
    words = ("identify", log[0], "--mapping", log[1], "--json")
    plain = json.loads(speak(*words).out)
    for name, value in (("hidden", "8,8"), ("learner", "extended"), ("covariance", "full")):
        told = json.loads(speak(*words, f"--{name}", value).out)
        assert told["nmse"] == plain["nmse"], name
        assert told["chosen"]["memory"] == plain["chosen"]["memory"]
    assert "memory" not in json.loads(speak(*words, "--learner", "cubature").out)["chosen"]


def refusals(folder: Path) -> dict[str, tuple[tuple[object, ...], str]]:
    """Words that cannot be obeyed, and what the one sentence must say."""
    nothing, text = folder / "nothing.nc", folder / "text.nc"
    text.write_text("no flight")
    broken = folder / "robot.yaml"
    broken.write_text("name: x\nwheels: 4\n")
    fly = ("simulate", "aerobat", *FLY)
    return {
        "unknown robot": (("robots", "albatross"), "albatross"),
        "figure of another kind": (("robots", "aerobat", "--draw", folder / "a.bmp"), ".png"),
        "draw nothing": (("robots", "--draw", folder / "a.png"), "one robot"),
        "no frequency": (("simulate", "ur5e"), "--frequency"),
        "no such joint": ((*fly, *BEAT, "--amplitude", "tail=1"), "tail"),
        "not name=value": ((*fly, *BEAT, "--amplitude", "tail"), "NAME=VALUE"),
        "beyond the limits of sense": ((*fly, *BEAT, "--density", "-1"), "density"),
        "phase of a linkage": (
            (*fly, "--gait", "linkage", "--frequency", "5", "--phase", "elbow=1"),
            "--phase",
        ),
        "speed of a held wing": (
            ("simulate", "yeo-wing", *FLY, "--gait", "still", "--speed", "3"),
            "floats",
        ),
        "no gait table": ((*fly, "--gait", folder / "gait.csv"), "gait.csv"),
        "no flight": (("check", nothing), "nothing.nc"),
        "a text for a flight": (("check", text), "text.nc"),
        "unknown key": (("check", broken), "wheels"),
        "unknown ending": (("check", folder / "a.docx"), ".yaml"),
        "table without mapping": (("identify", folder / "log.csv", *LEARN), "--mapping"),
        "model of nothing": (("evaluate", folder / "m.json", nothing), "m.json"),
    }


@pytest.mark.parametrize("case", range(16))
def test_what_cannot_be_done_is_one_sentence_and_exit_code_two(
    case: int, tmp_path: Path, speak: Speak
) -> None:
    cases = refusals(tmp_path)
    assert len(cases) == 16
    name = list(cases)[case]
    words, said = cases[name]
    answer = speak(*words)
    assert answer.code == 2, name
    assert answer.err.startswith("patagium: "), name
    assert said in answer.err, name
    assert "Traceback" not in answer.err
    assert answer.out == ""


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("simulate", "aerobat", "--duration", "3 m"), "a time"),
        (("simulate", "aerobat", *FLY, "--frequency", "5 m"), "frequency"),
        (("simulate", "aerobat", *FLY, "--wind", "1,2"), "three"),
        (("identify", "x.nc", "--hidden", "8,-1"), "whole"),
        (("sumilate",), "sumilate"),
        (("trim", "aerobat", "--beats", "1e12"), "10000"),
        (("optimize", "aerobat", "--beats", "1e12"), "10000"),  # before the gait is sought
        (("optimize", "aerobat", "--front", ",".join(["3"] * 100_000)), "at most 100 speeds"),
        (("fly", "aerobat", "--duration", "1e12"), "duration: expected at most"),
    ],
)
def test_words_it_does_not_know_are_named(words: tuple[str, ...], said: str, speak: Speak) -> None:
    answer = speak(*words)
    assert answer.code == 2
    assert said in answer.err


@pytest.mark.parametrize("given", [(), ("--frequency", "5"), ("--amplitude", "left_sweep=40 deg")])
def test_a_linkage_on_other_wings_is_refused_at_once(given: tuple[str, ...], speak: Speak) -> None:
    """Three errors in turn asked for an amplitude, forbade it and named --plunge."""
    answer = speak("simulate", "hawk", "--gait", "linkage", *given)
    assert answer.code == 2
    assert "--gait: expected joints plunge and elbow on either side for a linkage" in answer.err


def test_a_linkage_without_a_frequency_is_asked_for_no_amplitude(
    tmp_path: Path, speak: Speak
) -> None:
    """The error advised --amplitude, which --gait linkage refuses."""
    path, preset = tmp_path / "robot.yaml", Path(pt.robot.__file__).parent / "presets"
    text = (preset / "aerobat-beta.yaml").read_text()
    path.write_text(re.sub(r"(?ms)^cruise:.*?(?=^\w|\Z)", "", text))
    asked = speak("simulate", path, "--gait", "linkage").err
    assert "--frequency: expected" in asked and "--amplitude" not in asked


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "identify {0} --predictions {0}",
            "--predictions: expected another file than that of FILE",
        ),
        ("identify {0} --predictions {1}", "than that of FILE,"),  # a link to it
        ("identify {0} --model {2} --state {2}", "than that of --model"),
        ("stream {0} --robot aerobat --record {0}", "than that of SOURCE"),
        ("cycles {0} --table {0}", "than that of FLIGHT"),
        ("trim aerobat -o {2}.nc --figure {2}.nc", "than that of --output"),
        ("trim aerobat -o {2}/none/x.nc", "make its folder first"),
        ("cycles {0} --figure {0}.txt", "a name ending in .pdf"),
    ],
)
def test_no_output_replaces_another_file_of_its_verb(
    words: str, said: str, flight: Path, tmp_path: Path, speak: Speak
) -> None:
    measured, link = tmp_path / "measured.nc", tmp_path / "link.nc"
    measured.write_bytes(flight.read_bytes())
    link.symlink_to(measured)
    answer = speak(*(word.format(measured, link, tmp_path / "new") for word in words.split()))
    assert answer.code == 2 and said in answer.err
    assert measured.read_bytes() == flight.read_bytes()
    assert {file.name for file in tmp_path.iterdir()} == {"measured.nc", "link.nc"}


@pytest.mark.parametrize(
    "words",
    [
        "identify {} --report", "identify {} --predictions", "identify {} --state",
        "identify {} --model", "evaluate {} {} --report", "cycles {} --table", "view {} --film",
        "stream - --record", "robots aerobat --draw", "simulate aerobat -o",
    ],
)  # fmt: skip
def test_an_output_without_a_folder_is_refused_before_the_work(
    words: str, tmp_path: Path, speak: Speak
) -> None:
    """The files that are read are not there either: outputs come first."""
    place = tmp_path / "my folder" / ("out.nc" if words.endswith("-o") else "out.png")
    answer = speak(*words.replace("{}", "nothing.nc").split(), place)
    assert answer.code == 2 and f"{place}: cannot be written" in answer.err
    assert f"mkdir -p '{place.parent}'" in answer.err


@pytest.mark.parametrize(
    "words",
    [
        "identify {} --report", "identify {} --model", "evaluate {} {} --report",
        "simulate aerobat -o", "robots aerobat --draw",
    ],
)  # fmt: skip
def test_an_output_that_may_not_be_written_is_refused_before_the_work(
    words: str, tmp_path: Path, speak: Speak, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was refused after minutes of work; what is asked for is the folder behind a link."""
    there, link = tmp_path / "there", tmp_path / ("link.nc" if "-o" in words else "link.png")
    there.mkdir()
    link.symlink_to(there / "file")
    monkeypatch.setattr(os, "access", lambda path, _: Path(path) != there)  # of root all is true
    answer = speak(*words.replace("{}", "nothing.nc").split(), link)
    assert answer.code == 2 and f"{link}: cannot be written: Permission denied" in answer.err
    (there / "file").touch()  # may be written, but not replaced
    assert "Permission denied" in speak(*words.replace("{}", "n.nc").split(), link).err


@pytest.mark.parametrize("words", ["identify nothing.nc", "evaluate m.json nothing.nc"])
def test_a_report_of_another_kind_is_refused_before_the_work(words: str, speak: Speak) -> None:
    """All was learned before a report that is no page was not saved."""
    answer = speak(*words.split(), "--report", "r.pdf")
    said = "--report: expected a name ending in .html or .htm, found 'r.pdf'"
    assert answer.err == f"patagium: {said}\n"


def test_a_stdout_that_is_closed_is_told() -> None:
    """Python has None for a stream that is closed: the answer was lost, with exit code 0."""
    program = '"$0" -c "from patagium.cli.main import run; run([\'robots\'])" >&-'
    told = b"patagium: stdout: cannot be written: Bad file descriptor; name another place\n"
    for closed, said in (("", told), (" 2>&-", b"")):
        done = subprocess.run(["sh", "-c", program + closed, sys.executable], capture_output=True)
        assert (done.returncode, done.stderr) == (2, said)


@pytest.mark.parametrize(("pipe", "code"), [(True, 0), (False, 2)])
def test_a_stdout_that_takes_nothing_costs_no_file(
    pipe: bool, code: int, log: tuple[Path, Path], tmp_path: Path, speak: Speak
) -> None:
    """Flights and mappings were lost when stdout failed; a closed pipe gave exit code 1."""
    flown, begun = tmp_path / "flight.nc", tmp_path / "map.yaml"
    for words in (
        ("simulate", "aerobat", *FLY, "-o", flown),
        ("inspect", log[0], "-o", begun),
        ("robots",),
    ):
        with refusing_stdout(pipe=pipe):
            answer = speak(*words)
        assert answer.code == code
        said = "stdout: cannot be written: No space left on device"
        assert (said in answer.err) == (code == 2)
    assert pt.load_flight(flown).attrs["outcome"] == "COMPLETED"
    assert begun.read_text("utf-8").startswith("time: ")


def test_a_pipe_among_the_outputs_that_is_closed_is_told(
    log: tuple[Path, Path], speak: Speak, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A closed pipe among the outputs gave exit code 1 without a message."""

    def closed(*_: object) -> None:
        raise BrokenPipeError(32, "Broken pipe", "pipe")

    monkeypatch.setattr("patagium.whole_file.write_whole", closed)
    answer = speak("inspect", log[0], "-o", log[0].with_name("map.yaml"))
    assert answer == (2, "", "patagium: pipe: Broken pipe\n")


def test_an_input_that_ends_too_early_for_a_library_is_told(
    log: tuple[Path, Path], speak: Speak, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An EOFError gave exit code 1 and an empty line."""

    def ended(*_: object) -> None:
        raise EOFError("No data left in file")

    monkeypatch.setattr("patagium.whole_file.write_whole", ended)
    answer = speak("inspect", log[0], "-o", log[0].with_name("map.yaml"))
    assert answer == (2, "", "patagium: No data left in file\n")


def test_a_mapping_is_written_with_json_too(log: tuple[Path, Path], speak: Speak) -> None:
    """With --json, inspect accepted -o and wrote no file."""
    begun = log[0].with_name("map.yaml")
    answer = speak("inspect", log[0], "-o", begun, "--json")
    assert json.loads(answer.out)["format"] and begun.read_text("utf-8").startswith("time: ")


def test_an_abbreviated_option_is_completed(speak: Speak) -> None:
    """For --freq the message suggested --figure instead of --frequency."""
    for verb, word, whole in (
        ("simulate", "--freq", "--frequency"), ("simulate", "--amp", "--amplitude"),
        ("identify", "--meas", "--measurement-std"), ("simulate", "--freqency", "--frequency"),
    ):  # fmt: skip
        assert f"did you mean {whole}?" in speak(verb, "aerobat", word, "5").err


def test_the_example_of_a_hover_finds_its_orbit(speak: Speak) -> None:
    """The example of the help had too few free parameters and ended with an error."""
    (words,) = [one for one in trim.EXAMPLES if "dragonfly" in one]
    assert json.loads(speak(*words.split()[1:]).out)["speed_m_s"] == pytest.approx(0.0, abs=1e-6)


def test_commands_to_come_are_quoted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, speak: Speak
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("log 1.csv").write_text("t,x [m]\n0,1\n1,2\n2,4\n")
    assert "import 'log 1.csv' --mapping map.yaml" in speak("inspect", "log 1.csv").out
    assert "simulate 'my robot.yaml'" in speak("identify", "my robot.yaml").err


def test_a_learner_is_not_given_what_it_does_not_take(flight: Path, speak: Speak) -> None:
    foreign = speak("identify", flight, "--learner", "extended", "--spread", "1")
    assert foreign.code == 2 and "extended learner has none" in foreign.err


def test_identify_needs_nothing_and_says_what_it_chose(flight: Path, speak: Speak) -> None:
    answer = speak("identify", flight)
    assert answer.code == 0
    chosen = dict(line.split(": ", 1) for line in answer.out.splitlines()[:5])
    assert set(chosen) == {"network", "learner", "noise", "prior", "every"}
    assert chosen["learner"].endswith("the default") and "innovations" in chosen["noise"]
    assert "linear_strip" in chosen["network"] and "the network" in chosen["prior"]
    some = ("--prior-std", "0.3", "--every", "50", "--learner", "extended")
    half = speak("identify", flight, *some).out
    assert "learner: extended; set by you" in half and "weights; the default" in half
    assert "prior: 0.3; set by you" in half and "every: one sample in 50" in half
    assert "noise" in half and "from the samples and the innovations" in half


def test_debug_shows_where_it_went_wrong() -> None:
    with pytest.raises(RobotFileError, match="albatross"):
        run(["robots", "albatross", "--debug"])


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
def test_numbers_are_read_where_letters_lack(
    encoding: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A terminal of few letters showed the code of a minus before 0.69, which reads as digits."""
    shown = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", shown)
    with pytest.raises(SystemExit):
        run(["--version"])
    print("−0.69 3×10⁻⁴ – \u4e2d", file=shown, flush=True)
    told = shown.buffer.getvalue().decode(encoding).splitlines()[-1]  # type: ignore[attr-defined]
    assert told.replace("×", "x").replace("–", "-") == "-0.69 3x10^-4 - \\u4e2d"


def test_a_flight_is_written_with_the_ending_that_readers_go_by(tmp_path: Path) -> None:
    """`-o a` wrote a file that no other verb took for a flight."""
    assert netcdf(tmp_path / "a") == tmp_path / "a.nc" and netcdf(None) is None
    assert netcdf(tmp_path) == tmp_path  # a folder, which is refused by its name
