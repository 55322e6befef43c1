"""Cache of compiled libraries: damage, strangers, killed and parallel builds, size, and `CC`."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from patagium.cli.main import run
from patagium.errors import OutputError, ParameterError
from patagium.native import cache, compiler, compiler_name, load_functions
from patagium.native.compiler import compiler_command

needs_compiler = pytest.mark.skipif(compiler_name() is None, reason="no C compiler here")
needs_posix = pytest.mark.skipif(os.name != "posix", reason="owners and modes are POSIX ones")
needs_root = pytest.mark.skipif(
    os.name != "posix" or os.geteuid() != 0, reason="only root gives files away"
)
STRANGER = 54321  # a user who is neither root nor the one who runs the tests


def cubic() -> list[ca.Function]:
    x = ca.SX.sym("x")
    return [ca.Function("cubic", [x], [x * x * x - 2 * x], ["x"], ["y"])]


def other() -> list[ca.Function]:
    x = ca.SX.sym("x")
    return [ca.Function("cubic", [x], [x * x + 7], ["x"], ["y"])]


def value(functions: Callable[[], list[ca.Function]] = cubic, key: str = "cubic") -> float:
    """The function at 3, from the cache as a new process finds it."""
    cache._LOADED.clear()
    cache.tell.cache_clear()
    cache._tidy_once.cache_clear()
    return float(load_functions(key, functions, label="test")["cubic"](3.0))


def the_library(folder: Path) -> Path:
    (found,) = folder.glob("*.so")
    return found


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    place = tmp_path / "cache"
    monkeypatch.setenv("PATAGIUM_CACHE", str(place))
    return place


@pytest.fixture
def quick_builds(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """A warm cache, and builds that take no time: what the compiler made once is made again."""
    assert value() == 21.0
    made, builds = the_library(folder).read_bytes(), list[str]()

    def compiled(*_: object) -> bytes:
        builds.append("one")
        return made

    monkeypatch.setattr(compiler, "_compiled", compiled)
    monkeypatch.setattr(os, "fsync", lambda handle: None)  # the disk is not what is tested
    yield builds


@needs_compiler
@pytest.mark.parametrize("pattern", ["*.so", "*.record"])
def test_flipped_bits_are_found_told_and_mended(pattern, folder, quick_builds, rng, capsys):
    files = {file: file.read_bytes() for file in folder.glob(pattern)}
    for number in range(1, 201):
        for file, good in files.items():
            damaged = bytearray(good)
            damaged[rng.integers(len(good))] ^= 1 << int(rng.integers(8))
            file.write_bytes(damaged)
        capsys.readouterr()
        assert value() == 21.0
        assert "is damaged" in capsys.readouterr().err
        assert len(quick_builds) == number
        assert pattern == "*.record" or file.read_bytes() == good
    assert value() == 21.0
    assert len(quick_builds) == 200  # mended for good


@needs_compiler
@pytest.mark.parametrize("length", [0, 1, 63, 64, 1000, -1])
@pytest.mark.parametrize("pattern", ["*.so", "*.record"])
def test_cut_off_files_are_built_again(pattern, length, folder, quick_builds, capsys):
    for file in folder.glob(pattern):
        file.write_bytes(file.read_bytes()[:length] if length < file.stat().st_size else b"")
    capsys.readouterr()
    assert value() == 21.0
    assert "is damaged" in capsys.readouterr().err


@needs_compiler
def test_another_library_under_the_right_name_is_not_loaded(folder, capsys):
    assert value() == 21.0
    mine = the_library(folder)
    records = set(folder.glob("*.record"))
    assert value(other, "other") == 16.0
    (theirs,) = set(folder.glob("*.so")) - {mine}
    mine.write_bytes(theirs.read_bytes())
    assert value() == 21.0
    assert f"{mine} in the cache is damaged" in capsys.readouterr().err
    for old, new in zip(
        sorted(records), sorted(set(folder.glob("*.record")) - records), strict=True
    ):
        old.write_bytes(new.read_bytes())
    assert value() == 21.0
    assert "record in the cache is damaged" in capsys.readouterr().err


@needs_compiler
@needs_posix
def test_folder_and_files_are_private_whatever_the_umask(folder):
    old = os.umask(0)
    try:
        assert value() == 21.0
    finally:
        os.umask(old)
    assert folder.stat().st_mode & 0o777 == 0o700
    assert {file.stat().st_mode & 0o777 for file in folder.iterdir()} == {0o600}


@needs_compiler
@needs_root
def test_a_library_of_another_user_is_not_loaded(folder, capsys):
    assert value() == 21.0
    library = the_library(folder)
    os.chown(library, STRANGER, -1)
    assert value() == 21.0
    assert f"belongs to another user ({STRANGER})" in capsys.readouterr().err
    assert library.stat().st_uid == os.geteuid()


@needs_compiler
@needs_posix
@pytest.mark.parametrize("mode", [0o620, 0o602])
def test_a_library_that_others_may_write_is_not_loaded(mode, folder, capsys):
    assert value() == 21.0
    library = the_library(folder)
    library.chmod(mode)
    assert value() == 21.0
    assert "can be written to by others" in capsys.readouterr().err
    assert library.stat().st_mode & 0o777 == 0o600


@needs_compiler
@needs_posix
@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_what_is_no_plain_file_is_not_loaded(kind, folder, tmp_path, capsys):
    assert value() == 21.0
    library = the_library(folder)
    library.rename(tmp_path / "elsewhere.so")
    cache._LOADED.clear()
    if kind == "link":
        library.symlink_to(tmp_path / "elsewhere.so")
    elif kind == "pipe":
        os.mkfifo(library)
    else:
        library.mkdir()
    assert cache._trusted_bytes(library) is None
    assert "is not used but built again" in capsys.readouterr().err
    if kind != "folder":
        assert value() == 21.0
        assert library.read_bytes() == (tmp_path / "elsewhere.so").read_bytes()
        assert library.lstat().st_mode & 0o777 == 0o600
        return
    with pytest.raises(OutputError, match=library.stem):
        value()
    cache.tidy(0)  # `patagium cache --clear`
    assert value() == 21.0


@needs_compiler
@needs_posix
@pytest.mark.parametrize("fault", ["group", "world", "owner", "file", "unwritable"])
def test_builds_go_to_a_private_folder_where_the_cache_cannot_be_trusted(
    fault, folder, capsys, monkeypatch
):
    folder.mkdir()
    if fault == "owner":
        if os.geteuid() != 0:
            pytest.skip("only root gives folders away")
        os.chown(folder, STRANGER, -1)
    elif fault == "file":
        folder.rmdir()
        folder.touch()
    elif fault == "unwritable":
        monkeypatch.setattr(os, "access", lambda *_: False)  # root writes whatever the mode
    else:
        folder.chmod(0o770 if fault == "group" else 0o757)
    assert value() == 21.0
    said = capsys.readouterr().err
    assert str(folder) in said
    assert "PATAGIUM_CACHE" in said
    mode = {"group": "go-w", "world": "go-w", "unwritable": "u+w"}.get(fault)
    assert (f"run `chmod {mode} {folder}`" in said) if mode else ("chmod" not in said)
    assert "compiling test" in said and "kept for next time" not in said
    assert cache.cache_folder() != folder
    assert cache.cache_folder().stat().st_mode & 0o777 == 0o700
    assert folder.is_file() or not list(folder.iterdir())


@needs_compiler
def test_a_folder_that_is_removed_while_the_program_runs_is_made_again(folder):
    assert value() == 21.0
    shutil.rmtree(folder)
    assert value(other, "other") == 16.0
    assert the_library(folder).is_file()
    assert folder.stat().st_mode & 0o777 == 0o700 or os.name != "posix"


@needs_compiler
@needs_posix
@pytest.mark.parametrize("where", ["folder", "sources", "first"])
def test_a_build_for_which_the_disk_has_no_room_says_so(where, folder, monkeypatch):
    """In a new cache the compiler was blamed, and the virtual machine took its place."""
    assert where == "first" or value() == 21.0

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    compiler._compiler.cache_clear()
    monkeypatch.setattr(*((os, "mkdir") if where == "folder" else (Path, "write_text")), full)
    with pytest.raises(OutputError, match=f"{folder}: cannot be written: No space left"):
        value(other, "other")


@pytest.mark.parametrize("variable", ["PATAGIUM_CACHE", "XDG_CACHE_HOME", "HOME"])
@pytest.mark.skipif(sys.platform != "linux", reason="the folders of Linux")
def test_relative_paths_are_refused(variable, monkeypatch):
    for name in ("PATAGIUM_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(variable, "somewhere/here")
    with pytest.raises(ParameterError, match=f"{variable}: expected an absolute path"):
        cache.cache_folder()


BUILD = """
import casadi as ca, sys
from patagium.native import load_functions
if len(sys.argv) > 2:
    import resource
    resource.setrlimit(resource.RLIMIT_FSIZE, (6000, 6000))
x = ca.SX.sym("x")
made = [ca.Function("cubic", [x], [x * x * x - 2 * x], ["x"], ["y"])]
try:
    print(float(load_functions(sys.argv[1], lambda: made, label="test")["cubic"](3.0)))
except Exception as error:
    print(type(error).__name__)
"""


def build_apart(*words: str) -> tuple[str, str]:
    """Output and messages of a build in a process of its own."""
    command = [sys.executable, "-c", BUILD, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout.strip(), done.stderr


@needs_compiler
@needs_posix
def test_a_full_disk_leaves_nothing_half_written(folder):
    output, said = build_apart("cubic", "full disk")
    assert output == "21.0"
    assert "does not work" in said
    assert "virtual machine" in said
    assert not list(folder.iterdir())
    assert build_apart("cubic")[0] == "21.0"
    for file in folder.glob("*.record"):
        content = json.loads(file.read_text()[64:])
        if content[1] is not None:  # all but the record that the compiler works
            file.unlink()
    before = set(folder.iterdir())
    assert build_apart("cubic", "full disk")[0] == "CompilerError"
    assert set(folder.iterdir()) == before
    assert "compiling" in build_apart("cubic")[1]
    assert build_apart("cubic", "full disk") == ("21.0", "")  # nothing need be written


def test_what_several_keep_at_once_is_always_there(folder):
    library, missing = b"a library" * 1000, list[int]()
    digest = cache.keep_library(library)

    def keep(turn: int) -> None:
        cache.keep_library(library)
        cache.record_library("known", digest, turn)
        if cache._trusted_bytes(folder / f"{digest}.so") != library:
            missing.append(turn)

    with ThreadPoolExecutor(4) as pool:
        for kept in [pool.submit(keep, turn) for turn in range(60)]:
            kept.result()
    assert not missing


@needs_compiler
@needs_posix
def test_a_killed_build_is_repeated_and_its_rest_is_removed(folder, tmp_path, monkeypatch):
    assert value(other, "other") == 16.0
    command = compiler_command()
    assert command is not None
    slow = tmp_path / "slow"
    skipped = f'case "$*" in *-fsyntax-only*) ;; *) test -e {tmp_path}/quick || sleep 20;; esac'
    slow.write_text(f'#!/bin/sh\n{skipped}\nexec {command[0]} "$@"\n')
    slow.chmod(0o755)
    monkeypatch.setenv("CC", str(slow))
    (tmp_path / "quick").touch()
    assert compiler_command() == (str(slow),)
    (tmp_path / "quick").unlink()
    child = subprocess.Popen(
        [sys.executable, "-c", BUILD, "cubic"], start_new_session=True, stderr=subprocess.PIPE
    )
    until = time.monotonic() + 30
    while not list(folder.glob("building-*/*.c")):
        assert time.monotonic() < until
        time.sleep(0.02)
    (rest,) = folder.glob("building-*")
    age(rest)
    assert rest not in [item.path for item in cache.tidy()]  # its build goes on
    assert rest not in [item.path for item in cache.tidy(0)]
    os.killpg(child.pid, signal.SIGKILL)
    child.wait()
    assert child.stderr is not None
    child.stderr.close()
    assert rest in list(folder.iterdir())
    age(rest)  # files that were written since made it young again
    (tmp_path / "quick").touch()
    assert value() == 21.0
    assert not list(folder.glob("building-*"))
    assert not list(folder.glob("making-*"))


@needs_posix
def test_an_interruption_does_not_wait_for_compilers(tmp_path):
    """A compiler of another process group, as where Ctrl-C reaches the program alone."""
    begun, done = tmp_path / "begun", tmp_path / "done"
    slow = ["sh", "-c", f"touch {begun}; sleep 20; touch {done}"]

    def interrupt() -> None:
        until = time.monotonic() + 20
        while not begun.exists() and time.monotonic() < until:
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(interrupt)
        with pytest.raises(KeyboardInterrupt):
            compiler._compiled(slow, {"a.c": ""}, [], {})
        asked.result()
    assert begun.exists() and not done.exists()


def age(path: Path, seconds: float = 7200.0) -> None:
    old = time.time() - seconds
    os.utime(path, (old, old))


def test_drafts_and_locks_of_killed_programs_are_removed_when_they_are_old(folder):
    cache.cache_folder()
    old = [f".{'a' * 64}.so.x1_b.part", f"making-{'b' * 32}", f"index-{'c' * 32}.77"]
    young = [f".{'d' * 32}.record.x1_b.part", f"making-{'e' * 32}"]
    strange = ["notes.txt", "library.so", "making-bread", ".bashrc", "building plans"]
    for name in (*old, *young, *strange):
        (folder / name).touch()
    for name in (*old, *strange):
        age(folder / name)
    assert {item.path.name for item in cache.tidy()} == set(old)
    assert {item.path.name for item in cache.tidy(0)} == set(young)
    assert {file.name for file in folder.iterdir()} == set(strange)


def test_what_was_not_used_for_longest_is_removed_first(folder):
    digests = [cache.keep_library(bytes([k]) * 1000) for k in range(6)]
    for k, digest in enumerate(digests):
        age(folder / f"{digest}.so", 1000 - k)
    assert cache._trusted_bytes(folder / f"{digests[0]}.so")  # used now
    removed = cache.tidy(bound=4000)
    assert [item.path.stem for item in removed] == digests[1:3]
    assert {file.stem for file in folder.iterdir()} == {digests[0], *digests[3:]}


def test_the_verb_says_what_is_kept_and_removes_it(folder, capsys):
    def speak(*words: str) -> dict[str, object]:
        with pytest.raises(SystemExit) as end:
            run(["cache", *words, "--json"])
        assert end.value.code == 0
        return dict(json.loads(capsys.readouterr().out))

    assert speak()["libraries"] == 0
    digest = cache.keep_library(b"1" * 500_000)
    cache.record_library("0" * 32, digest, None)
    former = folder / ("f" * 32)  # a build of an earlier release
    former.mkdir()
    (former / "library.so").write_bytes(b"2" * 300_000)
    (folder / f"works-{'e' * 32}").touch()
    (folder / f"{'d' * 64}.so").symlink_to(folder.parent)
    said = speak()
    assert said["folder"] == str(folder)
    assert said["libraries"] == 2
    assert said["size_MB"] == 0.8
    assert (folder / f"{digest}.so").exists()
    said = speak("--clear")
    assert (said["removed"], said["libraries"], said["size_MB"]) == (5, 0, 0.0)
    assert not list(folder.iterdir())


@needs_compiler
@needs_posix
def test_arguments_in_cc_are_obeyed(folder, tmp_path, monkeypatch):
    command = compiler_command()
    assert command is not None
    script = tmp_path / "my tools" / "wrapper"
    script.parent.mkdir()
    script.write_text(f'#!/bin/sh\necho "$@" >> "{tmp_path}/said"\nexec "$@"\n')
    script.chmod(0o755)
    monkeypatch.setenv("CC", f"'{script}' {command[0]} '-DTWO_WORDS=\"a b\"'")
    assert value() == 21.0
    said = (tmp_path / "said").read_text()
    assert said.count('-DTWO_WORDS="a b"') == len(said.splitlines()) > 0
    monkeypatch.setenv("CC", str(script))  # a path with a space, as it stands
    assert compiler.command_words("CC", str(script)) == (str(script),)


@needs_compiler
def test_a_cc_that_cannot_be_obeyed_is_told(folder, monkeypatch, capsys):
    monkeypatch.setenv("CC", "gcc 'half")
    with pytest.raises(ParameterError, match="CC: expected a compiler, with arguments"):
        compiler_command()
    monkeypatch.setenv("CC", "no-such-compiler -m64")
    assert compiler_command() is not None
    assert "CC='no-such-compiler -m64' makes no library" in capsys.readouterr().err


@needs_compiler
def test_a_checked_library_is_hashed_once_per_process(folder, capsys):
    assert value() == 21.0
    the_library(folder).write_bytes(b"damaged later")
    assert load_functions("cubic", cubic, label="test")["cubic"](3.0) == 21.0
    assert "damaged" not in capsys.readouterr().err


def test_numbers_of_a_rebuilt_library_are_those_of_the_first(folder):
    x = np.linspace(-2, 2, 9)
    first = load_functions("cubic", cubic, label="test")["cubic"].batch(x)
    cache._LOADED.clear()
    cache.tidy(0)
    np.testing.assert_array_equal(
        load_functions("cubic", cubic, label="test")["cubic"].batch(x), first
    )
