"""D, C v + G, inverse and forward dynamics against Pinocchio and MuJoCo."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from patagium.dynamics import equations
from patagium.robot import load_robot
from patagium.robot.model import Robot

ROUNDING = 1e-12  # relative to the largest entry: another order of summation
SOLVED = 1e-9  # of D^-1: D's condition number is about 1e7 for the aerobats

PRESETS = ("aerobat", "aerobat-published", "aerobat-beta", "yeo-wing")  # floating, and fixed
# MuJoCo refuses the others: a point has no inertia, a lamina's sums of two moments hit the third
SOLID_PRESETS = ("aerobat", "aerobat-published")


def _ours(robot: Robot) -> ca.Function:
    q, v, a, f = (ca.SX.sym(name, robot.dof) for name in "qvaf")
    outputs = [
        equations.mass_matrix(robot, q),
        equations.bias(robot, q, v),
        equations.inverse(robot, q, v, a),
        equations.forward(robot, q, v, f),
    ]
    return ca.Function("ours", [q, v, a, f], [ca.densify(x) for x in outputs])


def _states(robot: Robot, rng: np.random.Generator, count: int) -> list[list[np.ndarray]]:
    n = robot.dof
    return [
        [rng.uniform(-1.2, 1.2, n), *(rng.normal(size=n) * scale for scale in (3, 10, 0.01))]
        for _ in range(count)
    ]


def _assert_close(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    expected = np.array(expected).reshape(found.shape)
    assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max()


def _compare_with_pinocchio(robot: Robot, rng: np.random.Generator) -> None:
    from patagium_lab.rivals.pinocchio_model import PinocchioModel

    theirs, ours = PinocchioModel(robot), _ours(robot)
    for q, v, a, f in _states(robot, rng, 5):
        mass_matrix, bias, inverse, forward = ours(q, v, a, f)
        _assert_close(theirs.mass_matrix(q), mass_matrix, ROUNDING)
        _assert_close(theirs.bias(q, v), bias, ROUNDING)
        _assert_close(theirs.inverse(q, v, a), inverse, ROUNDING)
        _assert_close(theirs.forward(q, v, f), forward, SOLVED)


@pytest.mark.parametrize("preset", PRESETS)
def test_pinocchio_on_presets(preset: str, rng: np.random.Generator) -> None:
    pytest.importorskip("pinocchio", reason="Pinocchio comes with the extra `bench`")
    _compare_with_pinocchio(load_robot(preset), rng)


@pytest.mark.parametrize("seed", range(20))
def test_pinocchio_on_random_trees(seed: int, random_machine, rng: np.random.Generator) -> None:
    pytest.importorskip("pinocchio", reason="Pinocchio comes with the extra `bench`")
    _compare_with_pinocchio(random_machine(seed), rng)


def _compare_with_mujoco(robot: Robot, rng: np.random.Generator) -> None:
    from patagium_lab.rivals.mujoco_model import MujocoModel

    theirs, ours = MujocoModel(robot), _ours(robot)
    for q, v, a, f in _states(robot, rng, 5):
        mass_matrix, bias, _, _ = ours(q, v, a, f)
        _assert_close(theirs.mass_matrix(q), mass_matrix, ROUNDING)
        _assert_close(theirs.bias(q, v), bias, ROUNDING)


@pytest.mark.parametrize("preset", SOLID_PRESETS)
def test_mujoco_on_presets(preset: str, rng: np.random.Generator) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo comes with the extra `bench`")
    _compare_with_mujoco(load_robot(preset), rng)


@pytest.mark.parametrize("seed", range(20))
def test_mujoco_on_random_trees(seed: int, random_machine, rng: np.random.Generator) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo comes with the extra `bench`")
    _compare_with_mujoco(random_machine(seed), rng)


def test_mujoco_with_a_massless_body(tmp_path: Path, rng: np.random.Generator) -> None:
    """A canted frame, as of a V-tail, was refused for its inertia."""
    pytest.importorskip("mujoco", reason="MuJoCo comes with the extra `bench`")
    shape = "mass: 0.1, shape: {type: box, size: [0.3, 0.1, 0.1]}"
    (tmp_path / "canted.yaml").write_text(
        "name: canted\ngravity: 9.81\nbodies:\n"
        f"  body: {{floating: true, {shape}}}\n"
        "  frame: {parent: body, at: [-0.3, 0, 0], orientation: [0.6, 0, 0], massless: true}\n"
        f"  tail: {{parent: frame, joints: [{{name: vane, axis: y}}], {shape}}}\n"
    )
    _compare_with_mujoco(load_robot(str(tmp_path / "canted.yaml")), rng)
