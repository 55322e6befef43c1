"""`patagium send`: a recorded flight as datagrams, in the flight's own time, for a try-out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = (
    "patagium send flight.nc udp://127.0.0.1:9000",
    "patagium send flight.nc udp://127.0.0.1:9000 --rate 2000 --rows 3",
)


def send(
    file: Annotated[Path, typer.Argument(help="Flight (.nc).")],
    target: Annotated[str, typer.Argument(help="udp://ADDRESS:PORT.")],
    rate: Annotated[
        float | None, typer.Option(min=1e-3, help="Packets a second; the flight's own by default.")
    ] = None,
    rows: Annotated[int, typer.Option(min=1, help="Packets a datagram.")] = 1,
    key_file: Annotated[Path | None, typer.Option(help="File of a key that signs them.")] = None,
) -> None:
    """Send the packets of a recorded flight, as its sensors would have, to `patagium stream`."""
    from patagium.cli.words import existing, progress_bar
    from patagium.live.packets import read_key, send_packets
    from patagium.live.sources import address_of
    from patagium.simulation import load_flight

    key = None if key_file is None else read_key(key_file)
    flight, address = load_flight(existing(file)), address_of(target)
    with progress_bar(f"Sending {file.name}") as progress:
        sent = send_packets(flight, address, rate=rate, rows=rows, key=key, progress=progress)
    typer.echo(f"{sent} packets sent to {target}", err=True)
