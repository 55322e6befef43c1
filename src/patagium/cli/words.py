"""Parts that all verbs share: quantities with units, progress on stderr, answers on stdout."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import degrees
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from patagium.errors import LogError, ParameterError, PatagiumError
from patagium.limits import TURN
from patagium.reading import json_ready, regular_file

if TYPE_CHECKING:
    import xarray as xr

    from patagium.learning.model_file import Model
    from patagium.report import Table


class Vector(NamedTuple):
    """Three components along x, y, z."""

    x: float
    y: float
    z: float


class WholeNumbers(tuple[int, ...]):
    """Positive whole numbers in order; no tuple to typer, which would want its length."""


class Numbers(tuple[float, ...]):
    """Numbers in order, which typer takes for one value and not for several."""


Progress = Callable[[int, int], None]
MEANING = "that says what the columns mean, which patagium inspect {} lists"
"""Description of a mapping, for messages."""
_UNIT = re.compile(r"_(m_s|J_m|deg_s|rad_s|Hz|deg|rad|W|SI|s)$")
BETWEEN_LINES = 10.0
"""Time between two lines of progress where stderr is no terminal [s]."""


def quantity(unit: str, noun: str = "", most: float = TURN) -> Callable[[str], float]:
    """A reader of quantities such as "5 Hz" or, bare, in SI.

    Args:
        unit: SI unit wanted.
        noun: Noun with its article, for the message; empty: that of the unit.
        most: Magnitude beyond which an angle needs a unit [rad].
    """

    def read(text: str) -> float:
        from patagium.robot.units import UnitMismatch, in_si

        try:
            return in_si(text, unit, noun, most)
        except UnitMismatch as error:
            raise typer.BadParameter(str(error)) from None

    read.__name__ = unit or "NUMBER"
    return read


FLIGHT = Path("flight.nc")
"""Flight that simulate writes and the verbs after it read, where none is named."""


def vector(unit: str) -> Callable[[str], Vector]:
    """A reader of three quantities such as "-3,0,0 m/s"; a last unit holds for all.

    Args:
        unit: SI unit wanted.
    """
    one = quantity(unit)

    def read(text: str) -> Vector:
        parts = parts_of(text)
        if len(parts) != 3:
            raise typer.BadParameter(f"expected three numbers such as -3,0,0, found {text!r}")
        return Vector(*map(one, parts))

    read.__name__ = "X,Y,Z"
    return read


def parts_of(text: str, between: str = ",") -> list[str]:
    """Quantities of a text such as "1,2 m"; a last unit holds for all."""
    parts = [part.strip() for part in text.split(between)]
    last = parts[-1].partition(" ")[2]
    return [part if " " in part else f"{part} {last}".strip() for part in parts]


def numbers(text: str) -> Numbers:
    """Numbers such as "0.003" or "0.003,0.01"."""
    try:
        return Numbers(float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"expected numbers such as 0.003,0.01, found {text!r}") from None


def whole_numbers(text: str) -> WholeNumbers:
    """Positive whole numbers such as "8,8"."""
    try:
        found = WholeNumbers(int(part) for part in text.split(","))
    except ValueError:
        found = WholeNumbers()
    if not found or min(found) < 1:
        raise typer.BadParameter(f"expected positive whole numbers such as 8,8, found {text!r}")
    return found


def named_quantities(
    option: str, words: Sequence[str], unit: str | Callable[[str], str], noun: str = ""
) -> dict[str, float]:
    """Values by name, in SI, from words such as "feather=30 deg".

    Args:
        option: Option of the words, for the message.
        words: Words NAME=VALUE.
        unit: SI unit wanted, or that of a name.
        noun: Noun with its article, for the message; empty: an angle or a length, by its unit.

    Raises:
        ParameterError: If a word is not NAME=VALUE, or a name comes twice.
    """
    from patagium.robot.units import UnitMismatch, in_si

    values: dict[str, float] = {}
    told = noun or "an angle or a length"
    for word in words:
        name, equals, value = (part.strip() for part in word.partition("="))
        if not (name and equals and value):
            expected = f"NAME=VALUE with {told}, such as {name or 'plunge'}=0.5"
            raise ParameterError(option, expected, word)
        if name in values:
            raise ParameterError(option, f"{name} once", word)
        try:
            wanted = unit if isinstance(unit, str) else unit(name)
            values[name] = in_si(value, wanted, noun)
        except UnitMismatch as error:
            raise PatagiumError(f"{option} {name}: {error}") from None
    return values


@contextmanager
def progress_bar(label: str) -> Iterator[Progress]:
    """Bar on stderr while a verb works; called with the work done and the work in all.

    Where stderr is no terminal, work that takes long is told by one line in some seconds.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield _progress_lines(label)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _progress_lines(label: str) -> Progress:
    """Progress as lines on stderr, one in `BETWEEN_LINES` seconds at most."""
    started = told = monotonic()

    def show(done: int, total: int) -> None:
        nonlocal told
        now = monotonic()
        if now - told >= BETWEEN_LINES:
            tell(f"{label}: {done / max(total, 1):.0%} after {now - started:.0f} s")
            told = now

    return show


def answer(facts: dict[str, Any], *, as_json: bool, title: str = "") -> None:
    """Facts on stdout: a table for a person, or one JSON object for a program."""
    if as_json:
        say_json(facts)
        return
    from patagium.report.page import Table

    show_table(Table(("quantity", "value"), [*for_person(facts).items()], title))


def for_person(facts: dict[str, Any]) -> dict[str, Any]:
    """Facts by their headings, angles in degrees."""
    told = {}
    for name, value in facts.items():
        turned = re.search(r"_rad(_s)?$", name) and isinstance(value, float)
        key = name.replace("_rad", "_deg") if turned else name
        told[heading(key)] = degrees(value) if turned else _plain(value)
    return told


def heading(name: str) -> str:
    """Heading of a fact: `turn_rate_rad_s` is `turn rate [rad/s]`."""
    unit = _UNIT.search(name)
    said = name[: unit.start() if unit else None].replace("_", " ")
    return f"{said} [{unit[1].replace('_', '/')}]" if unit else said


def only_given(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values that were given: those that are not None."""
    return {name: value for name, value in values.items() if value is not None}


def say_next(*commands: str) -> None:
    """Line on stdout with the commands that come next."""
    typer.echo(f"Next: {', or '.join(commands)}")


def tell(words: str) -> None:
    """Line of text on standard error, where messages go that are no result."""
    typer.echo(words, err=True)


def warn(words: str) -> None:
    """Tell a person what is amiss, as the program's own words."""
    tell(f"patagium: {words}")


def say_json(value: Any) -> None:
    """A value as JSON on stdout."""
    typer.echo(json_text(value))


def json_text(value: Any) -> str:
    """A value as JSON; numbers that are not finite become null."""
    return json.dumps(json_ready(value), indent=2, ensure_ascii=False)


def show_table(table: Table, *, err: bool = False) -> None:
    """A table on stdout, or stderr, as wide as its text when that is no terminal."""
    from rich.console import Console
    from rich.table import Table as RichTable

    shown = RichTable(title=table.caption or None, title_justify="left", box=None, pad_edge=False)
    rows = table.texts()
    for index, column in enumerate(table.columns):
        longest = max((len(row[index]) for row in rows), default=0)
        if table.numeric(index):  # a narrow terminal folds heads and sentences, and cuts nothing
            shown.add_column(column, justify="right", min_width=longest, overflow="fold")
        else:
            shown.add_column(column, no_wrap=longest <= 20, overflow="fold")
    for row in rows:
        shown.add_row(*row)
    place = sys.stderr if err else sys.stdout
    width = None if place.isatty() else 200
    Console(file=place, width=width, highlight=False, markup=False).print(shown, crop=False)


existing = regular_file


def model_for(path: Path, flight: xr.Dataset) -> Model:
    """Learned model of a file; what it did not learn of a flight goes to stderr."""
    from patagium.learning.model_file import load_model
    from patagium.learning.samples import in_flight

    model = load_model(existing(path))
    for words in in_flight(model, flight)[1]:
        tell(words)
    return model


def flight_file(path: Path) -> Path:
    """Path of a flight that exists.

    Raises:
        LogError: If it is a robot's, or none.
    """
    return existing(no_robot(path))


def no_robot(path: Path) -> Path:
    """Path that is not a robot's, a model's or the like, which is refused with what takes it.

    Raises:
        LogError: If it is one, or the usual flight, not made yet.
    """
    from patagium.netcdf_file import kind_of
    from patagium.robot import preset_names

    if path == FLIGHT and not path.exists():
        raise LogError(path, "a flight", "none; make it: patagium simulate aerobat")
    kind = f"a robot; fly it first: patagium simulate {path}"
    kind = kind if str(path) in preset_names() else kind_of(path)
    if kind.startswith(("a robot", "a mapping", "a learne", "predictions", "settings")):
        raise LogError(path, "a flight or log", kind)
    return path


def _plain(value: Any) -> Any:
    from patagium.report.page import cell_text

    if isinstance(value, (list, tuple)):
        return ", ".join(cell_text(_plain(one)) for one in value)
    return value
