"""Every command of a gait moves its joint, and every joint moves the flight."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.robot import Linkage

TIME = np.linspace(0.0, 0.4, 41)


@pytest.fixture(scope="module")
def robot():
    return pt.load_robot("aerobat")


def usual(robot, **change):
    options = {
        "frequency": 5.0,
        "plunge": 0.4,
        "phase": {"plunge": 0.3},
        "offset": {"plunge": 0.1},
    }
    return pt.gaits.sinusoidal(robot, **(options | change))


@pytest.mark.parametrize(
    "change",
    [
        {"frequency": 5.1},
        {"plunge": 0.41},
        {"phase": {"plunge": 0.31}},
        {"offset": {"plunge": 0.11}},
        *({name: 0.01} for name in ("mediolateral", "elbow", "feather")),
        *({f"left_{name}": 0.01} for name in ("mediolateral", "elbow", "feather")),
    ],
)
def test_every_argument_of_a_sinusoid_moves_a_joint(robot, change):
    moved = usual(robot, **change).motion(TIME).position - usual(robot).motion(TIME).position
    assert np.abs(moved).max() > 3e-3
    mirrored = not any(name.startswith("left_") for name in change)
    assert np.array_equal(moved[:, :4], moved[:, 4:]) == mirrored


@pytest.mark.parametrize(
    "change",
    [
        {"frequency": 5.1},
        {"plunge_offset": 0.01},
        {"elbow_offset": 0.01},
        {"linkage": Linkage(l5b=9e-3)},
    ],
)
def test_every_argument_of_the_linkage_moves_a_joint(robot, change):
    gaits = [pt.gaits.linkage(robot, **({"frequency": 5.0} | options)) for options in ({}, change)]
    before, after = (gait.motion(TIME).position for gait in gaits)
    assert np.abs(after - before).max() > 5e-3


@pytest.mark.parametrize("joint", ["plunge", "mediolateral", "elbow", "feather"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_every_joint_of_one_side_turns_the_robot_out_of_its_plane(robot, side, joint):
    def fly(**amplitude):
        gait = pt.gaits.sinusoidal(robot, frequency=5.0, **amplitude)
        start = robot.coordinates(x=4.0)
        flight = pt.simulate(
            robot, pt.QuasiSteady(robot), gait, duration=0.02, time_step=2e-4, v=start,
            q=robot.coordinates(pitch=0.2),
        )  # fmt: skip
        return flight.q.values[-1, : robot.index("yaw") + 1]

    lateral = [robot.index(name) for name in ("y", "roll", "yaw")]
    turned = fly(**{f"{side}_{joint}": 0.3})[lateral]
    other = "right" if side == "left" else "left"
    mirrored = fly(**{f"{other}_{joint}": 0.3})[lateral]
    assert np.abs(turned).max() > 1e-5
    # mirror images, to rounding
    np.testing.assert_allclose(turned, -mirrored, atol=1e-13)
