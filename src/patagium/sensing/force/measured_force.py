"""Measured generalized force of the air, with its covariance.

There are two ways: inverse dynamics of the smoothed motion; a load cell under the robot, whose
wrench less the robot's inertia is the air's. The covariance is that of motion, joint forces and
wrench through the Jacobian of the inverse dynamics. Neglected: errors of the robot's parameters;
that joint forces and wrench err alike over time, and errors of neighboring samples, as smoothing
leaves them; who learns from each sample should leave out those closer than a time constant of the
smoother.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from patagium.aerodynamics import AddedMass, Air
from patagium.arguments import checked, of_kind
from patagium.arrays import Array, Bools, brief, real_array, selected, stored
from patagium.dynamics.kinematics import body_poses, generalized_force
from patagium.errors import FlightError, ParameterError
from patagium.native import NativeFunction, load_functions, named_function
from patagium.reading import made_again
from patagium.robot import Robot
from patagium.sensing.force.air_force import added_mass_force, air_force
from patagium.sensing.motion.first_motion import spectral_noise
from patagium.sensing.motion.smoothers import smooth_series
from patagium.sensing.sensors import LoadCell, MotorCurrent, SensorLog
from patagium.sensing.sensors.joints import joint_names
from patagium.simulation import air_of, robot_of


@dataclass(frozen=True)
class ForceSamples:
    """States of a robot and the generalized force of the air at each, with its uncertainty.

    Args:
        time: Increasing, (N,) [s].
        q: Generalized coordinates, (N, n) [m, rad].
        v: Generalized velocities, (N, n) [m/s, rad/s].
        force: Of the air, (N, n) [N, N m]; NaN in coordinates where it was not measured.
        covariance: Of the force, (N, n, n) [N^2, N^2 m^2]; NaN likewise.
        robot: The machine.
        source: How it was measured.
        a: Generalized accelerations, (N, n) [m/s^2, rad/s^2]; None: not known.
        air: Air that the robot flew in.

    Raises:
        ShapeError: If arrays do not fit each other or the robot.
    """

    time: Array
    q: Array
    v: Array
    force: Array
    covariance: Array
    robot: Robot
    source: str
    a: Array | None = None
    air: Air = Air()
    __repr__ = brief

    def __post_init__(self) -> None:
        of_kind("robot", self.robot, Robot)
        shape = (len(real_array("time", self.time, ("N",))), self.robot.dof)
        shapes: dict[str, tuple[int, ...]] = {"time": shape[:1], "covariance": (*shape, shape[1])}
        shapes |= dict.fromkeys(("q", "v", "force", "a")[: 3 + (self.a is not None)], shape)
        for name, one in shapes.items():
            object.__setattr__(self, name, real_array(name, getattr(self, name), one))

    @property
    def state(self) -> Array:
        """State x = [q, v], (N, 2 n) [m, rad, m/s, rad/s]."""
        return np.hstack([self.q, self.v])

    @property
    def std(self) -> Array:
        """Standard deviation of the force, (N, n) [N, N m]; NaN where it was not measured."""
        return np.asarray(np.sqrt(np.einsum("nii->ni", self.covariance)))

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the coordinates in which the force was measured at any time."""
        seen = np.flatnonzero(np.isfinite(self.force).any(axis=0))
        return tuple(self.robot.dof_names[i] for i in seen)

    @classmethod
    def of(cls, motion: xr.Dataset) -> ForceSamples:
        """Forces in a file of `patagium motion`, as `load_log` reads it."""
        names = ("time", "q", "v", "force", "force_covariance", "a")
        with made_again("the motion's forces", FlightError):
            parts: Any = [stored(motion, name) for name in names]
            parts[5:5] = robot_of(motion), motion["force"].attrs["source"]
            return cls(*parts, *[air_of(motion)])

    def where(self, kept: slice | ArrayLike) -> ForceSamples:
        """Selection of the samples.

        Args:
            kept: A slice, indices in order, or a bool for each sample.

        Raises:
            ParameterError: If it is something else.
        """
        chosen = selected(kept, len(self.time))
        held: Any = {name: one for name, one in vars(self).items() if isinstance(one, np.ndarray)}
        return replace(self, **{name: one[chosen] for name, one in held.items()})


_LEAST = 1e-4  # of what a signal does, below which its noise is not believed
_ORDER = 3  # of the derivative of a signal that white noise drives


@dataclass(frozen=True)
class Measured:
    """Signal on the time axis of a motion.

    Args:
        values: (N, k) [unit of y]; NaN where there is none.
        variance: (N, k) [unit of y].
        noise: Standard deviation of a sample, stated or as its spectrum shows it, (k,) [unit of y].
    """

    values: Array
    variance: Array
    noise: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Wrench:
    """Wrench that a load cell showed, on the time axis of a motion.

    Args:
        measured: Force and moment of the mount on the robot, the cell's axes, (N, 6) [N, N m].
        cell: Where it sits.
    """

    measured: Measured
    cell: LoadCell


def motor_forces(
    log: SensorLog, motion: xr.Dataset, name: str, *, shift: float = 0.0, robot: Robot | None = None
) -> Measured:
    """Forces of the joints from the currents of their motors, at the times of a motion.

    Args:
        log: The log.
        motion: From `estimate_motion`.
        name: Of the sensor.
        shift: Delay of its stamps [s].
        robot: The machine; None for the log's.

    Returns:
        Forces, (N, n) [N, N m]; NaN in joints without a sensor.

    Raises:
        ParameterError: If the sensor is no amplifier of motors.
    """
    sensor = log.sensors.get(name)
    if not isinstance(sensor, MotorCurrent):
        raise ParameterError("name", "a motor current of the log", name)
    machine = log.robot if robot is None else robot
    columns = [machine.index(joint) for joint in joint_names(sensor.joints, machine)]
    force = sensor.in_range(log[name]["current"].values) * sensor.force_per_current
    found = _at(log[name], force, sensor, motion, shift)
    shape = (len(motion["time"]), machine.dof)
    values, variance = np.full(shape, np.nan), np.zeros(shape)
    values[:, columns] = found.values
    constant = (sensor.offset_std * sensor.force_per_current) ** 2
    scale = sensor.torque_constant_std**2
    variance[:, columns] = found.variance + constant + scale * found.values**2
    return Measured(values, variance, found.noise)


def cell_wrench(log: SensorLog, motion: xr.Dataset, name: str, *, shift: float = 0.0) -> Wrench:
    """Wrench that a load cell showed, at the times of a motion.

    Args:
        log: The log.
        motion: From `estimate_motion`.
        name: Of the sensor.
        shift: Delay of its stamps [s].

    Raises:
        ParameterError: If the sensor is no load cell, or one `at` a place within the robot.
    """
    cell = log.sensors.get(name)
    if not isinstance(cell, LoadCell) or cell.at is not None:
        raise ParameterError("name", "a load cell of the log, without `at`", name)
    shown = cell.in_range(log[name]["wrench"].values)
    found = _at(log[name], shown, cell, motion, shift)
    constant = np.concatenate([cell.force_bias, cell.moment_bias]) ** 2
    talk = np.zeros((6, 6)) if cell.cross_talk is None else np.asarray(cell.cross_talk) ** 2
    variance = found.variance + constant + found.values**2 @ talk.T
    return Wrench(Measured(found.values, variance, found.noise), cell)


@checked
def inverse_dynamics_force(
    motion: xr.Dataset,
    *,
    joints: Measured | None = None,
    mount: Wrench | None = None,
    added_mass: AddedMass | None = None,
) -> ForceSamples:
    """Force of the air by inverse dynamics: y = D a + C v + G - u1 - damping - mount.

    Known in the joints whose force was measured, and in the passive coordinates, those of a
    floating body only where nothing holds it or a load cell says how.

    Args:
        motion: From `estimate_motion`.
        joints: Forces of the joints; None: not measured.
        mount: Wrench of what holds the floating body; None: not measured.
        added_mass: Inertia of the air that is known and no part of y; None for none.

    Raises:
        FlightError: If the motion misses a quantity or carries no robot.
        ShapeError: If the signals do not fit the motion.
        ParameterError: If there is a mount and the robot has no floating body.
    """
    return _along(motion, joints, mount, added_mass, "inverse dynamics")


def load_cell_force(
    motion: xr.Dataset, mount: Wrench, *, added_mass: AddedMass | None = None
) -> ForceSamples:
    """Force of the air on the whole robot: the wrench of the cell less what inertia explains.

    Known in the floating body's coordinates; no motor is asked.

    Args:
        motion: From `estimate_motion`.
        mount: What the cell showed.
        added_mass: Inertia of the air that is known and no part of y; None for none.

    Raises:
        FlightError: If the motion misses a quantity or carries no robot.
        ShapeError: If the signals do not fit the motion.
        ParameterError: If the robot has no floating body.
    """
    robot = robot_of(motion)
    silent = {*range(robot.dof)}.difference(robot.floating_dofs)
    return _along(motion, None, mount, added_mass, "load cell", silent)


def _along(
    motion: xr.Dataset,
    joints: Measured | None,
    mount: Wrench | None,
    added_mass: AddedMass | None,
    source: str,
    silent: Collection[int] = (),
) -> ForceSamples:
    """Force of the air along a motion, with its covariance; NaN in silent coordinates."""
    robot = robot_of(motion)
    if mount is not None and not robot.floating:
        raise ParameterError("robot", "one with a floating body, for a mount", robot.name)
    names = ("time", "q", "v", "a", "covariance")
    if missing := [name for name in names[1:] if name not in motion]:
        held = ", ".join(map(str, motion.data_vars))
        raise FlightError(f"motion: expected {', '.join(missing)}, but it holds {held}")
    time, q, v, a, spread = (stored(motion, name) for name in names)
    count, n = q.shape
    wind, numbers = np.zeros((count, 3)), np.zeros(0)
    if added_mass is not None:
        added_mass.air.require_uniform("added_mass.air")
        wind, numbers = added_mass.air.wind_at(time), added_mass.parameters
    torque = _signal("joints", joints, (count, n))
    wrench = _signal("mount", mount.measured if mount else None, (count, 6))
    function = _measured_force(robot, mount.cell if mount else None, added_mass)
    state, more = np.hstack([q, v, a, wrench.values]), (robot.parameters, numbers)
    found = function["air_force"].batch(state, np.nan_to_num(torque.values), wind, *more)
    force, slopes = np.array(found).reshape(count, n), np.empty((count, n, 3 * n + 6))
    for k, direction in enumerate(np.eye(3 * n + 6)):
        column = function["along"].batch(state, wind, direction, *more)
        slopes[:, :, k] = np.asarray(column).reshape(count, n)
    by_motion, by_wrench = np.split(slopes, [3 * n], axis=2)
    covariance = by_motion @ spread @ np.swapaxes(by_motion, 1, 2)
    covariance += (by_wrench * wrench.variance[:, None]) @ np.swapaxes(by_wrench, 1, 2)
    rows = np.arange(n)
    covariance[:, rows, rows] += torque.variance
    force[~_known_rows(robot, motion, joints, mount)] = np.nan
    force[:, [*silent]] = np.nan
    lost = np.isnan(force)
    covariance[lost[:, :, None] | lost[:, None, :]] = np.nan
    return ForceSamples(time, q, v, force, covariance, robot, source, a, air_of(motion))


def _signal(name: str, signal: Measured | None, shape: tuple[int, int]) -> Measured:
    """Signal of the motion's length; zeros where it was not measured."""
    if signal is None:
        return Measured(np.zeros(shape), np.zeros(shape))
    real_array(name, signal.values, shape)
    return signal


def _known_rows(
    robot: Robot, motion: xr.Dataset, joints: Measured | None, mount: Wrench | None
) -> Bools:
    """Whether each coordinate is known in each sample, (N, n)."""
    known = np.ones((len(motion["time"]), robot.dof), bool)
    if mount is None and str(motion.attrs.get("mount", "free")) not in ("", "free"):
        known[:, list(robot.floating_dofs)] = False
    driven = list(robot.actuated)
    known[:, driven] = False if joints is None else np.isfinite(joints.values[:, driven])
    return known


def _measured_force(
    robot: Robot, cell: LoadCell | None, added_mass: AddedMass | None
) -> dict[str, NativeFunction]:
    """Compiled `air_force` of a measured motion, and `along`, its change in a direction.

    `air_force` takes (q, v, a, wrench), u1 and wind, and gives y.
    """

    def build() -> list[ca.Function]:
        machine, p = robot.symbolic()
        n = robot.dof
        state, wind = ca.SX.sym("state", 3 * n + 6), ca.SX.sym("wind", 3)
        torque, direction = ca.SX.sym("torque", n), ca.SX.sym("direction", 3 * n + 6)
        q, v, a, shown = ca.vertsplit(state, [0, n, 2 * n, 3 * n, 3 * n + 6])
        numbers = ca.SX.sym("c", 0 if added_mass is None else len(added_mass.parameters))
        known = {"u1": torque}
        if cell is not None:
            known["mount_force"] = _of_cell(machine, q, shown, cell)
        if added_mass is not None:
            carried = added_mass_force(machine, added_mass, (q, v, a), wind, numbers)
            known["added_mass_force"] = carried
        force = air_force(machine, q, v, a, known)
        change = ca.jtimes(force, state, direction)
        fixed, at = {"parameters": p, "air_parameters": numbers}, {"state": state, "wind": wind}
        whole = {"state": state, "torque": torque, "wind": wind, **fixed}
        along = at | {"direction_parameters": direction, **fixed}
        return [
            named_function("air_force", whole, {"force": force}),
            named_function("along", along, {"change": change}),
        ]

    if cell is not None and cell.body is not None:
        index, position = robot.place(cell.body, cell.position)
        cell = replace(cell, body=robot.bodies[index].name, position=tuple(position))
    place = None if cell is None else (cell.body, cell.position, cell.orientation)
    carried = None if added_mass is None else added_mass.structure
    key = f"measured air force {place} {carried} {robot.structure}"
    return load_functions(key, build, label=f"measured force on {robot.name}")


def _of_cell(machine: Robot, q: ca.SX, shown: ca.SX, cell: LoadCell) -> ca.SX:
    """Generalized force of what a cell shows, (n, 1) [N, N m]."""
    turn, lever = ca.DM(cell.orientation), ca.DM(cell.position)
    force, moment = turn @ shown[:3], turn @ shown[3:]
    if cell.body is not None:
        moment = moment + ca.cross(lever, force)
        return generalized_force(machine, q, {machine.body_index(cell.body): (force, moment)})
    body = next(iter(machine.floating_bodies))
    pose = body_poses(machine, q)[body]
    moment = moment + ca.cross(lever - pose.position, force)
    to_body = pose.rotation.T
    return generalized_force(machine, q, {body: (to_body @ force, to_body @ moment)})


def _at(
    reading: xr.Dataset,
    values: Array,
    sensor: MotorCurrent | LoadCell,
    motion: xr.Dataset,
    shift: float,
) -> Measured:
    """Input u = y + T y' of the low-pass of a sensor, by its smoothed output y, along a motion.

    The noise is that of the spectrum of the output where the sensor states zero.
    """
    stamps = stored(reading, "time") - shift
    times = stored(motion, "time")
    width = values.shape[1]
    told = np.isfinite(values).sum(axis=0) > _ORDER
    values, spread = values[:, told], np.full((2, len(times), width), np.nan)
    least = _LEAST * np.maximum(np.nanstd(values, axis=0), 1e-9)
    noise = np.array(np.broadcast_to(sensor.sample_std, width), float)[told]
    for k in np.flatnonzero(noise == 0):
        seen = np.isfinite(values[:, k])
        noise[k] = spectral_noise(stamps[seen], values[seen, k, None], _ORDER).std
    noise = np.fmax(noise, least)
    if told.any():
        found = smooth_series(stamps, values, noise, times, order=_ORDER)
        back = np.array([1.0, sensor.lag])
        spread[0][:, told] = found.state[:, :, :2] @ back
        spread[1][:, told] = found.covariance[:, :, :2, :2] @ back @ back
    every = np.full(width, np.nan)
    every[told] = noise
    return Measured(spread[0], spread[1], every)
