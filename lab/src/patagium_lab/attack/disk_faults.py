"""Faults of a disk: the nth operation that changes a folder fails, and so do all after it.

A shared library, compiled once and loaded before the system's, stands between a program and the
system. It counts whatever changes a folder (opening to write, writing, forcing, renaming, making
folders) and lets it fail from the nth on: as on a full disk, which still renames, as on a disk
that was mounted read-only, or as in a folder that vanished. C libraries such as HDF5 meet the
fault as Python does. Neglected: power that is lost, memory that is mapped.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from patagium.errors import ParameterError
from patagium.native.compiler import compiler_command

FULL, READ_ONLY, VANISHED = "full", "read-only", "vanished"
KINDS = (FULL, READ_ONLY, VANISHED)
"""Faults: no space is left; nothing may be changed; the folder is not there any more."""

_SOURCE = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static long left = -1, seen = 0;
static const char *folder = 0, *report = 0;
static int kind = 0; /* 0 full, 1 read-only, 2 vanished */

__attribute__((constructor)) static void begin(void) {
    const char *nth = getenv("DISK_FAULT_NTH"), *name = getenv("DISK_FAULT_KIND");
    folder = getenv("DISK_FAULT_FOLDER");
    report = getenv("DISK_FAULT_REPORT");
    if (nth) left = atol(nth);
    if (name && !strcmp(name, "read-only")) kind = 1;
    if (name && !strcmp(name, "vanished")) kind = 2;
}

__attribute__((destructor)) static void end(void) {
    if (!report || !seen) return;
    FILE *file = fopen(report, "a");
    if (file) { fprintf(file, "%ld\n", seen); fclose(file); }
}

static int inside(const char *path) {
    char whole[PATH_MAX];
    if (!folder || !path) return 0;
    if (path[0] != '/') {
        if (!getcwd(whole, sizeof whole)) return 0;
        size_t n = strlen(whole);
        snprintf(whole + n, sizeof whole - n, "/%s", path);
        path = whole;
    }
    return !strncmp(path, folder, strlen(folder));
}

static int behind(int handle) {
    char link[64], path[PATH_MAX];
    if (!folder) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", handle);
    ssize_t n = readlink(link, path, sizeof path - 1);
    if (n < 0) return 0;
    path[n] = 0;
    return inside(path);
}

/* what: 0 takes bytes, 1 takes a name, 2 renames, 3 forces */
static int fails(int what) {
    long now = __sync_add_and_fetch(&seen, 1);
    if (left < 0 || now <= left) return 0;
    if (kind == 0 && what == 2) return 0; /* a full disk renames, and may not force */
    if (kind == 1 && what == 3) return 0; /* there is nothing to force */
    if (kind == 2 && what != 1 && what != 2) return 0; /* its open files still take bytes */
    errno = kind == 0 ? ENOSPC : kind == 1 ? EROFS : ENOENT;
    return 1;
}

#define REAL(type, name, ...) \
    static type (*real)(__VA_ARGS__) = 0; \
    if (!real) real = (type (*)(__VA_ARGS__))dlsym(RTLD_NEXT, name)

ssize_t write(int h, const void *b, size_t n) {
    REAL(ssize_t, "write", int, const void *, size_t);
    if (behind(h) && fails(0)) return -1;
    return real(h, b, n);
}
ssize_t writev(int h, const struct iovec *v, int n) {
    REAL(ssize_t, "writev", int, const struct iovec *, int);
    if (behind(h) && fails(0)) return -1;
    return real(h, v, n);
}
ssize_t pwrite(int h, const void *b, size_t n, off_t o) {
    REAL(ssize_t, "pwrite", int, const void *, size_t, off_t);
    if (behind(h) && fails(0)) return -1;
    return real(h, b, n, o);
}
ssize_t pwrite64(int h, const void *b, size_t n, off64_t o) {
    REAL(ssize_t, "pwrite64", int, const void *, size_t, off64_t);
    if (behind(h) && fails(0)) return -1;
    return real(h, b, n, o);
}
int ftruncate(int h, off_t n) {
    REAL(int, "ftruncate", int, off_t);
    if (behind(h) && fails(0)) return -1;
    return real(h, n);
}
int ftruncate64(int h, off64_t n) {
    REAL(int, "ftruncate64", int, off64_t);
    if (behind(h) && fails(0)) return -1;
    return real(h, n);
}
int fsync(int h) {
    REAL(int, "fsync", int);
    if (behind(h) && fails(3)) return -1;
    return real(h);
}
int rename(const char *a, const char *b) {
    REAL(int, "rename", const char *, const char *);
    if (inside(b) && fails(2)) return -1;
    return real(a, b);
}
int mkdir(const char *p, mode_t m) {
    REAL(int, "mkdir", const char *, mode_t);
    if (inside(p) && fails(1)) return -1;
    return real(p, m);
}
#define OPENS(flags) (((flags) & O_ACCMODE) != O_RDONLY || ((flags) & O_CREAT))
#define OPEN(name) \
    int name(const char *p, int flags, ...) { \
        va_list rest; va_start(rest, flags); \
        mode_t m = (flags & (O_CREAT | O_TMPFILE)) ? va_arg(rest, mode_t) : 0; va_end(rest); \
        REAL(int, #name, const char *, int, ...); \
        if (OPENS(flags) && inside(p) && fails(1)) return -1; \
        return real(p, flags, m); \
    }
OPEN(open)
OPEN(open64)
#define OPENAT(name) \
    int name(int at, const char *p, int flags, ...) { \
        va_list rest; va_start(rest, flags); \
        mode_t m = (flags & (O_CREAT | O_TMPFILE)) ? va_arg(rest, mode_t) : 0; va_end(rest); \
        REAL(int, #name, int, const char *, int, ...); \
        if (OPENS(flags) && inside(p) && fails(1)) return -1; \
        return real(at, p, flags, m); \
    }
OPENAT(openat)
OPENAT(openat64)
#define FOPEN(name) \
    FILE *name(const char *p, const char *mode) { \
        REAL(FILE *, #name, const char *, const char *); \
        if (strpbrk(mode, "wa+") && inside(p) && fails(1)) return 0; \
        return real(p, mode); \
    }
FOPEN(fopen)
FOPEN(fopen64)

/* for a process that forks its cases: count from here on, and fail from the nth on */
void disk_fault_arm(const char *where, long nth, int what) {
    folder = where; left = nth; kind = what; seen = 0;
}
long disk_fault_seen(void) { return seen; }
"""


class FaultedRun(NamedTuple):
    """Result of a program that met a fault of the disk.

    Attributes:
        code: Exit code; negative for a signal that ended it, 1 for an exception that nobody caught.
        output: What it wrote to stdout.
        errors: What it wrote to stderr.
        operations: Operations that changed the folder, those that failed included.
    """

    code: int
    output: str
    errors: str
    operations: int


def injector(folder: Path) -> Path:
    """Shared library that makes a disk fail, compiled into a folder.

    Args:
        folder: Folder that the library is put into; not the one that is to fail.

    Raises:
        ParameterError: If this is no Linux, or there is no compiler.
    """
    compiler = compiler_command()
    if compiler is None or not sys.platform.startswith("linux"):
        raise ParameterError("faults of a disk", "Linux and a C compiler", sys.platform)
    source, library = folder / "disk_faults.c", folder / "disk_faults.so"
    source.write_text(_SOURCE)
    words = [*compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(source), "-ldl"]
    subprocess.run(words, check=True, capture_output=True)
    return library


def forked_with_fault(
    action: Callable[[], object], folder: Path, nth: int | None, fault: str = FULL
) -> FaultedRun:
    """Result of a function in a fork of this process, in whose folder all fails after a while.

    A program that was started with `LD_PRELOAD` set to the library tries many faults this way
    without importing anything anew.

    Args:
        action: Function; `SystemExit` is its exit code.
        folder: Folder that fails, with all below it.
        nth: Number of operations that succeed; None: all.
        fault: FULL, READ_ONLY or VANISHED.
    """
    with tempfile.TemporaryDirectory() as aside:
        out, errors, report = (Path(aside) / name for name in ("out", "errors", "operations"))
        child = os.fork()
        if child == 0:
            _child(action, (out, errors, report), (folder, nth, fault))
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        operations = int(report.read_text()) if report.exists() else 0
        return FaultedRun(code, out.read_text(), errors.read_text(), operations)


def _child(
    action: Callable[[], object],
    files: tuple[Path, Path, Path],
    fault: tuple[Path, int | None, str],
) -> None:
    """The fork: act with the fault, write down what happened, and end."""
    out, errors, report = files
    for handle, path in ((1, out), (2, errors)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT, 0o600), handle)
    library = ctypes.CDLL(None)
    library.disk_fault_arm.argtypes = [ctypes.c_char_p, ctypes.c_long, ctypes.c_int]
    library.disk_fault_seen.restype = ctypes.c_long
    folder, nth, kind = fault
    place = os.fsencode(folder.resolve())
    code = 0
    library.disk_fault_arm(place, -1 if nth is None else nth, KINDS.index(kind))
    try:
        action()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        code = 1
    operations = library.disk_fault_seen()
    library.disk_fault_arm(None, -1, 0)
    report.write_text(str(operations))
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code)
