"""Single wings on a mount: one description for the robot file and for the vortex lattice.

A wing is a flat trapezium on a hinge at the origin of a hub, a left wing along y. Neglected:
thickness, twist, bending.
"""

from __future__ import annotations

from dataclasses import dataclass

from patagium.robot import Robot, load_robot_text

AXES = {"plunge": "x", "feather": "y", "sweep": "z"}
"""Axis of each joint of the hinge, in the order in which they turn."""
STRIPS = 8
"""Number of blade elements of a wing."""
_AREA_MASS = 0.25  # mass of a wing over its area [kg/m^2]


@dataclass(frozen=True)
class SingleWing:
    """A trapezium on a hinge.

    Attributes:
        name: Name of the robot.
        root_chord: Chord at the root [m].
        tip_chord: Chord at the tip [m].
        span: Distance of the tip from the root [m].
        back: Distance by which the tip's leading edge lies behind the root's [m].
        axis: Distance of the feathering axis behind the leading edge, over the root chord [1].
        root: Distance of the root from the hinge [m].
    """

    name: str
    root_chord: float
    tip_chord: float
    span: float
    back: float
    axis: float = 0.25
    root: float = 0.0

    @property
    def ahead(self) -> float:
        """Distance of the root's leading edge ahead of the hinge [m]."""
        return self.axis * self.root_chord

    def robot(self) -> Robot:
        """Wing on a hub that a mount carries, with the three joints of the hinge."""
        tip = self.ahead - self.back
        mass = _AREA_MASS * self.span * (self.root_chord + self.tip_chord) / 2
        joints = "".join(f"      - {{name: {k}, axis: {v}}}\n" for k, v in AXES.items())
        middle = (self.ahead - self.root_chord / 2 + tip - self.tip_chord / 2) / 2
        chord = (self.root_chord + self.tip_chord) / 2
        return load_robot_text(
            f"name: {self.name}\n"
            "gravity: 9.81 m/s^2\n"
            "bodies:\n"
            "  hub:\n"
            "    floating: true\n"
            "    mass: 20 g\n"
            "    shape: {type: ellipsoid, semi_axes: [1 cm, 1 cm, 1 cm]}\n"
            "  wing:\n"
            "    parent: hub\n"
            f"    joints:\n{joints}"
            f"    mass: {mass:.6g} kg\n"
            f"    center_of_mass: [{middle:.6g} m, {self.root + self.span / 2:.6g} m, 0]\n"
            f"    shape: {{type: plate, chord: {chord:.6g} m, span: {self.span:.6g} m, "
            "thickness: 1 mm}\n"
            "wings:\n"
            "  - name: wing\n"
            "    segments:\n"
            "      - body: wing\n"
            f"        strips: {STRIPS}\n"
            "        stations:\n"
            f"          - {{span: {self.root:.6g} m, leading: {self.ahead:.6g} m, "
            f"trailing: {self.ahead - self.root_chord:.6g} m}}\n"
            f"          - {{span: {self.root + self.span:.6g} m, leading: {tip:.6g} m, "
            f"trailing: {tip - self.tip_chord:.6g} m}}\n",
            self.name,
        )


WINGS = {
    wing.name: wing
    for wing in (
        SingleWing("wing-square", 0.10, 0.10, 0.20, 0.0),
        SingleWing("wing-tapered", 0.10, 0.06, 0.20, 0.01),
        SingleWing("wing-slender", 0.06, 0.03, 0.30, 0.015, root=0.02),
        SingleWing("wing-swept", 0.12, 0.06, 0.22, 0.10, axis=0.5),
        SingleWing("wing-broad", 0.14, 0.12, 0.14, 0.02, axis=0.0, root=0.04),
    )
}
"""Single wings by name."""
