"""`patagium stream`: learn what the air does while the robot flies, from packets as they come."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
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
from patagium.cli.options import RobotOption, WindOption, option_in, output_file
from patagium.cli.outputs import Outputs
from patagium.cli.words import tell, warn
from patagium.errors import FilterDiverged, LogError, ParameterError, PatagiumError

if TYPE_CHECKING:
    from patagium.aerodynamics import Air
    from patagium.arrays import Array
    from patagium.live.loop import Rhythm, Sink, Status
    from patagium.live.packets import Intake
    from patagium.live.pipeline import Pipeline, Records
    from patagium.live.sources import PacketQueue, Source
    from patagium.robot import Robot

EXAMPLES = (
    "patagium stream udp://127.0.0.1:9000 --robot aerobat --state learner.state",
    "patagium stream udp://127.0.0.1:9000 --robot aerobat --network strip --prior-std 0.3 "
    "--measurement-std 3e-4 --spread 1.7 --outlier-std 5 --noise-memory 2000 "
    "--record stream.nc --model model.json",
    "patagium stream log.csv --robot aerobat --network dense --hidden 20 --scale-by flight.nc "
    "--covariance node --prior-std 0.5 --measurement-std 1e-3 --idle 5",
    'sensors | patagium stream - --robot robot.yaml --density 1.1 --wind "-3,0,0 m/s" --live',
)
PANELS = {
    "Packets": "key_file room samples idle",
    "Air": "density wind",
    "Learner": "settings scale_by memory autosave",
    "Live view": "live_address",
}
_LINE_PERIOD = 0.2  # s
_NOW_AND_THEN = 5.0  # s


@with_learner_options()
def stream(
    source: Annotated[
        str, typer.Argument(help="udp://ADDRESS:PORT, - for standard input, CSV file or log (.nc).")
    ],
    choice: LearnerChoice,
    robot: RobotOption = None,
    density: Annotated[
        float | None,
        option_in("kg/m^3", "Density of the air, in kg/m^3; that of a log, or 1.225."),
    ] = None,
    wind: WindOption = None,
    scale_by: Annotated[
        Path | None, typer.Option(help="Flight (.nc) whose samples scale a dense network.")
    ] = None,
    idle: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="Silence that ends the stream, of UDP after a first packet [s]; default: Ctrl-C.",
        ),
    ] = None,
    samples: Annotated[
        int | None, typer.Option(min=1, help="Number of samples that ends the stream.")
    ] = None,
    memory: Annotated[
        float, typer.Option(min=1.0, help="Number of past samples in the running scores.")
    ] = 10_000.0,
    key_file: Annotated[
        Path | None, typer.Option(help="File of the key that signs datagrams; others are not used.")
    ] = None,
    room: Annotated[
        int, typer.Option(min=1, help="Number of packets that may wait for the learner.")
    ] = 16_384,
    record: Annotated[
        Path | None, output_file("File for packets and predictions (.nc), written as they arrive.")
    ] = None,
    model: Annotated[Path | None, output_file("File for the learned model (.json).")] = None,
    state: Annotated[
        Path | None, output_file("File of the learner's state: resumed, and written.")
    ] = None,
    autosave: Annotated[
        float, typer.Option(min=0.1, help="Time between two writes of the state [s].")
    ] = 60.0,
    live: LiveOption = False,
    live_address: LiveAddressOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Summary as JSON on stdout.")] = False,
) -> None:
    """Learn what the air does while the robot flies, every sample, from packets as they come.

    A packet is a CSV line or a row of a binary datagram. It holds time, q, v, a and u1 of each
    coordinate, or the raw samples of sensors: inertial units, encoders, cameras, motor currents.
    Each sample is predicted before it is learned. What is lost, dropped, malformed or refused
    is counted and shown. Ctrl-C, SIGTERM and SIGHUP end the stream, and its files are written. An
    output that fails, and a second of raw samples without motion, make the exit code 2.
    """
    from patagium.cli.state import keep_model, keep_state, resumed, sole_user
    from patagium.learning.default_learner import learner_choices
    from patagium.live.loop import Counters, Status, summary
    from patagium.live.packets import Intake
    from patagium.live.pipeline import Pipeline
    from patagium.live.sources import PacketQueue
    from patagium.sensing.force.air_force import packet_columns

    machine, stated = _robot_and_air(source, robot)
    air = stated if density is None else replace(stated, density=density)
    air = air if wind is None else replace(air, wind=wind)
    net = _network(machine, air, choice, scale_by)
    if air != stated and choice.shape()[0] is NetworkKind.DENSE:
        raise ParameterError("--density, --wind", "a network of wings, which sees the air", "dense")
    outputs, stop, ending = Outputs(), threading.Event(), threading.Event()
    with sole_user(state), sole_user(record):
        student = resumed(choice.learner(net), state)
        pipeline = Pipeline(student, machine)
        status, intake = Status(Counters(net.outputs, memory)), Intake()
        columns = [column.name for column in packet_columns(machine)]
        queue = PacketQueue(room, len(columns), intake, machine)
        with (
            interrupted(_answers(stop, queue, ending)),
            nullcontext() if record is None else _Recording(record, pipeline, outputs) as recording,
        ):
            problem: Exception | None = None
            try:
                with live_stream(live, live_address, pipeline, status, intake) as view:
                    packets = _opened(source, columns, idle, key_file, machine)
                    shown = _watched(view, student, state, autosave, recording)
                    shown = shown._replace(rhythms=(*shown.rhythms, noting := _noting(queue, air)))
                    _learn(packets, queue, pipeline, status, stop, shown, samples)
                    noting.action()
            except Exception as error:
                problem = error
            finally:  # whatever ended it, what was learned is saved first
                lost = not status.counters.samples or isinstance(problem, FilterDiverged)
                if problem is None or not lost:
                    outputs.attempt("state", keep_state, student, state)
                ending.set()
            if problem is not None and not status.counters.samples:
                raise problem
            facts = summary(status, queue, pipeline)
            if recording is not None:
                recording.close(facts)
            facts["chosen"] = learner_choices(student, given=choice.chosen)
            outputs.attempt("model", keep_model, model, student, pipeline.inputs, source)
            _tell(facts["chosen"], intake)
            outputs.answer("summary", facts if as_json else _flat(facts), as_json)
    if problem is not None:
        raise problem
    _check(outputs, intake)


def _check(outputs: Outputs, intake: Intake) -> None:
    """End the verb with what was not saved, or not learned for long, if there is such a thing."""
    outputs.check()
    if times := intake.raw.get("silences"):
        raise LogError("raw samples", "motion in each second of them", f"none {times} time(s)")


def _robot_and_air(source: str, robot: str | None) -> tuple[Robot, Air]:
    """The named robot, else that of an imported log or a sensor log, and the air that it states."""
    from patagium.aerodynamics import Air
    from patagium.live.sources import refuse_other_kinds
    from patagium.robot import load_robot
    from patagium.sensing import load_sensor_log
    from patagium.sensing.logs.record import LogRecord, is_log, stated_air
    from patagium.sensing.sensors.sense import is_sensor_log

    machine, air, file = None if robot is None else load_robot(robot), Air(), Path(source)
    if is_log(source):
        with LogRecord(source) as record:
            machine, air = machine or record.robot, record.air
    elif not (source == "-" or "://" in source or file.is_fifo()) and is_sensor_log(source):
        log = load_sensor_log(source)
        machine, air = machine or log.robot, log.air
    elif file.is_file():
        refuse_other_kinds(file)
        with file.open("rb") as text:
            air = stated_air(text.readline(1 << 10)) or air
    if machine is None:
        raise ParameterError("--robot", "a preset or a robot file: the source carries none", None)
    return machine, air


def _opened(
    source: str, columns: list[str], idle: float | None, key_file: Path | None, robot: Robot
) -> Source:
    """Source of the packets; the command that sends to it, and a warning, are printed."""
    from patagium.live.sources import DatagramSource, source_of

    packets = source_of(source, columns, idle=idle, key_file=key_file, robot=robot)
    if not isinstance(packets, DatagramSource):
        tell(f"Reading {'standard input' if source == '-' else source}")
        return packets
    if packets.warning:
        warn(packets.warning)
    key = "" if key_file is None else f" --key-file {key_file}"
    words = "for motion and joint forces, or raw samples of sensors"
    tell(f"Listening at {packets.address} {words}")
    tell("To send a recorded flight or sensor log:")
    tell(f"  patagium send flight.nc {packets.address}{key}")
    return packets


def _noting(queue: PacketQueue, air: Air) -> Rhythm:
    """Rhythm that tells what was found about raw sensors, and of a text in other air."""
    from patagium.live.loop import Rhythm
    from patagium.sensing.logs.record import stated_air

    told: list[str] = []

    def note_changes() -> None:
        stated, queue.intake.air = stated_air(queue.intake.air) or air, b""
        if stated != air:
            words = f"wind {stated.wind} m/s and density {stated.density:.4g} kg/m^3"
            given = "another is learned in (--density, --wind)"
            tell(f"Warning: the text states {words}: {given}")
        for note in queue.notes[len(told) :]:
            told.append(note)
            tell(note + "." * (note[-1] not in ".?"))

    return Rhythm(_LINE_PERIOD, note_changes)


def _tell(chosen: Mapping[str, str], intake: Intake) -> None:
    """Print what was chosen for the learner, and examples of what was not used."""
    for name, text in chosen.items():
        tell(f"{name}: {text}")
    for reason in intake.examples:
        warn(f"not used: {reason}")


def _answers(
    stop: threading.Event, queue: PacketQueue, ending: threading.Event
) -> Iterator[Callable[[], None]]:
    """Answers to signals: what waits is learned; asked again, dropped, and the state is saved."""
    yield stop.set
    while not ending.is_set():
        yield queue.abandon


def _learn(
    source: Source,
    queue: PacketQueue,
    pipeline: Pipeline,
    status: Status,
    stop: threading.Event,
    shown: Shown,
    samples: int | None,
) -> None:
    """Learn the packets of a source until it ends or is stopped."""
    from patagium.live.loop import Rhythm, follow
    from patagium.live.sources import start_reading

    reader = start_reading(source, queue, stop)
    with _line(status, pipeline, queue.intake) as show:
        rhythms = (Rhythm(_LINE_PERIOD, show), *shown.rhythms)
        try:
            follow(queue, pipeline, status, stop, sinks=shown.sinks, rhythms=rhythms, most=samples)
        finally:
            stop.set()
            queue.close()
            reader.join(1.0)


def _watched(
    shown: Shown, learner: Any, state: Path | None, period: float, recording: _Recording | None
) -> Shown:
    """Recording, live view and saver of the state, whose failures are printed and end nothing."""
    from patagium.live.autosave import AutoSave
    from patagium.live.loop import Rhythm

    meanwhile = Outputs()
    sinks: list[Sink] = [*shown.sinks, *([] if recording is None else [recording])]
    rhythms = [
        Rhythm(one.period, partial(meanwhile.attempt, "live view", one.action))
        for one in shown.rhythms
    ]
    if state is not None:
        keeper = AutoSave(learner, state, period)

        def tick() -> None:
            before = keeper.failures
            keeper.tick()
            if keeper.failures > before:
                raise PatagiumError(keeper.problem)

        rhythms.append(Rhythm(period / 4, partial(meanwhile.attempt, "state", tick)))
    return Shown(tuple(sinks), tuple(rhythms))


class _Recording(AbstractContextManager["_Recording"]):
    """Recording of a stream, whole or not at all, which a full disk ends alone."""

    def __init__(self, path: Path, pipeline: Pipeline, outputs: Outputs) -> None:
        from patagium.live.record import StreamFile

        self._file, self._outputs, self._ended = StreamFile(path, pipeline), outputs, False

    def __exit__(self, *_: object) -> None:
        self._file.discard()

    def append(self, packets: Array, records: Records) -> None:
        if self._ended:
            return
        self._ended = not self._outputs.attempt("recording", self._file.append, packets, records)
        if not self._file.sound:
            self._file.discard()  # its room is for the state

    def close(self, facts: dict[str, Any]) -> None:
        """Put what was recorded in its place, if it is whole."""
        from patagium.cli.state import instead

        file, before = self._file, instead(self._file.path)
        if file.sound and self._outputs.attempt("recording", file.close, facts):
            tell(f"The record of {file.written} samples is in {file.path}{before}")


def _network(robot: Robot, air: Air, choice: LearnerChoice, scale_by: Path | None) -> Any:
    from patagium.sensing import training_data
    from patagium.simulation import load_flight

    if choice.shape()[0] is not NetworkKind.DENSE:
        if scale_by is not None:
            raise ParameterError("--scale-by", "a dense network to go with it", "one of wings")
        return winged_network(choice, robot, air)
    if scale_by is None:
        raise ParameterError("--scale-by", "a flight that scales the dense network", None)
    _, x, y = training_data(load_flight(scale_by), robot)
    return scaled_network(choice, robot.dof_names, x, y)


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
            tell(live_line(status, intake, pipeline))

    try:
        yield show
    finally:
        if rewritten:
            sys.stderr.write("\n")


def live_line(status: Status, intake: Intake, pipeline: Pipeline) -> str:
    """Progress of a stream in one line."""
    counters = status.counters
    words = ["waiting for packets"]
    if counters.samples:
        words = [
            f"{counters.samples} samples",
            *([f"{status.rate:.0f}/s"] if math.isfinite(status.rate) else []),
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
