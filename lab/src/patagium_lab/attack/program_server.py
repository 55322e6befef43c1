"""Server of programs: each request is a run of `patagium` in a fork of a process that is warm.

A request is a line of JSON on stdin, an answer a line of JSON on stdout. A fork costs hundredths
of a second where a new program costs one. Neglected: what goes wrong while modules are imported.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import signal
import sys
import time
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Any

from patagium_lab.attack.disk_faults import KINDS
from patagium_lab.attack.oracle import starved

MEMORY = 800_000_000
"""Address space that a run may take besides that of the server [B]."""
_LONG = 5.0  # s after which a run that nobody stops is asked to stop
_KEPT: list[Any] = []
_PATIENCE = 10.0  # s within which a run ends after a signal


def serve() -> None:
    """Answer requests until stdin ends."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    _warm()
    answers.write("{}\n")
    for line in sys.stdin:
        answers.write(json.dumps(_answer(json.loads(line))) + "\n")


def _warm() -> None:
    """Import what verbs import."""
    import matplotlib.pyplot  # noqa: F401
    import netCDF4  # noqa: F401
    import optuna  # noqa: F401
    import pandas  # noqa: F401
    import pint  # noqa: F401
    import scipy.io  # noqa: F401
    import xarray  # noqa: F401

    import patagium.cli.main
    import patagium.learning.identify
    import patagium.live
    import patagium.report.replay_page
    import patagium.sensing.logs.importing.inspection
    import patagium.simulation.simulator
    import patagium.viewer.replay  # noqa: F401


def _answer(request: dict[str, Any]) -> dict[str, Any]:
    """Run a request in a fork, and tell how it ended.

    Args:
        request: words (arguments), folder, aside (folder of what is said); signal and delay [s];
            nth and fault of the disk; environment.
    """
    for left in Path(request["aside"]).iterdir():
        left.unlink()  # a run that ends at once says nothing
    begun, child = time.monotonic(), os.fork()
    if child == 0:
        _run(request)
    number, delay = request.get("signal", 0), request.get("delay", _LONG)
    ended = _wait(child, begun + delay)
    late = False
    if ended is None:
        with suppress(ProcessLookupError):
            # Ctrl-C reaches all that the terminal runs, compilers among it
            os.kill(child, number) if number else os.killpg(child, signal.SIGINT)
        ended = _wait(child, time.monotonic() + _PATIENCE)
    if ended is None:
        late = True
        os.kill(child, signal.SIGKILL)
        ended = _wait(child, time.monotonic() + _PATIENCE)
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)  # what the run itself started
    status, memory = ended or (0, 0)
    return {
        "code": os.waitstatus_to_exitcode(status),
        "late": late,
        "memory": 1024 * memory,
        "seconds": time.monotonic() - begun,
        "errors": _said(Path(request["aside"]) / "errors"),
        "output": _said(Path(request["aside"]) / "output"),
        "operations": int(_said(Path(request["aside"]) / "operations") or 0),
    }


def _wait(child: int, until: float) -> tuple[int, int] | None:
    """Status and memory [kB] of a child that ends in time; None of one that does not.

    Time in which other programs held the processor does not count.
    """
    pause, before = 0.001, starved(child)
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            return status, usage.ru_maxrss
        left = until + starved(child) - before - time.monotonic()
        if left < 0:
            return None
        time.sleep(min(pause, left))
        pause = min(0.02, 1.5 * pause)


def _run(request: dict[str, Any]) -> None:
    """Run the program in this process, which ends with it."""
    code, aside = 1, Path(request["aside"])
    try:
        os.setsid()
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's job may ignore it
        for stream, name in ((1, "output"), (2, "errors")):
            os.dup2(os.open(aside / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.chdir(request["folder"])
        os.environ.update(request.get("environment", {}))
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        disk = _disk(request)
        from patagium.cli.main import run

        try:
            run([str(word) for word in request["words"]])
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
        finally:
            if disk is not None:
                seen = disk.disk_fault_seen()
                disk.disk_fault_arm(b"/nowhere", -1, 0)
                (aside / "operations").write_text(str(seen))
    except KeyboardInterrupt:  # before the program begins, too
        code = 130
    except BaseException:
        traceback.print_exc()
    finally:
        with suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _disk(request: dict[str, Any]) -> ctypes.CDLL | None:
    """Library of faults of the disk, armed; None where none is asked for."""
    if "fault" not in request:
        return None
    library = ctypes.CDLL(None)
    library.disk_fault_arm.argtypes = (ctypes.c_char_p, ctypes.c_long, ctypes.c_int)
    library.disk_fault_seen.restype = ctypes.c_long
    folder = ctypes.create_string_buffer(os.path.realpath(request["folder"]).encode())
    _KEPT.append(folder)  # the library keeps its address
    library.disk_fault_arm(folder, request["nth"], KINDS.index(request["fault"]))
    return library


def _said(path: Path) -> str:
    try:
        return path.read_bytes()[-100_000:].decode("utf-8", "replace")
    except OSError:
        return ""


if __name__ == "__main__":
    serve()
