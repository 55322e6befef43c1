"""Live view of `patagium stream` and `patagium simulate`: options, page, messages."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from patagium.cli.interruption import interrupted
from patagium.cli.learner_options import LearnerChoice, NetworkKind, winged_network
from patagium.cli.words import tell, warn
from patagium.errors import ParameterError, PatagiumError

if TYPE_CHECKING:
    from patagium.aerodynamics import Air
    from patagium.live.loop import Rhythm, Sink, Status
    from patagium.live.packets import Intake
    from patagium.live.pipeline import Pipeline
    from patagium.robot import Robot
    from patagium.simulation.gait_models import Gait
    from patagium.simulation.simulator import Simulator
    from patagium.viewer.live_frames import Subject
    from patagium.viewer.live_view import LiveView

DEFAULT_ADDRESS = "127.0.0.1:8080"

LiveOption = Annotated[
    bool, typer.Option("--live", help="Live view in a browser (patagium[viewer]).")
]
LiveAddressOption = Annotated[
    str | None,
    typer.Option(
        metavar="HOST:PORT",
        help=f"Address of the page; {DEFAULT_ADDRESS}, this machine only, by default.",
    ),
]


class Shown(NamedTuple):
    """Sinks and rhythms of the live view of a stream.

    Attributes:
        sinks: Receivers of the samples learned.
        rhythms: Periodic calls that send frames.
    """

    sinks: tuple[Sink, ...] = ()
    rhythms: tuple[Rhythm, ...] = ()


@contextmanager
def live_stream(
    live: bool, address: str | None, pipeline: Pipeline, status: Status, intake: Intake
) -> Iterator[Shown]:
    """Page of a stream, where one is wanted.

    Raises:
        ParameterError: If an address is given without a page, or the page cannot be served.
    """
    if not served(live, address):
        yield Shown()
        return
    from patagium.viewer.live_frames import Subject

    network, robot = pipeline.learner.network, pipeline.robot
    subject = Subject(robot, network.output_names, network, f"{robot.name}: learning")
    with opened(subject, address) as view:
        yield beside_stream(view, pipeline, status, intake)


def beside_stream(view: LiveView, pipeline: Pipeline, status: Status, intake: Intake) -> Shown:
    """Sinks and rhythms of a stream that feed a page."""
    from patagium.live.loop import Rhythm
    from patagium.viewer.live_frames import Feed, counted
    from patagium.viewer.live_view import PERIOD

    feed = Feed(view.letters, view.subject, pipeline.learner)

    def tick() -> None:
        tell_if_ended(view, "the learner goes on")
        facts = counted(status.counters)
        facts["failed"] += intake.dropped
        feed.post(load=status.load, **facts)

    return Shown((feed,), (Rhythm(PERIOD, tick),))


def fly_live(
    address: str | None,
    choice: LearnerChoice,
    start: Callable[[Gait], Simulator],
    robot: Robot,
    gait: Gait,
    air: Air,
) -> Any:
    """Flight in real time, shown and steered, until it is over or Ctrl-C.

    Args:
        address: HOST:PORT of the live view; None: the default.
        choice: Learner and network that learn from the flight; nothing learns if none was given.
        start: Function that begins a flight with a gait.
        robot: Robot.
        gait: Gait until it is steered.
        air: Air that it flies in.

    Returns:
        Flight since its last start.

    Raises:
        ParameterError: If the page cannot be served, or the learner cannot learn from a simulation.
    """
    from patagium.live.pipeline import Pipeline
    from patagium.viewer.live_flight import LiveFlight, flight_subject

    pipeline, every = None, 1
    if choice.given:
        if choice.shape()[0] is NetworkKind.DENSE:
            expected = "a network of wings, which needs no flight to begin"
            raise ParameterError("network", expected, "dense")
        network = winged_network(choice, robot, air)
        pipeline, every = Pipeline(choice.learner(network), robot), choice.every or 1
    subject = flight_subject(robot, gait, pipeline)
    step = start(gait).time_step  # compiled before there is a page, and refused before
    stop = threading.Event()
    with opened(subject, address) as view, interrupted([stop.set]):
        flying = LiveFlight(start, robot, gait, step, view, subject, pipeline, every)
        return flying.fly(stop, lambda: tell_if_ended(view, "the flight goes on"))


@contextmanager
def opened(subject: Subject, address: str | None) -> Iterator[LiveView]:
    """Page of a subject at HOST:PORT (None: the default), whose address is printed on stderr.

    Raises:
        ParameterError: If it cannot be served there.
    """
    from patagium.viewer.live_view import LiveView

    with LiveView(subject, *_host_and_port(address or DEFAULT_ADDRESS)) as view:
        reach = "loopback: this machine alone"
        if not view.loopback:
            reach = f"listens at {view.host}, not encrypted: whoever has it can watch and steer"
        tell(f"The live view is at {view.address} ({reach})")
        yield view


def tell_if_ended(view: LiveView, otherwise: str) -> None:
    """Message on stderr, once, that the page is gone."""
    reason = view.problem()
    if reason is not None:
        warn(f"the live view ended ({reason}); {otherwise}")


def served(live: bool, address: str | None, learner: Sequence[str] = ()) -> bool:
    """Whether there is a live view.

    Args:
        live: Whether one is wanted.
        address: Its address; None: not given.
        learner: Options that were given of a learner that needs one.

    Raises:
        PatagiumError: If an address, or one of these options, is given without one.
    """
    if address is not None and not live:
        raise ParameterError("--live-address", "--live with it", address)
    if learner and not live:
        expected = "--live with it, as only such a flight is learned"
        told = "none; add --live, or leave the other out"
        raise PatagiumError(", ".join(learner), expected, told)
    return live


def _host_and_port(address: str) -> tuple[str, int]:
    host, colon, port = address.rpartition(":")
    if not (colon and host and port.isdecimal() and int(port) < 1 << 16):
        raise ParameterError("--live-address", "HOST:PORT such as 127.0.0.1:8080", address)
    return host.strip("[]"), int(port)
