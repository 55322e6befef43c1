"""MuJoCo's C functions, called from C through the header its wheel ships.

The library is the wheel's own build. Its mass matrix stays in MuJoCo's sparse form,
and nothing is copied out.
"""

from __future__ import annotations

import ctypes
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from patagium.native.compiler import compiler_command
from patagium.robot.model import Robot
from patagium_lab.rivals.compiled import SHORT_FLAGS, Rival, compile_rival, library_calls
from patagium_lab.rivals.mujoco_model import MujocoModel, mujoco_xml


def mujoco_rival(robot: Robot) -> Rival | str:
    """MuJoCo's algorithms for a robot as compiled functions, or why there are none.

    Args:
        robot: Machine with numbers, not symbols. One robot at a time.

    Raises:
        CompilerError: If the compiler refuses the header.
    """
    compiler = compiler_command()
    if compiler is None:
        return "no C compiler"
    found = find_spec("mujoco")
    if found is None or found.origin is None:
        return "mujoco is not installed"
    folder = Path(found.origin).parent
    shared = sorted(folder.glob("libmujoco.so*")) + sorted(folder.glob("libmujoco*.dylib"))
    if not shared or not (folder / "include" / "mujoco" / "mujoco.h").exists():
        return "the installed mujoco ships no library or header"
    ctypes.CDLL(str(shared[0]), mode=ctypes.RTLD_GLOBAL)
    text = (Path(__file__).parent / "mujoco_rival.c").read_text()
    flags = (*SHORT_FLAGS, f"-I{folder / 'include'}")
    library, seconds = compile_rival("calls of MuJoCo", {"rival.c": text}, compiler, flags)
    _build(library, robot)
    n = robot.dof
    sizes = {
        "mass_matrix": (n * n,),
        "bias": (n,),
        "both": (n * n, n),
        "inverse": (n,),
        "forward": (n,),
    }
    return Rival(
        f"MuJoCo {shared[0].name.removeprefix('libmujoco.so.')} in C",
        library_calls(library, sizes),
        MujocoModel(robot).order,
        note="the wheel's library; D in its sparse form",
        compile_time=seconds,
    )


def _build(library: ctypes.CDLL, robot: Robot) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "robot.xml")
        file.write_text(mujoco_xml(robot))
        error = np.zeros(1000, dtype=np.uint8)
        size = library.rival_build(
            str(file).encode(), error.ctypes.data_as(ctypes.c_char_p), error.size
        )
    if size != robot.dof:
        raise RuntimeError(f"MuJoCo refused the robot: {error.tobytes().decode().strip(chr(0))}")
