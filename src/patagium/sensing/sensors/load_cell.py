"""Six-axis load cell between the robot and its mount.

The cell measures the force of the mount on the robot and the moment about its own origin, in its
own axes, through a cross-talk matrix and a low-pass. Neglected: elasticity and mass of the cell,
temperature, hysteresis.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from patagium.arrays import Array, real_array
from patagium.errors import FlightError, ParameterError
from patagium.sensing.sensors.scene import Scene
from patagium.sensing.sensors.sensor import (
    Axes,
    FramedSensor,
    Reading,
    Signal,
    bound,
    noise,
    stepped,
)
from patagium.simulation.flight import WRENCH


@dataclass(frozen=True, kw_only=True)
class LoadCell(FramedSensor):
    """Sensor of the force and moment of the mount on the robot.

    shown = (1 + cross_talk) wrench + bias + noise.

    Args:
        name: Key of the sensor in a log; "loadcell" by default.
        rate: Samples a second by its own clock [Hz].
        delay: Time from an event to its stamp [s].
        clock_offset: Reading of its clock at the world's time zero [s].
        clock_drift: Gain of its clock per second [s/s].
        wrench: Variable of the flight, (time, 6): force, then moment about the world's origin,
            world axes [N, N m]; or (time, load_cell, 6), in the axes of each cell.
        at: Name of one of the flight's load cells; None if the flight has one wrench.
        body: Body that carries the cell; None if it stands at the world's origin, in world axes.
        position: Position of its origin from that of the body, body axes, (3,) [m].
        orientation: Rotation from its axes to body axes, (3, 3) [-].
        force_std: Standard deviation of the noise of a sample, (3,) or one for all [N].
        moment_std: Standard deviation of the noise of a sample, (3,) or one for all [N m].
        force_bias: Standard deviation of the constant error, (3,) or one for all [N].
        moment_bias: Standard deviation of the constant error, (3,) or one for all [N m].
        cross_talk: Share of each component in each other, (6, 6) [1, m, 1/m]; None for none.
        force_step: One count, (3,) or one for all [N]; 0 for none.
        moment_step: One count, (3,) or one for all [N m]; 0 for none.
        force_range: Force at which it saturates, (3,) or one for all [N]; None for no limit.
        moment_range: Moment at which it saturates, (3,) or one for all [N m]; None for no limit.
        bandwidth: Bandwidth of a first-order low-pass [Hz]; None without one.

    Raises:
        ParameterError: If a number is out of its range, or `orientation` is no rotation.
        ShapeError: If a vector or matrix has another shape.
    """

    wrench: str = "mount_wrench"
    at: str | None = None
    body: str | None = None
    force_std: float | tuple[float, ...] = noise()
    moment_std: float | tuple[float, ...] = noise()
    force_bias: float | tuple[float, ...] = noise()
    moment_bias: float | tuple[float, ...] = noise()
    cross_talk: Axes | None = noise(None, signed=True)
    force_step: float | tuple[float, ...] = noise()
    moment_step: float | tuple[float, ...] = noise()
    force_range: float | tuple[float, ...] | None = bound()
    moment_range: float | tuple[float, ...] | None = bound()
    bandwidth: float | None = bound()

    def __post_init__(self) -> None:
        if self.cross_talk is not None:
            matrix = real_array("cross_talk", self.cross_talk, (6, 6))
            if not np.isfinite(matrix).all():
                raise ParameterError("cross_talk", "finite numbers", self.cross_talk)
            object.__setattr__(self, "cross_talk", tuple(map(tuple, matrix.tolist())))
        super().__post_init__()

    @property
    def sample_std(self) -> Array:
        """Standard deviation of a sample by noise and rounding, (6,) [N, N m]."""
        return np.asarray(np.hypot(self._pair("std"), self._pair("step") / np.sqrt(12.0)))

    @property
    def limit(self) -> Array:
        """Size at which each value saturates, (6,) [N, N m]; see `Sensor.limit`."""
        ranges = self.force_range, self.moment_range
        return np.concatenate([np.broadcast_to(np.inf if k is None else k, 3) for k in ranges])

    def measure(self, scene: Scene, times: Array, rng: np.random.Generator) -> Reading:
        """Reading of a scene at given times, (N,) [s]; see `Sensor.measure`."""
        felt = self._felt(scene)
        true, seen = (scene.through(felt, times, width) for width in (None, self.bandwidth))
        if self.cross_talk is not None:
            seen = seen + seen @ np.asarray(self.cross_talk).T
        bias = self._pair("bias") * rng.standard_normal(6)
        white = self._pair("std") * rng.standard_normal(seen.shape)
        shown = np.clip(seen + bias + white, -self.limit, self.limit)
        signal = partial(Signal, ("component",), "N or N m")
        return Reading(
            {"wrench": signal(stepped(shown, self._pair("step")))},
            {"wrench": signal(true), "bias": signal(np.broadcast_to(bias, true.shape))},
            {"component": WRENCH},
        )

    def _pair(self, part: str) -> Array:
        return np.concatenate([getattr(self, f"force_{part}"), getattr(self, f"moment_{part}")])

    def _felt(self, scene: Scene) -> Array:
        """Wrench in the cell's own axes at the samples of the flight, (N, 6) [N, N m]."""
        world = scene.values(self.wrench, "a load cell")
        if self.at is not None:
            cells = scene.flight[self.wrench].coords.get("load_cell")
            known = [] if cells is None else [str(name) for name in cells.values]
            if self.at not in known:
                raise ParameterError("at", f"a load cell of the flight, {known}", self.at)
            world = world[:, known.index(self.at)]
        if world.shape[1:] != (6,):
            raise FlightError(self.wrench, "(time, 6) for a load cell", world.shape)
        if self.at is not None:
            return world
        rotation, origin = np.asarray(self.orientation), np.asarray(self.position)
        if self.body is not None:
            motion = self._motion(scene, self.body, scene.time)
            rotation, origin = motion.rotation, motion.position
        force, moment = world[:, :3], world[:, 3:]
        moment = moment - np.cross(origin, force)
        turned = [np.einsum("...ji,...j->...i", rotation, part) for part in (force, moment)]
        return np.concatenate(turned, axis=1)
