"""Elements of a MAT file of version 5, checked before SciPy reads them.

SciPy's compiled reader ends the program at an element of an unknown type, and believes every
length. Neglected: files of version 4, which have no elements.

References:
    MathWorks, MAT-File Format, chapter 1: level 5 MAT-files.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

from patagium.reading import expanded

_NUMBERS = frozenset((1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18))
_MATRIX, _COMPRESSED, _SPARSE = 14, 15, 5
_HEADER = 128  # B of text and version before the elements
_DEEPEST = 32  # structures in structures
_Expand = Callable[[memoryview], memoryview]


def check_elements(path: Path) -> None:
    """Refuse a file of version 5 whose elements have unknown types or lengths beyond its end.

    Raises:
        Unreadable: If its compressed elements would take too much memory.
        ValueError: If an element is of no known type, too long or too deep.
        zlib.error: If a compressed element is damaged.
    """
    content = path.read_bytes()
    if len(content) < _HEADER or content[126:128] not in (b"IM", b"MI"):
        return
    order = "<" if content[126:128] == b"IM" else ">"
    size = 0

    def expand(element: memoryview) -> memoryview:
        nonlocal size  # SciPy holds all of them together
        found = expanded(path, zlib.decompressobj(), element, size)
        size += len(found)
        return memoryview(found)

    _check(memoryview(content), _HEADER, order, 0, expand)


def _check(content: memoryview, begin: int, order: str, depth: int, expand: _Expand) -> int:
    """Number of elements."""
    count = 0
    if depth > _DEEPEST:
        raise ValueError(f"expected at most {_DEEPEST} levels of elements, found more")
    while begin + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, begin)
        start, small = begin + 8, kind >> 16
        if small:
            kind, size, start = kind & 0xFFFF, small, begin + 4
        end = start + size
        if end > len(content) or (small and size > 4):
            raise ValueError(f"expected {len(content) - start} bytes at most, found {size}")
        if kind == _COMPRESSED:
            _check(expand(content[start:end]), 0, order, depth + 1, expand)
        elif kind == _MATRIX:
            _check_matrix(content[start:end], order, depth + 1, expand)
        elif kind not in _NUMBERS:
            raise ValueError(f"expected an element of a known type, found type {kind}")
        begin = begin + 8 if small else end if kind == _COMPRESSED else end + -size % 8
        count += 1
    return count


def _check_matrix(content: memoryview, order: str, depth: int, expand: _Expand) -> None:
    """Refuse an array without all its parts: flags, shape, name, numbers, imaginary ones."""
    count = _check(content, 0, order, depth, expand)
    if len(content) < 16:
        return
    (flags,) = struct.unpack_from(f"{order}I", content, 8)
    kind, is_complex = flags & 0xFF, flags >> 11 & 1
    if 4 <= kind <= 15 and count < (6 if kind == _SPARSE else 4) + is_complex:
        raise ValueError(f"expected an array with its numbers, found {count} elements")
