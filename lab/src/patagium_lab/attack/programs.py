"""Targets that are whole programs: hostile options, signals and failing disks, for every verb.

Whatever comes, a program ends with a sentence or its result, without a traceback, within ten
seconds of being asked to stop; a file that it writes is the former one or a whole new one.
Neglected: studies under signals and failing disks, power that is lost.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import patagium as pt
from patagium_lab.attack.disk_faults import FULL, KINDS, injector
from patagium_lab.attack.mutation import HOSTILE, Draw, mutated_bytes
from patagium_lab.attack.oracle import LostState, Refusal, Target, WrongNumber
from patagium_lab.attack.verbs import CALLS, STUDIES, Call, prepared

AREA_OPTIONS, AREA_SIGNALS, AREA_WRITES, AREA_CACHE = "options", "signals", "writes", "cache"
_LIMIT = 40.0  # s of a case: five until a program at work is asked to stop, ten until it has
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL)
_PATHS = (
    "missing.nc", "missing/deep/x.nc", ".", "", "robot.yaml", "robot.yaml/x", "a" * 300,
    "broken-link", "loop-link", "fifo", "flight.nc", "learner.state", "-", "éü.nc", "a b.nc",
    "x.png", "x.html", "x.csv", "x.json", "\udcff.nc",
)  # fmt: skip
"""Paths within the folder of a case; nothing outside is named."""
_STUDIED = 0.1  # of the cases
LEFT_OUT = {"live", "live_address", "jobs", "help"}
"""Options that serve until stopped, that call other machines, or that start processes."""


class CrashedProgram(Exception):
    """Program that ended by a traceback or by a signal that the case did not send."""


def program_targets() -> Iterator[Target]:
    """Targets of the areas, with their shares of the cases."""
    yield Target(AREA_OPTIONS, "options of every verb", 0.25, _options, _LIMIT)
    yield Target(AREA_SIGNALS, "signals at random times", 0.12, _signals, _LIMIT)
    yield Target(AREA_WRITES, "disks that fail", 0.12, _writes, _LIMIT)
    yield Target(AREA_CACHE, "damaged libraries", 0.03, _damaged_cache, _LIMIT)


class Server:
    """Warm process that runs the program in forks.

    Args:
        folder: Empty folder for cases.
        preload: Library that is loaded before those of the system.
    """

    def __init__(self, folder: Path, preload: Path | None = None) -> None:
        self.valid, self.folder, self.aside = (folder / n for n in ("valid", "case", "aside"))
        self.valid.mkdir()
        self.aside.mkdir()
        prepared(self.valid)
        os.mkfifo(self.valid / "fifo")
        (self.valid / "broken-link").symlink_to("nothing/x")
        (self.valid / "loop-link").symlink_to("loop-link")
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        if preload is not None:
            environment["LD_PRELOAD"] = str(preload)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "patagium_lab.attack.program_server"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        self._line()

    def run(self, words: list[str], **request: Any) -> dict[str, Any]:
        """Answer to a request; see `program_server`.

        Args:
            words: Verb and its arguments.
            **request: Signal, delay, fault.
        """
        whole = {"words": words, "folder": str(self.folder), "aside": str(self.aside), **request}
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(whole) + "\n")
        self._process.stdin.flush()
        return self._line()

    def fresh(self) -> None:
        """Make the folder of the case anew, with valid files."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        for file in self.valid.iterdir():
            if file.is_symlink():
                (self.folder / file.name).symlink_to(os.readlink(file))
            elif file.is_fifo():
                os.mkfifo(self.folder / file.name)
            elif file.is_file():
                shutil.copy(file, self.folder / file.name)

    def _line(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise CrashedProgram("the server of programs died")
        found: dict[str, Any] = json.loads(line)
        return found


def _options(folder: Path) -> Callable[[Draw], None]:
    """Case of a verb with hostile options."""
    server = Server(folder)
    parameters = {call.verb: option_parameters(call.verb) for call in (*CALLS, *STUDIES)}
    environment = {"PATAGIUM_CACHE": str(folder / "cache")}
    (folder / "cache").mkdir(mode=0o700)

    def case(draw: Draw) -> None:
        server.fresh()
        calls = STUDIES if draw.random() < _STUDIED else CALLS
        call = calls[int(draw.integers(len(calls)))]
        words, options = list(call.words), parameters[call.verb]
        for _ in range(int(draw.choice([1, 1, 2, 4]))):
            words += _option(options[int(draw.integers(len(options)))], draw)
        if draw.random() < 0.15:
            words[int(draw.integers(1, len(words)))] = str(draw.choice(_PATHS))
        own = environment if call.verb == "cache" else {}  # `--clear` clears it
        _judge(server.run(words, environment=own), words, {0, 2, 130})

    return case


def option_parameters(verb: str) -> list[Any]:
    """Options of a verb that a case may draw, as the parser of the command line has them.

    Args:
        verb: Its name, with that of its group.
    """
    from patagium.cli.main import program

    command: Any = program()
    for word in verb.split():
        command = command.commands[word]
    options = [p for p in command.params if p.param_type_name == "option"]
    return [p for p in options if p.name not in LEFT_OUT]


def _option(parameter: Any, draw: Draw) -> list[str]:
    """Words of an option with a hostile value."""
    name = str(draw.choice(parameter.opts))
    if parameter.is_flag:
        return [name]
    if "Path" in repr(parameter.type_descriptor.annotation):
        return [name, str(draw.choice(_PATHS))]
    value = str(HOSTILE[int(draw.integers(len(HOSTILE)))])
    if "\x00" in value or "\ud800" in value or value.startswith(("/", ".")):
        value = "\udcff"  # no word of a command line holds the former, the latter leave the folder
    return [name, value[:2000]]


def _damaged_cache(folder: Path) -> Callable[[Draw], None]:
    """Case of a program whose cache of compiled libraries has a damaged file."""
    server, call = Server(folder), next(c for c in CALLS if c.verb == "simulate")
    valid, damaged = folder / "cache", folder / "damaged"
    valid.mkdir(mode=0o700)
    server.fresh()
    environment = {"PATAGIUM_CACHE": str(valid)}
    _judge(server.run(list(call.words), environment=environment, delay=120.0), call.words, {0})
    clean = pt.load_flight(server.folder / "out.nc")

    def case(draw: Draw) -> None:
        server.fresh()
        shutil.rmtree(damaged, ignore_errors=True)
        shutil.copytree(valid, damaged)
        files = sorted(path for path in damaged.rglob("*") if path.is_file())
        file = files[int(draw.integers(len(files)))]
        if draw.random() < 0.2:
            file.write_bytes(files[int(draw.integers(len(files)))].read_bytes())
        else:
            file.write_bytes(mutated_bytes(file.read_bytes(), draw))
        found = server.run(
            list(call.words), environment={"PATAGIUM_CACHE": str(damaged)}, delay=30.0
        )
        _judge(found, call.words, {0})
        flown = pt.load_flight(server.folder / "out.nc")
        for name in ("q", "v", "a"):
            if not np.array_equal(flown[name].to_numpy(), clean[name].to_numpy()):
                raise WrongNumber(f"{name} differs with a damaged {file.name[-20:]}")

    return case


@dataclass(frozen=True)
class Usual:
    """Call of a verb that nothing disturbs.

    Attributes:
        seconds: Its duration [s].
        operations: Number of its operations that change the folder.
        former: Content of its outputs.
    """

    seconds: float
    operations: int
    former: dict[str, bytes]


def _usual(server: Server, call: Call, **request: Any) -> Usual:
    server.fresh()
    answer = server.run(list(call.words), delay=60.0, **request)
    _judge(answer, call.words, {0})
    former = {name: (server.folder / name).read_bytes() for name in call.outputs}
    return Usual(answer["seconds"], answer["operations"], former)


def _drawn(
    server: Server, calls: Sequence[Call], usual: dict[Call, Usual], draw: Draw, **request: Any
) -> tuple[Call, dict[str, bytes]]:
    """Call of a case, and the outputs that are there before it; its folder is made."""
    call = calls[int(draw.integers(len(calls)))]
    if call not in usual:
        usual[call] = _usual(server, call, **request)
    server.fresh()
    former = usual[call].former if draw.random() < 0.5 else {}
    for name, content in former.items():
        (server.folder / name).write_bytes(content)
    return call, former


def _signals(folder: Path) -> Callable[[Draw], None]:
    """Case of a verb that gets a signal at a random time."""
    server, usual = Server(folder), dict[Call, Usual]()

    def case(draw: Draw) -> None:
        call, former = _drawn(server, CALLS, usual, draw)
        number = int(draw.choice(_SIGNALS))
        delay = float(draw.uniform(0.0, 1.1 * usual[call].seconds))
        answer = server.run(list(call.words), signal=number, delay=delay)
        _judge(answer, call.words, {0, 2, 130, 143, 129, -number})
        _check_outputs(server.folder, call, former, clean=number == signal.SIGINT)

    return case


def _writes(folder: Path) -> Callable[[Draw], None]:
    """Case of a verb on a disk that fails from the nth operation on."""
    server, usual = Server(folder, injector(folder)), dict[Call, Usual]()
    calls = [call for call in CALLS if call.outputs]

    def case(draw: Draw) -> None:
        call, former = _drawn(server, calls, usual, draw, nth=-1, fault=FULL)
        nth, fault = int(draw.integers(usual[call].operations + 1)), str(draw.choice(KINDS))
        answer = server.run(list(call.words), nth=nth, fault=fault, delay=60.0)
        _judge(answer, call.words, {0, 2})
        _check_outputs(server.folder, call, former, clean=True)
        _check_words(server.folder, call, former, answer)
        if answer["code"] == 2:
            raise Refusal(answer["errors"])

    return case


def _check_outputs(folder: Path, call: Call, former: dict[str, bytes], *, clean: bool) -> None:
    """Refuse outputs that are neither the former ones nor whole, and drafts that are left.

    Raises:
        LostState: If a file that was there is gone, or an output does not load.
        WrongNumber: If a draft is left where the program ended by itself.
    """
    for name, read in call.outputs.items():
        path = folder / name
        if not path.exists():
            if name in former:
                raise LostState(f"{name}: it was there before, and is gone")
            continue
        if path.read_bytes() == former.get(name):
            continue
        try:
            read(path)
        except Exception as problem:
            raise LostState(f"{name}: neither the former nor a whole file: {problem}") from None
    endings = (".part", ".lock", ".rename")
    left = [path.name for path in folder.iterdir() if path.name.endswith(endings)]
    if clean and left:
        raise LostState(f"drafts or locks were left: {left}")


def _check_words(
    folder: Path, call: Call, former: dict[str, bytes], answer: dict[str, Any]
) -> None:
    """Refuse an end that does not name what was not saved; before any work one place is enough.

    Raises:
        WrongNumber: If an output was not written, and no word says so.
    """
    missing = {name for name in call.outputs.keys() - former.keys() if not (folder / name).exists()}
    named = {name for name in missing if name in answer["errors"]}
    if missing and answer["code"] == 0:
        raise WrongNumber(f"{missing}: not written, and the exit code is 0")
    refused = "not saved: " not in answer["errors"] and ": cannot be written" in answer["errors"]
    if missing != named and not refused:
        raise WrongNumber(f"{missing - named}: not written, and no word says so")


def _judge(answer: dict[str, Any], words: Any, codes: set[int]) -> None:
    """Refuse an end that no program may have.

    Raises:
        CrashedProgram: If there is a traceback, an exit code of another kind, or too much memory.
        Refusal: If the program refused its work with a sentence.
        WrongNumber: If it refused without one.
    """
    shown = f"{' '.join(str(word)[:60] for word in words)!r}"
    if answer["late"]:
        raise CrashedProgram(f"it did not end within 10 s of a signal: {shown}")
    if "Traceback (most recent" in answer["errors"] or answer["code"] not in codes:
        last = [line for line in answer["errors"].splitlines() if line.strip()][-1:]
        raise CrashedProgram(f"exit code {answer['code']}: {''.join(last)[:200]} of {shown}")
    with suppress(KeyError):
        if len(answer["errors"]) > 50_000:
            raise WrongNumber(f"{len(answer['errors'])} characters on stderr of {shown}")
    if answer["code"] == 2 and codes == {0, 2, 130}:
        if not answer["errors"].strip():
            raise WrongNumber(f"a refusal without words of {shown}")
        raise Refusal(answer["errors"][:2000])
