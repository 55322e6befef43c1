"""Outputs of a verb that do not cost each other: one that fails is told, the others are written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import typer

from patagium.errors import PatagiumError


class Outputs:
    """Outputs of a verb, each written whatever becomes of the others.

    Attributes:
        failures: Number of failures by the name of the output.
    """

    def __init__(self) -> None:
        self.failures: Counter[str] = Counter()
        self._first: Exception | None = None

    def attempt(self, name: str, write: Callable[[], object]) -> bool:
        """Whether an output was written; its first failure is told on stderr, all are counted.

        Args:
            name: Name of the output, for messages.
            write: Function that writes it; Ctrl-C ends it alone.
        """
        try:
            write()
        except KeyboardInterrupt:
            reason = "interrupted"
        except Exception as problem:
            known = isinstance(problem, (PatagiumError, OSError))
            reason = str(problem) if known else f"{type(problem).__name__}: {problem}"
            self._first = self._first or problem
        else:
            return True
        self.failures[name] += 1
        if self.failures[name] == 1:
            typer.echo(f"patagium: {name}: {reason}", err=True)
        return False

    def check(self) -> None:
        """End the verb with what was not saved, if there is such a thing.

        Raises:
            PatagiumError: If an output failed.
        """
        if self.failures:
            lost = ", ".join(
                name if count == 1 else f"{name} (failed {count} times)"
                for name, count in self.failures.items()
            )
            raise PatagiumError(f"not saved: {lost}; all else was") from self._first
