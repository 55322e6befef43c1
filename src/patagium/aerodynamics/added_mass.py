"""Added mass of the wings: inertia of the air carried along.

Each strip carries a cylinder of air normal to its chord; the strips of a body add up to a
constant apparent inertia, and Kirchhoff's equations give the force, implicit in the
acceleration. Beside a model of circulatory lift, which acts at the quarter chord and
leaves no room for the moment of a steadily moving ideal flow, that moment is taken back.
A gust that travels pushes the air carried along as it changes. Neglected: flow round the tips
but for one factor, the rate of a gust that is the same everywhere, bodies without strips, and
what separation does to the air carried along.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import pi
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics.air import Air, air_from_description
from patagium.aerodynamics.local_flow import lift_place, normalwash, strip_axes, strip_motions
from patagium.aerodynamics.named_descriptions import check_keys
from patagium.aerodynamics.of_wings import wings_of
from patagium.aerodynamics.polars import section_flow
from patagium.aerodynamics.sections import held_share
from patagium.arguments import check_fields
from patagium.arrays import Array, real_array
from patagium.dynamics.added_mass import BodyAddedMass
from patagium.dynamics.chain import vector
from patagium.dynamics.equations import kirchhoff_force
from patagium.dynamics.kinematics import add_wrench, body_poses, generalized_force
from patagium.errors import ParameterError, not_negative
from patagium.native import NativeFunction, load_functions, named_function
from patagium.robot.model import Robot, Strip


@dataclass(frozen=True)
class AddedMass:
    """Apparent inertia of the wings, to go with any model of the air.

    A strip of chord c and width ds carries rho pi (c/2)^2 ds along its normal at
    mid-chord and rho pi/8 (c/2)^4 ds about its span, relative to the air. With U forward,
    Q the normalwash at three quarters of the chord, m the carried mass and r the pitch
    rate, circulation takes back the moment m U Q and gives the chordwise force m r Q:
    together they do no work, and lift and moment become Theodorsen's. Where no flow stays
    attached, the force loses its part across the path, which does no work by itself.

    Args:
        robot: The machine.
        air: Its density; wind and gusts are those of the model it goes with.
        factor: Share of the air of an infinite wing: 1 for long wings, .85 at an aspect ratio of
            3; or one for each wing by its name, mirror images aside, which may be below zero as far
            as the robot's own inertia outweighs it: a learned one stands for all that is off.

    Raises:
        ParameterError: If the one factor is negative, one is not finite, or a wing has none.

    References:
        Theodorsen (1935), NACA TR 496; Garrick (1936), NACA TR 567; Lamb (1932), section 124.
    """

    robot: Robot
    air: Air = field(default_factory=Air)
    factor: float | Mapping[str, float] = field(default=1.0, hash=False)

    def __post_init__(self) -> None:
        check_fields(self)
        if not isinstance(self.factor, Mapping):
            not_negative(self, "factor")
        for name, factor in self.factors.items():
            if not np.isfinite(factor):
                raise ParameterError(name, "a finite number", factor)
        self._places()

    @property
    def factors(self) -> dict[str, float]:
        """Factors by name, that of all wings or one for each that has its own [1]."""
        if isinstance(self.factor, Mapping):
            return {f"added_mass.{wing}.factor": one for wing, one in self.factor.items()}
        return {"added_mass.factor": self.factor}

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of `parameters`."""
        return ("added_mass.density", *self.factors)

    @property
    def parameters(self) -> Array:
        """Values of the parameters, density [kg/m^3] and factors [1], (n_c,)."""
        return np.array([self.air.density, *self.factors.values()])

    @property
    def structure(self) -> str:
        """Text of what shapes the equations, numbers aside: part of a compiled function's key."""
        return " ".join(self.parameter_names)

    def _places(self) -> dict[str, int]:
        """Index of the factor of each wing in `parameters`."""
        wings = self.robot.wing_names
        if not isinstance(self.factor, Mapping):
            return dict.fromkeys(wings, 1)
        owner = wings_of("factor", self.factor, self.robot)
        return {wing: 1 + [*self.factor].index(owner[wing]) for wing in wings}

    def describe(self) -> dict[str, Any]:
        """Description that makes the added mass again for a robot, as JSON-able values."""
        return {"air": self.air.describe(), "factor": self.factor}

    def inertia(self, robot: Robot, wind: ca.SX, parameters: ca.SX) -> BodyAddedMass:
        """Added mass of the bodies.

        Args:
            robot: The model's robot, its numbers floats or symbols.
            wind: Velocity of the air, world axes, (3,) or (3, n_strips) [m/s]; a body meets
                the mean of its strips', weighted by what they carry.
            parameters: Density [kg/m^3] and factors, (n_c,).
        """
        matrices: dict[int, ca.SX] = {}
        for strip, mass, spin in self._carried(robot, parameters):
            _, normal, span = strip_axes(strip)
            moving = ca.vertcat(normal, ca.cross(_mid_chord(strip), normal))
            turning = ca.vertcat(ca.SX.zeros(3, 1), span)
            added = mass * (moving @ moving.T) + spin * (turning @ turning.T)
            matrices[strip.body] = matrices.get(strip.body, ca.SX(6, 6)) + added
        about = wind if wind.shape[1] == 1 else _about_bodies(robot, wind)
        return BodyAddedMass({k: ca.densify(m) for k, m in matrices.items()}, about)

    def gust_force(self, robot: Robot, q: ca.SX, rate: ca.SX, parameters: ca.SX) -> ca.SX:
        """Push of a gust that changes on the air carried along, generalized, (n, 1) [N, N m].

        m times the rate along the normal, at mid-chord of each strip.

        Args:
            robot: The model's robot, its numbers floats or symbols.
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            rate: Of the wind at each strip, world axes, (3, n_strips) [m/s^2].
            parameters: Density [kg/m^3] and factors, (n_c,).
        """
        poses = body_poses(robot, q)
        wrenches: dict[int, tuple[ca.SX, ca.SX]] = {}
        for i, (strip, mass, _) in enumerate(self._carried(robot, parameters)):
            normal = vector(strip.normal)
            local = poses[strip.body].rotation.T @ rate[:, i]
            force = normal * (mass * ca.dot(normal, local))
            add_wrench(wrenches, strip.body, force, ca.cross(_mid_chord(strip), force))
        return generalized_force(robot, q, wrenches)

    def circulation_force(
        self, robot: Robot, q: ca.SX, v: ca.SX, wind: ca.SX, parameters: ca.SX
    ) -> ca.SX:
        """Generalized force that circulation takes back of the ideal flow's, (n, 1) [N, N m].

        Args:
            robot: The model's robot, its numbers floats or symbols.
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
            wind: Velocity of the air, world axes, (3,) or (3, n_strips) [m/s].
            parameters: Density [kg/m^3] and factors, (n_c,).
        """
        wrenches: dict[int, tuple[ca.SX, ca.SX]] = {}
        carried = self._carried(robot, parameters)
        motions = strip_motions(robot, q, v, wind)
        for motion, (strip, mass, _) in zip(motions, carried, strict=True):
            forward, normal, span = strip_axes(strip)
            ahead, wash = lift_place(motion), normalwash(motion)
            flow = section_flow(motion.forward, motion.normal_ahead(ahead))
            sine, cosine = flow.normal / flow.speed, flow.forward / flow.speed
            lost = sine * (1.0 - held_share(flow))
            force = forward * (1.0 - lost * sine) + normal * (lost * cosine)
            force = force * (mass * motion.pitch_rate * wash)
            # nose down: the span points left of a wing that flies forward
            moment = span * (mass * motion.forward * wash)
            moment = moment + ca.cross(vector(strip.quarter_chord) + forward * ahead, force)
            add_wrench(wrenches, strip.body, force, moment)
        return generalized_force(robot, q, wrenches)

    def _carried(self, robot: Robot, parameters: ca.SX) -> list[tuple[Strip, ca.SX, ca.SX]]:
        """Strips, with mass [kg] and moment of inertia about the span [kg m^2] of their air."""
        places = self._places()
        densities = (parameters[0] * parameters[places[strip.wing]] for strip in robot.strips)
        pairs = zip(robot.strips, densities, strict=True)
        return [(strip, *_carried(strip, density)) for strip, density in pairs]

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Generalized inertia of the air carried along, (n, n) [kg, kg m, kg m^2].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].

        Raises:
            ShapeError: If q is not (n_q,).
        """
        matrix = self._called("added_mass_matrix", q=q)
        return np.asarray(matrix, float).reshape(self.robot.dof, self.robot.dof)

    def generalized_force(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, wind: ArrayLike | None = None
    ) -> Array:
        """Kirchhoff's force of the air carried along on the robot, (n,) [N, N m].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
            a: Generalized accelerations, (n,) [m/s^2, rad/s^2].
            wind: Velocity of the air, world axes, (3,) [m/s]; that of `air` at t = 0 by default.

        Raises:
            ShapeError: If an argument has another shape.
        """
        return self._force("added_mass_force", wind, q=q, v=v, a=a)

    def circulatory_force(self, q: ArrayLike, v: ArrayLike, wind: ArrayLike | None = None) -> Array:
        """Force that circulation takes back, (n,) [N, N m]; arguments of `generalized_force`."""
        return self._force("circulation_force", wind, q=q, v=v)

    def _force(self, name: str, wind: ArrayLike | None, **arguments: ArrayLike) -> Array:
        given = self.air.wind_at([0.0])[0] if wind is None else wind
        return np.atleast_1d(np.asarray(self._called(name, given, **arguments), float))

    def _called(self, name: str, *more: ArrayLike, **arguments: ArrayLike) -> Any:
        sizes = dict.fromkeys(arguments, self.robot.dof) | {"q": self.robot.coordinate_count}
        found = [real_array(name, value, (sizes[name],)) for name, value in arguments.items()]
        self.robot.check_attitudes(found[0])
        return self._functions[name](*found, *more, self.robot.parameters, self.parameters)

    def __getstate__(self) -> dict[str, Any]:
        return {name: one for name, one in vars(self).items() if name != "_functions"}

    @cached_property
    def _functions(self) -> dict[str, NativeFunction]:
        key, label = f"{self.structure} {self.robot.structure}", f"added mass of {self.robot.name}"
        return load_functions(key, lambda: added_mass_functions(self), label=label)


def added_mass_functions(model: AddedMass) -> list[ca.Function]:
    """CasADi functions added_mass_matrix, added_mass_force and circulation_force."""
    robot, robot_parameters = model.robot.symbolic()
    q = ca.SX.sym("q", robot.coordinate_count)
    v, a = ca.SX.sym("v", robot.dof), ca.SX.sym("a", robot.dof)
    wind, parameters = ca.SX.sym("wind", 3), ca.SX.sym("c", len(model.parameters))
    added = model.inertia(robot, wind, parameters)
    force = kirchhoff_force(robot, q, v, a, added)
    matrix = ca.densify(-ca.jacobian(force, a))
    taken = model.circulation_force(robot, q, v, wind, parameters)
    constants = {"robot_parameters": robot_parameters, "aero_parameters": parameters}
    inputs = {"q": q, "v": v, "a": a, "wind": wind, **constants}
    results = (
        ("added_mass_matrix", ["q", *constants], "D", matrix),
        ("added_mass_force", [*inputs], "f", force),
        ("circulation_force", ["q", "v", "wind", *constants], "f", taken),
    )
    return [
        named_function(name, {key: inputs[key] for key in keys}, {letter: value})
        for name, keys, letter, value in results
    ]


def added_mass_from_description(robot: Robot, description: Mapping[str, Any]) -> AddedMass:
    """The added mass of `AddedMass.describe()`, for a robot.

    Raises:
        ParameterError: If a key is missing or unknown.
    """
    check_keys("added mass", description, ("air", "factor"))
    return AddedMass(robot, air_from_description(description["air"]), factor=description["factor"])


def _carried(strip: Strip, density: Any) -> tuple[Any, Any]:
    """Mass [kg] and moment of inertia about the span [kg m^2] of a strip's air."""
    square = strip.chord * strip.chord / 4
    mass = density * pi * square * strip.width
    return mass, mass * square / 8


def _about_bodies(robot: Robot, wind: ca.SX) -> ca.SX:
    """Mean wind of each body's strips, weighted by what they carry, (3, n_bodies) [m/s]."""
    columns = [ca.SX.zeros(3, 1) for _ in robot.bodies]
    weights = [ca.SX(0)] * len(robot.bodies)
    for i, strip in enumerate(robot.strips):
        weight, _ = _carried(strip, 1.0)
        columns[strip.body] = columns[strip.body] + weight * wind[:, i]
        weights[strip.body] = weights[strip.body] + weight
    carrying = {strip.body for strip in robot.strips}
    return ca.horzcat(*[c / weights[k] if k in carrying else c for k, c in enumerate(columns)])


def _mid_chord(strip: Strip) -> ca.SX:
    return vector(strip.quarter_chord) - vector(strip.forward) * (strip.chord / 4)
