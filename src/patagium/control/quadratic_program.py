"""Quadratic program of linear optimal control with box constraints, solved in C or in NumPy.

    min sum_k 1/2 x'Q x + u'S x + 1/2 u'R u + q'x + r'u + 1/2 sum_i w_i dist(x_i, [least, most])^2
    x+ = A x + B u + c,  lower <= u <= upper,  fall <= u - u_before <= rise,  x_0 given

Limits of inputs and of their changes are hard, limits of states soft: a program whose limits do
not contradict each other always has a solution. `native/kernels/riccati_qp.h` solves it, warm
started and without allocation; `condensed_qp.h` is faster where an `inverse` is given.
`_solve_dense` is what runs without a compiler: nonnegative least squares on the program in the
inputs alone. Neglected: hard limits of states.

References:
    Bertsekas (1982), Constrained Optimization and Lagrange Multiplier Methods.
    Frison & Jorgensen (2013), Efficient implementation of the Riccati recursion for solving
    linear-quadratic control problems.
    Lawson & Hanson (1974), Solving Least Squares Problems.
"""

from __future__ import annotations

import ctypes
from enum import IntEnum
from typing import Any

import numpy as np

from patagium.arguments import checked
from patagium.arrays import Array, real_array
from patagium.errors import CompilerError, ParameterError
from patagium.native import load_kernel

TOLERANCE = 1e-9
"""Violation of a limit by which ranges and rates contradict each other in the dense form."""

_MOST = 10**8  # entries of all matrices
_LOW, _HIGH = ("lower", "fall", "least"), ("upper", "rise", "most")


class ProgramStatus(IntEnum):
    """Status of a program; the integers are those of the kernel.

    Not finite: a number is none, or infinite but no limit. Infeasible: ranges and rates of the
    inputs contradict each other. Not convex: the cost in the inputs is not.
    """

    SOLVED = 0
    NOT_FINITE = 1
    NOT_CONVEX = 2
    INFEASIBLE = 3
    NOT_CONVERGED = 4


def _fields(n: int, nx: int, nu: int) -> list[tuple[str, Any, tuple[int, ...]]]:
    """Fields of the kernel's structure, in its order."""
    ranges, states = (n, nu), (n + 1, nx)
    shapes: dict[str, tuple[int, ...]] = {
        "A": (n, nx, nx),
        "B": (n, nx, nu),
        "c": (n, nx),
        "Q": (n + 1, nx, nx),
        "S": (n, nu, nx),
        "R": (n, nu, nu),
        "q": states,
        "r lower fall": ranges,
        "least": states,
        "upper rise": ranges,
        "most weight": states,
        "start": (nx,),
        "before": (nu,),
        "u": ranges,
        "x": states,
        "range_force change_force": ranges,
        "penalty": (nu,),
        "cost gradient violation": (),
    }
    reals = [(k, np.float64, shape) for names, shape in shapes.items() for k in names.split()]
    counts = ("status", "factorizations", "sweeps", "inverse", "held")
    return [*reals, *((k, np.int64, ()) for k in counts)]


class QuadraticProgram:
    """Quadratic program of optimal control of fixed sizes, and its solution.

    Each of `A`, `B`, `c`, `Q`, `S`, `R`, `q`, `r`, `lower`, `upper`, `fall`, `rise`, `least`,
    `most`, `weight`, `start`, `before` and of the solution's `u`, `x`, `cost` is an array of
    `data`, to be read and written in place. A solution is where the next call begins.

    Args:
        stages: Number of intervals N.
        states: Number of states n_x.
        inputs: Number of inputs n_u.

    Raises:
        ParameterError: If a number is below one, or all make more than 10^8 entries.
    """

    @checked
    def __init__(self, stages: int, states: int, inputs: int) -> None:
        for name, value in (("stages", stages), ("states", states), ("inputs", inputs)):
            if not 1 <= value <= _MOST // max(1, stages * (states + inputs)):
                raise ParameterError(name, f"one at least, {_MOST} numbers in all", value)
        self.sizes = stages, states, inputs
        dtype = np.dtype(_fields(*self.sizes), align=True)
        macros = {"STAGES": stages, "STATES": states, "INPUTS": inputs}
        self._kernel = load_kernel("riccati_qp", macros)
        size = dtype.itemsize
        if self._kernel is not None:
            self._kernel.riccati_qp_size.restype = ctypes.c_int64
            size = int(self._kernel.riccati_qp_size())
        if size < dtype.itemsize:
            raise CompilerError("the structure of riccati_qp.h is not that of Python")
        self._memory = np.zeros(size + 64, np.uint8)
        first = -self._memory.ctypes.data % 64
        self._address = ctypes.c_void_p(self._memory.ctypes.data + first)
        self._held: Array | None = None
        self.data: Any = np.frombuffer(self._memory.data, dtype, 1, first)[0]
        for low, high in zip(_LOW, _HIGH, strict=True):
            self[low][...], self[high][...] = -np.inf, np.inf

    def __reduce__(self) -> tuple[Any, ...]:
        fields = set(self.data.dtype.names) - {"inverse", "held"}  # addresses
        return QuadraticProgram, self.sizes, {name: self[name].copy() for name in fields}

    def __setstate__(self, fields: dict[str, Array]) -> None:
        for name, value in fields.items():
            self.data[name] = value

    def __getitem__(self, name: str) -> Array:
        """Field of the program or of its solution by name; a single number has the shape ().

        Raises:
            ParameterError: If there is none of this name.
        """
        if not (isinstance(name, str) and name in self.data.dtype.names):
            raise ParameterError("name", f"one of {', '.join(self.data.dtype.names)}", name)
        return np.asarray(self.data[name])

    def inverse(self) -> Array:
        """Inverse Hessian of the cost as a function of the inputs alone, (N n_u, N n_u).

        `solve` may be given it as long as `A`, `B`, `Q`, `S` and `R` are what they are now.
        """
        return np.asarray(np.linalg.inv(condensed(self)[0]), float)

    def solve(self, inverse: Array | None = None) -> ProgramStatus:
        """Solve the program from the solution before, or anew where there was none.

        Args:
            inverse: What `inverse` gave; that of other matrices costs time only.

        Returns:
            Status; `u` and `x` hold a solution only where it is SOLVED.

        Raises:
            ShapeError: If the inverse has another size.
        """
        if self._kernel is None:
            return _solve_dense(self)
        self.data["inverse"] = 0
        if inverse is not None:
            size = self.sizes[0] * self.sizes[2]
            self._kept = np.ascontiguousarray(real_array("inverse", inverse, (size, size)))
            if self._held is None:
                self._held = np.zeros(2 * size * (size + 4) + 16)
                self.data["held"] = self._held.ctypes.data
            self.data["inverse"] = self._kept.ctypes.data
        return ProgramStatus(self._kernel.riccati_qp_solve(self._address))


def _possible(program: QuadraticProgram) -> ProgramStatus:
    """Whether limits are numbers, and some inputs keep ranges and rates: each as an interval."""
    finite = all(np.isfinite(program[name]).all() for name in ("weight", "start", "before"))
    if not finite or any(np.isnan(program[name]).any() for name in (*_LOW, *_HIGH)):
        return ProgramStatus.NOT_FINITE
    low = high = program["before"]
    for k in range(program.sizes[0]):
        low = np.maximum(low + program["fall"][k], program["lower"][k])
        high = np.minimum(high + program["rise"][k], program["upper"][k])
        if not (low <= high + TOLERANCE).all():
            return ProgramStatus.INFEASIBLE
    return ProgramStatus.SOLVED


def condensed(program: QuadraticProgram) -> tuple[Array, Array, Array, Array]:
    """Hessian and gradient of the cost in the inputs; slopes and offsets of the states.

    Returns:
        Hessian, (n, n); gradient, (n,); slopes, ((N + 1) n_x, n); offsets, ((N + 1) n_x,), with
        n = N n_u.
    """
    count, nx, nu = program.sizes
    slopes, offsets = np.zeros((count + 1, nx, count * nu)), np.zeros((count + 1, nx))
    hessian, gradient = np.zeros((count * nu,) * 2), program["r"].ravel().copy()
    offsets[0] = program["start"]
    for k in range(count + 1):
        weighted = program["Q"][k] @ slopes[k]
        hessian += slopes[k].T @ weighted
        gradient += weighted.T @ offsets[k] + slopes[k].T @ program["q"][k]
        if k < count:
            own = slice(k * nu, (k + 1) * nu)
            cross = program["S"][k] @ slopes[k]
            hessian[own] += cross
            hessian[:, own] += cross.T
            hessian[own, own] += program["R"][k]
            gradient[own] += program["S"][k] @ offsets[k]
            slopes[k + 1] = program["A"][k] @ slopes[k]
            slopes[k + 1, :, own] += program["B"][k]
            offsets[k + 1] = program["A"][k] @ offsets[k] + program["c"][k]
    return hessian, gradient, slopes.reshape(-1, count * nu), offsets.ravel()


def _solve_dense(program: QuadraticProgram) -> ProgramStatus:
    """Status of a solution in the inputs alone, its linear algebra dense."""
    program.data["status"] = status = _possible(program)
    if status is not ProgramStatus.SOLVED:
        return status
    count, _, nu = program.sizes
    hessian, gradient, slopes, offsets = condensed(program)
    own, none = np.eye(count * nu), np.zeros(count * nu)
    rows = np.vstack([own, own - np.eye(count * nu, k=-nu), slopes])
    base = np.r_[none, -program["before"], none[nu:], offsets]
    low = np.concatenate([program[k].ravel() for k in _LOW])
    high = np.concatenate([program[k].ravel() for k in _HIGH])
    weight = np.r_[np.full(2 * count * nu, np.inf), program["weight"].ravel()]
    weight[2 * count * nu :][: program.sizes[1]] = 0.0  # the first state is given
    limits, weight = np.vstack([rows, -rows]), np.tile(weight, 2)
    room = np.r_[high - base, base - low]
    kept = np.isfinite(np.r_[high, low]) & (weight > 0)
    inputs = _nearest(hessian, gradient, limits[kept], room[kept], 1.0 / weight[kept])
    if isinstance(inputs, ProgramStatus):
        program.data["status"] = inputs
        return inputs
    program["u"][...] = inputs.reshape(count, nu)
    program["x"][...] = (slopes @ inputs + offsets).reshape(program["x"].shape)
    program.data["cost"] = _cost(program)
    return ProgramStatus.SOLVED


def _cost(program: QuadraticProgram) -> float:
    """Cost of the program's inputs and states."""
    u, x = program["u"], program["x"]
    over = x - np.clip(x, program["least"], program["most"])
    over[0] = 0.0  # the first state is given
    states = np.einsum("ki,kij,kj", x, program["Q"], x) + (program["weight"] * over**2).sum()
    inputs = np.einsum("ki,kij,kj", u, program["R"], u) / 2
    cross = np.einsum("ki,kij,kj", u, program["S"], x[:-1])
    linear = (program["q"] * x).sum() + (program["r"] * u).sum()
    return float(states / 2 + inputs + cross + linear)


def _nearest(
    hessian: Array, gradient: Array, limits: Array, room: Array, give: Array
) -> Array | ProgramStatus:
    """Minimum of 1/2 u'H u + h'u under C u <= room + give z, z the duals; or why there is none.

    In the metric of H it is the point within the limits that is nearest to the minimum without
    them; nonnegative least squares find it [Lawson & Hanson, ch. 23]. What a soft limit gives
    is a coordinate of its own.
    """
    from scipy.optimize import nnls  # slow to import, rarely needed

    if not all(np.isfinite(part).all() for part in (hessian, gradient, room)):
        return ProgramStatus.NOT_FINITE
    try:
        root = np.linalg.cholesky(hessian).T
    except np.linalg.LinAlgError:
        return ProgramStatus.NOT_CONVEX
    free = np.asarray(np.linalg.solve(hessian, -gradient), float)
    soft = np.diag(np.sqrt(give))[:, give > 0]
    ways = np.hstack([-limits @ np.linalg.inv(root), soft])
    sizes = np.linalg.norm(ways, axis=1)
    away = (limits @ free - room) / sizes
    if not (away > 0).any():
        return free
    unit = away.max()  # of length, for rounding's sake
    rows = np.vstack([(ways / sizes[:, None]).T, away / unit])
    last = np.eye(len(rows))[-1]
    try:
        duals = nnls(rows, last)[0]
    except RuntimeError:
        return ProgramStatus.NOT_CONVERGED
    *moved, left = rows @ duals - last
    return np.asarray(free - unit / left * np.linalg.solve(root, moved[: len(free)]), float)
