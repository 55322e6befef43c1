"""Measured force of the air: one type for all the ways to measure it.

Neglected: that errors of neighboring samples are alike, as smoothing leaves them; who learns from
each sample should leave out those closer than a time constant of the smoother.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ShapeError
from patagium.robot import Robot

Array = NDArray[np.float64]


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

    def __post_init__(self) -> None:
        shape = (len(self.time), self.robot.dof)
        for name in ("q", "v", "force"):
            if getattr(self, name).shape != shape:
                raise ShapeError(name, shape, getattr(self, name).shape)
        if self.covariance.shape != (*shape, self.robot.dof):
            raise ShapeError("covariance", (*shape, self.robot.dof), self.covariance.shape)

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
        """
        chosen = kept if isinstance(kept, slice) else np.asarray(kept)
        names = ("time", "q", "v", "force", "covariance")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})
