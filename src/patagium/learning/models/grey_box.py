"""A model of the air whose numbers are the weights: grey box, learned as networks are.

Physics of `QuasiSteady`, `LiftingLine` or `DeLaurier`, numbers of it or of the robot unknown;
beside it a network may learn what is left. The memory of the air is recalled at the numbers
known by then, with its slopes for them (recursive prediction error). Neglected: gusts, noise of
the memory itself, errors of measured states and accelerations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics.added_mass import AddedMass, added_mass_from_description
from patagium.aerodynamics.description import aero_from_description
from patagium.aerodynamics.model import Aerodynamics
from patagium.errors import ParameterError, ShapeError
from patagium.learning.models.dense import described
from patagium.learning.models.grey_equations import GreyEquations
from patagium.learning.models.grey_memory import GreyMemory
from patagium.learning.models.network import (
    Carried,
    Encoding,
    Memory,
    Network,
    network_from_description,
)
from patagium.learning.models.physical import (
    FACTOR,
    Estimate,
    changed_air,
    numbers_of,
    physical_parameters,
    process_stds,
)
from patagium.learning.models.structure import Indices

Array = NDArray[np.float64]
Start = Literal["steady", "still"]


class _Kept(NamedTuple):
    """What is carried: the memory of the air, and whatever the network beside it carries."""

    memory: Memory | None
    beside: Carried


class GreyBox(Network):
    """Force of the air with unknown numbers, y = Q(x, z; p(W)) + network beside it.

    x is [q, v], or [q, v, a] where y depends on accelerations: with added mass, or with an
    inertia of the robot among the unknowns. y is what `training_data` gives: with added mass
    what it gives `with_added_mass`, in any case with the robot's own numbers as they were.

    A weight counts prior deviations of its parameter, or of its logarithm if it cannot be zero
    or less (`PhysicalParameter`): all start at zero, with a deviation of one whatever a learner
    is told, and a process deviation of .01 is a hundredth of the prior's. A learner's
    `prior_std` is that of the network beside, whose last layer starts at zero.

    Lags z follow the flow by `wash.lag_step` from sample to sample; x as the learner sees it
    goes on with [z, vec dz/dW, W], which `recall` finds.

    Args:
        model: The air around a robot, its numbers where they start.
        estimate: Prior standard deviation of each number to learn, by name, in its own unit:
            of the model (`parameter_names`), of its robot, `wind.x`, `added_mass.factor`.
        added_mass: The air carried along, in the same air, if y holds its force.
        beside: A network of the same force, learned with the numbers; its x is that of the
            grey box without what that remembers, or the first part of it.
        measured: Coordinates whose force y is; None: all.
        start: Flow before the first sample and in gaps: as it was always there, or "still" as
            a simulated flight begins.

    Raises:
        ParameterError: If a name is unknown, a deviation not positive, or what is beside does
            not go with the model.
        ShapeError: If the network beside sees more than there is.

    References:
        Ljung (1999), System Identification, chapter 11 (recursive prediction errors).
    """

    kind = "grey_box"

    def __init__(
        self,
        model: Aerodynamics,
        estimate: Mapping[str, float],
        added_mass: AddedMass | None = None,
        beside: Network | None = None,
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
        robot, numbers = model.robot, numbers_of(model, added_mass)
        self.model, self.added_mass, self.beside, self._start = model, added_mass, beside, start
        self.parameters = physical_parameters(estimate, numbers, robot)
        self._names = robot.dof_names if measured is None else tuple(measured)
        outputs = tuple(robot.index(name) for name in self._names)
        self.equations = GreyEquations(model, added_mass, self.parameters, outputs)
        scales = [parameter.scale for parameter in self.parameters]
        self._numbers = np.array([*numbers.values(), *scales])
        self._check_beside()
        self._functions = self.equations.compiled()

    def __reduce__(self) -> tuple[Any, ...]:
        options = {"measured": self._names, "start": self._start}
        arguments = (self.model, self._estimate, self.added_mass, self.beside)
        return _again, (type(self), arguments, options)

    @property
    def inputs(self) -> int:
        """Length of x, what is remembered included."""
        return self.measured_inputs + self._memory.size + self._remembered_beside

    @property
    def measured_inputs(self) -> int:
        """Length of [q, v] or [q, v, a]."""
        return self.equations.measured_inputs

    @property
    def needs_acceleration(self) -> bool:
        """Whether what is measured of x ends with the accelerations."""
        return self.equations.needs_acceleration

    @property
    def explains_added_mass(self) -> bool:
        """Whether y holds the force of the air carried along."""
        return self.equations.explains_added_mass

    @property
    def output_names(self) -> tuple[str, ...]:
        """Coordinates whose force y is."""
        return self._names

    @property
    def size(self) -> int:
        """How many weights, n; those of physical parameters come first."""
        return self._count + (0 if self.beside is None else self.beside.size)

    @property
    def neurons(self) -> list[list[Indices]]:
        """The parameters as one neuron of a layer of their own, then those beside."""
        beside = [] if self.beside is None else self.beside.neurons
        others = [[block + self._count for block in layer] for layer in beside]
        return [[np.arange(self._count)], *others]

    @property
    def hidden(self) -> tuple[int, ...]:
        """Neurons of each hidden layer of the network beside."""
        return () if self.beside is None else self.beside.hidden

    @property
    def fan_in(self) -> Array:
        """How many inputs the neuron of each weight sums, 1 for a parameter, (n,)."""
        beside = np.zeros(0) if self.beside is None else self.beside.fan_in
        return np.concatenate([np.ones(self._count), beside])

    @property
    def own_prior(self) -> Array:
        """Deviations before any sample: 1 of each parameter, nan beside, (n,)."""
        return np.where(np.arange(self.size) < self._count, 1.0, np.nan)

    def initial(self, seed: int) -> Array:
        """Weights to start from: the parameters at their priors, beside nothing yet, (n,).

        Args:
            seed: Seed of the draw.
        """
        weights = np.zeros(self.size)
        if self.beside is not None:
            drawn = self.beside.initial(seed)
            for neuron in self.beside.neurons[-1]:
                drawn[neuron] = 0.0
            weights[self._count :] = drawn
        return weights

    def encode(self, x: Array) -> Encoding:
        """The samples as they are, (N, 1, n_x); see `encode_one`."""
        readout = np.ones((len(x), self.outputs, 1))
        if self.beside is not None:
            readout = self.beside.encode(self._seen_beside(x)).readout
        return Encoding(x[:, None, :], readout, np.zeros(self.outputs))

    def encode_one(self, x: Array) -> Encoding:
        """The same of one sample: noise that is estimated grows with the readout beside."""
        readout = np.ones((self.outputs, 1))
        if self.beside is not None:
            readout = self.beside.encode_one(self._seen_beside(x)).readout
        return Encoding(x[None], readout, np.zeros(self.outputs))

    def decode(self, encoding: Encoding, weights: Array) -> Array:
        """y of samples encoded before, (N, n_y).

        Args:
            encoding: Of N samples.
            weights: (n,).
        """
        x = encoding.features[:, 0]
        y = self._force(x, np.broadcast_to(weights[: self._count], (len(x), self._count)))
        if self.beside is not None:
            seen = self.beside.encode(self._seen_beside(x))
            y = y + self.beside.decode(seen, weights[self._count :])
        return y

    def values(self, encoding: Encoding, points: Array) -> Array:
        """y of one encoded sample at many weights, (p, n_y).

        Args:
            encoding: Of one sample.
            points: (p, n).
        """
        x = encoding.features[0]
        own = points[:, : self._count].astype(float)
        different, place = np.unique(own, axis=0, return_inverse=True)
        y = self._force(np.broadcast_to(x, (len(different), len(x))), different)[place.ravel()]
        if self.beside is not None:
            seen = self.beside.encode_one(self._seen_beside(x))
            y = y + self.beside.values(seen, points[:, self._count :])
        return y

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (n_y,), and its derivative for the weights, (n_y, n).

        Args:
            encoding: Of one sample.
            weights: (n,).
        """
        x, own = encoding.features[0], weights[: self._count]
        state, slopes = self._memory.read(x[None], own[None])
        function, seen = self._functions["force_forward"], x[: self.measured_inputs]
        y, columns = np.zeros(0), []
        for k, along in enumerate(np.eye(self._count)):
            found = function(seen, state[0], own, slopes[0][:, k], along, self._numbers)
            y, column = (np.atleast_1d(part) for part in found)
            columns.append(column)
        slope = np.column_stack(columns)
        if self.beside is not None:
            beside = self.beside.encode_one(self._seen_beside(x))
            more, rest = self.beside.linearized(beside, weights[self._count :])
            y, slope = y + more, np.hstack([slope, rest])
        return y, slope

    def recall(
        self,
        weights: Array,
        time: ArrayLike,
        x: Array,
        carried: Carried = None,
        gaps: ArrayLike = (),
    ) -> tuple[Array, Carried]:
        """Inputs of a block of samples with what air and network remember; see `Network`."""
        kept: _Kept = _Kept(None, None) if carried is None else carried
        own, others = weights[: self._count], weights[self._count :]
        rows, memory = self._memory.recall(own, np.asarray(time, float), x, kept.memory, gaps)
        parts, beside = [x, rows], None
        if self.beside is not None:
            seen = x[:, : self.beside.measured_inputs]
            whole, beside = self.beside.recall(others, time, seen, kept.beside, gaps)
            parts.append(whole[:, self.beside.measured_inputs :])
        return np.hstack(parts), _Kept(memory, beside)

    def corrected(self, carried: Carried, change: Array) -> Carried:
        """What is carried, after an update moved the weights by a change, (n,)."""
        if carried is None:
            return None
        memory, beside = carried
        moved = None if memory is None else memory.moved(change[: self._count])
        if self.beside is not None:
            beside = self.beside.corrected(beside, change[self._count :])
        return _Kept(moved, beside)

    def estimates(self, weights: Array, variances: Array | None = None) -> tuple[Estimate, ...]:
        """The parameters, with deviations in their own units.

        Args:
            weights: (n,).
            variances: Of the weights, (n,); None: not known.
        """
        spread = np.full(self._count, np.nan) if variances is None else variances
        each = zip(self.parameters, weights.tolist(), spread.tolist(), strict=False)
        return tuple(parameter.estimate(w, variance) for parameter, w, variance in each)

    def stds(self, wandering: Mapping[str, float], beside: float = 0.0) -> Array:
        """A learner's process deviation from those of parameters in their own units, (n,).

        Args:
            wandering: By which each parameter wanders between two updates, by name; others
                stay.
            beside: The same for each weight beside.

        Raises:
            ParameterError: If a name is not learned.
        """
        own = process_stds(self.parameters, wandering)
        return np.append(own, np.full(self.size - self._count, beside))

    def air_at(self, weights: Array) -> tuple[Aerodynamics, AddedMass | None]:
        """Model of the air and added mass with what was learned, to fly with; not what is beside.

        Args:
            weights: (n,).

        Raises:
            ParameterError: If a parameter is no argument of the model.
        """
        return changed_air(self.model, self.added_mass, self.estimates(weights))

    def describe(self) -> dict[str, Any]:
        """Everything needed to make the network again, as JSON-able values."""
        return {
            "kind": self.kind,
            "robot": self.model.robot.source,
            "model": self.model.describe(),
            "estimate": self._estimate,
            "added_mass": None if self.added_mass is None else self.added_mass.describe(),
            "beside": None if self.beside is None else self.beside.describe(),
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
        from patagium.robot import load_robot_text

        keys = ("robot", "model", "estimate", "added_mass", "beside", "measured", "start")
        values = described(cls.kind, description, keys)
        robot = load_robot_text(values.pop("robot"))
        added, beside = values.pop("added_mass"), values.pop("beside")
        return cls(
            aero_from_description(robot, values.pop("model")),
            values.pop("estimate"),
            None if added is None else added_mass_from_description(robot, added),
            None if beside is None else network_from_description(beside),
            **values,
        )

    @property
    def _estimate(self) -> dict[str, float]:
        return {parameter.name: parameter.std for parameter in self.parameters}

    @property
    def _count(self) -> int:
        return len(self.parameters)

    @cached_property
    def _memory(self) -> GreyMemory:
        sizes = self.measured_inputs, self.model.state_size, self._count
        return GreyMemory(self._functions, self._numbers, sizes, self._start == "steady")

    @cached_property
    def _remembered_beside(self) -> int:
        return 0 if self.beside is None else self.beside.inputs - self.beside.measured_inputs

    def _force(self, x: Array, own: Array) -> Array:
        """y without what is beside, (N, n_y), of x (N, n_x) at weights (N, count)."""
        state, _ = self._memory.read(x, own)
        seen = x[:, : self.measured_inputs]
        y = self._functions["force"].batch(seen, state, own, self._numbers)
        return np.asarray(y).reshape(len(x), self.outputs)

    def _seen_beside(self, x: Array) -> Array:
        """What the network beside sees of x, (..., n)."""
        if self.beside is None:
            return x[..., :0]
        seen = x[..., : self.beside.measured_inputs]
        return np.concatenate([seen, x[..., x.shape[-1] - self._remembered_beside :]], axis=-1)

    def _check_beside(self) -> None:
        if self.beside is None:
            return
        if self.beside.output_names != self._names:
            expected = f"a network of {', '.join(self._names)}"
            raise ParameterError("beside", expected, ", ".join(self.beside.output_names))
        if self.beside.measured_inputs > self.measured_inputs:
            expected, found = f"at most {self.measured_inputs} inputs", self.beside.measured_inputs
            raise ShapeError("beside", expected, found)


def _again(kind: type[GreyBox], arguments: Any, options: Any) -> GreyBox:
    """A grey box unpickled."""
    return kind(*arguments, **options)
