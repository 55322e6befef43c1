"""The attack on a small scale: a few cases of every target, and all that were findings once."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from patagium.cli.main import program, run
from patagium.errors import ParameterError
from patagium_lab.attack.calls import call_targets
from patagium_lab.attack.files import READERS, file_targets
from patagium_lab.attack.loops import loop_targets
from patagium_lab.attack.oracle import LostState, Target, WrongNumber, judged
from patagium_lab.attack.packets import packet_targets
from patagium_lab.attack.page import page
from patagium_lab.attack.plan import AttackPlan
from patagium_lab.attack.programs import LEFT_OUT, option_parameters, program_targets
from patagium_lab.attack.run import AttackResults, drawn, targets
from patagium_lab.attack.run import run as attack
from patagium_lab.attack.verbs import CALLS, OWN, STUDIES, prepared
from patagium_lab.attack.worker import attacked, attacked_here
from patagium_lab.study import Stages

CORPUS = sorted((Path(__file__).parent / "corpus").iterdir())
SOURCES = (file_targets, packet_targets, call_targets, loop_targets)
TARGETS = {one.name: one for source in SOURCES for one in source()}
forks = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")


@pytest.mark.parametrize("name", TARGETS)
def test_a_few_cases_of_every_target(name: str) -> None:
    tally = attacked_here(TARGETS[name], 1, range(5))
    assert tally.cases == 5 and not tally.findings


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_what_was_a_finding_once_is_none(path: Path, tmp_path: Path) -> None:
    kind, _, name = path.name.partition("__")
    case = tmp_path / name
    case.write_bytes(path.read_bytes())
    assert judged(lambda: READERS[kind](case)) in (("answered", ""), ("refused", ""))


@forks
@pytest.mark.parametrize("area", ["signals", "writes"])
def test_signals_and_failing_disks_lose_nothing(area: str) -> None:
    target = next(one for one in program_targets() if one.area == area)
    tally = attacked(target, 1, 2)
    assert tally.cases == 2 and not tally.findings


def _commands(group: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from _commands(command, f"{before}{name} ")
        elif before or not command.hidden:
            yield before + name, command


def test_every_verb_and_option_of_the_program_is_drawn() -> None:
    found = dict(_commands(program()))
    assert found.keys() == {call.verb for call in (*CALLS, *STUDIES)} | set(OWN)
    for verb, command in found.items():
        drawn = {option.name for option in option_parameters(verb)}
        options = {one.name for one in command.params if one.param_type_name == "option"}
        assert options - drawn <= LEFT_OUT, verb


def test_a_report_in_the_place_of_a_folder_is_refused_by_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    call = next(c for c in CALLS if c.verb == "identify" and "--report" in c.words)
    prepared(tmp_path)
    monkeypatch.chdir(tmp_path)
    for place in (".", ""):
        with pytest.raises(SystemExit) as end:
            run([*call.words, "--report", place])
        said = capfd.readouterr().err
        assert end.value.code == 2 and "Is a directory; name a file" in said, place


def _bad(folder: Path):
    """Cases that end in every way."""
    ends = iter(
        [ValueError("x"), WrongNumber("y"), LostState("z"), ParameterError("a", "b", 1), None]
    )

    def case(draw):
        end = next(ends)
        if end is not None:
            raise end

    return case


def _dies(folder: Path):
    def case(draw):
        if draw.random() < 0.5:
            os._exit(3)

    return case


def test_each_end_of_a_case_is_counted() -> None:
    tally = attacked_here(Target("files", "bad", 1.0, _bad), 0, range(5))
    assert tally.counts == {"crash": 1, "wrong": 1, "lost": 1}
    assert (tally.answered, tally.refused) == (1, 1)
    assert tally.findings[0].words.startswith("ValueError: x")


def test_a_case_that_takes_too_long_is_a_hang() -> None:
    def endless() -> None:
        while True:
            pass

    assert judged(endless, 0.05) == ("hang", "more than 0.05 s")


@forks
def test_a_death_costs_one_case() -> None:
    tally = attacked(Target("files", "dies", 1.0, _dies), 0, 12)
    assert tally.cases == 12 and 0 < tally.counts["crash"] < 12
    assert tally.answered == 12 - tally.counts["crash"]


def test_a_plan_draws_all_of_its_cases() -> None:
    every = list(targets())
    share = AttackPlan().cases / sum(one.cases for one in every)
    assert sum(drawn(one, share) for one in every) >= AttackPlan().cases


@forks
def test_areas_that_are_not_attacked_are_kept(tmp_path: Path) -> None:
    plan = AttackPlan(cases=60, areas=("packets",), workers=1)
    found = attack(plan, {"damage": []}, Stages())
    assert set(found.areas) == {"damage", "packets"}
    again = json.loads(json.dumps(found.metrics()))
    text = page(AttackResults(0, {"packets": again["areas"]["packets"]}))
    written = text.write(tmp_path / "page.md").read_text()
    assert "| packets |" in written and "Findings that are left" not in written


def test_an_unknown_area_is_refused() -> None:
    with pytest.raises(ParameterError, match="area"):
        AttackPlan(areas=("moon",))
