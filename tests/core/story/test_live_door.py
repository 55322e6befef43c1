"""The live page lets no stranger in: real clients at its door, without a browser."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import os
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError

pytest.importorskip("viser", reason="viser is not installed: pip install 'patagium[viewer]'")

import msgspec
import viser
import websockets.asyncio.client
from websockets.asyncio import server
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.http11 import Request

from patagium.viewer import live_door
from patagium.viewer.live_door import LARGEST_MESSAGE, Door
from patagium.viewer.live_flight import LiveFlight, flight_subject
from patagium.viewer.live_frames import COMMAND, Feed, Mailbox, records_without_learner
from patagium.viewer.live_page import LivePage

TOKEN = "a-token-that-nobody-can-guess"
PROTOCOL = f"viser-v{viser.__version__}"
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1, 0, 0, 0.0], "position": [1, 2, 3.5], "fov": 1.0,
    "near": 0.01, "far": 1000, "image_height": 600, "image_width": 800,
    "look_at": [0, 0, 0.0], "up_direction": [0, 0, 1],
}  # fmt: skip


UPGRADE = (
    *(("Upgrade", "websocket"), ("Connection", "Upgrade"), ("Sec-WebSocket-Version", "13")),
    *(("Sec-WebSocket-Key", "AAAAAAAAAAAAAAAAAAAAAA=="), ("Sec-WebSocket-Protocol", PROTOCOL)),
)


class Answer(NamedTuple):
    status: int
    headers: dict[str, str]
    body: bytes


class Served:
    """A page in this process, with what it was asked for."""

    def __init__(self) -> None:
        robot = pt.load_robot("aerobat")
        gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
        self.subject = flight_subject(robot, gait, None)
        self.letters, self.commands = Mailbox(self.subject.layout, 8), Mailbox(COMMAND, 4)
        self.page = LivePage(self.subject, "127.0.0.1", 0, TOKEN, self.commands)
        self.door = self.page._door
        self.host = f"127.0.0.1:{self.page.port}"
        q = robot.coordinates()
        packet = np.concatenate([[0.0], q, np.zeros(3 * robot.dof)])[None]
        self.feed = Feed(self.letters, self.subject)
        self.feed.append(packet, records_without_learner(np.zeros((1, robot.dof))))

    def show(self) -> None:
        self.feed.post(strip_force=np.zeros((len(self.subject.robot.strips), 3)))
        self.page.show(self.letters.take(), self.letters.sent)

    def uuid(self, label: str) -> str:
        inputs = self.page._server.gui._gui_input_handle_from_uuid
        return next(k for k, handle in inputs.items() if handle.label.startswith(label))

    def get(self, path: str, *headers: tuple[str, str]) -> Answer:
        """Answer to a request with these headers; without a Host among them, the page's own."""
        with contextlib.closing(self.connection(path, *headers)) as asking:
            answer = asking.getresponse()
            return Answer(answer.status, dict(answer.getheaders()), answer.read())

    def connection(self, path: str, *headers: tuple[str, str]) -> http.client.HTTPConnection:
        asking = http.client.HTTPConnection("127.0.0.1", self.page.port, timeout=60)
        asking.putrequest("GET", path, skip_host=any(name == "Host" for name, _ in headers))
        for name, value in headers:
            asking.putheader(name, value)
        asking.endheaders()
        return asking

    def open(self, path: str = f"/{TOKEN}", **words: Any) -> Any:
        return websockets.asyncio.client.connect(
            f"ws://{self.host}{path}", subprotocols=[PROTOCOL], proxy=None, max_size=None, **words
        )

    def say(self, *messages: Any, raw: bool = False) -> None:
        """Say something as a client that is let in, and wait until it was heard."""

        async def talk() -> None:
            async with self.open() as client:
                for message in messages:
                    await client.send(message if raw else msgspec.msgpack.encode(message))
                await asyncio.wait_for(await client.ping(), 60)
                await asyncio.sleep(0.2)  # for the page's threads

        asyncio.run(asyncio.wait_for(talk(), 60))

    @property
    def asked(self) -> dict[str, Any]:
        return dict(self.page._asked)


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    opened = Served()
    yield opened
    opened.page.close()


def status(served: Served, path: str = f"/{TOKEN}", **words: Any) -> int:
    """Status of an attempt to open the WebSocket."""

    async def attempt() -> int:
        try:
            async with served.open(path, **words):
                return 101
        except InvalidStatus as refused:
            return refused.response.status_code

    return asyncio.run(asyncio.wait_for(attempt(), 60))


def test_only_the_whole_address_opens_the_page(served: Served) -> None:
    for path in (f"/{TOKEN}", f"/{TOKEN}/", f"/{TOKEN}?darkMode"):
        page = served.get(path)
        assert page.status == 200 and b"viser" in page.body.lower()
        assert page.headers["Referrer-Policy"] == "no-referrer"
        assert "Set-Cookie" not in page.headers
    wrong = ("/", "/index.html", f"/{TOKEN[:-1]}", f"/{TOKEN}x", f"/x/{TOKEN}", f"/?token={TOKEN}")
    for path in (*wrong, "*", f"//{TOKEN}", f"/{TOKEN}%2F", f"/{TOKEN.upper()}"):
        page = served.get(path)
        assert page.status == 403 and b"with its token" in page.body, path
    assert served.get(f"/{TOKEN}/../../_viser.py").status == 404
    assert status(served) == 101
    assert [status(served, path) for path in ("/", "/x", f"/{TOKEN}x")] == [403] * 3


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "http://localhost", "file://"]
)
def test_other_pages_are_refused(served: Served, origin: str) -> None:
    assert status(served, origin=origin) == 403
    assert status(served, origin=f"http://{served.host}") == 101
    twice = [("Origin", f"http://{served.host}"), ("Origin", origin)]
    assert status(served, additional_headers=twice) == 403


def test_names_that_were_pointed_at_this_machine_are_refused(served: Served) -> None:
    port, path = served.page.port, f"/{TOKEN}"
    for name in ("evil.example", "127.0.0.1.evil.example", "8.8.8.8", "", "localhost@evil.example"):
        host, origin = ("Host", f"{name}:{port}"), ("Origin", f"http://{name}:{port}")
        assert served.get(path, host).status == 403, name
        assert served.get(path, host, origin, *UPGRADE).status == 403, name
    for name in (f"localhost:{port}", "127.0.0.1:9000", f"[::1]:{port}", "LOCALHOST"):
        assert served.get(path, ("Host", name)).status == 200, name
    assert served.get(path, ("Host", "localhost"), ("Host", "localhost")).status == 403


def test_hosts_by_the_address_that_is_served() -> None:
    def lets_in(bound: str, host: str) -> bool:
        headers = Headers([("Host", host)])
        return Door(bound, TOKEN).problem(Request(f"/{TOKEN}", headers)) is None

    assert lets_in("0.0.0.0", "192.168.1.7:8080") and lets_in("::", "[fe80::1]:8080")
    assert lets_in("192.168.1.7", "192.168.1.7") and lets_in("robot.local", "Robot.local:8080")
    assert not lets_in("0.0.0.0", "evil.example") and not lets_in("192.168.1.7", "192.168.1.8")
    assert not lets_in("127.0.0.1", "[::1") and not lets_in("127.0.0.1", "localhost:http")
    strange = Request("/\udce9", Headers([("Host", "localhost")]))
    assert "token" in str(Door("127.0.0.1", TOKEN).problem(strange))


def test_nothing_opens_a_tunnel(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    tunnels: list[Any] = []
    monkeypatch.setattr(served.page._server, "request_share_url", lambda *_: tunnels.append(1))
    refused = served.door.refused
    served.say({"type": "ShareUrlRequest"}, {"type": "ShareUrlDisconnect"}, CAMERA)
    assert not tunnels
    assert served.door.refused == refused + 2


def test_the_controls_take_what_the_robot_allows(served: Served) -> None:
    beat, size = served.uuid("Frequency"), served.uuid("Amplitude")

    def update(uuid: str, value: Any, **others: Any) -> dict[str, Any]:
        return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value, **others}}

    served.say(CAMERA, update(beat, 7), update(size, 50.0))
    until(lambda: served.asked["frequency"] == 7.0 and served.asked["amplitude"] == 0.5)
    before, refused = served.asked, served.door.refused
    wrong = [15.1, 0.0, -5, 1e308, float("nan"), float("inf"), "nan", "7", True, 2**63, [7], {}]
    bad = [update(beat, value) for value in wrong]
    bad += [update(size, value) for value in (-1, 1e6, "50", False)]
    bad += [update(beat, 6.0, visible=False), update(beat, 6.0) | {"more": 1}]
    bad += [{"type": "GuiUpdateMessage", "uuid": beat, "updates": {"update_cb": 1}}]
    bad += [update("no such control", 6.0), update(served.uuid("Plot 1"), "no such force")]
    bad += [update(served.uuid("Follow"), 0), update(served.uuid("Pause"), False)]
    bad += [{"type": "CommandTriggerMessage", "uuid": "none"}, {"type": "RunJavascriptMessage"}]
    bad += [{"type": "ResetGuiMessage"}, {"uuid": beat}, {"type": 5}, {}, [], "text", None, 7]
    bad += [CAMERA | {"fov": float("nan")}, CAMERA | {"position": [0, "x", 1]}]
    bad += [CAMERA | {"wxyz": [[1], [2]]}, {"type": "ViewerCameraMessage", "deep": {"a": {}}}]
    served.say(*bad)
    assert served.asked == before
    assert served.door.refused == refused + len(bad)
    refused = served.door.refused
    served.say(b"", "text", b"\x81" * 5000, b"\xff", os.urandom(300), raw=True)
    assert served.asked == before and served.door.refused == refused + 5
    handles = served.page._server.gui._gui_input_handle_from_uuid
    assert handles[beat].value == 7.0 and handles[beat].visible


def test_a_flight_obeys_no_command_beyond_its_range() -> None:
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    steering = flight_subject(robot, gait, None).steering
    assert steering is not None
    for command in ((steering.least, 0.0), (steering.most, steering.amplitude), (5.0, 1.0)):
        assert steering.allows(*command)
    nan, inf = float("nan"), float("inf")
    wrong = [(0.0, 1.0), (-5.0, 1.0), (15.1, 1.0), (5.0, -0.1), (5.0, steering.amplitude + 0.01)]
    for command in (*wrong, (nan, 1.0), (5.0, nan), (inf, 1.0), (5.0, inf), (1e308, 1e308)):
        assert not steering.allows(*command)

    class Lying:
        command = {"frequency": 1e6, "amplitude": nan, "paused": False, "resets": 0}

    flying = LiveFlight.__new__(LiveFlight)
    flying._view, flying._steering = Lying(), steering  # type: ignore[assignment]
    flying._paused, flying._resets, flying._asked = False, 0, (5.0, 1.0)
    flying._obey()
    assert flying._asked == (5.0, 1.0)


def test_a_message_too_large_ends_its_connection_alone(served: Served) -> None:
    async def flood() -> int:
        async with served.open() as other, served.open() as client:
            await client.send(b"x" * (LARGEST_MESSAGE + 1))
            with contextlib.suppress(ConnectionClosed):
                while True:
                    await asyncio.wait_for(client.recv(), 60)
            await other.send(msgspec.msgpack.encode(CAMERA))
            await asyncio.wait_for(other.recv(), 60)
            return client.close_code or 0

    assert asyncio.run(flood()) == 1009


def test_who_reads_nothing_keeps_nobody_waiting(served: Served) -> None:
    async def talk() -> int:
        async with served.open() as client:
            await client.send(msgspec.msgpack.encode(CAMERA))
            while not served.page._server.get_clients():
                await asyncio.sleep(0.01)
            began, shown = time.monotonic(), 0
            # of some ms each: a machine that stops for seconds has time to spare for all of them;
            # a page that waits has none, since what it waits for never comes
            while shown < 200 and time.monotonic() - began < 60.0:
                served.show()
                shown += 1
            await asyncio.wait_for(client.recv(), 60)
            return shown

    with contextlib.ExitStack() as stack:
        for _ in range(5):  # these never read what they are sent
            slow = served.connection(f"/{TOKEN}", *UPGRADE)
            stack.callback(slow.close)
        assert asyncio.run(talk()) == 200


def test_the_thread_that_serves_draws(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    """Messages of viser may be made by another thread, but may then break its own."""
    drawn: list[object] = []
    monkeypatch.setattr(served.page, "_draw", lambda _: drawn.append(asyncio.get_running_loop()))

    async def talk() -> None:
        async with served.open() as client:
            await client.send(msgspec.msgpack.encode(CAMERA))
            while not served.page._server.get_clients():
                await asyncio.sleep(0.01)
            served.show()

    asyncio.run(asyncio.wait_for(talk(), 60))
    assert drawn == [served.page._server.get_event_loop()]


def test_there_is_an_end_to_connections(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_door, "MOST_CONNECTIONS", 3)

    async def crowd() -> tuple[int, int]:
        let_in, kept_out = 0, 0
        async with contextlib.AsyncExitStack() as stack:
            for _ in range(8):
                try:
                    await stack.enter_async_context(served.open(open_timeout=60))
                    let_in += 1
                except (OSError, EOFError, websockets.exceptions.WebSocketException):
                    kept_out += 1
            return let_in, kept_out

    until(lambda: asyncio.run(crowd()) == (3, 5))
    monkeypatch.undo()
    until(lambda: status(served) == 101)


def test_a_viser_that_serves_otherwise_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = server.serve
    with pytest.raises(ParameterError, match="server of websockets"), Door("::1", TOKEN).guarding():
        assert server.serve is not plain
    assert server.serve is plain


def until(wanted: Any, patience: float = 60.0) -> None:
    limit = time.monotonic() + patience
    while not wanted():
        assert time.monotonic() < limit
        time.sleep(0.02)
