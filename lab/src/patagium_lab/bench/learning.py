"""Times of the air, of networks, of updates, of a flight and of compiling.

The force of the air by its equations stands beside networks that learn it. The errors of the
networks belong to the reproduction.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import cycle

import casadi as ca
import numpy as np

from patagium.aerodynamics import Air, QuasiSteady
from patagium.aerodynamics.model import compile_aero
from patagium.arrays import Array
from patagium.errors import ParameterError
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.models.network import Network
from patagium.learning.models.strip import StripNetwork
from patagium.learning.models.wing import WingNetwork
from patagium.native import NativeFunction, load_functions
from patagium.native.compiler import compiler_command
from patagium.robot import load_robot
from patagium.robot.model import Robot
from patagium.simulation import gaits, simulate
from patagium_lab.bench.dynamics import random_states
from patagium_lab.bench.latency import LOADS, measure_latency
from patagium_lab.bench.result import Result, compared
from patagium_lab.bench.update import (
    full_covariance_results,
    noise_results,
)
from patagium_lab.comparisons import seconds_text
from patagium_lab.timing import (
    compiled_call,
    one_core,
    time_batch,
    time_call,
    time_python,
)

_BATCH = 4096
PACKETS = 50_000
"""Number of packets of each case of the pipeline."""
_AIR = "aerodynamic_force"
_BATCH_NOTE = f"a state, {_BATCH} in one Python call, everything included"


def networks(robot: Robot) -> dict[str, Network]:
    """The networks of the reproduction: the paper's size, the whole state, the strips."""
    n = robot.dof
    return {
        "network dense 8-20-14 (474 weights)": DenseNetwork(8, (20,), robot.dof_names),
        f"network dense {2 * n}-20-{n} (874 weights)": DenseNetwork(2 * n, (20,), robot.dof_names),
        "network strip 2-8-8-2 (114 weights)": StripNetwork(robot),
    }


def air_results(robot: Robot) -> Iterator[Result]:
    """The force of the air by its equations, and each network beside it.

    Args:
        robot: A machine with strips.
    """
    states, many = random_states(robot, 512), random_states(robot, _BATCH, seed=1)
    model = QuasiSteady(robot, Air())
    function = compile_aero(model)["generalized_force"]
    fixed = [np.zeros(0), np.zeros(3), robot.parameters, model.parameters]
    actual = _time(function, [states.q, states.v, *fixed])
    batch = time_batch(lambda: model.batch.generalized_force(many.q, many.v), _BATCH)
    yield Result(_AIR, actual, "ns", note=f"{len(robot.strips)} strips, one state a call")
    yield Result(f"{_AIR} batch", batch, "ns", note=_BATCH_NOTE)
    for name, network in networks(robot).items():
        weights = network.initial(0)
        x = np.hstack([states.q, states.v])[:, : network.inputs]
        estimated = network_cost(network, x)
        yield compared(name, estimated, "ns", _AIR, actual, "one state a call")
        x = np.hstack([many.q, many.v])[:, : network.inputs]
        value = time_batch(lambda n=network, x=x, w=weights: n.evaluate(x, w), _BATCH)  # type: ignore[misc]
        yield compared(f"{name} batch", value, "ns", f"{_AIR} batch", batch, _BATCH_NOTE)


def network_cost(network: Network, x: Array) -> float:
    """Time of a network's answer, one state a call, compiled [ns].

    Args:
        network: A dense one, or one that knows the wings.
        x: Inputs of the network, (N, n_x) [SI units].
    """
    return _time(compiled_network(network), [x, network.initial(0)])


def compiled_network(network: Network) -> NativeFunction:
    """A network as a compiled function of x and its weights.

    Args:
        network: A dense one, or one that knows the wings.
    """
    key = f"network {network.describe()}"
    return load_functions(key, lambda: [_expression(network)], label="a network")["network"]


def _expression(network: Network) -> ca.Function:
    x, weights = ca.SX.sym("x", network.inputs), ca.SX.sym("w", network.size)
    if isinstance(network, WingNetwork):
        features, readout = network.encoding(x)
        items = ca.reshape(features, -1, network.items)
        offset = np.zeros(network.outputs)
    elif isinstance(network, DenseNetwork):
        items = (x - network.input_center) / network.input_scale
        readout, offset = ca.DM(np.diag(network.output_scale)), network.output_center
    else:
        raise ParameterError("network", "a dense network, or one of the wings", network)
    widths, start = network.perceptron.widths, network.size - network.perceptron.size
    layer = items
    for number, (below, above) in enumerate(zip(widths, widths[1:], strict=False)):
        matrix = ca.reshape(weights[start : start + below * above], below, above).T
        bias = weights[start + below * above : start + (below + 1) * above]
        start += (below + 1) * above
        if number:
            soft = network.perceptron.activation == "softplus"
            layer = (
                ca.fmax(layer, 0) + ca.log1p(ca.exp(-ca.fabs(layer))) if soft else ca.tanh(layer)
            )
        layer = matrix @ layer + ca.repmat(bias, 1, layer.shape[1])
    y = offset + readout @ ca.vec(layer)
    return ca.Function("network", [x, weights], [y], ["x", "weights_parameters"], ["y"])


def update_results(robot: Robot) -> Iterator[Result]:
    """One update of each learner, as a user calls it, beside what it cannot do without.

    Args:
        robot: A machine with strips.
    """
    for name, network in networks(robot).items():
        setting = {"prior_std": 0.3, "measurement_std": 0.003, "spread": 3**0.5}
        value = _update_time(CubatureLearner(network, **setting), robot)  # type: ignore[arg-type]
        note = "Python call, everything included"
        if isinstance(network, DenseNetwork):
            products = matrix_products(network.size, network.outputs)
            against = "its two dominant matrix products"
            note += "; S Z and the rank-n_y change of S, by NumPy's BLAS, one thread"
            yield compared(f"update of {name}", value, "ns", against, products, note)
        else:
            yield Result(f"update of {name}", value, "ns", note=note)
        single = CubatureLearner(network, dtype="float32", **setting)  # type: ignore[arg-type]
        faster = _update_time(single, robot)
        yield compared(f"update in float32 of {name}", faster, "ns", "float64", value)
        plain = CubatureLearner(network, square_root="cholesky", **setting)  # type: ignore[arg-type]
        yield compared(
            f"update of {name}",
            value,
            "ns",
            "Algorithm 1 (cholesky)",
            _update_time(plain, robot, 8),
        )
    yield from full_covariance_results(robot)
    yield from noise_results(robot)


def _update_time(learner: Learner, robot: Robot, count: int = 100) -> float:
    """Median time of an update [ns]."""
    states = random_states(robot, count)
    network = learner.network
    x = np.hstack([states.q, states.v])[:, : network.inputs]
    y = 0.01 * np.random.default_rng(1).normal(size=(count, network.outputs))
    for sample, measured in zip(x, y, strict=True):
        learner.update(sample, measured)
    return 1e9 * learner.time_per_update


def matrix_products(size: int, outputs: int) -> float:
    """Time of S Z, (n, n) (n, n_y), and of (n, n_y) (n_y, n), by NumPy's BLAS [ns].

    Args:
        size: Number of weights, n.
        outputs: Number of outputs, n_y.
    """
    normal = np.random.default_rng(0).normal
    root, change = normal(size=(size, size)), np.empty((size, size))
    tall, wide = normal(size=(size, outputs)), normal(size=(outputs, size))
    first = time_python(lambda: root @ tall)
    return first + time_python(lambda: np.matmul(tall, wide, out=change))


def flight_result(robot: Robot) -> Result:
    """Time to simulate one second of free flight, aerodynamics inside.

    Args:
        robot: A floating machine with wings.
    """
    model, gait = QuasiSteady(robot, Air()), gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    q, v = robot.coordinates(pitch=0.1), robot.coordinates(x=4.0)

    def fly() -> int:
        flight = simulate(robot, model, gait, duration=1.0, time_step=1e-4, throw=False, q=q, v=v)
        return int(flight.sizes["time"]) - 1

    steps = fly()
    started = time.perf_counter()
    fly()
    seconds = (time.perf_counter() - started) * 10_000 / steps
    note = f"RK4 at 1e-4 s, free, quasi-steady air, every quantity recorded ({steps} steps flown)"
    return Result("simulation of 1 s of flight", seconds, "s", note=note)


def pipeline_results(samples: int = PACKETS) -> Iterator[Result]:
    """The whole of a learner's work for a packet: median and tail, and the response at 10 kHz.

    Args:
        samples: Packets of each case.
    """
    if compiler_command() is None:
        yield Result("rival left out", None, "us", note="no C compiler: no compiled pipeline")
        return
    for one in measure_latency(samples, LOADS[:1]):
        note, took = f"{samples} packets", {k: 1e6 * v for k, v in one.duration.items()}
        if one.paced:
            response = 1e6 * one.response["p99"]
            yield Result(f"{one.learner}: at 10 kHz, 99 % answered within", response, "us",
                         note=note)  # fmt: skip
            continue
        tail = f"{note}, one after the other; slowest {seconds_text(one.duration['slowest'])}"
        yield Result(f"{one.learner}: median", took["p50"], "us", note=note)
        yield Result(f"{one.learner}: 99 % within", took["p99"], "us", note=tail)


_START = """
import time, resource, patagium as pt
robot = pt.load_robot("{robot}")
gait = pt.gaits.sinusoidal(robot, frequency=5.0, {joint}=0.1)
started, before = time.perf_counter(), time.process_time()
"""
_ALL = """
air = pt.QuasiSteady(robot, pt.Air())
pt.Dynamics(robot).bias([0.0] * robot.dof, [0.0] * robot.dof)
air.generalized_force([0.0] * robot.dof, [0.0] * robot.dof)
pt.simulate(robot, air, gait, duration=1e-3, time_step=1e-4, throw=False)
network = pt.StripNetwork(robot)
learner = pt.CubatureLearner(network, prior_std=0.3, measurement_std=0.003)
learner.update([0.1] * (2 * robot.dof), [0.0] * robot.dof)
"""
_UNSTEADY = """
air, added = pt.LiftingLine(robot), pt.AddedMass(robot)
pt.simulate(robot, air, gait, duration=1e-3, time_step=1e-4, added_mass=added, throw=False)
"""
_TRIM = "assert pt.trim(robot{options}).found\n"
_END = """
compilers = resource.getrusage(resource.RUSAGE_CHILDREN)
print(time.process_time() - before, compilers.ru_utime + compilers.ru_stime)
print(time.perf_counter() - started)
"""
_UNSTEADY_NAME = "compiling a flight with lifting line and added mass"
_COMPILED = (
    ("compiling one robot on a fresh cache", "aerobat", "plunge", _ALL),
    (f"{_UNSTEADY_NAME}, 10 strips", "aerobat", "plunge", _UNSTEADY),
    (f"{_UNSTEADY_NAME}, 22 strips", "hawk", "left_sweep", _UNSTEADY),
    *(
        (f"the first trim on a fresh cache, {robot}", robot, joint, _TRIM.format(options=options))
        for robot, joint, options in (
            ("aerobat", "plunge", ""),
            ("ornithopter", "plunge", ""),
            ("dragonfly", "left_fore_plunge", ", speed=0.0"),
            ("hawk", "left_sweep", ", climb=None"),
        )
    ),
)


def compile_results() -> Iterator[Result]:
    """Time to compile on an empty cache: everything one robot needs, and unsteady flights.

    Unsteady flights are a rate and its record, with lifting line and added mass.
    """
    for name, robot, joint, code in _COMPILED:
        with tempfile.TemporaryDirectory() as cache:
            environment = {**os.environ, "PATAGIUM_CACHE": cache}
            command = [sys.executable, "-c", _START.format(robot=robot, joint=joint) + code + _END]
            done = subprocess.run(
                command, env=environment, capture_output=True, text=True, check=True
            )
        python, compilers, seconds = map(float, done.stdout.split())
        made = {_ALL: "dynamics, air, flight, strip network and learner", _UNSTEADY: "rate, record"}
        note = made.get(code, "rate and Jacobian of many states")
        note += f"; processor time: {python:.1f} s Python, {compilers:.1f} s C compilers"
        yield Result(name, seconds, "s", note=f"{note}, on all cores")


def on_one_thread(part: str) -> list[Result]:
    """A part of this bench in a process of its own, whose BLAS has one thread.

    A BLAS chooses its number of threads when it is loaded.

    Args:
        part: "air" or "update".
    """
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
    environment = {**os.environ, **dict.fromkeys(names, "1")}
    command = [sys.executable, "-m", __name__, part]
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return [Result(**fields) for fields in json.loads(done.stdout)]


def _time(function: NativeFunction, inputs: list[Array]) -> float:
    call = compiled_call(function)
    if call is not None:
        return time_call(call, inputs)
    rows = [x if x.ndim == 2 else np.broadcast_to(x, (512, *x.shape)) for x in inputs]
    turn = cycle(list(zip(*rows, strict=True)))
    return time_python(lambda: function(*next(turn)))


if __name__ == "__main__":
    _parts = {"air": air_results, "update": update_results}
    with one_core():
        _results = [result.as_dict() for result in _parts[sys.argv[1]](load_robot("aerobat"))]
    print(json.dumps(_results))
