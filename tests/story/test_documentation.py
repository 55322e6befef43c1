"""What the documentation shows, runs: every block of code, every name, every link, the build."""

from __future__ import annotations

import importlib
import re
import shlex
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.cli.main import run

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"^```(python|sh)\n(.*?)^```", re.MULTILINE | re.DOTALL)
SHORTER = {
    "duration=2.0": "duration=0.4",
    "duration=0.5": "duration=0.1",
    '"2 s"': '"0.2 s"',
    "every=100": "every=10",
    "--every 100": "--every 10",
    "trials=64": "trials=8",
    "--trials 64": "--trials 8",
}


def _pages() -> list[str]:
    return [p.name for p in sorted(DOCS.glob("*.md")) if BLOCK.search(p.read_text("utf-8"))]


def _shortened(text: str) -> str:
    for long, short in SHORTER.items():
        text = text.replace(long, short)
    return text


def _said(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    program, *words = shlex.split(line)
    assert program == "patagium"
    with pytest.raises(SystemExit) as left:
        run(words)
    assert left.value.code == 0, line + capsys.readouterr().err


def _stage(page: str) -> dict[str, Any]:
    """What a page takes for granted: it tells what comes from the reader's own machine."""
    if page != "stream.md":
        return {}
    seconds = iter([0.0, 1e-3])
    still, columns = np.zeros(14), 1 + 4 * 14
    packets = np.zeros((3, columns))
    packets[:, 0] = [0.0, 1e-3, 2e-3]
    left = iter([True, True, False])
    return {
        "flying": lambda: next(left),
        "clock": lambda: next(seconds),
        "packets": packets[:2],
        "packet": packets[2],
        **{name: (lambda: still) for name in ("q", "v", "a", "u1")},
    }


@pytest.mark.parametrize("page", _pages())
def test_blocks_of_a_page_run_one_after_the_other(
    page: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__", **_stage(page)}
    for language, block in BLOCK.findall((DOCS / page).read_text("utf-8")):
        if language == "python":
            exec(compile(_shortened(block), page, "exec"), names)
        else:
            for line in filter(None, _shortened(block).splitlines()):
                _said(line, capsys)


def test_every_public_name_is_on_the_page_of_names() -> None:
    page = (DOCS / "api.md").read_text("utf-8")
    shown = set(re.findall(r"^\.\. auto\w+:: patagium\.(?:\w+\.)?(\w+)$", page, re.MULTILINE))
    assert shown == {*pt.__all__} - {"__version__"}


def test_functions_the_physics_names_are_there() -> None:
    named = re.findall(r"`(patagium(?:\.\w+)+)`", (DOCS / "physics.md").read_text("utf-8"))
    assert len(named) > 20
    for name in named:
        module, _, attribute = name.rpartition(".")
        if find_spec(module) is not None and hasattr(importlib.import_module(module), attribute):
            continue
        assert find_spec(name) is not None, name


@pytest.mark.parametrize("page", [p.name for p in sorted(DOCS.glob("*.md"))])
def test_links_and_pictures_of_a_page_lead_somewhere(page: str) -> None:
    targets = re.findall(r"\]\(([^)#]+)[^)]*\)", (DOCS / page).read_text("utf-8"))
    inner = [t for t in targets if not re.match(r"[a-z]+:", t)]
    assert [t for t in inner if not (DOCS / t).is_file()] == []


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    if find_spec("sphinx") is None:
        pytest.skip("sphinx is not installed: pip install 'patagium[docs]'")
    words = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", str(DOCS), str(tmp_path)]
    built = subprocess.run(words, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    assert "<math" in (tmp_path / "physics.html").read_text("utf-8")
