"""`patagium study latency`: time of a sample from packet to prediction, median and tail."""

from __future__ import annotations

from typing import Annotated

import typer

from patagium_lab.verbs.options import JsonFileOption

EXAMPLES = (
    "patagium study latency",
    "patagium study latency --samples 100000 --json latency.json",
    'patagium study latency --load alone --load "all cores busy"',
)


def latency(
    samples: Annotated[
        int, typer.Option(min=100, help="Number of calls of each case.")
    ] = 1_000_000,
    load: Annotated[
        list[str] | None,
        typer.Option(help="Load: alone, other cores busy, or all cores busy; may be repeated."),
    ] = None,
    json_file: JsonFileOption = None,
) -> None:
    """Time the whole pipeline, packet by packet, as fast as it can and at 10 kHz.

    The dense network of the paper's size and the strip network, on one core, alone and beside
    processes that burn the others. A million samples at 10 kHz take 100 s a case.
    """
    from patagium.cli.words import json_text, show_table
    from patagium.report import Table
    from patagium.whole_file import write_whole
    from patagium_lab.bench.latency import LOADS, QUANTILES, measure_latency
    from patagium_lab.stage_bar import stage_bar

    with stage_bar("Timing") as progress:
        found = measure_latency(samples, load or LOADS[:2], progress=progress)
    heads = [
        "learner",
        "load",
        "pace",
        *(f"{name} [us]" for name in QUANTILES),
        "response p99 [us]",
    ]
    rows = [
        [one.learner, one.load, "10 kHz" if one.paced else "none"]
        + [1e6 * value for value in (*one.duration.values(), one.response["p99"])]
        for one in found
    ]
    show_table(Table(heads, rows))
    if json_file is not None:
        write_whole(json_file, json_text([one.as_dict() for one in found]) + "\n")
        typer.echo(f"Written to {json_file}", err=True)
