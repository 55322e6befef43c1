"""File of a learner's description and state, from which it goes on where it stood.

    patagium learner 1
    SHA-256 of all that follows, in hexadecimal
    one line of JSON: the learner's description, its counts, the arrays that follow
    the arrays, little-endian, row by row, one after the other

A model (`model_file`) predicts; a state learns on. Numbers come back bit for bit. On another
machine the arithmetic differs: without a compiler, or with other vectors, weights go on equal
to rounding. Wall-clock times of updates are not kept.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.errors import LogError, ParameterError
from patagium.limits import free_memory
from patagium.netcdf_file import kind_of
from patagium.reading import bytes_of, json_object, made_again
from patagium.version import __version__
from patagium.whole_file import write_whole

FORMAT = "patagium learner 1"


def write_state(path: str | Path, description: Mapping[str, Any], state: Mapping[str, Any]) -> Path:
    """Keep a learner's description and state, on the disk before this returns.

    Raises:
        OutputError: If it cannot be written; the file is then as it was.
    """
    arrays = {
        name: np.asarray(value, value.dtype.newbyteorder("<"), order="C")  # row by row
        for name, value in state.items()
        if isinstance(value, np.ndarray)
    }
    header = {
        "patagium_version": __version__,
        "learner": description,
        "state": {name: value for name, value in state.items() if name not in arrays},
        "arrays": {name: [array.dtype.str, array.shape] for name, array in arrays.items()},
    }
    parts = [json.dumps(header).encode(), b"\n", *(array.tobytes() for array in arrays.values())]
    rest = b"".join(parts)
    digest = hashlib.sha256(rest).hexdigest().encode()
    return write_whole(path, b"%s\n%s\n%s" % (FORMAT.encode(), digest, rest))


def read_state(path: str | Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Description of a learner, and its arrays and JSON-able values by name, from a file.

    Raises:
        LogError: If there is no such file, it is damaged or of another version.
    """
    file = Path(path)
    sound = _sound(file, bytes_of(file, free_memory() // 4))
    with made_again(f"{file}: the learner"):
        header, arrays = _parts_of(sound)
        return header["learner"], {**header["state"], **arrays}


def _sound(file: Path, content: bytes) -> bytes:
    """Content of a file as its digest says it was written.

    Raises:
        LogError: If it is of another format, or damaged.
    """
    first, _, content = content.partition(b"\n")
    if first != FORMAT.encode():
        other = "" if first.startswith(b"patagium learner") else kind_of(file)
        found = other or repr(first[:40].decode("ascii", errors="replace"))
        raise LogError(file, f"a file of format {FORMAT!r}", found)
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
    header, arrays, start = json_object(text, "header"), {}, 0
    for name, (kind, shape) in header["arrays"].items():
        dtype, count = np.dtype(kind), prod(shape)
        if dtype.kind not in "fiub" or min(shape, default=0) < 0:
            raise ParameterError(name, "real numbers of a size", f"{kind} {shape}")
        flat = np.frombuffer(numbers, dtype, count, start)
        arrays[name] = flat.reshape(shape).astype(dtype.newbyteorder("="))
        start += flat.nbytes
    return header, arrays
