"""`patagium tune`: settings of a learner chosen by what it predicts of a flight or a log."""

from __future__ import annotations

from math import exp, log
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from patagium.cli.learner_options import LearnerChoice, nested, with_learner_options

if TYPE_CHECKING:
    from patagium.learning import Tuned

EXAMPLES = (
    "patagium tune flight.nc --network strip --hidden 8,8 --every 100 --out settings.yaml",
    "patagium tune flight.nc --hidden 8,8 --hidden 12 --covariance node --trials 128 --jobs 4",
    "patagium tune flight.nc --outlier-std 5 --prior-share 0 --learner extended",
    "patagium tune log.csv --mapping columns.yaml --every 1 --cluster tcp://10.0.0.1:8786",
    "patagium identify flight.nc --settings settings.yaml",
)


@with_learner_options(several=True)
def tune(
    file: Annotated[Path, typer.Argument(help="Flight (.nc) or table (.csv, .parquet).")],
    choice: LearnerChoice,
    mapping: Annotated[
        Path | None, typer.Option(help="Meaning of the columns of a table (YAML).")
    ] = None,
    every: Annotated[int, typer.Option(min=1, help="Use one sample in so many.")] = 100,
    trials: Annotated[int, typer.Option(help="Number of settings to try.")] = 64,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Number of processes; one for each core by default.")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler whose workers do the work.")
    ] = None,
    out: Annotated[Path, typer.Option(help="File for the settings (.yaml).")] = (
        Path("settings.yaml")
    ),
    as_json: Annotated[bool, typer.Option("--json", help="The settings as JSON on stdout.")] = (
        False
    ),
) -> None:
    """Choose the settings of a learner by what it predicts.

    Each trial teaches a new learner the flight with other settings; the best trial is the one
    whose predictions have the largest likelihood. A setting that is given is not searched, and
    one that is repeated is searched among the values given. Trials are kept beside the result
    as they end: the same command goes on where it was stopped.
    """
    from patagium.cli.identify import flight_network, table_network
    from patagium.cli.logs import flight_or_table
    from patagium.cli.words import WholeNumbers, progress_bar, say_json
    from patagium.learning import tune as tune_learner
    from patagium.learning.settings import Alternatives

    layers = list(dict.fromkeys(choice.hidden or [WholeNumbers((8, 8))]))
    flight, table = flight_or_table(file, mapping)
    learned: Any = flight if table is None else table
    make: Any = flight_network if table is None else table_network
    networks = [make(learned, choice.network, tuple(one), choice.activation) for one in layers]
    settings: dict[str, Any] = {}
    for name, given in nested(choice.settings or {}).items():
        several = isinstance(given, list) and len(given) > 1
        settings[name] = Alternatives(tuple(given)) if several else given
        if isinstance(given, list) and len(given) == 1:
            settings[name] = given[0]
    journal = out.with_suffix(".trials.jsonl")
    if journal.exists():
        typer.echo(f"Going on from the trials in {journal}", err=True)
    with progress_bar(f"Tuning on {file.name}") as progress:
        found = tune_learner(
            learned,
            networks,
            every=every,
            trials=trials,
            learner=choice.kind,
            settings=settings,
            seed=choice.seed,
            jobs=jobs,
            cluster=cluster,
            journal=journal,
            source=file.name,
            progress=progress,
        )
    found.save(out)
    typer.echo(f"The settings are in {out}", err=True)
    if as_json:
        say_json(found.best.model_dump(mode="json"))
    else:
        _show(found)


def _show(found: Tuned) -> None:
    """The best trials as a table, and the best of them in a sentence."""
    from patagium.cli.words import show_table
    from patagium.learning.tuning.tune import SHOWN
    from patagium.report import Table

    rows: list[list[Any]] = []
    for trial in found.trials[:SHOWN]:
        one, values = trial.prediction, trial.values
        scores = [one.score, one.nmse_second_half, one.coverage_second_half]
        rows.append([*scores, *map(_cell, [*values.values(), list(trial.hidden)])])
    names = [name.replace("_", " ") for name in found.trials[0].values]
    show_table(Table(["log likelihood", "NMSE", "coverage", *names, "hidden"], rows))
    best = found.trials[0].prediction
    typer.echo(
        f"Second half, samples used: log likelihood {best.score:.6g}, NMSE "
        f"{best.nmse_second_half:.3g}, {best.coverage_second_half:.1%} inside the 95 % interval. "
        "A standard deviation of each output is shown by its geometric mean."
    )


def _cell(value: Any) -> Any:
    """A value for a person: a standard deviation of each output as one number."""
    if isinstance(value, list) and all(isinstance(one, float) for one in value) and value:
        return exp(sum(map(log, value)) / len(value))
    if isinstance(value, list):
        return ",".join(map(str, value))
    if isinstance(value, dict):
        return ", ".join(f"{name}={one}" for name, one in value.items())
    return value
