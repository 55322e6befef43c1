"""Door of the live page: who may open it, and what may be said there.

The library of the page serves whoever connects and obeys every message, even one that asks for a
public tunnel. So each request and each message passes here first:

- The path of the address begins with a random token. A cookie would do, but browsers send it to
  every port of the machine, and other people's pages may be served there.
- The Host of a request is the machine's own, so that no name of a stranger's that was pointed
  at this machine (DNS rebinding) can be used; an Origin is that of the page itself.
- A message is one of the three that the page sends, of bounded size, with values that its
  controls allow. All others are dropped and counted, and the library sees none of them.

Neglected: encryption, and strangers who keep the door busy; a learner is in another process.
"""

from __future__ import annotations

import hmac
import logging
import re
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from http import HTTPStatus
from ipaddress import ip_address
from itertools import chain
from typing import Any

import msgspec
from websockets.asyncio import server
from websockets.http11 import Request, Response

from patagium.errors import ParameterError, is_finite

LARGEST_MESSAGE = 1 << 14
"""Largest message from a page [B]; one of its camera has about 300 B."""
MOST_CONNECTIONS = 64
"""Connections at a time; more are closed."""
_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
_HOST = re.compile(r"(?:\[([0-9a-f:.]+)\]|([^\[\]:@/]+))(?::\d{1,5})?")
_Number = bool | int | float
_Flat = dict[str, str | _Number]
_MESSAGE: Any = msgspec.msgpack.Decoder(dict[str, str | _Number | list[int | float] | _Flat])
_LOGGER = logging.getLogger("patagium.live_door")  # its messages go nowhere
_LOGGER.addHandler(logging.NullHandler())
_LOGGER.propagate = False


class Door:
    """Checks of requests and messages.

    Args:
        host: Address that the page is served at.
        token: First part of the path of its address, which nobody can guess.

    Attributes:
        refused: Number of requests and messages that were refused.
    """

    def __init__(self, host: str, token: str) -> None:
        self.refused = 0
        self._token = token.encode()
        self._names = {"localhost", host.lower()}
        self._everywhere = host in ("0.0.0.0", "::")
        if self._everywhere:
            self._names.add(socket.gethostname().lower())
        self._allowed: dict[str, Callable[[Any], bool]] = {}

    def allow(self, control: Any, accepts: Callable[[Any], bool] = bool) -> Any:
        """Let messages of a control in."""
        self._allowed[control._impl.uuid] = accepts  # noqa: SLF001  it has no other
        return control

    @contextmanager
    def guarding(self) -> Iterator[None]:
        """Context in which viser begins to serve, behind the door.

        Raises:
            ParameterError: If it served in another way.
        """
        plain, begun = server.serve, []

        def serve(handler: Any, *address: Any, process_request: Any, **options: Any) -> Any:
            begun.append(address)
            options |= {"max_size": LARGEST_MESSAGE, "logger": _LOGGER}
            options |= {"create_connection": self._connection()}
            check = self._answer(process_request)
            return plain(handler, *address, process_request=check, **options)

        server.serve = serve  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            server.serve = plain  # type: ignore[misc]
        if not begun:
            raise ParameterError("viser", "a server of websockets", "another")

    def problem(self, request: Request) -> str | None:
        """Reason why a request is refused; None if it is let in."""
        hosts = request.headers.get_all("Host")
        origins = request.headers.get_all("Origin")
        if len(hosts) != 1 or not self._is_own(hosts[0].lower()):
            return "This Host is another one."
        own = [f"http://{hosts[0]}"], [f"https://{hosts[0]}"]
        if origins and origins not in own:
            return "This Origin is another page."
        token = re.split("[/?]", request.path.removeprefix("/"))[0]
        if not hmac.compare_digest(token.encode(errors="replace"), self._token):
            return "Open the whole address that was printed, with its token."
        return None

    def checked(self, raw: bytes | str) -> bytes | None:
        """Message that viser may read; None where it was refused."""
        with suppress(msgspec.MsgspecError, TypeError):
            message = _MESSAGE.decode(raw)
            if self._accepts(message):
                return msgspec.msgpack.encode(message)
        self.refused += 1
        return None

    def _is_own(self, host: str) -> bool:
        found = _HOST.fullmatch(host)
        name = "" if found is None else found[1] or found[2]
        try:
            address = ip_address(name)
        except ValueError:
            return name in self._names
        return address.is_loopback or self._everywhere or str(address) in self._names

    def _accepts(self, message: dict[str, Any]) -> bool:
        match message:
            case {"type": "ViewerCameraMessage", **numbers}:
                lists = [k if isinstance(k, list) else [k] for k in numbers.values()]
                return all(map(is_finite, chain(*lists)))
            case {"type": "CommandTriggerMessage", "uuid": str(uuid), **others}:
                return uuid in self._allowed and not others
            case {"type": "GuiUpdateMessage", "uuid": str(uuid), "updates": updates, **others}:
                accepts = self._allowed.get(uuid, lambda _: False)
                whole = list(updates) == ["value"] and not others
                return whole and accepts(updates["value"])
        return False

    def _answer(self, page: Callable[..., Response | None]) -> Callable[..., Response | None]:
        """Answer to requests: the page's to those that are let in."""

        def answer(connection: server.ServerConnection, request: Request) -> Response | None:
            problem = self.problem(request)
            if problem is not None:
                self.refused += 1
                return connection.respond(HTTPStatus.FORBIDDEN, f"{problem}\n")
            path = request.path.partition("?")[0][1 + len(self._token) :]
            found = page(connection, replace(request, path=path or "/"))
            if found is not None:
                found.headers.update(_HEADERS)
            return found

        return answer

    def _connection(self) -> type[server.ServerConnection]:
        """Connections whose messages are checked."""
        door = self

        class Guarded(server.ServerConnection):
            async def recv(self, decode: bool | None = None) -> Any:
                message = None
                while message is None:
                    message = door.checked(await super().recv(decode))
                return message

            def connection_made(self, transport: Any) -> None:
                super().connection_made(transport)
                if len(self.server.handlers) > MOST_CONNECTIONS:
                    transport.abort()

        return Guarded
