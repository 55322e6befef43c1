"""Pages of studies as Markdown, for the documentation.

Markdown does not understand HTML: prose besides `code` and **bold** is taken literally.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from patagium.report.page import Block, KeyNumber, Link, Note, PageSection, Picture, Table

MARK = "<!-- Written by patagium; do not edit: run the command again. -->"
"""First line of every page."""


def markdown_page(
    title: str,
    sections: Sequence[PageSection],
    summary: str,
    facts: Mapping[str, str],
    folder: str,
    opening: Sequence[Block] = (),
) -> tuple[str, dict[str, bytes]]:
    """Text of a page and its pictures.

    Args:
        title: Title of the page.
        sections: In reading order.
        summary: What was found, in a few sentences, under the title.
        facts: Where it comes from, at the foot.
        folder: Where the pictures lie, as seen from the page.
        opening: Blocks before the sections.

    Returns:
        The text, and the pictures by name of their files: that of the section, numbered
        where it has several.
    """
    pictures: dict[str, bytes] = {}
    parts = [MARK, f"# {markdown_prose(title)}", *([markdown_prose(summary)] if summary else [])]
    for section in (PageSection("At a glance", opening), *sections):
        if section.blocks:
            parts.append(f"## {markdown_prose(section.title)}")
        for block in section.blocks:
            if isinstance(block, Picture):
                kind, image = block.file()
                name = _free(section.title, kind, pictures)
                pictures[name] = image
                caption = markdown_prose(block.caption)
                parts += [f"![{markdown_prose(section.title)}]({folder}/{name})", f"*{caption}*"]
            else:
                parts += _block(block)
    if facts:
        listed = [
            f"- **{markdown_prose(name)}**: {markdown_prose(value)}"
            for name, value in facts.items()
        ]
        parts += ["## Where it comes from", "\n".join(listed)]
    return "\n\n".join(parts) + "\n", pictures


def markdown_prose(text: str) -> str:
    """Text in which `code` and **bold** stay as they are and all else is literal."""
    return "".join(map(_span, re.split(r"(`[^`]+`|\*\*[^*]+\*\*)", text)))


def table_text(table: Table) -> str:
    """Table without its caption, with columns of numbers aligned to the right."""
    rules = ["---:" if table.numeric(i) else "---" for i in range(len(table.columns))]
    rows = [
        [markdown_prose(cell).replace("|", "\\|") for cell in row]
        for row in (table.columns, *table.texts())
    ]
    rows.insert(1, rules)
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _block(block: Block) -> list[str]:
    if isinstance(block, Table):
        caption = [f"*{markdown_prose(block.caption)}*"] if block.caption else []
        return [*caption, table_text(block)]
    if isinstance(block, Note):
        return [f"> {markdown_prose(block.text)}"]
    if isinstance(block, KeyNumber):
        return [markdown_prose(f"**{block.value}**: {block.meaning} {block.beside}")]
    if isinstance(block, Link):
        return [f"[{markdown_prose(block.text)}]({block.address})"]
    return [re.sub(r"^(\d*)(?=[#+>.)-])", r"\1\\", markdown_prose(str(block)))]


def _span(text: str) -> str:
    if text.startswith("`"):
        return text
    return f"**{markdown_prose(text[2:-2])}**" if text.startswith("**") else _literal(text)


def _literal(text: str) -> str:
    text = re.sub(r"([\\*$]|<(?=[\w/!?])|&(?=#?\w+;)|\](?=\()|\[(?=\^))", r"\\\1", text)
    return re.sub(r"((?<!\w)_|_(?!\w))", r"\\\1", text)


def _free(title: str, kind: str, taken: Mapping[str, object]) -> str:
    """Name of a file after a title, one that is not taken."""
    stem = re.sub(r"\W+", "-", title.lower()).strip("-")
    number, name = 1, f"{stem}.{kind}"
    while name in taken:
        number += 1
        name = f"{stem}-{number}.{kind}"
    return name
