"""Independent pieces of work in two processes, one thread each, the longest first.

Neglected: memory; what a piece needs and gives travels between processes.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
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
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    cost: float


def run_jobs(
    jobs: Sequence[Job],
    progress: Callable[[float], None] | None = None,
    workers: int = WORKERS,
) -> list[Any]:
    """All jobs, the longest first.

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
    order = sorted(range(len(jobs)), key=lambda k: -jobs[k].cost)
    found: dict[int, Any] = {}
    with one_thread(), ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        waiting = {pool.submit(jobs[k].function, *jobs[k].arguments): k for k in order}
        try:
            for future in as_completed(waiting):
                number = waiting[future]
                found[number] = future.result()
                done += jobs[number].cost
                if progress is not None:
                    progress(done / total)
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise
    return [found[k] for k in range(len(jobs))]


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
