"""Figures of a study: files in a folder, and pictures for a page."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from patagium.report import Picture
from patagium.report.figures import save_figure
from patagium.whole_file import make_folder

_KINDS = {"png": "image/png", "svg": "image/svg+xml"}


class Gallery:
    """Figures written as PNG and SVG into a folder.

    Args:
        folder: Folder of the files.
        captions: Caption of each figure that is already in the folder.
        kind: Form in which a page shows the figures, "png" or "svg".
    """

    def __init__(
        self, folder: Path, captions: Mapping[str, str] | None = None, kind: str = "png"
    ) -> None:
        self.folder, self.captions, self.kind = folder, dict(captions or {}), kind

    def add(self, name: str, figure: Figure, caption: str) -> None:
        """Write a figure as `name`.png and `name`.svg.

        Args:
            name: Name of the figure.
            figure: The figure; its layout is fixed afterwards.
            caption: What is seen in it.
        """
        for kind in _KINDS:
            save_figure(figure, make_folder(self.folder) / f"{name}.{kind}")
            figure.set_layout_engine("none")  # the layout is computed once: it takes half the time
        self.captions[name] = caption

    def vectors(self) -> Gallery:
        """Figures shown as vectors."""
        return Gallery(self.folder, self.captions, "svg")

    def pictures(self, *names: str) -> list[Picture]:
        """Pictures of the figures that exist, in the order of their names.

        Args:
            names: Names of figures.
        """
        return [self._picture(name) for name in names if name in self.captions]

    def _picture(self, name: str) -> Picture:
        content = (self.folder / f"{name}.{self.kind}").read_bytes()
        image = base64.b64encode(content).decode("ascii")
        return Picture(f"data:{_KINDS[self.kind]};base64,{image}", self.captions[name])
