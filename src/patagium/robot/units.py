"""Quantities as a person writes them: numbers with a unit, or bare SI numbers.

Units live at the border only: inside the package every number is SI and every
angle is in radians. Offset units (degrees Celsius)
and logarithmic ones are not known.
"""

# mypy: disable-error-code="valid-type"
from __future__ import annotations

import math
import re
from functools import cache, lru_cache
from typing import Annotated, Any, TypeAlias

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from patagium.errors import shown
from patagium.limits import LARGEST, QUANTITY, SWING, TILT, TURN, UNIT

_WRITTEN = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*", re.DOTALL)
_COMMA = re.compile(r"[^,.]*\d,\d++(?!\.)[^,]*")
_NAME = r"[A-Za-zµμ°][A-Za-z0-9_µμ°]*+"
_EXPONENT = r"[+-]?\d(?:\.\d{1,2}|/\d)?"
_POWER = rf"(?:\^|\*\*)\s*+(?:{_EXPONENT}|\(\s*{_EXPONENT}\s*\))(?!\d|\.\d|\s*(?:\^|\*\*))"
_RAISED = re.compile(r"\)\s*(?:\^|\*\*)")
_TORQUE = re.compile(r"\b([kMmuµ]?N)([cm]?m)(s?)\b(\s*(?:\^|\*\*)\s*\d)?")
_TRAPS = {"gr": "g", "Mm": "mm", "Mg": "mg", "Ms": "ms"}
"""Units that hardly anybody means (grain, megameter), and those of the same kind that are meant."""
_DIGIT = re.compile(r"(?<![\w^])([A-Za-z]{1,4})([234])\b")
_DOT = re.compile(r"(?<=[\w)])\.(?=[^\W\d]|\()")
_COMMON = {
    **{("cm", "m"): 0.01, ("mm", "m"): 0.001, ("g", "kg"): 0.001, ("mg", "kg"): 1e-6},
    **{("ms", "s"): 0.001, ("g mm^2", "kg m^2"): 1e-9},
    **{("deg", "rad"): math.pi / 180, ("deg/s", "rad/s"): math.pi / 180},
}
"""Factors of what robot files are mostly written in: pint takes half a second to load."""
_UNIT = re.compile(rf"(?:(?:{_NAME}|\))\s*+(?:{_POWER})?+|1\s*+/|[\s*/·.(])*+")


class UnitMismatch(ValueError):
    """A quantity of another kind than the one wanted.

    Args:
        expected: What was wanted, in words.
        found: What was written.
    """

    def __init__(self, expected: str, found: str) -> None:
        super().__init__(f"expected {expected}, found {found}")
        self.expected, self.found = expected, found


def in_si(written: object, unit: str, noun: str = "", most: float = TURN) -> float:
    """The SI value of a quantity as written in a file.

    Args:
        written: A number (already SI) or text such as "12 cm".
        unit: SI unit wanted, such as "kg m^2"; "" for a pure number.
        noun: What it is, for the message; empty: that of the unit.
        most: Magnitude beyond which an angle without a unit is refused [rad].

    Returns:
        Value [unit].

    Raises:
        UnitMismatch: If it is no number below 1e30, has another dimension, or seems to be degrees.
    """
    expected = f"{noun or _NOUNS[unit]} such as {_EXAMPLES.get(unit, f'1 {unit}')!r}"
    expected += f", or a number [{unit}]" if unit else ""
    if isinstance(written, bool) or not isinstance(written, (int, float, str)):
        raise UnitMismatch(expected, shown(written))
    value, label = _parts(written, expected)
    if label:
        value *= _factor(label, unit, expected, shown(written))
    if not abs(value) <= LARGEST:
        finite = "finite and " * (not math.isfinite(value))
        raise UnitMismatch(f"{expected}, {finite}below {LARGEST:g}", shown(written))
    if unit == "rad" and not label and abs(value) > most:
        seen = f"{value:g}, which is {spoken(unit, value)} without a unit"
        raise UnitMismatch(expected, f"{seen}; write '{value:g} deg' or '{value:g} rad'")
    return value


def spoken(unit: str, *values: float) -> str:
    """One value [unit] or several for a person, angles in degrees: "-50 to 60 deg"."""
    factor, name = as_read(unit)
    return f"{' to '.join(f'{factor * k:.4g}' for k in values)} {name}"


def as_read(unit: str) -> tuple[float, str]:
    """Factor from an SI unit to the unit that a person reads, degrees for radians, and its name."""
    return (180 / math.pi, f"deg{unit[3:]}") if unit.startswith("rad") else (1.0, unit)


def meant(*angles: float) -> str:
    """Question after angles [rad] of a program that seem to be degrees, or nothing."""
    far = max(angles, key=abs)
    return f"; are degrees meant? np.radians({far:g})" if abs(far) > SWING else ""


def _parts(written: float | str, expected: str) -> tuple[float, str]:
    if not isinstance(written, str):
        try:
            return float(written), ""
        except OverflowError:
            raise UnitMismatch(expected, "a number too large for a float") from None
    match = _WRITTEN.fullmatch(written) if len(written) <= QUANTITY else None
    if match is None:
        raise UnitMismatch(expected, shown(written))
    if _COMMA.fullmatch(written):
        raise UnitMismatch(expected, f"{shown(written)}; write {written.replace(',', '.')!r}")
    return float(match[1]), match[2]


def _factor(label: str, unit: str, expected: str, found: str) -> float:
    """Factor from a unit as written to the one wanted."""
    if common := _COMMON.get((label, unit), float(label == unit)):
        return common
    plain = re.sub(r"^1\s*/", "1/", unit_for_pint(label))  # no other unit starts with a number
    if not unit or not written_as_unit(plain):
        raise UnitMismatch(expected, found)
    trap = next((k for k in re.findall(r"[A-Za-z]+", plain) if k in _TRAPS), "")
    if trap:
        raise UnitMismatch(expected, f"{found}; did you mean {_TRAPS[trap]}?")
    try:
        base, wanted = _base(plain), _base(unit)
    except Exception:
        raise UnitMismatch(expected, f"{found} (unknown unit {label!r})") from None
    turns, wanted_turns = (dict(k.unit_items()).get("radian", 0) for k in (base, wanted))
    if base.dimensionality != wanted.dimensionality or turns != wanted_turns > 0:
        kind = f"of dimension {base.dimensionality}" if base.dimensionality else "a pure number"
        raise UnitMismatch(expected, f"{found}, {kind}")
    cycle = (2 * math.pi) ** turns if "Hz" in unit else 1.0  # 60 rpm are 1 Hz
    return float(base.magnitude) / (float(wanted.magnitude) * cycle)


@lru_cache
def _base(unit: str) -> Any:
    return pint_units().Quantity(1.0, unit).to_base_units()


def written_as_unit(text: str) -> bool:
    """Whether a text is written as a unit: names with powers of one digit, and few of them.

    Args:
        text: A text such as "kg m/s^2"; what it means is not looked at.
    """
    few = len(text) <= UNIT and len(_RAISED.findall(text)) < 2
    return few and _UNIT.fullmatch(text) is not None


def unit_for_pint(text: str) -> str:
    """Unit in the spelling that pint reads: `Nm` is a unit of yarn to it, `N.m` and `m/s2` unknown.

    Args:
        text: A text such as "mNm", "N.m", "m/s2" or "m/s²".
    """
    raised = _DOT.sub("*", text.translate({ord("²"): "^2", ord("³"): "^3"}))
    return _TORQUE.sub(r"(\1 \2 \3\4)", _DIGIT.sub(r"\1^\2", raised))


@cache
def pint_units() -> Any:
    """Registry of units of the library pint, created at the first call."""
    import pint  # a fifth of a second: only where a unit is written

    return pint.UnitRegistry()


_NOUNS = {
    "": "a pure number", "m": "a length", "kg": "a mass", "s": "a time", "rad": "an angle",
    "Hz": "a frequency", "m/s": "a speed", "m/s^2": "an acceleration",
    "rad/s": "a rate of turning", "kg/m^3": "a density", "kg m^2": "a moment of inertia",
    "N m^2": "a stiffness of a beam", "N s/m": "a damping", "N m s/rad": "a damping",
    "N/m": "a stiffness", "N m/rad": "a stiffness",
}  # fmt: skip
"""Noun of a quantity with its article, for messages, by its SI unit."""
_EXAMPLES = {
    "m": "12 cm",
    "kg": "20 g",
    "rad": "5 deg",
    "Hz": "15 Hz",
    "m/s": "3 m/s",
    "m/s^2": "9.8 m/s^2",
    "kg m^2": "4.8 g cm^2",
    "N m s/rad": "0.01 N m s/rad",
    "N s/m": "0.1 N s/m",
    "": "0.5",
}


def quantity_type(unit: str, noun: str = "", most: float = TURN) -> Any:
    """Pydantic field type of a quantity: text with a unit in, an SI float out."""
    convert = BeforeValidator(lambda written: si_at(written, unit, "", noun, most))
    return Annotated[float, convert, Field(examples=[_EXAMPLES.get(unit, f"1 {unit}")])]


def si_at(written: object, unit: str, at: str, noun: str = "", most: float = TURN) -> float:
    """SI value of a quantity below a key of a file; else the error that pydantic carries."""
    try:
        return in_si(written, unit, noun, most)
    except UnitMismatch as error:
        raise mismatch(error.expected, error.found, at) from None


def mismatch(expected: str, found: str, at: str = "") -> PydanticCustomError:
    """The error that pydantic carries to the message of a robot file."""
    evidence = {"expected": expected, "found": found, "at": at}
    return PydanticCustomError("mismatch", "expected {expected}, found {found}", evidence)


Length: TypeAlias = quantity_type("m")
Mass: TypeAlias = quantity_type("kg")
Angle: TypeAlias = quantity_type("rad", most=SWING)
Tilt: TypeAlias = quantity_type("rad", most=TILT)
Speed: TypeAlias = quantity_type("m/s")
Frequency: TypeAlias = quantity_type("Hz")
SlidingDamping: TypeAlias = quantity_type("N s/m")
TurningDamping: TypeAlias = quantity_type("N m s/rad")
Duration: TypeAlias = quantity_type("s")
Acceleration: TypeAlias = quantity_type("m/s^2")
Inertia: TypeAlias = quantity_type("kg m^2")
BeamStiffness: TypeAlias = quantity_type("N m^2")
PureNumber: TypeAlias = quantity_type("")
NumberInSI: TypeAlias = quantity_type("", "a number in SI units")
