"""Hovering monarch butterfly under feedback of its position, compared with a public program's.

The program (FWUAV; its equations are those of `monarch` with a prescribed attitude) flies 10,000
starts within 3 m for 100 beats and counts those that end on the orbit, without its abdomen at work
and with it. Its law is repeated: the force that position, velocity and integral ask for becomes
changes of the stroke's amplitude, of the mean feathering and of the abdomen's amplitude, by slopes
that depend on the signs of forces, each at most .1 rad, at each of 100 Euler's steps a beat.
Here starts lie on a spiral, and the orbit is the one that is flown here, its drift taken out.
"""

from __future__ import annotations

import numpy as np

from patagium.aerodynamics import Air
from patagium.arrays import Array
from patagium.native import load_functions
from patagium.simulation.flight_equations import flight_functions
from patagium.simulation.gait_models import FourierGait
from patagium.simulation.mounts import mount_of
from patagium.simulation.state_layout import state_layout
from patagium_lab.validation.cases.case import CaseResult, ErrorLimit
from patagium_lab.validation.cases.monarch import (
    Hover,
    PublishedTurn,
    flown_beat,
    hovers,
    published,
)

STARTS, BEATS = 10_000, 100
STEPS = 100
"""Euler's steps a beat."""
REACH = 3.0
"""Distance from the orbit within which flights start [m]."""
MOST = 0.1
"""Change of an angle, at most [rad]."""
BACK = 1e-4
"""Mean size of the demanded force in the last beat of a flight that is back, at most [N]."""
_HARMONICS = 8  # of the orbit that is followed
_DOWN = np.array([1.0, -1.0])  # vectors here are forward and down


class Butterfly:
    """The butterfly and the orbit of its hover, step by step of a beat.

    Attributes:
        step: Time of a step [s].
        mass: Mass [kg].
        rows: Position, velocity and acceleration of the joints, (STEPS, 3, n_a) [SI].
        ways: Their change with the amplitude of the stroke, the mean of the feathering and the
            amplitude of the abdomen, (STEPS, 3, 3, n_a).
        orbit: Position and velocity, (STEPS, 4) [m, m/s].
        abdomen: Inertial force of the abdomen's own motion, over its mass and the distance of its
            center of mass from its joint, (STEPS, 2) [rad/s^2].
    """

    def __init__(self) -> None:
        hover = next(one for one in hovers() if one.name == "attitude prescribed")
        robot, gait = hover.robot, hover.gait
        air, vacuum = (
            PublishedTurn(robot, Air(one), force_point="fixed") for one in (1.225, 1e-12)
        )
        self._rate = load_functions(
            f"rate of flights side by side {air.key} {robot.structure}",
            lambda: flight_functions(robot, air, mount_of(robot, None))[:1],
            label=f"flights of {robot.name}, side by side",
        )["rate"]
        self._airs, self._constants = (vacuum.parameters, air.parameters), robot.parameters
        passive = [robot.dof_names[i] for i in robot.passive]
        self._places = [len(passive) + passive.index(name) for name in "xz"]
        self._size = state_layout(robot, air, mount_of(robot, None)).size
        self.mass, self.step = robot.mass, 1 / (STEPS * gait.frequency)
        found = gait.motion(np.arange(STEPS) * self.step)
        self.rows = np.stack([found.position, found.velocity, found.acceleration], axis=1)
        self.ways = _ways(gait, self.rows)
        self.abdomen = _abdomen_force(gait, self.rows)
        self.orbit = _followed(hover)
        self.still = self.acceleration(np.zeros((STEPS, 2)), self.rows, in_air=False)

    def acceleration(self, velocity: Array, rows: Array, *, in_air: bool = True) -> Array:
        """Acceleration of the thorax, (N, 2) [m/s^2].

        Args:
            velocity: Its velocity, (N, 2) [m/s].
            rows: Motion of the joints, (N, 3, n_a) [SI].
            in_air: Whether there is air.
        """
        count = len(velocity)
        states = np.zeros((count, self._size))
        states[:, self._places] = velocity * _DOWN
        given = np.hstack([rows.reshape(count, -1), np.zeros((count, 3))])
        found = self._rate.batch(states, given, self._constants, self._airs[in_air])
        return np.asarray(np.asarray(found)[:, self._places] * _DOWN)


def _ways(gait: FourierGait, rows: Array) -> Array:
    """Derivative of the joints' motion by each commanded angle; see `Butterfly.ways`."""
    motion = published()["orbits"]["attitude_prescribed"]["motion"]
    ways = np.zeros((STEPS, 3, *rows.shape[1:]))
    for k, name in enumerate(gait.joints):
        away = rows[:, :, k] - [gait.mean[k], 0, 0]
        if name.endswith("plunge"):
            ways[:, 0, :, k] = away / motion["phi_m"]
        elif name.endswith("feather"):
            ways[:, 1, 0, k] = 1.0  # set anew at each step, without a rate
        elif name == "abdomen":
            ways[:, 2, :, k] = away / motion["theta_A_m"]
    return ways


def _abdomen_force(gait: FourierGait, rows: Array) -> Array:
    """Inertial force of the abdomen, with half of the Coriolis force, as in the public program."""
    hinge, thorax = (rows[:, :, gait.joints.index(name)] for name in ("abdomen", "pitch"))
    angle, rate = hinge[:, 0] - thorax[:, 0], hinge[:, 1] - thorax[:, 1]
    turn = np.array([[np.sin(angle), np.cos(angle)], [np.cos(angle), -np.sin(angle)]])
    return np.asarray(-np.einsum("ijk,jk->ki", turn, [hinge[:, 2], hinge[:, 1] * rate]))


def _followed(hover: Hover) -> Array:
    """Orbit that is followed: a simulated beat without its drift, as a short Fourier series."""
    flown = flown_beat(hover, errors=True)[:, [2, 3, 0, 1]] * np.tile(_DOWN, 2)
    count = len(flown) - 1
    flat = flown[:-1] - np.arange(count)[:, None] / count * (flown[-1] - flown[0])
    parts = np.fft.rfft(flat, axis=0)[: _HARMONICS + 1] / count
    return np.asarray(np.fft.irfft(parts * STEPS, STEPS, axis=0))


def demanded(starts: Array, weight: float, beats: int = BEATS) -> Array:
    """Mean size of the force that is demanded in the last beat of each flight, (N,) [N].

    Args:
        starts: Positions at the start, off the orbit's, (N, 2) [m].
        weight: Weight of the abdomen [1]; 0: it swings as on the orbit.
        beats: Number of beats.
    """
    fly, law = Butterfly(), published()["feedback"]
    gains = fly.mass * np.array(law["gains"])[:, None, None]
    slopes = np.array([[np.resize(one, 2) for one in law[axis]] for axis in ("forward", "down")])
    answers = np.array([[_answer(slopes, weight, ahead, one) for ahead in (True, False)]
                        for one in fly.abdomen])  # fmt: skip
    position, velocity = fly.orbit[0, :2] + starts, np.tile(fly.orbit[0, 2:], (len(starts), 1))
    integral, size = np.zeros_like(starts), np.zeros(len(starts))
    for k in range(beats * STEPS):
        at = k % STEPS
        off, slow = fly.orbit[at, :2] - position, fly.orbit[at, 2:] - velocity
        force = (gains * [off, slow, integral]).sum(axis=0)
        if k >= (beats - 1) * STEPS:
            size += np.hypot(*force.T) / STEPS
        rows = np.broadcast_to(fly.rows[at], (len(starts), *fly.rows.shape[1:]))
        pushed = fly.acceleration(velocity, rows)[:, 0] > fly.still[at, 0]
        changes = np.where(pushed[:, None], *(force @ answer.T for answer in answers[at]))
        rows = rows + np.tensordot(np.clip(changes, -MOST, MOST), fly.ways[at], axes=1)
        faster = fly.step * fly.acceleration(velocity, rows)
        position, velocity = position + fly.step * velocity, velocity + faster
        integral = integral + fly.step * off
    return size


def _answer(slopes: Array, weight: float, pushed: bool, abdomen: Array) -> Array:
    """Changes of the three angles over the demanded force, (3, 2) [rad/N].

    Args:
        slopes: Slopes of the force, axis by axis and angle by angle, where it is pushed that way
            and where it is not, (2, 3, 2) [N/rad].
        weight: Weight of the abdomen [1].
        pushed: Whether the air pushes forward.
        abdomen: Force of the abdomen's own motion, (2,).
    """
    by_angle = slopes[:, :, 0 if pushed else 1].copy()
    by_angle[:, 2] = np.where(abdomen > 0, slopes[:, 2, 0], slopes[:, 2, 1])
    balance = by_angle[0] * [weight, weight, weight - 1]
    return np.linalg.inv(np.vstack([by_angle, balance]))[:, :2]


def spiral(count: int) -> Array:
    """Starts whose distances are even up to `REACH`, turned by the golden angle, (count, 2) [m]."""
    places = np.arange(count)
    turns = places * np.pi * (3 - np.sqrt(5))
    away = REACH * (places + 0.5) / count
    return np.column_stack([away * np.cos(turns), away * np.sin(turns)])


def compute(count: int = STARTS) -> list[CaseResult]:
    """Shares of the starts from which flights return to the orbit: published, and found here.

    Args:
        count: Number of starts.
    """
    shares = published()["feedback"]["shares"]
    expected = np.array(list(shares.values()))
    back = [demanded(spiral(count), weight) < BACK for weight in shares]
    found = np.array([one.mean() for one in back])
    told = [
        f"{k + 1} weight {weight:g} of the abdomen, {found[k]:.4f} (published {share:.4f})"
        for k, (weight, share) in enumerate(shares.items())
    ]
    name = "with the program's errors"
    return [
        CaseResult(
            "Monarch butterfly under feedback",
            "figures of the public program FWUAV of Tejaswi, Kang, Lee and others",
            "case [1]",
            "share of starts that are back [1]",
            np.arange(1.0, len(expected) + 1),
            expected,
            {name: found},
            "largest absolute difference [1]",
            {name: float(np.abs(found - expected).max())},
            {},
            f"{count} starts within 3 m of the orbit, each flown for 100 beats. Those of the "
            f"program are random: its shares are known to .004. Cases: {'; '.join(told)}.",
            {name: ErrorLimit(0.01, "a point, as two draws of 10,000 starts may differ")},
        )
    ]
