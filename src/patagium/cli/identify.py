"""`patagium identify`: a flight or a log streamed through a learner, and how well it foresaw."""

from __future__ import annotations

from contextlib import nullcontext
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from patagium.cli.words import Numbers, WholeNumbers, numbers, whole_numbers

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from patagium.identification import Identification, Table

EXAMPLES = (
    "patagium identify flight.nc --network strip --hidden 8,8 --prior-deviation 0.3 "
    "--measurement-deviation 3e-4 --spread 1.7 --model model.json --report report.html",
    "patagium identify log.csv --mapping columns.yaml --network dense --hidden 16,16 --every 1 "
    "--prior-deviation 0.5 --measurement-deviation 0.05 --state learner.state",
)


class NetworkKind(StrEnum):
    """Networks: one that knows the wing, one that knows nothing."""

    STRIP = "strip"
    DENSE = "dense"


class LearnerKind(StrEnum):
    """Ways of learning the weights."""

    CUBATURE = "cubature"
    EXTENDED = "extended"
    GRADIENT = "gradient"
    LINEAR = "linear"


class Activation(StrEnum):
    """What a neuron does to its sum."""

    SOFTPLUS = "softplus"
    TANH = "tanh"


def identify(
    file: Annotated[Path, typer.Argument(help="A flight (.nc) or a table (.csv, .parquet).")],
    mapping: Annotated[
        Path | None, typer.Option(help="What the columns of a table mean (YAML).")
    ] = None,
    network: Annotated[
        NetworkKind | None, typer.Option(help="strip for flights, dense for tables by default.")
    ] = None,
    hidden: Annotated[
        WholeNumbers | None,
        typer.Option(parser=whole_numbers, help="Neurons of each hidden layer; 8,8 by default."),
    ] = None,
    activation: Annotated[Activation, typer.Option(help="Of the hidden layers.")] = (
        Activation.SOFTPLUS
    ),
    learner: Annotated[LearnerKind, typer.Option(help="How the weights are learned.")] = (
        LearnerKind.CUBATURE
    ),
    every: Annotated[int, typer.Option(min=1, help="Use one sample in so many.")] = 100,
    prior_deviation: Annotated[
        float | None,
        typer.Option(help="Of each weight at the start, before dividing by sqrt(fan-in)."),
    ] = None,
    measurement_deviation: Annotated[
        Numbers | None,
        typer.Option(parser=numbers, help="Of the outputs, in their units: one, or one each."),
    ] = None,
    process_deviation: Annotated[
        float | None, typer.Option(help="By which each weight wanders between updates.")
    ] = None,
    spread: Annotated[
        float | None, typer.Option(help="Distance of the cubature points, in deviations.")
    ] = None,
    forgetting_factor: Annotated[
        float | None, typer.Option(help="Above 0, at most 1: forgets old samples.")
    ] = None,
    learning_rate: Annotated[
        float | None, typer.Option(help="Step of the gradient learner.")
    ] = None,
    replay: Annotated[
        int | None, typer.Option(help="Old samples the gradient learner sees again.")
    ] = None,
    features: Annotated[
        int | None, typer.Option(help="Random softplus features of the linear learner.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the initial weights.")] = 0,
    model: Annotated[
        Path | None, typer.Option(help="Write what was learned (.json): a model that predicts.")
    ] = None,
    state: Annotated[
        Path | None,
        typer.Option(
            help="Learn on from this file if it is there; keep the learner in it at the end and "
            "on Ctrl-C. Unlike a model, it learns on."
        ),
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Write an HTML page.")] = None,
    predictions: Annotated[
        Path | None, typer.Option(help="Write every prediction and score (.nc).")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="All scores as JSON on stdout.")] = False,
) -> None:
    """Learn what the air does, online, from a flight or a measured log.

    Each sample is predicted before it may be used; the score is the mean square error of
    these predictions over the variance of the output, beside that of holding the last
    used sample. There is no default for deviations and learning rate: they are yours.

    With --state the learner goes on where it stood, with the centers and scales it began
    with; everything else must be said alike. A learner that diverged is not kept.
    """
    from patagium.cli.state import Interrupted, interrupted_between_samples, keep_state, resumed
    from patagium.cli.words import existing, progress_bar
    from patagium.errors import Outcome, ParameterError
    from patagium.identification import identify as identify_flight
    from patagium.identification import read_table
    from patagium.identification.logs import identify_table
    from patagium.simulation import load_flight

    settings = {
        "prior_deviation": prior_deviation,
        "measurement_deviation": _one_or_each(measurement_deviation),
        "process_deviation": process_deviation,
        "spread": spread,
        "forgetting_factor": forgetting_factor,
        "learning_rate": learning_rate,
        "replay": replay,
        "features": features,
    }
    given: dict[str, Any] = {name: value for name, value in settings.items() if value is not None}
    kind, layers = _shape(network, hidden, learner)
    is_flight = file.suffix.lower() == ".nc"
    if is_flight and mapping is not None:
        raise ParameterError("--mapping", "a table (.csv, .parquet) to go with it", str(file))
    if not is_flight and mapping is None:
        raise ParameterError("--mapping", "a YAML file that says what the columns mean", None)
    if mapping is None:
        flight = load_flight(existing(file))
        net = _flight_network(flight, kind, layers, activation.value)
    else:
        table = read_table(existing(file), existing(mapping))
        net = _table_network(table, kind, layers, activation.value)
    student = resumed(_learner(learner, net, given, seed), state)
    try:
        with (
            progress_bar(f"Learning from {file.name}") as bar,
            interrupted_between_samples(bar) if state else nullcontext(bar) as progress,
        ):
            if mapping is None:
                result = identify_flight(flight, student, every=every, progress=progress)
            else:
                result = identify_table(table, student, every=every, progress=progress)
    except Interrupted:
        keep_state(student, state)
        raise typer.Exit(130) from None
    if mapping is not None:
        typer.echo(f"{file}: {table.describe_gaps()}", err=True)
    if result.outcome is Outcome.COMPLETED:
        keep_state(student, state)
    _keep(result, file, None if is_flight else table.input_names, model, report, predictions)
    show_scores(result.scores, as_json=as_json)
    if result.outcome is not Outcome.COMPLETED:
        typer.echo(f"patagium: {result.message}", err=True)
        raise typer.Exit(2)


def show_scores(scores: Mapping[str, Any], *, as_json: bool) -> None:
    """Scores on stdout: a table by output and a line, or all of them as JSON.

    Args:
        scores: Of an `Identification`.
        as_json: Whether a program reads them.
    """
    from patagium.cli.words import say_json, show_table
    from patagium.identification.page import summary
    from patagium.report import Table

    if as_json:
        say_json(dict(scores))
        return
    columns = {
        "NMSE": scores.get("nmse", {}),
        "second half": scores.get("nmse_second_half", {}),
        "held sample, second half": scores.get("persistence_second_half", {}),
        "in the 95 % interval": scores.get("coverage_by_output", {}),
    }
    names = [name for name in columns["NMSE"] if name not in scores["silent"]]
    rows = [[name, *(column.get(name) for column in columns.values())] for name in names]
    show_table(Table(["output", *columns], rows))
    typer.echo(summary(scores))


def _shape(
    network: NetworkKind | None, hidden: WholeNumbers | None, learner: LearnerKind
) -> tuple[NetworkKind | None, tuple[int, ...]]:
    """The network asked for; the linear learner takes inputs and outputs only."""
    from patagium.errors import ParameterError

    if learner is not LearnerKind.LINEAR:
        return network, hidden or (8, 8)
    if hidden is not None or network is NetworkKind.STRIP:
        option = "--network" if hidden is None else "--hidden"
        raise ParameterError(
            option, "nothing: the linear learner has --features", hidden or network
        )
    return NetworkKind.DENSE, ()


def _flight_network(
    flight: Any, kind: NetworkKind | None, hidden: tuple[int, ...], activation: str
) -> Any:
    from patagium.identification import DenseNetwork, StripNetwork, training_data
    from patagium.simulation import aero_of, robot_of

    robot = robot_of(flight)
    if kind is not NetworkKind.DENSE:
        return StripNetwork(robot, hidden, aero_of(flight).air, activation)
    time, x, y = training_data(flight, robot)
    first = time <= time[0] + _look(flight)
    (x_center, x_scale), (y_center, y_scale) = _spans(x[first]), _spans(y[first])
    return DenseNetwork(
        2 * robot.dof, hidden, robot.dof_names, activation, input_center=x_center,
        input_scale=x_scale, output_center=y_center, output_scale=y_scale,
    )  # fmt: skip


def _look(flight: Any) -> float:
    """One wingbeat, or the first 10 ms: the span that scales a dense network [s]."""
    from patagium.identification.identify import flight_horizons

    span = max(flight_horizons(flight).values())
    typer.echo(f"Inputs and outputs are scaled by the first {span:.4g} s.", err=True)
    return span


def _spans(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middle and half width of each column, one where it stands still."""
    low, high = values.min(axis=0), values.max(axis=0)
    half = (high - low) / 2
    half[half < 1e-9 * max(half.max(), 1e-300)] = 1.0
    return (low + high) / 2, half


def _table_network(
    table: Table, kind: NetworkKind | None, hidden: tuple[int, ...], activation: str
) -> Any:
    from patagium.errors import ParameterError
    from patagium.identification.logs import network_for

    if kind is NetworkKind.STRIP:
        raise ParameterError("--network", "dense for a table: a strip needs q and v", kind.value)
    return network_for(table, hidden, activation)


_NEEDED = {
    LearnerKind.CUBATURE: {"prior_deviation", "measurement_deviation"},
    LearnerKind.EXTENDED: {"prior_deviation", "measurement_deviation"},
    LearnerKind.GRADIENT: {"learning_rate"},
    LearnerKind.LINEAR: {"prior_deviation", "measurement_deviation"},
}
_TAKEN = {
    LearnerKind.CUBATURE: {"process_deviation", "spread", "forgetting_factor"},
    LearnerKind.EXTENDED: {"process_deviation", "forgetting_factor"},
    LearnerKind.GRADIENT: {"replay"},
    LearnerKind.LINEAR: {"features", "forgetting_factor"},
}


def _learner(kind: LearnerKind, network: Any, given: Mapping[str, Any], seed: int) -> Any:
    from patagium import identification
    from patagium.errors import ParameterError

    for name in sorted(_NEEDED[kind] - set(given)):
        raise ParameterError(_option(name), f"a number for the {kind} learner", None)
    for name in sorted(set(given) - _NEEDED[kind] - _TAKEN[kind]):
        raise ParameterError(_option(name), f"nothing: the {kind} learner has none", given[name])
    make = getattr(identification, f"{kind.value.capitalize()}Learner")
    return make(network, seed=seed, **given)


def _one_or_each(deviations: Numbers | None) -> float | Numbers | None:
    return deviations[0] if deviations is not None and len(deviations) == 1 else deviations


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")


def _keep(
    result: Identification,
    file: Path,
    inputs: tuple[str, ...] | None,
    model: Path | None,
    report: Path | None,
    predictions: Path | None,
) -> None:
    from patagium.identification.model_file import model_of, save_model

    if model is not None:
        save_model(model, model_of(result.learner, inputs=inputs, source=file.name))
        typer.echo(f"The model is in {model}", err=True)
    if report is not None:
        result.report(report, f"Identification of {file.name}")
        typer.echo(f"The report is in {report}", err=True)
    if predictions is not None:
        result.save(predictions)
        typer.echo(f"The predictions are in {predictions}", err=True)
