"""`patagium tune`: settings of a learner chosen by what it predicts of a flight or a log."""

from __future__ import annotations

from enum import StrEnum
from math import exp, log
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from patagium.cli.learner_options import NetworkKind, structure
from patagium.cli.words import WholeNumbers, whole_numbers

if TYPE_CHECKING:
    from patagium.learning import Tuned

EXAMPLES = (
    "patagium tune flight.nc --network strip --hidden 8,8 --every 100 --out settings.yaml",
    "patagium tune flight.nc --hidden 8,8 --hidden 12 --covariance node --trials 128 --jobs 4",
    "patagium tune log.csv --mapping columns.yaml --every 1 --cluster tcp://10.0.0.1:8786",
    "patagium identify flight.nc --settings settings.yaml",
)


class Activation(StrEnum):
    """Activations of the hidden layers."""

    SOFTPLUS = "softplus"
    TANH = "tanh"


class LearnerKind(StrEnum):
    """Learners that say how sure they are."""

    CUBATURE = "cubature"
    EXTENDED = "extended"


def tune(
    file: Annotated[Path, typer.Argument(help="A flight (.nc) or a table (.csv, .parquet).")],
    mapping: Annotated[
        Path | None, typer.Option(help="What the columns of a table mean (YAML).")
    ] = None,
    network: Annotated[
        NetworkKind | None, typer.Option(help="By default strip for flights, dense for tables.")
    ] = None,
    hidden: Annotated[
        list[WholeNumbers] | None,
        typer.Option(
            parser=whole_numbers,
            help="Neurons of each hidden layer; 8,8 by default. Repeat it to try several.",
        ),
    ] = None,
    activation: Annotated[Activation, typer.Option(help="Of the hidden layers.")] = (
        Activation.SOFTPLUS
    ),
    learner: Annotated[LearnerKind, typer.Option(help="How the weights are learned.")] = (
        LearnerKind.CUBATURE
    ),
    covariance: Annotated[
        list[Any] | None,
        typer.Option(
            parser=structure,
            metavar="full|layer|node|RANK",
            help="The first three by default, above 400 weights node. Repeat it to try several.",
        ),
    ] = None,
    every: Annotated[int, typer.Option(min=1, help="Use one sample in so many.")] = 100,
    trials: Annotated[int, typer.Option(help="Settings to try.")] = 64,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes; one a core by default.")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler whose workers do it instead.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the search and of the initial weights.")] = 0,
    out: Annotated[Path, typer.Option(help="Where the settings go (.yaml).")] = (
        Path("settings.yaml")
    ),
    as_json: Annotated[bool, typer.Option("--json", help="The settings as JSON on stdout.")] = (
        False
    ),
) -> None:
    """Choose the settings of a learner by what it predicts.

    Each trial learns the flight with other deviations, spread, forgetting and structure of
    the covariance; the best is the one that gave what it then saw the largest likelihood.
    Trials are kept beside the result as they end: the same command goes on where it stopped.
    """
    from patagium.cli.identify import flight_network, table_network
    from patagium.cli.logs import flight_or_table
    from patagium.cli.words import progress_bar, say_json
    from patagium.learning import tune as tune_learner

    layers = list(dict.fromkeys(tuple(one) for one in hidden or [WholeNumbers((8, 8))]))
    learned: Any
    flight, table = flight_or_table(file, mapping)
    if table is None:
        learned = flight
        networks = [flight_network(learned, network, one, activation.value) for one in layers]
    else:
        learned = table
        networks = [table_network(learned, network, one, activation.value) for one in layers]
    journal = out.with_suffix(".trials.jsonl")
    if journal.exists():
        typer.echo(f"Going on from the trials in {journal}", err=True)
    with progress_bar(f"Tuning on {file.name}") as progress:
        found = tune_learner(
            learned,
            networks,
            every=every,
            trials=trials,
            learner=learner.value,
            covariance=list(covariance) if covariance else None,
            seed=seed,
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
        gave, values = trial.foresight, trial.values
        scores = [gave.score, gave.nmse_second_half, gave.coverage_second_half]
        rows.append([*scores, *map(_cell, [*values.values(), list(trial.hidden)])])
    names = [name.replace("_", " ") for name in found.trials[0].values]
    show_table(Table(["log likelihood", "NMSE", "coverage", *names, "hidden"], rows))
    best = found.trials[0].foresight
    typer.echo(
        f"Second half, samples used: log likelihood {best.score:.6g}, NMSE "
        f"{best.nmse_second_half:.3g}, {best.coverage_second_half:.1%} inside the 95 % interval. "
        "A deviation of each output is shown by its geometric mean."
    )


def _cell(value: Any) -> Any:
    """A value for a person: a deviation of each output as one number."""
    if isinstance(value, list) and all(isinstance(one, float) for one in value) and value:
        return exp(sum(map(log, value)) / len(value))
    if isinstance(value, list):
        return ",".join(map(str, value))
    if isinstance(value, dict):
        return ", ".join(f"{name}={one}" for name, one in value.items())
    return value
