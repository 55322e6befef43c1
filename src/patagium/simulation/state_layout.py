"""Layout of the flat state that a flight integrates, and of the table rows.

    state = [q passive, v passive, lag states, works (4, 5 with added mass), impulse (3)]
    row = [q, v, a of the prescribed coordinates, wind (3), gust at the strips (9 a strip)]

Passive coordinates are integrated; actuated ones (and those of a body that a mount holds) follow
the row. The last part of a row is there in a gust that travels only: it is not prescribed, the
integrator looks it up where the strips are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from patagium.aerodynamics import AddedMass, Aerodynamics, WindShear
from patagium.aerodynamics.on_model import has_layer
from patagium.arrays import Array
from patagium.robot import Robot
from patagium.simulation.mounts import InternalLoadCell, Mount, on_massless_mount, with_load_cells

WORKS = ("joint_work", "air_work", "damping_work", "mount_work")
ADDED_WORK = "added_mass_work"
"""Work that follows the others in the state where there is added mass."""
IMPULSE = ("impulse_x", "impulse_y", "impulse_z")
_AFTER_VELOCITIES = ("aero_state", "works", "impulse")
"""Recorded quantities that follow coordinates and velocities in the state."""


@dataclass(frozen=True)
class StateLayout:
    """Places of all quantities in state and row.

    Attributes:
        machine: The robot, on a massless mount if it has no floating body; its
            coordinates and velocities are the last of the machine's.
        hidden: Coordinates held at zero, the first: 6 of each load cell, 6 of a massless mount.
        passive: Degrees of freedom of the machine that are integrated, as places in v.
        prescribed: Degrees of freedom that follow the row, in its order, as places in v.
        passive_coordinates: Places in q of those integrated.
        prescribed_coordinates: Places in q of those prescribed, in the row's order.
        lag_names: Names of the aerodynamic model's own states.
        works: Names of the works that ride along.
        cells: Load cells.
        met: Strips that meet a gust that travels, all or none.
        several: Whether each strip meets a wind of its own, which is recorded.
    """

    machine: Robot
    hidden: int
    passive: tuple[int, ...]
    prescribed: tuple[int, ...]
    passive_coordinates: tuple[int, ...]
    prescribed_coordinates: tuple[int, ...]
    lag_names: tuple[str, ...]
    works: tuple[str, ...] = WORKS
    cells: int = 0
    met: int = 0
    several: bool = False

    @property
    def size(self) -> int:
        """Length of the state."""
        return self.moving + self.lags + len(self.works) + len(IMPULSE)

    @property
    def moving(self) -> int:
        """Length of q and v at the beginning of the state."""
        return len(self.passive_coordinates) + len(self.passive)

    @property
    def row_size(self) -> int:
        """Length of what is prescribed of a row."""
        return len(self.prescribed_coordinates) + 2 * len(self.prescribed) + 3

    def initial_state(self, q: Array, v: Array, lags: Array) -> Array:
        """State at the start, (size,): works and impulse are zero.

        Args:
            q: Initial coordinates of the robot, (n_q,) [m, rad, 1].
            v: Initial velocities of the robot, (n,) [m/s, rad/s].
            lags: Initial lag states, (n_z,) [m/s, -].
        """
        rest = np.zeros(self.size - self.moving - len(lags))
        return np.concatenate([*self._integrated(q, v), lags, rest])

    def state_of_sample(self, samples: Mapping[str, Array], k: int) -> Array:
        """State at a recorded sample, (size,).

        Args:
            samples: Recorded quantities by name, (N, ...) each [SI].
            k: Number of the sample.
        """
        moving = self._integrated(samples["q"][k], samples["v"][k])
        return np.concatenate([*moving, *(samples[name][k] for name in _AFTER_VELOCITIES)])

    def _integrated(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Integrated part of the robot's own coordinates and velocities."""
        places = np.array(self.passive_coordinates, int), np.array(self.passive, int)
        return q[places[0] - self.hidden], v[places[1] - self.hidden]

    @property
    def quaternions(self) -> tuple[tuple[int, ...], ...]:
        """Places in the state of each quaternion that is integrated."""
        places = {k: place for place, k in enumerate(self.passive_coordinates)}
        turning = [body for body in self.machine.bodies if body.by_quaternion]
        found = [self.machine.floating_coordinates(body)[3:] for body in turning]
        return tuple(tuple(places[k] for k in q) for q in found if q[0] in places)

    @property
    def lags(self) -> int:
        """Number of the aerodynamic model's own states."""
        return len(self.lag_names)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the entries of the state, for messages."""
        names = [self.machine.coordinate_names[i] for i in self.passive_coordinates]
        rates = [f"velocity of {self.machine.dof_names[i]}" for i in self.passive]
        return (*names, *rates, *self.lag_names, *self.works, *IMPULSE)

    def coordinates_and_velocities(self, state: ca.SX, row: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Coordinates (n_q, 1) [m, rad, 1] and velocities (n, 1) [m/s, rad/s] of the machine."""
        machine = self.machine
        n_u = len(self.passive_coordinates)
        n_p = len(self.prescribed_coordinates)
        q, v = ca.SX.zeros(machine.coordinate_count, 1), ca.SX.zeros(machine.dof, 1)
        q[list(self.passive_coordinates)] = state[:n_u]
        q[list(self.prescribed_coordinates)] = row[:n_p]
        v[list(self.passive)] = state[n_u : self.moving]
        v[list(self.prescribed)] = row[n_p : n_p + len(self.prescribed)]
        return q, v

    def prescribed_acceleration(self, row: ca.SX) -> ca.SX:
        """Accelerations of hidden coordinates, then of prescribed ones, (hidden + n_p, 1) [SI]."""
        first = len(self.prescribed_coordinates)
        count = len(self.prescribed)
        given = row[first + count : first + 2 * count]
        return ca.vertcat(ca.SX.zeros(self.hidden, 1), given)

    def after_velocities(self, state: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Lag states, (n_z, 1), works [J] and impulse, (3, 1) [N s], from the state."""
        first = self.moving + self.lags
        last = first + len(self.works)
        return state[self.moving : first], state[first:last], state[last:]

    def normalized(self, state: ca.SX) -> ca.SX:
        """State with its quaternions scaled to length one, (size, 1).

        A quaternion's rate keeps its length but for the integrator's error, and nothing else
        depends on that length: the scaling is a projection that costs no order.
        """
        scaled = ca.SX(state)
        for places in self.quaternions:
            quaternion = state[list(places)]
            scaled[list(places)] = quaternion / ca.sqrt(ca.sumsqr(quaternion))
        return scaled


def state_layout(
    robot: Robot,
    aero: Aerodynamics,
    mount: Mount,
    added_mass: AddedMass | None = None,
    cells: Sequence[InternalLoadCell] = (),
) -> StateLayout:
    """Layout of a robot's flight.

    Args:
        robot: The machine; numbers or symbols.
        aero: Model of the air around it.
        mount: Mount that holds it.
        added_mass: Inertia of the air, or None.
        cells: Load cells.
    """
    on_ground = robot if robot.floating else on_massless_mount(robot)
    machine = with_load_cells(on_ground, cells)
    hidden = machine.dof - robot.dof
    held = machine.floating_dofs if robot.floating and mount.kind != "free" else ()
    prescribed = (*machine.actuated, *(i for i in held if i not in machine.actuated))
    follows = {*range(hidden), *prescribed}
    passive = tuple(i for i in range(machine.dof) if i not in follows)
    works = WORKS if added_mass is None else (*WORKS, ADDED_WORK)
    places = machine.coordinate_indices
    driven = tuple(places[i] for i in machine.actuated)
    kept = [k for body in machine.bodies for k in machine.floating_coordinates(body) if held]
    follows = {*range(hidden), *driven, *kept}
    return StateLayout(
        machine=machine,
        hidden=hidden,
        passive=passive,
        prescribed=prescribed,
        passive_coordinates=tuple(k for k in range(machine.coordinate_count) if k not in follows),
        prescribed_coordinates=(*driven, *(k for k in kept if k not in driven)),
        lag_names=aero.state_names,
        works=works,
        cells=len(cells),
        met=len(robot.strips) if aero.air.traveling else 0,
        several=bool(robot.strips) and (bool(aero.air.traveling) or has_layer(aero, WindShear)),
    )
