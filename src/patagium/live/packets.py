"""Packets as lines of a CSV text or rows of datagrams: readers, a sender, counts of bad ones.

A text has a header that names the columns of `packet_columns`, in any order. Other columns are
ignored, an empty field is a missing number. A datagram is little-endian float64:

    session, sequence, then rows of time, q, v, a, u1 and the known forces carried.

A sender of raw samples begins with a description of its sensors, and repeats it each second: a
comment line `# sensors {...}` before the header of a text, a datagram of sequence -1 with the text
after it. Its rows are those of `raw_sensors`.

The session is 64 random bits that the sender draws when it begins, the sequence how many rows it
sent before this datagram; so what is lost, doubled or overtaken can be told. With a key, 32 bytes
follow: HMAC-SHA256 of the rest, so that nobody else can send packets. Packets are not encrypted,
and those of an earlier flight can be sent again to a listener that has not heard them.
UDP has checksums of its own; clocks of sender and receiver are not compared. Neglected by the
sender of a flight, which holds true values: noise, delays and clocks of sensors.

References:
    RFC 3550, appendix A.1: a jump of the sequence counts once two datagrams in order confirm it.
    RFC 2104: HMAC.
"""

from __future__ import annotations

import hmac
import os
import secrets
import socket
import struct
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, nan
from pathlib import Path

import numpy as np
import xarray as xr

from patagium.arguments import Progress
from patagium.arrays import Array
from patagium.errors import LogError, ParameterError, Unreadable
from patagium.live.raw_sensors import sensor_rows, sensors_text
from patagium.reading import regular_file
from patagium.sensing.force.air_force import PARTS
from patagium.sensing.logs.record import AIR_LINE
from patagium.sensing.sensors import SensorLog
from patagium.simulation import robot_of

LARGEST_DATAGRAM = 65507
"""Largest payload of UDP [B]."""
LONGEST_LINE = 1 << 20
"""Longest line of a text [B]."""
_TOO_LONG = f"expected its end within {LONGEST_LINE} B, found none"
REACH = 1 << 14
"""Largest jump of a sequence that one datagram may make [packets]."""
_HEADER = 2
_TAG = 32  # B of HMAC-SHA256
_SHORTEST_KEY, _LONGEST_KEY = 16, 4096  # B
_RUNS = 64  # runs of packets in order that are remembered
_SHOWN = 3
_SENSORS = b"# sensors "
_DESCRIBES = struct.pack("<d", -1.0)
_DESCRIBED = 1.0  # s between two descriptions
_PAUSE = 1.0  # s: longest wait of a sender, whatever the clock of a record did


@dataclass
class Intake:
    """Counts of packets that came in, and of those that did not.

    Attributes:
        received: Packets that were read.
        lost: Packets that the sequence numbers say were sent and that have not come, not even
            after later ones.
        repeated: Packets that came twice, or after later ones; not used.
        bad_rows: Lines or datagrams that are no packets.
        resynchronized: Jumps of a sequence that a second datagram confirmed; what was lost in
            them is not counted.
        unauthenticated: Datagrams without the tag of the key; not used.
        dropped: Packets for which there was no room, because the learner was too slow.
        air: Line of a text that states its air; empty without one.
        examples: The first bad ones, in words.
        raw: Counts of raw samples, as `MotionPackets` counts them.
    """

    received: int = 0
    lost: int = 0
    repeated: int = 0
    bad_rows: int = 0
    resynchronized: int = 0
    unauthenticated: int = 0
    dropped: int = 0
    air: bytes = b""
    examples: list[str] = field(default_factory=list)
    raw: dict[str, int] = field(default_factory=dict)

    def refuse(self, reason: str, *, authentic: bool = True) -> None:
        """Count a bad row or a wrong tag, and keep the first few reasons."""
        self.bad_rows += authentic
        self.unauthenticated += not authentic
        if len(self.examples) < _SHOWN:
            self.examples.append(reason)

    @property
    def counts(self) -> dict[str, int]:
        """Counts by name."""
        counts = {name: value for name, value in vars(self).items() if isinstance(value, int)}
        return counts | {f"raw_{name}": value for name, value in self.raw.items()}


Describe = Callable[[str], Sequence[str]]
"""Function of a description of sensors that gives the names of the numbers of a row."""


class TextPackets:
    """Packets of a CSV text that comes in pieces.

    Args:
        columns: Names of the numbers of a packet.
        intake: Counts of packets.
        describe: Function that takes a description of raw sensors; None: it is a comment.
    """

    def __init__(
        self, columns: Sequence[str], intake: Intake, describe: Describe | None = None
    ) -> None:
        self._columns, self._intake, self._describe = tuple(columns), intake, describe
        self._places: list[int] | None = None
        self._fields, self._line, self._rest = 0, 0, bytearray()

    def take(self, piece: bytes) -> Array:
        """Packets of the lines that end in this piece, (k, columns).

        The time is linear in the length of the text, whatever its pieces.

        Raises:
            LogError: If the first line does not name all columns, or has no end.
        """
        ended, end, begun = piece.rpartition(b"\n")
        lines = (bytes(self._rest) + ended).split(b"\n") if end else []
        if end:
            self._rest = bytearray()
        room = LONGEST_LINE + 1 - len(self._rest)  # one more than allowed says that it is too long
        self._rest += begun[: max(0, room)]
        rows = [row for row in map(self._packet, lines) if row is not None]
        if self._places is None and len(self._rest) > LONGEST_LINE:
            raise LogError(f"line {self._line + 1}: {_TOO_LONG}; binary packets go by udp://")
        self._intake.received += len(rows)
        return np.array(rows, float).reshape(len(rows), len(self._columns))

    def end(self) -> None:
        """End the text; a last line without an end is no packet."""
        if self._rest.strip():
            self._line += 1
            self._intake.refuse(f"line {self._line}: the text ends within it")
        self._rest = bytearray()

    def _packet(self, line: bytes) -> list[float] | None:
        """Numbers of a line; None of a comment, a line of names, or one that is refused."""
        self._line += 1
        if len(line) > LONGEST_LINE:
            self._intake.refuse(f"line {self._line}: {_TOO_LONG}")
            return None
        text = line.strip()
        if text.startswith(_SENSORS) and self._describe is not None and self._places is None:
            words = text.removeprefix(_SENSORS).decode("utf-8", "replace")
            self._columns = tuple(self._describe(words))
        if self._places is None and text.startswith(AIR_LINE):
            self._intake.air = text
        if not text or text.startswith(b"#"):
            return None
        fields = text.split(b",")
        if self._places is None:
            self._places = self._read_header(fields)
            return None
        try:
            if len(fields) != self._fields:
                raise ValueError(f"expected {self._fields} fields, found {len(fields)}")
            row = [_number(fields[place]) for place in self._places]
            if not isfinite(row[0]):
                raise ValueError(f"expected a time, found {row[0]}")
            return row
        except ValueError as problem:
            self._intake.refuse(f"line {self._line}: {problem}")
            return None

    def _read_header(self, fields: list[bytes]) -> list[int]:
        names = [one.decode("utf-8-sig", "replace").strip().strip('"') for one in fields]
        missing = [name for name in self._columns if names.count(name) != 1]
        if missing:
            kinds = (".specific_force.", ".quaternion.", ".current.")
            raw = any(kind in name for kind in kinds for name in names)
            first = "the line `# sensors {...}` before it, or " if raw else ""
            raise LogError(
                f"line {self._line}: expected {first}a header with the columns {_shown(missing)}, "
                f"found {_shown(names)}{': each once' * (missing[0] in names)}"
            )
        self._fields = len(names)
        return [names.index(name) for name in self._columns]


@dataclass
class _Run:
    """Packets of a session from `first` up to `expected`: they came but for those `missing`."""

    session: float
    first: int
    expected: int
    missing: OrderedDict[int, bool] = field(default_factory=OrderedDict)  # the newest, in order

    def distance(self, sequence: int) -> float:
        """Packets between a sequence and those that came; infinite out of reach."""
        late, ahead = self.first - sequence, sequence - self.expected
        if late > 0:
            return REACH + late if late <= REACH else inf
        return max(0, ahead) if ahead <= REACH else inf


class DatagramPackets:
    """Packets of datagrams, as they come in.

    Sessions may be interleaved: what came of each of the last 64 is remembered. A datagram
    whose sequence is out of reach of what came of its session is refused, unless it follows
    the one refused before.

    Args:
        columns: Number of numbers in a packet.
        intake: Counts of packets.
        key: Key that datagrams are signed with; None: any datagram is taken.
        describe: Function that takes a description of raw sensors; None: it is a bad row.
    """

    def __init__(
        self,
        columns: int,
        intake: Intake,
        key: bytes | None = None,
        describe: Describe | None = None,
    ) -> None:
        self._columns, self._intake, self._key = columns, intake, key
        self._describe = describe
        self._runs: list[_Run] = []  # the last used first
        self._awaited: tuple[float, int] | None = None

    def take(self, datagram: bytes) -> Array:
        """New packets of a datagram, (k, columns)."""
        if self._key is not None:
            datagram, tag = datagram[:-_TAG], datagram[-_TAG:]
            if not hmac.compare_digest(tag, hmac.digest(self._key, datagram, "sha256")):
                reason = "datagram: its tag is missing or not that of the key"
                self._intake.refuse(reason, authentic=False)
                return np.empty((0, self._columns))
        try:
            if self._describe is not None and datagram[8:16] == _DESCRIBES:
                text = datagram[16:].decode("utf-8", "replace")
                self._columns = len(self._describe(text))
            else:
                return self._in_order(*self._read(datagram))
        except ValueError as problem:
            self._intake.refuse(f"datagram: {problem}")
        return np.empty((0, self._columns))

    def _read(self, datagram: bytes) -> tuple[float, int, Array]:
        numbers, left = divmod(len(datagram), 8)
        if left or numbers <= _HEADER or (numbers - _HEADER) % self._columns:
            signed = numbers > _HEADER and (numbers - _HEADER - _TAG // 8) % self._columns == 0
            hint = " (with the tag of a key: --key-file)" if signed and not left else ""
            size = f"8 (2 + k {self._columns}) B"
            raise ValueError(f"expected {size}, found {len(datagram)} B{hint}")
        values = np.frombuffer(datagram, "<f8")
        session, sequence = values[:_HEADER].tolist()
        if not (isfinite(session) and 0 <= sequence < 2**53 and sequence == int(sequence)):
            raise ValueError(f"expected session and sequence, found {session}, {sequence}")
        rows = values[_HEADER:].reshape(-1, self._columns)
        if not np.isfinite(rows[:, 0]).all():
            raise ValueError("expected finite times, found another")
        return session, int(sequence), rows

    def _in_order(self, session: float, sequence: int, rows: Array) -> Array:
        run = self._run_of(session, sequence, len(rows))
        old = min(len(rows), max(0, run.expected - sequence))
        self._intake.repeated += old
        skipped = range(run.expected, sequence)
        run.missing.update(dict.fromkeys(skipped, True))
        found = sum(run.missing.pop(one, False) for one in range(sequence, sequence + old))
        while len(run.missing) > REACH:
            run.missing.popitem(last=False)
        self._intake.lost += len(skipped) - found
        self._intake.received += len(rows) - old
        run.expected = max(run.expected, sequence + len(rows))
        return rows[old:]

    def _run_of(self, session: float, sequence: int, count: int) -> _Run:
        """Run that packets belong to, or a new one."""
        known = [run for run in self._runs if run.session == session]
        run = min(known, key=lambda one: one.distance(sequence), default=None)
        if run is not None and run.distance(sequence) < inf:
            self._runs.remove(run)
        else:
            if run is not None and self._awaited != (session, sequence):
                self._awaited = session, sequence + count
                raise ValueError(f"expected sequence near {run.expected}, found {sequence}")
            self._intake.resynchronized += run is not None
            run = _Run(session, sequence, sequence)
        self._runs = [run, *self._runs[: _RUNS - 1]]
        return run


def new_session() -> float:
    """Session of a sender: 64 random bits that are a finite number."""
    while True:
        (session,) = struct.unpack("<d", secrets.token_bytes(8))
        if isfinite(session):
            return float(session)


def read_key(path: Path) -> bytes:
    """Key of senders and listeners: the text of a file, without white space around it.

    Args:
        path: File that its owner alone may read.

    Raises:
        ParameterError: If it cannot be read, is too short or too long, or others may read it.
    """
    try:
        with regular_file(path).open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            key = file.read(_LONGEST_KEY + 1).strip()
    except (OSError, Unreadable) as problem:
        raise ParameterError("--key-file", "a file that can be read", str(problem)) from None
    if os.name == "posix" and mode & 0o077:
        expected = f"a file that its owner alone may read (chmod 600 {path})"
        raise ParameterError("--key-file", expected, f"mode {mode & 0o777:o}")
    if not _SHORTEST_KEY <= len(key) <= _LONGEST_KEY:
        expected = f"{_SHORTEST_KEY} to {_LONGEST_KEY} B, such as those of openssl rand -hex 32"
        raise ParameterError("--key-file", expected, f"{len(key)} B")
    return key


def datagrams(
    packets: Array, session: float, rows: int = 1, first: int = 0, key: bytes | None = None
) -> Iterator[bytes]:
    """Packets as datagrams, for a sender.

    Args:
        packets: (N, columns) [units of the columns].
        session: Random number of the session, as `new_session` draws it.
        rows: Packets a datagram.
        first: Number of packets sent before.
        key: Key that datagrams are signed with; None: they are not signed.
    """
    for start in range(0, len(packets), rows):
        part = packets[start : start + rows]
        header = np.array([session, first + start])
        yield _signed(np.concatenate([header, part.ravel()]).astype("<f8").tobytes(), key)


def most_rows(columns: int) -> int:
    """Largest number of packets that a datagram holds with the tag of a key."""
    return ((LARGEST_DATAGRAM - _TAG) // 8 - _HEADER) // columns


def _shown(names: Sequence[str]) -> str:
    """First few names, each shortened, without what a terminal would obey."""
    plain = ["".join(k if k.isprintable() else "?" for k in name[:40]) for name in names[:6]]
    return ", ".join(plain) + (" ..." if len(names) > 6 else "")


def _number(field: bytes) -> float:
    text = field.strip()
    if not text:
        return nan
    try:
        return float(text.replace(b"_", b"?"))  # Python would read 1_000
    except ValueError:
        shown = text[:40].decode("utf-8", "replace")
        raise ValueError(f"expected a number, found {shown!r}") from None


def flight_packets(flight: xr.Dataset, carried: Sequence[str] = ()) -> Array:
    """Packets of a flight, (N, 1 + n_q + (3 + k) n): time, q, v, a, u1, and k forces.

    Args:
        flight: Record with q, v, a, u1.
        carried: Known forces that packets carry after u1, among `OPTIONAL_PARTS`.
    """
    if "robot" in flight.attrs:
        robot_of(flight)  # refuses coordinates in another order
    parts = [flight[part].transpose("time", ...).to_numpy() for part in (*PARTS, *carried)]
    return np.column_stack([flight["time"].to_numpy(), *parts])


def send_packets(
    recorded: xr.Dataset | SensorLog,
    target: tuple[str, int],
    *,
    rate: float | None = None,
    rows: int = 1,
    key: bytes | None = None,
    progress: Progress | None = None,
) -> int:
    """Send a flight or the raw samples of a sensor log as datagrams.

    Args:
        recorded: Record with q, v, a, u1, or a log of sensors, whose description goes ahead.
        target: Address and port.
        rate: Packets a second; None: as fast as the record's time goes, a step of which takes a
            second at most.
        rows: Packets a datagram.
        key: Key that datagrams are signed with; None: they are not signed.
        progress: Called now and then with packets sent and packets in all.

    Returns:
        How many packets were sent.

    Raises:
        ParameterError: If a datagram cannot hold so many packets.
    """
    if isinstance(recorded, SensorLog):
        packets, text = sensor_rows(recorded), sensors_text(recorded)
    else:
        packets, text = flight_packets(recorded), ""
        if "mount_force" in recorded:
            held = recorded["mount_force"].transpose("time", ...).to_numpy()
            packets[:, -held.shape[1] :] += held
    if rows > most_rows(packets.shape[1]):
        raise ParameterError("rows", f"at most {most_rows(packets.shape[1])}", rows)
    steps = np.diff(packets[:, 0], prepend=packets[0, 0]) if rate is None else 1 / rate
    due = np.cumsum(np.clip(np.broadcast_to(steps, len(packets)), 0.0, _PAUSE))
    family = socket.AF_INET6 if ":" in target[0] else socket.AF_INET
    session = new_session()
    described = -inf
    said = _signed(struct.pack("<d", session) + _DESCRIBES + text.encode(), key)
    began, told = time.monotonic(), max(1, len(packets) // (200 * rows))
    with socket.socket(family, socket.SOCK_DGRAM) as port:
        for number, datagram in enumerate(datagrams(packets, session, rows, key=key)):
            ahead = due[number * rows] - (time.monotonic() - began)
            if ahead > 0:
                time.sleep(ahead)
            if text and time.monotonic() > described + _DESCRIBED:
                port.sendto(said, target)
                described = time.monotonic()
            port.sendto(datagram, target)
            if progress is not None and number % told == 0:
                progress(number * rows, len(packets))
    return len(packets)


def _signed(datagram: bytes, key: bytes | None) -> bytes:
    return datagram if key is None else datagram + hmac.digest(key, datagram, "sha256")
