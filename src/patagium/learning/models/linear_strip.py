"""Forces of strips and bodies that are linear in the weights: physics first, then corrections.

The physics is that of `aerodynamics.linear_strips`; the prior says what is expected of each term,
and how far it may be from that. Flow that was never seen is predicted by the physics as far as it
was confirmed, flow that was seen by what was measured. The priors were chosen on flights in foreign
air (docs/foreign.md). Where flow is attached, the memory of the network follows one lag a strip.
Neglected: what the physics neglects, and gusts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Self

import casadi as ca
import numpy as np

from patagium.aerodynamics.added_mass import AddedMass
from patagium.aerodynamics.air import Air
from patagium.aerodynamics.linear_strips import (
    CORRECTIONS,
    NOTHING,
    OUTPUTS,
    LinearStrips,
    StripSums,
    surfaces_of,
    terms_of,
)
from patagium.arguments import checked
from patagium.arrays import Array, real_array
from patagium.dynamics.chain import vector
from patagium.dynamics.kinematics import add_wrench, generalized_force
from patagium.errors import ParameterError
from patagium.learning.models.memory import LagEquations, compiled_steps, row_size
from patagium.learning.models.network import Encoding, FlightTerms
from patagium.learning.models.perceptron import Perceptron
from patagium.learning.models.strip_lags import StripLags, lag_functions
from patagium.learning.models.wing import WingNetwork, measured_names
from patagium.learning.settings import Misfit
from patagium.native import load_functions, named_function
from patagium.robot.model import Robot
from patagium.robot.planform import sides_of
from patagium.robot.strip_chains import strip_chains

STDS, ATTACHED_STDS = (0.03, 0.2), (0.1, 0.05)
"""Prior of the corrections, `CORRECTIONS` of each kind, and where flow is attached [1]."""
_POLYNOMIALS = sum(CORRECTIONS)
_TERMS = "of the whole velocity, mirrored", "with side edges, mirrored"
"""Meaning of the weights in files, where flow may separate and where it is attached."""


class LinearStripNetwork(WingNetwork):
    """Force of the air as a sum of physical terms and corrections, linear in the weights.

    x is [q, v, a], y the generalized force of the air, added mass included; in attached flow x as
    the learner sees it goes on with the lags, which its memory finds. The corrections are those of
    `LinearStrips`, the physical terms in `terms`.

    Taught by `ExtendedLearner` it is learned exactly: recursive least squares with a prior, as
    long as the covariance is "full". Where no noise is stated, the filter takes the network's
    error as `Misfit` says.

    Args:
        robot: The machine; its numbers are taken as they are.
        air: Density and steady wind; gusts are not known to the network.
        measured: Coordinates whose force y is; None: all.
        attached: Whether flow is expected to stay attached: a lifting line takes the place of blade
            elements, and corrections are expected to be small.

    Attributes:
        terms: Physical terms, whose weights follow the corrections.
        measured: Names of the coordinates whose force y is.
        surfaces: Kinds of wings that may; none where all are of one kind.
        attached: Whether flow is expected to stay attached.
        per_newton: Root of the sum of squares of each output for one newton on each strip, along
            each axis, joints at rest, (n_y,) [1, m].
        output_scale: The same with one newton a quarter chord behind besides, 1 where it is 0:
            outputs of unlike units are compared in it.
        levers: Square of each output over that of each strip's force, (n_y, strips) [1, m^2], and
            of each strip's force over that of each joint that it moves, or else of the upward
            force, (n_y, strips) [1, 1/m^2].
        scaled_prior: True: a stated `prior_std` is a factor on `own_prior`.
        own_misfit: Error of this network that a filter assumes where no noise is stated.
        flight_terms: Accelerations among the inputs, added mass in the outputs.

    Raises:
        ParameterError: If the robot has no strips, or a name is unknown or there twice.

    References:
        Dickinson, Lehmann & Sane (1999), Science 284 (blade elements); Theodorsen (1935), NACA
        TR 496 (added mass, attached lift); Izraelevitz, Zhu & Triantafyllou (2017), AIAA Journal
        55 (lifting line); Polhamus (1966), NASA TN D-3767 (lift of separated flow); Sane &
        Dickinson (2002), J. Exp. Biol. 205 (pitching); Andersen, Pesavento & Wang (2005), J. Fluid
        Mech. 541 (sections that turn); Hoerner (1965), Fluid-Dynamic Drag (separated flow, bodies).
    """

    kind = "linear_strip"
    shared = ("air",)
    options = ("measured", "attached")
    scaled_prior = True
    one_by_one = True
    own_misfit = Misfit()
    flight_terms = FlightTerms(acceleration=True, added_mass=True)

    @checked
    def __init__(
        self,
        robot: Robot,
        air: Air | None = None,
        measured: Sequence[str] | None = None,
        attached: bool = False,
    ) -> None:
        self._fly(robot, air)
        self._names = self.measured = measured_names(robot, measured)
        rows = [robot.index(name) for name in self._names]
        self.surfaces = surfaces_of(robot)
        self.attached = attached
        self.terms = terms_of(robot, attached)
        slots = _slots(len(self.terms))
        self.items = len(robot.strips) + slots
        self.perceptron = Perceptron((_POLYNOMIALS + slots, OUTPUTS))
        self.offset = np.zeros(len(self._names))
        squares = strip_squares(robot)[rows]
        self.per_newton = np.sqrt(squares[..., :3].sum(axis=(1, 2)))
        squares = squares.sum(axis=2)
        self.levers = _levers(robot, rows, squares)
        self.output_scale = np.sqrt(squares.sum(axis=1))
        self.output_scale[self.output_scale == 0] = 1.0
        self._parameters = np.array([*self.air.wind, self.air.density, *robot.parameters])
        sides = *sides_of(robot), strip_chains(robot) if attached else ""
        made = load_functions(
            f"linear strip network {self._names} {self.surfaces} {sides} {robot.structure}",
            lambda: _functions(robot, rows, attached),
            label=f"air of {robot.name}",
        )
        self._encode = made["encode"]
        self.lag_equations: LagEquations | None = None
        if attached:
            steps = compiled_steps(made["begin"].address, made["step"].address, self._parameters)
            sizes = self.measured_inputs, len(robot.strips)
            self.lag_equations = StripLags(made, self._parameters, *sizes, steps)

    def describe(self) -> dict[str, Any]:
        """Description of the network that rebuilds it, as JSON-able values."""
        return super().describe() | {"terms": _TERMS[self.attached]}

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> Self:
        """Inverse of `describe`.

        Raises:
            ParameterError: If a key is missing or unknown, or the terms were others then.
        """
        values = dict(description)
        found, known = values.pop("terms", None), _TERMS[bool(values.get("attached"))]
        if found != known:
            expected = f"{known}; weights of other terms mean other forces: learn the log anew"
            raise ParameterError("terms of the network", expected, found)
        return super().from_description(values)

    @property
    def inputs(self) -> int:
        """Number of inputs: of [q, v, a] and, in attached flow, of the lag states."""
        lags = self.lag_equations
        return self.measured_inputs + (0 if lags is None else row_size(lags))

    @property
    def measured_inputs(self) -> int:
        """Length of [q, v, a]."""
        return self.robot.state_size + self.robot.dof

    @property
    def own_prior(self) -> Array:
        """Standard deviation of each weight before any sample, (n,) [1]."""
        return self.prior(ATTACHED_STDS if self.attached else STDS)

    def prior(self, corrections: tuple[float, float]) -> Array:
        """Standard deviation of each weight before any sample, (n,) [1].

        Args:
            corrections: That of corrections by spanwise flow, and by the direction of flow [1].
        """
        stds = np.repeat(corrections, CORRECTIONS)
        return self._placed(stds, [term.std for term in self.terms], NOTHING)

    def initial(self, seed: int) -> Array:
        """Weights that are expected, those of physics alone, whatever the seed, (n,)."""
        return self.physics()

    def physics(self, added_mass: bool = True) -> Array:
        """Weights of physics alone, with the added mass or without, (n,) [1]."""
        means = [term.mean for term in self.terms]
        means[1:3] = [float(added_mass)] * 2
        return self._placed(np.zeros(_POLYNOMIALS), means, 0.0)

    def air_at(self, weights: Array) -> tuple[LinearStrips, AddedMass]:
        """Model of the air and added mass with what was learned, to fly with.

        The two together are the force of the network, which knows no ground.

        Args:
            weights: Weights, (n,) [1].

        Raises:
            ParameterError: If a weight is not finite.
            ShapeError: If there are more weights than the network has, or fewer.
        """
        corrections, terms = self.split(ca.DM(real_array("weights", weights, (self.size,))))
        named = zip((term.name for term in self.terms), terms.full()[:, 0].tolist(), strict=True)
        coefficients = corrections.full().ravel()
        free = replace(self.air, ground=None)
        air = LinearStrips(self.robot, free, dict(named), coefficients, self.attached)
        return air, air.added_mass

    def split(self, weights: Any) -> tuple[Any, Any]:
        """Coefficients of the corrections, (4, 17), and weights of the terms, (n,), in CasADi."""
        matrix = ca.reshape(weights[:-OUTPUTS], -1, OUTPUTS).T
        return matrix[:, :_POLYNOMIALS], ca.vec(matrix[:, _POLYNOMIALS:])[: len(self.terms)]

    def slopes(self, encoding: Encoding) -> Array:
        """Derivative of the outputs of many samples for the weights, the same for all weights.

        Args:
            encoding: Of N samples.

        Returns:
            (N, n_y, n) [unit of y]; times the weights it is the outputs.
        """
        count, items, _ = encoding.features.shape
        readout = encoding.readout.reshape(count, self.outputs, items, OUTPUTS)
        rows = readout.swapaxes(2, 3).reshape(count, -1, items)
        flat = (rows @ encoding.features).reshape(count, self.outputs, -1)
        return np.concatenate([flat, readout.sum(axis=2)], axis=2)

    def _placed(self, corrections: Array, terms: Sequence[float], others: float) -> Array:
        """Numbers of the corrections, of the terms and of what stands for nothing, (n,)."""
        inputs, _ = self.perceptron.widths
        matrix = np.zeros((OUTPUTS, inputs))
        matrix[:, :_POLYNOMIALS] = corrections
        slots = np.full((inputs - _POLYNOMIALS) * OUTPUTS, others)
        slots[: len(terms)] = terms
        matrix[:, _POLYNOMIALS:] = slots.reshape(-1, OUTPUTS).T
        return np.concatenate([matrix.ravel(), np.full(OUTPUTS, others)])


def strip_forces(network: LinearStripNetwork, x: Array, weights: Array) -> Array:
    """Force of each strip, world axes, (N, m, 3) [N]: blade elements, terms and corrections.

    Neglected: the added mass and its circulation, which are of a wing and not of its strips.

    Args:
        network: The network.
        x: Inputs, (N, n_x) [units of x].
        weights: Weights, (n,) [1].
    """
    robot, air = network.robot, network.air
    machine, robot_parameters = robot.symbolic()
    given = _Inputs(robot, machine, network.attached)
    known = ca.SX.sym("w", network.size)
    corrections, terms = network.split(known)
    forces = given.sums.strip_forces(given.sums.loads(corrections, terms), terms)
    inputs = [given.x, given.wind, given.density, robot_parameters, known]
    function = ca.Function("strip_forces", inputs, [forces])
    numbers = air.wind, air.density, robot.parameters, weights
    return np.array([function(sample, *numbers).full().T for sample in x])


class _Inputs:
    """Symbols of a sample, and its sums.

    Attributes:
        measured: State and accelerations [q, v, a].
        x: What the network sees, [q, v, a] and lags, (n_x,).
        wind: Wind, world axes, (3,) [m/s].
        density: Of the air [kg/m^3].
        sums: Terms and corrections.
    """

    def __init__(self, machine: Robot, robot: Robot, attached: bool) -> None:
        n_q, dof = robot.coordinate_count, robot.dof
        self.measured = ca.SX.sym("x", robot.state_size + dof)
        motion = ca.vertsplit(self.measured, [0, n_q, n_q + dof, n_q + 2 * dof])
        self.wind, self.density = ca.SX.sym("wind", 3), ca.SX.sym("rho")
        self.sums = StripSums(machine, robot, motion, self.wind, self.density, attached)
        line = self.sums.line
        self.x = self.measured if line is None else ca.vertcat(self.measured, line.state)


def _functions(machine: Robot, rows: Sequence[int], attached: bool) -> list[ca.Function]:
    """Encoder: polynomials of each strip, then one row a slot; forces of unit outputs.

    Behind it, where flow is attached, begin and step of the lags.
    """
    robot, robot_parameters = machine.symbolic()
    given = _Inputs(machine, robot, attached)
    seen, units, terms = given.sums.parts(list(rows))
    slots = _slots(terms.shape[1])
    rest = ca.SX.zeros(len(rows), OUTPUTS * slots - terms.shape[1])
    ones = ca.vertcat(ca.SX.zeros(_POLYNOMIALS, slots), ca.SX.eye(slots))
    wide = [ca.vertcat(one, ca.SX.zeros(slots, 1)) for one in seen]
    features = ca.densify(ca.horzcat(*wide, ones))
    readout = ca.densify(ca.horzcat(*units, terms, rest))
    parameters = ca.vertcat(given.wind, given.density, robot_parameters)
    known = {"x": given.x, "network_parameters": parameters}
    encode = named_function("encode", known, {"features": features, "readout": readout})
    if given.sums.line is None:
        return [encode]
    return [encode, *lag_functions(given.sums.line, given.measured, parameters)]


def strip_squares(robot: Robot) -> Array:
    """Squares of generalized forces of one newton on a strip, (n, strips, 4) [1, m^2].

    One newton along each axis, and its moment by a quarter of the chord; joints at rest.
    """
    wrenches: dict[int, tuple[ca.SX, ca.SX]] = {}
    forces = ca.SX.sym("forces", 4, len(robot.strips))
    for k, strip in enumerate(robot.strips):
        span = np.cross(strip.normal, strip.forward)
        moment = ca.cross(vector(strip.quarter_chord), forces[:3, k])
        moment += vector(span) * strip.chord / 4 * forces[3, k]
        add_wrench(wrenches, strip.body, forces[:3, k], moment)
    q = ca.SX(ca.DM(robot.coordinates(**robot.resting)))
    slope = ca.jacobian(generalized_force(robot, q, wrenches), ca.vec(forces))
    squares = ca.evalf(slope).full() ** 2
    return np.asarray(squares.reshape(len(squares), -1, 4))


def _levers(robot: Robot, rows: Sequence[int], squares: Array) -> tuple[Array, Array]:
    """Levers as `levers` tells them, of squares of the measured rows, (n_y, strips)."""
    moves = (squares > 0) & ~np.isin(rows, robot.floating_dofs)[:, None]
    upward = np.array([robot.dof_names[row] == "z" for row in rows], bool)
    moves |= upward[:, None] & ~moves.any(axis=0)
    whole = squares.sum(axis=1, keepdims=True)
    return squares, np.divide(moves, whole, out=np.zeros_like(squares), where=moves)


def _slots(terms: int) -> int:
    """Rows of outputs that the terms take."""
    return -(-terms // OUTPUTS)
