"""Robots whose foreign air is flown, and the ranges of their wingbeats.

MuJoCo flies robots of the catalogue, the vortex lattice single wings of its own. MuJoCo refuses a
lamina whose two moments make up the third to the last digit, so the Aerobat beta's are made a
thousandth less flat.
"""

from __future__ import annotations

from math import pi

from patagium.robot import Robot, load_robot
from patagium_lab.foreign.kinematics import GaitRange, JointRange, Range
from patagium_lab.foreign.wings import WINGS

MOUNTED, FREE, DRAG, LATTICE = "mujoco-mount", "mujoco-free", "mujoco-free-drag", "vortex-lattice"
TITLES = {
    MOUNTED: "MuJoCo's ellipsoids, on a mount",
    FREE: "MuJoCo's ellipsoids, free flight",
    DRAG: "MuJoCo's ellipsoids, free flight with drag of the bodies",
    LATTICE: "PteraSoftware's vortex lattice, a wing on a mount",
}
"""Kinds of foreign air, and their names on the page."""
_ANY = (0.0, 2 * pi)
_FLAT = 0.999  # factor on the third moment of a lamina


def subject_robot(name: str) -> Robot:
    """Robot or single wing by its name.

    Args:
        name: Name of a preset, or of a wing of `WINGS`.
    """
    if name in WINGS:
        return WINGS[name].robot()
    robot = load_robot(name)
    flat = [body for body in robot.bodies if _lamina(body.inertia)]
    names = (f"{body.name}.inertia.zz" for body in flat)
    return robot.with_parameters(
        {name: float(body.inertia[2]) * _FLAT for name, body in zip(names, flat, strict=True)}
    )


def _lamina(inertia: tuple[float, ...]) -> bool:
    return bool(float(inertia[2]) >= (1 - 1e-6) * (float(inertia[0]) + float(inertia[1])) > 0)


def _flapping(
    frequency: Range, speed: Range, *joints: JointRange, incidence: Range = (-0.05, 0.25)
) -> GaitRange:
    return GaitRange(frequency, speed, incidence, joints)


_AEROBAT = (
    JointRange("plunge", (0.25, 0.8), offset=(-0.2, 0.2)),
    JointRange("elbow", (0.0, 0.5), _ANY),
    JointRange("feather", (0.0, 0.5), (0.6, 2.4), (-0.1, 0.1)),
    JointRange("mediolateral", (0.0, 0.25), _ANY),
)
_BETA = (
    JointRange("plunge", (0.25, 0.7), offset=(-0.2, 0.1)),
    JointRange("elbow", (0.0, 0.6), _ANY, (-0.3, 0.0)),
)
_DRAGONFLY = (
    JointRange("fore_plunge", (0.2, 0.6), offset=(-0.1, 0.2)),
    JointRange("fore_feather", (0.1, 0.6), (0.8, 2.2)),
    JointRange("hind_plunge", (0.2, 0.6), _ANY, (-0.1, 0.2)),
    JointRange("hind_feather", (0.1, 0.6), _ANY),
)
_HAWK = (
    JointRange("sweep", (0.05, 0.3), offset=(0.15, 0.3)),
    JointRange("fold", (0.1, 0.5), _ANY, (0.4, 0.9)),
    JointRange("elevation", (0.05, 0.4), _ANY, (-0.1, 0.05)),
)
_ORNITHOPTER = (
    JointRange("plunge", (0.2, 0.6), offset=(0.0, 0.15)),
    JointRange("elevation", (0.0, 0.3), _ANY, (-0.2, 0.1)),
    JointRange("rudder", (0.0, 0.25), _ANY),
)
_HINGE = (
    JointRange("plunge", (0.15, 0.65)),
    JointRange("feather", (0.0, 0.5), (0.9, 2.3)),
    JointRange("sweep", (0.0, 0.2), _ANY),
)

_CATALOGUE = {
    "aerobat": _flapping((3.5, 8.0), (2.0, 5.0), *_AEROBAT),
    "aerobat-beta": _flapping((3.5, 7.0), (2.0, 5.0), *_BETA),
    "dragonfly": _flapping((8.0, 18.0), (2.0, 6.0), *_DRAGONFLY),
    "hawk": _flapping((1.0, 4.0), (6.0, 12.0), *_HAWK),
    "ornithopter": _flapping((2.5, 5.5), (3.5, 7.0), *_ORNITHOPTER),
}
_ON_HINGE = {
    "wing-square": (4.0, 8.0),
    "wing-tapered": (4.0, 8.0),
    "wing-slender": (3.0, 6.0),
    "wing-swept": (3.0, 6.0),
    "wing-broad": (3.0, 7.0),
}
_FLYING = {name: one for name, one in _CATALOGUE.items() if name != "aerobat-beta"}  # it tumbles
SUBJECTS: dict[str, dict[str, GaitRange]] = {
    MOUNTED: _CATALOGUE,
    FREE: _FLYING,
    DRAG: _FLYING,
    LATTICE: {
        name: _flapping(frequency, (2.0, 5.0), *_HINGE, incidence=(0.0, 0.14))
        for name, frequency in _ON_HINGE.items()
    },
}
"""Ranges of the wingbeats by kind of air and robot."""
