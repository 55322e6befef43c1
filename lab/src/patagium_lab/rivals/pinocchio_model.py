"""The robot as a Pinocchio model with the coordinates of q: oracle and rival.

A floating base is a translation followed by ZYX Euler angles or, with a quaternion, by a
spherical joint, so that D, C v and G compare entry by entry. Damping is left out, as in D, C v
and G. Needs `pin`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from patagium.arrays import Array
from patagium.robot.model import Robot
from patagium_lab.rivals.joint_table import (
    configuration_order,
    coordinate_order,
    joint_table,
)


class PinocchioModel:
    """A robot's dynamics by Pinocchio, called from Python.

    Args:
        robot: Machine with numbers, not symbols.

    Attributes:
        model: The `pinocchio.Model`.
        order: Index in v of each velocity of the model, (n,) [1].
        places: Index in q of each coordinate of the model, (n_q,) [1].
    """

    def __init__(self, robot: Robot) -> None:
        import pinocchio

        rows = joint_table(robot)
        joints = {
            "translation": pinocchio.JointModelTranslation,
            "zyx": pinocchio.JointModelSphericalZYX,
            "spherical": pinocchio.JointModelSpherical,
        }
        self.pinocchio: Any = pinocchio
        self.model: Any = pinocchio.Model()
        self.model.gravity.linear = np.array([0.0, 0.0, -float(robot.gravity)])
        for row in rows:
            kind = joints.get(row.kind) or getattr(pinocchio, f"JointModel{row.kind}")
            placement = pinocchio.SE3(row.rotation, row.position)
            joint = self.model.addJoint(row.parent + 1, kind(), placement, row.name)
            inertia = pinocchio.Inertia(row.mass, row.center_of_mass, row.central_inertia)
            self.model.appendBodyToJoint(joint, inertia, pinocchio.SE3.Identity())
        self.data: Any = self.model.createData()
        self.order = coordinate_order(rows)
        self.places = configuration_order(robot, rows)

    def mass_matrix(self, q: Array) -> Array:
        """D by the composite-rigid-body algorithm, (n, n) [kg, kg m, kg m^2]."""
        upper: Array = np.triu(self.pinocchio.crba(self.model, self.data, q[self.places]))
        matrix = np.empty_like(upper)
        matrix[np.ix_(self.order, self.order)] = upper + np.triu(upper, 1).T
        return matrix

    def bias(self, q: Array, v: Array) -> Array:
        """C v + G by `nonLinearEffects`, (n,) [N, N m]."""
        found = self.pinocchio.nonLinearEffects(
            self.model, self.data, q[self.places], v[self.order]
        )
        return self._ours(found)

    def inverse(self, q: Array, v: Array, a: Array) -> Array:
        """D a + C v + G by the recursive Newton-Euler algorithm, (n,) [N, N m]."""
        o, p = self.order, self.places
        return self._ours(self.pinocchio.rnea(self.model, self.data, q[p], v[o], a[o]))

    def forward(self, q: Array, v: Array, force: Array) -> Array:
        """Acceleration by the articulated-body algorithm, (n,) [m/s^2, rad/s^2]."""
        o, p = self.order, self.places
        return self._ours(self.pinocchio.aba(self.model, self.data, q[p], v[o], force[o]))

    def _ours(self, found: Array) -> Array:
        vector = np.empty(len(self.order))
        vector[self.order] = found
        return vector
