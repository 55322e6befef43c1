"""What verbs that teach a network share: its shape, how it learns, and with which numbers.

Options are declared here once, and a verb names them in its signature.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeAlias

import typer

from patagium.cli.words import Numbers, WholeNumbers, numbers, whole_numbers

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from patagium.aerodynamics import Air
    from patagium.learning.models.network import Network
    from patagium.robot import Robot


class NetworkKind(StrEnum):
    """Networks: of each strip, of the flow at all wings, each also with memory, of anything."""

    STRIP = "strip"
    HIDDEN_STRIP = "hidden_strip"
    FLOW = "flow"
    HIDDEN_FLOW = "hidden_flow"
    DENSE = "dense"


REMEMBERING = (NetworkKind.HIDDEN_STRIP, NetworkKind.HIDDEN_FLOW)
"""Networks with memory."""

WINGED = (NetworkKind.STRIP, NetworkKind.FLOW, *REMEMBERING)
"""Networks of a robot with wings; they see q and v."""


class LearnerKind(StrEnum):
    """Ways of learning the weights."""

    CUBATURE = "cubature"
    EXTENDED = "extended"
    GRADIENT = "gradient"
    LINEAR = "linear"


class Activation(StrEnum):
    """What a neuron does to its sum."""

    SOFTPLUS = "softplus"
    TANH = "tanh"


class Precision(StrEnum):
    """Numbers of the covariance's square root."""

    FLOAT64 = "float64"
    FLOAT32 = "float32"


def structure(text: str) -> Any:
    """Structure of a covariance: `full`, `layer`, `node`, or a rank such as 20."""
    if text in ("full", "layer", "node"):
        return text
    if not text.isdecimal() or int(text) < 1:
        raise typer.BadParameter(f"expected full, layer, node or a rank such as 20, found {text!r}")
    from patagium.learning import LowRank

    return LowRank(int(text))


SettingsOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="What patagium tune wrote (.yaml); other options count more."),
]
NetworkOption: TypeAlias = Annotated[
    NetworkKind | None, typer.Option(help="By default strip for flights, dense for tables.")
]
HiddenOption: TypeAlias = Annotated[
    WholeNumbers | None,
    typer.Option(parser=whole_numbers, help="Neurons of each hidden layer; 8,8 (flow: 28)."),
]
ActivationOption: TypeAlias = Annotated[Activation, typer.Option(help="Of the hidden layers.")]
LearnerOption: TypeAlias = Annotated[LearnerKind, typer.Option(help="How the weights are learned.")]
PriorDeviationOption: TypeAlias = Annotated[
    float | None,
    typer.Option(help="Of each weight at the start, before dividing by sqrt(fan-in)."),
]
MeasurementDeviationOption: TypeAlias = Annotated[
    Numbers | None,
    typer.Option(parser=numbers, help="Of the outputs, in their units: one, or one each."),
]
ProcessDeviationOption: TypeAlias = Annotated[
    float | None, typer.Option(help="By which each weight wanders between updates.")
]
SpreadOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Distance of the cubature points, in deviations.")
]
ForgettingFactorOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Above 0, at most 1: forgets old samples.")
]
PriorShareOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Of the first covariance, mixed in before each sample.")
]
CovarianceOption: TypeAlias = Annotated[
    Any,
    typer.Option(
        parser=structure,
        metavar="full|layer|node|RANK",
        help="What is kept of it; full by default.",
    ),
]
DtypeOption: TypeAlias = Annotated[
    Precision | None, typer.Option(help="Of the covariance's root; float64 by default.")
]
OutlierDeviationOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Innovations beyond so many deviations are doubted, such as 5.")
]
StuckSamplesOption: TypeAlias = Annotated[
    int | None, typer.Option(help="A channel that repeats itself so often is left out.")
]
NoiseMemoryOption: TypeAlias = Annotated[
    int | None, typer.Option(help="Estimate the measurement deviation over so many samples.")
]
ChangeWindowOption: TypeAlias = Annotated[
    int | None, typer.Option(help="Look for changes over so many samples, and doubt the weights.")
]
ChangeReferenceOption: TypeAlias = Annotated[
    int | None, typer.Option(help="Samples before them to compare with; a wingbeat or more.")
]
FalseAlarmRateOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Of the test for changes, a sample, such as 1e-7.")
]
LearningRateOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Step of the gradient learner.")
]
ReplayOption: TypeAlias = Annotated[
    int | None, typer.Option(help="Old samples the gradient learner sees again.")
]
FeaturesOption: TypeAlias = Annotated[
    int | None, typer.Option(help="Random softplus features of the linear learner.")
]
SeedOption: TypeAlias = Annotated[int, typer.Option(help="Of the initial weights.")]

_FILTER = {
    *("process_std", "forgetting_factor", "prior_share", "covariance"),
    *("screening", "noise_estimation", "change_detection"),
}
_NEEDED = {
    LearnerKind.CUBATURE: {"prior_std", "measurement_std"},
    LearnerKind.EXTENDED: {"prior_std", "measurement_std"},
    LearnerKind.GRADIENT: {"learning_rate"},
    LearnerKind.LINEAR: {"prior_std", "measurement_std"},
}
_TAKEN = {
    LearnerKind.CUBATURE: {*_FILTER, "spread", "dtype"},
    LearnerKind.EXTENDED: _FILTER,
    LearnerKind.GRADIENT: {"replay"},
    LearnerKind.LINEAR: {"features", "forgetting_factor"},
}


def given(**settings: Any) -> dict[str, Any]:
    """Settings that somebody gave, as a learner takes them.

    Args:
        **settings: By name; None where nothing was given.
    """
    found = {name: value for name, value in settings.items() if value is not None}
    stds = found.get("measurement_std")
    if stds is not None and len(stds) == 1:
        found["measurement_std"] = stds[0]
    if "dtype" in found:
        found["dtype"] = found["dtype"].value
    return found


def watched(
    outlier_std: float | None,
    stuck_samples: int | None,
    noise_memory: int | None,
    change_window: int | None,
    change_reference: int | None,
    false_alarm_rate: float | None,
) -> dict[str, Any]:
    """Settings of what a learner does about bad samples, noise and changes.

    Args:
        outlier_std: Of `Screening`.
        stuck_samples: Of `Screening`.
        noise_memory: Of `NoiseEstimation`.
        change_window: Of `ChangeDetection`.
        change_reference: Of `ChangeDetection`.
        false_alarm_rate: Of `ChangeDetection`.

    Raises:
        ParameterError: If a number is out of its range, or the test for changes is not whole.
    """
    from patagium.errors import ParameterError
    from patagium.learning import ChangeDetection, NoiseEstimation, Screening

    found: dict[str, Any] = {}
    screening = given(outlier_std=outlier_std, stuck_samples=stuck_samples)
    if screening:
        found["screening"] = Screening(**screening)
    if noise_memory is not None:
        found["noise_estimation"] = NoiseEstimation(noise_memory)
    test = (false_alarm_rate, change_window, change_reference)
    if test != (None, None, None):
        if false_alarm_rate is None or change_window is None or change_reference is None:
            names = "--change-window, --change-reference and --false-alarm-rate"
            raise ParameterError("test for changes", names, test)
        found["change_detection"] = ChangeDetection(
            false_alarm_rate, change_window, change_reference
        )
    return found


def make_learner(kind: LearnerKind, network: Any, settings: Mapping[str, Any], seed: int) -> Any:
    """A learner with the settings given.

    Args:
        kind: How it learns.
        network: What it learns.
        settings: See `given`.
        seed: Of the initial weights.

    Raises:
        ParameterError: If a setting is missing, or one that this learner does not have.
    """
    import numpy as np

    from patagium import learning as identification
    from patagium.errors import ParameterError

    known = set() if np.isnan(network.own_prior).any() else {"prior_std"}
    for name in sorted(_NEEDED[kind] - known - set(settings)):
        raise ParameterError(_option(name), f"a number for the {kind} learner", None)
    for name in sorted(set(settings) - _NEEDED[kind] - _TAKEN[kind]):
        raise ParameterError(_option(name), f"nothing: the {kind} learner has none", settings[name])
    make = getattr(identification, f"{kind.value.capitalize()}Learner")
    return make(network, seed=seed, **settings)


class Asked(NamedTuple):
    """What the command line asks for.

    Attributes:
        learner: How it learns.
        options: Settings of the learner that were given.
        network: None where nothing was said.
        hidden: None where nothing was said.
        activation: Of the hidden layers.
        every: One sample in so many is used.
        seed: Of the initial weights.
    """

    learner: LearnerKind
    options: dict[str, Any]
    network: NetworkKind | None
    hidden: WholeNumbers | None
    activation: Activation
    every: int
    seed: int


def completed(context: typer.Context, asked: Asked, settings: Path | None) -> Asked:
    """The same, with what was not said taken from a file of settings.

    Args:
        context: Of the verb.
        asked: What the command line asks for.
        settings: What `patagium tune` wrote; None: nothing is added.
    """
    if settings is None:
        return asked
    from patagium.cli.words import existing
    from patagium.learning import load_settings

    found, said = load_settings(existing(settings)), said_by_hand(context)
    learner = asked.learner if "learner" in said else LearnerKind(found.learner.kind)
    linear, activation = learner is LearnerKind.LINEAR, Activation(found.network.activation)
    return Asked(
        learner,
        settled(found.learner.values, learner) | asked.options,
        asked.network if linear else asked.network or NetworkKind(found.network.kind),
        asked.hidden if linear else asked.hidden or WholeNumbers(found.network.hidden),
        asked.activation if "activation" in said else activation,
        asked.every if "every" in said else found.every,
        asked.seed if "seed" in said else found.learner.seed,
    )


def settled(values: Mapping[str, Any], kind: LearnerKind) -> dict[str, Any]:
    """Settings of a learner from a file of settings, as far as it has them.

    Args:
        values: Plain, by name.
        kind: How it learns.
    """
    from patagium.learning.tuning.knobs import keywords

    known = _NEEDED[kind] | _TAKEN[kind]
    return {name: value for name, value in keywords(values).items() if name in known}


def said_by_hand(context: typer.Context) -> set[str]:
    """Names of the options that stand on the command line.

    Args:
        context: Of the verb.
    """
    sources = {name: context.get_parameter_source(name) for name in context.params}
    return {name for name, source in sources.items() if source and source.name == "COMMANDLINE"}


def network_shape(
    network: NetworkKind | None, hidden: WholeNumbers | None, learner: LearnerKind
) -> tuple[NetworkKind | None, tuple[int, ...]]:
    """The network asked for; the linear learner takes inputs and outputs only.

    Raises:
        ParameterError: If the linear learner is to have hidden layers or wings.
    """
    from patagium.errors import ParameterError

    if learner is not LearnerKind.LINEAR:
        return network, hidden or ((28,) if network is NetworkKind.FLOW else (8, 8))
    if hidden is not None or network in WINGED:
        option = "--network" if hidden is None else "--hidden"
        raise ParameterError(
            option, "nothing: the linear learner has --features", hidden or network
        )
    return NetworkKind.DENSE, ()


def winged_network(
    kind: NetworkKind | None, robot: Robot, hidden: tuple[int, ...], air: Air, activation: str
) -> Network:
    """The network that knows the wings; the one of strips unless asked."""
    from patagium import learning as found

    if kind is NetworkKind.HIDDEN_STRIP:
        return found.HiddenStripNetwork(robot, hidden, air=air, activation=activation)
    if kind is NetworkKind.HIDDEN_FLOW:
        return found.HiddenFlowNetwork(robot, hidden, air=air, activation=activation)
    make = found.FlowNetwork if kind is NetworkKind.FLOW else found.StripNetwork
    return make(robot, hidden, air, activation)


def scaled_network(
    names: tuple[str, ...],
    hidden: tuple[int, ...],
    activation: str,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
) -> Any:
    """A dense network whose inputs and outputs are scaled by samples.

    Args:
        names: Of the outputs.
        hidden: Neurons of each hidden layer.
        activation: Of the hidden layers.
        x: Inputs, (N, n_x).
        y: Outputs, (N, n_y).
    """
    from patagium.learning import DenseNetwork

    (x_center, x_scale), (y_center, y_scale) = _spans(x), _spans(y)
    return DenseNetwork(
        x.shape[1], hidden, names, activation, input_center=x_center,
        input_scale=x_scale, output_center=y_center, output_scale=y_scale,
    )  # fmt: skip


def _spans(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middle and half width of each column, one where it stands still."""
    low, high = values.min(axis=0), values.max(axis=0)
    half = (high - low) / 2
    half[half < 1e-9 * max(half.max(), 1e-300)] = 1.0
    return (low + high) / 2, half


_OPTIONS = {
    "screening": "--outlier-std, --stuck-samples",
    "noise_estimation": "--noise-memory",
    "change_detection": "--change-window",
}


def _option(name: str) -> str:
    return _OPTIONS.get(name, "--" + name.replace("_", "-"))
