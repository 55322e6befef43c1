"""The Markdown page says the same as the HTML page; its pictures are files of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from patagium.report import KeyNumber, Link, Note, PageSection, Table, figures, picture
from patagium_lab.markdown import MARK, markdown_page, markdown_prose, table_text
from patagium_lab.study import Page

HOSTILE = (
    "a * b * c, _x_ and x_1_2, <b>no</b>, 5 < 6 & 7, &amp; $x$, [1] [2](3), back\\slash, "
    "n_y n_y, ** alone"
)


def read(text: str) -> str:
    """What a reader of Markdown sees of a paragraph, marks of bold and code dropped."""
    parser = pytest.importorskip("markdown_it").MarkdownIt()
    inline = parser.parse(text)[1]
    return "".join(child.content for child in inline.children)


def test_prose_is_read_as_it_was_written() -> None:
    for text in (HOSTILE, "# no heading", "1. no list", "- no list", "> no quotation"):
        assert read(markdown_prose(text) if text == HOSTILE else _block(text)) == text


def test_code_and_bold_keep_their_meaning() -> None:
    text = "A `a*b_c` and **one `d_` of _them**."
    assert markdown_prose(text) == "A `a*b_c` and **one `d_` of \\_them**."


def test_a_table_keeps_its_cells_and_sets_numbers_right() -> None:
    text = table_text(Table(("name", "value [1]"), [["a|b", 0.5], ["**no**", 2.0]]))
    assert text.splitlines() == [
        "| name | value [1] |",
        "| --- | ---: |",
        "| a\\|b | 0.500 |",
        "| **no** | 2.00 |",
    ]


def test_a_page_and_its_pictures(tmp_path: Path) -> None:
    figure = figures.histories(np.linspace(0, 1, 5), [("Height", "m", {"z": np.zeros(5)})])
    sections = [
        PageSection("First, of two", [picture(figure, "Rise"), picture(figure, "Again")]),
        PageSection("Second", ["Words.", Note("But"), Link("Elsewhere", "there.html")]),
        PageSection(
            "Third", [Table(("a",), [[1.0]], "Numbers"), picture(figure, "Once more", "png")]
        ),
    ]
    path = Page("Title", "Sum.", {"by": "us"}, sections).write(tmp_path / "page.md")
    text = path.read_text("utf-8")
    assert text.startswith(f"{MARK}\n\n# Title\n\nSum.\n\n## First, of two\n")
    assert "> But" in text and "[Elsewhere](there.html)" in text and "*Numbers*" in text
    assert text.endswith("## Where it comes from\n\n- **by**: us\n")
    drawn = {one.name: one.read_bytes()[:5] for one in (tmp_path / "page").iterdir()}
    assert drawn == {
        "first-of-two.svg": b"<?xml",
        "first-of-two-2.svg": b"<?xml",
        "third.png": b"\x89PNG\r",
    }
    assert all(f"](page/{name})" in text for name in drawn)


def test_a_page_begins_with_its_opening(tmp_path: Path) -> None:
    opening = [KeyNumber("3 %", "Of <air>.", "Right: 5 %."), "Said."]
    sections = [PageSection("One", ["First."])]
    text = Page("T", "", {}, sections, opening).write(tmp_path / "r.md").read_text("utf-8")
    assert "## At a glance\n\n**3 %**: Of <air>. Right: 5 %." in text.replace("\\", "")


def _block(text: str) -> str:
    """A paragraph as it stands on a page."""
    page, pictures = markdown_page("t", [PageSection("s", [text])], "", {}, "f")
    assert not pictures
    return page.split("## s\n\n")[1]
