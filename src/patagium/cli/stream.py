"""`patagium stream`: learn what the air does while the robot flies, from packets as they come."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from patagium.cli.interruption import interrupted
from patagium.cli.learner_options import (
    LearnerChoice,
    NetworkKind,
    scaled_network,
    winged_network,
    with_learner_options,
)
from patagium.cli.live import LiveAddressOption, LiveOption, Shown, live_stream

if TYPE_CHECKING:
    from patagium.live.loop import Rhythm, Status
    from patagium.live.packets import Intake
    from patagium.live.pipeline import Pipeline
    from patagium.live.sources import PacketQueue, Source
    from patagium.robot import Robot

EXAMPLES = (
    "patagium stream udp://127.0.0.1:9000 --robot aerobat --state learner.state",
    "patagium stream udp://127.0.0.1:9000 --robot aerobat --network strip --prior-std 0.3 "
    "--measurement-std 3e-4 --spread 1.7 --outlier-std 5 --noise-memory 2000 "
    "--record stream.nc --model model.json",
    "patagium stream log.csv --robot aerobat --network dense --hidden 20 --scale-by flight.nc "
    "--covariance node --prior-std 0.5 --measurement-std 1e-3 --idle 5",
    "sensors | patagium stream - --robot robot.yaml --live",
)
_LINE_PERIOD = 0.2  # s
_NOW_AND_THEN = 5.0  # s


@with_learner_options()
def stream(
    source: Annotated[
        str,
        typer.Argument(help="CSV file, imported log, - for standard input, or udp://ADDRESS:PORT."),
    ],
    robot: Annotated[str, typer.Option(help="Name of a preset, or a robot file.")],
    choice: LearnerChoice,
    scale_by: Annotated[
        Path | None, typer.Option(help="Flight (.nc) whose samples scale a dense network.")
    ] = None,
    idle: Annotated[
        float | None,
        typer.Option(
            min=0.0, help="Silence of the source that ends the stream [s]; Ctrl-C by default."
        ),
    ] = None,
    samples: Annotated[
        int | None, typer.Option(min=1, help="Number of samples that ends the stream.")
    ] = None,
    memory: Annotated[
        float, typer.Option(min=1.0, help="Number of past samples in the running scores.")
    ] = 10_000.0,
    key_file: Annotated[
        Path | None,
        typer.Option(help="File of the key that signs datagrams; others are not used."),
    ] = None,
    room: Annotated[
        int, typer.Option(min=1, help="Number of packets that may wait for the learner.")
    ] = 16_384,
    record: Annotated[
        Path | None,
        typer.Option(help="File for packets and predictions (.nc), written as they arrive."),
    ] = None,
    model: Annotated[Path | None, typer.Option(help="File for the learned model (.json).")] = None,
    state: Annotated[
        Path | None,
        typer.Option(help="File of the learner's state: resumed if it is there, and written."),
    ] = None,
    autosave: Annotated[
        float, typer.Option(min=0.1, help="Time between two writes of the state [s].")
    ] = 60.0,
    live: LiveOption = False,
    live_address: LiveAddressOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Summary as JSON on stdout.")] = False,
) -> None:
    """Learn what the air does while the robot flies, every sample, from packets as they come.

    A packet is time, q, v, a and u1 of each coordinate: a CSV line under a header such as
    time,q.roll,...,u1.roll, or a row of a binary datagram; `docs/stream.md` has the formats.
    Each sample is predicted before it is learned. What is lost, dropped, malformed or refused
    is counted and shown. Ctrl-C ends the stream, and its files are written. With --state
    the learner goes on where it stopped, with the centers and scales it began with.
    """
    from patagium.cli.state import keep_model, keep_state, resumed
    from patagium.cli.words import answer
    from patagium.learning.default_learner import learner_choices
    from patagium.live.loop import Counters, Status
    from patagium.live.packets import Intake
    from patagium.live.pipeline import Pipeline
    from patagium.live.sources import DatagramSource, PacketQueue, source_of
    from patagium.robot import load_robot
    from patagium.sensing.force.air_force import packet_columns

    machine = load_robot(robot)
    kind, layers = choice.shape()
    net = _network(machine, kind, layers, choice.activation, scale_by)
    student = resumed(choice.learner(net), state)
    pipeline = Pipeline(student, machine)
    status, intake = Status(Counters(net.outputs, memory)), Intake()
    columns = [column.name for column in packet_columns(machine)]
    queue = PacketQueue(room, len(columns), intake)
    rhythms = _saving(student, state, autosave)
    packets = source_of(source, columns, idle=idle, key_file=key_file)
    if isinstance(packets, DatagramSource) and packets.warning:
        typer.echo(f"patagium: {packets.warning}", err=True)
    with live_stream(live, live_address, pipeline, status, intake) as shown:
        live_view = Shown(shown.sinks, (*shown.rhythms, *rhythms))
        facts, problem = _learn(packets, queue, pipeline, status, record, live_view, samples)
    if problem is not None and not facts["samples"]:
        raise problem
    keep_state(student, state)
    keep_model(model, pipeline.learner, pipeline.inputs, source)
    chosen = learner_choices(pipeline.learner, given=not choice.default)
    for name, text in chosen.items():
        typer.echo(f"{name}: {text}", err=True)
    for reason in intake.examples:
        typer.echo(f"patagium: not used: {reason}", err=True)
    facts["chosen"] = chosen
    answer(facts if as_json else _flat(facts), as_json=as_json)
    if problem is not None:
        raise problem


def _learn(
    source: Source,
    queue: PacketQueue,
    pipeline: Pipeline,
    status: Status,
    record: Path | None,
    live_view: Shown,
    samples: int | None,
) -> tuple[dict[str, Any], Exception | None]:
    """Summary of a stream, and the error that ended it early."""
    from patagium.errors import PatagiumError
    from patagium.live.loop import Rhythm, follow, summary
    from patagium.live.sources import start_reading

    stop, problem = threading.Event(), None
    with (
        interrupted(stop.set, queue.abandon),  # what waits is learned; asked again, dropped
        _recording(record, pipeline) as sink,
        _line(status, pipeline, queue.intake) as show,
    ):
        reader = start_reading(source, queue, stop)
        often = (Rhythm(_LINE_PERIOD, show), *live_view.rhythms)
        sinks = [*live_view.sinks, *([] if sink is None else [sink])]
        try:
            follow(queue, pipeline, status, stop, sinks=sinks, rhythms=often, most=samples)
        except (PatagiumError, OSError) as error:
            problem = error
        stop.set()
        queue.close()
        reader.join(1.0)
        facts = summary(status, queue, pipeline)
        if sink is not None and (facts["samples"] or problem is None):
            typer.echo(f"The record is in {sink.close(facts)}", err=True)
    return facts, problem


def _saving(learner: Any, state: Path | None, period: float) -> tuple[Rhythm, ...]:
    """Rhythm that keeps the state; a full disk does not stop the stream."""
    from patagium.live.autosave import AutoSave
    from patagium.live.loop import Rhythm

    if state is None:
        return ()
    keeper, reported = AutoSave(learner, state, period), 0

    def tick() -> None:
        nonlocal reported
        keeper.tick()
        if keeper.failures > reported:
            typer.echo(f"patagium: {keeper.problem}", err=True)
        reported = keeper.failures

    return (Rhythm(period / 4, tick),)


def _network(
    robot: Robot,
    kind: NetworkKind | None,
    hidden: tuple[int, ...],
    activation: str,
    scale_by: Path | None,
) -> Any:
    from patagium.aerodynamics import Air
    from patagium.errors import ParameterError
    from patagium.sensing import training_data
    from patagium.simulation import load_flight

    if kind is not NetworkKind.DENSE:
        if scale_by is not None:
            raise ParameterError("--scale-by", "a dense network to go with it", "one of wings")
        return winged_network(kind, robot, hidden, Air(), activation)
    if scale_by is None:
        raise ParameterError("--scale-by", "a flight that scales the dense network", None)
    _, x, y = training_data(load_flight(scale_by), robot)
    return scaled_network(robot.dof_names, hidden, activation, x, y)


@contextmanager
def _recording(path: Path | None, pipeline: Pipeline) -> Iterator[Any]:
    """File of the stream, whole or not at all; None without a path."""
    from patagium.live.record import StreamFile

    if path is None:
        yield None
        return
    file = StreamFile(path, pipeline)
    try:
        yield file
    finally:
        file.discard()


@contextmanager
def _line(status: Status, pipeline: Pipeline, intake: Intake) -> Iterator[Any]:
    """Line on stderr that is rewritten; without a terminal, a new line every few seconds."""
    rewritten, last = sys.stderr.isatty(), -math.inf

    def show() -> None:
        nonlocal last
        now = time.monotonic()
        if rewritten:
            sys.stderr.write("\r\x1b[K" + live_line(status, intake, pipeline))
            sys.stderr.flush()
        elif status.counters.samples and now - last > _NOW_AND_THEN:
            last = now
            typer.echo(live_line(status, intake, pipeline), err=True)

    try:
        yield show
    finally:
        if rewritten:
            sys.stderr.write("\n")


def live_line(status: Status, intake: Intake, pipeline: Pipeline) -> str:
    """Progress of a stream in one line.

    Args:
        status: Rate, error, coverage.
        intake: Counts of packets that came in, and that did not.
        pipeline: Pipeline, whose learner counts the samples it refused or left out.
    """
    counters = status.counters
    words = ["waiting for packets"]
    if counters.samples:
        words = [
            f"{counters.samples} samples",
            f"{status.rate:.0f}/s",
            f"load {status.load:.0%}",
            f"NMSE {counters.nmse_mean:.2e}",
            f"in the 95 % interval {counters.coverage:.1%}",
        ]
    counts = {**intake.counts, "gaps": status.gaps, "failed": counters.failed}
    counts |= {"memory_resets": pipeline.memory_resets, **pipeline.learner.events}
    del counts["received"]
    words += [f"{name.replace('_', ' ')} {count}" for name, count in counts.items() if count]
    return ", ".join(words)


def _flat(facts: dict[str, Any]) -> dict[str, Any]:
    """Summary for a person: without channels, times in microseconds."""
    flat = {name: value for name, value in facts.items() if not isinstance(value, dict)}
    flat |= {f"event: {name}": count for name, count in facts["events"].items() if count}
    times = facts["time_per_call"]
    return flat | {f"time per call, {name} [us]": 1e6 * value for name, value in times.items()}
