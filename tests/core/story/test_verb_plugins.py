"""Verbs of other packages: their names, and errors in one of them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest


def said(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Result of the program with a folder of packages on the import path."""
    path = os.pathsep.join([str(folder), *filter(None, sys.path)])
    program = [sys.executable, "-c", "from patagium.cli.main import run; run()", *words]
    return subprocess.run(
        program, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False
    )


def install(folder: Path, entry: str, **modules: str) -> None:
    """Write an installed package that brings a verb to a folder."""
    facts = folder / "flap_verbs-1.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: flap-verbs\nVersion: 1\n")
    (facts / "entry_points.txt").write_text(f"[patagium.verbs]\n{entry}\n")
    for name, text in modules.items():
        (folder / f"{name}.py").write_text(text)


def test_a_verb_has_the_word_of_its_entry_point_and_replaces_none(tmp_path: Path) -> None:
    """A verb had the name of its module: a module `cache` replaced `patagium cache`."""
    verb = 'def {0}() -> None:\n    """Wave."""\n    print("hello from {0}")\n'
    entry = "wave = cache\nrobots = waving"
    install(tmp_path, entry, cache=verb.format("cache"), waving=verb.format("waving"))
    for words in (("wave",), ("study", "wave")):
        assert said(tmp_path, *words).stdout == "hello from cache\n"
    assert said(tmp_path, "study", "robots").stdout == "hello from waving\n"
    assert "aerobat" in said(tmp_path, "robots").stdout
    assert "hello" not in said(tmp_path, "cache").stdout
    assert "Wave." in said(tmp_path, "study", "wave", "--help").stdout


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("import no_such_module", "ModuleNotFoundError(\"No module named 'no_such_module'\")"),
        ("x = 1", "AttributeError(\"module 'waving' has no attribute 'waving'\")"),
        ("def waving(x: int | str) -> None: ...", "AssertionError("),
    ],
)
def test_a_verb_that_cannot_be_used_costs_one_sentence(tmp_path: Path, text: str, why: str) -> None:
    """One verb that cannot be imported ended every command in a traceback, also `--version`."""
    install(tmp_path, "wave = waving", waving=text)
    answer = said(tmp_path, "--version")
    assert (answer.returncode, answer.stdout.split()[0]) == (0, "patagium")
    sentence = "patagium: verb wave of the package flap-verbs fails: "
    assert answer.stderr.startswith(sentence + why) and answer.stderr.count("\n") == 1
