"""Pages, tables and figures say what they were given, whole and offline."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest

from patagium.errors import FlightError, ParameterError, ShapeError
from patagium.report import (
    KeyNumber,
    Note,
    PageSection,
    Table,
    cell_text,
    figures,
    picture,
    write_page,
)
from patagium.report.page import Link, Picture
from patagium.report.style import envelope


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        ("plain", "plain"),
        (True, "yes"),
        (np.bool_(False), "no"),
        (0.0, "0"),
        (14, "14"),
        (np.int64(20001), "20001"),
        (3.14159, "3.14"),
        (31.4159, "31.4"),
        (31415.9, "31416"),
        (0.00314159, "0.00314"),
        (-2.5, "−2.50"),
        (1.23456e-7, "1.23×10⁻⁷"),
        (9.999e-4, "1.00×10⁻³"),
        (6.02e23, "6.02×10²³"),
        (float("nan"), "n/a"),
        (float("-inf"), "−∞"),
    ],
)
def test_cell_reads_as_a_person_writes(value: object, text: str) -> None:
    assert cell_text(value) == text  # type: ignore[arg-type]


def test_table_with_a_short_row_is_refused() -> None:
    with pytest.raises(ShapeError, match="row 1"):
        Table(("a", "b"), [[1, 2], [1]])


@pytest.mark.parametrize("block", [Link, lambda text, to: Picture("data:image/png;,", text, to)])
def test_a_link_leads_to_a_page_whatever_its_name(block: Any, tmp_path: Path) -> None:
    """Links to files with # or ? in their name were dead."""
    name = "run: #3? 5%-replay.html"
    page = write_page(tmp_path / "r.html", "R", [PageSection("S", [block("flight", name)])])
    (found,) = re.findall(r'<a href="([^"]+)"', page.read_text("utf-8"))
    parts = urlsplit(found)
    assert unquote(parts.path) == name and not parts.query and not parts.fragment


def test_powers_of_ten_are_set_as_such_and_names_are_not() -> None:
    figure = figures.innovation_and_covariance(
        np.arange(3.0), np.zeros((3, 1)), np.array([1e-4, 1.0, 1e4]), names=["a$b$"], units=["N"]
    )
    picture(figure, "Powers")
    labels = figure.axes[-1].get_yticklabels()
    assert any(one.get_text().startswith("$") for one in labels)
    assert all(one.get_parse_math() for one in labels)
    assert not figure.axes[0].title.get_parse_math()


def test_an_attitude_begins_within_half_a_turn_and_does_not_jump() -> None:
    turn = 2 * np.pi + np.linspace(0.0, 3 * np.pi, 50)
    wrapped = np.where(turn > 3 * np.pi, turn - 2 * np.pi, turn)
    found = figures.unwound(wrapped)
    np.testing.assert_allclose(found, np.linspace(0.0, 540.0, 50), atol=1e-9)  # rounding


def test_a_page_with_an_opening_shows_it_and_folds_its_sections(tmp_path: Path) -> None:
    opening = [KeyNumber("3 %", "Of <air>.", "Right: 5 %."), "Said."]
    sections = [PageSection("One", ["First."]), PageSection("Two", ["Second."])]
    page = write_page(tmp_path / "r.html", "T", sections, opening=opening).read_text("utf-8")
    head = page.partition("<main>")[0]
    assert "<strong>3 %</strong> Of &lt;air&gt;. <em>Right: 5 %.</em>" in head and "Said." in head
    assert page.count("<details>") == 2 and "<details>" not in head


class Tags(HTMLParser):
    """Every tag with its attributes, and whether each that opened was closed."""

    EMPTY = {"meta", "img", "br", "link"}

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def example_page(folder: Path) -> str:
    time = np.linspace(0.0, 1.0, 50)
    figure = figures.histories(time, [("Height", "m", {"z": time**2})])
    sections = [
        PageSection(
            "Forces", ["A `code` and **bold** <script>x</script>.", picture(figure, "Rise")]
        ),
        PageSection(
            "Numbers", [Table(("claim", "value [s]"), [["first", 0.5]], "Claims"), Note("But")]
        ),
        PageSection("End", [picture(figure, "Again", "png")]),
    ]
    path = write_page(
        folder / "report.html", "On <air>", sections, summary="Found.", facts={"by": "us"}
    )
    return path.read_text("utf-8")


def test_page_is_well_formed_and_offline(tmp_path: Path) -> None:
    text = example_page(tmp_path)
    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    sources = [
        a.get("src") or a.get("href") or "" for _, a in tags.seen if {"src", "href"} & set(a)
    ]
    assert len(sources) == 5
    assert all(source.startswith(("data:image/", "#s")) for source in sources)
    assert not re.search(r"url\(|@import|<script|<link", text)


def test_page_escapes_what_it_is_given(tmp_path: Path) -> None:
    text = example_page(tmp_path)
    assert "On &lt;air&gt;" in text
    assert "&lt;script&gt;x&lt;/script&gt;" in text
    assert "<code>code</code>" in text and "<strong>bold</strong>" in text


def test_page_is_the_same_bytes_twice(tmp_path: Path) -> None:
    assert example_page(tmp_path) == example_page(tmp_path)


def test_page_leaves_no_draft_beside_it(tmp_path: Path) -> None:
    example_page(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def test_page_that_fails_leaves_the_old_one(tmp_path: Path) -> None:
    path = write_page(tmp_path / "r.html", "Old", [])
    with pytest.raises(ParameterError, match="characters that UTF-8 has"):
        write_page(path, "New \ud800", [])
    assert "Old" in path.read_text("utf-8")
    assert [p.name for p in tmp_path.iterdir()] == ["r.html"]


def test_envelope_keeps_the_peaks() -> None:
    time = np.linspace(0.0, 1.0, 20_001)
    values = np.sin(40.0 * time)
    values[7_777], values[12_345] = 9.0, -9.0
    short_time, short = envelope(time, values)
    assert len(short) < 2_000
    assert short.max() == 9.0 and short.min() == -9.0
    assert (np.diff(short_time) >= 0.0).all()
    assert short_time[-1] == time[-1]
    assert np.isin(short, values).all()


def test_envelope_keeps_a_peak_at_the_end() -> None:
    """Thinning lost peaks near the end of a long signal."""
    time = np.arange(999_999) * 1e-3
    values = np.sin(time)
    values[-5] = 50.0
    thinned_time, thinned = envelope(time, values)
    assert thinned.max() == 50.0 and thinned_time[-1] == time[-1]
    assert (np.diff(thinned_time) >= 0.0).all() and np.isfinite(thinned).all()


def test_envelope_of_a_signal_that_broke_down_keeps_what_was() -> None:
    time = np.arange(10_000.0)
    values = np.where(time < 5_000, time, np.nan)
    _, short = envelope(time, values)
    assert np.nanmax(short) >= 4_990.0


@pytest.mark.parametrize("size", [1_000, 20_000])
def test_nothing_is_drawn_over_a_gap_in_time(size: int) -> None:
    """Curves and bands were drawn straight over a gap in time."""
    time = np.linspace(0.0, 10.0, size)
    time = time[(time < 4.0) | (time > 5.5)]
    truth = np.sin(time)
    figure = figures.comparison(
        time, truth, {"strip": truth}, names=["x"], units=["N"], std=np.full(time.size, 0.1)
    )
    (panel,) = figure.axes
    drawn = [line.get_xydata() for line in panel.get_lines()]
    for points in drawn:
        before, after = np.split(points, np.flatnonzero(np.isnan(points[:, 0])))
        assert 3.9 < before[-1, 0] < 4.0 and 5.5 < after[1, 0] < 5.6
    bands = [path.vertices[:, 0] for path in panel.collections[0].get_paths()]
    assert len(bands) == 2 and bands[0].max() < 4.0 and bands[1].min() > 5.5


def lines_of(panel: object) -> list[str]:
    return [line.get_label() for line in panel.get_lines()]  # type: ignore[attr-defined]


def test_comparison_draws_every_estimate_in_every_panel() -> None:
    time = np.linspace(0.0, 1.0, 30)
    truth = np.stack([time, -time], axis=1)
    figure = figures.comparison(
        time,
        truth,
        {"strip": truth * 1.1, "dense": truth * 0.9},
        names=["x", "z"],
        units=["N", "N"],
    )
    assert [lines_of(panel) for panel in figure.axes] == [["actual", "strip", "dense"]] * 2
    assert [panel.get_ylabel() for panel in figure.axes] == ["[N]", "[N]"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    np.testing.assert_array_equal(figure.axes[1].get_lines()[1].get_ydata(), -1.1 * time)


def test_comparison_is_scaled_by_the_truth() -> None:
    time = np.linspace(0.0, 1.0, 30)
    figure = figures.comparison(
        time, time, {"ran away": 1e6 * time}, names=["x"], units=["N"], std=np.ones(30)
    )
    assert figure.axes[0].get_ylim()[1] < 2.0


def test_figures_refuse_arrays_that_do_not_fit() -> None:
    with pytest.raises(ShapeError, match="strip"):
        figures.comparison([0, 1], [[1], [2]], {"strip": [1, 2, 3]}, names=["x"], units=["N"])


def test_innovation_figure_has_a_panel_more_than_outputs(tmp_path: Path) -> None:
    time = np.linspace(0.0, 1.0, 20)
    figure = figures.innovation_and_covariance(
        time, np.ones((20, 2)), np.exp(-time), names=["x", "y"], units=["N", "N"],
    )  # fmt: skip
    assert len(figure.axes) == 3
    assert figure.axes[-1].get_yscale() == "log"
    assert figures.save_figure(figure, tmp_path / "i.png").stat().st_size > 1_000


def test_figure_of_another_kind_is_refused(tmp_path: Path) -> None:
    figure = figures.curves([0, 1], [0, 1], {}, abscissa="x", ordinate="y")
    with pytest.raises(ParameterError, match=r"\.png or \.svg"):
        figures.save_figure(figure, tmp_path / "figure.bmp")


def test_machine_shows_every_strip_in_each_view() -> None:
    square = np.array([[0, 0, 0], [0, 1, 0], [-1, 1, 0], [-1, 0, 0]], float)
    figure = figures.machine(
        "wing",
        strips={"left": [square, square + [0, 1, 0]]},
        joints={
            "plunge": figures.Hinge(
                np.zeros(3), np.array([1.0, 0, 0]), np.eye(3), "plunge: about x, -45 to 60 deg"
            )
        },
        centers={"body": (0.1, 0, 0)},
        outlines=[np.vstack([np.eye(3), -np.eye(3)])],
        lines=[square.mean(0) + np.array([[0.0, 0, 0], [0, 1, 0]])],
    )
    above, _, left = figure.axes
    words = [[k.get_text() for k in panel.texts] for panel in figure.axes]
    assert words == [["1", "nose"], [], ["1"]]  # the axis points at who looks from behind
    assert figure.get_supxlabel() == "1  plunge: about x, -45 to 60 deg"
    assert "path of the tip between its limits" in above.get_legend_handles_labels()[1]
    assert [len(panel.collections[0].get_paths()) for panel in figure.axes] == [2, 2, 2]
    assert left.get_xlim()[0] > left.get_xlim()[1]  # forward is to the left
    with pytest.raises(ShapeError, match="left"):
        figures.machine("wing", strips={"left": [[0, 0, 0]]}, joints={}, centers={})


def test_overview_names_what_a_flight_misses() -> None:
    with pytest.raises(FlightError, match="aero_force"):
        figures.flight_overview({"q": 0})
