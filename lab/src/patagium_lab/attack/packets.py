"""Targets that are streams: datagrams and lines of packets with hostile ones among them.

A stranger's datagram has another session or no form at all; the sender's own come whole, for UDP
has a checksum, but may be lost, doubled or late. Whatever comes, a packet that is given to the
learner was sent, and none is given twice. Neglected: a stranger who knows the session.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from patagium.arrays import Array
from patagium.errors import LogError
from patagium.live.packets import DatagramPackets, Intake, TextPackets, datagrams, flight_packets
from patagium_lab.attack import seeds
from patagium_lab.attack.mutation import Draw, mutated_table
from patagium_lab.attack.oracle import Target, WrongNumber

AREA = "packets"


def packet_targets() -> Iterator[Target]:
    """Targets of the area, with their shares of the cases."""
    yield Target(AREA, "datagrams", 30.0, _datagrams)
    yield Target(AREA, "lines", 14.0, _lines)
    yield Target(AREA, "lines in pieces", 8.0, _pieces)


def _clean() -> Array:
    """Packets of the flight."""
    return flight_packets(seeds.flight())


def _datagrams(folder: Path) -> Callable[[Draw], None]:
    """Case of a session with strangers in between."""
    clean = _clean()

    def case(draw: Draw) -> None:
        own = list(datagrams(clean, float(draw.normal()), int(draw.choice([1, 1, 3]))))
        sent = _disturbed(own, draw)
        alone, columns = [one for one, is_own in sent if is_own], clean.shape[1]
        rows = _received([one for one, _ in sent], columns)
        if not np.array_equal(rows, _received(alone, columns)):
            raise WrongNumber("strangers change what comes of a session")
        _judge(rows, clean)

    return case


def _received(sent: list[bytes], columns: int) -> Array:
    """Packets of datagrams."""
    reader = DatagramPackets(columns, Intake())
    return np.concatenate([np.empty((0, columns)), *(reader.take(one) for one in sent)])


def _disturbed(own: list[bytes], draw: Draw) -> list[tuple[bytes, bool]]:
    """Datagrams as they arrive and whether they are the sender's: some lost, doubled, late."""
    sent = [(one, True) for one in own if draw.random() > 0.1]
    for _ in range(int(draw.choice([0, 1, 5]))):
        place, other = (int(k) for k in draw.integers(len(sent), size=2))
        sent.insert(place, sent[other])
    for _ in range(int(draw.choice([1, 3, 10]))):
        sent.insert(int(draw.integers(len(sent) + 1)), (_stranger(own, draw), False))
    return sent


def _stranger(own: list[bytes], draw: Draw) -> bytes:
    """Datagram of a stranger: no form, or the form and numbers out of range."""
    kind = int(draw.integers(6))
    if kind == 0:
        return bytes(draw.integers(256, size=int(draw.choice([0, 1, 16, 500])), dtype=np.uint8))
    one = own[int(draw.integers(len(own)))]
    if kind == 1:
        return one[: int(draw.integers(len(one)) // 8 * 8 + draw.integers(1, 8))]
    values = np.frombuffer(one, "<f8").copy()
    if kind == 2:
        values[0] = draw.choice([np.nan, np.inf])
    elif kind == 3:  # another session, which is the sender's next only if it goes on
        values[0] = draw.normal() + 10.0
        values[2:] = np.nan
    elif kind == 4:
        values[1] = draw.choice([-1.0, np.nan, 1e300, np.inf, 0.5, -np.inf, 2.0**60])
    else:
        values[2] = draw.choice([np.nan, np.inf, -np.inf])
    return values.tobytes()


def _judge(rows: Array, clean: Array) -> None:
    """Refuse rows that were not sent or came twice.

    Raises:
        WrongNumber: If one is.
    """
    known = {row.tobytes(): k for k, row in enumerate(clean)}
    places = [known.get(row.tobytes()) for row in rows]
    if None in places:
        raise WrongNumber(f"a packet that was not sent: {rows[places.index(None)][:4]}")
    if len(set(places)) < len(places):
        raise WrongNumber("a packet was given twice")


def packet_text() -> bytes:
    """CSV text of the packets of the flight."""
    rows = _clean().tolist()
    lines = [",".join(seeds.column_names()), *(",".join(map(repr, row)) for row in rows)]
    return ("\n".join(lines) + "\n").encode()


def _taken(pieces: list[bytes], columns: list[str]) -> Array:
    packets = TextPackets(columns, Intake())
    parts = [packets.take(piece) for piece in pieces]
    packets.end()
    return np.concatenate([np.empty((0, len(columns))), *parts])


def _lines(folder: Path) -> Callable[[Draw], None]:
    """Case of a text with hostile lines; it comes out as when it is read cell by cell."""
    columns, content = seeds.column_names(), packet_text()

    def case(draw: Draw) -> None:
        text = mutated_table(content, draw)
        rows = _taken([text], columns)
        expected = list(_plainly(text, columns))
        if len(rows) != len(expected) or not np.array_equal(
            rows, np.reshape(expected, rows.shape), equal_nan=True
        ):
            raise WrongNumber(f"{len(rows)} packets of a text that has {len(expected)}")

    return case


def _plainly(text: bytes, columns: list[str]) -> Iterator[list[float]]:
    """Packets of a text, read the slow way."""
    names: list[str] | None = None
    for line in text.split(b"\n")[:-1]:
        cells = [cell.strip() for cell in line.strip().split(b",")]
        if not line.strip() or line.strip().startswith(b"#"):
            continue
        if names is None:
            names = [cell.decode("utf-8", "replace") for cell in cells]
            continue
        if len(cells) != len(names):
            continue
        found: dict[str, Any] = {}
        for name, cell in zip(names, cells, strict=True):
            found.setdefault(name, cell)
        try:
            row = [float(found[k].replace(b"_", b"?")) if found[k] else np.nan for k in columns]
        except ValueError:
            continue
        if np.isfinite(row[0]):
            yield row


def _pieces(folder: Path) -> Callable[[Draw], None]:
    """Case of a text that comes in pieces; the same packets as of the whole."""
    columns, content = seeds.column_names(), packet_text()

    def case(draw: Draw) -> None:
        text = mutated_table(content, draw)
        cuts = np.sort(draw.integers(len(text) + 1, size=int(draw.choice([1, 5, 50]))))
        ends = [0, *cuts.tolist(), len(text)]
        pieces = [text[a:b] for a, b in zip(ends[:-1], ends[1:], strict=True)]
        try:
            whole = _taken([text], columns)
        except LogError:
            _taken(pieces, columns)
            raise WrongNumber("a text in pieces was taken, the whole text refused") from None
        if not np.array_equal(_taken(pieces, columns), whole, equal_nan=True):
            raise WrongNumber("a text in pieces gives other packets than the whole text")

    return case
