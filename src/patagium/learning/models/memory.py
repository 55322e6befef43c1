"""Memory of a network: lag states z that follow the samples of a log or of a stream.

The lag states depend on the first weights of a network. They are found at the weights known at
the time, together with their sensitivity S = dz/dW_m, and each sample carries them on:

    x = [measured inputs, z, vec S, W_m];

at other weights the network reads z + S (W - W_m). After an update of the weights the memory
itself moves along S. Without noise of its own on z this is the joint filter of W and z, whose
covariance with W is S P. A log is followed in blocks (`recall`), a stream sample by sample
(`next_input` and `settle`), in C where there is a compiler. Neglected: noise added to W between
samples, which the joint filter would pass on to z at once; two streams at once.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from math import inf, isnan, nan
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.arrays import Array, Indices
from patagium.errors import Outcome, ShapeError
from patagium.learning.models.network import Network
from patagium.native import load_kernel
from patagium.native.function import as_c

LONGEST_STEP = 0.01
"""A step up to this is bridged, [s]: short against a wingbeat and the lags of its air, ..."""
USUAL_STEPS = 3.0
"""... and so is one of up to so many usual ones; as long as a gap of an imported log begins."""
UNSEEN = (Outcome.BAD_INPUT, Outcome.LATE, Outcome.DUPLICATE)
"""Outcomes of samples that a learner did not look at."""
_SHARE = 0.01  # of a step in the usual one
_PREFIX = "memory_"


class MemoryState(NamedTuple):
    """Lag states at one sample, or at N samples (leading axis N).

    Attributes:
        state: Lag states z found at the weights W_m, ([N,] n_s): the n_z that the network reads,
            then those that only their own equations read.
        sensitivity: S = dz/dW_m, ([N,] n_s, n_m).
        weights: W_m, ([N,] n_m).
        driver: Numbers of the sample that the next step starts from, (n_d,) [as x].
        time: Time of the sample [s].
    """

    state: Array
    sensitivity: Array
    weights: Array
    driver: Array = np.zeros(0)
    time: float = nan

    def at(self, weights: Array) -> Array:
        """Lag states at other weights, z + S (W - W_m), ([N,] n_s).

        Args:
            weights: W, ([N,] n_m).
        """
        if not self.state.shape[-1]:
            return self.state
        change = weights - self.weights
        return np.asarray(self.state + np.einsum("...ij,...j->...i", self.sensitivity, change))


class CompiledSteps(NamedTuple):
    """Lag equations in C for the kernel `memory.c`, of lags that depend on no weight.

    Attributes:
        kernel: The compiled kernel.
        begin: Address of `void f(x, constants) -> (z, driver)`.
        step: Address of `void f(x, constants, time step, z, driver) -> (z, driver)`.
        constants: Constants of both functions.
    """

    kernel: ctypes.CDLL
    begin: int
    step: int
    constants: Array


def compiled_steps(begin: int | None, step: int | None, constants: Array) -> CompiledSteps | None:
    """Lag equations in C by addresses and constants; None without a compiler."""
    kernel = load_kernel("memory")
    if kernel is None or begin is None or step is None:
        return None
    return CompiledSteps(kernel, begin, step, constants)


class LagEquations(Protocol):
    """Equations of lag states from sample to sample; z depends on the first n_m weights given."""

    @property
    def measured(self) -> int:
        """Number of measured inputs that drive the lags, the first of x."""

    @property
    def states(self) -> int:
        """Number of lag states that the network reads, n_z."""

    @property
    def carried(self) -> tuple[int, int]:
        """Number of lag states in all, n_s, and of numbers of a driver, n_d."""

    @property
    def parameters(self) -> int:
        """Number of weights that the lag states depend on, n_m."""

    @property
    def compiled(self) -> CompiledSteps | None:
        """Equations in C; None without."""

    def begin(self, x: Array, weights: Array) -> tuple[Array, Array, Array]:
        """State, sensitivity and driver where memory begins, at measured inputs x (measured,)."""

    def step(
        self, x: Array, weights: Array, time_step: float, before: MemoryState
    ) -> tuple[Array, Array, Array]:
        """State, sensitivity and driver a time step [s] after the memory before."""


def measured_inputs(network: Network) -> int:
    """Number of inputs of a network that are measured, the first of x."""
    return int(getattr(network, "measured_inputs", network.inputs))


def row_size(lags: LagEquations) -> int:
    """Length of [z, vec S, W_m] in the input of a network."""
    return lags.states * (1 + lags.parameters) + (lags.parameters if lags.states else 0)


def memory_in(rows: Array, states: int, parameters: int) -> MemoryState:
    """Memory read from [z, vec S, W_m], the last inputs of a network."""
    end = states * (1 + parameters)
    slopes = rows[:, states:end].reshape(len(rows), states, parameters)
    return MemoryState(rows[:, :states], slopes, rows[:, end : end + parameters])


def memory_of(network: Network) -> ModelMemory | None:
    """A memory for a network, empty yet; None for a network without."""
    return None if getattr(network, "lag_equations", None) is None else ModelMemory(network)


def replay(network: Network, time: Array, x: Array, gaps: ArrayLike = ()) -> ModelMemory:
    """A memory that follows a log; without lag states the inputs are x.

    Args:
        network: With memory or without.
        time: Increasing, (N,) [s].
        x: Measured inputs, (N, n_measured), or all, (N, n_x) [units of x].
        gaps: First sample after each gap, where memory begins anew.

    Raises:
        ShapeError: If x has another shape.
    """
    memory = ModelMemory(network)
    memory.follow(time, x, gaps)
    return memory


def network_inputs(
    network: Network, weights: Array, time: ArrayLike, x: Array, gaps: ArrayLike = ()
) -> Array:
    """Inputs of a network over a log with weights that stay, lag states included, (N, n_x).

    Args:
        network: With memory or without.
        weights: Weights, (n,) [1].
        time: Increasing, (N,) [s].
        x: Measured inputs, (N, n_measured), or all, (N, n_x) [units of x].
        gaps: First sample after each gap, where memory begins anew.

    Raises:
        ShapeError: If x has another shape.
    """
    stamps = np.asarray(time, float)
    return replay(network, stamps, x, gaps).upto(len(stamps), weights)


class ModelMemory:
    """Memory of one network along one log or one stream.

    In a stream it begins with the first sample, and anew where the stamps go back (and the
    learner believes them) or after a step longer than `LONGEST_STEP` and `USUAL_STEPS` usual
    ones. A sample that the learner refuses for its stamp or its input leaves it as it was.

    Args:
        network: The network; without lag states its inputs are the measured ones.

    Attributes:
        last: Memory at the last sample; None before the first one.
        clock: Last stamp and usual step, (2,) [s].
        resets: How often memory began anew in a stream.
    """

    def __init__(self, network: Network) -> None:
        self._network = network
        self._whole = False  # whether x of the log has all inputs, so that nothing is left to find
        self._measured = measured_inputs(network)
        self.last: MemoryState | None = None
        self.clock, self.resets = np.array([-inf, nan]), 0
        self._next: MemoryState | None = None
        self._log: tuple[Array, Array, Indices] | None = None
        self._reached = 0

    def recall(self, weights: Array, time: ArrayLike, x: Array, gaps: ArrayLike = ()) -> Array:
        """Inputs of the next block of samples, lag states included, (N, n_x).

        Sample k depends on samples up to k alone.

        Args:
            weights: Weights over the block, (n,) [1].
            time: Increasing, (N,) [s].
            x: Measured inputs, (N, n_measured) [units of x].
            gaps: First sample after each gap, where memory begins anew.
        """
        rows, self.last = self._block(weights, np.asarray(time, float), x, gaps, self.last)
        return rows

    def corrected(self, change: Array) -> None:
        """Move the memory along its sensitivity after the weights moved by a change, (n,) [1]."""
        if self.last is not None:
            weights = self.last.weights + change[: len(self.last.weights)]
            self.last = self.last._replace(state=self.last.at(weights), weights=weights)

    def follow(self, time: Array, x: Array, gaps: ArrayLike = ()) -> None:
        """Follow a log from its first sample on by `upto` and `ahead`; see `replay`.

        Raises:
            ShapeError: If x has another shape.
        """
        whole = self._network.inputs
        if x.ndim != 2 or x.shape[1] not in (self._measured, whole):
            raise ShapeError("x", f"(N, {self._measured})", x.shape)
        self._log, self._reached = (time, x, np.asarray(gaps, np.int64)), 0
        self._whole = x.shape[1] == whole

    def upto(self, end: int, weights: Array) -> Array:
        """Inputs from the sample reached up to another one; the memory moves on.

        Args:
            end: One past the last sample.
            weights: Weights over these samples, (n,) [1].
        """
        rows, self.last = self._span(end, weights)
        self._reached = end
        return rows

    def ahead(self, end: int, weights: Array) -> Array:
        """Inputs as `upto` gives them; the memory stays."""
        return self._span(end, weights)[0]

    def next_input(self, time: float, x: Array, weights: Array) -> Array:
        """Input of the next sample of a stream, (n_x,); `settle` must follow.

        Args:
            time: Of the sample [s].
            x: Measured inputs, (n_measured,) [units of x].
            weights: Weights at that sample, (n,) [1].
        """
        before = self.last if self._follows(time) else None
        rows, found = self._block(weights, np.array([time]), x[None], (), before)
        self._next = found if np.isfinite(rows[0, self._measured :]).all() else None
        return np.asarray(rows[0])

    def settle(self, outcome: Outcome, change: Array) -> None:
        """Keep or drop the sample of `next_input` after an update that moved weights, (n,) [1]."""
        if self._next is None or outcome in UNSEEN:
            return
        time = self._next.time
        if self.last is not None:
            self.resets += not self._follows(time)
            step, usual = time - float(self.clock[0]), float(self.clock[1])
            if step > 0:  # steps back in time say nothing
                counted = usual + _SHARE * (min(step, USUAL_STEPS * usual) - usual)
                self.clock[1] = step if isnan(usual) else counted
        self.clock[0], self.last = time, self._next
        self.corrected(change)

    def state(self) -> dict[str, Any]:
        """All that the next samples of a stream depend on, by name."""
        last = {} if self.last is None else self.last._asdict()
        kept: dict[str, Any] = {
            f"{_PREFIX}0_{name}": np.array(value, float) for name, value in last.items()
        }
        return {**kept, f"{_PREFIX}clock": self.clock.copy(), f"{_PREFIX}resets": self.resets}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from a state; one without a memory begins with the next sample.

        Args:
            state: As `state` gave it.

        Raises:
            ShapeError: If an array has another shape.
        """
        self._next, self.last = None, None
        self.clock = np.array(state.get(f"{_PREFIX}clock", (-inf, nan)), float)
        self.resets = int(state.get(f"{_PREFIX}resets", 0))
        if f"{_PREFIX}0_state" not in state or self._lags is None:
            return
        z, slopes, weights, driver, time = (
            np.array(state[f"{_PREFIX}0_{name}"], float) for name in MemoryState._fields
        )
        (states, drivers), n_m = self._lags.carried, self._lags.parameters
        shapes = (states,), (states, n_m), (n_m,), (drivers,)
        for array, shape in zip((z, slopes, weights, driver), shapes, strict=True):
            if array.shape != shape:
                raise ShapeError("memory", shape, array.shape)
        self.last = MemoryState(z, slopes, weights, driver, float(time))

    def compiled(self, x: Array) -> CompiledLags | None:
        """The memory as C code moves it between two calls; None without a compiler.

        Args:
            x: Input that a compiled filter reads, (n_x,) [units of x].
        """
        lags = self._lags
        if lags is None or lags.compiled is None:
            return None
        return CompiledLags(lags, lags.compiled, x)

    @property
    def _lags(self) -> LagEquations | None:
        return None if self._whole else getattr(self._network, "lag_equations", None)

    def _span(self, end: int, weights: Array) -> tuple[Array, MemoryState | None]:
        if self._log is None:
            raise RuntimeError("upto and ahead follow the log of replay: call replay first")
        time, x, gaps = self._log
        part = slice(self._reached, end)
        inside = gaps[(gaps >= part.start) & (gaps < end)] - part.start
        return self._block(weights, time[part], x[part], inside, self.last)

    def _block(
        self,
        weights: Array,
        time: Array,
        x: Array,
        gaps: ArrayLike,
        before: MemoryState | None,
    ) -> tuple[Array, MemoryState | None]:
        """Inputs of a block and the memory at its end."""
        lags = self._lags
        if lags is None:
            return x, before
        if not len(x):
            return np.empty((0, self._network.inputs)), before
        anew = np.zeros(len(x), np.int8)
        anew[np.asarray(gaps, int)] = 1
        anew[0] |= before is None
        known = time, x, anew, before
        rows, after = _advanced_in_c(lags, *known) or _advanced(lags, weights, *known)
        return np.hstack([x, rows]), after

    def _follows(self, time: float) -> bool:
        last, usual = self.clock.tolist()
        longest = inf if isnan(usual) else max(LONGEST_STEP, USUAL_STEPS * usual)
        return self.last is not None and 0 < time - last <= longest


def _advanced(
    lags: LagEquations,
    weights: Array,
    time: Array,
    x: Array,
    anew: NDArray[np.int8],
    before: MemoryState | None,
) -> tuple[Array, MemoryState]:
    """[z, vec S, W_m] of a block, (N, row size), and the memory at its end."""
    n_z, n_m = lags.states, lags.parameters
    own = weights[:n_m].copy()
    rows = np.empty((len(x), row_size(lags)))
    begins, measured = anew.tolist(), x[:, : lags.measured]
    for k, stamp in enumerate(time.tolist()):
        if before is None or begins[k]:
            state, slopes, driver = lags.begin(measured[k], weights)
        else:
            state, slopes, driver = lags.step(measured[k], weights, stamp - before.time, before)
        before = MemoryState(state, slopes, own, driver, stamp)
        rows[k, :n_z] = state[:n_z]
        rows[k, n_z : n_z * (1 + n_m)] = slopes[:n_z].ravel()
    rows[:, n_z * (1 + n_m) :] = own
    if before is None:
        raise ValueError("expected at least one sample")
    return rows, before._replace(state=before.state.copy(), sensitivity=before.sensitivity.copy())


def _advanced_in_c(
    lags: LagEquations,
    time: Array,
    x: Array,
    anew: NDArray[np.int8],
    before: MemoryState | None,
) -> tuple[Array, MemoryState] | None:
    """Result of `_advanced` by one call of C; None without a compiler."""
    if lags.compiled is None:
        return None
    block = CompiledLags(lags, lags.compiled)
    last = -inf if before is None else before.time
    if before is not None:
        block.put(before)
    steps = np.diff(time, prepend=last)
    rows = np.empty((len(x), lags.states))
    arrays = np.ascontiguousarray(x[:, : lags.measured]), anew, steps, rows
    lags.compiled.kernel.memory_block(ctypes.byref(block), *as_c(len(x), *arrays))
    return rows, block.taken(float(time[-1]))


class CompiledLags(ctypes.Structure):
    """`lags` of the kernel `memory.c`, field by field: a memory between two calls of C code.

    Args:
        lags: The equations.
        steps: The same in C.
        x: Input that a compiled filter reads, (n_x,) [units of x]; None where blocks are recalled.
    """

    _fields_ = [
        *((name, ctypes.c_int32) for name in ("measured", "states", "all", "driver")),
        *((name, ctypes.c_void_p) for name in ("begin", "step", "constants", "carried")),
        *((name, ctypes.c_void_p) for name in ("x", "clock", "counts")),
    ]

    def __init__(self, lags: LagEquations, steps: CompiledSteps, x: Array | None = None) -> None:
        states, drivers = lags.carried
        self.arrays: dict[str, NDArray[Any]] = {
            "constants": steps.constants,
            "carried": np.zeros(2 * (states + drivers)),
            "x": np.zeros(0) if x is None else x,
            "clock": np.zeros(3),
            "counts": np.zeros(2, np.int64),
        }
        self._kernel = steps.kernel
        sizes = lags.measured, lags.states, states, drivers
        addresses = {name: array.ctypes.data for name, array in self.arrays.items()}
        super().__init__(*sizes, steps.begin, steps.step, **addresses)

    @property
    def native(self) -> tuple[int, int, int]:
        """Addresses of the functions that find the next input and settle it, and of the memory."""
        calls = (getattr(self._kernel, name) for name in ("memory_next", "memory_settle"))
        begin, end = (int(ctypes.cast(call, ctypes.c_void_p).value or 0) for call in calls)
        return begin, end, ctypes.addressof(self)

    def put(self, memory: MemoryState) -> None:
        """Memory before the next sample."""
        carried = self.arrays["carried"]
        np.concatenate([memory.state, memory.driver], out=carried[: len(carried) // 2])

    def taken(self, time: float) -> MemoryState:
        """Memory at the last sample, of a time [s]."""
        carried = self.arrays["carried"]
        state, driver = np.split(carried[: len(carried) // 2].copy(), [self.all])
        return MemoryState(state, np.zeros((len(state), 0)), np.zeros(0), driver, time)

    def load(self, memory: ModelMemory) -> None:
        """Take over the memory of a stream before a call."""
        self.arrays["clock"][:2] = memory.clock
        self.arrays["counts"][:] = memory.last is not None, memory.resets
        if memory.last is not None:
            self.put(memory.last)

    def store(self, memory: ModelMemory) -> None:
        """Give the memory of a stream back after a call."""
        begun, memory.resets = self.arrays["counts"].tolist()
        memory.clock = self.arrays["clock"][:2].copy()
        if begun:
            memory.last = self.taken(float(memory.clock[0]))
