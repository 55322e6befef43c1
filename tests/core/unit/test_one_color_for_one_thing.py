"""The same color for the same thing: on pages, in figures, in pictures."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

from patagium.report.style import COLORS, SCENE, TRUTH

SOURCE = Path(__file__).parents[3] / "src" / "patagium"
REPLAY = files("patagium.report").joinpath("replay")
NAMED = re.compile(r"#[0-9a-fA-F]{6}\b")


def test_scripts_take_colors_of_things_from_the_style() -> None:
    for name in ("view.js", "arrows.js", "paths.js", "plots.js", "player.js", "flight.js"):
        text = REPLAY.joinpath(name).read_text("utf-8")
        of_things = {color.lower() for color in (TRUTH, *COLORS, *SCENE.values())}
        written = {color.lower() for color in NAMED.findall(text)}
        assert not written & of_things, name  # they come with the flight
        used = set(re.findall(r"\bLOOK\.(\w+)", text))
        assert used <= set(SCENE), name


def test_the_paper_of_the_page_is_that_of_the_scene() -> None:
    style = REPLAY.joinpath("style.css").read_text("utf-8")
    assert f"--paper: {SCENE['paper']}" in style


def test_no_figure_names_a_color_of_its_own_for_truth_or_estimate() -> None:
    of_things = {color.lower() for color in (TRUTH, *COLORS)}
    for file in SOURCE.rglob("*.py"):
        if file.name == "style.py":
            continue
        written = {color.lower() for color in NAMED.findall(file.read_text("utf-8"))}
        assert not written & of_things, file.name
        # nor matplotlib's own cycle, whose colors mean nothing here
        assert not re.search(r"""["']C\d["']|["']tab:\w+["']""", file.read_text("utf-8")), file.name
