"""Lagrange's equations by a computer algebra system, as a careful user would derive them.

K and U are written out, D = d^2 K / d v^2, C v = (d(dK/dv)/dq) v - dK/dq, G = dU/dq by
symbolic differentiation, nothing expanded and nothing simplified (both blow up).
SymPy or SymEngine, the same lines. Neglected: what `Robot` neglects.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from patagium.dynamics.chain import chain_of
from patagium.errors import ParameterError
from patagium.robot.model import Body, Robot
from patagium_lab.rivals.symbols import with_symbols

Row = list[Any]
_ZERO: Row = [0, 0, 0]
_ONE: list[Row] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


@dataclass(frozen=True)
class SymbolicEquations:
    """Equations of motion as symbolic expressions.

    Attributes:
        backend: "sympy" or "symengine".
        arguments: Symbols of q (n,), v (n,) and the robot's parameters (n_p,) [SI].
        mass_matrix: D, n rows of n.
        coriolis: C v, n entries.
        gravity: G, n entries.
        derivation_time: Processor time taken, without any C [s].
    """

    backend: str
    arguments: tuple[Row, Row, Row]
    mass_matrix: list[Row]
    coriolis: Row
    gravity: Row
    derivation_time: float

    @property
    def bias(self) -> Row:
        """C v + G, n entries."""
        return [c + g for c, g in zip(self.coriolis, self.gravity, strict=True)]

    @property
    def lower_triangle(self) -> Row:
        """Lower triangle of D by rows, n (n + 1) / 2 entries."""
        return [entry for i, row in enumerate(self.mass_matrix) for entry in row[: i + 1]]


def derive_symbolic(robot: Robot, backend: str = "sympy") -> SymbolicEquations:
    """The equations of motion of a robot by symbolic differentiation of its energies.

    Args:
        robot: The machine.
        backend: "sympy" or "symengine", which must be installed.

    Raises:
        ParameterError: If its attitude is a quaternion: Lagrange's equations are written
            for velocities that are rates of coordinates.
    """
    if robot.attitude == "quaternion":
        raise ParameterError("robot", "a robot with Euler angles", "a quaternion")
    algebra: Any = importlib.import_module(backend)
    started = time.process_time()
    q = [algebra.Symbol(f"q{i}") for i in range(robot.dof)]
    v = [algebra.Symbol(f"v{i}") for i in range(robot.dof)]
    p = [algebra.Symbol(f"p{i}") for i in range(len(robot.parameter_names))]
    machine = with_symbols(robot, dict(zip(robot.parameter_names, p, strict=True)))
    kinetic, potential = _energies(algebra, machine, q, v)
    momentum = [kinetic.diff(rate) for rate in v]
    lower = [[momentum[i].diff(v[j]) for j in range(i + 1)] for i in range(robot.dof)]
    mass_matrix = [
        [lower[max(i, j)][min(i, j)] for j in range(robot.dof)] for i in range(robot.dof)
    ]
    coriolis = [
        sum(p_i.diff(x) * rate for x, rate in zip(q, v, strict=True)) - kinetic.diff(x_i)
        for p_i, x_i in zip(momentum, q, strict=True)
    ]
    gravity = [potential.diff(x) for x in q]
    return SymbolicEquations(
        backend, (q, v, p), mass_matrix, coriolis, gravity, time.process_time() - started
    )


def _energies(algebra: Any, machine: Robot, q: Row, v: Row) -> tuple[Any, Any]:
    """Kinetic and potential energy; machine's numbers are symbols."""
    kinetic: Any = 0
    potential: Any = algebra.Integer(0)
    for body, center, turned in _walk(algebra, machine, q, v):
        velocity = [
            sum(algebra.sympify(c).diff(x) * rate for x, rate in zip(q, v, strict=True))
            for c in center
        ]
        xx, yy, zz, xy, xz, yz = (_exact(x) for x in body.inertia)
        spin = _product([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], turned)
        kinetic += body.mass * sum(x**2 for x in velocity) / 2
        kinetic += sum(w * s for w, s in zip(turned, spin, strict=True)) / 2
        potential += _exact(machine.gravity) * body.mass * center[2]
    return kinetic, potential


def _walk(algebra: Any, machine: Robot, q: Row, v: Row) -> Iterator[tuple[Body, Row, Row]]:
    """Each body, its centre of mass in world axes, its angular velocity in body axes."""
    frames: list[tuple[Row, list[Row], Row]] = []
    for body in machine.bodies:
        position, rotation, turned = (
            (_ZERO, _ONE, _ZERO) if body.parent < 0 else frames[body.parent]
        )
        orientation = [[_exact(x) for x in row] for row in body.orientation]
        position = _sum(position, _product(rotation, [_exact(x) for x in body.position]))
        rotation, turned = _multiply(rotation, orientation), _product(_flip(orientation), turned)
        for step in chain_of(machine, body):
            axis, (dof,) = [_exact(x) for x in step.axes[0]], step.dofs
            if not step.turns:
                position = _sum(position, _product(rotation, [a * q[dof] for a in axis]))
                continue
            turn = _turn(axis, algebra.sin(q[dof]), algebra.cos(q[dof]))
            rotation = _multiply(rotation, turn)
            turned = _sum(_product(_flip(turn), turned), [a * v[dof] for a in axis])
        frames.append((position, rotation, turned))
        center = _product(rotation, [_exact(x) for x in body.center_of_mass])
        yield body, _sum(position, center), turned


def _exact(value: Any) -> Any:
    """A whole number as such, so that products with zero and one vanish."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _turn(axis: Row, s: Any, c: Any) -> list[Row]:
    x, y, z = axis
    return [
        [x * x + c * (1 - x * x), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s],
        [x * y * (1 - c) + z * s, y * y + c * (1 - y * y), y * z * (1 - c) - x * s],
        [x * z * (1 - c) - y * s, y * z * (1 - c) + x * s, z * z + c * (1 - z * z)],
    ]


def _product(matrix: list[Row], vector: Row) -> Row:
    return [sum(m * x for m, x in zip(row, vector, strict=True)) for row in matrix]


def _multiply(left: list[Row], right: list[Row]) -> list[Row]:
    return _flip([_product(left, column) for column in _flip(right)])


def _flip(matrix: list[Row]) -> list[Row]:
    return [list(column) for column in zip(*matrix, strict=True)]


def _sum(a: Row, b: Row) -> Row:
    return [x + y for x, y in zip(a, b, strict=True)]
