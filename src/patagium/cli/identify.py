"""`patagium identify`: a learner on a flight or a log, and the scores of its predictions."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from patagium.cli import estimates, learner_options
from patagium.cli.options import LogArgument, MappingOption, ReportOption, ScoresOption, output_file
from patagium.cli.outputs import Outputs
from patagium.cli.words import FLIGHT, progress_bar, say_json, say_next, show_table, tell, warn
from patagium.errors import Interrupted, Outcome, ParameterError, command

if TYPE_CHECKING:
    from collections.abc import Mapping

    from patagium.learning import Identification
    from patagium.sensing import LogTable

EXAMPLES = (
    "patagium identify flight.nc --report report.html",
    "patagium identify flight.nc --network strip --hidden 8,8 --prior-std 0.3 "
    "--measurement-std 3e-4 --spread 1.7 --model model.json --report report.html",
    "patagium identify log.csv --mapping columns.yaml --network dense --hidden 16,16 --every 1 "
    "--prior-std 0.5 --measurement-std 0.05 --state learner.state",
    "patagium identify flight.nc --settings settings.yaml --report report.html",
    "patagium identify flight.nc --settings settings.yaml --horizon 20ms --horizon 100ms",
    'patagium identify flight.nc --estimate "section.lift_slope=0.5,lags.rate[0]=0.02" '
    "--aero lifting-line --report report.html",
)
PANELS = {
    "Numbers of the air and the robot": "estimate aero refine",
    "Logs and forecasts": "mapping horizon",
    "State, settings, predictions": "state settings predictions",
}
_MOMENT = "The force of the air, the predicted one as a halo; a click plays the flight."
_START = 1 << 18  # samples of a long log that a network is made from


@learner_options.with_learner_options()
def identify(
    choice: learner_options.LearnerChoice,
    file: LogArgument = FLIGHT,
    mapping: MappingOption = None,
    every: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Use one sample in so many; by default 100 a second, or 20 a wingbeat, of a table "
            "all, as far as the network's size allows.",
        ),
    ] = None,
    horizon: Annotated[
        list[str] | None,
        typer.Option(
            help="Forecast the outputs so long ahead, such as 100ms, from samples up to a time "
            "alone, compared with predictors that know as much. May be repeated."
        ),
    ] = None,
    estimate: estimates.EstimateOption = None,
    aero: estimates.AeroOption = None,
    refine: estimates.RefineOption = None,
    model: Annotated[
        Path | None,
        output_file(
            "File for the learned model (.json), which predicts; model.json next to the log."
        ),
    ] = None,
    state: Annotated[
        Path | None,
        output_file(
            "File of the learner's state: it is resumed if it is there, and written at the "
            "end. A state, unlike a model, learns on, with the centers and scales it began with; "
            "that of a learner that diverged is not written."
        ),
    ] = None,
    report: ReportOption = None,
    predictions: Annotated[
        Path | None, output_file("File for every prediction and score (.nc).")
    ] = None,
    as_json: ScoresOption = False,
) -> None:
    """Learn what the air does, online, from a flight or a measured log.

    Each sample is predicted before it may be used; the score is the mean square error of
    these predictions over the variance of the output, compared with holding the last
    used sample. These predictions see the measured inputs of their sample; --horizon scores a
    true forecast. Nothing has to be set: what was chosen, and from what, is printed, and an option
    overrides it, one by one. With --state the other options must be the same as before.
    """
    from patagium.cli.logs import flight_or_table
    from patagium.cli.state import keep_model, keep_state, resumed, sole_user
    from patagium.learning.default_learner import learner_choices, table_settings
    from patagium.learning.model_file import model_of
    from patagium.sensing.logs.record import LogRecord

    every = every or choice.every
    flight, log = flight_or_table(file, mapping, blocks=True)
    long = isinstance(log, LogRecord)
    table = log.table(0, _START) if long else log
    estimates.check_estimate(estimate, aero, refine, table is None)
    if table is not None:
        network = table_network(table, choice, resumes=state is not None and state.exists())
        if choice.kind == "extended" and choice.every is None:  # no file of settings
            given = dict(choice.settings or {})
            found = table_settings(table, network, every, given)
            choice = replace(choice, settings=found | given)
    elif estimate:
        if choice.network is not None:
            raise ParameterError("--network", "none with --estimate", choice.network.value)
        network = estimates.grey_box(flight, estimate, aero)
    else:
        network = flight_network(flight, choice)
    outputs, by_hand = Outputs(), {*choice.chosen, *["network"] * bool(estimate)}
    with sole_user(state):
        learner = resumed(choice.learner(network), state)
        before = model_of(learner) if estimate and learner.count else None
        result = _learned(learner, file, log or flight, state, every=every, horizons=horizon)
        made = result.learner
        if estimate and refine is not False and result.outcome is Outcome.COMPLETED:
            with progress_bar(f"Refining what {file.name} taught"):
                result = estimates.refined(result, flight, result.scores["every"], before)
        if result.outcome is Outcome.COMPLETED:
            outputs.attempt("state", keep_state, made, state, of_course=long)
    result.scores["chosen"] |= learner_choices(made, given=by_hand)
    if table is not None:
        tell(f"{file}: {result.scores['gaps_found']}")
    model = model or file.with_name("model.json")
    outputs.attempt("model", keep_model, model, result.learner, result.inputs, file.name)
    if predictions is not None and outputs.attempt("predictions", result.save, predictions):
        tell(f"The predictions are in {predictions}")
    flown = None if flight is None or "air" in flight.attrs else flight  # not of a log
    if report is not None:
        _report(result, file, flown, report, outputs)
    outputs.attempt("scores", show_scores, result.scores, as_json=as_json)
    if result.outcome is not Outcome.COMPLETED:
        warn(result.message)
        raise typer.Exit(2)
    outputs.check()
    if not as_json:
        _say_what_next(file, mapping, model, flown=flown is not None)


def _say_what_next(file: Path, mapping: Path | None, model: Path, *, flown: bool) -> None:
    view = command("patagium view {} --model {}", file, model)
    meant = "" if mapping is None else command(" --mapping {}", mapping)
    again = command(f"patagium evaluate {{}} ANOTHER{file.suffix}", model) + meant
    say_next(*((view, command("patagium cycles {}", file)) if flown else (again,)))


def _learned(learner: Any, file: Path, learned: Any, state: Path | None, **options: Any) -> Any:
    """Identification of a flight, a table or a long log; Ctrl-C leaves a state as it was.

    Raises:
        Exit: With code 130 on Ctrl-C.
    """
    from patagium.cli.interruption import interruptible
    from patagium.cli.state import course_of
    from patagium.learning import identify as identify_log
    from patagium.learning.long_log import identify_record
    from patagium.sensing.logs.record import LogRecord

    resume = course_of(state) if state and isinstance(learned, LogRecord) else None
    work: Any = identify_log
    if isinstance(learned, LogRecord):
        work = partial(identify_record, course=resume)
    with progress_bar(f"Learning from {file.name}") as bar:
        try:
            with interruptible(bar) as progress:
                return work(learned, learner, progress=progress, **options)
        except Interrupted:
            if resume is not None and resume.exists():
                tell(f"The same command goes on from {resume}")
            elif state is not None:
                tell(f"{state} is as it was; the same command begins anew")
            raise typer.Exit(130) from None


def show_scores(scores: Mapping[str, Any], *, as_json: bool) -> None:
    """Scores on stdout: a table by output and a line, or all of them as JSON."""
    from patagium.learning.page import forecast_tables, score_table, silent_words, summary
    from patagium.learning.parameter_paths import parameter_table

    if as_json:
        say_json(dict(scores))
        return
    for name, text in scores.get("chosen", {}).items():
        typer.echo(f"{name}: {text}")
    for table in (score_table(scores), *forecast_tables(scores)):
        show_table(table)
    parameters = parameter_table(scores)
    if parameters is not None:
        show_table(parameters)
    typer.echo("\n".join([summary(scores), *silent_words(scores), *scores["verdict"]]))


def flight_network(flight: Any, choice: learner_options.LearnerChoice) -> Any:
    """A network for a flight; a dense one is scaled by its first wingbeat, or second, of motion."""
    from patagium.learning.default_learner import first_motion
    from patagium.learning.samples import with_force
    from patagium.sensing import ForceSamples, training_data
    from patagium.simulation import air_of, gait_period, robot_of

    if choice.shape()[0] is not learner_options.NetworkKind.DENSE:
        return learner_options.winged_network(choice, flight, air_of(flight))
    names, forces = robot_of(flight).dof_names, with_force(flight)
    if isinstance(forces, ForceSamples):
        names, time, x = forces.measured, forces.time, forces.state
        y = forces.force[:, [forces.robot.index(name) for name in names]]
    else:
        time, x, y = training_data(flight)
    first = first_motion(robot_of(flight), time, x, gait_period(flight))
    begin, end = time[first][[0, -1]]
    tell(f"Inputs and outputs are scaled by {begin:.4g} to {end:.4g} s.")
    return learner_options.scaled_network(choice, names, x[first], y[first])


def table_network(
    table: LogTable, choice: learner_options.LearnerChoice, *, resumes: bool = False
) -> Any:
    """Network for a table, scaled by the ranges of its mapping, else by the first samples.

    Where a learner resumes, which has scales of its own, it is not scaled.

    Raises:
        ParameterError: If the kind needs a robot.
    """
    import numpy as np

    from patagium.learning.default_learner import HIDDEN
    from patagium.learning.table_network import network_for

    kind, hidden = choice.shape()
    if kind in learner_options.WINGED:
        raise ParameterError("--network", "dense for a table: wings need q and v", kind.value)
    if resumes:
        parts = {name: getattr(table, name) for name in ("input_range", "output_range")}
        table = replace(table, **{k: np.ones_like(one) * [-1, 1] for k, one in parts.items()})
    return network_for(table, hidden or HIDDEN, choice.activation)


def _report(
    result: Identification, file: Path, flight: Any, report: Path, outputs: Outputs
) -> None:
    """Write a page of the result and, if there is a flight, a page of it in three dimensions."""
    moving = None
    if flight is not None and result.outcome is Outcome.COMPLETED:
        from patagium.report import picture
        from patagium.report.style import figures_for
        from patagium.viewer import replay, still

        title = f"Flight {file.stem}, as it was learned"
        page = report.parent / f"{report.stem}-replay.html"
        if outputs.attempt(page.name, replay, flight, page, predicted=result, title=title):
            with figures_for("phone"):
                figure = still(flight, predicted=result)
            moving = replace(picture(figure, _MOMENT, "png"), address=page.name)
    title = f"Identification of {file.name}"
    if outputs.attempt("report", result.report, report, title, moving):
        where = "" if moving is None else f"; the flight in three dimensions is in {moving.address}"
        tell(f"The report is in {report}{where}")
