"""The user's C compiler, and libraries built by it, kept in the cache.

Environment: `CC` chooses the compiler and may give it arguments, `PATAGIUM_COMPILER=none`
does without.
"""

from __future__ import annotations

import ctypes
import functools
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from patagium.errors import CompilerError, ParameterError
from patagium.native.cache import (
    TEMPORARY,
    Library,
    build_lock,
    building_folder,
    cache_folder,
    keep_library,
    load_library,
    record_library,
    short_hash,
    tell,
)
from patagium.native.structs import HEADERS

KERNELS = Path(__file__).parent / "kernels"
_COMMON = ("-std=gnu11", "-fPIC", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast")
_NATIVE = () if platform.machine().startswith(("arm", "aarch")) else ("-march=native",)
STRAIGHT_LINE = ("-O2", *_COMMON, *_NATIVE)
LOOPS = ("-O3", *_COMMON, *_NATIVE)


_TOLD = "PATAGIUM_TOLD_WITHOUT_COMPILER"


@functools.cache
def _compiler(choice: str, preferred: str) -> tuple[str, ...] | None:
    if choice == "none":
        return None
    for name in filter(None, (preferred, "cc", "gcc", "clang")):
        command = command_words("CC", name)
        if command and _works(command):
            if preferred and name != preferred:
                tell(f"CC={preferred!r} makes no library that loads here: {command[0]} is used")
            return command
    return None


def command_words(variable: str, text: str) -> tuple[str, ...] | None:
    """Compiler that an environment variable names, and its arguments; None if it is not there.

    Args:
        variable: Name of the variable.
        text: Its value: a program, or words as in a shell, such as "ccache gcc -m64".

    Raises:
        ParameterError: If a quote in it is not closed.
    """
    path = shutil.which(text)
    if path:
        return (path,)
    try:
        words = shlex.split(text, posix=os.name == "posix")
    except ValueError:
        raise ParameterError(variable, "a compiler, with arguments as in a shell", text) from None
    path = shutil.which(words[0]) if words else None
    return (path, *words[1:]) if path else None


def _works(command: tuple[str, ...]) -> bool:
    """Whether the compiler makes a library, with the kernels' vector types, that loads here."""
    known = short_hash("a compiler that works", machine_identity(command), header_digest())
    if load_library(known) is not None:
        return True
    probe = {"probe.c": '#include "operations.h"\nint probe(void) { return LANES; }\n'}
    try:
        record_library(known, keep_library(_compiled(command, probe, STRAIGHT_LINE, {})), None)
    except CompilerError as error:
        tell(f"{shlex.join(command)} does not work: {str(error).splitlines()[-1]}")
        return False
    return load_library(known) is not None


@functools.cache
def compiler_accepts(compiler: tuple[str, ...], flags: tuple[str, ...]) -> bool:
    """Whether a compiler knows all of some flags."""
    command = [*compiler, *flags, "-Werror", "-fsyntax-only", "-x", "c", os.devnull]
    return subprocess.run(command, capture_output=True).returncode == 0


def compiler_command() -> tuple[str, ...] | None:
    """The C compiler in use and its arguments, or None; the first None is announced.

    Raises:
        ParameterError: If a quote in `CC` is not closed.
    """
    choice = os.environ.get("PATAGIUM_COMPILER", "")
    command = _compiler(choice, os.environ.get("CC", "").strip())
    if command is None:
        _announce_fallback(choice)
    return command


def compiler_name() -> str | None:
    """The C compiler in use as a short name, or None where there is none."""
    command = compiler_command()
    return Path(command[0]).name if command else None


@functools.cache
def _announce_fallback(choice: str) -> None:
    if os.environ.get(_TOLD) == choice:
        return
    os.environ[_TOLD] = choice  # worker processes inherit it and keep quiet
    reason = "as PATAGIUM_COMPILER=none asks" if choice == "none" else "none was found that works"
    words = "running on CasADi's virtual machine, the same numbers, several times slower"
    tell(f"no C compiler ({reason}): {words}")


@functools.cache
def machine_identity(compiler: tuple[str, ...]) -> str:
    """Text that identifies compiler and processor, on which a binary depends as on its source."""
    text = platform.machine()
    for word in compiler:  # "ccache gcc": both are programs
        program = shutil.which(word)
        if program:
            status = os.stat(program)
            word = f"{os.path.realpath(program)} {status.st_size} {status.st_mtime_ns}"
        text += f" {word}"
    cpu = Path("/proc/cpuinfo")
    if cpu.exists():
        flags = next((x for x in cpu.read_text().splitlines() if x.startswith("flags")), "")
        text += flags
    return text


def build(
    compiler: tuple[str, ...],
    sources: Mapping[str, str],
    flags: Sequence[str],
    label: str,
    own: Mapping[str, str] | None = None,
) -> Library:
    """Library of some sources, from the cache or compiled now; its fact is the time it took [s].

    Args:
        compiler: The compiler and its arguments.
        sources: File name to text; `.c` files are compiled side by side, others can be included.
        flags: Compiler flags.
        label: What is being compiled, for the progress line.
        own: One more flag of some of the sources, which prevails.

    Raises:
        CompilerError: With the compiler's own words.
        OutputError: If the disk does not take it.
    """
    own = own or {}
    texts = [f"{name} {own.get(name, '')}\n{text}" for name, text in sources.items()]
    name = short_hash(header_digest(), machine_identity(compiler), *flags, *texts)
    if library := load_library(name):
        return library
    with build_lock(name):
        if library := load_library(name):  # of another process
            return library
        started, end = time.perf_counter(), ""
        print(f"patagium: compiling {label}", end="", file=sys.stderr, flush=True)
        try:
            digest = keep_library(_compiled(compiler, sources, flags, own))
            seconds = time.perf_counter() - started
            record_library(name, digest, seconds)
            kept = "" if cache_folder() in TEMPORARY else ", kept for next time"
            end = f" ... {seconds:.1f} s{kept}"
        finally:
            print(end, file=sys.stderr)
        library = load_library(name)
    if library is None:
        raise CompilerError(f"{label}: {shlex.join(compiler)} made a library that does not load")
    return library


def _compiled(
    compiler: Sequence[str],
    sources: Mapping[str, str],
    flags: Sequence[str],
    own: Mapping[str, str],
) -> bytes:
    """Bytes of the shared library of some sources."""
    with building_folder() as work:
        for name, text in sources.items():
            (work / name).write_text(text)
        units = [work / name for name in sources if name.endswith(".c")]
        running: list[subprocess.Popen[str]] = []

        def compiled(unit: Path) -> str:
            target = str(unit.with_suffix(".o"))
            words = [*flags, *filter(None, [own.get(unit.name)]), f"-I{KERNELS}", f"-I{work}"]
            _run([*compiler, *words, "-c", str(unit), "-o", target], running)
            return target

        library = work / "library.so"
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            try:
                objects = list(pool.map(compiled, units))
                _run([*compiler, "-shared", *objects, "-o", str(library), "-lm"], running)
            except BaseException:  # Ctrl-C does not wait for compilers
                for process in running:
                    with suppress(ProcessLookupError):
                        if process.poll() is None:  # another program may have its number by now
                            os.killpg(process.pid, signal.SIGKILL)
                raise
        return library.read_bytes()


def _run(command: Sequence[str], running: list[subprocess.Popen[str]]) -> None:
    """Run a command in a process group of its own, which `running` is told of."""
    out, errors = subprocess.DEVNULL, subprocess.PIPE
    process = subprocess.Popen(
        command, stdout=out, stderr=errors, text=True, start_new_session=True
    )
    running.append(process)
    words = process.communicate()[1].strip()[-4000:] or f"exit status {process.returncode}"
    if process.returncode != 0:
        raise CompilerError(f"{shlex.join(command)}\nfailed:\n{words}")


@functools.cache
def header_digest() -> str:
    """Hash of the headers that every build may include."""
    return short_hash(*[file.read_text() for file in sorted(KERNELS.glob("*.h"))])


def load_kernel(
    name: str, defines: Mapping[str, str | int] | None = None, folder: Path = KERNELS
) -> ctypes.CDLL | None:
    """A hand-written kernel, compiled and cached; None without a compiler.

    Args:
        name: `<name>.c` in the folder.
        defines: Macros set for this build, such as sizes or the type of a number.
        folder: Where the source is; headers of `kernels/` can be included from anywhere.

    Raises:
        CompilerError: If the compiler refuses it.
    """
    compiler = compiler_command()
    if compiler is None:
        return None
    macros = [f"-D{macro}={value}" for macro, value in sorted((defines or {}).items())]
    sources = {f"{name}.c": (folder / f"{name}.c").read_text(), **HEADERS}
    return build(compiler, sources, (*LOOPS, *macros), f"the {name} kernel").handle
