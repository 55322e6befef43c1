"""`patagium cycles`: a flight as a load-cell lab reports it, averaged over wingbeats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from patagium.cli.options import FlightArgument, JsonOption, option_in, output_file
from patagium.cli.outputs import Outputs
from patagium.cli.words import FLIGHT, flight_file, say_next
from patagium.errors import command

EXAMPLES = (
    "patagium cycles flight.nc --figure wingbeat.svg",
    'patagium cycles flight.nc --period "0.2 s" --skip 3 --json',
)


def cycles(
    flight: FlightArgument = FLIGHT,
    period: Annotated[
        float | None,
        option_in("s", "Period of a wingbeat, in s; that of the gait by default."),
    ] = None,
    skip: Annotated[
        int, typer.Option(min=0, help="Number of wingbeats left out at the beginning.")
    ] = 1,
    phases: Annotated[
        int, typer.Option(min=2, max=10_000, help="Number of points of a wingbeat.")
    ] = 100,
    figure: Annotated[
        Path | None, output_file("File for a drawing of a wingbeat with its spread (.png, .svg).")
    ] = None,
    table: Annotated[
        Path | None, output_file("File for the wingbeat, phase by phase (.csv).")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Lift, thrust and power over a wingbeat: means, spread, cost of transport."""
    from patagium.simulation import cycle_statistics, load_flight

    statistics = cycle_statistics(
        load_flight(flight_file(flight)), period=period, skip=skip, phases=phases
    )
    outputs, facts = Outputs(), {str(name): value for name, value in statistics.attrs.items()}
    outputs.draw(figure, lambda drawn: drawn.wingbeat(statistics))
    if table is not None:
        from patagium.whole_file import write_whole

        rows = statistics.drop_dims("cycle").to_dataframe().reset_index()
        outputs.attempt("table", lambda: write_whole(table, rows.to_csv(index=False).encode()))
    shown = facts if as_json else {_LABELS.get(name, name): facts[name] for name in facts}
    outputs.answer("means", shown, as_json, "Over a wingbeat")
    outputs.check()
    if not as_json:
        say_next(command("patagium figures {}", flight))


_LABELS = {
    "cycles": "wingbeats [1]",
    "cut_cycles": "wingbeats left out for a gap in time [1]",
    "period": "period [s]",
    "mean_lift": "mean lift [N]",
    "mean_lift_gram_force": "mean lift [gram-force]",
    "mean_thrust": "mean thrust [N]",
    "mean_thrust_gram_force": "mean thrust [gram-force]",
    "mean_power": "mean power of the joints [W]",
    "mean_positive_power": "mean power of the joints where positive [W]",
    "airspeed": "airspeed [m/s]",
    "cost_of_transport": "cost of transport, of positive power [1]",
}
