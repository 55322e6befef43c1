"""The words of a mapping file: which column of a table is what, in which unit.

A mapping is a YAML file that a person writes beside a log. Units scale a column;
there are no expressions: a quantity that has to be computed belongs to the program
that wrote the table.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from patagium.errors import LogError

_UNIT = re.compile(r"[A-Za-z0-9_µ°·*/^(). -]{0,40}")
_HIGH_POWER = re.compile(r"(?:\^|\*\*)\s*\(?\s*-?\d{2,}")
_DERIVED = {
    "kg m/s^2": "N",
    "kg m^2/s^2": "N m",
    "kg m^2/s^3": "W",
    "kg/m/s^2": "Pa",
}
"""How a person writes the SI units of mechanics."""


class _Words(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class TimeColumn(_Words):
    """The column that holds time.

    Attributes:
        column: Its name in the table.
        unit: Its unit, a time.
    """

    column: str
    unit: str = "s"


class ValueColumn(_Words):
    """A column that is an input or an output.

    Attributes:
        column: Its name in the table.
        name: Its name in results; the column's name when left out.
        unit: Unit of the numbers in the table; "1" for plain numbers.
        as_unit: Unit the model shall see (key `as`); SI when left out.
        offset: Subtracted first, in the unit of the table (a sensor's zero).
        range: Lowest and highest value to expect, in the unit of the table. The network
            scales by it, so that it need not look ahead in the log.
    """

    column: str
    name: str = ""
    unit: str
    as_unit: str | None = Field(default=None, alias="as")
    offset: float = 0.0
    range: tuple[float, float] | None = None

    @model_validator(mode="after")
    def _ordered(self) -> ValueColumn:
        if self.range is not None and not self.range[0] < self.range[1]:
            raise ValueError("range: expected [low, high] with low < high")
        return self

    @property
    def label(self) -> str:
        """Name in results."""
        return self.name or self.column


class TableMapping(_Words):
    """What the columns of a table mean.

    Attributes:
        about: What the table is, where it comes from, its licence; in words.
        time: The column that holds time.
        inputs: What the network sees, in order.
        outputs: What it predicts, in order.
        gap: A time step longer than this many medians is a gap.
    """

    about: str = ""
    time: TimeColumn
    inputs: Annotated[tuple[ValueColumn, ...], Field(min_length=1)]
    outputs: Annotated[tuple[ValueColumn, ...], Field(min_length=1)]
    gap: Annotated[float, Field(gt=1.0)] = 3.0

    @model_validator(mode="after")
    def _distinct(self) -> TableMapping:
        labels = [column.label for column in (*self.inputs, *self.outputs)]
        twice = sorted({label for label in labels if labels.count(label) > 1})
        if twice:
            raise ValueError(f"name: expected different names, found {', '.join(twice)} twice")
        return self


def load_mapping(path: str | Path) -> TableMapping:
    """A mapping file, validated.

    Args:
        path: A YAML file.

    Raises:
        LogError: If it cannot be read, or does not say what is needed.
    """
    file = Path(path)
    try:
        words = yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as problem:
        raise LogError(f"{file}: cannot be read: {problem.strerror}") from problem
    except yaml.YAMLError as problem:
        raise LogError(f"{file}: expected YAML, found: {problem}") from problem
    return parse_mapping(words, str(file))


def parse_mapping(words: Any, source: str = "mapping") -> TableMapping:
    """A mapping from the plain dict of a YAML file.

    Args:
        words: What the YAML holds.
        source: Named in messages.

    Raises:
        LogError: One line a problem: where in the file, what is wrong, what was found.
    """
    try:
        mapping = TableMapping.model_validate(words)
    except ValidationError as problem:
        raise LogError("\n".join(_line(source, error) for error in problem.errors())) from None
    conversion(mapping.time.unit, "s", f"{source}: time ({mapping.time.column})")
    for column in (*mapping.inputs, *mapping.outputs):
        conversion(column.unit, column.as_unit, f"{source}: {column.column}")
    return mapping


def conversion(unit: str, target: str | None, where: str) -> tuple[float, str]:
    """The factor from one unit to another, and the name of the other.

    Args:
        unit: Unit of the numbers.
        target: Unit wanted; None for SI.
        where: Named in messages.

    Raises:
        LogError: If a unit is unknown, or the two do not measure the same quantity.
    """
    from pint import DimensionalityError

    known = _unit(unit, where)
    wanted = None if target is None else _unit(target, where)
    numbers = [_registry().Quantity(number, known) for number in (0.0, 1.0)]
    try:
        zero, one = (n.to_base_units() if wanted is None else n.to(wanted) for n in numbers)
    except DimensionalityError as problem:
        raise LogError(
            f"{where}: expected a unit of {_dimension(problem.dim2)} such as {target!r}, "
            f"found {unit!r}, which is of {_dimension(problem.dim1)}"
        ) from problem
    if zero.magnitude != 0.0:
        raise LogError(f"{where}: expected a unit that only scales, found {unit!r}")
    return float(one.magnitude), _written(f"{one.units:~}")


@cache
def _registry() -> Any:
    import pint  # a fifth of a second: only where a table is read

    return pint.UnitRegistry()


def _unit(text: str, where: str) -> Any:
    try:
        if not _UNIT.fullmatch(text) or _HIGH_POWER.search(text):
            raise ValueError("no unit is written like this")
        return _registry().Unit("" if text.strip() == "1" else text)
    except Exception as problem:  # pint raises its own, tokenize's and Python's for bad text
        raise LogError(
            f"{where}: expected a unit such as 'm/s^2', 'deg/s', 'g_0' or '1', found {text!r}"
        ) from problem


def _written(unit: str) -> str:
    plain = unit.replace(" ** ", "^").replace(" * ", " ").replace(" / ", "/")
    return _DERIVED.get(plain, plain) or "1"


def _dimension(dimension: Any) -> str:
    return str(dimension).replace("dimensionless", "plain numbers")


def _line(source: str, error: Any) -> str:
    where = ".".join(str(part) for part in error["loc"]) or "file"
    kind, words = error["type"], error["msg"].removeprefix("Value error, ")
    if kind == "extra_forbidden":
        return f"{source}: {where}: unknown key"
    if kind == "missing":
        return f"{source}: {where}: expected, but not there"
    return f"{source}: {where}: {words}, found {error['input']!r}"
