"""A page as Markdown: text for a documentation site, and pictures as files of their own.

HTML is not understood: what prose holds besides `code` and **bold** is taken literally.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence

from patagium.report.blocks import Block, Link, Note, PageSection, Picture
from patagium.report.tables import Table

MARK = "<!-- Written by patagium; do not edit: run the command again. -->"
"""First line of every page."""


def markdown_page(
    title: str,
    sections: Sequence[PageSection],
    summary: str,
    facts: Mapping[str, str],
    folder: str,
) -> tuple[str, dict[str, bytes]]:
    """Text of a page and its pictures.

    Args:
        title: Title of the page.
        sections: In reading order.
        summary: What was found, in a few sentences, under the title.
        facts: Where it comes from, at the foot.
        folder: Where the pictures lie, as seen from the page.

    Returns:
        The text, and the pictures by name of their files: that of the section, numbered
        where it has several.
    """
    pictures: dict[str, bytes] = {}
    parts = [MARK, f"# {prose(title)}", *([prose(summary)] if summary else [])]
    for section in sections:
        parts.append(f"## {prose(section.title)}")
        for block in section.blocks:
            if isinstance(block, Picture):
                kind, image = _image(block)
                name = _free(section.title, kind, pictures)
                pictures[name] = image
                caption = prose(block.caption)
                parts += [f"![{prose(section.title)}]({folder}/{name})", f"*{caption}*"]
            else:
                parts += _block(block)
    if facts:
        listed = [f"- **{prose(name)}**: {prose(value)}" for name, value in facts.items()]
        parts += ["## Where it comes from", "\n".join(listed)]
    return "\n\n".join(parts) + "\n", pictures


def prose(text: str) -> str:
    """Text in which `code` and **bold** stay as they are and all else is literal."""
    return "".join(map(_span, re.split(r"(`[^`]+`|\*\*[^*]+\*\*)", text)))


def table_text(table: Table) -> str:
    """A table without its caption; columns of numbers flush right."""
    rules = ["---:" if table.numeric(i) else "---" for i in range(len(table.columns))]
    rows = [[_cell(cell) for cell in row] for row in (table.columns, *table.texts())]
    rows.insert(1, rules)
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _block(block: Block) -> list[str]:
    if isinstance(block, Table):
        caption = [f"*{prose(block.caption)}*"] if block.caption else []
        return [*caption, table_text(block)]
    if isinstance(block, Note):
        return [f"> {prose(block.text)}"]
    if isinstance(block, Link):
        return [f"[{prose(block.text)}]({block.address})"]
    return [re.sub(r"^(\d*)(?=[#+>.)-])", r"\1\\", prose(str(block)))]


def _span(text: str) -> str:
    if text.startswith("`"):
        return text
    return f"**{prose(text[2:-2])}**" if text.startswith("**") else _literal(text)


def _literal(text: str) -> str:
    text = re.sub(r"([\\*$]|<(?=[\w/!?])|&(?=#?\w+;)|\](?=\()|\[(?=\^))", r"\\\1", text)
    return re.sub(r"((?<!\w)_|_(?!\w))", r"\\\1", text)


def _cell(text: str) -> str:
    return prose(text).replace("|", "\\|")


def _image(picture: Picture) -> tuple[str, bytes]:
    """Kind of a picture's file, and its bytes."""
    head, data = picture.source.split(",", 1)
    kind = "svg" if "svg" in head else "png"
    return kind, base64.b64decode(data)


def _free(title: str, kind: str, taken: Mapping[str, object]) -> str:
    """Name of a file after a title, one that is not taken."""
    stem = re.sub(r"\W+", "-", title.lower()).strip("-")
    number, name = 1, f"{stem}.{kind}"
    while name in taken:
        number += 1
        name = f"{stem}-{number}.{kind}"
    return name
