"""The live view beside `patagium stream` and `patagium simulate`: its options and its words."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

if TYPE_CHECKING:
    from patagium.identification.live import Rhythm, Sink, Status
    from patagium.identification.packets import Intake
    from patagium.identification.pipeline import Pipeline
    from patagium.viewer.live_frames import Subject
    from patagium.viewer.live_view import LiveView

DEFAULT_ADDRESS = "127.0.0.1:8080"

LiveOption = Annotated[
    bool, typer.Option("--live", help="Show it in a browser while it runs (patagium[viewer]).")
]
LiveAddressOption = Annotated[
    str | None,
    typer.Option(
        metavar="HOST:PORT",
        help=f"Where that page is served; {DEFAULT_ADDRESS}, this machine alone, if not said.",
    ),
]


class Shown(NamedTuple):
    """What a stream does for its live view.

    Attributes:
        sinks: Take what was learned.
        rhythms: Send frames.
    """

    sinks: tuple[Sink, ...] = ()
    rhythms: tuple[Rhythm, ...] = ()


class Several(NamedTuple):
    """Sinks as one.

    Attributes:
        sinks: Each takes everything.
    """

    sinks: tuple[Sink, ...]

    def append(self, packets: Any, records: Any) -> None:
        """Give them to each."""
        for sink in self.sinks:
            sink.append(packets, records)


@contextmanager
def live_stream(
    live: bool, address: str | None, pipeline: Pipeline, status: Status, intake: Intake
) -> Iterator[Shown]:
    """A page beside a stream, where one is asked for.

    Args:
        live: Whether it is.
        address: Where; None: where it usually is.
        pipeline: What learns.
        status: How it goes.
        intake: What came in, and what did not.

    Raises:
        ParameterError: If an address is given without a page, or the page cannot be served.
    """
    if not _asked(live, address):
        yield Shown()
        return
    from patagium.identification.live import Rhythm
    from patagium.viewer.live_frames import Feed, Subject
    from patagium.viewer.live_view import PERIOD

    learner = pipeline.learner
    network, robot = learner.network, pipeline.robot
    subject = Subject(robot, network.output_names, network, f"{robot.name}: learning")
    with opened(subject, address) as view:
        feed = Feed(view.letters, subject, learner)

        def tick() -> None:
            tell_if_ended(view, "the learner goes on")
            tally = status.tally
            feed.post(
                samples=tally.samples,
                failed=tally.samples - tally.learned + intake.dropped,
                load=status.load,
                nmse=tally.nmse_mean,
                coverage=tally.coverage,
                time_per_call=tally.duration(0.5),
            )

        yield Shown((feed,), (Rhythm(PERIOD, tick),))


@contextmanager
def opened(subject: Subject, address: str | None) -> Iterator[LiveView]:
    """A page, and where it is, said on stderr.

    Args:
        subject: What it shows.
        address: HOST:PORT; None: where it usually is.

    Raises:
        ParameterError: If it cannot be served there.
    """
    from patagium.viewer.live_view import LiveView

    with LiveView(subject, *_host_and_port(address or DEFAULT_ADDRESS)) as view:
        reach = "loopback: this machine alone"
        if not view.loopback:
            reach = f"listens at {view.host}: whoever reaches this machine can watch and steer"
        typer.echo(f"The live view is at {view.address} ({reach})", err=True)
        yield view


def tell_if_ended(view: LiveView, otherwise: str) -> None:
    """Say once that the page is gone.

    Args:
        view: The page.
        otherwise: What happens all the same.
    """
    reason = view.problem()
    if reason is not None:
        typer.echo(f"patagium: the live view ended ({reason}); {otherwise}", err=True)


def _asked(live: bool, address: str | None) -> bool:
    from patagium.errors import ParameterError

    if address is not None and not live:
        raise ParameterError("--live-address", "--live with it", address)
    return live


def _host_and_port(address: str) -> tuple[str, int]:
    from patagium.errors import ParameterError

    host, colon, port = address.rpartition(":")
    if not (colon and host and port.isdecimal() and int(port) < 1 << 16):
        raise ParameterError("--live-address", "HOST:PORT such as 127.0.0.1:8080", address)
    return host.strip("[]"), int(port)
