"""Processes that run the cases of a target, watched from outside.

A process that dies or never returns costs one case; the next one begins after it. Neglected:
damage that one case does to the process and that shows in a later one.
"""

from __future__ import annotations

import os
import resource
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from patagium_lab.attack.oracle import Finding, Target, judged, starved

MEMORY = 800_000_000
"""Largest memory of a process [B]."""
_PATIENCE = 5.0  # s that a case may hold the interpreter beyond its limit
_PREPARATION = 240.0  # s
_MOST_FINDINGS = 50


@dataclass
class Tally:
    """Verdicts on the cases of a target.

    Attributes:
        area: Area of the target.
        target: Name of the target.
        cases: Number of cases.
        answered: Cases that were answered.
        refused: Cases that were refused with words.
        peak: Largest memory of a process [B].
        seconds: Duration of all cases [s].
        findings: Cases that ended as none may, the first of each kind and place.
        counts: Number of findings of each kind.
    """

    area: str
    target: str
    cases: int = 0
    answered: int = 0
    refused: int = 0
    peak: int = 0
    seconds: float = 0.0
    findings: list[Finding] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)

    def take(self, number: int, verdict: str, words: str) -> None:
        """Count a verdict."""
        self.cases += 1
        if verdict == "answered":
            self.answered += 1
        elif verdict == "refused":
            self.refused += 1
        else:
            self.counts[verdict] = self.counts.get(verdict, 0) + 1
            if len(self.findings) < _MOST_FINDINGS:
                self.findings.append(Finding(self.target, number, verdict, words))


def generator(seed: int, target: str, number: int) -> np.random.Generator:
    """Generator of a case, the same wherever and whenever it is made.

    Args:
        seed: Seed of the campaign.
        target: Name of the target.
        number: Number of the case.
    """
    return np.random.default_rng([seed, crc32(target.encode()), number])


def attacked(target: Target, seed: int, cases: int) -> Tally:
    """Verdicts on the cases 0 to `cases - 1` of a target, run in processes of their own.

    Args:
        target: What is attacked.
        seed: Seed of the campaign.
        cases: Number of cases.
    """
    tally, begun, first = Tally(target.area, target.name), time.monotonic(), 0
    while first < cases:
        first = _one_process(target, seed, range(first, cases), tally)
    tally.seconds = time.monotonic() - begun
    return tally


def attacked_here(target: Target, seed: int, numbers: range) -> Tally:
    """Verdicts on some cases of a target, run in this process.

    Args:
        target: What is attacked.
        seed: Seed of the campaign.
        numbers: Numbers of the cases.
    """
    tally = Tally(target.area, target.name)
    with tempfile.TemporaryDirectory(prefix="patagium-") as folder:
        case = target.prepare(Path(folder))
        for number in numbers:
            tally.take(number, *_verdict(target, case, generator(seed, target.name, number)))
    tally.peak = peak_memory()
    return tally


def peak_memory() -> int:
    """Largest memory of this process so far [B]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _one_process(target: Target, seed: int, numbers: range, tally: Tally) -> int:
    """Run cases until one ends the process; number of the next case."""
    context = get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_run, args=(target, seed, numbers, sender), daemon=True)
    process.start()
    sender.close()
    number, prepared, ended = numbers.start, False, False
    patience, before = _PREPARATION, 0.0
    while True:
        if not receiver.poll(patience):
            waited, before = starved(process.pid or 0) - before, starved(process.pid or 0)
            if waited > 1.0:  # other programs held the processor
                patience = waited
                continue
            process.kill()
            tally.take(number, "hang", f"the process did not come back within {patience:g} s")
            number += 1
            break
        try:
            message: Any = receiver.recv()
        except EOFError:
            break
        if message is None:
            ended = True
            break
        prepared, patience, before = True, target.limit + _PATIENCE, starved(process.pid or 0)
        if message == "ready":
            continue
        number, verdict, words, peak = message
        tally.take(number, verdict, words)
        tally.peak = max(tally.peak, peak)
        number += 1
    process.join(1.0)
    if not ended and process.exitcode != -9:
        tally.take(number, "crash", f"the process died: exit code {process.exitcode}")
        number += 1
    return number if prepared and not ended else numbers.stop


def _run(target: Target, seed: int, numbers: range, sender: Any) -> None:
    """Cases of a target in this process; what is said on the way goes nowhere."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2) if not os.environ.get("LOUD") else ():
        os.dup2(nowhere, stream)
    with tempfile.TemporaryDirectory(prefix="patagium-", dir=_fast_folder()) as folder:
        case = target.prepare(Path(folder))
        _limit_memory()
        sender.send("ready")
        for number in numbers:
            verdict, words = _verdict(target, case, generator(seed, target.name, number))
            sender.send((number, verdict, words, peak_memory()))
    sender.send(None)


def _verdict(
    target: Target, case: Callable[[Any], object], draw: np.random.Generator
) -> tuple[str, str]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return judged(partial(case, draw), target.limit)


def _limit_memory() -> None:
    """Refuse this process more address space than it has now and `MEMORY`."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))


def _fast_folder() -> str | None:
    """Folder in memory where there is one."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None  # noqa: S108
