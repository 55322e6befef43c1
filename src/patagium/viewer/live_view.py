"""The live page's own process: a learner's is never kept waiting by a picture.

The page is served by viser in a process of its own, at a lower priority, which reads frames from
a mailbox and sends commands through another. Where it hangs, frames are overwritten; where it
dies, nobody else does. Both processes are on one machine and share memory. The address has a
random token, new each time: who does not have it sees nothing.
"""

from __future__ import annotations

import os
import secrets
import signal
import socket
import sys
import time
from contextlib import AbstractContextManager, suppress
from importlib.util import find_spec
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from patagium.errors import ParameterError
from patagium.live.sources import is_loopback
from patagium.viewer.live_frames import COMMAND, SLOTS, Mailbox, Subject

PERIOD = 1.0 / 30.0
"""Between two frames [s]."""
_PATIENCE = 300.0  # s for the process to start on a busy machine
_FAREWELL = 3.0  # s for it to end by itself
_COURTESY = 5  # how much lower its priority is while others learn
_COMMANDS = 4  # of which only the last counts


class LiveView(AbstractContextManager["LiveView"]):
    """A live page, served until it is closed.

    Args:
        subject: Subject of the page.
        host: Address it is served at.
        port: Port; 0: any that is free.

    Attributes:
        loopback: Whether only this machine can reach the page.

    Raises:
        ParameterError: If viser is not installed, or the page cannot be served there.
    """

    def __init__(self, subject: Subject, host: str, port: int) -> None:
        if find_spec("viser") is None:
            raise ParameterError("live view", "viser: pip install 'patagium[viewer]'", None)
        self.loopback = is_loopback(_bound(host, port))
        self._token = secrets.token_urlsafe(32)
        self.letters = Mailbox(subject.layout, SLOTS)
        self._commands = Mailbox(COMMAND, _COMMANDS)
        self.subject = subject
        self._command: Any = None
        spawn = get_context("spawn")
        self._pipe, other = spawn.Pipe()
        words = (subject, host, port, self._token, self.letters, self._commands, other)
        self._process = spawn.Process(target=_serve, args=words, daemon=True, name="live view")
        self._process.start()
        other.close()
        self._told = False
        self.port = self._answer(host, port)
        self.host = host

    @property
    def address(self) -> str:
        """Address for a browser, with the token that lets it in."""
        host = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(self.host, self.host)
        place = f"[{host}]" if ":" in host and host[0] != "[" else host
        return f"http://{place}:{self.port}/{self._token}"

    @property
    def command(self) -> Any:
        """Last command from the page, a record of `COMMAND`; None before the first."""
        found = self._commands.take()
        if found:
            self._command = found[-1]
        return self._command

    def problem(self) -> str | None:
        """Reason why the page ended, given once; None while it runs."""
        if self._told or self._process.is_alive():
            return None
        self._told = True
        reason = f"exit code {self._process.exitcode}"
        with suppress(EOFError, OSError):
            if self._pipe.poll():
                reason = str(self._pipe.recv()[1])
        return reason

    def close(self) -> None:
        """End the page."""
        self._pipe.close()
        self._process.join(_FAREWELL)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._told = True

    def __exit__(self, *_: object) -> None:
        self.close()

    def _answer(self, host: str, port: int) -> int:
        expected = f"an address where a page can be served, {host}:{port}"
        try:
            if self._pipe.poll(_PATIENCE):
                served, reason = self._pipe.recv()
                if served is not None:
                    return int(served)
            else:
                reason = f"no answer in {_PATIENCE:g} s"
        except EOFError:
            reason = "its process ended"
        self.close()
        raise ParameterError("live view", expected, reason)


def _bound(host: str, port: int) -> str:
    """Address in numbers that a page would be served at.

    Raises:
        ParameterError: If it is taken, or not one of this machine.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
            probe.listen(1)
            return str(probe.getsockname()[0])
        except OSError as error:
            expected = "one of this machine with a free port (--live-address HOST:PORT)"
            raise ParameterError("live address", expected, f"{host}:{port}") from error


def _serve(
    subject: Subject,
    host: str,
    port: int,
    token: str,
    letters: Mailbox,
    commands: Mailbox,
    pipe: Connection,
) -> None:
    """The process: serve until the other end of the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that flies
    sys.stdout = open(os.devnull, "w")  # noqa: SIM115
    try:
        from patagium.viewer.live_page import LivePage

        page = LivePage(subject, host, port, token, commands)
        pipe.send((page.port, ""))
        os.nice(_COURTESY)
        due = time.monotonic()
        while not pipe.poll(max(0.0, due - time.monotonic())):
            due = time.monotonic() + PERIOD
            page.show(letters.take(), letters.sent)
        page.close()
    except (EOFError, BrokenPipeError):
        pass
    except Exception as error:
        pipe.send((None, f"{type(error).__name__}: {error}"))
