"""Sender of a recorded flight: packets that its sensors would have sent.

Neglected: noise, delays and clocks of sensors; a flight holds true values.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.errors import ParameterError
from patagium.live.packets import datagrams, most_rows
from patagium.sensing.force.air_force import PARTS

Array = NDArray[np.float64]


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
