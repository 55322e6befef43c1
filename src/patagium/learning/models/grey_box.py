"""A grey box: model of the air whose numbers are the weights, learned as networks are.

Physics of `QuasiSteady`, `LiftingLine` or `DeLaurier`, numbers of it or of the robot unknown. The
lag states of the air are found at the numbers known by then, with their sensitivity to them
(recursive prediction error):

    y = Q(x, z; p) + circulation and force of the air carried along - changes of the robot's own
    inertia and damping, at numbers p of which some are learned.

Slopes are forward derivatives along one direction, by algorithmic differentiation. Neglected:
gusts (the wind is steady), noise of the lag states, flow between samples other than straight,
errors of measured states and accelerations.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any, Literal, NamedTuple, Self, get_args

import casadi as ca
import numpy as np

from patagium.aerodynamics.added_mass import AddedMass, added_mass_from_description
from patagium.aerodynamics.description import aero_from_description
from patagium.aerodynamics.indicial import Relaxation, lag_step
from patagium.aerodynamics.model import Aerodynamics, checked_air
from patagium.arguments import checked
from patagium.arrays import Array, Indices, real_array
from patagium.dynamics.equations import damping_force, inverse, kirchhoff_force
from patagium.errors import ParameterError, check_names
from patagium.learning.models.dense import described
from patagium.learning.models.linear_strip import strip_squares
from patagium.learning.models.memory import LagEquations, MemoryState, memory_in, row_size
from patagium.learning.models.network import Encoding, FlightTerms, Network
from patagium.learning.models.physical import (
    FACTOR,
    Estimate,
    changed_air,
    inertial,
    numbers_of,
    physical_parameters,
)
from patagium.learning.models.wing import measured_names
from patagium.native import NativeFunction, load_functions, named_function
from patagium.robot.files import load_robot_text

Start = Literal["steady", "still"]
_MOST_ROUNDS, _CLOSE = 20, 1e-11  # of Newton's method where a memory begins


class GreyBox(Network):
    """Force of the air with unknown numbers, y = Q(x, z; p(W)).

    x is [q, v], or [q, v, a] where y depends on accelerations: with added mass, or with an
    inertia of the robot among the unknowns. y is what `training_data` gives: with added mass
    what it gives `with_added_mass`, in any case with the robot's own numbers as they were.

    A weight counts prior deviations of its parameter, or of its logarithm if it cannot be zero
    or less (`PhysicalParameter`): all start at zero, with a deviation of one whatever a learner
    is given, and a process deviation of .01 is a hundredth of the prior's.

    Lags z follow the flow by `lag_step` from sample to sample; x as the learner sees it goes on
    with [z, vec dz/dW, W], which its memory finds.

    Args:
        model: The air around a robot, its numbers where they start.
        estimate: Prior standard deviation of each number to learn, by name, in its own unit:
            of the model (`parameter_names`), of its robot, `wind.x`, `added_mass.factor`.
        added_mass: The air carried along, in the same air, if y holds its force.
        measured: Coordinates whose force y is; None: all.
        start: Flow before the first sample and in gaps: as it was always there, or "still" as
            a simulated flight begins.

    Attributes:
        flight_terms: Whether x ends with the accelerations; whether y holds the force of added
            mass.
        measured_inputs: Length of [q, v] or [q, v, a].
        own_prior: Standard deviations before any sample, 1 of each parameter, (n,) [1].

    Raises:
        ParameterError: If a name is unknown or there twice, a deviation not positive, or the added
            mass does not go with the model.

    References:
        Ljung (1999), System Identification, chapter 11 (recursive prediction errors).
    """

    kind = "grey_box"

    @checked
    def __init__(
        self,
        model: Aerodynamics,
        estimate: Mapping[str, float],
        added_mass: AddedMass | None = None,
        *,
        measured: Sequence[str] | None = None,
        start: Start = "steady",
    ) -> None:
        if added_mass is not None and added_mass.air != model.air:
            raise ParameterError("added_mass.air", f"the air of model, {model.air}", added_mass.air)
        if start not in get_args(Start):
            raise ParameterError("start", '"steady" or "still"', start)
        if FACTOR in estimate and added_mass is None:
            raise ParameterError(FACTOR, "an added mass to go with it", None)
        if model.air.gust is not None:
            model, added_mass = changed_air(model, added_mass, ())
        robot = model.robot
        numbers = numbers_of(model, added_mass)
        self.model = model
        self.added_mass = added_mass
        self._start = start
        self.parameters = physical_parameters(estimate, numbers, robot)
        carries = added_mass is not None
        accelerates = carries or inertial([*estimate], robot)
        own = robot if {*estimate} & {*robot.parameter_names} else None
        self.flight_terms = FlightTerms(accelerates, carries, robot=own)
        self.measured_inputs = robot.state_size + robot.dof * accelerates
        self.own_prior = np.ones(self.size)
        self._names = measured_names(robot, measured)
        self._rows = tuple(robot.index(name) for name in self._names)
        weight = 9.81 * float(robot.mass)
        squares = strip_squares(robot)[list(self._rows), :, :3].sum(axis=(1, 2))
        self._scales = weight * np.sqrt(squares)[:, None]
        self._places = [*numbers]
        scales = [parameter.scale for parameter in self.parameters]
        self._numbers = np.array([*numbers.values(), *scales])
        self._functions = self._compiled()
        sizes = self.measured_inputs, model.state_size, self.size
        self._lags = GreyLags(self._functions, self._numbers, start == "steady", *sizes)

    def __reduce__(self) -> tuple[Any, ...]:
        arguments = self.model, self._estimate, self.added_mass
        return partial(GreyBox, *arguments, measured=self._names, start=self._start), ()

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    @property
    def size(self) -> int:
        """Number of parameters that are learned, n."""
        return len(self.parameters)

    @property
    def neurons(self) -> tuple[tuple[Indices, ...], ...]:
        """Indices of all weights as one group, since physical parameters belong to no neuron."""
        return ((np.arange(self.size),),)

    @property
    def fan_in(self) -> Array:
        """Number of inputs behind each weight, (n,): always 1."""
        return np.ones(self.size)

    @property
    def inputs(self) -> int:
        """Length of x, lag states included."""
        return self.measured_inputs + row_size(self._lags)

    @property
    def lag_equations(self) -> LagEquations | None:
        """Equations of the air's lags; None without."""
        return self._lags if self._lags.states else None

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the coordinates whose force is y."""
        return self._names

    @property
    def hidden(self) -> tuple[int, ...]:
        """No hidden layers."""
        return ()

    def initial(self, seed: int) -> Array:
        """Weights to start from, the parameters at their priors, (n,)."""
        return np.zeros(self.size)

    def encode(self, x: Array) -> Encoding:
        """Samples as they are, (N, 1, n_x), and the scales of the outputs as a readout."""
        readout = np.broadcast_to(self._scales, (len(x), *self._scales.shape))
        return Encoding(x[:, None, :], readout, np.zeros(self.outputs))

    def decode(self, encoding: Encoding, weights: Array) -> Array:
        """y of N encoded samples at weights (n,), (N, n_y)."""
        x = encoding.features[:, 0]
        return self._force(x, np.broadcast_to(weights, (len(x), self.size)))

    def values(self, encoding: Encoding, points: Array) -> Array:
        """y of one encoded sample at weights (p, n), (p, n_y)."""
        x = encoding.features[0]
        different, place = np.unique(points.astype(float), axis=0, return_inverse=True)
        return self._force(np.broadcast_to(x, (len(different), len(x))), different)[place.ravel()]

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (n_y,), and its derivative for weights (n,), (n_y, n)."""
        x = encoding.features[0]
        memory = self._memory_in(x[None])
        known = x[: self.measured_inputs], memory.at(weights[None])[0], weights
        moved = zip(memory.sensitivity[0].T, np.eye(self.size), strict=True)
        return _along(self._functions["force_forward"], known, moved, self._numbers)

    def estimates(self, weights: Array, variances: Array | None = None) -> tuple[Estimate, ...]:
        """The parameters, with standard deviations in their own units.

        Args:
            weights: Weights, (n,) [1].
            variances: Of the weights, (n,) [1], the diagonal of their covariance; None: not known.

        Raises:
            ParameterError: If a number is no real one, or a variance is below zero.
            ShapeError: If there are more weights or variances than parameters, or fewer.
        """
        weights = real_array("weights", weights, (self.size,))
        spread = np.full(self.size, np.nan) if variances is None else variances
        spread = real_array("variances", spread, (self.size,))
        if (spread < 0).any():
            raise ParameterError("variances", "zero or more", spread.min())
        each = zip(self.parameters, weights.tolist(), spread.tolist(), strict=True)
        return tuple(parameter.estimate(w, variance) for parameter, w, variance in each)

    @checked
    def stds(self, wandering: Mapping[str, float]) -> Array:
        """A learner's process deviation from those of parameters in their own units, (n,).

        Args:
            wandering: By which each parameter wanders between two updates, by name; others stay.

        Raises:
            ParameterError: If a name is not learned, or a number is below zero.
        """
        check_names("wandering", wandering, [one.name for one in self.parameters])
        if min(wandering.values(), default=0.0) < 0:
            raise ParameterError("wandering", "zero or more", dict(wandering))
        return np.array([wandering.get(one.name, 0.0) / one.std for one in self.parameters])

    def air_at(self, weights: Array) -> tuple[Aerodynamics, AddedMass | None]:
        """Model of the air and added mass with what was learned, to fly with.

        Args:
            weights: Weights, (n,) [1].

        Raises:
            ParameterError: If a parameter is no argument of the model.
            ShapeError: If there are more weights than parameters, or fewer.
        """
        return changed_air(self.model, self.added_mass, self.estimates(weights))

    def describe(self) -> dict[str, Any]:
        """Description of the network that rebuilds it, as JSON-able values."""
        return {
            "kind": self.kind,
            "robot": self.model.robot.source,
            "model": self.model.describe(),
            "estimate": self._estimate,
            "added_mass": None if self.added_mass is None else self.added_mass.describe(),
            "measured": list(self._names),
            "start": self._start,
        }

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> GreyBox:
        """Inverse of `describe`.

        Raises:
            ParameterError: If a key is missing or unknown.
            RobotFileError: If the text of the robot does not describe one.
        """
        keys = ("robot", "model", "estimate", "added_mass", "measured", "start")
        values = described(cls.kind, description, keys)
        robot = load_robot_text(values.pop("robot"))
        added = values.pop("added_mass")
        return cls(
            aero_from_description(robot, values.pop("model")),
            values.pop("estimate"),
            None if added is None else added_mass_from_description(robot, added),
            **values,
        )

    @property
    def _estimate(self) -> dict[str, float]:
        return {parameter.name: parameter.std for parameter in self.parameters}

    def _memory_in(self, x: Array) -> MemoryState:
        """Lags of the air, their sensitivity and W_m in the inputs, x (N, n_x)."""
        return memory_in(x[:, self.measured_inputs :], self._lags.states, self.size)

    def _force(self, x: Array, own: Array) -> Array:
        """y, (N, n_y), of x (N, n_x) at weights (N, n)."""
        state = self._memory_in(x).at(own)
        seen = x[:, : self.measured_inputs]
        y = self._functions["force"].batch(seen, state, own, self._numbers)
        return np.asarray(y).reshape(len(x), self.outputs)

    def _compiled(self) -> dict[str, NativeFunction]:
        """Functions by name.

        force (x, z, theta) -> y; force_forward (x, z, theta, dz, dtheta) -> y, dy; of models
        with memory step_forward (before, after, z, theta, dz, dtheta, step) -> z', dz' and
        follow_forward (x, z, theta, dz, dtheta) -> target, dtarget. Their last input are all
        numbers, then the scales of theta.
        """
        model = self.model
        added = None if self.added_mass is None else self.added_mass.structure
        options = f"{[*self._estimate]} {self._rows} {added}"
        kinds = [parameter.positive for parameter in self.parameters]
        key = f"grey box {options} {kinds} {model.key} {model.robot.structure}"
        return load_functions(key, self._expressions, label=f"grey box of {model.robot.name}")

    def _expressions(self) -> list[ca.Function]:
        """CasADi functions that `_compiled` compiles."""
        n_z, count, whole = self.model.state_size, self.size, len(self._places)
        x = ca.SX.sym("x", self.measured_inputs)
        z = ca.SX.sym("z", n_z)
        theta = ca.SX.sym("theta", count)
        numbers = ca.SX.sym("numbers", whole + count)
        physics = self._physics()
        actual = self._actual(theta, numbers)

        def air(x: ca.SX, z: ca.SX) -> tuple[ca.SX, Relaxation]:
            y, rate, target = physics.call([x, z, actual, numbers[:whole]], True, False)
            return y, Relaxation(rate, target)

        dz = ca.SX.sym("dz", n_z)
        dtheta = ca.SX.sym("dtheta", count)

        def along(value: ca.SX) -> ca.SX:
            slope = ca.jtimes(value, ca.vertcat(z, theta), ca.vertcat(dz, dtheta))
            return ca.densify(slope)

        y, memory = air(x, z)
        known = {"x": x, "z": z, "theta": theta}
        moved, given = {"dz": dz, "dtheta": dtheta}, {"grey_parameters": numbers}
        found = [
            named_function("force", known | given, {"y": y}),
            named_function("force_forward", known | moved | given, {"y": y, "dy": along(y)}),
        ]
        if not n_z:
            return found
        target = memory.target
        follow = {"target": target, "dtarget": along(target)}
        after = ca.SX.sym("after", self.measured_inputs)
        step = ca.SX.sym("step")
        _, later = air(after, lag_step(z, step, memory, memory))
        reached = lag_step(z, step, memory, later)
        inputs = {"before": x, "after": after, "z": z, "theta": theta, **moved, "step": step}
        advanced = {"reached": reached, "dreached": along(reached)}
        return [
            *found,
            named_function("follow_forward", known | moved | given, follow),
            named_function("step_forward", inputs | given, advanced),
        ]

    def _actual(self, theta: ca.SX, numbers: ca.SX) -> ca.SX:
        """All numbers, those that are learned as theta says."""
        whole = len(self._places)
        actual = ca.SX(numbers[:whole])
        for k, parameter in enumerate(self.parameters):
            place = self._places.index(parameter.name)
            start, moved = actual[place], theta[k] * numbers[whole + k]
            actual[place] = start * ca.exp(moved) if parameter.positive else start + moved
        return actual

    def _physics(self) -> ca.Function:
        """(x, z, numbers, numbers as they were before) -> y, rate and target of the memory."""
        model, robot = self.model, self.model.robot
        n = robot.dof
        n_q = robot.coordinate_count
        machine, symbols = robot.symbolic()
        before, symbols_before = robot.symbolic()
        of_air = ca.SX.sym("c", len(model.parameter_names))
        wind = ca.SX.sym("wind", 3)
        carries = () if self.added_mass is None else self.added_mass.factors
        factors = ca.SX.sym("factors", len(carries))
        x = ca.SX.sym("x", self.measured_inputs)
        z = ca.SX.sym("z", model.state_size)
        q, v, a = x[:n_q], x[n_q : n_q + n], x[n_q + n :]
        air = checked_air(model, machine, model.expressions(machine, q, v, z, wind, of_air))
        y = air.generalized_force
        if self.added_mass is not None:
            density = of_air[model.parameter_names.index("density")]
            carried = ca.vertcat(density, factors)
            y = y + self.added_mass.circulation_force(machine, q, v, wind, carried)
            added = self.added_mass.inertia(machine, wind, carried)
            y = y + kirchhoff_force(machine, q, v, a, added)
        if inertial([*self._estimate], robot):
            y = y - (inverse(machine, q, v, a) - inverse(before, q, v, a))
        y = y + damping_force(machine, v) - damping_force(before, v)
        memory = air.memory or Relaxation(ca.SX(0, 1), ca.SX(0, 1))
        if memory.rate.numel() != model.state_size:
            raise ParameterError("model", "one whose memory follows something", model.name)
        numbers = ca.vertcat(symbols, of_air, wind, factors)
        others = ca.SX.sym("others", len(self._places) - len(robot.parameter_names))
        known = ca.vertcat(symbols_before, others)
        results = [y[list(self._rows)], memory.rate, memory.target]
        return ca.Function("physics", [x, z, numbers, known], list(map(ca.densify, results)))


class GreyLags(NamedTuple):
    """Equations of the lags of the air, by the exponential trapezoid of `lag_step`.

    Attributes:
        functions: Those of `GreyBox`.
        numbers: All numbers, then the scales of the weights.
        steady: Whether memory begins with a flow that was always there; else at zero.
        measured: Length of [q, v] or [q, v, a].
        states: Number of lags z, n_z.
        parameters: Number of weights that the lags depend on, n_w.
    """

    functions: Mapping[str, NativeFunction]
    numbers: Array
    steady: bool
    measured: int
    states: int
    parameters: int

    @property
    def carried(self) -> tuple[int, int]:
        """Number of lags, and of measured inputs."""
        return self.states, self.measured

    @property
    def compiled(self) -> None:
        """None: slopes are found direction by direction."""

    def begin(self, x: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Lags where a memory begins."""
        state = np.zeros(self.states)
        own = weights[: self.parameters]
        if not self.steady:
            return state, np.zeros((self.states, self.parameters)), x
        eye = np.eye(self.states)
        for _ in range(_MOST_ROUNDS):  # Newton's method; of attached flow one round is enough
            target, by_state = self._followed(x, state, own, of_state=True)
            apart = target - state
            if np.abs(apart).max() <= _CLOSE * (1.0 + np.abs(state).max()):
                break
            state = state + np.linalg.solve(eye - by_state, apart)
        _, by_weights = self._followed(x, state, own, of_state=False)
        return state, np.asarray(np.linalg.solve(eye - by_state, by_weights)), x

    def step(
        self, x: Array, weights: Array, time_step: float, before: MemoryState
    ) -> tuple[Array, Array, Array]:
        """Lags a step later."""
        known = before.driver, x, before.state, weights[: self.parameters]
        moved = zip(before.sensitivity.T, np.eye(self.parameters), strict=True)
        function = self.functions["step_forward"]
        return *_along(function, known, moved, time_step, self.numbers), x

    def _followed(
        self, sample: Array, state: Array, weights: Array, of_state: bool
    ) -> tuple[Array, Array]:
        """Lags that the state follows, and their slopes for the state, or for the weights."""
        every = np.split(np.eye(self.states + self.parameters), [self.states])
        moved = (np.split(one, [self.states]) for one in every[0 if of_state else 1])
        known = sample, state, weights
        return _along(self.functions["follow_forward"], known, moved, self.numbers)


def _along(
    function: NativeFunction,
    known: Sequence[Array],
    moved: Iterable[Sequence[Array]],
    *others: Array | float,
) -> tuple[Array, Array]:
    """Value of a function, (m,), and its slopes along directions of z and theta, a column each."""
    found = [function(*known, *directions, *others) for directions in moved]
    slopes = np.column_stack([np.atleast_1d(slope) for _, slope in found])
    return np.atleast_1d(found[-1][0]), slopes
