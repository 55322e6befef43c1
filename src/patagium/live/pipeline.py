"""Pipeline from a sensor packet to an update: inverse dynamics, prediction, learning.

Packets go in, a record of each comes out; between them there is no Python where there is a
compiler and the learner's filter is compiled. Otherwise each sample goes through `learn`, with
the same results but for rounding. Lag states of the network follow the packets
(`ModelMemory`). Two threads must not use one learner.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter_ns
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics import AddedMass
from patagium.arguments import checked
from patagium.arrays import Array, Bools, Indices, real_array
from patagium.errors import FilterDiverged, Outcome, ParameterError, ShapeError
from patagium.learning.filters.kernel_memory import Compiled
from patagium.learning.filters.screening import REFUSALS
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.models.memory import (
    UNSEEN,
    CompiledLags,
    ModelMemory,
    measured_inputs,
    memory_of,
)
from patagium.learning.models.network import Network, flight_terms
from patagium.learning.stream import learn
from patagium.native import load_kernel
from patagium.native.structs import PIPELINE
from patagium.robot import Robot
from patagium.sensing.force.air_force import Column, SampleForm, packet_columns


@dataclass(frozen=True)
class Records:
    """Records of packets: prediction, measurement and outcome of each.

    Attributes:
        rows: One for each packet, (N, 3 n_y + 4) [unit of y]: prediction, its std, measurement,
            nis, outcome, channels left out and nanoseconds.
    """

    rows: Array

    @property
    def prediction(self) -> Array:
        """Prediction of y before learning, (N, n_y) [unit of y]; NaN where there is none."""
        return self.rows[:, : self._outputs]

    @property
    def std(self) -> Array:
        """Standard deviation of measurement less prediction, noise included, (N, n_y)."""
        return self.rows[:, self._outputs : 2 * self._outputs]

    @property
    def measurement(self) -> Array:
        """Measurement y by inverse dynamics, (N, n_y)."""
        return self.rows[:, 2 * self._outputs : 3 * self._outputs]

    @property
    def nis(self) -> Array:
        """Normalized innovation squared, (N,); NaN where nothing was learned."""
        return self.rows[:, -4]

    @property
    def outcome(self) -> Indices:
        """Outcome of each update, (N,); a sample that is not COMPLETED was not learned."""
        return self.rows[:, -3].astype(np.int64)

    @property
    def left_out(self) -> Bools:
        """Channels of samples learned that were left out, (N, n_y); of the first 53 at most."""
        bits = self.rows[:, -2].astype(np.int64)[:, None] >> np.arange(self._outputs)
        return (bits & 1).astype(bool)

    @property
    def duration(self) -> Array:
        """Wall-clock time of each call, (N,) [s]."""
        return self.rows[:, -1] * 1e-9

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def _outputs(self) -> int:
        return int(self.rows.shape[1]) // 3 - 1


class Pipeline:
    """Learner fed with the packets of a robot's sensors.

    Nothing that a packet holds raises: its record says what could not be learned, which left the
    learner as it was.

    Args:
        learner: Learner, which goes on from its state and is changed. Its network's
            outputs are coordinates of the robot.
        robot: The machine that sends.
        inputs: Names of what the network sees, such as `v.roll`; None: q, then v.
        carried: Known forces that packets carry after u1, n numbers each: which of
            `damping_force`, `mount_force` and `added_mass_force` (`OPTIONAL_PARTS`). With those
            that a flight has, its packets give the force that `training_data` gives.
        added_mass: Model of the added mass of the wings, in steady wind, for packets that do not
            carry its force; None for none.

    Raises:
        ParameterError: If an input, an output or a force has no such name, added mass is given
            twice or in wind that changes, or the network remembers and the learner cannot keep
            what.
        ShapeError: If the network sees another number of inputs.
    """

    @checked
    def __init__(
        self,
        learner: Learner,
        robot: Robot,
        *,
        inputs: Sequence[str] | None = None,
        carried: Sequence[str] = (),
        added_mass: AddedMass | None = None,
    ) -> None:
        network, terms = learner.network, flight_terms(learner.network)
        _check_network(network, robot, inputs)
        self.learner, self.robot = learner, robot
        self.form = SampleForm(
            robot,
            None if inputs is None else tuple(inputs),
            tuple(network.output_names),
            tuple(carried),
            added_mass,
            terms.acceleration,
            terms.added_mass,
        )
        self._parameters = self.form.parameters
        self._columns = len(self.columns)
        self._memory = _memory(learner)
        self.chain = _chain(learner, self.form)

    def __reduce__(self) -> tuple[Any, ...]:
        """Recipe of a copy: a new pipeline around a copy of the learner."""
        form, own = self.form, type(self)
        again = partial(own, inputs=form.inputs, carried=form.carried, added_mass=form.added_mass)
        return again, (self.learner, self.robot)

    def __repr__(self) -> str:
        return f"<Pipeline of {self.robot.name}: {self.learner!r}>"

    @property
    def inputs(self) -> tuple[str, ...] | None:
        """Names of what the network sees; None: q, then v."""
        return self.form.inputs

    @property
    def columns(self) -> tuple[Column, ...]:
        """Names and units of the numbers of a packet: time, q, v, a, u1, then those carried."""
        return packet_columns(self.robot, self.form.carried)

    @property
    def compiled(self) -> bool:
        """Whether no Python runs between two samples."""
        return self.chain is not None

    @property
    def memory_resets(self) -> int:
        """Number of times that the network's memory began anew; 0 without one."""
        return 0 if self._memory is None else self._memory.resets

    def run(self, packets: ArrayLike) -> Records:
        """Learn packets in order; each is predicted before it is learned.

        Args:
            packets: (N, 1 + n_q + (3 + k) n) with k forces carried, as `columns` names them.

        Returns:
            A record of each.

        Raises:
            ShapeError: If the packets have another shape.
        """
        rows = np.ascontiguousarray(real_array("packets", packets, ("N", self._columns)))
        records = np.empty((len(rows), 3 * self.learner.network.outputs + 4))
        if self.chain is None:
            self._run_in_python(rows, records)
        else:
            self.chain.run(rows, records)
        return Records(records)

    def step(self, packet: ArrayLike) -> Records:
        """Record of one packet, (1 + n_q + (3 + k) n,), once it is learned; N = 1.

        Raises:
            ShapeError: If the packet has another shape.
        """
        row = real_array("packet", packet, (self._columns,))
        return self.run(row[None])

    def _run_in_python(self, rows: Array, records: Array) -> None:
        m, robot = self.learner.network.outputs, self.robot
        cuts = 1 + np.cumsum([0, robot.coordinate_count, robot.dof, robot.dof])
        for row, record in zip(rows, records, strict=True):
            started = perf_counter_ns()
            parts = np.split(row, cuts)[1:]
            x, y = map(np.atleast_1d, self.form.function(*parts, self._parameters))
            record[:] = np.nan
            record[2 * m : 3 * m], record[3 * m + 2] = y, 0.0
            record[3 * m + 1] = self._sample(float(row[0]), x, y, record)
            record[3 * m + 3] = perf_counter_ns() - started

    def _sample(self, time: float, x: Array, y: Array, record: Array) -> Outcome:
        """Outcome of one sample that is recalled and learned."""
        if self._memory is None:
            return _learned(self.learner, time, x, y, record)
        before = self.learner.weights
        x = self._memory.next_input(time, x, before)
        outcome = _learned(self.learner, time, x, y, record)
        self._memory.settle(outcome, self.learner.weights - before)
        return outcome


def _check_network(network: Network, robot: Robot, inputs: Sequence[str] | None) -> None:
    """Refuse a network that packets of a robot cannot feed; what it recalls is not sent."""
    for name in network.output_names:
        if name not in robot.dof_names:
            known = ", ".join(robot.dof_names)
            raise ParameterError("outputs of the network", f"coordinates among {known}", name)
    count = robot.state_size if inputs is None else len(inputs)
    count += robot.dof if flight_terms(network).acceleration else 0
    if measured_inputs(network) != count:
        raise ShapeError("inputs of the network", (count,), (measured_inputs(network),))


def over_rows(function: Any, struct: Any) -> Callable[[Array, Array, int], int]:
    """C function of a structure, as one of rows, their records, and the row from which it goes on.

    It returns the number of rows that it took.
    """
    function.argtypes = [ctypes.c_void_p, ctypes.c_int64, *[ctypes.c_void_p] * 2]
    function.restype = ctypes.c_int64

    def run(rows: Array, records: Array, begin: int) -> int:
        places = rows[begin:].ctypes.data, records[begin:].ctypes.data
        return int(function(ctypes.addressof(struct), len(rows) - begin, *places))

    return run


class _CompiledChain:
    """Pipeline in C: a struct and all arrays that it points to.

    Attributes:
        native: Addresses of the C function and of the memory that it takes first.
    """

    def __init__(
        self,
        learner: FilterLearner,
        compiled: Compiled,
        kernel: ctypes.CDLL,
        form: SampleForm,
        lags: CompiledLags | None,
    ) -> None:
        self.learner, self.lags = learner, lags
        robot, parameters = form.robot, form.parameters
        places = {
            name: value if isinstance(value, int) else value.ctypes.data
            for name, value in compiled._asdict().items()
            if name not in ("predict", "weights")
        }
        if lags is not None:
            places |= dict(zip(("recall", "settle", "lags"), lags.native, strict=True))
        self._struct = PIPELINE.type(
            columns=len(packet_columns(robot, form.carried)),
            coordinates=robot.coordinate_count,
            dof=robot.dof,
            outputs=len(compiled.y),
            air_force=form.function.address,
            parameters=parameters.ctypes.data,
            **places,
        )
        self._keep = form, compiled, parameters
        self._run = over_rows(kernel.pipeline_run, self._struct)
        function = ctypes.cast(kernel.pipeline_run, ctypes.c_void_p).value or 0
        self.native = function, ctypes.addressof(self._struct)

    def run(self, rows: Array, records: Array) -> None:
        """Turn packets, (N, columns), into records, (N, 3 n_y + 4)."""
        self.account_for(partial(self._run, rows, records), records)

    def account_for(self, run: Callable[[int], int], records: Array) -> None:
        """Account for samples that C code learns through `native`; nan in records of those not due.

        `run` goes on from a record, and returns how many it added: not all where an alarm stops it.
        """
        begin, memory = 0, self.learner.memory
        if self.lags is not None and memory is not None:
            self.lags.load(memory)
        while begin < len(records):
            done = records[begin : begin + run(begin)]
            begin += len(done)
            learned = done[~np.isnan(done[:, -3])]
            self.learner.account_for(learned[:, -3], learned[:, -1])
        if self.lags is not None and memory is not None:
            self.lags.store(memory)


def _chain(learner: Learner, form: SampleForm) -> _CompiledChain | None:
    """Pipeline in C; None where a sample takes Python as well."""
    if not isinstance(learner, FilterLearner):
        return None
    compiled, kernel = learner.compiled, load_kernel("pipeline")
    if compiled is None or kernel is None or form.function.address is None:
        return None
    lags = None
    if learner.memory is not None:
        lags = learner.memory.compiled(compiled.x)
        if lags is None:
            return None
    return _CompiledChain(learner, compiled, kernel, form, lags)


def _memory(learner: Learner) -> ModelMemory | None:
    """Memory that the learner keeps for its network; None for a network without."""
    if memory_of(learner.network) is None:
        return None
    memory = getattr(learner, "memory", None)
    if not isinstance(memory, ModelMemory):
        expected = "a filter, for a network with memory"
        raise ParameterError("learner", expected, type(learner).__name__)
    return memory


_OUTCOMES = {event: outcome for outcome, event in REFUSALS.items()}
_OUTCOMES["refused"] = Outcome.NOT_FINITE


def _learned(learner: Learner, time: float, x: Array, y: Array, record: Array) -> Outcome:
    """Outcome of a sample; its prediction and nis are written into its record."""
    m, before = len(y), dict(learner.events)
    with contextlib.suppress(FilterDiverged):
        mean, covariance = learner.predict(x)
        record[:m], record[m : 2 * m] = mean, np.sqrt(np.diagonal(np.atleast_2d(covariance)))
    try:
        innovation, _, nis = learn(learner, x, y, time)
    except FilterDiverged as failure:
        return failure.outcome
    after = learner.events
    for event, outcome in _OUTCOMES.items():
        if after[event] > before[event]:
            record[: 2 * m] = np.nan if outcome in UNSEEN else record[: 2 * m]
            return outcome
    record[3 * m] = nis
    record[3 * m + 2] = float(np.isnan(innovation) @ 2.0 ** np.arange(m))
    return Outcome.COMPLETED
