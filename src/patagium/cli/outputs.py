"""Output files of a command: the error of one is printed, and the others are still written."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer.models import ArgumentInfo
from typer.utils import get_params_from_function

from patagium.cli.interruption import stop_repeating
from patagium.cli.words import answer, warn
from patagium.errors import ParameterError, PatagiumError
from patagium.whole_file import placed

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def check_files(verb: Callable[..., object], given: Mapping[str, Any]) -> None:
    """Refuse outputs that would fail, or replace another file of the verb, before it works.

    Args:
        verb: Function of the verb; its outputs are those of its options that are `writable`.
        given: Values of its options by name.

    Raises:
        OutputError: If an output cannot be written.
        ParameterError: If it is of no kind that can be, or is named twice.
    """
    named: dict[str, str] = {}
    known = get_params_from_function(verb)
    outputs = {name for name, one in known.items() if getattr(one.default, "writable", False)}
    for name in sorted(given, key=outputs.__contains__):
        value = given[name]
        for word in value if isinstance(value, list) else [value]:
            if not isinstance(word, (str, Path)) or "\0" in str(word):
                continue
            if name == "robot" and str(word).endswith(".nc"):
                continue  # no robot, as its reader will say
            place, written = os.path.realpath(word), name in outputs
            if written and (other := named.get(place)):
                argument = isinstance(known[other].default, ArgumentInfo)
                taken = other.upper() if argument else f"--{other}"
                wanted = f"another file than that of {taken}, which it would replace"
                raise ParameterError(name, wanted, str(word))
            if os.path.isfile(place) or (written and not os.path.exists(place)):
                named[place] = name  # nothing else is lost by being written twice
            if written:
                if str(word) == "-":
                    raise ParameterError(name, "the name of a file", "-")
                placed(word)
            if name in ("figure", "plot", "draw"):
                from patagium.report.figures import figure_kind

                figure_kind(word)
            if name == "report":
                from patagium.report.page import page_path

                page_path(word, name=name)


class Outputs:
    """Outputs of a verb, each written whatever becomes of the others.

    Attributes:
        failures: Number of failures by the name of the output.
    """

    def __init__(self) -> None:
        self.failures: Counter[str] = Counter()
        self._first: Exception | None = None

    def attempt(self, name: str, write: Callable[..., object], *given: Any, **named: Any) -> bool:
        """Whether an output was written; its first failure is printed, all are counted.

        Args:
            name: Name of the output, for messages.
            write: Function that writes it; Ctrl-C ends it alone.
            given: Its arguments.
            named: Its arguments by keyword.
        """
        try:
            write(*given, **named)
        except KeyboardInterrupt:
            stop_repeating()
            reason = "interrupted"
        except Exception as problem:
            known = isinstance(problem, (PatagiumError, OSError))
            reason = str(problem) if known else f"{type(problem).__name__}: {problem}"
            self._first = self._first or problem
        else:
            return True
        self.failures[name] += 1
        if self.failures[name] == 1:
            warn(f"{name}: {reason}")
        return False

    def draw(self, file: Path | None, make: Callable[[Any], Figure], name: str = "figure") -> bool:
        """Whether a figure, made with `patagium.report.figures`, was drawn into a file, if any."""
        if file is None:
            return False
        from patagium.report import figures

        return self.attempt(name, lambda: figures.save_figure(make(figures), file))

    def answer(self, name: str, facts: dict[str, Any], as_json: bool, title: str = "") -> None:
        """Write facts on stdout, a table for a person or one JSON object."""
        self.attempt(name, answer, facts, as_json=as_json, title=title)

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
