"""The live view begins where force arrows are seen from the side."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest

import patagium as pt
from patagium.cli.main import run
from patagium.viewer.live_page import LiveScene

END_ON = np.radians(25.0)
"""Angle to the line of sight below which an arrow is shorter on the screen than .42 of itself."""


@pytest.mark.parametrize("name", ["aerobat", "hawk", "ornithopter"])
def test_hardly_any_force_points_at_the_eye(name: str, tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        run(["simulate", name, "-o", str(tmp_path / "flight.nc")])
    force = pt.load_flight(tmp_path / "flight.nc")["strip_force"].to_numpy().reshape(-1, 3)
    place, target = LiveScene(MagicMock(), pt.load_robot(name), 0.2).camera
    sight = (target - place) / np.linalg.norm(target - place)
    size = np.linalg.norm(force, axis=1)
    facing = np.abs(force @ sight) > size * np.cos(END_ON)
    assert size[facing].sum() < 0.03 * size.sum()  # from (-.72, -.75, .62): .12 with the aerobat
