"""The shape of every study of the laboratory: a plan, a run, a page.

A study is a package of three modules. `plan` holds frozen dataclasses that say what is done.
`run` has one function, `run(plan, ...)`, which gives the results as plain data. `page` has one
function, `page(results)`, which makes a `Page` of them. Modules beside these three hold the
physics of the study. This module holds what all studies need around that.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from patagium.reading import json_ready
from patagium.report import Block, PageSection, Table, write_page
from patagium.report.page import Cell
from patagium.whole_file import make_folder, write_whole
from patagium_lab.gallery import Gallery
from patagium_lab.markdown import markdown_page

Metrics = Mapping[str, Any]
"""Figures of a study by name, JSON-able."""
Row = Mapping[str, Any]
"""One line of results: figures and words by name."""
Columns = Mapping[str, str | Callable[[Row], Cell]]
"""Heading of each column, with its unit, and the key of its cell or a function of the row."""
Progress = Callable[[str, float], None]
"""Receives the name of the stage and the part of the whole study that is done, 0 to 1."""
Plan = TypeVar("Plan")


@dataclass(frozen=True)
class Page:
    """A page of results, ready to be written as Markdown or HTML.

    Attributes:
        title: Title of the page.
        summary: Findings in a few sentences.
        facts: Program, machine and settings behind the figures, for the foot of the page.
        sections: Sections in reading order.
        opening: First screen: pictures, numbers and sentences; the sections are folded then.
    """

    title: str
    summary: str
    facts: Mapping[str, str]
    sections: Sequence[PageSection]
    opening: Sequence[Block] = ()

    def only(self, titles: Sequence[str]) -> Page:
        """Page with some of its sections.

        Args:
            titles: Titles of the sections in reading order; titles without a section are skipped.
        """
        found = {section.title: section for section in self.sections}
        return replace(self, sections=[found[title] for title in titles if title in found])

    def write(self, path: str | Path) -> Path:
        """Write the page and give its path.

        Args:
            path: File to write; a name that ends in .md makes Markdown with its pictures in a
                folder of the same name beside it, any other name HTML.
        """
        page, words = Path(path), (self.title, self.sections)
        more: Any = {"summary": self.summary, "facts": self.facts, "opening": self.opening}
        if page.suffix != ".md":
            return write_page(page, *words, **more)
        text, pictures = markdown_page(*words, folder=page.stem, **more)
        for name, image in pictures.items():
            write_whole(make_folder(page.with_suffix("")) / name, image)
        return write_whole(page, text)


@dataclass(frozen=True)
class Results:
    """Results of a study that writes a folder.

    Attributes:
        metrics: Every figure of the study, JSON-able.
        gallery: Figures drawn into the folder.
        sections: Sections of smaller studies that this study contains.
    """

    metrics: dict[str, Any]
    gallery: Gallery
    sections: list[PageSection] = field(default_factory=list)


class Stages:
    """Stages of a run: progress for the caller, and the time that each stage took.

    Args:
        progress: Receives the stage and the part done; None: nobody does.
        show: Receives a page of what is known early; None: nobody does.
    """

    def __init__(
        self, progress: Progress | None = None, show: Callable[[Page], Any] | None = None
    ) -> None:
        self._progress, self._show = progress, show
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str, begin: float, end: float) -> Iterator[Callable[[float], None]]:
        """One stage; gives a function that receives the part of the stage that is done.

        Args:
            name: Name of the stage.
            begin: Part of the study that is done before it, 0 to 1.
            end: Part of the study that is done after it, 0 to 1.
        """

        def tell(part: float) -> None:
            self.tell(name, begin + part * (end - begin))

        started = time.perf_counter()
        tell(0.0)
        yield tell
        self.seconds[name] = time.perf_counter() - started

    def show(self, page: Page) -> None:
        """Show a page of what is known early.

        Args:
            page: The page; the report takes its place at the end.
        """
        if self._show is not None:
            self._show(page)

    def tell(self, name: str, part: float) -> None:
        """Report progress.

        Args:
            name: Name of the stage.
            part: Part of the whole study that is done, 0 to 1.
        """
        if self._progress is not None:
            self._progress(name, part)


def write_study(
    out: Path,
    plan: Plan,
    run: Callable[[Plan, Path, Stages], Results],
    page: Callable[[Results], Page],
    progress: Progress | None = None,
) -> tuple[Path, Page]:
    """Run a study into a folder: report.html, metrics.json, figures and the study's own files.

    Args:
        out: Folder of the results; it is made if it does not exist.
        plan: What the study does.
        run: Function `run` of the study.
        page: Function `page` of the study.
        progress: Receives the stage and the part done.

    While it runs, report.html may hold an early page.

    Returns:
        Path of report.html, and the page with its pictures as vectors, which are smaller.

    Raises:
        OutputError: If a file cannot be written; the report is written where it can be.
    """
    make_folder(out)
    stages = Stages(progress, lambda early: early.write(out / "report.html"))
    results = run(plan, out, stages)
    text = json.dumps(json_ready(results.metrics), indent=1, ensure_ascii=False)
    whole = page(results)
    try:
        write_whole(out / "metrics.json", text + "\n")
    finally:  # figures that cannot be written do not cost the report
        report = whole.write(out / "report.html")
    stages.tell("done", 1.0)
    vectors = replace(results, gallery=results.gallery.vectors())
    return report, page(vectors)


def table_of(columns: Columns, rows: Sequence[Row], caption: str = "") -> Table:
    """A table with one line for each row of results.

    Args:
        columns: Heading of each column, with its unit, and the key of its cell in a row or a
            function that gives the cell of a row. A key that a row lacks gives an empty cell.
        rows: Results.
        caption: What the table shows.
    """
    cells = [
        [row.get(key) if isinstance(key, str) else key(row) for key in columns.values()]
        for row in rows
    ]
    return Table(list(columns), cells, caption)
