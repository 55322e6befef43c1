"""Measured generalized force of the air, with its covariance.

There are two ways: inverse dynamics of the smoothed motion; a load cell under the robot, whose
wrench less the robot's inertia is the air's. The covariance is that of motion, joint forces and
wrench through the Jacobian of the inverse dynamics. Neglected: errors of the robot's parameters;
that joint forces and wrench err alike over time, and errors of neighboring samples, as smoothing
leaves them; who learns from each sample should leave out those closer than a time constant of the
smoother.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from patagium.aerodynamics import AddedMass
from patagium.arguments import checked, of_kind
from patagium.arrays import Array, Bools, brief, real_array, selected
from patagium.dynamics.kinematics import body_poses, generalized_force
from patagium.errors import FlightError, ParameterError
from patagium.native import NativeFunction, load_functions
from patagium.robot import Robot
from patagium.sensing.force.air_force import added_mass_force, air_force
from patagium.sensing.motion.first_motion import spectral_noise
from patagium.sensing.motion.smoothers import smooth_series
from patagium.sensing.sensors import LoadCell, MotorCurrent, SensorLog
from patagium.sensing.sensors.joints import joint_names
from patagium.simulation import robot_of


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
    __repr__ = brief

    def __post_init__(self) -> None:
        of_kind("robot", self.robot, Robot)
        shape = (len(real_array("time", self.time, ("N",))), self.robot.dof)
        for name in ("q", "v", "force", *(["a"] if self.a is not None else [])):
            real_array(name, getattr(self, name), shape)
        real_array("covariance", self.covariance, (*shape, self.robot.dof))

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

    def where(self, kept: slice | ArrayLike) -> ForceSamples:
        """Selection of the samples.

        Args:
            kept: A slice, indices in order, or a bool for each sample.

        Raises:
            ParameterError: If it is something else.
        """
        chosen = selected(kept, len(self.time))
        names = ["time", "q", "v", "force", "covariance", *(["a"] if self.a is not None else [])]
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})


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
    found = _at(log[name], force, sensor.sample_std, motion, shift)
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
        ParameterError: If the sensor is no load cell.
    """
    cell = log.sensors.get(name)
    if not isinstance(cell, LoadCell):
        raise ParameterError("name", "a load cell of the log", name)
    shown = cell.in_range(log[name]["wrench"].values)
    found = _at(log[name], shown, cell.sample_std, motion, shift)
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
    """
    parts = ForceParts(motion, joints, mount, added_mass)
    return parts.samples(parts.force, "inverse dynamics")


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
    parts = ForceParts(motion, None, mount, added_mass)
    base = [i for body in parts.robot.bodies for i in body.floating_dofs or ()]
    if not base:
        raise ParameterError("robot", "one with a floating body", parts.robot.name)
    others = [i for i in range(parts.robot.dof) if i not in base]
    force = parts.force.copy()
    force[:, others] = np.nan
    return parts.samples(force, "load cell")


class ForceParts:
    """Force of the air along a measured motion, with its covariance.

    Args:
        motion: From `estimate_motion`.
        joints: Forces of the joints; None: not measured.
        mount: Wrench of what holds the floating body; None: not measured.
        added_mass: Inertia of the air that is known; None for none.

    Attributes:
        force: Of the air, (N, n) [N, N m].
        covariance: Of the force, (N, n, n) [N^2, N^2 m^2].

    Raises:
        FlightError: If the motion misses a quantity or carries no robot.
        ShapeError: If the signals do not fit the motion.
        ParameterError: If a gust of the added mass travels.
    """

    def __init__(
        self,
        motion: xr.Dataset,
        joints: Measured | None,
        mount: Wrench | None,
        added_mass: AddedMass | None,
    ) -> None:
        self.robot = robot_of(motion)
        for name in ("q", "v", "a", "covariance"):
            if name not in motion:
                held = ", ".join(map(str, motion.data_vars))
                raise FlightError(f"motion: expected {name}, but it holds {held}")
        if added_mass is not None:
            added_mass.air.require_uniform("added_mass.air")
        self.time = np.asarray(motion["time"].values, float)
        self.q, self.v, self.a = (np.asarray(motion[name].values, float) for name in "qva")
        torque = self._signal("joints", joints, self.robot.dof)
        wrench = self._signal("mount", None if mount is None else mount.measured, 6)
        self._known = self._known_rows(motion, joints, mount)
        function = _measured_force(self.robot, None if mount is None else mount.cell, added_mass)
        slopes = self._evaluate(function, torque.values, wrench.values, added_mass)
        self.covariance = self._spread(
            slopes, np.asarray(motion["covariance"].values, float), torque, wrench
        )

    def samples(self, force: Array, source: str) -> ForceSamples:
        """Samples of a force, (N, n), in the coordinates where it is known.

        Args:
            force: Of the air, (N, n) [N, N m].
            source: How it was measured.
        """
        covariance = self.covariance.copy()
        known = np.where(self._known, force, np.nan)
        lost = np.isnan(known)
        covariance[lost[:, :, None] | lost[:, None, :]] = np.nan
        motion = self.time, self.q, self.v
        return ForceSamples(*motion, known, covariance, self.robot, source, a=self.a)

    def _signal(self, name: str, signal: Measured | None, width: int) -> Measured:
        """Signal of the motion's length; zeros where it was not measured."""
        shape = (len(self.time), width)
        if signal is None:
            return Measured(np.zeros(shape), np.zeros(shape))
        real_array(name, signal.values, shape)
        return signal

    def _evaluate(
        self,
        function: dict[str, NativeFunction],
        torque: Array,
        wrench: Array,
        added_mass: AddedMass | None,
    ) -> Array:
        """Force along the motion, and its slopes to q, v, a and wrench, (N, n, 3 n + 6)."""
        count, n = self.q.shape
        wind = np.zeros((count, 3)) if added_mass is None else added_mass.air.wind_at(self.time)
        numbers = np.zeros(0) if added_mass is None else added_mass.parameters
        constants = self.robot.parameters, numbers
        state = np.hstack([self.q, self.v, self.a, wrench])
        force = function["air_force"].batch(state, np.nan_to_num(torque), wind, *constants)
        self.force = np.array(force).reshape(count, n)
        slopes = np.empty((count, n, 3 * n + 6))
        for k, direction in enumerate(np.eye(3 * n + 6)):
            column = function["along"].batch(state, wind, direction, *constants)
            slopes[:, :, k] = np.asarray(column).reshape(count, n)
        return slopes

    def _spread(self, slopes: Array, motion: Array, torque: Measured, wrench: Measured) -> Array:
        """Covariance of the force, (N, n, n), from that of motion, torque and wrench."""
        n = self.robot.dof
        by_motion, by_wrench = slopes[:, :, : 3 * n], slopes[:, :, 3 * n :]
        covariance = by_motion @ motion @ np.swapaxes(by_motion, 1, 2)
        covariance += (by_wrench * wrench.variance[:, None]) @ np.swapaxes(by_wrench, 1, 2)
        rows = np.arange(n)
        covariance[:, rows, rows] += torque.variance
        return np.asarray(covariance)

    def _known_rows(
        self, motion: xr.Dataset, joints: Measured | None, mount: Wrench | None
    ) -> Bools:
        robot = self.robot
        base = {i for body in robot.bodies for i in body.floating_dofs or ()}
        free = str(motion.attrs.get("mount", "free")) in ("", "free")
        known = np.ones((len(self.time), robot.dof), bool)
        for i in range(robot.dof):
            if i in base and not free and mount is None:
                known[:, i] = False
            if i in robot.actuated:
                known[:, i] = False if joints is None else np.isfinite(joints.values[:, i])
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
        beside = {}
        if cell is not None:
            beside["mount_force"] = _of_cell(machine, q, shown, cell)
        if added_mass is not None:
            motion = (q, v, a)
            beside["added_mass_force"] = added_mass_force(
                machine, added_mass, motion, wind, numbers
            )
        force = ca.densify(air_force(machine, q, v, a, {"u1": torque, **beside}))
        along = ca.densify(ca.jtimes(force, state, direction))
        names = ["parameters", "air_parameters"]
        return [
            ca.Function(
                "air_force",
                [state, torque, wind, p, numbers],
                [force],
                ["state", "torque", "wind", *names],
                ["force"],
            ),
            ca.Function(
                "along",
                [state, wind, direction, p, numbers],
                [along],
                ["state", "wind", "direction_parameters", *names],
                ["change"],
            ),
        ]

    place = None if cell is None else (cell.body, cell.position, cell.orientation)
    carried = None if added_mass is None else added_mass.describe()
    key = f"measured air force {place} {carried} {robot.structure}"
    return load_functions(key, build, label=f"measured force on {robot.name}")


def _of_cell(machine: Robot, q: ca.SX, shown: ca.SX, cell: LoadCell) -> ca.SX:
    """Generalized force of what a cell shows, (n, 1) [N, N m]."""
    turn, lever = ca.DM(cell.orientation), ca.DM(cell.position)
    force, moment = turn @ shown[:3], turn @ shown[3:]
    if cell.body is not None:
        moment = moment + ca.cross(lever, force)
        return generalized_force(machine, q, {machine.body_index(cell.body): (force, moment)})
    pose = body_poses(machine, q)[0]
    moment = moment + ca.cross(lever - pose.position, force)
    to_body = pose.rotation.T
    return generalized_force(machine, q, {0: (to_body @ force, to_body @ moment)})


def _at(
    reading: xr.Dataset, values: Array, std: Array | float, motion: xr.Dataset, shift: float
) -> Measured:
    """Signal smoothed at the times of a motion, with the noise of its spectrum where it is zero."""
    stamps = np.asarray(reading["time"].values, float) - shift
    times = np.asarray(motion["time"].values, float)
    width = values.shape[1]
    told = np.isfinite(values).sum(axis=0) > _ORDER
    values, spread = values[:, told], np.full((2, len(times), width), np.nan)
    least = _LEAST * np.maximum(np.nanstd(values, axis=0), 1e-9)
    noise = np.array(np.broadcast_to(std, width), float)[told]
    for k in np.flatnonzero(noise == 0):
        seen = np.isfinite(values[:, k])
        noise[k] = spectral_noise(stamps[seen], values[seen, k, None], _ORDER).std
    noise = np.fmax(noise, least)
    if told.any():
        found = smooth_series(stamps, values, noise, times, order=_ORDER)
        spread[:, :, told] = found.state[:, :, 0], found.covariance[:, :, 0, 0]
    every = np.full(width, np.nan)
    every[told] = noise
    return Measured(spread[0], spread[1], every)
