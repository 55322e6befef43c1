"""Places of the entries of q beside those of v.

Each degree of freedom has its place in v and its coordinate in q, in the same order; a
quaternion is one coordinate more than the three rates it goes with. Its qx, qy, qz stand where
v has roll, pitch, yaw, and qw before the first of them.
"""

from __future__ import annotations

from collections.abc import Sequence

Attitudes = Sequence[tuple[int, ...]]
"""Places in v of roll, pitch and yaw of every body whose attitude is a quaternion."""


def repeated(names: Sequence[str]) -> list[str]:
    """Names that stand more than once."""
    return [name for i, name in enumerate(names) if name in names[:i]]


def places_in_q(dof: int, attitudes: Attitudes) -> tuple[int, ...]:
    """For each entry of v the place in q of what it moves; of roll that of qx, and so on.

    Args:
        dof: Number of velocities n.
        attitudes: Where quaternions are.
    """
    firsts = [min(dofs) for dofs in attitudes]
    return tuple(i + sum(first <= i for first in firsts) for i in range(dof))


def coordinate_names(dof_names: Sequence[str], attitudes: Attitudes) -> tuple[str, ...]:
    """Names of the coordinates, in the order of q.

    Args:
        dof_names: Names in the order of v.
        attitudes: Where quaternions are.
    """
    scalars: dict[int, str] = {}
    others: dict[int, str] = {}
    for dofs in attitudes:
        stem = dof_names[dofs[0]].removesuffix("roll")
        scalars[min(dofs)] = f"{stem}qw"
        others |= {dof: f"{stem}q{letter}" for dof, letter in zip(dofs, "xyz", strict=True)}
    names: list[str] = []
    for i, name in enumerate(dof_names):
        names += [scalars[i]] if i in scalars else []
        names.append(others.get(i, name))
    return tuple(names)
