"""The user's C compiler, and the cache of what it built.

A build is a folder of the cache, named by the hash of everything it depends on,
made beside its place and renamed into it: parallel processes may build the same
thing, and an interrupted build leaves nothing. Environment: `CC` chooses the
compiler, `PATAGIUM_COMPILER=none` does without, `PATAGIUM_CACHE` moves the cache.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import importlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from patagium.errors import CompilerError
from patagium.native.structs import STRUCTS

fcntl: Any = importlib.import_module("fcntl") if os.name == "posix" else None
"""Locks of files; not on Windows."""

KERNELS = Path(__file__).parent / "kernels"
_COMMON = ("-std=gnu11", "-fPIC", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast")
_NATIVE = () if platform.machine().startswith(("arm", "aarch")) else ("-march=native",)
STRAIGHT_LINE = ("-O2", *_COMMON, *_NATIVE)
LOOPS = ("-O3", *_COMMON, *_NATIVE)


_TOLD = "PATAGIUM_TOLD_WITHOUT_COMPILER"


@functools.cache
def _compiler(choice: str, preferred: str) -> str | None:
    if choice == "none":
        return None
    for name in filter(None, (preferred, "cc", "gcc", "clang")):
        path = shutil.which(name)
        if path and _works(path):
            return path
    return None


def _works(path: str) -> bool:
    """Whether the compiler links a library with the vector types the kernels use."""
    known = cache_folder() / f"works-{short_hash(machine_identity(path), header_digest())}"
    if known.exists():
        return True
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "probe.c")
        source.write_text('#include "operations.h"\nint probe(void) { return LANES; }\n')
        command = [path, *STRAIGHT_LINE, f"-I{KERNELS}", "-shared", str(source)]
        done = subprocess.run(
            [*command, "-o", str(source.with_suffix(".so")), "-lm"], capture_output=True
        )
    if done.returncode == 0:
        known.touch()
    return done.returncode == 0


@functools.cache
def compiler_accepts(path: str, flag: str) -> bool:
    """Whether a compiler knows a flag.

    Args:
        path: The compiler.
        flag: One of its options.
    """
    command = [path, flag, "-Werror", "-fsyntax-only", "-x", "c", os.devnull]
    return subprocess.run(command, capture_output=True).returncode == 0


def compiler_path() -> str | None:
    """The C compiler in use, or None; the first None of a process is announced."""
    choice = os.environ.get("PATAGIUM_COMPILER", "")
    path = _compiler(choice, os.environ.get("CC", ""))
    if path is None:
        _announce_fallback(choice)
    return path


def compiler_name() -> str | None:
    """The C compiler in use as a short name, or None where there is none."""
    path = compiler_path()
    return Path(path).name if path else None


@functools.cache
def _announce_fallback(choice: str) -> None:
    if os.environ.get(_TOLD) == choice:
        return
    os.environ[_TOLD] = choice  # worker processes inherit it and keep quiet
    reason = "as PATAGIUM_COMPILER=none asks" if choice == "none" else "none was found that works"
    print(
        f"patagium: no C compiler ({reason}): running on CasADi's virtual machine, "
        "the same numbers, several times slower",
        file=sys.stderr,
    )


def short_hash(*texts: str) -> str:
    """Name of a cache entry that depends on all the texts."""
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:32]


@functools.cache
def _writable(folder: Path) -> Path:
    """The folder, made when missing; a private temporary one where that is refused."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    fallback = Path(tempfile.mkdtemp(prefix="patagium-"))
    print(f"patagium: {folder} is not writable, builds go to {fallback}", file=sys.stderr)
    return fallback


def cache_folder() -> Path:
    """Folder of the cache, created when it is missing."""
    chosen = os.environ.get("PATAGIUM_CACHE")
    if chosen:
        folder = Path(chosen)
    elif sys.platform == "darwin":
        folder = Path.home() / "Library" / "Caches" / "patagium"
    elif sys.platform == "win32":
        folder = Path(os.environ.get("LOCALAPPDATA", Path.home())) / "patagium"
    else:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "patagium"
    return _writable(folder)


@functools.cache
def machine_identity(path: str) -> str:
    """Text that identifies compiler and processor, on which a binary depends beside its source."""
    status = os.stat(path)
    text = f"{os.path.realpath(path)} {status.st_size} {status.st_mtime_ns} {platform.machine()}"
    cpu = Path("/proc/cpuinfo")
    if cpu.exists():
        flags = next((x for x in cpu.read_text().splitlines() if x.startswith("flags")), "")
        text += flags
    return text


@contextmanager
def build_lock(name: str) -> Iterator[None]:
    """Lock of a cache entry: other processes that would build it wait until it exists.

    Where files cannot be locked nobody waits, and the same may be made twice.

    Args:
        name: Of the entry.
    """
    if fcntl is None:
        yield
        return
    file = cache_folder() / f"making-{name}"
    lock = _locked(file)
    try:
        yield
    finally:
        if lock is not None:
            file.unlink(missing_ok=True)
            lock.close()


def _locked(file: Path) -> IO[bytes] | None:
    """A file that this process alone holds; None of a file system that knows no locks."""
    while True:
        lock = file.open("wb")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
        except OSError:
            lock.close()
            return None
        with contextlib.suppress(FileNotFoundError):  # taken away by who held it before
            if os.path.samestat(os.fstat(lock.fileno()), file.stat()):
                return lock
        lock.close()


def build(path: str, sources: Mapping[str, str], flags: Sequence[str], label: str) -> Path:
    """Folder of the cache that holds `library.so` and whatever else the sources bring.

    Args:
        path: The compiler.
        sources: File name to text; `.c` files are compiled side by side, others
            are kept as they are.
        flags: Compiler flags.
        label: What is being compiled, for the progress line.

    Raises:
        CompilerError: With the compiler's own words.
    """
    texts = [f"{name}\n{text}" for name, text in sources.items()]
    folder = cache_folder() / short_hash(header_digest(), machine_identity(path), *flags, *texts)
    if (folder / "library.so").exists():
        return folder
    started = time.perf_counter()
    print(f"patagium: compiling {label}, kept for next time", end="", file=sys.stderr, flush=True)
    with tempfile.TemporaryDirectory(
        dir=folder.parent, prefix="building-", ignore_cleanup_errors=True
    ) as scratch:
        work = Path(scratch)
        units = []
        for name, text in sources.items():
            (work / name).write_text(text)
            if name.endswith(".c"):
                units.append(work / name)
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            objects = list(pool.map(lambda unit: _compile(path, unit, flags), units))
        library = work / "library.so"
        _run([path, "-shared", *map(str, objects), "-o", str(library), "-lm"])
        for leftover in objects:
            leftover.unlink()
        try:
            work.rename(folder)
        except OSError:
            if not (folder / "library.so").exists():
                raise
    print(f" ... {time.perf_counter() - started:.1f} s", file=sys.stderr)
    return folder


def _compile(path: str, unit: Path, flags: Sequence[str]) -> Path:
    target = unit.with_suffix(".o")
    _run([path, *flags, f"-I{KERNELS}", f"-I{unit.parent}", "-c", str(unit), "-o", str(target)])
    return target


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise CompilerError(f"{' '.join(command)}\nfailed:\n{done.stderr.strip()[-4000:]}")


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
    path = compiler_path()
    if path is None:
        return None
    macros = [f"-D{macro}={value}" for macro, value in sorted((defines or {}).items())]
    headers = {f"{one.name}_struct.h": one.header for one in STRUCTS}
    sources = {f"{name}.c": (folder / f"{name}.c").read_text(), **headers}
    with build_lock(short_hash(name, *macros, machine_identity(path))):
        built = build(path, sources, (*LOOPS, *macros), f"the {name} kernel")
    return ctypes.CDLL(str(built / "library.so"))
