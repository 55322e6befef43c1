"""Hovering orbits of a monarch butterfly whose abdomen swings, beside a public program's.

The program (FWUAV of Tejaswi, Kang, Lee and others) has two errors, and both are repeated for the
comparison: it turns the rate of the thorax into the axes of the wings the wrong way, and with a
free attitude it counts the inertia and weight of wings and abdomen about their joints twice in the
moment on the thorax. `closed_orbits` closes the three hovers exactly without them. Neglected:
smoothing of signs below .1 m/s, which the program has not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any

import casadi as ca
import numpy as np
import yaml

from patagium.aerodynamics import Air, QuasiSteady
from patagium.aerodynamics.local_flow import strip_motions
from patagium.aerodynamics.strip_loads import AeroExpressions, assemble
from patagium.arrays import Array
from patagium.control import NoOrbit, Orbit, floquet, trim
from patagium.dynamics import Dynamics
from patagium.dynamics.chain import vector
from patagium.dynamics.kinematics import body_poses, body_velocities
from patagium.errors import ParameterError
from patagium.robot import Robot, load_robot_text
from patagium.simulation.gait_models import FourierGait
from patagium_lab.validation.cases.case import CaseResult, ErrorLimit

STEPS = 480
"""Time steps a wingbeat."""
_CASES = files("patagium_lab").joinpath("cases")
_SAMPLES, _HARMONICS = 1024, 64
_SLIDES = "".join(
    f"\n      - {{name: {axis}, type: prismatic, axis: {axis}, passive: true}}" for axis in "xyz"
)
_PRESCRIBED = f"joints:{_SLIDES}\n      - {{name: pitch, axis: y}}"


@dataclass(frozen=True)
class PublishedTurn(QuasiSteady):
    """Quasi-steady air with the public program's error: Q W for Q^T W, the rate of the thorax.

    Q maps axes of the wing to those of the thorax, whose angular velocity is W.
    """

    name = "monarch_published"

    def expressions(
        self, robot: Robot, q: ca.SX, v: ca.SX, state: ca.SX, wind: ca.SX, parameters: ca.SX
    ) -> AeroExpressions:
        """Equations of the model; see `Aerodynamics.expressions`."""
        poses, twists = body_poses(robot, q), body_velocities(robot, q, v)
        thorax = robot.body_index("body")
        motions = []
        for motion in strip_motions(robot, q, v, wind):
            strip = motion.strip
            turn = poses[thorax].rotation.T @ poses[strip.body].rotation
            rate = (turn - turn.T) @ twists[thorax].angular
            more = ca.cross(rate, vector(strip.quarter_chord))
            ahead, upward = (ca.dot(vector(one), more) for one in (strip.forward, strip.normal))
            forward, normal = motion.forward + ahead, motion.normal + upward
            motions.append(replace(motion, forward=forward, normal=normal))
        loads = [self._load(motion, parameters) for motion in motions]
        return assemble(robot, q, loads, ca.SX(0, 1))


@dataclass(frozen=True)
class Hover:
    """Published hover of the butterfly.

    Attributes:
        name: Name of the hover.
        robot: The butterfly.
        gait: Published motion of its joints.
        start: Velocity forward and up [m/s], pitch [rad] and its rate [rad/s], by name.
        swing: Largest less least of the velocity forward and up [m/s], and of the position [m].
    """

    name: str
    robot: Robot
    gait: FourierGait
    start: dict[str, float]
    swing: Array


@cache
def published() -> dict[str, Any]:
    """Numbers that the public program stores: its orbits and its feedback (`monarch.yaml`)."""
    words: dict[str, Any] = yaml.safe_load(_CASES.joinpath("monarch.yaml").read_text("utf-8"))
    return words


def hovers() -> list[Hover]:
    """The three published hovers."""
    text = _CASES.joinpath("monarch_robot.yaml").read_text(encoding="utf-8")
    found = []
    for name, orbit in published()["orbits"].items():
        still = "theta_B_0" in orbit["motion"]  # the attitude is prescribed
        robot = load_robot_text(text.replace("floating: true", _PRESCRIBED) if still else text)
        gait, swing = _gait(robot, orbit["motion"]), np.array(orbit["swing"])
        found.append(Hover(name.replace("_", " "), robot, gait, orbit["start"], swing))
    return found


def _gait(robot: Robot, k: dict[str, float]) -> FourierGait:
    """Published motion as a Fourier series."""
    x = 2 * np.pi * np.arange(_SAMPLES) / _SAMPLES
    swing = np.arcsin(k["phi_K"] * np.cos(x)) / np.arcsin(k["phi_K"])
    turn = np.tanh(k["theta_C"] * np.sin(x + k["theta_a"])) / np.tanh(k["theta_C"])
    angles = {
        "tilt": k["beta"] + 0 * x,
        "plunge": -(k["phi_m"] * swing + k["phi_0"]),
        "sweep": -(k["psi_m"] * np.cos(2 * x + k["psi_a"]) + k["psi_0"]),
        "feather": k["theta_m"] * turn + k["theta_0"],
        "abdomen": k["theta_A_m"] * np.cos(x + k["theta_A_a"]) + k["theta_A_0"],
    }
    if "theta_B_0" in k:
        angles["pitch"] = -(k["theta_B_m"] * np.cos(x + k["theta_B_a"]) + k["theta_B_0"])
    joints = tuple(robot.dof_names[i] for i in robot.actuated)
    sides = [angles[name.removeprefix("left_").removeprefix("right_")] for name in joints]
    series = np.fft.rfft(np.array(sides).T, axis=0)[: _HARMONICS + 1] * 2 / _SAMPLES
    return FourierGait(joints, k["f"], series[0].real / 2, series[1:].real, -series[1:].imag)


def flown_beat(hover: Hover, *, errors: bool) -> Array:
    """Velocities, then positions, forward and up at each step of a beat, (STEPS + 1, 4) [m/s, m].

    Args:
        hover: The hover, flown from its start with the published motion.
        errors: Whether the two errors of the public program are repeated.
    """
    robot = hover.robot
    kind = PublishedTurn if errors else QuasiSteady
    aero, dynamics = kind(robot, Air(1.225), force_point="fixed"), Dynamics(robot)
    motion = hover.gait.motion(np.arange(2 * STEPS + 1) / (2 * STEPS * hover.gait.frequency))
    passive, moved = list(robot.passive), list(robot.actuated)
    doubled = [robot.index(name) for name in ("abdomen", "left_tilt", "right_tilt")]
    pitch = robot.index("pitch")

    def rate(row: int, state: Array) -> Array:
        q, v = robot.coordinates(), np.zeros(robot.dof)
        q[passive], v[passive] = np.split(state, 2)
        q[moved], v[moved] = motion.position[row], motion.velocity[row]
        mass, bias = dynamics.mass_matrix_and_bias(q, v)
        force = aero.generalized_force(q, v) - bias
        if errors and pitch in passive:
            force[pitch] += bias[doubled].sum()
            mass = mass.copy()
            mass[pitch] -= mass[doubled].sum(axis=0)
        force = force - mass[:, moved] @ motion.acceleration[row]
        freed = np.linalg.solve(mass[np.ix_(passive, passive)], force[passive])
        return np.concatenate([v[passive], freed])

    names = [robot.dof_names[i] for i in passive]
    start = hover.start
    q = {"pitch": start.get("pitch", 0.0)}
    v = {"x": start["x"], "z": start["z"], "pitch": start.get("pitch_rate", 0.0)}
    states = [np.array([one.get(name, 0.0) for one in (q, v) for name in names])]
    step = 1.0 / (STEPS * hover.gait.frequency)
    for row in range(0, 2 * STEPS, 2):
        k1 = rate(row, states[-1])
        k2 = rate(row + 1, states[-1] + step / 2 * k1)
        k3 = rate(row + 1, states[-1] + step / 2 * k2)
        k4 = rate(row + 2, states[-1] + step * k3)
        states.append(states[-1] + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    flown = np.array(states)
    places = [first + names.index(name) for first in (len(names), 0) for name in "xz"]
    return np.asarray(flown[:, places])


@cache
def closed_orbits() -> dict[str, Orbit]:
    """The three hovers closed exactly, without the errors, their gaits changed least.

    Raises:
        ParameterError: If one is not found.
    """
    found = {}
    for hover in hovers():
        aero = QuasiSteady(hover.robot, Air(1.225), force_point="fixed")
        orbit = trim(hover.robot, aero, hover.gait, speed=0.0, climb=0.0, steps=STEPS)
        if isinstance(orbit, NoOrbit):
            raise ParameterError("hover", "one that is found", f"{hover.name}: {orbit.reason}")
        found[hover.name] = orbit
    return found


def compute() -> list[CaseResult]:
    """Swings of the three hovers, and their orbits in words."""
    known = hovers()
    expected = np.concatenate([hover.swing for hover in known])
    models: dict[str, Any] = {
        name: np.concatenate([np.ptp(flown_beat(one, errors=errors), axis=0) for one in known])
        for name, errors in (("with the program's errors", True), ("without them", False))
    }
    apart = {name: float(np.abs(one / expected - 1).max()) for name, one in models.items()}
    told = "; ".join(
        f"{name}: residual {orbit.residual:.0e}, frequency {orbit.gait.frequency:.2f} Hz, "
        f"largest multiplier {abs(floquet(orbit).multipliers).max():.3f}"
        for name, orbit in closed_orbits().items()
    )
    return [
        CaseResult(
            "Hovering monarch butterfly",
            "figures of the public program FWUAV of Tejaswi, Kang, Lee and others",
            "swing [1]",
            "swing [m/s, m]",
            np.arange(1.0, len(expected) + 1),
            expected,
            models,
            "largest relative difference [1]",
            apart,
            {},
            "Swings within a beat of the velocity forward and up and of the position, of "
            f"{', '.join(hover.name for hover in known)}. The public program turns the rate of "
            "the thorax into the axes of the wings the wrong way, and with a free attitude counts "
            "the moments of wings and abdomen about their joints twice; without these errors its "
            f"hovers are none, and the nearest ones, closed exactly, are: {told}.",
            {"with the program's errors": ErrorLimit(0.01, "the same equations, other steps")},
        )
    ]
