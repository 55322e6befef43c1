"""`patagium send`: a flight, a record of a stream or a log as datagrams, in its own time."""

from __future__ import annotations

from pathlib import Path
from socket import gaierror
from typing import TYPE_CHECKING, Annotated

import typer

from patagium.cli.words import existing, progress_bar, tell
from patagium.errors import ParameterError

if TYPE_CHECKING:
    import xarray as xr

EXAMPLES = (
    "patagium send flight.nc udp://127.0.0.1:9000",
    "patagium send flight.nc udp://127.0.0.1:9000 --rate 2000 --rows 3",
)


def send(
    file: Annotated[Path, typer.Argument(help="Flight, record of a stream or log (.nc).")],
    target: Annotated[str, typer.Argument(help="udp://ADDRESS:PORT.")],
    rate: Annotated[
        float | None, typer.Option(min=1e-3, help="Packets a second; the record's own by default.")
    ] = None,
    rows: Annotated[int, typer.Option(min=1, help="Packets a datagram.")] = 1,
    key_file: Annotated[Path | None, typer.Option(help="File of a key that signs them.")] = None,
) -> None:
    """Send a flight's motion and forces, or the raw samples of a log, to `patagium stream`."""
    from patagium.aerodynamics import Air
    from patagium.cli.logs import record_of
    from patagium.live.packets import read_key, send_packets
    from patagium.live.sources import address_of
    from patagium.netcdf_file import kind_of
    from patagium.sensing import SensorLog, load_log, load_sensor_log, sensor_log
    from patagium.sensing.logs.record import LOADED
    from patagium.sensing.sensors.sense import is_sensor_log
    from patagium.simulation import air_of, load_flight

    key = None if key_file is None else read_key(key_file)
    recorded: xr.Dataset | SensorLog
    record = record_of(existing(file), None)
    if record is not None:
        with record:
            recorded = record.flight() if record.is_flight else sensor_log(file)
    elif is_sensor_log(file):
        recorded = load_sensor_log(file)
    else:
        streamed = kind_of(file).startswith(LOADED[0])
        recorded = load_log(file) if streamed else load_flight(file)
    address = address_of(target)
    if not isinstance(recorded, SensorLog) and (air := air_of(recorded)) != Air():
        told = f"density {air.density:.4g} kg/m^3"
        given = f"--density {air.density:.6g}"
        if any(air.wind):
            told = f"wind {air.wind} m/s and no {told}"
            given += f' --wind "{",".join(f"{one:.6g}" for one in air.wind)}"'
        tell(f"Warning: packets hold no {told}: give them to the stream, {given}")
    with progress_bar(f"Sending {file.name}") as progress:
        try:
            sent = send_packets(recorded, address, rate=rate, rows=rows, key=key, progress=progress)
        except OSError as problem:
            expected = "an address of one machine that is in reach, and a port of 1 to 65535"
            expected = "a host that is known" if isinstance(problem, gaierror) else expected
            found = f"{target} ({problem.strerror or problem})"
            raise ParameterError("target", expected, found) from None
    kind = "rows of raw samples" if isinstance(recorded, SensorLog) else "packets"
    tell(f"{sent} {kind} sent to {target}")
