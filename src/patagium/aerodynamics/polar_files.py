"""Static polars of sections from text files of XFOIL, AeroSandbox, NeuralFoil or AeroDyn.

A header names the columns, numbers follow: apart by semicolons or commas if the header's names
are, else by spaces. Neglected: the size of the Reynolds number and all other columns.
"""

from __future__ import annotations

import csv
import re
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np

from patagium.arguments import checked
from patagium.arrays import Array
from patagium.errors import Unreadable
from patagium.reading import text_of

_COLUMNS = ("alpha", "cl", "cd", "cm")
_ANGLE = re.compile("(?:alpha|aoa|angleofattack)(deg(?:rees?)?|rad(?:ians?)?|)")
_LARGEST = 1 << 24  # B
_STEEP = 0.3  # 1/degree, of C_L over a whole polar: nearly three times a thin section's


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


def is_polar(path: str | Path) -> bool:
    """Whether a text file has a header with the columns alpha, CL and CD.

    Raises:
        Unreadable: If the file cannot be read.
    """
    lines = text_of(path, _LARGEST).splitlines()
    return any({*_COLUMNS[:3]} <= {*_header(line)} for line in lines)


@checked
def read_polar(path: str | Path) -> PolarTable:
    """Static polar of a section, from the columns alpha, CL, CD and perhaps CM of a text file.

    Angles are in degrees unless the header has alpha [rad] or alpha_rad; AoA is alpha. Rows are
    sorted by angle; of rows with the same angle the first counts. Rows without a number in
    one of these columns are left out. So are, with a warning, those beyond 90 degrees (270 is
    -90): a section that moves backward is its own mirror image in every model.

    Args:
        path: Polar saved by XFOIL, a CSV file of AeroSandbox's or NeuralFoil's results, or a file
            of AeroDyn 15 with one table.

    Raises:
        Unreadable: If the file cannot be read, has not one header with alpha, CL and CD and two
            rows of numbers after it, has several Reynolds numbers, or angles in radians unsaid.
    """
    lines = text_of(path, _LARGEST).splitlines()
    headers = [_header(line) for line in lines]
    firsts = [k for k, names in enumerate(headers) if {*_COLUMNS[:3]} <= {*names}]
    if len(firsts) != 1:
        expected = "one header that names the columns alpha, CL and CD"
        raise Unreadable(path, "", expected, str(len(firsts) or "none"))
    first, header, names = firsts[0], lines[firsts[0]], headers[firsts[0]]
    most, unit = len(_cells(header, header)) if {*";,"} & {*header} else None, names["alpha"][1]
    wanted = [names[name][0] for name in _COLUMNS if name in names]
    flow = [names[name][0] for name in names if name == "re" or name.startswith("reynolds")]
    if unit[:3] not in ("", "deg", "rad", "°"):
        raise Unreadable(path, "alpha", "angles in [deg] or [rad]", unit)
    rows, flows = [], list[float]()
    for number, line in enumerate(lines[first + 1 :], first + 2):
        cells = _cells(line, header)
        numbers = [_number(cells, place) for place in wanted]
        if not np.isfinite(numbers).all():
            continue  # rules below a header, remarks, and points that were not found
        if most and any(cells[most:]):
            found = f"{len(cells)}; apart by semicolons, or in quotes, numbers may have commas"
            raise Unreadable(path, f"line {number}", f"{most} cells", found)
        rows.append(numbers)
        flows += [_number(cells, place) for place in flow]
    known = np.unique(np.array(flows)[np.isfinite(flows)])
    if known.size and np.ptp(known) > 1e-6 * known.max():
        remedy = f"{', '.join(f'{one:g}' for one in known)}; keep the rows of one"
        raise Unreadable(path, "Re", "one Reynolds number", remedy)
    table = np.array(rows).reshape(len(rows), len(wanted))
    turn = 2 * np.pi if unit[:3] == "rad" else 360.0
    table[table[:, 0] > turn / 2, 0] -= turn
    _, kept = np.unique(table[:, 0], return_index=True)
    if len(kept) < 2:
        raise Unreadable(path, "", "two or more rows of numbers", f"{len(kept)}")
    table = table[kept]
    with np.errstate(over="ignore"):  # the polar refuses what is too large
        span, rise = np.ptp(table[:, :2], axis=0)
    if not unit and rise > _STEEP * span:
        rises = f"C_L {rise:.3g} higher in {span:.3g} degrees"
        raise Unreadable(path, "alpha", "degrees, or a column alpha [rad]", rises)
    table[:, 0] *= 2 * np.pi / turn
    angle, lift, drag, *moment = _within(table, str(path)).T
    return PolarTable(angle, lift, drag, moment[0] if moment else None)


def _within(table: Array, path: str) -> Array:
    """Rows within 90 degrees; a warning tells how many are left out."""
    within = np.abs(table[:, 0]) <= np.pi / 2 + 1e-9
    if not within.all():
        left = f"{np.count_nonzero(~within)} of {len(within)} rows"
        words = f"{path}: {left} are beyond 90 degrees and left out: backward motion is mirrored"
        warnings.warn(words, stacklevel=4)
    if np.count_nonzero(within) < 2:
        raise Unreadable(path, "alpha", "two or more rows within 90 degrees", "fewer")
    return table[within]


def _cells(line: str, header: str) -> list[str]:
    """Cells of a line, without quotes, split at the mark that splits the header."""
    mark = next((mark for mark in ";," if mark in header), None)
    if mark is None:
        return line.split()
    try:
        return next(csv.reader([line], delimiter=mark, skipinitialspace=True), [])
    except csv.Error:
        return []  # one longer than any number


def _number(cells: list[str], place: int) -> float:
    """Number in a cell, with a point or a comma; not a number if there is none."""
    try:
        return float(cells[place].replace(",", "."))
    except (ValueError, IndexError):
        return float("nan")


def _header(line: str) -> dict[str, tuple[int, str]]:
    """Position and unit of each column in a header line; units in brackets, as in alpha [deg]."""
    joined = re.sub(r"^[\s#%!]+|\s+(?=[\[(])", "", line.lower())  # remarks' marks are no column
    found: dict[str, tuple[int, str]] = {}
    for place, word in enumerate(_cells(joined, joined)):
        opened = re.sub("[ _\"']", "", word).replace("(", "[")
        name, _, unit = opened.partition("[")
        if angle := _ANGLE.fullmatch(name):
            name, unit = "alpha", unit or angle[1]
        found.setdefault(name, (place, unit.rstrip("])")))
    return found
