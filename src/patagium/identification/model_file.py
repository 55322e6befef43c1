"""A learned model on disk: the network, its weights, how sure they are, what they came from.

One JSON file, written whole or not at all. Numbers come back bit for bit; the covariance
is kept as the bytes of its lower triangle. Neglected: the learner's own state beyond that.
"""

from __future__ import annotations

import base64
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium import __version__
from patagium.errors import LogError, PatagiumError, ShapeError
from patagium.identification.learner import Learner, as_input
from patagium.identification.network import Network, network_from_description

Array = NDArray[np.float64]

FORMAT = "patagium model 1"


@dataclass(frozen=True)
class Model:
    """A network with the weights it has learned; it predicts and does not learn.

    Attributes:
        network: The network.
        weights: (n,).
        covariance: Of the weights, (n, n); None if the learner had none.
        measurement_deviation: Of the measurements it learned from, (n_y,) in the unit of y;
            zero where unknown.
        inputs: Names of what the network sees; None: the state q, then v.
        learner: What the learner was made of.
        source: What it was learned from, in words.
    """

    network: Network
    weights: Array
    covariance: Array | None = field(default=None, repr=False)
    measurement_deviation: Array | None = None
    inputs: tuple[str, ...] | None = None
    learner: dict[str, Any] = field(default_factory=dict, repr=False)
    source: str = ""

    def __post_init__(self) -> None:
        """Refuse weights or a covariance of another network."""
        n = self.network.size
        if self.weights.shape != (n,):
            raise ShapeError("weights", (n,), self.weights.shape)
        if self.covariance is not None and self.covariance.shape != (n, n):
            raise ShapeError("covariance", (n, n), self.covariance.shape)

    def predict(self, x: ArrayLike) -> tuple[Array, Array]:
        """Measurement at x before it is made, with the network linear around its weights.

        Args:
            x: Input, (n_x,).

        Returns:
            Mean, (n_y,), and covariance H P H' + R, (n_y, n_y); nan without a covariance.

        Raises:
            ShapeError: If x has another shape.
        """
        sample = as_input(self.network, x)
        mean = self.network(sample, self.weights)
        if self.covariance is None or self.measurement_deviation is None:
            return mean, np.full((len(mean), len(mean)), np.nan)
        _, slope = self.network.linearized(self.network.encode_one(sample), self.weights)
        noise = np.diag(self.measurement_deviation**2)
        return mean, slope @ self.covariance @ slope.T + noise


def model_of(learner: Learner, *, inputs: Sequence[str] | None = None, source: str = "") -> Model:
    """What a learner has learned, without the learner.

    Args:
        learner: The learner.
        inputs: Names of what its network sees; None: the state q, then v.
        source: What it was learned from, in words.
    """
    description, covariance = learner.describe(), learner.covariance
    noise = description.get("measurement_deviation")
    outputs = learner.network.outputs
    return Model(
        learner.network,
        np.array(learner.weights, float),
        None if covariance is None else np.array(covariance, float),
        None if noise is None else np.broadcast_to(np.asarray(noise, float), (outputs,)).copy(),
        None if inputs is None else tuple(inputs),
        {key: value for key, value in description.items() if key != "network"},
        source,
    )


def save_model(path: str | Path, model: Model | Learner) -> Path:
    """Write a model as JSON; an interrupted write leaves what was there.

    Args:
        path: The file, replaced if it exists; folders are made.
        model: A model, or a learner whose network sees the whole state.

    Returns:
        The path.
    """
    file = Path(path)
    learned = model if isinstance(model, Model) else model_of(model)
    text = json.dumps(_words(learned), indent=1)
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, draft = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        Path(draft).chmod(0o644)
        Path(draft).replace(file)
    finally:
        Path(draft).unlink(missing_ok=True)
    return file


def load_model(path: str | Path) -> Model:
    """Read a model that `save_model` wrote.

    Args:
        path: The file.

    Raises:
        LogError: If there is no such file, or it is not a model of this version.
    """
    file = Path(path)
    try:
        words = json.loads(file.read_text(encoding="utf-8"))
    except OSError as problem:
        raise LogError(f"{file}: cannot be read: {problem.strerror}") from None
    except ValueError as problem:
        raise LogError(f"{file}: expected a model (JSON), found: {problem}") from None
    found = words.get("format") if isinstance(words, dict) else type(words).__name__
    if found != FORMAT:
        raise LogError(f"{file}: expected a file of format {FORMAT!r}, found {found!r}")
    try:
        return _model(words)
    except (PatagiumError, KeyError, TypeError, ValueError) as problem:
        raise LogError(f"{file}: the model cannot be made again: {problem}") from problem


def _words(model: Model) -> dict[str, Any]:
    noise = model.measurement_deviation
    return {
        "format": FORMAT,
        "patagium_version": __version__,
        "source": model.source,
        "network": model.network.describe(),
        "inputs": None if model.inputs is None else list(model.inputs),
        "outputs": list(model.network.output_names),
        "learner": model.learner,
        "measurement_deviation": None if noise is None else noise.tolist(),
        "weights": model.weights.tolist(),
        "covariance": None if model.covariance is None else _packed(model.covariance),
    }


def _model(words: Mapping[str, Any]) -> Model:
    inputs, noise, covariance = (
        words[key] for key in ("inputs", "measurement_deviation", "covariance")
    )
    weights = np.array(words["weights"], float)
    return Model(
        network_from_description(words["network"]),
        weights,
        None if covariance is None else _unpacked(covariance, len(weights)),
        None if noise is None else np.array(noise, float),
        None if inputs is None else tuple(inputs),
        dict(words["learner"]),
        str(words["source"]),
    )


def _packed(covariance: Array) -> str:
    lower = covariance[np.tril_indices(len(covariance))]
    return base64.b64encode(lower.astype("<f8").tobytes()).decode("ascii")


def _unpacked(text: str, size: int) -> Array:
    lower = np.frombuffer(base64.b64decode(text, validate=True), "<f8")
    rows, columns = np.tril_indices(size)
    covariance = np.empty((size, size))
    covariance[rows, columns] = lower
    covariance[columns, rows] = lower
    return covariance
