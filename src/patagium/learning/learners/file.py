"""A learner on disk: what it is made of and all it has learned; it goes on where it stood.

    patagium learner 1
    SHA-256 of all that follows, in hexadecimal
    one line of JSON: the learner's description, its counts, the arrays that follow
    the arrays, little-endian, row by row, one after the other

A model (`model_file`) predicts; a state learns on. Numbers come back bit for bit. What differs on
another machine is its arithmetic: without a compiler, or with other vectors, weights go on equal
to rounding. Neglected: wall-clock times of updates; they are not kept.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from patagium.errors import LogError, PatagiumError
from patagium.learning.learners.description import (
    first_difference,
    learner_from_description,
)
from patagium.learning.learners.learner import Learner
from patagium.version import __version__
from patagium.whole_file import write_whole

FORMAT = "patagium learner 1"


class Resumable(Learner, Protocol):
    """A learner whose state can be kept."""

    def state(self) -> dict[str, Any]:
        """All that the next samples depend on: arrays and JSON-able values by name."""
        ...

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        ...

    def restart_clock(self) -> None:
        """Take the next sample by whatever clock it comes."""
        ...

    def save(self, path: str | Path) -> Path:
        """Keep the learner in a file."""
        ...


def save_learner(path: str | Path, learner: Resumable) -> Path:
    """Keep a learner's state, on the disk before this returns; see `Learner.save`.

    Args:
        path: The file, replaced whole or not at all; folders are made.
        learner: The learner, between two samples.

    Returns:
        The path.

    Raises:
        OSError: If it cannot be written; the file is then as it was.
    """
    return write_whole(path, _bytes_of(learner.describe(), learner.state()))


def load_learner(path: str | Path, like: Learner | None = None) -> Resumable:
    """The learner that `save` kept: it goes on as the one that was saved would have.

    Args:
        path: The file.
        like: A learner that must be described alike, but for centers and scales of its inputs
            and outputs; None: any.

    Raises:
        LogError: If there is no such file, it is damaged, of another version, or describes
            another learner.
    """
    file = Path(path)
    try:
        content = file.read_bytes()
    except OSError as problem:
        raise LogError(f"{file}: cannot be read: {problem.strerror}") from None
    sound = _sound(file, content)
    try:
        header, arrays = _parts_of(sound)
        if like is not None:
            difference = first_difference(header["learner"], like.describe())
            if difference is not None:
                raise LogError(f"{file}: of another learner: {difference}")
        learner = learner_from_description(header["learner"])
        learner.resume({**header["state"], **arrays})
    except LogError:
        raise
    except (PatagiumError, AttributeError, KeyError, TypeError, ValueError) as problem:
        raise LogError(f"{file}: the learner cannot be made again: {problem}") from problem
    return learner


def _bytes_of(description: Mapping[str, Any], state: Mapping[str, Any]) -> bytes:
    arrays = {name: _plain(value) for name, value in state.items() if _is_array(value)}
    header = {
        "patagium_version": __version__,
        "learner": description,
        "state": {name: value for name, value in state.items() if not _is_array(value)},
        "arrays": {name: [array.dtype.str, array.shape] for name, array in arrays.items()},
    }
    parts = [json.dumps(header).encode(), b"\n", *(array.tobytes() for array in arrays.values())]
    rest = b"".join(parts)
    return b"%s\n%s\n%s" % (FORMAT.encode(), hashlib.sha256(rest).hexdigest().encode(), rest)


def _sound(file: Path, content: bytes) -> bytes:
    """What the digest of a file's content says was written.

    Raises:
        LogError: If it is of another format, or damaged.
    """
    first, _, content = content.partition(b"\n")
    if first != FORMAT.encode():
        found = first[:40].decode("ascii", errors="replace")
        raise LogError(f"{file}: expected a file of format {FORMAT!r}, found {found!r}")
    digest, _, rest = content.partition(b"\n")
    if digest != hashlib.sha256(rest).hexdigest().encode():
        raise LogError(
            f"{file}: damaged: expected what was written, found {len(rest)} bytes with another "
            "digest; use an older copy"
        )
    return rest


def _parts_of(sound: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays."""
    text, _, numbers = sound.partition(b"\n")
    header, arrays, start = json.loads(text), {}, 0
    for name, (kind, shape) in header["arrays"].items():
        dtype, count = np.dtype(kind), int(np.prod(shape, dtype=int))
        flat = np.frombuffer(numbers, dtype, count, start)
        arrays[name] = flat.reshape(shape).astype(dtype.newbyteorder("="))
        start += flat.nbytes
    return header, arrays


def _is_array(value: object) -> bool:
    return isinstance(value, np.ndarray)


def _plain(array: NDArray[Any]) -> NDArray[Any]:
    """The same row by row, little-endian."""
    return np.asarray(array, array.dtype.newbyteorder("<"), order="C")
