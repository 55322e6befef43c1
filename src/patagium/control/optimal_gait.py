"""Optimal gaits: the periodic orbit of least power, least energy a meter, or greatest speed.

Parameters are frequency, means and Fourier coefficients of the joints, or others that are named;
states along the beat are unknowns too (`gait_program`). Power is mechanical, and what a joint takes
back from its wing counts as recovered, as in a flight's `joint_work`; the power without recovery
stands beside it. Neglected: losses in motors. Minima are local: a search goes on from a gait.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, cast

import numpy as np

from patagium.aerodynamics import AddedMass, Aerodynamics
from patagium.arguments import Progress, checked
from patagium.control.gait_family import GaitFamily, fourier_series, gait_family
from patagium.control.gait_program import (
    IN_PLANE,
    TOLERANCE,
    GaitProgram,
    Goal,
    Optimum,
    lateral_states,
)
from patagium.control.orbit import NoOrbit, Orbit, said
from patagium.control.trimming import NEARBY, Conditions, OrbitSearch, orbit_of, stable_steps, trim
from patagium.errors import ParameterError
from patagium.robot import Robot
from patagium.simulation.gait_models import Gait

GOALS = {"power": "least power", "range": "least energy a meter", "speed": "greatest speed"}
"""What may be sought, and its words."""
MOST = 16
"""Greatest order of the Fourier series of an optimal gait."""
_ALIKE = 1e-6  # difference of speeds, climbs and turns of two flights under the same conditions


@dataclass(frozen=True)
class OptimalGait:
    """Optimal gait that was found.

    Attributes:
        orbit: Its orbit, as `trim` gives it.
        goal: What was sought: "power", "range" or "speed".
        harmonics: Order of the Fourier series.
        power: Mean mechanical power of the joints [W].
        power_before: That of the orbit it began from [W]; None where that flies otherwise.
        sinusoid: The best gait of one harmonic at the same conditions; None if it is that, if none
            was found, or if the search began from an orbit that was given.
        residual: Largest residual of the conditions of Karush, Kuhn and Tucker, scaled [1].
        iterations: Iterations of IPOPT.
        held: Limits that hold the gait back, in words.
    """

    orbit: Orbit
    goal: Goal
    harmonics: int
    power: float
    power_before: float | None
    sinusoid: OptimalGait | None
    residual: float
    iterations: int
    held: tuple[str, ...]
    found: ClassVar[bool] = True

    @cached_property
    def powers(self) -> tuple[float, float]:
        """Mean power of the joints in a simulated beat, and that without recovery [W]."""
        beat = self.orbit.flight(beats=1)
        each = beat["u1"].to_numpy() * beat["v"].to_numpy()
        spent = np.maximum(each, 0.0).sum(axis=1)[:-1].mean()
        return float(beat["joint_work"].to_numpy()[-1] / self.orbit.period), float(spent)

    @property
    def energy_per_meter(self) -> float:
        """Mechanical energy a meter of way [J/m]; infinite in hover."""
        hovers = abs(self.orbit.speed) < 1e-9
        return float("inf") if hovers else self.power / self.orbit.speed

    @property
    def note(self) -> str:
        """Warning that the gait takes more power than the one begun from; empty if it does not."""
        if self.goal != "power" or self.power <= 1.001 * (self.power_before or np.inf):
            return ""
        return "more power than before: that gait exceeds a limit, or minima are several"

    def summary(self) -> dict[str, Any]:
        """Gait as facts by name, with their units."""
        simulated, spent = self.powers
        facts: dict[str, Any] = {
            "goal": self.goal,
            "harmonics": self.harmonics,
            "power_W": self.power,
            "power_simulated_W": simulated,
            "power_without_recovery_W": spent,
            "energy_per_meter_J_m": self.energy_per_meter,
        }
        if self.power_before is not None:
            facts["power_before_W"] = self.power_before
        if self.sinusoid is not None:
            facts["power_of_best_sinusoid_W"] = self.sinusoid.power
            facts["saved_over_sinusoid"] = 1.0 - self.power / self.sinusoid.power
        facts |= {"kkt_residual": self.residual, "iterations": self.iterations}
        told = {"note": self.note} if self.note else {}
        facts |= told | {"held_by": list(self.held)} | self._swings()
        relative = self.orbit.parameter_facts.keys() - {"frequency_Hz"}  # to a trim not shown
        return facts | {k: v for k, v in self.orbit.summary().items() if k not in relative}

    def _swings(self) -> dict[str, float]:
        """Least and greatest position of each joint by name and unit."""
        robot, family = self.orbit.robot, self.orbit.family
        paths = zip(family.base.joints, family.swings(self.orbit.values)[-1].T, strict=True)
        facts: dict[str, float] = {}
        for joint, path in paths:
            unit = robot.dof_units[robot.index(joint)]
            facts |= {f"{joint}_least_{unit}": path.min(), f"{joint}_most_{unit}": path.max()}
        return facts

    def __repr__(self) -> str:
        orbit, best = self.orbit, self.sinusoid
        others = {"before": self.power_before, "best sinusoid": best and best.power}
        told = [f"{name} {power:.4g} W" for name, power in others.items() if power is not None]
        lines = [
            f"gait of {GOALS[self.goal]} of {orbit.robot.name}, "
            f"{self.harmonics} harmonic{'s' * (self.harmonics > 1)}, {orbit.gait.frequency:.4g} Hz",
            f"  speed {said(orbit.speed)} m/s, climb {said(orbit.climb)} m/s",
            f"  power {self.power:.4g} W, {self.energy_per_meter:.4g} J/m"
            + (f" ({'; '.join(told)})" if told else ""),
            f"  without recovery {self.powers[1]:.4g} W",
            f"  residual {self.residual:.1e} after {self.iterations} iterations",
            f"  held by: {', '.join(self.held) or 'nothing'}",
            *([f"  note: {self.note}"] if self.note else []),
        ]
        return "\n".join(lines)


@checked
def optimize(
    robot: Robot,
    aero: Aerodynamics | None = None,
    gait: Gait | None = None,
    *,
    speed: float | None = None,
    climb: float = 0.0,
    harmonics: int = 3,
    goal: Goal = "power",
    free: Sequence[str] | None = None,
    added_mass: AddedMass | None = None,
    start: Orbit | None = None,
    steps: int | None = None,
    tolerable: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> OptimalGait | NoOrbit:
    """Optimal gait of a periodic flight: of least power, least energy a meter, greatest speed.

    Args:
        robot: The machine, with a floating body and Euler angles.
        aero: Model of the air around it, in air at rest; that of `start`, else quasi-steady by
            default.
        gait: Gait to begin from; by default that of the robot's section `cruise`.
        speed: Mean speed forward [m/s]; None leaves it free, 0 hovers.
        climb: Mean speed upward [m/s].
        harmonics: Order of the Fourier series of the joints.
        goal: "power" for least mean mechanical power, "range" for least energy a meter, "speed".
        free: Gait parameters that may change, by the names of `gait_family`; by default frequency,
            means and coefficients of the joints that the robot's `actuators` swing and shift, or
            without actuators of all joints that move or have limits.
        start: Orbit to begin from, in this air; by default that of `trim`, and then the best
            sinusoids.
        added_mass: Inertia of the air that moves with the wings, in the same air as the model.
        steps: Time steps of a beat, a multiple of 40.
        tolerable: Sizes of changes of states by name [SI], as of `trim`.
        progress: Function that takes the iterations of a search done, and those at most.

    Returns:
        The gait with its orbit; or a `NoOrbit` that says what stood in the way. `found` tells them
        apart.

    Raises:
        ParameterError: If an argument is not what it may be.
    """
    given = start
    if not 1 <= harmonics <= MOST:
        raise ParameterError("harmonics", f"a whole number from 1 to {MOST}", harmonics)
    if goal != "power" and speed is not None:
        raise ParameterError("speed", f"None, as the goal {goal} finds it", speed)
    conditions = Conditions(0.0, climb, speed)
    if start is None:
        trimmed = trim(
            robot, aero, gait, speed=speed, climb=climb, added_mass=added_mass, steps=steps,
            tolerable=tolerable,
        )  # fmt: skip
        start = trimmed.beyond if isinstance(trimmed, NoOrbit) else trimmed
        if start is None:  # one beyond limits serves: they hold in the program
            return cast(NoOrbit, trimmed)
    elif start.robot is not robot or gait is not None:
        raise ParameterError("start", "an orbit of this robot, and no gait in addition", start)
    elif (steps or start.steps, tolerable) != (start.steps, None):
        told = "those of start (pt.trim(..., steps=..., tolerable=..., start=start))"
        raise ParameterError("steps, tolerable", told, (steps, tolerable))
    for name, one in {"aero": aero, "added_mass": added_mass}.items():
        own = getattr(start, name)
        if one is not None and (own is None or one.describe() != own.describe()):
            raise ParameterError(name, f"that of start (trim(..., {name}=..., start=start))", one)
    sinusoid = None
    if free is None and given is None and harmonics > 1:
        sinusoid = _optimal(start, conditions, goal, 1, None, progress)
    if not isinstance(sinusoid, OptimalGait):  # limits that no sinusoid keeps, harmonics may
        return _optimal(start, conditions, goal, harmonics, free, progress)
    best = _optimal(sinusoid.orbit, conditions, goal, harmonics, None, progress)
    if not isinstance(best, OptimalGait):
        return best
    return replace(best, power_before=sinusoid.power_before, sinusoid=sinusoid)


@checked
def power_front(
    robot: Robot,
    speeds: Sequence[float],
    aero: Aerodynamics | None = None,
    gait: Gait | None = None,
    *,
    climb: float = 0.0,
    harmonics: int = 3,
    added_mass: AddedMass | None = None,
) -> list[tuple[float, OptimalGait | NoOrbit]]:
    """Least mean power over speed, each gait sought from the one before, with its best sinusoid.

    Args:
        robot: The machine, with a floating body and Euler angles.
        speeds: Mean speeds forward [m/s].
        aero: Model of the air around it; quasi-steady by default.
        gait: Gait to begin from; by default that of the robot's section `cruise`.
        climb: Mean speed upward [m/s].
        harmonics: Order of the Fourier series of the joints, at least 2.
        added_mass: Inertia of the air that moves with the wings, in the same air as the model.

    Returns:
        Each speed with its gait, or with a `NoOrbit`.

    Raises:
        ParameterError: If an argument is not what it may be.
    """
    if harmonics < 2:
        raise ParameterError("harmonics", "at least 2, more than the best sinusoid has", harmonics)
    if len({*speeds}) < len(speeds):
        raise ParameterError("speeds", "each speed once", speeds)
    found: list[tuple[float, OptimalGait | NoOrbit]] = []
    last: OptimalGait | None = None
    sine: OptimalGait | None = None
    for speed in speeds:
        given: dict[str, Any] = {"speed": speed, "climb": climb}
        if last is None or sine is None:
            one = optimize(robot, aero, gait, harmonics=harmonics, added_mass=added_mass, **given)
            sine = one.sinusoid if isinstance(one, OptimalGait) else None
        else:
            own = optimize(robot, harmonics=1, start=sine.orbit, **given)
            one = optimize(robot, harmonics=harmonics, start=last.orbit, **given)
            if isinstance(own, OptimalGait):
                sine = own
                one = replace(one, sinusoid=own) if isinstance(one, OptimalGait) else one
        last = one if isinstance(one, OptimalGait) else last
        found.append((float(speed), one))
    return found


def coefficients(robot: Robot, gait: Gait, harmonics: int) -> tuple[str, ...]:
    """Names of the parameters that an optimization changes where none are given."""
    base = fourier_series(gait)
    series = base.cosine - 1j * base.sine
    moving = np.abs(series).max(axis=0, initial=0.0) > 0
    own = {robot.paired(name) for name in robot.actuators}
    found, phased = ["frequency"] if gait.period else [], False
    for name, joints in robot.joint_groups.items():
        k, i = base.joints.index(joints[0]), robot.index(joints[0])
        limited = np.isfinite(robot.lower[i]) and np.isfinite(robot.upper[i])
        if f"{name}_offset" in own if own else limited or moving[k]:
            found.append(f"{name}_offset")
        if not ({f"{name}_amplitude", "amplitude"} & own if own else limited or moving[k]):
            continue
        for order in range(1, harmonics + 1):
            parts = ["cosine", "sine"]
            if order == 1 and not phased and moving[k]:  # where the beat begins is nobody's matter
                phased, first = True, series[0, k]
                parts = ["sine" if abs(first.imag) > abs(first.real) else "cosine"]
            found += [f"{name}_{part}_{order}" for part in parts]
    return tuple(found)


def _optimal(
    start: Orbit,
    conditions: Conditions,
    goal: Goal,
    harmonics: int,
    free: Sequence[str] | None,
    progress: Progress | None,
) -> OptimalGait | NoOrbit:
    """Optimal gait from an orbit nearby, within one family of gaits."""
    robot = start.robot
    if "yaw" not in start.names:
        raise ParameterError("robot", "a body that floats, with Euler angles", robot.name)
    names = coefficients(robot, start.gait, harmonics) if free is None else tuple(free)
    family = gait_family(robot, start.gait, names)
    if free is None:
        family = _in_plane(family, start)
    search = OrbitSearch(start.map, family, start.steps)
    program = GaitProgram(family, start, goal, conditions)
    found = program.solve(progress)
    if not found.solved:
        begun = search.point(start.states, family.neutral, conditions)
        return _not_found(program, found, search.strained(begun))
    nodes, values = found.nodes[:-1], found.values
    alike = all(
        asked is None or abs(getattr(start, name) - asked) <= _ALIKE
        for name, asked in vars(conditions).items()
    )
    search.steps = max(search.steps, stable_steps(search, values, nodes))  # of a slower beat
    at, trouble = search.newton(search.point(nodes, values, conditions), conditions)
    if at.residual <= TOLERANCE:
        trouble = search.strained(at)
    else:
        trouble = f"the beat of the best gait does not close: a misfit of {at.residual:.2g}"
    if trouble:
        return _not_found(program, found, trouble)
    return OptimalGait(
        orbit_of(search, at),
        goal,
        harmonics,
        found.work * family.gait(found.values).frequency,
        program.power_before if alike else None,
        None,
        found.residual,
        found.iterations,
        found.held,
    )


def _in_plane(family: GaitFamily, start: Orbit) -> GaitFamily:
    """Family without what leads out of the plane of symmetry and is still, such as a rudder.

    It is the whole family where the orbit leaves that plane anyway, or where none would be left.
    """
    rows = family.rows(family.neutral, start.steps, start.aero.air)
    lateral, slopes = lateral_states(start.names), start.map.fly(start.states, rows).by_parameter
    kept = np.abs(slopes[:, lateral]).max(axis=(0, 1)) < IN_PLANE
    ways = family.directions[:, 1:].reshape(len(kept), -1, len(family.base.joints))
    kept |= ways[..., np.isin(family.base.joints, family.base.moving)].any(axis=(1, 2))
    if np.abs(start.states[:, lateral]).max() > IN_PLANE or not kept.any():
        return family
    chosen = tuple(name for name, stays in zip(family.names, kept, strict=True) if stays)
    return replace(family, names=chosen, directions=family.directions[kept])


def _not_found(program: GaitProgram, found: Optimum, trouble: str) -> NoOrbit:
    """Failure in words, with trouble of the beat that was found, or of the one begun from."""
    reason, remedy = trouble, NEARBY
    if not found.solved:
        parts = [_REASONS.get(found.status, found.status.replace("_", " ").lower())]
        if overloads := program.overloads:
            parts.append(f"the gait it began from takes {', '.join(overloads)}")
            remedy += ", or raise that limit"
        if trouble:
            parts.append(f"in the flight it began from {trouble}")
            remedy += ", or stiffen its spring or widen its limits"
        parts.append(f"residual {found.residual:.2g} after {found.iterations} iterations")
        reason = "; ".join(parts)
    nearest = dict(zip(program.family.names, map(float, found.values), strict=True))
    return NoOrbit(reason, remedy, {}, found.residual, found.iterations, nearest)


_REASONS = {
    "Infeasible_Problem_Detected": "no gait within the limits fulfils the conditions near by",
    "Maximum_Iterations_Exceeded": "the search was not done in time",
    "Restoration_Failed": "no step from here leads nearer to the conditions",
    "Invalid_Number_Detected": "the flight breaks",
    "Solved_To_Acceptable_Level": "the search came near to a gait, but not near enough",
    "Search_Direction_Becomes_Too_Small": "no step from here leads nearer to the conditions",
    "Diverging_Iterates": "the goal has no bound: a limit of joints or actuators is missing",
}
