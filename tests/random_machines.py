"""Random machines for the oracles: every kind of joint, any branching, any orientation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from patagium.robot.model import Body, Joint, Robot

FLOATING = ("x", "y", "z", "roll", "pitch", "yaw")


def _rotation(rng: np.random.Generator) -> np.ndarray:
    matrix, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return matrix * np.sign(np.linalg.det(matrix))


def _axis(rng: np.random.Generator) -> tuple[float, float, float]:
    if rng.random() < 0.5:
        axis = np.zeros(3)
        axis[rng.integers(3)] = rng.choice([-1.0, 1.0])
    else:
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
    return tuple(map(float, axis))


def _inertia(rng: np.random.Generator) -> tuple[float, ...]:
    """Of a random cloud of points, so that it is one a body can have."""
    points = rng.normal(size=(6, 3)) * 0.1
    points -= points.mean(axis=0)
    matrix = sum(p @ p * np.eye(3) - np.outer(p, p) for p in points)
    return tuple(float(matrix[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


def _machine(seed: int) -> Robot:
    rng = np.random.default_rng(seed)
    bodies: list[Body] = []
    names: list[str] = []
    for index in range(int(rng.integers(2, 7))):
        root = index == 0
        floating = root and bool(rng.random() < 0.5)
        joints, dofs = [], None
        if floating:
            dofs = tuple(range(6))
            names += FLOATING
        else:
            # the root moves and at most two joints carry a body; a body may be fixed to its parent
            for number in range(int(rng.integers(1, 3)) if root else int(rng.integers(0, 3))):
                kind = "revolute" if rng.random() < 0.7 else "prismatic"
                axis = _axis(rng)
                while joints and abs(np.dot(axis, joints[0].axis)) > 0.9:
                    axis = _axis(rng)  # two joints along one axis would be one coordinate twice
                joints.append(Joint(f"joint {index} {number}", kind, axis, len(names)))
                names.append(joints[-1].name)
        straight = rng.random() < 0.3
        turn = np.eye(3) if straight else _rotation(rng)
        bodies.append(
            Body(
                f"body {index}",
                -1 if root else int(rng.integers(0, index)),
                tuple(map(float, rng.normal(size=3) * 0.2)),
                tuple(tuple(map(float, row)) for row in turn),
                tuple(joints),
                dofs,
                float(rng.uniform(0.5, 2.0)),
                tuple(map(float, rng.normal(size=3) * 0.1)),
                _inertia(rng),
            )
        )
    n = len(names)
    return Robot(
        name=f"tree {seed}",
        bodies=tuple(bodies),
        strips=(),
        dof_names=tuple(names),
        dof_units=("rad",) * n,
        actuated=(),
        damping=(0.0,) * n,
        lower=(-np.inf,) * n,
        upper=(np.inf,) * n,
        gravity=9.8,
    )


@pytest.fixture(scope="session")
def random_machine() -> Callable[[int], Robot]:
    """A random tree of bodies for each seed."""
    return _machine
