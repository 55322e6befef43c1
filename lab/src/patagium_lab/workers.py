"""Pieces of work in two processes, one thread each, the longest line of them first.

Neglected: memory; what a piece needs and gives travels between processes.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

WORKERS = 2
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Job:
    """A call to make in a worker.

    Attributes:
        function: Found by its module and name.
        arguments: What it is called with.
        cost: About how long it takes, for order and progress [s].
        after: Places of jobs, before it in the list, that must be done first.
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    cost: float
    after: tuple[int, ...] = ()


def run_jobs(
    jobs: Sequence[Job],
    progress: Callable[[float], None] | None = None,
    workers: int = WORKERS,
) -> list[Any]:
    """All jobs, of those that can be begun the one with the longest work behind it first.

    Processes are started afresh, not forked: a script that calls this needs the usual guard
    of its main module.

    Args:
        jobs: What to do.
        progress: Told the part of the work done.
        workers: Number of processes.

    Returns:
        What each job gave, in the order of the jobs.
    """
    total, done = sum(job.cost for job in jobs), 0.0
    order, found = by_urgency(jobs), dict[int, Any]()
    running: dict[Future[Any], int] = {}
    with one_thread(), ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        try:
            while len(found) < len(jobs):
                ready = [k for k in order if all(before in found for before in jobs[k].after)]
                for k in ready[: workers - len(running)]:
                    running[pool.submit(jobs[k].function, *jobs[k].arguments)] = k
                    order.remove(k)
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    number = running.pop(future)
                    found[number] = future.result()
                    done += jobs[number].cost
                    if progress is not None:
                        progress(done / total)
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise
    return [found[k] for k in range(len(jobs))]


def by_urgency(jobs: Sequence[Job]) -> list[int]:
    """Places of jobs: first those with the longest time to the end of what waits for them.

    Args:
        jobs: Each after others that stand before it.
    """
    left, behind = [0.0] * len(jobs), [0.0] * len(jobs)
    for k in reversed(range(len(jobs))):
        left[k] = jobs[k].cost + behind[k]
        for before in jobs[k].after:
            behind[before] = max(behind[before], left[k])
    return sorted(range(len(jobs)), key=lambda k: -left[k])


@contextmanager
def one_thread() -> Iterator[None]:
    """Processes started meanwhile compute on one thread each."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name)
            else:
                os.environ[name] = value
