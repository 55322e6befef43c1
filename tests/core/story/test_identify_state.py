"""`patagium identify --state`: one learner over several runs, kept when somebody interrupts."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import patagium as pt
from patagium.learning import long_log

from ...spoken import Speak

MAPPING = """
time: {column: t, unit: s}
inputs:
  - {column: a, unit: "1", range: [-1, 1]}
  - {column: b, unit: "1", range: [-1, 1]}
outputs:
  - {column: lift, unit: N, range: [-2, 2]}
"""
LEARN = ("--prior-std", "0.5", "--measurement-std", "0.05", "--hidden", "4")


@pytest.fixture
def identify(tmp_path: Path, speak: Speak) -> Iterator[Speak]:
    """Identify a log of 400 samples, every one of them used."""
    draw = np.random.default_rng(3)
    x = np.sin(np.linspace(0, 20, 400)[:, None] * [1.0, 1.7])
    rows = np.column_stack([0.01 * np.arange(400), x, x[:, 0] * x[:, 1] + 0.01 * draw.normal()])
    log, mapping = tmp_path / "log.csv", tmp_path / "columns.yaml"
    np.savetxt(log, rows, delimiter=",", header="t,a,b,lift", comments="", fmt="%.9g")
    mapping.write_text(MAPPING)

    handler = signal.getsignal(signal.SIGINT)
    yield partial(speak, "identify", log, "--mapping", mapping, "--every", 1)
    assert signal.getsignal(signal.SIGINT) is handler


def test_a_second_run_goes_on_from_the_first(identify: Speak, tmp_path: Path) -> None:
    state = tmp_path / "learner.state"
    first = identify(*LEARN, "--state", state)
    assert first.code == 0 and f"The state after 400 samples is in {state}" in first.err
    second = identify(*LEARN, "--state", state, "--json")
    assert second.code == 0 and "Going on" in second.err and "400 samples" in second.err
    learner = pt.load_learner(state)
    assert learner.count == 800
    fresh = identify(*LEARN, "--state", tmp_path / "other", "--json")
    nmse = [float(answer.out.split('"nmse_mean":')[1].split(",")[0]) for answer in (fresh, second)]
    assert nmse[1] < 0.5 * nmse[0]  # it knew the log


def test_a_short_second_log_goes_on_with_the_scales_of_the_first(
    identify: Speak, tmp_path: Path, speak: Speak
) -> None:
    """A second log lost its first second, and one shorter than that was refused."""
    mapping, state, short = (tmp_path / name for name in ("columns.yaml", "state", "short.csv"))
    mapping.write_text(MAPPING.replace(", range: [-2, 2]", ""))
    first = identify(*LEARN, "--state", state)
    assert "The state after 300 samples" in first.err  # a second scales
    rows = (tmp_path / "log.csv").read_text().splitlines()
    short.write_text("\n".join(rows[:60]))
    wanted = "--mapping", mapping, "--every", 1, *LEARN, "--state", state
    answer = speak("identify", short, *wanted)
    assert answer.code == 0 and "The state after 359 samples" in answer.err


def test_a_state_of_another_learner_is_refused_and_kept(identify: Speak, tmp_path: Path) -> None:
    state = tmp_path / "learner.state"
    assert identify(*LEARN, "--state", state).code == 0
    before = state.read_bytes()
    answer = identify(*LEARN[:-1], "6", "--state", state)
    assert answer.code == 2
    assert "network.hidden: expected [6], found [4]" in answer.err
    assert "Traceback" not in answer.err and state.read_bytes() == before


def test_a_learner_that_diverged_is_not_kept(identify: Speak, tmp_path: Path) -> None:
    state = tmp_path / "learner.state"
    answer = identify(*LEARN, "--forgetting-factor", "1e-8", "--state", state)
    assert answer.code == 2 and "diverged" in answer.err
    assert not state.exists()


def test_an_output_that_fails_costs_no_other(
    identify: Speak, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = ("--state", tmp_path / "state", "--predictions", tmp_path / "p.nc")
    folder = tmp_path / "gone"
    folder.mkdir()
    update = pt.ExtendedLearner.update

    def vanishes(self: pt.ExtendedLearner, *sample: object) -> object:
        shutil.rmtree(folder, ignore_errors=True)
        return update(self, *sample)

    monkeypatch.setattr(pt.ExtendedLearner, "update", vanishes)
    answer = identify(*LEARN, *kept, "--model", folder / "m.json", "--json")
    assert answer.code == 2 and '"nmse_mean"' in answer.out
    assert "m.json: cannot be written: No such file" in answer.err and "mkdir -p" in answer.err
    assert answer.err.endswith("patagium: not saved: model; all else was\n")
    assert pt.load_learner(tmp_path / "state").count == 400 and (tmp_path / "p.nc").exists()


def test_ctrl_c_leaves_the_state_as_it_was(
    identify: Speak, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The samples before Ctrl-C were kept, so that the same command counted them twice."""
    state, update = tmp_path / "learner.state", pt.ExtendedLearner.update

    def interrupted(self: pt.ExtendedLearner, *sample: object) -> object:
        if self.count == 150:
            signal.raise_signal(signal.SIGINT)
        return update(self, *sample)

    monkeypatch.setattr(pt.ExtendedLearner, "update", interrupted)
    answer = identify(*LEARN, "--state", state)
    assert answer.code == 130
    assert not state.exists() and f"{state} is as it was" in answer.err
    monkeypatch.undo()
    assert identify(*LEARN, "--state", state).code == 0
    assert pt.load_learner(state).count == 400


@pytest.fixture
def in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """A log of 200 samples is long, and learned from in blocks of 100."""
    monkeypatch.setattr(long_log, "LONG", 200)
    monkeypatch.setitem(long_log.identify_record.__kwdefaults__, "block", 100)


def killed(*_: object, **__: object) -> None:
    raise SystemExit(137)


@pytest.mark.usefixtures("in_blocks")
@pytest.mark.parametrize(
    "place", ["patagium.cli.state.keep_state", "patagium.learning.long_log.remove_course"]
)
def test_a_long_run_killed_near_its_end_is_not_lost(
    place: str, identify: Speak, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A long run's progress was removed before its state was written, a table's never kept."""
    state, straight = tmp_path / "learner.state", tmp_path / "straight.state"
    assert identify(*LEARN, "--state", straight).code == 0

    with monkeypatch.context() as patched:
        patched.setattr(place, killed)
        assert identify(*LEARN, "--state", state).code == 137
    calls, update = list[object](), pt.ExtendedLearner.update

    def counted(self: pt.ExtendedLearner, *sample: object) -> object:
        calls.append(sample)
        return update(self, *sample)

    monkeypatch.setattr(pt.ExtendedLearner, "update", counted)
    assert identify(*LEARN, "--state", state).code == 0
    assert 0 < len(calls) < 150  # of the last block alone
    learners = [pt.load_learner(one) for one in (state, straight)]
    assert [one.count for one in learners] == [400, 400]
    np.testing.assert_array_equal(learners[0].weights, learners[1].weights)
    assert not list(tmp_path.glob("*.course*"))


@pytest.mark.usefixtures("in_blocks")
def test_a_long_run_goes_on_with_the_same_mapping_alone(
    identify: Speak, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks of a table under one mapping must not be mixed with those under another."""
    with monkeypatch.context() as patched:
        patched.setattr("patagium.cli.state.keep_state", killed)
        assert identify(*LEARN, "--state", tmp_path / "state").code == 137
    mapping = tmp_path / "columns.yaml"
    mapping.write_text(MAPPING.replace("column: a,", "column: a, negated: true,"))
    answer = identify(*LEARN, "--state", tmp_path / "state")
    assert answer.code == 2 and "state.course: of another log, learner or setting" in answer.err
