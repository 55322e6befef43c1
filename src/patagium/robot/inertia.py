"""Moments of inertia of simple homogeneous shapes, or as measured.

Every tensor is about the centre of mass, in the axes of the body. Neglected:
uneven density; describe such a body by its measured moments.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Tensor = NDArray[np.float64]


def cylinder(mass: float, axis: NDArray[np.float64], radius: float, length: float) -> Tensor:
    """Inertia of a solid cylinder about its centre.

    I = I_t (1 - u u^T) + I_a u u^T, I_a = m r^2 / 2, I_t = m (3 r^2 + l^2) / 12.

    Args:
        mass: Mass m [kg].
        axis: Unit vector u along the cylinder, (3,) [-], body axes.
        radius: Radius r [m].
        length: Length l [m].

    Returns:
        Inertia, (3, 3) [kg m^2], body axes: symmetric, positive definite.
    """
    along = np.outer(axis, axis)
    across = mass * (3 * radius**2 + length**2) / 12
    return across * (np.eye(3) - along) + mass * radius**2 / 2 * along


def box(mass: float, size: tuple[float, float, float]) -> Tensor:
    """Inertia of a box with edges along the body axes about its centre.

    I_xx = m (y^2 + z^2) / 12 and so on.

    Args:
        mass: Mass m [kg].
        size: Edges along x, y, z, (3,) [m].

    Returns:
        Inertia, (3, 3) [kg m^2], body axes.
    """
    return _from_second_moments(mass / 12 * np.square(size))


def plate(mass: float, axis: str, chord: float, span: float, thickness: float) -> Tensor:
    """Inertia of a flat rectangular wing: chord along x, span along y or z.

    Args:
        mass: Mass [kg].
        axis: Spanwise axis, "y" or "z".
        chord: Edge along x [m].
        span: Edge along the spanwise axis [m].
        thickness: Remaining edge [m].

    Returns:
        Inertia, (3, 3) [kg m^2], body axes.
    """
    size = (chord, span, thickness) if axis == "y" else (chord, thickness, span)
    return box(mass, size)


def ellipsoid(mass: float, semi_axes: tuple[float, float, float]) -> Tensor:
    """Inertia of a solid ellipsoid along the body axes: I_xx = m (b^2 + c^2) / 5.

    Args:
        mass: Mass m [kg].
        semi_axes: Semi-axes a, b, c along x, y, z, (3,) [m].

    Returns:
        Inertia, (3, 3) [kg m^2], body axes.
    """
    return _from_second_moments(mass / 5 * np.square(semi_axes))


def point() -> Tensor:
    """Inertia of a point mass about itself: zero, (3, 3) [kg m^2]."""
    return np.zeros((3, 3))


def is_physical(tensor: Tensor) -> bool:
    """Whether some distribution of mass has this inertia.

    The principal moments satisfy I1, I2, I3 >= 0 and I1 + I2 >= I3 (triangle inequality).

    Args:
        tensor: Inertia about the centre of mass, (3, 3) [kg m^2].
    """
    if not np.isfinite(tensor).all():
        return False
    moments = np.linalg.eigvalsh(tensor)
    rounding = 1e-6 * abs(moments).max()  # files carry six or seven digits
    return bool(moments[0] >= -rounding and moments[0] + moments[1] >= moments[2] - rounding)


def _from_second_moments(second: NDArray[np.float64]) -> Tensor:
    return np.asarray(np.diag(second.sum() - second))
