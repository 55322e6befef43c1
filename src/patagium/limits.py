"""Bounds of what is read and computed, each with its reason.

A bound stops what no honest input needs: it is far above the largest use, and far below what
would fill the memory or keep the program busy for minutes.
"""

from __future__ import annotations

import os
from pathlib import Path

ROBOT_FILE = 1_000_000
"""File of a robot [B], with the shapes and meshes that a URDF names."""
YAML_TEXT = 400_000
"""YAML of a robot, a mapping or settings [B]: the longest preset has 3 kB, settings with all trials
some 60 kB; 100 kB take a second."""
TABLE_FILE = 100_000_000
"""CSV text of a gait, path or polar, read at once [B]; a row takes some 100 B."""
NESTING = 60
"""Levels of nested lists and mappings; files of the package have 12."""
ENTRIES = 200_000
"""Entries of YAML, aliases written out: what such a text can honestly hold."""
LEAST_TRIALS = 8
"""Trials of `tune` at least: those that are drawn at a time."""
PROBLEMS = 8
"""Problems of a file that are told one by one; more are counted."""
SHOWN = 60
"""Characters of a value that a message shows."""
QUANTITY = 100
"""Characters of a quantity with its unit."""
UNIT = 40
"""Characters of a unit; the longest SI unit of a mapping has 14."""
LARGEST = 1e30
"""Magnitude of a physical quantity [SI]: products of ten of them are still finite numbers."""
LEAST_MASS = 1e-20
"""Mass of a body that has one [kg]: a bacterium has 1e-15 kg."""
TURN, SWING, TILT = 6.2832, 3.1416, 1.571
"""Largest angle of any kind, amplitude, and incidence or pitch that is written without a unit
[rad]: larger numbers are degrees whose unit was forgotten."""
MEMORY_SHARE = 0.125
"""Share of the free memory that samples of a flight take before they go to the disk."""
DISK_SHARE = 0.9
"""Share of the free disk that they may take there."""
LEAST_INERTIA = 1e-40
"""Moment of inertia about a joint [kg m^2]: the least mass at a distance of 0.1 nm."""
WIDEST = 1_000_000
"""Neurons of a layer: one more layer of the same size would have 8 TB of weights."""
MOST_STEPS = 10**15
"""Time steps of a flight: near 10^16 a float no longer tells one from the next."""


def free_memory() -> int:
    """Memory that can be taken now [B], also where a control group allows less than there is."""
    found = []
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        stated = next(line for line in lines if line.startswith("MemAvailable"))
        found.append(int(stated.split()[1]) * 1024)
        group = Path("/sys/fs/cgroup")
        most = (group / "memory.max").read_text().strip()
        if most.isdecimal():
            found.append(int(most) - int((group / "memory.current").read_text()))
    except (OSError, StopIteration, ValueError, IndexError):
        pass
    if not found:  # no Linux: half of what the machine has
        found = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2]
    return max(min(found), 0)


def in_bytes(size: float) -> str:
    """A number of bytes as a person reads it, such as '102 TiB'."""
    for unit in ("B", "KiB", "MiB", "GiB", "TiB", "PiB"):
        if size < 1024 or unit == "PiB":
            break
        size /= 1024
    return f"{size:.3g} {unit}"
