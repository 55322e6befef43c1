"""Row of the bench: a figure of ours, and the figure of a rival."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Result:
    """A figure of ours, and its ratio to a rival's figure of the same run.

    Attributes:
        name: What was measured.
        value: Our figure; None where the note says why a rival is left out.
        unit: Its unit.
        against: The rival; None where the figure stands alone.
        ratio: Our figure divided by the rival's: below one we are faster.
        note: How the rival was made, and whether the numbers agree.
        against_value: The rival's figure, in the same unit.
    """

    name: str
    value: float | None
    unit: str
    against: str | None = None
    ratio: float | None = None
    note: str = ""
    against_value: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """The row as JSON-able values."""
        return asdict(self)


def compared(
    name: str, value: float, unit: str, against: str, against_value: float, note: str = ""
) -> Result:
    """Row of a figure of ours beside a rival's.

    Args:
        name: What was measured.
        value: Our figure.
        unit: Unit of both.
        against: The rival.
        against_value: Its figure.
        note: How the rival was made.
    """
    return Result(name, value, unit, against, value / against_value, note, against_value)
