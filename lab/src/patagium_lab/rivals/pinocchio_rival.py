"""Pinocchio in C++, compiled from the headers its wheel ships, for this processor.

The headers of Boost come with the same wheel, those of Eigen with CasADi's. The model
has the coordinates of q (translation and ZYX Euler angles, aligned one-axis joints),
which on the Aerobat is faster than Pinocchio's own free flyer. D is its upper triangle,
as Pinocchio leaves it, and nothing is copied out.
"""

from __future__ import annotations

import ctypes
import os
import sysconfig
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import casadi as ca

from patagium.native.compiler import command_words
from patagium.robot.model import Robot
from patagium_lab.rivals.compiled import Rival, compile_rival, library_calls
from patagium_lab.rivals.joint_table import coordinate_order, flat, joint_table

FLAGS = ("-x", "c++", "-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-fPIC", "-w")
_DEFINES = (  # those of Pinocchio's own CMake target
    "-DBOOST_MPL_LIMIT_LIST_SIZE=30",
    "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
    "-DBOOST_FUSION_INVOKE_MAX_ARITY=12",
)


def pinocchio_rival(robot: Robot) -> Rival | str:
    """Pinocchio's algorithms for a robot as compiled functions, or why there are none.

    Args:
        robot: Machine with numbers, not symbols. One robot at a time: the library
            holds one model.

    Raises:
        CompilerError: If the compiler refuses the headers.
    """
    if robot.attitude == "quaternion":
        return "the model has the coordinates of q, which here are Euler angles"
    compiler = command_words("CXX", os.environ.get("CXX", "g++"))
    if compiler is None or os.environ.get("PATAGIUM_COMPILER") == "none":
        return "no C++ compiler"
    site = Path(sysconfig.get_paths()["purelib"])
    headers = site / "cmeel.prefix" / "include"
    eigen = Path(ca.__file__).parent / "include" / "eigen3"
    for needed in (headers / "pinocchio", headers / "boost", eigen / "Eigen"):
        if not needed.exists():
            return f"no headers {needed.name} in the installed wheels"
    text = (Path(__file__).parent / "pinocchio_rival.cpp").read_text()
    includes = ("-isystem", str(headers), "-isystem", str(eigen))
    library, seconds = compile_rival(
        f"Pinocchio {pinocchio_version()} in C++ (minutes)",
        {"rival.c": text},
        compiler,
        (*FLAGS, *_DEFINES, *includes),
    )
    rows = joint_table(robot)
    table = flat(rows)
    pointers = [table[k].ctypes.data_as(ctypes.c_void_p) for k in table]
    library.rival_build(len(rows), *pointers, ctypes.c_double(float(robot.gravity)))
    n = robot.dof
    sizes = {
        "mass_matrix": (n * n,),
        "bias": (n,),
        "both": (n * n, n),
        "gravity": (n,),
        "inverse": (n,),
        "forward": (n,),
    }
    return Rival(
        f"Pinocchio {pinocchio_version()} in C++",
        library_calls(library, sizes),
        coordinate_order(rows),
        note="g++ -O3 -march=native -DNDEBUG; CRBA, nonLinearEffects, RNEA, ABA",
        compile_time=seconds,
    )


def pinocchio_version() -> str:
    """Version of the installed Pinocchio, or "none"."""
    try:
        return version("pin")
    except PackageNotFoundError:
        return "none"
