"""Jobs that depend on each other, in worker processes of one thread each.

The order is our own, because the jobs of a study wait for each other (a flight before the learners
that learn it) and joblib runs independent calls only; a graph scheduler such as Dask's would be a
dependency of every study for these few lines. So are the processes: the threads and locks of
`concurrent.futures` can stand still for good if Ctrl-C comes between two of their lines.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from multiprocessing.resource_tracker import ensure_running
from traceback import format_exc
from typing import Any

from patagium.errors import PatagiumError

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
    of its main module. They ignore Ctrl-C, which this process answers: an exception here, or one
    of a job, ends those that run at once.

    Args:
        jobs: The jobs.
        progress: Receives the part of the work that is done, 0 to 1.
        workers: Number of processes; 0: everything runs in this process.
        done_one: Receives the place and the result of each job when it is done.

    Returns:
        Result of each job, in the order of the jobs.

    Raises:
        PatagiumError: If a process ends before its job.
        Exception: What a job raised.
    """
    total, done = sum(job.cost for job in jobs), 0.0
    found = dict[int, Any]()
    with closing(_results(jobs, workers)) as results:
        for number, result in results:
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


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Context in which Ctrl-C waits, for processes that are started in it as well.

    A terminal sends Ctrl-C to all of its foreground group; this process answers it for the others.
    """
    ensure_running()  # which lets signals through when it begins
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(calls: Connection) -> None:
    """Answer calls until there are no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # for what a job starts
    answer: tuple[Any, Exception | None]
    while True:
        try:
            function, arguments = calls.recv()
        except EOFError:
            return
        try:
            answer = function(*arguments), None
        except Exception as error:
            error.add_note(format_exc())
            answer = None, error
        calls.send(answer)


def _answer(process: SpawnProcess, calls: Connection) -> Any:
    """Result of the call that a process answers."""
    try:
        result, error = calls.recv()
    except (EOFError, ConnectionError):
        process.join()
        raise PatagiumError(
            f"a process ended with exit code {process.exitcode} before its job was done; run the "
            "command again, where memory is short with fewer jobs at a time"
        ) from None
    if error is not None:
        raise error
    return result


def _results(jobs: Sequence[Job], workers: int) -> Generator[tuple[int, Any]]:
    """Place and result of each job as it is done."""
    if not workers:
        yield from ((k, job.function(*job.arguments)) for k, job in enumerate(jobs))
        return
    order, done, running = by_urgency(jobs), set[int](), dict[Connection, int]()
    processes = dict[Connection, SpawnProcess]()
    try:
        for _ in range(min(workers, len(jobs))):
            calls, theirs = get_context("spawn").Pipe()
            process = get_context("spawn").Process(target=_serve, args=(theirs,))
            with one_thread(), _no_interrupt():
                process.start()
            theirs.close()
            processes[calls] = process
        while len(done) < len(jobs):
            idle = [calls for calls in processes if calls not in running]
            ready = [k for k in order if done.issuperset(jobs[k].after)]
            for k, calls in zip(ready, idle, strict=False):
                running[calls] = k
                order.remove(k)
                with suppress(BrokenPipeError):  # its answer is then missing, too
                    calls.send((jobs[k].function, jobs[k].arguments))
            answered = wait(list(running))
            for calls in [calls for calls in running if calls in answered]:
                done.add(number := running.pop(calls))
                yield number, _answer(processes[calls], calls)
    finally:
        for process in processes.values():
            process.kill()  # in a call of C it hears nothing else
        for process in processes.values():
            process.join()
