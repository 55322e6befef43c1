"""Mean power that still air gives to random wings in random motions: it must never be positive.

A body without mass of its own carries two wings through still air at a constant speed, while
the wings sweep, flap and feather. Size, planform, twist, motion, speed and direction are drawn
from a seed. What joints and mount give, the air must take: the work of the air over the last
wingbeat, its inertia included, is negative. `python -m patagium_lab.validation.still_air 1000 2`
prints a table of the models; a name after it chooses one.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import patagium as pt
from patagium.aerodynamics import AddedMass, Aerodynamics
from patagium.arrays import Array
from patagium.errors import SimulationFailed
from patagium.robot import Robot
from patagium.robot.files import load_robot_text

Make = Callable[[Robot], Aerodynamics]

BEATS = 6
"""Wingbeats of a flight; the last one is judged."""
STEPS = 200
"""Time steps of a wingbeat."""
ROUNDING = 1e-3
"""Share of the mean of the power's size below which a mean is none: a lag state of long memory is
that far from periodic after `BEATS`."""

_FAR = 1e4  # radius of a path that is straight within a flight [m]

ROBOT = """
name: random_wings
gravity: 9.81 m/s^2
bodies:
  body:
    floating: true
    mass: 1 g
    center_of_mass: [0, 0, 0]
    shape: {{type: box, size: [1 cm, 1 cm, 1 cm]}}
  left_wing:
    parent: body
    joints: [{{name: left_flap, axis: x}}, {{name: left_sweep, axis: -z}}]
    mass: 0.01 g
    center_of_mass: [0, {half}, 0]
    shape: {{type: plate, axis: y, chord: {root}, span: {span}, thickness: 0.1 mm}}
  left_blade:
    parent: left_wing
    joints: [{{name: left_feather, axis: -y}}]
    mass: 0.01 g
    center_of_mass: [0, {half}, 0]
    shape: {{type: plate, axis: y, chord: {root}, span: {span}, thickness: 0.1 mm}}
wings:
  - name: left_wing
    segments:
      - body: left_blade
        strips: 4
        stations:
          - {{span: {begin}, leading: {lead}, trailing: {trail}}}
          - {{span: {span}, leading: {lead_tip}, trailing: {trail_tip}}}
mirror: [{{from: left, to: right}}]
"""


def models() -> dict[str, tuple[Make, bool]]:
    """Makers of the models by name, each with whether the air has inertia."""
    delay = pt.air.StallDelay()

    def line(robot: Robot) -> Aerodynamics:
        return pt.LiftingLine(robot, stall_delay=delay)

    plain: dict[str, Make] = {
        "quasi-steady": pt.QuasiSteady,
        "quasi-steady, rotational": lambda robot: pt.QuasiSteady(robot, rotational=True),
        "DeLaurier": pt.DeLaurier,
        "lifting line": pt.LiftingLine,
        "lifting line, stall delay": line,
        "quasi-steady, inflow": lambda robot: pt.air.Inflow(pt.QuasiSteady(robot)),
        "quasi-steady by Reynolds number, inflow": lambda robot: pt.air.Inflow(
            pt.QuasiSteady(robot, polar=pt.air.ReynoldsPolar())
        ),
        "DeLaurier, inflow": lambda robot: pt.air.Inflow(pt.DeLaurier(robot)),
        "lifting line, stall delay, inflow": lambda robot: pt.air.Inflow(line(robot)),
    }
    with_mass = {
        f"{name}, added mass": (plain[name], True)
        for name in ("quasi-steady", "DeLaurier", "lifting line", "lifting line, stall delay")
    }
    return {name: (make, False) for name, make in plain.items()} | with_mass


def random_wings(rng: np.random.Generator) -> tuple[Robot, Any, Any, float]:
    """Random robot, gait, mount that carries it, and frequency [Hz].

    Args:
        rng: Source of the numbers.
    """
    span = 10 ** rng.uniform(-2.0, -0.4)
    root = span / rng.uniform(1.0, 6.0)
    tip, axis = root * rng.uniform(0.3, 1.0), rng.uniform(0.0, 0.5)
    lengths = {
        "half": span / 2, "root": root, "span": span, "begin": span * rng.uniform(0.0, 0.2),
        "lead": axis * root, "trail": (axis - 1) * root,
        "lead_tip": axis * tip, "trail_tip": (axis - 1) * tip,
    }  # fmt: skip
    text = ROBOT.format(**{name: f"{x:.9f} m" for name, x in lengths.items()})
    robot = load_robot_text(text)
    sweep, flap = rng.uniform(0.0, 1.2, 2)
    tip_speed = 10 ** rng.uniform(0.0, 1.2)
    frequency = tip_speed / (4 * span * max(float(np.hypot(sweep, flap)), 0.1))
    names = ("flap", "sweep", "feather")
    gait = pt.gaits.sinusoidal(
        robot,
        frequency=frequency,
        phase=dict(zip(names, rng.uniform(-np.pi, np.pi, 3), strict=True)),
        offset={"feather": rng.uniform(-0.5, np.pi / 2), "flap": rng.uniform(-0.3, 0.3)},
        **dict(zip(names, (flap, sweep, rng.uniform(0.0, 1.2)), strict=True)),
    )
    speed, (pitch, yaw) = rng.uniform(0.0, 2.0) * tip_speed, rng.uniform(-1.0, 1.0, 2)
    attitude = (0.0, pitch, np.pi / 2 + yaw)  # the path begins along y
    path = pt.paths.circle((0.0, 0.0, 0.0), _FAR, speed=speed, attitude=attitude)
    return robot, gait, pt.mounts.carried(path), frequency


def power_share(make: Make, added_mass: bool, seed: int) -> float:
    """Mean power of still air over the last wingbeat, over the mean of its size, -1 to 1.

    NaN where the flight stops before its end.

    Args:
        make: Makes the model of the air.
        added_mass: Whether the air has inertia.
        seed: Seed of wings and motion.
    """
    robot, gait, mount, frequency = random_wings(np.random.default_rng(seed))
    try:
        flight = pt.simulate(
            robot,
            make(robot),
            gait,
            duration=BEATS / frequency,
            time_step=1 / (STEPS * frequency),
            mount=mount,
            added_mass=AddedMass(robot) if added_mass else None,
        )
    except SimulationFailed:
        return float("nan")
    work = (flight["air_work"] + flight["added_mass_work"]).to_numpy()
    steps = np.diff(work[-STEPS - 1 :])
    return float(steps.sum() / np.abs(steps).sum())


def power_shares(
    count: int, seed: int, names: Mapping[str, Any] | None = None, first: int = 0
) -> Array:
    """Shares of each model over random wings, (n_models, count) [1].

    Args:
        count: Number of wings and motions.
        seed: Seed of all.
        names: Models by name; all by default.
        first: Number of the first wing of this seed.
    """
    chosen = (names or models()).values()
    begin = seed * 1_000_000 + first
    seeds = range(begin, begin + count)
    return np.array([[power_share(make, added, k) for k in seeds] for make, added in chosen])


def print_table(count: int, seed: int, names: list[str]) -> None:
    """Table of the models: wings, flights that stopped, largest share, positive shares.

    Args:
        count: Number of wings and motions.
        seed: Seed of all.
        names: Names of the models.
    """
    print("| model | wings | stopped | largest share [1] | positive |\n|---|---:|---:|---:|---:|")
    for name in names:
        found = power_shares(count, seed, {name: models()[name]})[0]
        stopped, positive = int(np.isnan(found).sum()), np.flatnonzero(found > ROUNDING)
        which = f" ({', '.join(map(str, positive))})" if len(positive) else ""
        row = f"{name} | {count} | {stopped} | {np.nanmax(found):+.2g} | {len(positive)}{which}"
        print(f"| {row} |", flush=True)


if __name__ == "__main__":
    print_table(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:] or [*models()])
