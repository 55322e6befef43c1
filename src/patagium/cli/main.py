"""The program `patagium`: its verbs, and how it fails.

Exit codes: 0 done, 2 for what a user can mend (one sentence on stderr), 130 when
interrupted. With --debug the traceback comes too. Verbs import what they need when
they run, so that --help is quick.
"""

from __future__ import annotations

import codecs
import os
import re
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import lru_cache, partial
from io import TextIOWrapper
from types import ModuleType
from typing import Annotated, Any, TextIO, cast

import typer
from typer.core import TyperCommand, TyperOption
from typer.main import get_command

from patagium.cli import (  # isort: skip
    cache, check, cycles, evaluate, export, figures, fly, identify, import_log, inspect, motion,
    optimize, robots, send, simulate, stream, trim, tune, view,
)  # fmt: skip
from patagium.cli.interruption import repeated_interrupt
from patagium.cli.outputs import check_files
from patagium.cli.usage import UsageError, usage_sentence
from patagium.cli.words import warn
from patagium.errors import OutputError, ParameterError, PatagiumError
from patagium.plugins import VERBS, plugins
from patagium.version import __version__

app = typer.Typer(
    name="patagium",
    help="Morphing-wing robots: their equations, their flight, and what the air does to them.",
    epilog="Every verb explains itself: patagium simulate --help. "
    "Add --debug anywhere for the traceback behind an error.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["--help", "-h"]},
)


def _add(verb: ModuleType, where: typer.Typer = app, word: str = "", hidden: bool = False) -> None:
    name = verb.__name__.rpartition(".")[2]
    word = word or getattr(verb, "NAME", name)  # `import` names no function
    command = where.command(word, epilog=_epilog(verb), hidden=hidden, cls=_command(verb))
    command(getattr(verb, name))


def _epilog(verb: ModuleType, further: Sequence[str] = ()) -> str:
    """End of a verb's help: names of options that are not described, and examples."""
    told = ["Further options, which --help-all describes:", "\n".join(further)] if further else []
    examples = ["Examples:", *getattr(verb, "EXAMPLES", ())][: 3 if further else None]
    return "\n\n".join([*told, *(examples if examples[1:] else ())])


def _command(verb: ModuleType) -> type[TyperCommand]:
    """Command whose help describes the usual options and names the others, panel by panel.

    PANELS of a verb has the options of each panel; the usual ones come before, in none.
    """
    places = {
        name: panel
        for panel, names in getattr(verb, "PANELS", {}).items()
        for name in names.split()
    }

    class Command(TyperCommand):
        def __init__(self, *words: Any, **options: Any) -> None:
            super().__init__(*words, **options)
            for one in cast(list[TyperOption], self.params):
                if one.name in places:
                    one.rich_help_panel = places[one.name]

        def get_help_option_names(self, context: Any) -> list[str]:
            return ["--help", "--help-all", "-h"]

        def parse_args(self, context: Any, words: list[str]) -> list[str]:
            self.brief = "--help-all" not in words
            alone = getattr(verb, "ALONE", {}).get(words[-1] if words else None, [])
            return super().parse_args(context, [*words, *alone])

        def format_help(self, context: Any, formatter: Any) -> None:
            further: dict[str, list[str]] = {}
            for one in cast(list[TyperOption], self.params):
                panel = one.rich_help_panel
                one.hidden = self.brief and panel is not None
                if panel and one.hidden:
                    further.setdefault(panel, []).append(one.opts[0])
            named = [f"- {panel}: {' '.join(names)}" for panel, names in further.items()]
            self.epilog = _epilog(verb, named)
            super().format_help(context, formatter)

        def invoke(self, context: Any) -> Any:
            try:
                check_files(getattr(verb, verb.__name__.rpartition(".")[2]), context.params)
                return super().invoke(context)
            except ParameterError as error:  # of Python, whose arguments are options here
                word = {one.name: one.opts[0] for one in self.params}.get(error.name, "")
                if word.startswith("--"):
                    error.args = (str(error).replace(error.name, word, 1),)
                raise
            except (OSError, EOFError) as error:  # which Typer ends with 1 and no word
                raise PatagiumError(_sentence(error)) from error

    return Command


for _verb in (
    simulate, trim, optimize, fly, cycles, figures, view, export, inspect, import_log, motion,
    identify, tune, evaluate, stream, send, robots, check, cache,
):  # fmt: skip
    _add(_verb)
_study = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown")
_taken = {"study", *(one.name for one in app.registered_commands)}
for _word, _point in plugins(VERBS).items():
    try:
        _add(_module := _point.load(), _trial := typer.Typer(), _word)
        get_command(_trial)
    except Exception as error:
        _by = _point.dist and _point.dist.name
        warn(f"verb {_word} of the package {_by} fails: {error!r}")
        continue
    _add(_module, _study, _word, getattr(_module, "HIDDEN", False))
    if _word not in _taken:
        _add(_module, app, _word, hidden=True)  # the word of 0.1
if _study.registered_commands:
    app.add_typer(_study, name="study", help="Studies of the authors: the paper, rigs, benches.")


def _say_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"patagium {__version__}")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_say_version, is_eager=True, help="Version of patagium."
        ),
    ] = False,
) -> None:
    """Morphing-wing robots: their equations, their flight, and what the air does to them."""


program = lru_cache(partial(get_command, app))
"""Its parser, made once per process: Typer reads each signature for long."""


def run(arguments: Sequence[str] | None = None) -> None:
    """Run the program, and leave with its exit code.

    Args:
        arguments: Words after the program's name; those of the process by default.

    Raises:
        SystemExit: Always, with the exit code.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    for name in ("stdout", "stderr"):  # closed before the start
        if getattr(sys, name) is None:  # writing fails, as to a full disk
            nowhere = os.open(os.devnull, os.O_RDONLY)
            setattr(sys, name, open(nowhere, "w", encoding="utf-8"))
    debug, stdout, stderr = "--debug" in words, sys.stdout, sys.stderr
    if isinstance(sys.stdout, TextIOWrapper):  # names of files may hold what is no text
        codecs.register_error("patagium", _in_fewer_letters)
        sys.stdout.reconfigure(errors="patagium")
    sys.stdout = cast(TextIO, _Lossy(stdout, BrokenPipeError))  # a reader has what it wanted
    sys.stderr = cast(TextIO, _Lossy(stderr, OSError, ValueError))
    try:
        with repeated_interrupt(), warnings.catch_warnings():
            warnings.simplefilter("always", UserWarning)
            warnings.showwarning = _say_warning
            said = [word for word in words if word != "--debug"]
            code = program()(said, prog_name="patagium", standalone_mode=False)
            raise SystemExit(code if isinstance(code, int) else 0)
    except UsageError as error:
        if not said or said == ["study"]:  # the help of a program without words
            error.show()
        else:
            warn(usage_sentence(error, said))
        raise SystemExit(2) from None
    except typer.Abort:
        raise SystemExit(1) from None
    except KeyboardInterrupt:  # before a verb is at work
        raise SystemExit(130) from None
    except (PatagiumError, OSError) as error:
        if debug:
            raise
        warn(_sentence(error))
        raise SystemExit(2) from None
    finally:
        sys.stdout, sys.stderr = stdout, stderr
        _drop_unwritable()


def _in_fewer_letters(problem: Any) -> tuple[str | bytes, int]:
    """Text for letters that an encoding lacks, such as -3x10^-4 for a number with its signs."""
    lost = problem.object[problem.start : problem.end]
    plain = re.sub("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", r"^\g<0>", lost)
    plain = plain.translate(str.maketrans("−–⁻×⁰¹²³⁴⁵⁶⁷⁸⁹", "---x0123456789"))
    return plain.encode("ascii", "backslashreplace").decode(), problem.end


class _Lossy:
    """Standard stream that drops text whose writing fails with given errors, and tells others."""

    def __init__(self, stream: TextIO, *lost: type[Exception]) -> None:
        self._stream, self._lost = stream, lost

    def write(self, text: str) -> int:
        self._attempt(self._stream.write, text)
        return len(text)

    def flush(self) -> None:
        self._attempt(self._stream.flush)

    def _attempt(self, act: Callable[..., object], *words: str) -> None:
        try:
            act(*words)
        except self._lost:
            pass
        except OSError as problem:
            raise OutputError("stdout", problem) from problem

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _drop_unwritable() -> None:
    """Give up what a standard stream does not take, which Python would try and report at exit."""
    for standard in (sys.stdout, sys.stderr):
        try:
            standard.flush()
        except (OSError, ValueError):
            with suppress(OSError, ValueError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, standard.fileno())
                os.close(nowhere)


def _say_warning(message: Warning | str, category: Any, *_: Any, **__: Any) -> None:
    known = issubclass(category, UserWarning)
    warn(f"{'' if known else category.__name__ + ': '}{message}")


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and not isinstance(error, PatagiumError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return str(error)
