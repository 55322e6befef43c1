"""`patagium tune`: settings of a learner chosen by what it predicts of flights that it left out."""

from __future__ import annotations

from dataclasses import replace
from math import exp, log
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from patagium.cli.learner_options import LearnerChoice, NetworkKind, nested, with_learner_options
from patagium.cli.options import OUTPUT, MappingOption, output_file
from patagium.cli.outputs import Outputs
from patagium.cli.words import progress_bar, say_json, say_next, show_table, tell
from patagium.errors import LogError, command
from patagium.limits import LEAST_TRIALS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from patagium.learning import Tuned
    from patagium.sensing import LogTable

EXAMPLES = (
    "patagium tune flight.nc --every 100 --out settings.yaml",
    "patagium tune slow.nc fast.nc --hold-out other.nc --hidden 8,8 --out settings.yaml",
    "patagium tune flight.nc --hidden 8,8 --hidden 12 --covariance node --trials 128 --jobs 4",
    "patagium tune flight.nc --outlier-std 5 --prior-share 0 --learner extended",
    "patagium tune log.csv --mapping columns.yaml --every 1",
    "patagium identify flight.nc --settings settings.yaml",
)
PANELS = {"Trials": "horizon jobs mapping"}


@with_learner_options(several=True)
def tune(
    files: Annotated[
        list[Path], typer.Argument(help="Flights (.nc) or tables (.csv, .parquet) to learn.")
    ],
    choice: LearnerChoice,
    hold_out: Annotated[
        list[Path] | None,
        typer.Option(
            help="Flight or table that no trial learns and all are judged on; may be repeated."
        ),
    ] = None,
    mapping: MappingOption = None,
    every: Annotated[int, typer.Option(min=1, help="Use one sample in so many.")] = 100,
    horizon: Annotated[
        str | None,
        typer.Option(
            help="Time for which the weights stay when they are judged, such as 100ms, where all "
            "kinematics are alike and none are left out; half of the flight by default."
        ),
    ] = None,
    trials: Annotated[int, typer.Option(min=LEAST_TRIALS, help="Number of settings to try.")] = 64,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Number of processes; one for each core by default.")
    ] = None,
    out: Annotated[Path, output_file("File for the settings (.yaml).", *OUTPUT)] = (
        Path("settings.yaml")
    ),
    as_json: Annotated[bool, typer.Option("--json", help="The settings as JSON on stdout.")] = (
        False
    ),
) -> None:
    """Choose the settings of a learner by what it predicts of kinematics that it never learned.

    Each trial teaches a new learner the flights with other settings, and then predicts what was
    left out: the flights of --hold-out, else wingbeats of other kinematics, else the second
    half. Without --network and --hidden the default network of a robot is tried, and strips. A
    trial that diverges there, or errs more than predicting zero or than the weights before any
    sample, is refused. A setting that is given is not searched, and one that is repeated is
    searched among the values given. Trials are kept next to the result as they end: the same
    command goes on where it was stopped.
    """
    from patagium.cli.identify import flight_network, table_network
    from patagium.cli.logs import flight_or_table
    from patagium.learning import tune as tune_learner
    from patagium.learning.settings import Alternatives

    held = hold_out or []
    opened = [flight_or_table(file, mapping) for file in (*files, *held)]
    logs: list[Any] = [flight if table is None else table for flight, table in opened]
    _check_alike((*files, *held), logs)
    names = [file.name for file in files]
    make: Any = flight_network if opened[0][1] is None else table_network
    networks = [make(logs[0], one) for one in _tried(choice, opened[0][1])]
    settings = nested(choice.settings or {})
    for name, given in settings.items():
        if isinstance(given, list):
            settings[name] = Alternatives(tuple(given)) if len(given) > 1 else given[0]
    journal = out.with_suffix(".trials.jsonl")
    if journal.exists():
        tell(f"Going on from the trials in {journal}")
    with progress_bar(f"Tuning on {', '.join(names)}") as progress:
        found = tune_learner(
            logs[: len(files)],
            networks,
            every=every,
            trials=trials,
            learner=choice.kind,
            settings=settings,
            seed=choice.seed,
            jobs=jobs,
            journal=journal,
            source=", ".join(names),
            hold_out=dict(zip((file.name for file in held), logs[len(files) :], strict=True)),
            horizon=horizon,
            progress=progress,
        )
    outputs = Outputs()
    if outputs.attempt("settings", found.save, out):
        tell(f"The settings are in {out}")
    best = found.best.model_dump(mode="json")
    told: Any = (say_json, best) if as_json else (_show, found)
    outputs.attempt("trials", *told)
    outputs.check()
    if not as_json:
        meant = "" if mapping is None else command(" --mapping {}", mapping)
        say_next(command("patagium identify {} --settings {}", files[0], out) + meant)


def _tried(choice: LearnerChoice, table: LogTable | None) -> list[LearnerChoice]:
    """Choice of each network that is tried; table: None where a flight is."""
    if choice.hidden:
        return [replace(choice, hidden=tuple(one)) for one in dict.fromkeys(choice.hidden)]
    if choice.network is not None or table is not None:
        return [choice]
    return [choice, replace(choice, network=NetworkKind.STRIP)]


def _check_alike(files: Sequence[Path], logs: Sequence[Any]) -> None:
    """Refuse files that one network cannot learn.

    Raises:
        LogError: If some are flights and some are tables, or robot, wind or density differ.
    """
    from patagium.sensing import LogTable
    from patagium.simulation import air_of, robot_of

    def kind(one: Any) -> tuple[Any, ...]:
        if isinstance(one, LogTable):
            return ("table", one.input_names, one.output_names)
        return ("flight", robot_of(one), air_of(one).wind, air_of(one).density)

    first = kind(logs[0])
    for file, one in zip(files, logs, strict=True):
        pairs = zip(("kind", "robot", "wind", "density"), kind(one), first, strict=False)
        for name in (name for name, found, expected in pairs if found != expected):
            expected = f"the {name} of {files[0].name}, which the network is made for"
            raise LogError(file, expected, "another")


def _show(found: Tuned) -> None:
    """The best trials as a table, and the best of them in a sentence."""
    from patagium.learning.tuning.tune import SHOWN
    from patagium.report import Table

    rows: list[list[Any]] = []
    for trial in found.trials[:SHOWN]:
        one, values = trial.prediction, trial.values
        scores = [one.crps, one.left_out_nmse, one.left_out_coverage]
        scores += [one.nmse_second_half, one.coverage_second_half]
        rows.append([*scores, *map(_cell, [*values.values(), list(trial.hidden)])])
    names = [name.replace("_", " ") for name in found.trials[0].values]
    scored = ["CRPS [std]", "left out: NMSE [1]", "coverage [1]", "known: NMSE [1]", "coverage [1]"]
    show_table(Table([*scored, *names, "hidden"], rows))
    best, search = found.trials[0].prediction, found.best.search
    typer.echo(
        f"Left out, by weights that stay: CRPS {best.left_out_crps:.3g} standard deviations of the "
        f"output, NMSE {best.left_out_nmse:.3g}, {best.left_out_coverage:.1%} inside the 95 % "
        f"interval. Known, each sample before it was learned, second half: NMSE "
        f"{best.nmse_second_half:.3g}, {best.coverage_second_half:.1%}. A standard deviation of "
        "each output is shown by its geometric mean."
    )
    typer.echo(
        f"Rule: {found.rule}. {search['refused']} of {search['trials']} trials were refused."
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
