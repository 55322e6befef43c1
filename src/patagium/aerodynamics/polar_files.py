"""Static polars of sections from text files of XFOIL, AeroSandbox or NeuralFoil.

A header names the columns, numbers follow, apart by spaces or commas; angles are in degrees.
Neglected: Reynolds number and all other columns.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from patagium.arguments import checked
from patagium.arrays import Array
from patagium.errors import Unreadable
from patagium.reading import text_of

_COLUMNS = ("alpha", "cl", "cd", "cm")
_LARGEST = 1 << 24  # B


class PolarTable(NamedTuple):
    """Static polar of a section, in the order of the arguments of `measured_section`.

    Attributes:
        angle: Angles of attack, ascending, (n,) [rad].
        lift: C_L, (n,) [-].
        drag: C_D, (n,) [-].
        moment: C_m about the quarter chord, nose up, (n,) [-]; None if the file has none.
    """

    angle: Array
    lift: Array
    drag: Array
    moment: Array | None


@checked
def read_polar(path: str | Path) -> PolarTable:
    """Static polar from a text file: columns alpha [degrees], CL, CD and perhaps CM, by name.

    Rows are sorted by angle; of rows with the same angle the first counts.

    Args:
        path: Polar saved by XFOIL, or a CSV file of AeroSandbox's or NeuralFoil's results.

    Raises:
        Unreadable: If the file cannot be read, or has no header with alpha, CL and CD or fewer
            than two rows of numbers after it.
    """
    lines = [line.replace(",", " ").split() for line in text_of(path, _LARGEST).splitlines()]
    names = [[word.strip("\"'").lower() for word in line] for line in lines]
    first = next((k for k, line in enumerate(names) if {*_COLUMNS[:3]} <= {*line}), None)
    if first is None:
        expected = "a header that names the columns alpha, CL and CD"
        raise Unreadable(str(path), "", expected, "none")
    header = names[first]
    places = [header.index(name) for name in _COLUMNS if name in header]
    rows = []
    for words in lines[first + 1 :]:
        try:
            numbers = [float(words[place]) for place in places]
        except (ValueError, IndexError):
            continue  # rules below a header, and remarks
        if np.isfinite(numbers).all():
            rows.append(numbers)
    table = np.array(rows).reshape(len(rows), len(places))
    _, kept = np.unique(table[:, 0], return_index=True)
    if len(kept) < 2:
        raise Unreadable(str(path), "", "two or more rows of numbers", f"{len(kept)}")
    angle, lift, drag, *moment = table[kept].T
    return PolarTable(np.radians(angle), lift, drag, moment[0] if moment else None)
