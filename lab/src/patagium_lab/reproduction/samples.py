"""Samples of flights as files, through which flights reach the worker processes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from patagium.arrays import Array

Series = tuple[Array, Array, Array]
"""Time (N,) [s], states (N, n_x) [m, rad, m/s, rad/s] and forces (N, n) [N, N m]."""


@dataclass(frozen=True)
class Samples:
    """Samples of a flight that is learned, and of flights that are not.

    Attributes:
        learned: Series of the flight that is learned.
        unseen: Series of each flight that is not learned, by name.
        beat: Duration of a wingbeat [s].
    """

    learned: Series
    unseen: Mapping[str, Series]
    beat: float


def write_samples(path: Path, samples: Samples) -> Path:
    """Write samples into a file and give its path.

    Args:
        path: File to write.
        samples: What it holds.
    """
    arrays = {"names": np.array(list(samples.unseen)), "beat": np.array(samples.beat)}
    for number, series in enumerate((samples.learned, *samples.unseen.values())):
        for key, values in zip(_KEYS, series, strict=True):
            arrays[f"{key}_{number}"] = values
    np.savez(path, **arrays)  # type: ignore[arg-type]
    return path


@cache
def load_samples(path: Path) -> Samples:
    """Samples from a file of `write_samples`; they are kept for the life of the process.

    Args:
        path: The file.
    """
    with np.load(path) as file:
        names, beat = file["names"].tolist(), float(file["beat"])
        learned, *unseen = (
            (file[f"time_{k}"], file[f"x_{k}"], file[f"y_{k}"]) for k in range(len(names) + 1)
        )
    return Samples(learned, dict(zip(names, unseen, strict=True)), beat)


_KEYS = ("time", "x", "y")
