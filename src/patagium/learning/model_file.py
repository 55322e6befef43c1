"""A learned model on disk: the network, its weights and their covariance, and its source.

A model is one JSON file, written whole or not at all. Numbers come back bit for bit. The
covariance is stored as its structure keeps it: lower triangles of blocks, or the diagonal and
the columns of its inverse. The state of the learner has a file of its own; see `state_file`.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics.added_mass import AddedMass
from patagium.aerodynamics.air import Air
from patagium.aerodynamics.description import aero_from_description, innermost
from patagium.aerodynamics.model import Aerodynamics
from patagium.arguments import checked
from patagium.arrays import Array, brief, real_array
from patagium.errors import LogError, ParameterError, ShapeError, shown
from patagium.learning.filters.misfit import widened
from patagium.learning.filters.state import packed, symmetric, unpacked
from patagium.learning.filters.weight_covariance import BlockCovariance, block_covariance
from patagium.learning.learners.learner import Learner, as_input, row_by_row
from patagium.learning.models.network import Network, center_of
from patagium.learning.models.registry import network_from_description
from patagium.learning.models.structure import blocks_of
from patagium.learning.settings import checked_structure
from patagium.limits import free_memory
from patagium.netcdf_file import kind_of
from patagium.reading import json_object, made_again, text_of
from patagium.robot.model import Robot
from patagium.simulation.simulator import check_added_mass
from patagium.version import __version__
from patagium.whole_file import write_whole

FORMAT = "patagium model 2"
_DRAWS = 20
"""Draws of weights that no possible air has, after which the last refusal is raised."""


@dataclass(frozen=True, eq=False)
class Model:
    """A network with the weights it has learned; it predicts and does not learn.

    Attributes:
        network: The network.
        weights: Weights, (n,) [1].
        kept_covariance: Covariance of the weights as the learner kept it; None if it had none.
        measurement_std: Standard deviation of the measurements, given or estimated,
            (n_y,) [unit of y]; 0 of outputs that were never measured, None where none is known.
        inputs: Names of the inputs; None: the state q, then v.
        learner: Description of the learner.
        source: Source of the samples, in words.
        usual_std: Standard deviation that the weights gave to the flow that was learned last,
            (n_y,) [unit of y]; the measurement's is then that of the errors there. None of
            learners without `misfit`.
    """

    network: Network
    weights: Array
    kept_covariance: BlockCovariance | None = field(default=None, repr=False)
    measurement_std: Array | None = None
    inputs: tuple[str, ...] | None = None
    learner: dict[str, Any] = field(default_factory=dict, repr=False)
    source: str = ""
    usual_std: Array | None = None
    __repr__ = brief

    def __post_init__(self) -> None:
        """Refuse weights, a covariance or deviations of another network."""
        n, outputs = self.network.size, self.network.outputs
        for name, size in (("weights", n), ("measurement_std", outputs), ("usual_std", outputs)):
            array = getattr(self, name)
            if array is None:
                continue
            if array.shape != (size,):
                raise ShapeError(name, (size,), array.shape)
            if center_of(name, array, size).min() < 0 and name != "weights":
                raise ParameterError(name, "numbers not below zero", array)
        kept = self.kept_covariance
        if kept is not None and kept.size != n:
            raise ShapeError("covariance", (n, n), (kept.size, kept.size))

    @property
    def covariance(self) -> Array | None:
        """Covariance of the weights, (n, n); None if the learner had none.

        Raises:
            ParameterError: If it was kept by parts and would be a very large matrix.
        """
        return None if self.kept_covariance is None else self.kept_covariance.dense()

    @checked
    def air(
        self, robot: Robot | None = None, air: Air | None = None
    ) -> tuple[Aerodynamics, AddedMass | None]:
        """Air that was learned, as a model to trim and fly with, and what wings carry of it.

        Both belong to `trim`, `optimize`, `simulate` and `fly`: without its added mass the model
        is another one. `evaluate` of a flight says whether its flow was learned (`unseen_share`).

        Args:
            robot: Robot to fly, of the same bodies and wings as that of the log, by default that
                one; what was learned of its numbers is written into it.
            air: Density and wind to fly in; by default those of the log.

        Raises:
            ParameterError: If the network is no model of the air, the robot is another one, or
                the numbers are those of no possible robot and air.
        """
        found: Any = getattr(self.network, "air_at", None)
        if found is None:
            expected = "one whose weights are a model of the air: linear_strip, the default, or "
            expected += "numbers that were estimated (--estimate, GreyBox)"
            raise ParameterError("network", expected, self.network.describe().get("kind"))
        model, added = found(self.weights)
        machine: Robot = model.robot
        if robot is not None:
            if robot.structure != machine.structure:
                expected = f"{machine.name} as in the log, of the same bodies, joints and wings"
                raise ParameterError("robot", expected, robot.name)
            before: Any = getattr(self.network, "model", self.network)
            known = before.robot.parameters
            numbers = zip(machine.parameter_names, machine.parameters, known, strict=True)
            learned = {name: float(value) for name, value, was in numbers if value != was}
            machine = robot.with_parameters(learned) if learned else robot
        description = model.describe()
        if air is not None:
            innermost(description)["air"] = air.describe()
        model = aero_from_description(machine, description)
        added = None if added is None else replace(added, robot=machine, air=model.air)
        check_added_mass(machine, model, added)
        return model, added

    @checked
    def draw(self, seed: int, robot: Robot | None = None, air: Air | None = None) -> Model:
        """Model with weights drawn from what the samples left open: normal, about its own.

        What several draws make of a question, such as the orbits that they have, says how far the
        log answers it. Weights that no possible air has, which `air` refuses, are drawn again.

        Args:
            seed: Seed of the draw.
            robot: Robot to fly, as the method `air` takes it.
            air: Density and wind to fly in, likewise.

        Raises:
            ParameterError: If the learner had no covariance, or `air` refused twenty draws.
        """
        if self.kept_covariance is None:
            raise ParameterError("covariance", "one, which filters keep", None)
        kept, random = self.kept_covariance, np.random.default_rng(seed)
        for left in reversed(range(_DRAWS)):
            drawn = replace(self, weights=self.weights.copy())
            for block, part in zip(kept.blocks, kept.parts, strict=True):
                drawn.weights[block] += random.multivariate_normal(
                    np.zeros(len(block)), part, check_valid="ignore", method="eigh"
                )
            try:
                if hasattr(self.network, "air_at"):
                    drawn.air(robot, air)
                break
            except ParameterError:
                if not left:
                    raise
        return drawn

    def predict(self, x: ArrayLike) -> tuple[Array, Array]:
        """Measurement at x before it is made, with the network linear around its weights.

        Args:
            x: Input, (n_x,) [units of x]; several, (N, n_x), give (N, n_y) and (N, n_y, n_y).

        Returns:
            Mean, (n_y,), and covariance, (n_y, n_y); nan without one. It is H P H' + R, scaled to
            the variances that the learner states in any flow if it had `misfit`.

        Raises:
            ShapeError: If x has another shape.
        """
        if (rows := real_array("x", x)).ndim == 2:
            return row_by_row(self.predict, rows, self.network.outputs)
        sample = as_input(self.network, rows)
        mean = self.network(sample, self.weights)
        if self.kept_covariance is None or self.measurement_std is None:
            return mean, np.full((len(mean), len(mean)), np.nan)
        _, slope = self.network.linearized(self.network.encode_one(sample), self.weights)
        noise, seen = self.measurement_std**2, self.kept_covariance.seen_by(slope)
        covariance = seen + np.diag(noise)
        if self.usual_std is None:
            return mean, covariance
        stated = widened(noise, np.diag(seen), self.usual_std**2)
        scale = np.sqrt(stated / np.diag(covariance))
        return mean, scale[:, None] * covariance * scale


@checked
def model_of(learner: Learner, *, inputs: Sequence[str] | None = None, source: str = "") -> Model:
    """Model that a learner has learned, without the learner.

    Args:
        learner: The learner.
        inputs: Names of the inputs; None: the state q, then v.
        source: Source of the samples, in words.
    """
    description = learner.describe()
    noise = getattr(learner, "measurement_std", description.get("measurement_std"))
    if noise is not None and np.isnan(noise).all():  # not found before the first sample
        noise = None
    outputs = learner.network.outputs
    return Model(
        learner.network,
        np.array(learner.weights, float),
        _kept(learner),
        None if noise is None else np.broadcast_to(np.nan_to_num(noise), (outputs,)).copy(),
        None if inputs is None else tuple(inputs),
        {key: value for key, value in description.items() if key != "network"},
        source,
        getattr(learner, "usual_std", None),
    )


@checked
def save_model(path: str | Path, model: Model | Learner) -> Path:
    """Write a model as JSON; an interrupted write leaves the former file.

    Args:
        path: The file, replaced if it exists, in a folder that is there.
        model: A model, or a learner whose network sees the whole state.

    Returns:
        The path.
    """
    learned = model if isinstance(model, Model) else model_of(model)
    kept = learned.kept_covariance
    words = {
        "format": FORMAT,
        "patagium_version": __version__,
        "source": learned.source,
        "network": learned.network.describe(),
        "inputs": learned.inputs,
        "outputs": list(learned.network.output_names),
        "learner": learned.learner,
        "measurement_std": learned.measurement_std,
        "usual_std": learned.usual_std,
        "weights": learned.weights,
        "covariance": None if kept is None else _packed(kept),
    }
    return write_whole(path, json.dumps(words, indent=1, default=np.ndarray.tolist))


@checked
def load_model(path: str | Path) -> Model:
    """Read a model that `save_model` wrote.

    Args:
        path: The file.

    Raises:
        LogError: If there is no such file, or it is not a model of this version.
    """
    file = Path(path)
    kind = kind_of(file)
    if kind and not kind.startswith("a learned model"):
        raise LogError(file, "a model (.json) such as patagium identify writes", kind)
    words = json_object(text_of(file, free_memory() // 8), str(file))
    if words.get("format") != FORMAT:
        raise LogError(file, f"a file of format {FORMAT!r}", shown(words.get("format")))
    with made_again(f"{file}: the model"):
        inputs, covariance = words["inputs"], words["covariance"]
        noise, usual = words["measurement_std"], words.get("usual_std")
        network = network_from_description(words["network"])
        return Model(
            network,
            real_array("weights", words["weights"]),
            None if covariance is None else _unpacked(network, covariance),
            None if noise is None else real_array("measurement_std", noise),
            None if inputs is None else tuple(inputs),
            dict(words["learner"]),
            str(words["source"]),
            None if usual is None else real_array("usual_std", usual),
        )


def _kept(learner: Learner) -> BlockCovariance | None:
    """Covariance as a learner keeps it; of a learner of another kind the whole matrix."""
    kept: Callable[[], BlockCovariance] | None = getattr(learner, "kept_covariance", None)
    if kept is not None:
        return kept()
    whole = learner.covariance
    if whole is None:
        return None
    return block_covariance(learner.network, "full", [np.array(whole, float)])


def _packed(covariance: BlockCovariance) -> dict[str, str]:
    lower = packed(covariance.parts).astype("<f8").tobytes()
    return {"kind": covariance.structure, "lower": base64.b64encode(lower).decode()}


def _unpacked(network: Network, words: Mapping[str, str]) -> BlockCovariance:
    content = base64.b64decode(words["lower"], validate=True)
    lower = np.frombuffer(content, "<f8").astype(float)
    center_of("lower", lower, lower.size)
    kind = checked_structure(words["kind"])
    blocks = blocks_of(network, kind)
    parts = unpacked(lower, [len(block) for block in blocks])
    return BlockCovariance(kind, blocks, tuple(map(symmetric, parts)))
