"""The planar seven-bar linkage that folds Aerobat's wing, driven by one crank.

Three loops close one after the other: crank to humerus, crank to the link that
steers the elbow, and that link to the radius. Each is a dyad whose free pin lies
where two circles meet; keeping to one side of the line of centres keeps to one
branch, as long as the circles never touch, and touching is an error. The angles
are polished by Newton's method on the closures and differentiated implicitly.
Neglected: play and flexibility of the bars, forces in them.

References:
    Aerobat's linkage as in Ghanem et al., "Efficient Modeling of Morphing Wing
    Flight Using Neural Networks and Cubature Rules".
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.arrays import Array
from patagium.errors import LinkageError, ParameterError, positive

Complex = NDArray[np.complex128]

_TOLERANCE = 1e-12  # closure error relative to the longest bar
_REFERENCE = -np.pi / 4  # angles of the wing are within half a turn of it


@dataclass(frozen=True)
class LinkageMotion:
    """Angles of the wing over the crank's phase, and their derivatives by the phase.

    Multiply a rate by the crank's speed [rad/s], an acceleration by its square.

    Attributes:
        phase: Crank phase, (N,) [rad].
        humerus: Plunge angle of the humerus J5, wing up positive, (N,) [rad].
        radius: Absolute plunge angle of the radius J6, (N,) [rad].
        humerus_rate: d humerus / d phase, (N,) [-].
        radius_rate: d radius / d phase, (N,) [-].
        humerus_acceleration: d^2 humerus / d phase^2, (N,) [1/rad].
        radius_acceleration: d^2 radius / d phase^2, (N,) [1/rad].
        closure_error: Largest distance by which a loop stays open, (N,) [m].
    """

    phase: Array
    humerus: Array
    radius: Array
    humerus_rate: Array
    radius_rate: Array
    humerus_acceleration: Array
    radius_acceleration: Array
    closure_error: Array


@dataclass(frozen=True)
class Linkage:
    """Lengths of the seven-bar linkage; y to the wing, z up, origin in the body.

    Bars are named as in the drawing of the linkage (L1, L2a ... P8). `l3b`, `l5a` and
    `l5b` are the regulator lengths that steer the gait: 5.88 to 20.13 mm, 9.79 to
    18.43 mm and 8.76 to 11.66 mm on the robot.

    Attributes:
        l1: Crank pin from its axis [m].
        l2a: Crank pin to the humerus' lever [m].
        l2b: Branch on the coupler, along it [m].
        l2c: Branch on the coupler, across it [m].
        l3a: Shoulder to elbow [m].
        l3b: Lever of the humerus, backwards along it [m].
        l3c: Lever of the humerus, across it [m].
        l4: Branch of the coupler to the rocker [m].
        l5a: Lever of the rocker, backwards along it [m].
        l5b: Lever of the rocker, across it [m].
        l5c: Rocker's axis to its far pin, along it [m].
        l5d: Rocker's axis to its far pin, across it [m].
        l6: Rocker to the radius' lever [m].
        l7a: Elbow to the tip of the radius [m].
        l7b: Lever of the radius, along it [m].
        l7c: Lever of the radius, across it [m].
        alpha3: Bend of the humerus against its lever [rad].
        p1: Axis of the crank, (2,) [m].
        p5: Shoulder, (2,) [m].
        p8: Axis of the rocker, (2,) [m].
        start: Crank angle at phase zero [rad].
    """

    l1: float = 7.5e-3
    l2a: float = 35e-3
    l2b: float = 5e-3 * float(np.cos(np.radians(35)))
    l2c: float = 5e-3 * float(np.sin(np.radians(35)))
    l3a: float = 50e-3
    l3b: float = 6.71e-3
    l3c: float = 6e-3
    l4: float = 36e-3
    l5a: float = 11.18e-3
    l5b: float = 10e-3
    l5c: float = 78.78e-3
    l5d: float = -3.89e-3
    l6: float = 36e-3
    l7a: float = 90e-3
    l7b: float = 35e-3
    l7c: float = 15e-3
    alpha3: float = float(np.radians(-15))
    p1: tuple[float, float] = (-10e-3, -9.8e-3)
    p5: tuple[float, float] = (
        22e-3 * float(np.cos(np.radians(20))),
        22e-3 * float(np.sin(np.radians(20))),
    )
    p8: tuple[float, float] = (
        22e-3 * float(np.sin(np.radians(25))),
        22e-3 * float(np.cos(np.radians(25))),
    )
    start: float = -np.pi / 2

    def __post_init__(self) -> None:
        """Refuse what is no length.

        Raises:
            ParameterError: If a number is not finite, or a bar has no length.
        """
        for entry in fields(self):
            value = getattr(self, entry.name)
            size = 2 if entry.name in ("p1", "p5", "p8") else 1
            if np.size(value) != size or not np.isfinite(value).all():
                raise ParameterError(entry.name, f"{size} finite number(s)", value)
        for name in ("l1", "l2a", "l3a", "l4", "l6", "l7a"):
            positive(name, getattr(self, name), "a positive length [m]")

    def solve(self, phase: ArrayLike) -> LinkageMotion:
        """Motion of humerus and radius, loops closed to 1e-12 of the longest bar.

        Args:
            phase: Crank phase, (N,) or one [rad], any order and any number of turns.

        Raises:
            LinkageError: If the linkage cannot close at some phase.
        """
        phases: Array = np.atleast_1d(np.asarray(phase, dtype=np.float64))
        angles = self._angles(phases)
        rates, accelerations = self._derivatives(phases, angles)
        return LinkageMotion(
            phase=phases,
            humerus=angles[1],
            radius=angles[5],
            humerus_rate=rates[1],
            radius_rate=rates[5],
            humerus_acceleration=accelerations[1],
            radius_acceleration=accelerations[5],
            closure_error=np.abs(self._openings(phases, angles)).max(axis=0),
        )

    def points(self, phase: float) -> dict[str, tuple[float, float]]:
        """Pins of the linkage at one phase, for drawing, (2,) each [m].

        Args:
            phase: Crank phase [rad].

        Raises:
            LinkageError: If the linkage cannot close there.
        """
        at = np.array([phase])
        th2, th5, _, th8, _, th6 = self._angles(at)[:, 0]
        pin = self._crank_pin(at)[0]
        elbow = self._shoulder + _turn(th5) * self._elbow_arm
        pins = {
            "crank_axis": self._crank_axis,
            "crank_pin": pin,
            "humerus_lever": pin + _turn(th2) * self.l2a,
            "coupler_branch": pin + _turn(th2) * self._branch,
            "rocker_lever": self._rocker_axis + _turn(th8) * self._rocker_lever,
            "rocker_axis": self._rocker_axis,
            "rocker_pin": self._rocker_axis + _turn(th8) * self._rocker_arm,
            "radius_lever": elbow + _turn(th6) * self._radius_lever,
            "shoulder": self._shoulder,
            "elbow": elbow,
            "tip": elbow + _turn(th6) * self.l7a,
        }
        return {name: (float(p.real), float(p.imag)) for name, p in pins.items()}

    @property
    def _crank_axis(self) -> complex:
        return complex(*self.p1)

    @property
    def _shoulder(self) -> complex:
        return complex(*self.p5)

    @property
    def _rocker_axis(self) -> complex:
        return complex(*self.p8)

    @property
    def _branch(self) -> complex:
        return complex(self.l2b, self.l2c)

    @property
    def _humerus_lever(self) -> complex:
        """Lever as seen in the axes of th5, bend included."""
        return complex(-self.l3b, self.l3c) * complex(np.exp(-1j * self.alpha3))

    @property
    def _elbow_arm(self) -> complex:
        return complex(self.l3a + self.l3c * np.exp(1j * (np.pi / 2 - self.alpha3)))

    @property
    def _rocker_lever(self) -> complex:
        return complex(-self.l5a, self.l5b)

    @property
    def _rocker_arm(self) -> complex:
        return complex(self.l5c, self.l5d)

    @property
    def _radius_lever(self) -> complex:
        return complex(self.l7b, self.l7c)

    def _crank_pin(self, phase: Array) -> Complex:
        return self._crank_axis + self.l1 * _turn(self.start + phase)

    def _angles(self, phase: Array) -> Array:
        """th2, th5, th3, th8, th9, th6, (6, N) [rad]."""
        pin = self._crank_pin(phase)
        th2, th5 = self._dyad(
            "crank and humerus", phase, pin, self.l2a, self._shoulder, self._humerus_lever
        )
        branch = pin + _turn(th2) * self._branch
        th3, th8 = self._dyad(
            "coupler and rocker", phase, branch, self.l4, self._rocker_axis, self._rocker_lever
        )
        far = self._rocker_axis + _turn(th8) * self._rocker_arm
        elbow = self._shoulder + _turn(th5) * self._elbow_arm
        th9, th6 = self._dyad("rocker and radius", phase, far, self.l6, elbow, self._radius_lever)
        return self._polished(phase, np.array([th2, th5, th3, th8, th9, th6]))

    def _dyad(
        self,
        loop: str,
        phase: Array,
        start: Complex,
        start_length: float,
        end: Complex | complex,
        end_arm: complex,
    ) -> tuple[Array, Array]:
        """Angles of a dyad's bars, its pin left of the line from start to end, (N,) [rad]."""
        between, end_length = end - start, abs(end_arm)
        distance = np.abs(between)
        with np.errstate(divide="ignore", invalid="ignore"):  # centres that coincide: NaN below
            along = (distance**2 + start_length**2 - end_length**2) / (2 * distance)
        squared = start_length**2 - along**2
        # the branches meet where the dyad is stretched or folded flat
        short = ~(squared > 1e-9 * start_length**2)
        if short.any():
            raise LinkageError(
                loop, float(phase[short][0]), (start_length, end_length), float(distance[short][0])
            )
        offset: Complex = between / distance * (along + 1j * np.sqrt(squared))
        pin = start + offset
        return _angle(pin - start, 1.0), _angle(pin - end, end_arm)

    def _polished(self, phase: Array, angles: Array) -> Array:
        """Two Newton steps on the closures: from rounding of circles to rounding of angles."""
        bars = (self._elbow_arm, self._rocker_arm, self.l2a, self.l4, self.l6)
        for _ in range(2):
            opening = self._openings(phase, angles)
            if np.abs(opening).max() < _TOLERANCE * max(map(abs, bars)):
                break
            angles = angles - self._solved(angles, _real_rows(opening))
        return angles

    def _openings(self, phase: Array, angles: Array) -> Complex:
        """The three closures, (3, N) [m]: zero where the loops close."""
        pin, shoulder, rocker = self._crank_pin(phase), self._shoulder, self._rocker_axis
        between = np.array([pin - shoulder, pin - rocker, rocker - shoulder + 0 * pin])
        return np.asarray(between + self._arms(angles).sum(axis=1))

    def _arms(self, angles: Array) -> Complex:
        """Each closure's bars as turned by the six angles, (3, 6, N) [m]."""
        bars = [  # of th2, th5, th3, th8, th9, th6
            [self.l2a, -self._humerus_lever, 0, 0, 0, 0],
            [self._branch, 0, self.l4, -self._rocker_lever, 0, 0],
            [0, -self._elbow_arm, 0, self._rocker_arm, self.l6, -self._radius_lever],
        ]
        return np.array(bars)[:, :, None] * _turn(angles)

    def _solved(self, angles: Array, right: Array) -> Array:
        """Solution of (d closures / d angles) s = right, (6, N)."""
        jacobian = _real_rows(1j * self._arms(angles))
        solution = np.linalg.solve(np.moveaxis(jacobian, -1, 0), right.T[..., None])
        return np.asarray(solution[..., 0].T, dtype=np.float64)

    def _derivatives(self, phase: Array, angles: Array) -> tuple[Array, Array]:
        """First and second derivatives of the angles by the phase, (6, N) each.

        Differentiating sum_k a_k exp(i th_k) = 0 twice: J th' = -i c and
        J th'' = c + sum_k a_k exp(i th_k) th_k'^2, c the crank's bar.
        """
        crank = np.zeros((3, phase.size), complex)
        crank[:2] = self.l1 * _turn(self.start + phase)
        rates = self._solved(angles, -_real_rows(1j * crank))
        turned = np.einsum("ijn,jn->in", self._arms(angles), rates**2)
        return rates, self._solved(angles, _real_rows(crank + turned))


def _turn(angle: Array) -> Complex:
    turned: Complex = np.exp(1j * angle)
    return turned


def _angle(vector: Complex, arm: complex) -> Array:
    """Angle from an arm to a vector, within half a turn of the reference, (N,) [rad]."""
    shifted = np.angle(vector / (arm * np.exp(1j * _REFERENCE)))
    return np.asarray(shifted + _REFERENCE)


def _real_rows(rows: Complex) -> Array:
    """Real and imaginary parts as twice as many rows."""
    return np.concatenate([rows.real, rows.imag])
