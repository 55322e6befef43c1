"""Conditions of a study's figures: program, machine, compiler, load, date.

Neglected: clock rates and temperatures, which change a ratio of two times of one run least.
"""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import date
from importlib.metadata import version
from pathlib import Path

from patagium import __version__
from patagium.native.compiler import STRAIGHT_LINE, compiler_command


def conditions() -> dict[str, str]:
    """Program, machine, date and present load, for the foot of a page."""
    return {
        "program": f"patagium {__version__}",
        "machine": machine(),
        "date": date.today().isoformat(),
        "load average at the end": load_average(),
    }


def machine() -> str:
    """Processor, system, compiler with its flags, and versions of libraries."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("casadi", "numpy"))
    return (
        f"{_processor()}, {os.cpu_count() or 1} cores; {platform.system()} {platform.machine()}; "
        f"{_compiler()}; Python {platform.python_version()}; {packages}"
    )


def load_average() -> str:
    """Load average over the last minutes, or "unknown" where the system has none."""
    if not hasattr(os, "getloadavg"):
        return "unknown"
    last, five, fifteen = os.getloadavg()
    return f"{last:.1f} ({five:.1f} over 5 minutes, {fifteen:.1f} over 15)"


def _compiler() -> str:
    compiler = compiler_command()
    if compiler is None:
        return "no C compiler"
    done = subprocess.run([*compiler, "--version"], capture_output=True, text=True, check=False)
    flags = " ".join(flag for flag in STRAIGHT_LINE if flag != "-fPIC")
    said = done.stdout.splitlines() or [Path(compiler[0]).name]
    return f"{said[0]}, {flags}"


def _processor() -> str:
    try:
        with open("/proc/cpuinfo") as file:
            names = [
                line.split(":", 1)[1].strip() for line in file if line.startswith("model name")
            ]
        return names[0]
    except (OSError, IndexError):
        return platform.processor() or platform.machine()
