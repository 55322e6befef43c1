"""Sources of packets while a robot flies: a text that grows, a pipe, datagrams, a log.

A thread reads and puts packets into a queue of bounded size; who learns takes them out. A text
waits where the queue is full, for it can; datagrams do not, and what found no room is counted.
A file that is cut while it is read is read anew, where it is seen before it has outgrown what was
read; one that is replaced under its name is not noticed.
"""

from __future__ import annotations

import os
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import nullcontext, suppress
from ipaddress import ip_address
from pathlib import Path
from typing import Protocol

import numpy as np

from patagium.arrays import Array
from patagium.errors import LogError, ParameterError
from patagium.live.packets import LARGEST_DATAGRAM, DatagramPackets, Intake, TextPackets, read_key
from patagium.live.raw_sensors import MotionPackets, packet_doubts, sensor_rows, sensors_text
from patagium.netcdf_file import kind_of
from patagium.reading import regular_file
from patagium.robot import Robot
from patagium.sensing.logs.record import LogRecord, is_log
from patagium.sensing.logs.sensor_log import sensor_log
from patagium.sensing.sensors import load_sensor_log
from patagium.sensing.sensors.sense import is_sensor_log

_PIECE = 1 << 20
_ROWS = 1 << 14
_FIRST, _APART = 1000, 50  # packets that are compared with limits and stamps, and how often
_LOOK = 0.05  # s between looks at what else goes on
_BUFFER = 1 << 22  # B asked of the system for datagrams that wait
LOOPBACK = "127.0.0.1"
"""Default address that datagrams are listened for at: this machine alone."""


class PacketQueue:
    """Packets that were read and not learned yet, oldest first.

    Raw rows of sensors, once these are described, come out as packets.

    Args:
        capacity: Packets it holds at most.
        columns: Numbers a packet.
        intake: Counts of packets, those without room among them.
        robot: The machine that sends; None: raw rows are not taken.

    Attributes:
        motion: Maker of packets from raw rows; None while no sensors are described.
        spent: Time that each packet taken last took to be made of raw rows [s].
    """

    motion: MotionPackets | None = None
    spent = 0.0
    _held = _look = 0
    _closed = _abandoned = False
    _problem: Exception | None = None

    def __init__(
        self, capacity: int, columns: int, intake: Intake, robot: Robot | None = None
    ) -> None:
        self.intake, self._robot = intake, robot
        self._capacity, self._columns = capacity, columns
        self._blocks: deque[Array] = deque()
        self._doubts: list[str] = []
        self._first = np.empty((0, columns))
        self._changed = threading.Condition()

    def describe(self, text: str) -> tuple[str, ...]:
        """Names of the numbers of a raw row, once the sensors that send it are described.

        Args:
            text: Description of the sensors; only the first one counts.

        Raises:
            LogError: If it cannot be read, or comes after packets that are no raw rows.
        """
        if self.motion is None:
            if self._robot is None or self.intake.received:
                raise LogError("sensors", "raw rows from the first", "other packets")
            self.motion = MotionPackets(self._robot, text)
            self.intake.raw = self.motion.counts
        if text != self.motion.text:
            raise LogError("sensors", "those described at first", "others")
        return self.motion.columns

    @property
    def notes(self) -> list[str]:
        """Findings about the first packets or raw rows, in words."""
        return self._doubts if self.motion is None else self.motion.notes

    def put(self, packets: Array, *, waits: bool) -> None:
        """Add packets.

        Args:
            packets: (k, columns) [units of the columns].
            waits: Whether to wait for room; otherwise the newest without room are dropped,
                and counted.
        """
        with self._changed:
            while len(packets) and not self._closed:
                room = self._capacity - self._held
                if room:
                    self._blocks.append(packets[:room])
                    self._held += len(self._blocks[-1])
                    self._changed.notify_all()
                packets = packets[room:]
                if len(packets) and not waits:
                    self.intake.dropped += len(packets)
                    return
                if len(packets):
                    self._changed.wait(_LOOK)

    def take(self, most: int, patience: float) -> Array | None:
        """Oldest packets, (k, columns), none if none came in time; None where no more will come.

        Args:
            most: Largest number of packets.
            patience: Longest wait for the first one [s].

        Raises:
            LogError: If reading them failed, or raw rows do not tell the motion.
        """
        rows = self._oldest(most, patience)
        if self.motion is None:
            if not (rows is None or self._robot is None or self._look > _FIRST):
                self._first = np.concatenate([self._first, rows])[:_FIRST]
                if len(self._first) >= self._look:  # compared every `_APART` packets
                    found = packet_doubts(self._robot, self._first)
                    self._doubts += [f"Warning: {one}" for one in found]
                    self._look = _FIRST + 1 if found else len(self._first) + _APART
            return rows
        packets = self.motion.take(rows, most)
        self.spent = self.motion.spent
        return packets

    def _oldest(self, most: int, patience: float) -> Array | None:
        """Oldest packets or raw rows, as `take`."""
        with self._changed:
            if self._abandoned:
                self.intake.dropped += self._held
                self._blocks.clear()
                self._held, self._closed = 0, True
            if not self._blocks and not self._closed:
                self._changed.wait(patience)
            if not self._blocks:
                if self._problem is not None:
                    raise self._problem
                return None if self._closed else np.empty((0, self._columns))
            taken: list[Array] = []
            while self._blocks and most:
                block = self._blocks.popleft()
                taken.append(block[:most])
                if len(block) > most:
                    self._blocks.appendleft(block[most:])
                most -= len(taken[-1])
            packets = np.concatenate(taken)
            self._held -= len(packets)
            self._changed.notify_all()
            return packets

    def abandon(self) -> None:
        """Close the queue; packets that wait are dropped and counted at the next `take`."""
        self._abandoned = True  # no lock: signal handlers may call this

    def close(self, problem: Exception | None = None) -> None:
        """Close the queue: no more packets will come.

        Args:
            problem: Why reading ended; None where it came to its end.
        """
        with self._changed:
            self._closed, self._problem = True, problem
            self._changed.notify_all()


class Source(Protocol):
    """Source of packets."""

    def read(self, queue: PacketQueue, stop: threading.Event) -> None:
        """Put packets into the queue until there are no more, or `stop` is set."""
        ...


class TextSource:
    """A CSV text: a file that may grow, or a pipe.

    Args:
        columns: Names of the numbers of a packet.
        path: The file; None for a pipe.
        pipe: File descriptor of a pipe, such as 0 for standard input.
        idle: Longest wait for more at the end of a file, or of a pipe after a first piece [s];
            None: until it is stopped.
    """

    def __init__(
        self,
        columns: Sequence[str],
        path: Path | None = None,
        *,
        pipe: int = 0,
        idle: float | None = None,
    ) -> None:
        self._columns, self._path, self._pipe, self._idle = columns, path, pipe, idle

    def read(self, queue: PacketQueue, stop: threading.Event) -> None:
        """Read lines as they come; a pipe ends where its writer closes it.

        Raises:
            LogError: If the text has no header that names the columns.
        """
        packets = TextPackets(self._columns, queue.intake, queue.describe)
        with nullcontext() if self._path is None else self._path.open("rb") as file:
            descriptor = self._pipe if file is None else file.fileno()
            fed = None if file is None else time.monotonic()
            while not stop.is_set():
                if file and os.fstat(descriptor).st_size < os.lseek(descriptor, 0, os.SEEK_CUR):
                    queue.notes.append(f"Warning: {self._path} was cut, and is read anew")
                    packets.end()
                    packets = TextPackets(self._columns, queue.intake, queue.describe)
                    os.lseek(descriptor, 0, os.SEEK_SET)
                told = bool(file or select.select([descriptor], [], [], _LOOK)[0])
                piece = os.read(descriptor, _PIECE) if told else b""
                if piece:
                    queue.put(packets.take(piece), waits=True)
                    fed = time.monotonic()
                elif file is None and told:
                    break
                elif self._idle is not None and fed and time.monotonic() - fed > self._idle:
                    break
                elif file is not None:
                    stop.wait(_LOOK / 2)
        packets.end()


class DatagramSource:
    """Datagrams that arrive at a UDP port.

    Args:
        columns: Number of numbers in a packet.
        host: Address to listen at.
        port: Port to listen at; 0: any that is free.
        idle: Longest silence after the first packet [s]; None: until it is stopped.
        key: Key that datagrams are signed with; None: any datagram is taken.

    Raises:
        LogError: If the address cannot be listened at.
    """

    def __init__(
        self,
        columns: int,
        host: str,
        port: int,
        *,
        idle: float | None = None,
        key: bytes | None = None,
    ) -> None:
        self._columns, self._idle, self._key = columns, idle, key
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        try:
            self._socket.bind((host, port))
        except OSError as problem:
            self._socket.close()
            raise LogError(f"udp://{host}:{port}: cannot listen: {problem.strerror}") from None
        self._socket.setblocking(False)
        self._host = str(self._socket.getsockname()[0])

    @property
    def port(self) -> int:
        """Port that the source listens at."""
        return int(self._socket.getsockname()[1])

    @property
    def address(self) -> str:
        """Address to send to, udp://ADDRESS:PORT."""
        host = f"[{self._host}]" if ":" in self._host else self._host
        return f"udp://{host}:{self.port}"

    @property
    def warning(self) -> str | None:
        """Warning that other machines can send packets; None where they cannot."""
        if is_loopback(self._host):
            return None
        words = f"packets are listened for at {self._host}, beyond this machine"
        if self._key is None:
            return f"{words}, without a key: whoever reaches it can send them (--key-file)"
        return f"{words}: only those with the tag of the key are used, and none is encrypted"

    def read(self, queue: PacketQueue, stop: threading.Event) -> None:
        """Read datagrams as they come."""
        packets = DatagramPackets(self._columns, queue.intake, self._key, queue.describe)
        fed = None
        with self._socket:
            while not stop.is_set():
                if select.select([self._socket], [], [], _LOOK)[0]:
                    queue.put(self._waiting(packets), waits=False)
                    fed = time.monotonic()
                elif self._idle is not None and fed and time.monotonic() - fed > self._idle:
                    break

    def _waiting(self, packets: DatagramPackets) -> Array:
        found: list[Array] = []
        with suppress(BlockingIOError):
            while len(found) < 64:
                found.append(packets.take(self._socket.recv(LARGEST_DATAGRAM)))
        whole = [part for part in found if len(part)]
        return np.concatenate(whole) if whole else np.empty((0, self._columns))


class LogSource:
    """A recorded log, of which packets or raw rows are read as fast as they are learned.

    Args:
        blocks: Some of them at a time, (k, columns) [units of the columns], read as they are taken.
        sensors: Description of the sensors of raw rows; empty of packets.
    """

    def __init__(self, blocks: Iterable[Array], sensors: str = "") -> None:
        self._blocks, self._sensors = blocks, sensors

    def read(self, queue: PacketQueue, stop: threading.Event) -> None:
        """Read the log's samples."""
        if self._sensors:
            queue.describe(self._sensors)
        for rows in self._blocks:
            if stop.is_set():
                return
            queue.intake.received += len(rows)
            queue.put(rows, waits=True)


def _record_blocks(columns: Sequence[str], path: Path) -> Iterator[Array]:
    """Packets of a log that `patagium import` wrote, some at a time."""
    with LogRecord(path) as record:
        for begin in range(0, record.count, _ROWS):
            end = begin + _ROWS
            values = record.values(tuple(columns[1:]), begin, end)
            yield np.column_stack([record.time(begin, end), values])


def source_of(
    words: str,
    columns: Sequence[str],
    *,
    idle: float | None = None,
    key_file: Path | None = None,
    robot: Robot | None = None,
) -> TextSource | DatagramSource | LogSource:
    """Source of packets that words name.

    Args:
        words: `-` for standard input, `udp://ADDRESS:PORT`, or the path of a CSV file, of a
            sensor log, or of a log that `patagium import` wrote.
        columns: Names of the numbers of a packet.
        idle: Longest wait for more packets [s]; None: until it is stopped.
        key_file: File of the key that datagrams are signed with; None: any datagram is taken.
        robot: The machine whose sensors a log is of; None for the one that the log names.

    Raises:
        ParameterError: If an address has no port, the key cannot be used, or texts have one.
        LogError: If there is no such file, it lacks a number, or the address cannot be listened at.
    """
    if words.startswith("udp://"):
        key = None if key_file is None else read_key(key_file)
        return DatagramSource(len(columns), *address_of(words), idle=idle, key=key)
    if key_file is not None:
        raise ParameterError("--key-file", "datagrams, udp://ADDRESS:PORT, to go with it", words)
    if words == "-":
        return TextSource(columns, idle=idle)
    path = Path(words)
    if path.is_fifo():
        raise LogError(path, "a file", "a pipe; give - and pipe it to the program")
    regular_file(path)
    imported = is_log(path)
    if imported:
        with LogRecord(path) as record:
            if {*columns[1:]} <= {*record.labels}:
                return LogSource(_record_blocks(columns, path))
    if imported or is_sensor_log(path):
        log = sensor_log(path, robot) if imported else load_sensor_log(path)
        rows = sensor_rows(log)
        blocks = [rows[begin : begin + _ROWS] for begin in range(0, len(rows), _ROWS)]
        return LogSource(blocks, sensors_text(log))
    refuse_other_kinds(path)
    return TextSource(columns, path, idle=idle)


def refuse_other_kinds(path: Path) -> None:
    """Refuse a file of this program that holds no packets, such as a flight.

    Raises:
        LogError: If it is one.
    """
    if other := kind_of(path):
        if other.startswith(("a flight", "a record")):
            other += f"; it is sent: patagium send {path} udp://127.0.0.1:9000, to patagium stream "
            other += "udp://127.0.0.1:9000 --robot ROBOT"
        raise LogError(path, "text of packets, an imported log or a sensor log", other)


def address_of(words: str) -> tuple[str, int]:
    """Host and port of `udp://HOST:PORT`; without a host, this machine alone.

    Raises:
        ParameterError: If there is no port.
    """
    host, _, port = words.removeprefix("udp://").rpartition(":")
    if not port.isdecimal() or int(port) > 65535 or "://" in host:
        raise ParameterError("address", "udp://ADDRESS:PORT such as udp://127.0.0.1:9000", words)
    return host.strip("[]") or LOOPBACK, int(port)


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach an address.

    Args:
        host: Address in numbers; a name is none.
    """
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def start_reading(source: Source, queue: PacketQueue, stop: threading.Event) -> threading.Thread:
    """Thread that reads a source until it ends or stop is set, then closes the queue."""

    def read() -> None:
        try:
            source.read(queue, stop)
        except Exception as problem:
            queue.close(problem)
        else:
            queue.close()

    thread = threading.Thread(target=read, name="packets", daemon=True)
    thread.start()
    return thread
