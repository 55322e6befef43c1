"""Sensor packet to training sample: inverse dynamics of one packet as a compiled function.

A packet is one row of numbers, [time, q, v, a, u1], n each, and q one more with a quaternion. It
becomes the network's input and the force of the air, y = D(q) a + C(q, v) v + G(q) - u1 + d v,
the equation of `training_data` for a robot that nothing holds. Neglected: mounts and added mass,
which no sensor measures, and errors of sensors and of the robot's parameters, which end up in the
force.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from patagium.dynamics import equations
from patagium.native import NativeFunction, load_functions
from patagium.robot import Robot
from patagium.sensing.force.training_data import state_columns

Array = NDArray[np.float64]

PARTS = ("q", "v", "a", "u1")
"""What a packet holds of each coordinate, after its time."""


class Column(NamedTuple):
    """A number of a packet.

    Attributes:
        name: `time`, or part and coordinate such as `v.roll`.
        unit: Its SI unit.
    """

    name: str
    unit: str


def packet_columns(robot: Robot) -> tuple[Column, ...]:
    """What the numbers of a packet are, in order, 1 + n_q + 3 n.

    Args:
        robot: The machine that sends them.
    """
    found = [Column("time", "s")]
    for name, unit in zip(robot.coordinate_names, robot.coordinate_units, strict=True):
        found.append(Column(f"q.{name}", unit))
    for part in PARTS[1:]:
        for name, length in zip(robot.dof_names, robot.dof_units, strict=True):
            force = "N" if length == "m" else "N m"
            units = {"v": f"{length}/s", "a": f"{length}/s^2", "u1": force}
            found.append(Column(f"{part}.{name}", units[part]))
    return tuple(found)


def packet_parts(packets: Array, robot: Robot) -> list[Array]:
    """q, v, a and u1 of packets, (..., n_q) and (..., n) each.

    Args:
        packets: (..., 1 + n_q + 3 n).
        robot: The machine that sent them.
    """
    first = 1 + robot.coordinate_count
    cuts = [1, *(first + k * robot.dof for k in range(3))]
    return np.split(packets, cuts, axis=-1)[1:]


def air_force(robot: Robot, inputs: Sequence[str] | None, outputs: Sequence[str]) -> NativeFunction:
    """What a network sees and what it should say, of one packet.

    Args:
        robot: The machine.
        inputs: Names of what the network sees, such as `v.roll`; None: q, then v.
        outputs: Coordinates whose force it learns.

    Returns:
        Compiled (q, v, a, u1, parameters) -> x (n_x,), y (n_y,) [N, N m].

    Raises:
        ParameterError: If an input has no such name.
    """
    n = robot.dof
    seen = list(range(robot.state_size)) if inputs is None else state_columns(robot, inputs)
    felt = [robot.index(name) for name in outputs]

    def build() -> list[ca.Function]:
        machine, parameters = robot.symbolic()
        q = ca.SX.sym("q", robot.coordinate_count)
        v, a, u1 = (ca.SX.sym(part, n) for part in PARTS[1:])
        force = equations.inverse(machine, q, v, a) - u1 + ca.vertcat(*machine.damping) * v
        x, y = ca.vertcat(q, v)[seen], force[felt]
        names_in = [*PARTS, "parameters"]
        return [ca.Function("air_force", [q, v, a, u1, parameters], [x, y], names_in, ["x", "y"])]

    key = f"air force of packets {seen} {felt} {robot.structure}"
    return load_functions(key, build, label=f"inverse dynamics of {robot.name}")["air_force"]
