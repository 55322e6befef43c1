"""Description of the package for an index: the README, whose links lead to the project's address.

An index shows the description without the files beside it. So links and pictures of the README
become absolute, at the address `Source` of `[project.urls]`; without such an address pictures go,
and of links the words stay.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?![a-z]+:|#)([^)]+)\)")


def described(text: str, source: str | None) -> str:
    """Description from the text of the README.

    Args:
        text: The README, in Markdown.
        source: Address of the repository; None where it has none.
    """

    def absolute(link: re.Match[str]) -> str:
        picture, words, place = link.groups()
        if source is None:
            return "" if picture else words
        kind = "raw" if picture else "blob"
        return f"{picture}[{words}]({source.rstrip('/')}/{kind}/HEAD/{place})"

    return _LINK.sub(absolute, text)


class ReadmeHook(MetadataHookInterface):
    """Hook of hatchling that gives the description."""

    PLUGIN_NAME = "custom"

    def update(self, metadata: dict[str, Any]) -> None:
        """Set the description.

        Args:
            metadata: The table `project`, which is changed.
        """
        text = (Path(self.root) / "README.md").read_text("utf-8")
        source = metadata.get("urls", {}).get("Source")
        metadata["readme"] = {"content-type": "text/markdown", "text": described(text, source)}
