"""Tuning as a person meets it: the page, the command, its file, and what it refuses."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
import yaml

import patagium as pt
from patagium.cli.main import run
from patagium.errors import LogError, ParameterError

from ...spoken import Speak

PAGE = (Path(__file__).parents[3] / "docs" / "tune.md").read_text("utf-8")
TUNE = ("--every", 10, "--trials", 8, "--jobs", 1, "--covariance", "node")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a flight and its settings are."""
    folder = tmp_path_factory.mktemp("tune")
    beat = ["--gait", "sinusoidal", "--frequency", "5", "--plunge", "0.6"]
    beat += ["--speed", "3", "--duration", "0.1"]
    flight, settings = folder / "flight.nc", folder / "settings.yaml"
    words = ["tune", flight, *TUNE, "--hidden", "4", "--hidden", "3", "--out", settings]
    for said in (["simulate", "aerobat", *beat, "--time-step", "1e-4", "-o", flight], words):
        with pytest.raises(SystemExit) as left:
            run([str(word) for word in said])
        assert left.value.code == 0
    return folder


def blocks(language: str) -> list[str]:
    found = re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert found
    short = {"64": "8", '"2 s"': '"0.1 s"', "every=100": "every=10", "--every 100": "--every 10"}
    for old, new in short.items():
        found = [block.replace(old, new) for block in found]
    return found


def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, speak: Speak) -> None:
    monkeypatch.chdir(tmp_path)
    for line in "".join(blocks("sh")).splitlines():
        program, *words = shlex.split(line)
        assert program == "patagium"
        jobs = ["--jobs", "1"] if words[0] == "tune" else []
        answer = speak(*words, *jobs)
        assert answer.code == 0, line + answer.err
    names: dict[str, object] = {"__name__": "__main__"}
    for block in blocks("python"):
        exec(compile(block, "tune.md", "exec"), names)
    learner, tuned = names["learner"], names["tuned"]
    assert learner.describe() == tuned.learner().describe()  # type: ignore[attr-defined]


def test_the_file_says_what_was_chosen_for_what(folder: Path) -> None:
    words = yaml.safe_load((folder / "settings.yaml").read_text("utf-8"))
    assert (words["flight"], words["every"]) == ("flight.nc", 10)
    assert words["network"]["kind"] == "strip" and words["network"]["hidden"] in ([3], [4])
    assert words["learner"]["covariance"] == "node"
    assert len(words["learner"]["measurement_std"]) == 14
    first, *others = (trial["crps"] for trial in words["trials"])
    assert others == sorted(others)
    assert words["prediction"]["crps"] == first
    assert words["search"]["rule"].startswith("second half, by weights that stay; the")
    assert "y" not in words["prediction"]["outputs"]  # a symmetric flight


def test_the_same_command_goes_on_and_another_question_is_refused(
    folder: Path, speak: Speak
) -> None:
    journal, settings = folder / "settings.trials.jsonl", folder / "settings.yaml"
    before, chosen = journal.read_text("utf-8"), settings.read_text("utf-8")
    words = ("--hidden", "4", "--hidden", "3", "--out", settings)
    again = speak("tune", folder / "flight.nc", *TUNE, *words)
    assert again.code == 0 and "Going on from the trials in" in again.err
    assert (journal.read_text("utf-8"), settings.read_text("utf-8")) == (before, chosen)
    other = speak("tune", folder / "flight.nc", *TUNE, *words, "--every", 20)
    assert other.code == 2
    assert "every was 10, is 20; name another result (--out)" in other.err


def test_identify_takes_the_settings_and_options_count_more(folder: Path, speak: Speak) -> None:
    flight, settings, model = (folder / name for name in ("flight.nc", "settings.yaml", "m.json"))
    chosen = yaml.safe_load(settings.read_text("utf-8"))
    plain = speak("identify", flight, "--settings", settings, "--model", model, "--json")
    assert plain.code == 0, plain.err
    assert json.loads(plain.out)["every"] == 10
    learned = json.loads(model.read_text("utf-8"))
    for name, value in chosen["learner"].items():
        assert learned["learner"][name] == value
    assert learned["network"]["hidden"] == chosen["network"]["hidden"]
    own = ("--learner", "cubature", "--every", 20, "--spread", 1.5, "--hidden", "5")
    own = (*own, "--covariance", "layer", "--seed", 2)
    other = speak("identify", flight, "--settings", settings, *own, "--model", model, "--json")
    assert other.code == 0, other.err
    assert json.loads(other.out)["every"] == 20
    learned = json.loads(model.read_text("utf-8"))
    assert (learned["learner"]["spread"], learned["learner"]["seed"]) == (1.5, 2)
    assert learned["learner"]["covariance"] == "layer"
    assert learned["learner"]["prior_std"] == chosen["learner"]["prior_std"]
    assert learned["network"]["hidden"] == [5]


def test_settings_of_one_learner_serve_another_as_far_as_it_has_them(
    folder: Path, speak: Speak
) -> None:
    words = ("identify", folder / "flight.nc", "--settings", folder / "settings.yaml")
    answer = speak(*words, "--learner", "extended")
    assert answer.code == 0 and "learner: extended; set by you" in answer.out


def test_the_default_network_is_tuned_with_its_own_misfit(
    folder: Path, tmp_path: Path, speak: Speak
) -> None:
    flight, out = folder / "flight.nc", tmp_path / "settings.yaml"
    words = [*TUNE[:-1], "full", "--network", "linear_strip", "--out", out]
    assert speak("tune", flight, *words).code == 0
    found = pt.learning.load_settings(out)
    assert (found.network.kind, found.network.hidden) == ("linear_strip", ())
    assert found.learner.kind == "extended"
    assert found.learner.values["measurement_std"] is None
    assert speak("identify", flight, "--settings", out).code == 0


def test_without_options_the_default_network_and_strips_are_tried(
    folder: Path, tmp_path: Path, speak: Speak
) -> None:
    flight, out = folder / "flight.nc", tmp_path / "settings.yaml"
    assert speak("tune", flight, *TUNE[:-2], "--out", out).code == 0
    found = pt.learning.load_settings(out)
    assert {tuple(trial["hidden"]) for trial in found.trials} == {(), (8, 8)}
    assert found.network.kind == ("strip" if found.network.hidden else "linear_strip")
    assert found.learner.kind == "extended"
    assert speak("identify", flight, "--settings", out).code == 0


def test_a_table_is_tuned_as_it_is_identified(folder: Path, tmp_path: Path, speak: Speak) -> None:
    flight = pt.load_flight(folder / "flight.nc")
    table, mapping, out = (tmp_path / name for name in ("log.csv", "columns.yaml", "s.yaml"))
    frame = flight["v"].to_pandas()[["z", "pitch"]].assign(t=flight["time"].values)
    frame.to_csv(table, index=False)
    words = {
        "time": {"column": "t"},
        "inputs": [{"column": "z", "unit": "m/s", "range": [-1.0, 1.0]}],
        "outputs": [{"column": "pitch", "unit": "rad/s", "range": [-1.0, 1.0]}],
    }
    mapping.write_text(yaml.safe_dump(words), "utf-8")
    base = (table, "--mapping", mapping)
    answer = speak("tune", *base, *TUNE, "--hidden", "3", "--out", out, "--json")
    assert answer.code == 0, answer.err
    assert json.loads(answer.out)["network"]["kind"] == "dense"
    assert speak("identify", *base, "--settings", out).code == 0
    assert speak("tune", table, *TUNE, "--out", out).code == 2


def test_flights_are_left_out_and_must_be_of_one_robot_in_one_wind(
    folder: Path, tmp_path: Path, speak: Speak
) -> None:
    flight, out = folder / "flight.nc", tmp_path / "s.yaml"
    beat = ("--gait", "sinusoidal", "--frequency", 5, "--plunge", 0.3, "--speed", 4)
    beat += ("--duration", 0.1, "--time-step", 1e-4)
    other, windy = tmp_path / "other.nc", tmp_path / "windy.nc"
    assert speak("simulate", "aerobat", *beat, "-o", other).code == 0
    assert speak("simulate", "aerobat", *beat, "--wind", "-1,0,0", "-o", windy).code == 0
    base = ("--hidden", 3, "--prior-std", 0.01, "--out", out)
    answer = speak("tune", flight, "--hold-out", other, *TUNE, *base)
    said = " ".join(answer.out.split())
    assert answer.code == 0, answer.err
    assert "Rule: left-out flights: other.nc. " in said and "trials were refused." in said
    assert said.endswith(f"Next: patagium identify {flight} --settings {out}")
    assert yaml.safe_load(out.read_text("utf-8"))["search"]["rule"] == "left-out flights: other.nc"
    refused = speak("tune", flight, "--hold-out", windy, *TUNE, *base)
    assert refused.code == 2 and "expected the wind of flight.nc" in refused.err
    thin = pt.load_flight(flight)
    thin = thin.assign_attrs(aero=thin.attrs["aero"].replace("1.225", "0.9"))
    network = pt.StripNetwork(pt.load_robot("aerobat"), (3,))
    with pytest.raises(LogError, match=r"flight 2: .* at 1.225 kg/m\^3, found .* at 0.9"):
        pt.tune([pt.load_flight(flight), thin], network, trials=8, jobs=1)
    with pytest.raises(ParameterError, match="trials: expected at least 8"):  # first of all
        pt.tune([pt.load_flight(flight), thin], network, trials=7, jobs=1)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--trials", 3), "--trials: expected a value greater than or equal to 8, found '3'"),
        (
            ("--covariance", "square"),
            "expected one of full, layer, node",
        ),
        (("--mapping", "m.yaml"), "--mapping: expected a table"),
        (("--hidden", "8,0"), "expected positive whole numbers"),
    ],
)
def test_what_cannot_be_asked_is_refused(
    words: tuple[object, ...], said: str, folder: Path, tmp_path: Path, speak: Speak
) -> None:
    answer = speak("tune", folder / "flight.nc", "--out", tmp_path / "s.yaml", *words)
    assert answer.code == 2
    assert said in " ".join(re.sub("[│╭╮╰╯─]", " ", answer.err).split())


def test_identify_shows_a_forecast_and_says_what_is_none(folder: Path, speak: Speak) -> None:
    words = ("identify", folder / "flight.nc", "--settings", folder / "settings.yaml")
    answer = speak(*words, "--horizon", "10ms")
    said = " ".join(answer.out.split())
    assert answer.code == 0, answer.err
    assert "Forecast 0.01 s ahead from samples up to a time alone" in said
    assert "linear least squares [1]" in said and "propagated by the robot's equations" in said
    scores = json.loads(speak(*words, "--horizon", "10 ms", "--json").out)
    assert scores["forecast_10ms_count"] > 10 and scores["forecast_10ms_seconds"] == 0.01
    assert speak(*words, "--horizon", "soon").code == 2
    assert "--horizon scores a true forecast" in " ".join(
        re.sub("[│╭╮╰╯─]", " ", speak("identify", "--help-all").out).split()
    )
