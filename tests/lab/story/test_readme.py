"""What the README shows, runs: its code, its shell lines, its tree, its links."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

import patagium as pt
from patagium.cli.main import run

ROOT = Path(__file__).parents[3]
README = (ROOT / "README.md").read_text("utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def shortened(text: str) -> str:
    """The same with short flights: every line runs, none takes long.

    tests/core/story/test_first_hour.py types the lines without options as they stand.
    """
    text = re.sub("^patagium simulate aerobat$", r'\g<0> --duration "0.6 s"', text, flags=re.M)
    short = text.replace("duration=2.0", "duration=0.2").replace('"2 s"', '"0.2 s"')
    short = short.replace("duration=0.5", "duration=0.2")
    return short.replace("every=100", "every=10").replace("--every 100", "--every 10")


def test_it_takes_two_screens_before_the_tree() -> None:
    assert README.split("## The tree")[0].count("\n") <= 96  # two screens of 48 lines


def test_changelog_citation_and_laboratory_name_the_same_release() -> None:
    headings = re.findall(
        r"^## \[(.*?)\]", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE
    )
    assert headings[:2] == ["Unreleased", pt.__version__]
    for file in ("CITATION.cff", "lab/pyproject.toml"):
        found = re.search(r'^version\s*[:=]\s*"?([\d.]+)', (ROOT / file).read_text("utf-8"), re.M)
        assert found is not None and found[1] == pt.__version__


def test_python_blocks_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks("python"):
        exec(compile(shortened(block), "README.md", "exec", dont_inherit=True), names)
    assert (tmp_path / "report.html").stat().st_size > 10_000
    assert names["flight"].attrs["outcome"] == "COMPLETED"  # type: ignore[attr-defined]
    residual = names["D"] @ names["a"] + names["h"] - names["f"]  # type: ignore[operator]
    assert abs(residual).max() < 1e-9  # N, N m: rounding of the solve


def test_shell_lines_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    lines = [line for block in blocks("sh") for line in shortened(block).splitlines() if line]
    assert len(lines) >= 5
    for line in lines:
        program, *words = shlex.split(line)
        assert program == "patagium"
        with pytest.raises(SystemExit) as left:
            run(words)
        assert left.value.code == 0, line + capsys.readouterr().err
    assert {"flight.nc", "model.json", "report.html"} <= {p.name for p in tmp_path.iterdir()}


def test_tree_names_every_layer_and_no_other() -> None:
    named = set(re.findall(r"^ {6}(\w+)/ ", README, re.MULTILINE))
    package = ROOT / "src" / "patagium"
    assert named == {p.name for p in package.iterdir() if p.is_dir() and "_" not in p.name}


def test_links_and_pictures_lead_somewhere() -> None:
    targets = re.findall(r"\]\(([^)]+)\)", README)
    assert len(targets) >= 4
    assert [t for t in targets if not (ROOT / t).is_file()] == []


def test_make_targets_it_names_are_there() -> None:
    makefile = (ROOT / "Makefile").read_text("utf-8")
    named = set(
        re.findall(r"make (demo|test-core|test|check|docs|bench|pages|lint|install|lock)\b", README)
    )
    assert {"demo", "test", "test-core", "check", "docs", "bench", "pages"} <= named
    assert [t for t in named if not re.search(rf"^{t}:", makefile, re.MULTILINE)] == []
