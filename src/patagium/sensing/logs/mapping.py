"""Mapping file of a log: the meaning, unit and axes of its columns or fields.

A mapping is a YAML file that a person writes next to a log. Units scale and axes turn; there are
no other expressions. `docs/logs.md` has an example for each kind of file.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    StrictBool,
    StrictInt,
    ValidationError,
    model_validator,
)

from patagium.arguments import checked
from patagium.errors import LogError, shown
from patagium.limits import YAML_TEXT
from patagium.reading import beside, parsed_yaml, refused, text_of
from patagium.robot.units import (
    PureNumber,
    pint_units,
    quantity_type,
    unit_for_pint,
    written_as_unit,
)
from patagium.sensing.logs.axes import AXES_WORDS, axes_of

_DERIVED = {
    "kg m/s^2": "N",
    "kg m^2/s^2": "N m",
    "kg m^2/s^3": "W",
    "kg/m/s^2": "Pa",
}
"""Usual names of the SI units of mechanics."""
_COUNTED = re.compile(r"(?:(?=[\d.]*[1-9])(\d*\.?\d+(?:[eE][-+]?\d{1,2})?)\s+)?(.*)", re.DOTALL)
"""A number that is not zero, where there is one, and a unit."""
_Rate: TypeAlias = quantity_type("Hz", "a rate")  # type: ignore[valid-type]
Rate: TypeAlias = Annotated[_Rate, Field(gt=0.0, lt=1e7)]


class _Words(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class StampColumn(_Words):
    """Column or field with stamps.

    Attributes:
        column: Its name.
        unit: Unit of the stamps, a time; if left out, that which the file states, else that of
            `time`, else s.
    """

    column: str = Field(min_length=1)
    unit: str | None = None


class TimeColumn(StampColumn):
    """Source of the stamps, and the time base of the import.

    Attributes:
        column: Name of the column or field with stamps; empty for the stamps of messages.
        base: Stamps of messages: those in their `header`, or the times at which they were
            `received`; None takes the header's where there is one.
        rate: Rate of the common time base, such as "200 Hz" [Hz].
        like: Topic whose stamps are the common time base.
        start: Time from the first sample before which samples are left out [s].
        end: Time from the first sample after which samples are left out [s].
        duplicates: Row that is kept of those with the same stamp, "keep-first" or "keep-last";
            None keeps the first and refuses a log in which most rows repeat a stamp.
        restamp: Rate at which the rows were sampled, such as "100 Hz"; or a rate for each topic
            or column of stamps. Rows are then taken as evenly spaced, and the stamps of the file
            serve only to find the first of them, gaps, and a rate that is not the stated one.
    """

    column: str = ""
    base: Literal["header", "received"] | None = None
    rate: Rate | None = None
    like: str | None = None
    start: PureNumber | None = None
    end: PureNumber | None = None
    duplicates: Literal["keep-first", "keep-last"] | None = None
    restamp: Rate | dict[str, Rate] | None = None

    @model_validator(mode="after")
    def _one_base(self) -> TimeColumn:
        if None not in (self.rate, self.like):
            raise ValueError("rate, like: expected one of the two")
        if self.start is not None and self.end is not None and not self.start < self.end:
            raise ValueError("start, end: expected start < end")
        if None not in (self.duplicates, self.restamp):
            raise ValueError("duplicates, restamp: expected one: restamp keeps every row")
        return self


class ValueColumn(_Words):
    """Quantity of the log: a number, a vector (with `frame`) or an attitude (with `order`).

    Attributes:
        column: Name of the column in a table, or the names of its components.
        topic: Topic of the messages that hold the quantity.
        field: Dotted path in the message, such as `position[2]`, or the paths of the components.
        stamp: Field with its stamps, if it is not that of `time`, or only the name of the field.
        name: Name in results; the name of the column or field if left out.
        unit: Unit of the numbers in the log; "1" for plain numbers.
        turn: Change after which the numbers of an encoder begin again, in the unit of the log; a
            whole turn of the angle if left out.
        as_unit: Unit that the model sees (key `as`); SI if left out.
        offset: Zero of the sensor, subtracted first, in the unit of the log; one number, or one
            for each component of a vector.
        negated: Whether the numbers have the opposite sign, such as the force of a robot on its
            load cell for that of the cell on the robot.
        range: Lowest and highest expected value, in the unit of the log. The network scales its
            inputs and outputs by it.
        frame: Axes of a vector, or world axes of an attitude: flu, nwu (ours), frd, ned, enu,
            rfu, or ours in terms of them such as "x, -y, -z".
        body: Body axes of an attitude.
        order: Components of an attitude: wxyz, xyzw, rpy (roll, pitch, yaw), rotvec (axis times
            angle), or matrix (nine entries row by row).
        inverted: Whether the attitude is that of the world in the body.
    """

    column: str | tuple[str, ...] = ""
    topic: str = ""
    field: str | tuple[str, ...] = ""
    stamp: StampColumn | None = None
    name: str = ""
    unit: str
    turn: Annotated[PureNumber, Field(gt=0.0)] | None = None
    as_unit: str | None = Field(default=None, alias="as")
    offset: PureNumber | tuple[PureNumber, PureNumber, PureNumber] = 0.0
    negated: StrictBool = False
    range: tuple[PureNumber, PureNumber] | None = None
    frame: str | None = None
    body: str | None = None
    order: Literal["wxyz", "xyzw", "rpy", "rotvec", "matrix"] | None = None
    inverted: StrictBool = False

    @model_validator(mode="before")
    @classmethod
    def _short_words(cls, words: Any) -> Any:
        if isinstance(words, dict) and isinstance(words.get("stamp"), str):
            words = {**words, "stamp": {"column": words["stamp"]}}
        if isinstance(words, dict) and words.get("order") in ("wxyz", "xyzw", "matrix"):
            return {"unit": "1", **words}
        return words

    @model_validator(mode="after")
    def _consistent(self) -> ValueColumn:
        """Refuse words of a column that do not go together."""
        if self.range is not None and not self.range[0] < self.range[1]:
            raise ValueError("range: expected [low, high] with low < high")
        if bool(self.column) == bool(self.field):
            raise ValueError("column, field: expected one of the two")
        if self.topic and self.column:
            raise ValueError("column: expected field to go with topic")
        for word, axes in (("frame", self.frame), ("body", self.body)):
            if axes is not None and axes_of(axes) is None:
                raise ValueError(f"{word}: expected {AXES_WORDS}")
        if self.order and not (self.frame and self.body):
            raise ValueError("order: expected frame (the world's axes) and body to go with it")
        if self.order and (self.as_unit or self.offset or self.range or self.negated):
            raise ValueError("order: an attitude has no as, offset, negated or range")
        if not self.frame and not isinstance(self.offset, float):
            raise ValueError("offset: expected one number; a vector (with frame) may have three")
        if self.size == 3 and not self.order and si_of(self.unit)[1] == "kg":
            raise ValueError("unit: no vector is a mass: expected g_0 (standard gravity) or gf")
        if self.turn is not None and self.size > 1:
            raise ValueError("turn: expected a single number, no vector or attitude")
        if not self.order and (self.body or self.inverted):
            raise ValueError("body, inverted: expected order to go with it: they are of attitudes")
        if not isinstance(self.source, str) and len(self.source) != self.size:
            raise ValueError(
                f"expected {self.size} name(s), for a number has one, a vector (with frame) "
                f"three, an attitude (with order) four, three or nine, found {len(self.source)}"
            )
        return self

    @property
    def source(self) -> str | tuple[str, ...]:
        """Name of the column or path of the field, or those of its components."""
        return self.column or self.field

    @property
    def size(self) -> int:
        """Number of components in the log: 1, 3, 4 or 9."""
        if self.order is not None:
            return {"rpy": 3, "rotvec": 3, "matrix": 9}.get(self.order, 4)
        return 1 if self.frame is None else 3

    @property
    def label(self) -> str:
        """Name in results."""
        if self.name or isinstance(self.source, str):
            return self.name or str(self.source).lstrip("/")
        return ",".join(self.source)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of its components in results."""
        parts = "wxyz" if self.order is not None else "xyz" if self.frame is not None else ""
        return tuple(f"{self.label}.{part}" for part in parts) or (self.label,)


class AirWords(_Words):
    """Air of a flight, for networks that compute the flow at the wings.

    Attributes:
        density: Air density [kg/m^3].
        wind: Wind velocity in our world axes, (3,) [m/s].
    """

    density: Annotated[PureNumber, Field(gt=0.0)] = 1.225
    wind: tuple[PureNumber, PureNumber, PureNumber] = (0.0, 0.0, 0.0)


class TableMapping(_Words):
    """Meaning of the columns of a table or the fields of a log.

    Attributes:
        about: Description of the log, its origin and its licence.
        time: Source of the stamps, and the time base of the import.
        inputs: Inputs of the network, in order.
        outputs: Outputs of the network, in order.
        channels: Further quantities to keep; `q.roll`, `v.roll`, `a.roll`, `u1.roll` ... of every
            coordinate make the log a flight of the robot.
        robot: Robot of a flight, a preset or a file; the path of a file is relative to the mapping
            file, else to the working folder.
        air: Air of a flight.
        gap: Length from which a time step is a gap, in median steps.
        skip_rows: Number of lines before the line of names of a CSV file; found if left out.
    """

    about: str = ""
    time: TimeColumn = TimeColumn()
    inputs: tuple[ValueColumn, ...] = ()
    outputs: tuple[ValueColumn, ...] = ()
    channels: tuple[ValueColumn, ...] = ()
    robot: str | None = None
    air: AirWords = AirWords()
    gap: Annotated[PureNumber, Field(gt=1.0)] = 3.0
    skip_rows: Annotated[StrictInt, Field(ge=0)] | None = None

    @model_validator(mode="after")
    def _distinct(self) -> TableMapping:
        if bool(self.inputs) != bool(self.outputs) or not self.columns:
            missing = "outputs" if self.inputs else "inputs"
            raise ValueError(f"{missing}: expected at least one, or channels alone")
        labels = [label for column in self.columns for label in column.labels]
        twice = sorted({label for label in labels if labels.count(label) > 1})
        if twice:
            raise ValueError(f"name: expected different names, found {', '.join(twice)} twice")
        return self

    @property
    def columns(self) -> tuple[ValueColumn, ...]:
        """All quantities: inputs, outputs, channels."""
        return (*self.inputs, *self.outputs, *self.channels)


@checked
def load_mapping(path: str | Path) -> TableMapping:
    """Validated mapping of a YAML file.

    Raises:
        LogError: If the file cannot be read, or is no mapping.
    """
    file = Path(path)
    text = text_of(file, YAML_TEXT)
    mapping = parse_mapping(parsed_yaml(text, str(file)), str(file), text)
    robot = mapping.robot and beside(file, mapping.robot)
    return mapping.model_copy(update={"robot": robot})


def parse_mapping(words: Any, source: str = "mapping", text: str = "") -> TableMapping:
    """Validated mapping from the content of a YAML file.

    Args:
        words: Content of the file.
        source: Name of the file in messages.
        text: Text of the file, for the numbers of lines in messages.

    Raises:
        LogError: If the content is no mapping; the message has one line for each problem.
    """
    try:
        mapping = TableMapping.model_validate(words)
    except ValidationError as problem:
        raise refused(source, problem.errors(), TableMapping, text) from None
    for stamp in (mapping.time, *(one.stamp for one in mapping.columns if one.stamp)):
        conversion(stamp.unit or "s", "s", f"{source}: time ({stamp.column})")
    for column in mapping.columns:
        conversion(column.unit, column.as_unit, f"{source}: {column.label}")
    return mapping


def conversion(unit: str, target: str | None, where: str) -> tuple[float, str]:
    """Factor from one unit to another, and the name of the other.

    Args:
        unit: Unit of the numbers, or so many of it: "0.02 deg" behind a gear of 50.
        target: Unit of the result; None for SI.
        where: Place of the unit in messages.

    Raises:
        LogError: If a unit is unknown, or the two do not measure the same quantity.
    """
    from pint import DimensionalityError

    size, plain = _COUNTED.fullmatch(unit).groups()  # type: ignore[union-attr]
    known = _unit(plain, where)
    wanted = None if target is None else _unit(target, where)
    numbers = [pint_units().Quantity(number, known) for number in (0.0, 1.0)]
    try:
        zero, one = (n.to_base_units() if wanted is None else n.to(wanted) for n in numbers)
    except DimensionalityError as problem:
        expected = f"a unit of {_dimension(problem.dim2)} such as {target!r}"
        found = f"{unit!r}, which is of {_dimension(problem.dim1)}"
        raise LogError(where, expected, found) from problem
    if zero.magnitude != 0.0:
        raise LogError(where, "a unit that only scales", f"{unit!r}")
    written = f"{one.units:~}".replace(" ** ", "^").replace(" * ", " ").replace(" / ", "/")
    return float(size or 1) * float(one.magnitude), _DERIVED.get(written, written) or "1"


def si_of(unit: str) -> tuple[float, str]:
    """Factor from a unit to SI, and the SI unit; 1 and nothing for a unit that is not known."""
    try:
        return conversion(unit, None, unit)
    except LogError:
        return 1.0, ""


def _unit(text: str, where: str) -> Any:
    try:
        plain = unit_for_pint("" if text.strip() == "1" else text)
        if plain and not written_as_unit(plain):
            raise ValueError("no unit is written like this")
        return pint_units().Unit(plain)
    except Exception as problem:  # pint raises its own, tokenize's and Python's for bad text
        raise LogError(
            f"{where}: expected a unit such as 'm/s^2', 'deg/s', 'g_0' or '1', or a number of one "
            f"such as '0.02 deg', found {shown(text)}"
        ) from problem


def _dimension(dimension: Any) -> str:
    return str(dimension).replace("dimensionless", "plain numbers")
