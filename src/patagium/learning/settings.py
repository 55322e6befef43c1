"""Settings of the filters that learn weights: the only place where they are named.

Each setting has a sentence, a unit, a range and a default. From these records come the arguments
of the learners, the options of the command line, the search space of `tune`, the YAML file of
settings, `describe()` and the table in the documentation: nothing else names a setting.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import Field, asdict, dataclass, field, fields, replace
from inspect import Parameter, Signature
from math import inf, isfinite
from textwrap import fill
from typing import Any, Literal, NamedTuple, TypeAlias

from patagium.errors import ParameterError, ShapeError, check_names

FILTERS = ("cubature", "extended")
"""Learners whose weights a filter moves."""


@dataclass(frozen=True)
class LogRange:
    """Search space of a number, tried over a range of magnitudes.

    Args:
        low: Least value.
        high: Largest value.
        one_minus: Whether the value is one minus the number that is drawn.
        off: Value that switches the setting off, tried half of the time; None: it is never off.
        per_output: Whether the number is relative to the standard deviation of each output.
    """

    low: float
    high: float
    one_minus: bool = False
    off: float | None = None
    per_output: bool = False


@dataclass(frozen=True)
class Alternatives:
    """Search space of a setting that is one of several values.

    Args:
        values: Plain values, as a YAML file holds them.
    """

    values: tuple[Any, ...]


class Meaning(NamedTuple):
    """Metadata of a setting: unit, range, sentence.

    Attributes:
        text: A phrase with its noun: help of the option and row of the documentation's table.
        unit: SI unit; "1" for a pure number, "y" for that of the outputs.
        low: Least value.
        high: Largest value.
        above: Whether the value must be above `low`, not only equal to it.
        below: Whether the value must be below `high`.
        choices: What a setting that is no number may be.
        learners: Learners that have it.
        found: What takes the place of a value that nobody gave; empty: the default.
        search: Values that `tune` tries; None: it is not tuned.
        option: Word of the command line without its dashes, where it is not the name.
    """

    text: str
    unit: str = "1"
    low: float = -inf
    high: float = inf
    above: bool = False
    below: bool = False
    choices: tuple[Any, ...] = ()
    learners: tuple[str, ...] = FILTERS
    found: str = ""
    search: LogRange | Alternatives | None = None
    option: str = ""

    def check(self, name: str, value: Any) -> None:
        """Refuse a value out of range.

        Args:
            name: Of the setting.
            value: A number, several, or one of the choices.

        Raises:
            ParameterError: If it is out of range, no finite number or none of the choices.
        """
        if self.choices:
            if not isinstance(value, str | int) or value not in self.choices:
                raise ParameterError(name, f"one of {', '.join(map(str, self.choices))}", value)
            return
        numbers = _array(name, value)
        under = numbers <= self.low if self.above else numbers < self.low
        over = numbers >= self.high if self.below else numbers > self.high
        if (under | over | ~(abs(numbers) < inf)).any():
            kind = {"a": "", "at": "a number of "}.get(self.range.split()[0], "a number ")
            raise ParameterError(name, kind + self.range, value)

    @property
    def range(self) -> str:
        """Range of the value in words, such as "above 0 and at most 1"."""
        if self.choices:
            return ", ".join(map(str, self.choices))
        words = []
        if isfinite(self.low):
            words.append(f"{'above' if self.above else 'at least'} {self.low:g}")
        if isfinite(self.high):
            words.append(f"{'below' if self.below else 'at most'} {self.high:g}")
        return " and ".join(words) or "a finite number"


_MOST_SAMPLES = 1_000_000  # minutes of flapping; their arrays are made at once


def setting(default: Any, text: str, **meaning: Any) -> Any:
    """A field of a record of settings, described by a phrase with its noun; see `Meaning`."""
    return field(default=default, metadata={"meaning": Meaning(text, **meaning)})


def _positive(default: float | None, text: str, **meaning: Any) -> Any:
    """A field that is a number above zero, or several."""
    return setting(default, text, low=0.0, above=True, **meaning)


def _samples(default: int, text: str, low: int = 1, **meaning: Any) -> Any:
    """A field that is a number of samples."""
    return setting(default, text, unit="samples", low=low, high=_MOST_SAMPLES, **meaning)


def group(kind: type, text: str, **meaning: Any) -> Any:
    """A field that is a record of settings itself, or None where it is switched off."""
    return field(default=None, metadata={"meaning": Meaning(text, **meaning), "group": kind})


@dataclass(frozen=True)
class _Checked:
    """Record whose fields are made by `setting`: numbers out of range are refused.

    Several numbers, in whatever sequence, are kept as a tuple.
    """

    def __post_init__(self) -> None:
        for one in fields(self):
            value, kind = getattr(self, one.name), one.metadata.get("group")
            if getattr(value, "shape", None) == ():  # a number of NumPy
                object.__setattr__(self, one.name, value := value.item())
            if value is None:
                if one.default is not None:
                    raise ParameterError(one.name, one.metadata["meaning"].range, value)
            elif kind is not None:
                if not isinstance(value, kind):
                    raise ParameterError(one.name, f"{kind.__name__}(...) or None", value)
            elif one.name != "covariance":
                self._check_plain(one, value)

    def _check_plain(self, one: Field[Any], value: Any) -> None:
        """Refuse a value that is neither None nor a record."""
        if str(one.type).startswith("Numbers"):
            object.__setattr__(self, one.name, value := _plain_numbers(one.name, value))
        one.metadata["meaning"].check(one.name, value)
        if one.type == "int" and type(value) is not int:
            raise ParameterError(one.name, "a whole number", value)
        if str(one.type).startswith("float") and not (
            isinstance(value, int | float) and isfinite(value)
        ):
            raise ParameterError(one.name, "a finite number", value)


BLOCKS = ("full", "layer", "node")
"""Covariance structures of independent blocks of weights."""
OWN_BLOCKS: dict[str, Any] = {}
"""Structures that `register_blocks` added: functions that give the blocks, by name."""
Structure: TypeAlias = Literal["full", "layer", "node"]
Numbers: TypeAlias = float | tuple[float, ...]


@dataclass(frozen=True)
class Screening(_Checked):
    """Settings of the screening of samples.

    A channel whose innovation e is further off than c predicted standard deviations,
    c = `outlier_std`, has its noise raised until e is c standard deviations: its pull on the
    weights falls with 1 / e. One that moved before and repeats one value for `stuck_samples`
    samples is left out until it moves again; one that never moved is believed.

    Args:
        outlier_std: c, at least 2: of Gaussian innovations one in 1.7e6 is beyond 5.
        stuck_samples: Samples of one value before a channel is left out; more than a coarse
            sensor repeats itself in slow motion.

    Raises:
        ParameterError: If a number is out of its range.

    References:
        Chang (2014), Robust Kalman filtering based on Mahalanobis distance as outlier judging
        criterion, J. Geodesy 88.
    """

    outlier_std: float = setting(
        5.0, "Innovations beyond this many predicted standard deviations are down-weighted", low=2.0
    )
    stuck_samples: int = _samples(50, "Repeated values after which a channel is left out", low=2)


@dataclass(frozen=True)
class NoiseEstimation(_Checked):
    """Variances of the measurement as the innovations show them, channel by channel.

    R_k = a_k + b_k s_k^2 / <s_k^2>, with s_k the norm of the channel's row of the network's
    readout: in a strip network it goes with the dynamic pressure of the strips, in a dense one it
    is constant. After each sample a_k moves by a share, 1 / 10 at first and 1 / memory in the end,
    towards its expectation given the sample, a_k + a_k^2 ((P_yy^-1 e)_k^2 - (P_yy^-1)_kk), and
    b_k alike: a step of the EM algorithm, times R_k over the larger part, so that R_k as a whole
    moves by that share. Both stay positive. `measurement_std` is where it starts, half in
    each: rather too large than too small, as a covariance that shrank on too small a noise opens
    by forgetting only.

    Args:
        memory: Samples over which it is estimated; a wingbeat at least, better ten of them.

    Raises:
        ParameterError: If it is no integer of at least 10.

    References:
        Shumway & Stoffer (1982), An approach to time series smoothing and forecasting using the
        EM algorithm; Cappé & Moulines (2009), On-line expectation-maximization algorithm.
    """

    memory: int = _samples(
        200,
        "Memory over which the measurement noise is estimated",
        low=10,
        option="noise-memory",
    )


@dataclass(frozen=True)
class Misfit(_Checked):
    """Error of the model itself, as the data show it; see `learning/filters/misfit.py`.

    No model of the air is the air. Its error comes again with the same flow, so that it is
    correlated in time: the filter assumes a noise of that size over the time in which the
    outputs change, and states the interval that recent innovations had, wider where the flow
    leaves what was seen. The noise of the measurement itself is `measurement_std`.

    Args:
        floor: Least error that is assumed, over the standard deviation of each output.

    Raises:
        ParameterError: If it is not above 0.
    """

    floor: float = _positive(
        0.06,
        "Least error of the model that the filter assumes, over the deviation of each output",
        high=10.0,
        option="misfit",
    )


@dataclass(frozen=True)
class ChangeDetection(_Checked):
    """Settings of change detection: alarm rate and growth of the covariance.

    Where the innovations are white and Gaussian, a sample raises a false alarm with
    probability `false_alarm_rate` at most; after an alarm the test starts anew and is silent
    for window + reference samples.

    Args:
        false_alarm_rate: Of the test at each sample, between 0 and 1.
        window: Samples that are tested; a change is found about so many samples after it.
        reference: Samples before them that they are compared with; a flapping wing's
            innovations differ over the beat, so that one wingbeat is the least.
        reopening: Share s of the prior that comes back, P <- (1 - s) P + s P0, 0 < s <= 1.

    Raises:
        ParameterError: If a number is out of its range.
    """

    false_alarm_rate: float = _positive(
        1e-7, "False alarms per sample of the test for changes", high=1.0, below=True
    )
    window: int = _samples(
        100, "Window of recent samples that is tested for a change", option="change-window"
    )
    reference: int = _samples(
        1000,
        "Samples before the window that it is compared with, a wingbeat or more",
        option="change-reference",
    )
    reopening: float = _positive(
        1.0,
        "Share of the prior covariance that comes back after a change",
        high=1.0,
        option="change-reopening",
    )


@dataclass(frozen=True, kw_only=True)
class FilterSettings(_Checked):
    """Settings of a filter that learns weights.

    Between two samples P <- (1 - s) P / forgetting_factor + s P0 + Q, with s = prior_share, P0
    the covariance before any sample and Q = diag(process_std^2). Neglected: standard deviations
    that change with the state.

    Args:
        prior_std: Standard deviation of each weight before any sample, divided by sqrt(fan-in) of
            its neuron (biases: fan-in 1); one number or (n,) [1]; None: 1. Weights of which the
            network has its own (`GreyBox`) keep that; for a `LinearStripNetwork` the number is
            a factor on its own.
        measurement_std: Standard deviation of the measurement noise, one number or (n_y,) [y];
            None: a tenth of each output's scale at first, then as `noise_estimation` says.
        process_std: Standard deviation by which each weight wanders between two samples, one
            number or (n,) [1]; not divided by anything.
        spread: kappa, distance of the cubature points [standard deviations]; None is sqrt(n), the
            cubature rule, or 1 with a `prior_share`; `spread` has mean and covariance at any other.
        square_root: "transform" carries the square root through the update; "cholesky" is
            Algorithm 1 of the paper to rounding.
        dtype: Precision of the square root and of the points, "float64" or "float32"; the
            weights themselves and the algebra of y are double in both.
        forgetting_factor: Divides the covariance before each sample, 0 < factor <= 1.
        prior_share: Share of the covariance before any sample that is mixed in before each
            sample, 0 <= share < 1: a memory of 1 / share samples. Weights go back to the prior as
            their variance does.
        covariance: Structure of the covariance: "full", "layer" or "node".
        screening: How far samples are believed; None: as they are, if they are numbers.
        noise_estimation: How the variances of the measurement follow the innovations, from
            measurement_std on; None: it is known, or, where no measurement_std is given,
            estimated with the default memory.
        misfit: Error of the model itself, in addition to the measurement's noise; None: none.
        change_detection: When the covariance is opened anew; None: never.

    Raises:
        ParameterError: If a number is out of its range, "cholesky" is not of "full", or the noise
            is estimated and the misfit too.
    """

    prior_std: Numbers | None = _positive(
        None,
        "Standard deviation of each weight before any sample, before division by sqrt(fan-in)",
        found="1, or what the network states of its weights",
        search=LogRange(0.03, 3.0),
    )
    measurement_std: Numbers | None = _positive(
        None,
        "Standard deviation of the measurement noise: one number, or one for each output",
        unit="y",
        found="a tenth of each output's scale at first, then estimated from the innovations",
        search=LogRange(1e-5, 1.0, per_output=True),
    )
    process_std: Numbers = setting(
        0.0, "Standard deviation by which each weight wanders between two samples", low=0.0
    )
    spread: float | None = setting(
        None,
        "Cubature point spread, in standard deviations",
        found="the cubature rule's root of the number of weights, or 1 with a prior share",
        low=1e-6,
        high=1e6,
        learners=("cubature",),
        search=LogRange(0.3, 4.0),
    )
    square_root: str = setting(
        "transform",
        "Form of the square root: carried (transform) or factorized at each sample (cholesky)",
        choices=("transform", "cholesky"),
        learners=("cubature",),
    )
    dtype: str = setting(
        "float64",
        "Precision of the covariance's square root",
        choices=("float64", "float32"),
        learners=("cubature",),
    )
    forgetting_factor: float = _positive(
        1.0,
        "Factor that divides the covariance before each sample, so that old samples are forgotten",
        high=1.0,
        search=LogRange(1e-5, 0.1, one_minus=True, off=1.0),
    )
    prior_share: float = setting(
        0.0,
        "Share of the prior covariance that is mixed in before each sample",
        low=0.0,
        high=1.0,
        below=True,
        search=LogRange(1e-7, 0.01, off=0.0),
    )
    covariance: Structure = setting(
        "full",
        "Structure of the covariance that is kept: full, layer or node",
        search=Alternatives(BLOCKS),
    )
    screening: Screening | None = group(Screening, "Screening of outliers and stuck channels")
    noise_estimation: NoiseEstimation | None = group(
        NoiseEstimation,
        "Estimation of the measurement noise from the innovations",
        search=Alternatives((None, {"memory": 50}, {"memory": 200})),
    )
    misfit: Misfit | None = group(Misfit, "Error of the model itself, found from the data")
    change_detection: ChangeDetection | None = group(
        ChangeDetection, "Detection of changes, which opens the covariance anew"
    )

    def __post_init__(self) -> None:
        checked_structure(self.covariance)
        super().__post_init__()
        if self.misfit is not None and self.noise_estimation is not None:
            raise ParameterError(
                "noise_estimation", "None where misfit is given", self.noise_estimation
            )
        if self.square_root == "cholesky" and self.covariance != "full":
            raise ParameterError(
                "covariance", '"full" with square_root="cholesky"', self.covariance
            )

    def describe(self, learner: str = "cubature") -> dict[str, Any]:
        """Settings as JSON-able values, as a file holds them.

        Args:
            learner: Kind of the learner; settings of others are left out.
        """
        plain = {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}
        return {one.name: plain[one.name] for one in settings_of(learner)}

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> FilterSettings:
        """Inverse of `describe`.

        Args:
            description: Plain values by name; missing ones take their defaults.

        Raises:
            ParameterError: If a name is unknown or a value out of range.
        """
        known = {one.name: one for one in fields(cls)}
        check_names("settings", description, known, "names among", near=True)
        made = {name: _made(known[name], value) for name, value in description.items()}
        return cls(**made)


def leaves(record: type = FilterSettings, path: str = "") -> Iterator[tuple[str, Field[Any]]]:
    """Settings one by one, those of groups too: dotted name and field.

    Args:
        record: A record of settings.
        path: Dotted name of the record within another.
    """
    for one in fields(record):
        if "group" in one.metadata:
            yield from leaves(one.metadata["group"], f"{path}{one.name}.")
        else:
            yield f"{path}{one.name}", one


def settings_of(learner: str) -> list[Field[Any]]:
    """Fields of the settings that a learner has.

    Args:
        learner: Kind of the learner, one of `FILTERS`.
    """
    return [one for one in fields(FilterSettings) if learner in one.metadata["meaning"].learners]


def settings_from(learner: str, values: Mapping[str, Any]) -> FilterSettings:
    """Record of the settings of a learner from plain values.

    Args:
        learner: Kind of the learner, one of `FILTERS`.
        values: Values by name, as a file holds them; missing ones take their defaults.

    Raises:
        ParameterError: If the learner has no such setting, or a value is out of its range.
    """
    known = [one.name for one in settings_of(learner)]
    for name, value in values.items():
        if name not in known:
            inner = next(iter(value), name) if isinstance(value, Mapping) else name
            raise ParameterError(inner, f"nothing: the {learner} learner has none", value)
    return FilterSettings.from_description(values)


def chosen_settings(
    learner: str, settings: FilterSettings | None, given: Mapping[str, Any]
) -> FilterSettings:
    """Settings of a learner from a record and from values that override it.

    Args:
        learner: Kind of the learner, one of `FILTERS`.
        settings: The record; None: the defaults.
        given: Values by name of the setting.

    Raises:
        ParameterError: If a name is unknown to the learner or a value out of range.
    """
    known = [one.name for one in settings_of(learner)]
    check_names(f"{learner} learner", given, known, "settings among", near=True)
    own = FilterSettings() if settings is None else settings
    if type(own) is not FilterSettings:
        raise ParameterError("settings", "FilterSettings(...) or None", own)
    return replace(own, **given)


def learner_signature(learner: str) -> Signature:
    """Signature of the constructor of a learner, with every setting by its name.

    Args:
        learner: Kind of the learner, one of `FILTERS`.
    """
    either, named = Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY
    return Signature(
        [
            Parameter("network", either),
            Parameter("settings", either, default=None, annotation="FilterSettings | None"),
            *(
                Parameter(one.name, named, default=one.default, annotation=one.type)
                for one in settings_of(learner)
            ),
            Parameter("seed", named, default=0, annotation="int"),
        ]
    )


def arguments_text(learner: str) -> str:
    """Lines of a docstring without margin that explain the settings of a learner.

    Args:
        learner: Kind of the learner, one of `FILTERS`.
    """
    lines = []
    for one in settings_of(learner):
        meaning = one.metadata["meaning"]
        unit = "" if meaning.unit == "1" else f" [{meaning.unit}]"
        limits = "" if meaning.range == "a finite number" else f"; {meaning.range}"
        default = meaning.found or repr(one.default)
        text = f"{one.name}: {meaning.text}{unit}{limits}; {default} by default."
        lines.append(fill(text, 88, initial_indent=" " * 4, subsequent_indent=" " * 8))
    return "\n".join(lines)


def checked_structure(value: object) -> Structure:
    """A covariance structure as it is.

    Raises:
        ParameterError: If it is none.
    """
    if isinstance(value, str) and value in {*BLOCKS, *OWN_BLOCKS}:
        return value  # type: ignore[return-value]
    known = ", ".join(f'"{name}"' for name in (*BLOCKS, *sorted(OWN_BLOCKS)))
    raise ParameterError("covariance", f"one of {known}", value)


def _array(name: str, value: Any) -> Any:
    """Array of plain numbers."""
    from patagium.arrays import real_array  # NumPy is not for the help of the command line

    return real_array(name, value)


def _plain_numbers(name: str, value: Any) -> Numbers:
    """A scalar or vector as a number, or a tuple of numbers."""
    numbers = _array(name, value)
    if numbers.ndim == 0:
        return float(numbers)
    if numbers.ndim > 1:
        raise ShapeError(name, "() or (n,)", numbers.shape)
    return tuple(numbers.ravel().tolist())


def _made(one: Field[Any], value: Any) -> Any:
    kind = one.metadata.get("group")
    if kind is None or value is None or isinstance(value, kind):
        return value
    try:
        return kind(**value)
    except TypeError:
        names = ", ".join(inner.name for inner in fields(kind))
        raise ParameterError(one.name, f"none, or numbers for {names}", value) from None
