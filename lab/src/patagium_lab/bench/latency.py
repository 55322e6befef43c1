"""Latency of a learner from packet to prediction: median and tail.

The whole pipeline runs in C, one packet a call, on one core, alone or beside processes that load
the other cores, as fast as it can or at the pace of a sensor. Neglected: real-time scheduling, and
the bus of the packets.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.aerodynamics import Air, QuasiSteady
from patagium.arrays import Array
from patagium.errors import ParameterError
from patagium.learning.default_learner import default_learner
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.models.strip import StripNetwork
from patagium.live.packets import flight_packets
from patagium.live.pipeline import Pipeline
from patagium.native import load_kernel
from patagium.robot import load_robot
from patagium.sensing.force.air_force import training_data
from patagium.simulation import gaits, simulate
from patagium_lab.kernels import KERNELS
from patagium_lab.study import Progress
from patagium_lab.timing import one_core

TIME_STEP = 1e-4
"""Between packets where they are paced: 10 kHz [s]."""
QUANTILES = {"p50": 0.5, "p99": 0.99, "p999": 0.999, "slowest": 1.0}
LOADS = ("alone", "other cores busy", "all cores busy")
_CHUNK = 50_000
_BURN = "import os, sys\nos.sched_setaffinity(0, {int(sys.argv[1])})\nwhile True: pass"


@dataclass(frozen=True)
class Latency:
    """Times of a pipeline's calls.

    Attributes:
        learner: Name of the learner.
        load: Load of the machine.
        paced: Whether packets came at 10 kHz, or one after the other.
        samples: Number of calls.
        duration: Quantiles of the time of a call [s].
        response: Quantiles of the time from when a packet was due until it was learned [s].
    """

    learner: str
    load: str
    paced: bool
    samples: int
    duration: dict[str, float]
    response: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """The times as JSON-able values."""
        return asdict(self)


def measure_latency(
    samples: int = 1_000_000,
    loads: Sequence[str] = LOADS[:2],
    pacing: Sequence[bool] = (False, True),
    progress: Progress | None = None,
) -> list[Latency]:
    """Times of the pipeline with the paper's network, the strip network and the default learner.

    Args:
        samples: Calls of each case.
        loads: Some of `LOADS`: processes that burn no core, all but ours, or all.
        pacing: Whether packets come at 10 kHz, each case.
        progress: Receives the case and the part of all that is done.

    Raises:
        ParameterError: If there is no such load, or no compiler.
    """
    for load in loads:
        if load not in LOADS:
            raise ParameterError("loads", f"some of {', '.join(LOADS)}", load)
    pipelines, packets = _pipelines()
    cases = [(n, load, p) for n in pipelines for load in loads for p in pacing]
    found = []
    for number, (name, load, paced) in enumerate(cases):
        if progress is not None:
            progress(f"{name}, {load}", number / len(cases))
        with one_core() as core, _burning(load, core):
            times = call_times(pipelines[name](), packets, samples, paced)
        found.append(Latency(name, load, paced, samples, *map(_quantiles, times)))
    return found


def call_times(
    pipeline: Pipeline, packets: Array, samples: int, paced: bool
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Duration and response of each call, (samples,) [ns].

    Args:
        pipeline: Pipeline that is timed; its learner learns.
        packets: Packets that are used again and again, (N, 1 + n_q + 3 n) [SI units].
        samples: Number of calls.
        paced: Whether packets come at 10 kHz, or one after the other.

    Raises:
        ParameterError: If the pipeline is not compiled.
    """
    kernel, chain = load_kernel("latency", folder=KERNELS), pipeline.chain
    if kernel is None or chain is None:
        raise ParameterError("pipeline", "a compiled one", "Python")
    rows = np.ascontiguousarray(packets)
    row, record = np.empty(rows.shape[1]), np.empty(3 * pipeline.learner.network.outputs + 4)
    period = 1e9 * TIME_STEP if paced else 0.0
    memory = _Paced(
        *chain.native, *rows.shape, *(a.ctypes.data for a in (rows, row, record)), TIME_STEP, period
    )
    times = np.empty((2, samples), np.float32)
    for first in range(0, samples, _CHUNK):
        part = times[:, first : first + _CHUNK]
        kernel.latency_run(
            ctypes.byref(memory),
            *(ctypes.c_int64(k) for k in (first, part.shape[1])),
            *(ctypes.c_void_p(side.ctypes.data) for side in part),
        )
    return times[0], times[1]


class _Paced(ctypes.Structure):
    """`paced` of the kernel, field by field."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("function", "pipeline")),
        *((name, ctypes.c_int64) for name in ("rows", "columns")),
        *((name, ctypes.c_void_p) for name in ("packets", "row", "record")),
        *((name, ctypes.c_double) for name in ("time_step", "period")),
    ]


def _pipelines() -> tuple[dict[str, Callable[[], Pipeline]], Array]:
    """Pipelines that are timed, by name, and their packets."""
    robot = load_robot("aerobat")
    gait = gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    air = QuasiSteady(robot, Air())
    start = robot.coordinates(x=3.0)
    flight = simulate(robot, air, gait, duration=0.4, time_step=TIME_STEP, v=start)
    _, x, y = training_data(flight, robot)
    still = x.std(axis=0) < 1e-9
    dense = DenseNetwork(
        2 * robot.dof, (20,), robot.dof_names, input_center=x.mean(axis=0),
        input_scale=np.where(still, 1.0, x.std(axis=0)),
        output_scale=np.maximum(y.std(axis=0), 1e-3),
    )  # fmt: skip
    strip = StripNetwork(robot)

    def made(network: Any, noise: float, **options: Any) -> Callable[[], Pipeline]:
        def make() -> Pipeline:
            learner = CubatureLearner(
                network, prior_std=0.3, measurement_std=noise, spread=1.7,
                forgetting_factor=0.9999, **options,
            )  # fmt: skip
            return Pipeline(learner, robot)

        return make

    found = {
        "dense 28-20-14, one block a neuron": made(dense, 3e-3, covariance="node"),
        "dense 28-20-14, one block a neuron, float32": made(
            dense, 3e-3, covariance="node", dtype="float32"
        ),
        "strip 2-8-8-2, full covariance": made(strip, 3e-4),
        "strip 2-8-8-2, full covariance, float32": made(strip, 3e-4, dtype="float32"),
        "default of aerobat": lambda: Pipeline(default_learner(robot), robot),
    }
    return found, flight_packets(flight)


@contextlib.contextmanager
def _burning(load: str, core: int | None) -> Iterator[None]:
    """Load on the cores while the context lasts."""
    cores = set(range(os.cpu_count() or 1)) if core is not None and load != LOADS[0] else set()
    if load == LOADS[1]:
        cores -= {core} if core is not None else set()
    burners = [subprocess.Popen([sys.executable, "-c", _BURN, str(k)]) for k in sorted(cores)]
    if burners:
        time.sleep(0.2)  # until they run
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


def _quantiles(nanoseconds: NDArray[np.float32]) -> dict[str, float]:
    found = np.quantile(nanoseconds, list(QUANTILES.values())) * 1e-9
    return dict(zip(QUANTILES, found.tolist(), strict=True))
