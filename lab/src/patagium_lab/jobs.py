"""Jobs that depend on each other, in worker processes of one thread each.

The processes are those of `concurrent.futures`. The order is our own, because the jobs of a study
wait for each other (a flight before the learners that learn it) and joblib runs independent calls
only; a graph scheduler such as Dask's would be a dependency of every study for these few lines.
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
    """A call to make in a worker process.

    Attributes:
        function: Function at the top level of a module, so that a worker can import it.
        arguments: Arguments of the call.
        cost: Expected duration, for order and progress [s].
        after: Places, in the list of jobs, of earlier jobs that must be done first.
        urgent: Whether it and the jobs that it waits for begin before all others.
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    cost: float
    after: tuple[int, ...] = ()
    urgent: bool = False


def run_jobs(
    jobs: Sequence[Job],
    progress: Callable[[float], None] | None = None,
    workers: int = WORKERS,
    done_one: Callable[[int, Any], None] | None = None,
) -> list[Any]:
    """Results of all jobs; among jobs that can begin, the longest chain of work begins first.

    Processes are started afresh, not forked: a script that calls this needs the usual guard
    of its main module.

    Args:
        jobs: The jobs.
        progress: Receives the part of the work that is done, 0 to 1.
        workers: Number of processes; 0: everything runs in this process.
        done_one: Receives the place and the result of each job when it is done.

    Returns:
        Result of each job, in the order of the jobs.
    """
    total, done = sum(job.cost for job in jobs), 0.0
    found = dict[int, Any]()
    for number, result in _results(jobs, workers):
        found[number] = result
        if done_one is not None:
            done_one(number, result)
        done += jobs[number].cost
        if progress is not None:
            progress(done / total)
    return [found[k] for k in range(len(jobs))]


def by_urgency(jobs: Sequence[Job]) -> list[int]:
    """Places of the jobs: urgent ones, then those with the longest chain of work behind them.

    Args:
        jobs: Jobs, each after others that stand before it.
    """
    left, behind = [0.0] * len(jobs), [0.0] * len(jobs)
    urgent = [job.urgent for job in jobs]
    for k in reversed(range(len(jobs))):
        left[k] = jobs[k].cost + behind[k]
        for before in jobs[k].after:
            behind[before] = max(behind[before], left[k])
            urgent[before] |= urgent[k]
    return sorted(range(len(jobs)), key=lambda k: (not urgent[k], -left[k]))


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit processes that are started in this context to one thread of computation each."""
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


def _results(jobs: Sequence[Job], workers: int) -> Iterator[tuple[int, Any]]:
    """Place and result of each job as it is done."""
    if not workers:
        yield from ((k, job.function(*job.arguments)) for k, job in enumerate(jobs))
        return
    order, done, running = by_urgency(jobs), set[int](), dict[Future[Any], int]()
    with one_thread(), ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        try:
            while len(done) < len(jobs):
                ready = [k for k in order if done.issuperset(jobs[k].after)]
                for k in ready[: workers - len(running)]:
                    running[pool.submit(jobs[k].function, *jobs[k].arguments)] = k
                    order.remove(k)
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    number = running.pop(future)
                    done.add(number)
                    yield number, future.result()
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise
