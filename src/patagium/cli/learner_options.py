"""Options of the verbs that teach a network, made from the records of settings.

A verb with a parameter `choice: LearnerChoice` takes all of them by `with_learner_options`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import Field, dataclass, replace
from enum import StrEnum
from functools import wraps
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from patagium.cli.words import Numbers, WholeNumbers, existing, numbers, whole_numbers
from patagium.errors import ParameterError, PatagiumError, similar
from patagium.learning.settings import BLOCKS, FILTERS, Meaning, leaves, settings_from, settings_of

if TYPE_CHECKING:
    from patagium.aerodynamics import Air
    from patagium.arrays import Array
    from patagium.learning.models.network import Network

PANEL = "Learner settings"
ACTIVATIONS = ("softplus", "tanh")


class NetworkKind(StrEnum):
    """Networks of each strip, and of anything."""

    LINEAR_STRIP = "linear_strip"
    STRIP = "strip"
    DENSE = "dense"


WINGED = {
    NetworkKind.LINEAR_STRIP: "LinearStripNetwork",
    NetworkKind.STRIP: "StripNetwork",
}
"""Networks of a robot with wings, which see its motion: classes in `patagium.learning`."""


@dataclass(frozen=True)
class LearnerChoice:
    """Learner and network that the command line and a file of settings choose.

    Attributes:
        kind: Kind of the learner, one of `FILTERS`: the extended filter where it was not chosen,
            unless a setting was that only the cubature filter has.
        settings: Values of its settings by dotted name, such as "screening.outlier_std".
        network: Kind of the network; None: the default of a robot, a dense one of a table.
        hidden: Neurons of each hidden layer, or several of these; None: those of the network.
        activation: Activation of the hidden layers; None: that of the network.
        options: Other arguments of the network, from a file of settings.
        seed: Seed of the initial weights.
        every: Stride of the samples that are used; None where no file states it.
        given: Words of the options that were given, such as "--network".
        chosen: Which of "network" and "learner" these options and the file choose.
    """

    kind: str = "extended"
    settings: Mapping[str, Any] | None = None
    network: NetworkKind | None = None
    hidden: Any = None
    activation: str | None = None
    options: Mapping[str, Any] | None = None
    seed: int = 0
    every: int | None = None
    given: tuple[str, ...] = ()
    chosen: frozenset[str] = frozenset()

    def learner(self, network: Any) -> Any:
        """New learner of a network.

        Raises:
            ParameterError: If a setting is missing, out of its range, or not of this learner.
        """
        from patagium.learning.learners.registry import LEARNERS

        try:
            record = settings_from(self.kind, nested(self.settings or {}))
            return LEARNERS[self.kind](network, record, seed=self.seed)
        except ParameterError as error:
            name = error.name
            words = {path.rpartition(".")[2]: f"--{word}" for word, path, _ in setting_options()}
            raise ParameterError(words.get(name, name), error.expected, error.found) from None

    def shape(self) -> tuple[NetworkKind | None, tuple[int, ...]]:
        """Kind and hidden layers of the network; None and () for the default network.

        Raises:
            ParameterError: If a linear network is to have hidden layers.
        """
        layers = () if self.network in (None, NetworkKind.LINEAR_STRIP) else (8, 8)
        if self.hidden and self.network is NetworkKind.LINEAR_STRIP:
            raise ParameterError("--hidden", "nothing: the network is linear", self.hidden)
        return self.network, self.hidden or layers


def with_learner_options(
    *, several: bool = False, file: str = "Settings that patagium tune wrote (.yaml)"
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorator of a verb whose parameter `choice` becomes the options of a learner.

    Args:
        several: Whether settings and hidden layers may be repeated, and no file is read: the
            choice then holds lists.
        file: Help of the option of the file.
    """

    def decorate(verb: Callable[..., None]) -> Callable[..., None]:
        options = list(_options(several, file))
        own = list(inspect.signature(verb, eval_str=True).parameters.values())
        place = next(k for k, one in enumerate(own) if one.name == "choice")
        both = [*own[:place], *options, *own[place + 1 :]]

        @wraps(verb)
        def with_choice(**values: Any) -> None:
            found = {one.name: values.pop(one.name) for one in options}
            verb(**values, choice=_chosen(found))

        keywords = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in both]
        with_choice.__dict__["__signature__"] = inspect.Signature(keywords)
        with_choice.__annotations__ = {one.name: one.annotation for one in keywords}
        return with_choice

    return decorate


def setting_options() -> Iterator[tuple[str, str, Field[Any]]]:
    """Settings of the learners: word of the option, dotted name, field."""
    for path, one in leaves():
        yield one.metadata["meaning"].option or one.name.replace("_", "-"), path, one


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by name, those of groups by name within them."""
    found: dict[str, Any] = {}
    for path, value in values.items():
        group, _, name = path.rpartition(".")
        (found.setdefault(group, {}) if group else found)[name] = value
    return found


def _options(several: bool, file: str) -> Iterator[inspect.Parameter]:
    """Parameters of a verb: file, learner, network, then one for each setting."""
    many: Any = list[WholeNumbers] if several else WholeNumbers
    repeat = " Repeat it to try several." if several else ""
    if not several:
        help_text = f"{file}; command-line options override it."
        yield _parameter("settings", Path, typer.Option(help=help_text))
    network = "Network; by default linear_strip for a robot with wings, dense for tables."
    hidden = "Neurons of each hidden layer; 8,8 by default." + repeat
    activation = "Activation of the hidden layers; softplus by default."
    layers: dict[str, Any] = {"parser": whole_numbers, "metavar": "N,N,..."}
    for name, kind, text, reading in (
        ("network", str, network, _one_of(tuple(NetworkKind))),
        ("hidden", many, hidden, layers),
        ("activation", str, activation, _one_of(ACTIVATIONS)),
        ("learner", str, "Kind of the learner; extended by default.", _one_of(FILTERS)),
        ("seed", int, "Seed of the initial weights; 0 by default.", {}),
    ):
        yield _parameter(name, kind, typer.Option(help=text, rich_help_panel=PANEL, **reading))
    for word, path, one in setting_options():
        yield _setting(word, path, one, several)


def _setting(word: str, path: str, one: Field[Any], several: bool) -> inspect.Parameter:
    """Parameter of a verb for a setting; only settings outside of groups may be repeated."""
    meaning: Meaning = one.metadata["meaning"]
    group = path.rpartition(".")[0]
    plain, reading = _READINGS[str(one.type).removesuffix(" | None")]
    words = [meaning.text + ("" if meaning.unit in ("1", "y") else f" [{meaning.unit}]")]
    if meaning.choices:
        plain, reading = str, _one_of(meaning.choices)
    elif isfinite(meaning.low) or isfinite(meaning.high):
        words.append(meaning.range)
    if one.default is not None:
        default = f"{one.default:g}" if isinstance(one.default, float) else str(one.default)
        where = f"off by default, {default} with other options of {group}"
        words.append(where.replace("_", " ") if group else f"{default} by default")
    elif meaning.found:
        words.append(f"by default {meaning.found}")
    text = "; ".join(words) + "."
    option = typer.Option(f"--{word}", help=text, rich_help_panel=PANEL, **reading)
    many: Any = list[plain] if several and not group else plain  # type: ignore[valid-type]
    return _parameter(word.replace("-", "_"), many, option)


def _one_of(words: tuple[str, ...]) -> dict[str, Any]:
    """Reading of an option for one of several words."""

    def read(text: str) -> str:
        if text not in words:
            found = f"{text!r}{similar(text, words)}"
            raise typer.BadParameter(f"expected one of {', '.join(words)}, found {found}")
        return text

    return {"parser": read, "metavar": "|".join(words)}


def _parameter(name: str, kind: Any, option: Any) -> inspect.Parameter:
    """Keyword of a verb that is None where the option is not given."""
    hint = Annotated[kind | None, option]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=hint)


_READINGS: dict[str, tuple[Any, dict[str, Any]]] = {
    "float": (float, {}),
    "int": (int, {}),
    "str": (str, {}),
    "Numbers": (Numbers, {"parser": numbers, "metavar": "NUMBER[,NUMBER...]"}),
    "Structure": (str, _one_of(BLOCKS)),
}
"""Type of an option and how its text is read, for each type of a setting."""


def _chosen(found: dict[str, Any]) -> LearnerChoice:
    """Choice of the values of `_options`; a file of settings gives what was not given."""
    path = found.pop("settings", None)
    given = {name: value for name, value in found.items() if value is not None}
    words = {"learner": "kind"} | {name: name for name in ("hidden", "activation", "seed")}
    shape: dict[str, Any] = {new: given[old] for old, new in words.items() if old in given}
    if "network" in given:
        shape["network"] = NetworkKind(given["network"])
    places = {word.replace("-", "_"): dotted for word, dotted, _ in setting_options()}
    settings = {dotted: _plain(given[name]) for name, dotted in places.items() if name in given}
    words_given = tuple(f"--{k.replace('_', '-')}" for k in (*given, *["settings"] * bool(path)))
    extended = {one.name for one in settings_of("extended")}
    alone = {name.partition(".")[0] for name in settings} - extended  # of the cubature filter
    if path is None and alone and "learner" not in given:
        shape["kind"] = "cubature"
    deciding = {"network": {"network", "hidden", "activation"}, "learner": {"kind"}}
    by_hand = frozenset(name for name, own in deciding.items() if path or own & {*shape})
    choice = LearnerChoice(settings=settings, given=words_given, chosen=by_hand, **shape)
    if path is not None:
        choice = _completed(choice, set(shape), path)
    if {"misfit", "noise_estimation"} <= {name.partition(".")[0] for name in choice.settings or ()}:
        expected = "one of the two, as each finds the noise"
        raise PatagiumError("--misfit, --noise-memory", expected, "both; leave one of them out")
    return choice


def _plain(value: Any) -> Any:
    """A value of an option as a file of settings would hold it."""
    if type(value) is list:
        return [_plain(one) for one in value]
    if isinstance(value, Numbers):
        return value[0] if len(value) == 1 else list(value)
    return value


def _completed(choice: LearnerChoice, given: set[str], path: Path) -> LearnerChoice:
    """Choice completed by a file of settings, as far as the learner has them."""
    from patagium.learning import load_settings

    found, kinds = load_settings(existing(path)), [one.value for one in NetworkKind]
    if found.network.kind not in kinds:
        where, expected = f"{path}: network.kind", f"one of {', '.join(kinds)}"
        raise ParameterError(where, f"{expected} on the command line", found.network.kind, kinds)
    kind = choice.kind if "kind" in given else found.learner.kind
    known = {one.name for one in settings_of(kind)}
    kept: dict[str, Any] = {}
    for name, value in found.learner.values.items():
        inner = value if isinstance(value, dict) and name != "covariance" else None
        if name in known and value is not None:
            kept |= {name: value} if inner is None else {f"{name}.{k}": v for k, v in inner.items()}
    filled: dict[str, Any] = {
        "network": NetworkKind(found.network.kind),
        "hidden": WholeNumbers(found.network.hidden),
        "activation": found.network.activation,
        "kind": found.learner.kind,
        "seed": found.learner.seed,
    }
    if choice.network in (None, found.network.kind):
        filled["options"] = found.network.options
    filled = {name: value for name, value in filled.items() if name not in given}
    settings = {**kept, **(choice.settings or {})}
    return replace(choice, settings=settings, every=found.every, **filled)


def winged_network(choice: LearnerChoice, subject: Any, air: Air) -> Network:
    """Network of the wings of a robot, or of the robot of a flight, in an air."""
    from patagium import learning
    from patagium.learning.default_learner import default_network
    from patagium.robot import Robot
    from patagium.simulation import robot_of

    kind, hidden = choice.shape()
    kind = kind or (NetworkKind.STRIP if hidden else NetworkKind.LINEAR_STRIP)
    linear = kind is NetworkKind.LINEAR_STRIP
    if linear and not choice.options:
        return default_network(subject, air)
    robot = subject if isinstance(subject, Robot) else robot_of(subject)
    given: dict[str, Any] = {} if linear else {"hidden": hidden}
    if choice.activation and not linear:
        given["activation"] = choice.activation
    make = getattr(learning, WINGED[kind])
    for name, value in (choice.options or {}).items():
        given[name] = make.readers[name](value) if name in make.readers else value
    network: Network = make(robot, air=air, **given)
    return network


def scaled_network(choice: LearnerChoice, names: tuple[str, ...], x: Array, y: Array) -> Any:
    """Dense network whose inputs and named outputs are scaled by samples x and y."""
    from patagium.learning.table_network import dense_network, sample_ranges

    ranges = [*sample_ranges(x), *sample_ranges(y)]
    return dense_network(names, choice.shape()[1], ranges, choice.activation)
