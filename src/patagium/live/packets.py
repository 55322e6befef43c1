"""Packets as lines of a CSV text or rows of datagrams: readers, a sender, counts of bad ones.

A text has a header that names the columns of `packet_columns`, in any order; other columns are
passed over, an empty field is a missing number. A datagram is little-endian float64:

    session, sequence, then rows of time, q, v, a, u1 and the known forces carried.

The session is any number that the sender chose when it began, the sequence how many rows it sent
before this datagram; so what is lost, doubled or overtaken can be told. UDP has
checksums of its own; clocks of sender and receiver are not compared. Neglected by the sender of a
flight, which holds true values: noise, delays and clocks of sensors.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import isfinite, nan

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.errors import LogError, ParameterError
from patagium.sensing.force.air_force import PARTS

Array = NDArray[np.float64]

LARGEST_DATAGRAM = 65507
"""Largest payload of UDP [B]."""
_HEADER = 2
_SHOWN = 3


@dataclass
class Intake:
    """Counts of packets that came in, and of those that did not.

    Attributes:
        received: Packets that were read.
        lost: Packets that the sequence numbers say were sent and never came.
        repeated: Packets that came twice, or after later ones; not used.
        bad_rows: Lines or datagrams that are no packets.
        dropped: Packets for which there was no room, because the learner was too slow.
        examples: The first bad ones, in words.
    """

    received: int = 0
    lost: int = 0
    repeated: int = 0
    bad_rows: int = 0
    dropped: int = 0
    examples: list[str] = field(default_factory=list)

    def refuse(self, reason: str) -> None:
        """Count a bad row, and keep the first few reasons."""
        self.bad_rows += 1
        if len(self.examples) < _SHOWN:
            self.examples.append(reason)

    @property
    def counts(self) -> dict[str, int]:
        """Counts by name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, int)}


class TextPackets:
    """Packets of a CSV text that comes in pieces.

    Args:
        columns: Names of the numbers of a packet.
        intake: Where they are counted.
    """

    def __init__(self, columns: Sequence[str], intake: Intake) -> None:
        self._columns, self._intake = tuple(columns), intake
        self._places: list[int] | None = None
        self._fields, self._line, self._rest = 0, 0, b""

    def take(self, piece: bytes) -> Array:
        """Packets of the lines that end in this piece, (k, columns).

        Raises:
            LogError: If the first line does not name all columns.
        """
        *lines, self._rest = (self._rest + piece).split(b"\n")
        rows = [row for row in map(self._packet, lines) if row is not None]
        self._intake.received += len(rows)
        return np.array(rows, float).reshape(len(rows), len(self._columns))

    def end(self) -> None:
        """End the text; a last line without an end is no packet."""
        if self._rest.strip():
            self._line += 1
            self._intake.refuse(f"line {self._line}: the text ends within it")
        self._rest = b""

    def _packet(self, line: bytes) -> list[float] | None:
        self._line += 1
        text = line.strip()
        if not text or text.startswith(b"#"):
            return None
        fields = text.split(b",")
        if self._places is None:
            self._places = self._read_header(fields)
            return None
        try:
            return self._row(fields, self._places)
        except ValueError as problem:
            self._intake.refuse(f"line {self._line}: {problem}")
            return None

    def _row(self, fields: list[bytes], places: list[int]) -> list[float]:
        if len(fields) != self._fields:
            raise ValueError(f"expected {self._fields} fields, found {len(fields)}")
        row = [_number(fields[place]) for place in places]
        if not isfinite(row[0]):
            raise ValueError(f"expected a time, found {row[0]}")
        return row

    def _read_header(self, fields: list[bytes]) -> list[int]:
        names = [name.strip().decode("utf-8", "replace") for name in fields]
        missing = [name for name in self._columns if name not in names]
        if missing:
            shown = ", ".join(missing[:6]) + (" ..." if len(missing) > 6 else "")
            raise LogError(
                f"line {self._line}: expected a header with the columns {shown}, found "
                f"{', '.join(names[:6])}{' ...' if len(names) > 6 else ''}"
            )
        self._fields = len(names)
        return [names.index(name) for name in self._columns]


class DatagramPackets:
    """Packets of datagrams, as they come in.

    Args:
        columns: How many numbers a packet has.
        intake: Where they are counted.
    """

    def __init__(self, columns: int, intake: Intake) -> None:
        self._columns, self._intake = columns, intake
        self._session, self._expected = nan, 0

    def take(self, datagram: bytes) -> Array:
        """New packets of a datagram, (k, columns)."""
        try:
            return self._in_order(*self._read(datagram))
        except ValueError as problem:
            self._intake.refuse(f"datagram: {problem}")
            return np.empty((0, self._columns))

    def _read(self, datagram: bytes) -> tuple[float, int, Array]:
        numbers, left = divmod(len(datagram), 8)
        if left or numbers < _HEADER or (numbers - _HEADER) % self._columns:
            raise ValueError(f"expected 8 (2 + k {self._columns}) B, found {len(datagram)} B")
        values = np.frombuffer(datagram, "<f8")
        session, sequence = values[:_HEADER].tolist()
        if not (isfinite(session) and isfinite(sequence) and sequence >= 0):
            raise ValueError(f"expected session and sequence, found {session}, {sequence}")
        rows = values[_HEADER:].reshape(-1, self._columns)
        if not np.isfinite(rows[:, 0]).all():
            raise ValueError("expected times, found one that is not finite")
        return session, int(sequence), rows

    def _in_order(self, session: float, sequence: int, rows: Array) -> Array:
        if session != self._session:
            self._session, self._expected = session, sequence
        old = min(len(rows), max(0, self._expected - sequence))
        self._intake.repeated += old
        self._intake.lost += max(0, sequence - self._expected)
        self._intake.received += len(rows) - old
        self._expected = max(self._expected, sequence + len(rows))
        return rows[old:]


def datagrams(packets: Array, session: float, rows: int = 1, first: int = 0) -> Iterator[bytes]:
    """Packets as datagrams, for a sender.

    Args:
        packets: (N, columns) [units of the columns].
        session: Any number that differs from that of the sender's last run.
        rows: Packets a datagram.
        first: How many were sent before.
    """
    for start in range(0, len(packets), rows):
        part = packets[start : start + rows]
        header = np.array([session, first + start])
        yield np.concatenate([header, part.ravel()]).astype("<f8").tobytes()


def most_rows(columns: int) -> int:
    """Largest number of packets that a datagram holds.

    Args:
        columns: Numbers of a packet.
    """
    return (LARGEST_DATAGRAM // 8 - _HEADER) // columns


def _number(field: bytes) -> float:
    text = field.strip()
    if not text:
        return nan
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"expected a number, found {text.decode('utf-8', 'replace')!r}") from None


def flight_packets(flight: xr.Dataset, carried: Sequence[str] = ()) -> Array:
    """Packets of a flight, (N, 1 + n_q + (3 + k) n): time, q, v, a, u1, and k forces.

    Args:
        flight: Record with q, v, a, u1.
        carried: Known forces that packets carry after u1, among `OPTIONAL_PARTS`.
    """
    parts = [flight[part].transpose("time", ...).to_numpy() for part in (*PARTS, *carried)]
    return np.column_stack([flight["time"].to_numpy(), *parts])


def send_packets(
    flight: xr.Dataset,
    target: tuple[str, int],
    *,
    rate: float | None = None,
    rows: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Send a flight as datagrams.

    Args:
        flight: Record with q, v, a, u1.
        target: Address and port.
        rate: Packets a second; None: as fast as the flight's time goes.
        rows: Packets a datagram.
        progress: Called now and then with packets sent and packets in all.

    Returns:
        How many packets were sent.

    Raises:
        ParameterError: If a datagram cannot hold so many packets.
    """
    packets = flight_packets(flight)
    if rows > most_rows(packets.shape[1]):
        raise ParameterError("rows", f"at most {most_rows(packets.shape[1])}", rows)
    due = packets[:, 0] - packets[0, 0] if rate is None else np.arange(len(packets)) / rate
    family = socket.AF_INET6 if ":" in target[0] else socket.AF_INET
    began, told = time.monotonic(), max(1, len(packets) // (200 * rows))
    with socket.socket(family, socket.SOCK_DGRAM) as port:
        for number, datagram in enumerate(datagrams(packets, time.time(), rows)):
            ahead = due[number * rows] - (time.monotonic() - began)
            if ahead > 0:
                time.sleep(ahead)
            port.sendto(datagram, target)
            if progress is not None and number % told == 0:
                progress(number * rows, len(packets))
    return len(packets)
