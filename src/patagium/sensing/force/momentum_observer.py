"""Force of the air by an observer of the generalized momentum, without accelerations.

With p = D v the momentum and T the kinetic energy, p' = dT/dq - G + u1 + damping + mount + Q: what
p does beyond what is known is the air's force Q. Neglected: errors of the robot's parameters.

References:
    De Luca & Mattone (2003), Actuator failure detection and isolation using generalized momenta.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson

from patagium.aerodynamics import AddedMass
from patagium.dynamics import equations
from patagium.errors import LogError, positive
from patagium.native import NativeFunction, load_functions
from patagium.robot import Robot
from patagium.sensing.force.samples import ForceSamples
from patagium.sensing.force.sources import ForceParts, Measured, Wrench

Array = NDArray[np.float64]


def momentum_force(
    motion: xr.Dataset,
    *,
    gain: float,
    joints: Measured | None = None,
    mount: Wrench | None = None,
    added_mass: AddedMass | None = None,
) -> ForceSamples:
    """Force of the air by an observer of the momentum p = D v, without accelerations.

    r' = K (p' - (dT/dq - G + u1 + damping + mount) - r), with T the kinetic energy, run forwards
    and backwards and averaged, so that it does not lag: what changes at w is seen by
    1 / (1 + w^2 / K^2). That is made up for once, and what is left of it counts as error. The
    covariance is that of inverse dynamics, which an observer's cannot exceed.

    Args:
        motion: From `estimate_motion`; its accelerations are not used.
        gain: K, above what the force does [1/s].
        joints: Forces of the joints; None: not measured.
        mount: Wrench of what holds the floating body; None: not measured.
        added_mass: Inertia of the air that is known and no part of y; None for none.

    Raises:
        FlightError: If the motion misses a quantity or carries no robot.
        ShapeError: If the signals do not fit the motion.
        ParameterError: If the gain is not positive.
        LogError: If the times of the motion are not equally spaced.
    """
    positive("gain", gain)
    parts = ForceParts(motion, joints, mount, added_mass)
    step = float(np.median(np.diff(parts.time)))
    if np.abs(np.diff(parts.time) - step).max() > 1e-3 * step:
        raise LogError("motion: expected equal steps in time for an observer of the momentum")
    momentum, rate = (
        np.array(part).reshape(parts.q.shape)
        for part in _momentum_function(parts.robot).batch(parts.q, parts.v, parts.robot.parameters)
    )
    known = rate + parts.held + parts.joint
    drift = cumulative_simpson(known, x=parts.time, axis=0, initial=0.0)
    apart = momentum - drift
    first = np.gradient(apart, step, axis=0, edge_order=2)
    once = _observed(apart, first, step, gain)
    again = _seen(once, step, gain)
    thrice = _seen(again, step, gain)
    force = 2 * once - again
    left = once - 2 * again + thrice  # what making up once leaves of what was seen, ...
    around = np.maximum(_seen(left**2, step, gain / 4), left**2)  # ... also where it crosses zero
    return parts.samples(force, "momentum observer", around)


class MomentumObserver:
    """Observer that runs on a robot: force of the air up to a lag of 1 / K.

    Args:
        robot: The machine.
        gain: K [1/s].

    Raises:
        ParameterError: If the gain is not positive.
    """

    def __init__(self, robot: Robot, gain: float) -> None:
        self.robot, self.gain = robot, positive("gain", gain)
        self._function = _momentum_function(robot)
        self._time: float | None = None
        self._past = self._momentum = np.zeros(robot.dof)
        self._force = np.zeros(robot.dof)

    @property
    def force(self) -> Array:
        """Aerodynamic force estimated so far, (n,) [N, N m]."""
        return self._force.copy()

    def step(self, time: float, q: Array, v: Array, known: Array) -> Array:
        """Force of the air after one more sample.

        Args:
            time: Later than before [s].
            q: Generalized coordinates, (n,) [m, rad].
            v: Generalized velocities, (n,) [m/s, rad/s].
            known: Forces of joints and mount, (n,) [N, N m]; dampers are the robot's.

        Returns:
            (n,) [N, N m].

        Raises:
            LogError: If time does not advance.
        """
        momentum, rate = self._function(q, v, self.robot.parameters)
        push = np.atleast_1d(rate) + known
        momentum = np.atleast_1d(momentum)
        if self._time is not None:
            span = time - self._time
            if not span > 0:
                raise LogError(f"time: expected to advance, found {time:.9g} s")
            slope = (momentum - self._momentum) / span - 0.5 * (push + self._past)
            self._force = slope + (self._force - slope) * np.exp(-self.gain * span)
        self._time, self._momentum, self._past = time, momentum, push
        return self.force


def _observed(apart: Array, slope: Array, step: float, gain: float) -> Array:
    """Rate of a momentum observed forwards and backwards, begun from the slopes at the ends."""
    rates = np.diff(apart, axis=0) / step
    keep = np.exp(-gain * step)
    forth, back = np.empty_like(apart), np.empty_like(apart)
    forth[0], back[-1] = slope[0], slope[-1]
    for k in range(len(rates)):
        forth[k + 1] = rates[k] + (forth[k] - rates[k]) * keep
        j = len(rates) - 1 - k
        back[j] = rates[j] + (back[j + 1] - rates[j]) * keep
    return 0.5 * (forth + back)


def _seen(force: Array, step: float, gain: float) -> Array:
    """Force as an observer would see it, (N, n) [N, N m]."""
    whole = np.vstack([np.zeros(force.shape[1]), np.cumsum(0.5 * (force[1:] + force[:-1]), axis=0)])
    return _observed(whole * step, force, step, gain)


def _momentum_function(robot: Robot) -> NativeFunction:
    """Compiled (q, v, parameters) -> D v, and dT/dq - G - damping."""

    def build() -> list[ca.Function]:
        machine, p = robot.symbolic()
        q, v = ca.SX.sym("q", robot.dof), ca.SX.sym("v", robot.dof)
        kinetic = equations.kinetic_energy(machine, q, v)
        rate = ca.gradient(kinetic, q) - equations.gravity_force(machine, q)
        rate = rate + equations.damping_force(machine, v)
        results = [ca.densify(ca.gradient(kinetic, v)), ca.densify(rate)]
        inputs = ["q", "v", "parameters"]
        return [ca.Function("momentum", [q, v, p], results, inputs, ["momentum", "rate"])]

    key = f"momentum and its known rate {robot.structure}"
    return load_functions(key, build, label=f"momentum of {robot.name}")["momentum"]
