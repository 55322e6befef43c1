"""Mutations of valid files: of their bytes, of the tree of YAML and JSON, of the cells of a table.

Everything is drawn from a generator, so that a case can be made again from its seed. Neglected:
guidance by the coverage of the code.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np
import yaml

Draw = np.random.Generator
Mutation = Callable[[bytes, Draw], bytes]

HOSTILE: tuple[Any, ...] = (
    None, True, "", " ", 0, -1, 1, 2**31, 2**63, 10**30, 0.0, -0.0, 1e-320, 1e308, -1e308, 1e-300,
    float("nan"), float("inf"), -float("inf"), [], {}, [[]], [1, 2], {"a": 1}, "1e308 kg",
    "1e-320 kg", "nan", "inf m", "-1 kg", "0 m", "1 m/s^2^9^9^9", "9" * 400, "x" * 5000,
    "1" + " " * 5000 + "m", "\x00", "\ud800", "\u202e", "$\\frac{$", "<script>", "../../x",
    "/dev/null", "%s%n", "{0.__class__}", "y", "2026-01-01", "0x10", "1_000", "~", "é" * 50,
)  # fmt: skip
"""Values that take the place of a valid one."""
_TOKENS: tuple[bytes, ...] = (
    b"&a ", b"*a", b"!!python/object:os.system ", b"!!binary ", b"!!bool ", b"!!float ", b"\t",
    b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"\r", b"\n\n", b": ", b"- ", b"[", b"]", b"{", b"}",
    b'"', b"'", b"#", b"|", b"<<: ", b"? ", b"---\n", b"...\n", b"%YAML 9.9\n", b"<!ENTITY a 'b'>",
    b"&amp;", b"]]>", b"NaN", b"Infinity", b"-", b"1e999", b",", b";", b",,,,", b"9" * 400,
    b"\xed\xa0\x80", b"\x1a", b"[" * 3000, b"{'a':" * 1000, b"<a>" * 1000, b"( " * 500,
)  # fmt: skip
_NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)
_MOST = 4_000_000  # B of a mutated file


def mutated_bytes(content: bytes, draw: Draw) -> bytes:
    """Content after a few mutations of its bytes.

    Args:
        content: Valid content.
        draw: Generator of the mutations.
    """
    data = bytearray(content)
    for _ in range(int(draw.choice([1, 1, 2, 4, 16]))):
        _damage(data, draw)
    return bytes(data[:_MOST])


def mutated_text(content: bytes, draw: Draw) -> bytes:
    """Content with tokens of its language put in, left out or repeated.

    Args:
        content: Valid text.
        draw: Generator of the mutations.
    """
    data = bytearray(content)
    for _ in range(int(draw.choice([1, 1, 2, 5]))):
        place = int(draw.integers(len(data) + 1))
        kind = int(draw.integers(5))
        if kind == 0:
            data[place:place] = _TOKENS[int(draw.integers(len(_TOKENS)))]
        elif kind == 1:
            lines = bytes(data).split(b"\n")
            k, m = (int(one) for one in draw.integers(len(lines), size=2))
            lines[k], lines[m] = lines[m], lines[k]
            data = bytearray(b"\n".join(lines))
        elif kind == 2:
            lines = bytes(data).split(b"\n")
            lines.insert(int(draw.integers(len(lines) + 1)), lines[int(draw.integers(len(lines)))])
            data = bytearray(b"\n".join(lines))
        elif kind == 3:
            end = data.find(b"\n", place)
            del data[place : end if end >= 0 else len(data)]
        else:
            _damage(data, draw)
    return bytes(data[:_MOST])


def mutated_yaml(content: bytes, draw: Draw) -> bytes:
    """YAML whose tree has a few hostile places, or hostile text.

    Args:
        content: Valid YAML.
        draw: Generator of the mutations.
    """
    if draw.random() < 0.4:
        return mutated_text(content, draw)
    tree = mutated_tree(yaml.safe_load(content), draw)
    try:
        text = yaml.safe_dump(tree, sort_keys=False, allow_unicode=True)
    except RecursionError:  # too deep for this writer; JSON is YAML too
        text = json.dumps(tree)
    return text.encode("utf-8", "surrogatepass")


def mutated_json(content: bytes, draw: Draw) -> bytes:
    """JSON whose tree has a few hostile places, or hostile text.

    Args:
        content: Valid JSON.
        draw: Generator of the mutations.
    """
    if draw.random() < 0.3:
        return mutated_text(content, draw)
    return json.dumps(mutated_tree(json.loads(content), draw)).encode()


def mutated_tree(tree: Any, draw: Draw) -> Any:
    """Copy of a tree of mappings and lists with a few hostile places.

    Args:
        tree: Mappings, lists and plain values.
        draw: Generator of the places and values.
    """
    whole = {"": deepcopy(tree)}
    for _ in range(int(draw.choice([1, 1, 2, 4]))):
        places = _places(whole)
        holder, key = places[int(draw.integers(len(places)))]
        kind = int(draw.integers(7))
        if kind == 0 and key != "":
            del holder[key]
        elif kind == 1 and isinstance(holder, dict) and key != "":
            holder[str(_hostile(draw))] = holder.pop(key)
        elif kind == 2:
            other, name = places[int(draw.integers(len(places)))]
            holder[key] = deepcopy(other[name])
        elif kind == 3:
            holder[key] = [deepcopy(holder[key])] * int(draw.choice([1, 2, 300]))
        elif kind == 4:
            holder[key] = _nested(holder[key], int(draw.choice([3, 30, 100])))
        elif kind == 5 and isinstance(holder[key], int | float):
            holder[key] = _number(holder[key], draw)
        else:
            holder[key] = _hostile(draw)
    return whole[""]


def mutated_table(content: bytes, draw: Draw) -> bytes:
    """CSV text with hostile cells, rows of other lengths, or hostile text.

    Args:
        content: Valid CSV.
        draw: Generator of the mutations.
    """
    if draw.random() < 0.4:
        return mutated_text(content, draw)
    rows = [line.split(",") for line in content.decode().split("\n") if line]
    for _ in range(int(draw.choice([1, 1, 3, 10]))):
        k = 0 if draw.random() < 0.2 else int(draw.integers(len(rows)))
        row = rows[k]
        place = int(draw.integers(len(row))) if row else 0
        kind = int(draw.integers(5))
        if kind == 0 and row:
            del row[place]
        elif kind == 1:
            row.insert(place, str(_hostile(draw)))
        elif kind == 2:
            rows[k] = list(rows[int(draw.integers(len(rows)))])
        elif row:
            row[place] = str(_hostile(draw))
    return "\n".join(",".join(row) for row in rows).encode("utf-8", "surrogatepass")


def _damage(data: bytearray, draw: Draw) -> None:
    """Change bytes at a place drawn: flipped, replaced, left out, repeated, put in or zeroed."""
    if not data:
        data += bytes(draw.integers(256, size=int(draw.integers(1, 64)), dtype=np.uint8))
        return
    place, kind = int(draw.integers(len(data))), int(draw.integers(8))
    if kind == 0:
        data[place] ^= 1 << int(draw.integers(8))
    elif kind == 1:
        data[place] = int(draw.integers(256))
    elif kind == 2:
        del data[place:]
    elif kind == 3:
        del data[place : place + int(draw.choice([1, 4, 64]))]
    elif kind == 4:
        end = place + int(draw.choice([1, 8, 256]))
        data[place:place] = data[place:end]
    elif kind == 5:
        data[place:place] = bytes(draw.integers(256, size=int(draw.choice([1, 8])), dtype=np.uint8))
    elif kind == 6:
        width = int(draw.choice([1, 2, 4, 8]))
        number = _NUMBERS[int(draw.integers(len(_NUMBERS)))] % 256**width
        order = "little" if draw.random() < 0.7 else "big"
        data[place : place + width] = number.to_bytes(width, order)
    else:
        end = min(len(data), place + int(draw.choice([4, 64])))
        data[place:end] = bytes(end - place)


def _places(tree: Any) -> list[tuple[Any, Any]]:
    """All places of a tree: what holds the value, and its key there."""
    keys = list(tree) if isinstance(tree, dict) else range(len(tree))
    found = [(tree, key) for key in keys]
    for key in keys:
        if isinstance(tree[key], dict | list) and len(found) < 3000:
            found += _places(tree[key])
    return found


def _hostile(draw: Draw) -> Any:
    return deepcopy(HOSTILE[int(draw.integers(len(HOSTILE)))])


def _nested(value: Any, depth: int) -> Any:
    for _ in range(depth):
        value = [value]
    return value


def _number(value: float, draw: Draw) -> float:
    """Number near a valid one, or far from it."""
    scale = float(draw.choice([-1.0, 0.0, 1e-9, 0.5, 2.0, 1e3, 1e9, 1e150]))
    return (
        type(value)(value + scale)
        if isinstance(value, int) and abs(scale) < 1e10
        else (value * scale if abs(float(value)) < 1e150 else scale)
    )
