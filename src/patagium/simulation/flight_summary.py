"""Summary of a flight: how fast it flew, how high, how it turned, what it cost.

Means are over the second half, in whole wingbeats where the flight holds one. Neglected: what
happened in between; a mean hides a loop.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from patagium.aerodynamics import Inflow, QuasiSteady
from patagium.aerodynamics.description import innermost
from patagium.aerodynamics.smooth_functions import SWITCH_SPEED
from patagium.arrays import Array, stored
from patagium.dynamics.dynamics import poses_at
from patagium.errors import FlightError
from patagium.reading import json_object, made_again
from patagium.robot import Robot
from patagium.robot.model import CAPACITIES, capacity_units
from patagium.robot.planform import inwards, poses
from patagium.simulation.air_audit import air_findings
from patagium.simulation.cycles import air_force, air_velocity, beat_means, flight_between
from patagium.simulation.flight import (
    WINGBEATS,
    aero_words,
    air_of,
    flying_mass,
    gait_period,
    robot_of,
)

TUMBLE = np.radians(80.0)
"""Roll or pitch from which on a robot tumbles [rad]."""
STEEPEST = np.radians(15.0)
"""Steepest glide that is no fall [rad]."""
HOVER = 0.1
"""Speed over that of the fastest strip below which wings hover [1] (Ellington 1984)."""
NO_INFLOW = (
    "It hovers, and its wings do not meet the air that they have thrown down: the lift may be "
    "up to twice too large (--inflow, or patagium.air.Inflow(model), adds it)."
)
"""Warning about wings that hover in a model of the air without inflow."""
HINGED = (
    "A spring hinge lets {} turn by itself, and its force acts at a quarter of the chord; where "
    "flow is separated it lies further back, and wings turn more: "
    'patagium.QuasiSteady(robot, force_point="moving") has it so (docs/air.md, Hover).'
)
"""Warning about wings on a passive hinge, in quasi-steady air with another force point."""
SEPARATED = np.radians(30.0)
"""Mean incidence from which on the force of a wing is far behind a quarter of its chord [rad]."""
LIQUID = 2.0
"""Density above which a medium carries robots by buoyancy [kg/m^3]."""
BUOYANT = (
    "Buoyancy is not modeled: gravity: 0 m/s^2 in the robot file stands for a robot as heavy as "
    "its water."
)
"""Warning about robots with a weight in a liquid."""
SLOWEST_FALL = 0.3
"""Sink rate below which there is no warning [m/s]."""
UNEXPLAINED = 1e-2
"""Energy audit from which on the time step is too long [1]."""
STEADY = (0.7, 1.4)
"""Force of the air over the weight within which a free flight is near a steady one [1]."""


class FlightSummary(dict[str, Any]):
    """Facts of a flight by name, which a notebook shows with a picture.

    Args:
        facts: The facts.
        flight: The flight.
    """

    def __init__(self, facts: dict[str, Any], flight: xr.Dataset) -> None:
        super().__init__(facts)
        self._flight = flight

    def _repr_html_(self) -> str:
        from patagium.report.figures import flight_overview
        from patagium.report.page import snippet

        facts = {name: str(value) for name, value in self.items()}
        return snippet("Flight", facts, flight_overview(self._flight))


def flight_summary(flight: xr.Dataset) -> FlightSummary:
    """Summary of a flight, and what is wrong with it in sentences.

    Returns:
        `means_over`: part of the flight that means are over, in words; `frequency` of the gait
        [Hz], where it has one; `force_over_weight`: mean vertical force of the air, added mass
        included, over the weight [1]; `joint_power`: mean power of the joints [W]; where a body
        floats also `speed`: mean speed along the nose [m/s], `climb_rate` [m/s], `height_change`
        [m], and `roll`, `pitch`, `yaw`: least and greatest angle [rad]; of a closed loop
        `held_samples`: samples at which the last command was held; `warnings`: sentences.

    Raises:
        FlightError: If the flight does not carry its robot, or its attributes cannot be read.
    """
    robot, time, beat = robot_of(flight), stored(flight, "time"), gait_period(flight)
    steered = stored(flight, WINGBEATS) if WINGBEATS in flight else None
    ends, beats = _averaged(time, beat, steered)
    begin, averaged = ends[0], flight_between(flight, ends)
    if steered is not None and beats:
        beat = (time[-1] - begin) / beats
    words = {0: "its second half", 1: "its last wingbeat"}.get(beats, f"its last {beats} wingbeats")
    weight = float(robot.gravity) * _mean(flying_mass(flight, robot), time, begin)
    lift = _mean(air_force(flight, robot, time)[:, 2], time, begin)
    power = (flight["u1"] * flight["v"]).sum("dof").to_numpy()
    facts: dict[str, Any] = {
        "means_over": f"{words}; it is shorter than a wingbeat" if beat and not beats else words,
        **({"frequency": 1.0 / beat} if beat else {}),
        "force_over_weight": float(lift / weight) if weight else float("nan"),
        "joint_power": _mean(power, time, begin),
    }
    facts |= _of_body(robot, flight, begin)
    warnings = list[str]()
    with made_again("the flight's held commands and audit", FlightError):
        told = json_object(flight.attrs.get("held", "{}"), "held")
        held = {cause: int(count) for cause, count in told.items()}
        audit, step = (float(flight.attrs.get(k, 0.0)) for k in ("energy_audit", "time_step"))
    if "held" in flight.attrs:
        facts["held_samples"] = sum(held.values())
    if "speed" in facts and flight.attrs.get("mount") == "free":
        warnings += _warnings(facts, judged=bool(weight) and (not beat or beats > 0))
        if weight and air_of(flight).density > LIQUID:
            warnings.append(BUOYANT)
    warnings += [*_hover(robot, averaged, ends), *_hinge(robot, averaged)]
    if audit > UNEXPLAINED:
        warnings.append(
            f"Its energy audit is {audit:.2g}, a share of energy that no work explains: "
            f"fly with steps shorter than {step:.3g} s."
        )
    if held:
        causes = ", ".join(f"{count} {cause}" for cause, count in sorted(held.items()))
        warnings.append(f"Its last command was held at {facts['held_samples']} samples: {causes}.")
    findings = air_findings(robot, flight, ends if beats else None)
    facts["warnings"] = [*warnings, *_overloads(robot, flight), *findings]
    return FlightSummary(facts, flight)


def _averaged(time: Array, beat: float | None, steered: Array | None) -> tuple[Array, int]:
    """Ends of the second half, or of its wingbeats where it has some, [s], and their number."""
    half, beats = 0.5 * (time[-1] - time[0]), 0
    if beat:
        passed = (time - time[0]) / beat if steered is None else steered
        before = np.interp(time[-1] - half, time, passed)
        beats = int(passed[-1] - before + 1e-9) or int(passed[-1] - passed[0] + 0.01)  # to a sample
    if not beats:
        return time[-1] - np.array([half, 0.0]), 0
    return np.interp(passed[-1] - np.arange(beats, -1, -1), passed, time), beats


def _mean(values: Array, time: Array, begin: float) -> float:
    """Mean over the time from `begin` on [s]."""
    return float(beat_means(values[:, None], time, np.array([begin, time[-1]])).item())


def _of_body(robot: Robot, flight: xr.Dataset, begin: float) -> dict[str, Any]:
    """Speed, height and attitude of the floating body; empty where none floats."""
    if not robot.floating:
        return {}
    body, dofs = next(iter(robot.floating_bodies)), robot.floating_dofs
    time = stored(flight, "time")
    position, rotation = poses_at(robot, stored(flight, "q"))
    height, turned = position[:, body, 2], rotation[:, body]
    velocity = stored(flight, "v")[:, dofs[:3]]
    ahead = np.einsum("ni,ni->n", turned[:, :, 0], velocity)
    angles = {
        "roll": np.arctan2(turned[:, 2, 1], turned[:, 2, 2]),
        "pitch": np.arcsin(np.clip(-turned[:, 2, 0], -1.0, 1.0)),
        "yaw": np.unwrap(np.arctan2(turned[:, 1, 0], turned[:, 0, 0])),
    }
    return {
        "speed": _mean(ahead, time, begin),
        "climb_rate": _mean(velocity[:, 2], time, begin),
        "height_change": float(height[-1] - height[0]),
        **{name: (float(a.min()), float(a.max())) for name, a in angles.items()},
    }


def _warnings(facts: dict[str, Any], judged: bool) -> Iterator[str]:
    """Sentences about what is wrong in free flight; `judged` by its mean force."""
    for name in ("roll", "pitch"):
        most = max(abs(one) for one in facts[name])
        if most > TUMBLE:
            yield f"It tumbles: {name} reaches {np.degrees(most):.0f} degrees."
    speed, sinking = facts["speed"], -facts["climb_rate"]
    if speed < -SWITCH_SPEED:
        yield f"It flies backwards, at {-speed:.2g} m/s."
    share = facts["force_over_weight"]
    if not judged:
        return
    if sinking > max(SLOWEST_FALL, np.tan(STEEPEST) * abs(speed)):
        yield f"It sinks at {sinking:.2g} m/s: the air carries {share:.0%} of the weight."
    elif not STEADY[0] <= share <= STEADY[1]:
        yield f"Its flight is not steady: the air carries {share:.0%} of the weight."


def _hover(robot: Robot, flight: xr.Dataset, ends: Array) -> Iterator[str]:
    """Warning about wings that hover in a model of the air without inflow."""
    told = str(flight.attrs.get("aero", "{}"))
    if not flight.sizes["strip"] or '"model"' not in told or f'"{Inflow.name}"' in told:
        return
    fastest = float(stored(flight, "strip_airspeed").mean(axis=0).max())
    driven = stored(flight, "v")[:, list(robot.actuated)].any()
    velocity = beat_means(air_velocity(flight, robot), stored(flight, "time"), ends)
    if driven and not np.linalg.norm(velocity, axis=1).mean() > HOVER * fastest:
        yield NO_INFLOW


def hinged_strips(robot: Robot) -> list[int]:
    """Places of the strips that a passive joint with a spring turns about their span."""
    bodies, found = poses(robot), []
    springs = [i for i in robot.passive if robot.stiffness and robot.stiffness[i]]
    for place, strip in enumerate(robot.strips):
        span = bodies[strip.body][1] @ np.cross(strip.normal, strip.forward)
        joints = ((k, j) for k in inwards(robot, strip.body) for j in robot.bodies[k].joints)
        axes = (bodies[k][1] @ joint.axis for k, joint in joints if joint.dof in springs)
        if any(abs(axis @ span) > np.cos(SEPARATED) for axis in axes):
            found.append(place)
    return found


def _hinge(robot: Robot, flight: xr.Dataset) -> Iterator[str]:
    """Sentence about a wing that turns by itself far beyond attached flow."""
    air = innermost(aero_words(flight))
    if air.get("model") != QuasiSteady.name or air.get("force_point") == "moving":
        return
    incidence = np.abs(stored(flight, "angle_of_attack")).mean(axis=0)
    beyond = [place for place in hinged_strips(robot) if incidence[place] > SEPARATED]
    for place in beyond[:1]:
        yield HINGED.format(robot.strips[place].wing)


def _overloads(robot: Robot, flight: xr.Dataset) -> Iterator[str]:
    """Sentences about joints that take more than their actuators have."""
    v, effort = stored(flight, "v"), stored(flight, "u1")
    taken = dict(zip(CAPACITIES, (v, stored(flight, "a"), effort, effort * v), strict=True))
    for k, (name, values) in enumerate(taken.items()):
        limits, what = getattr(robot, name), name.removesuffix("_limit")
        for i in robot.actuated if limits else ():
            size, unit = np.abs(values[:, i]), capacity_units(robot.dof_units[i])[k]
            most = int(np.argmax(size))
            if size[most] > limits[i]:
                yield (
                    f"{robot.dof_names[i]} needs {size[most]:.3g} {unit} of {what} at "
                    f"{float(flight['time'][most]):.3g} s, but has {limits[i]:.3g} {unit}."
                )
