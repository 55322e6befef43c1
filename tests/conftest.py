"""What every test starts from: fixed seeds, no network, no window, one thread a worker."""

from __future__ import annotations

import os
import random
import socket
import sys
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

os.environ.setdefault("MPLBACKEND", "Agg")
for _threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")
# tests start hundreds of interpreters: without bytecode each compiles the package for seconds
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

import numpy as np
import pytest
from hypothesis import settings

from patagium.control import Orbit, trim
from patagium.robot import Robot, load_robot, load_robot_text

from .random_machines import random_machine as random_machine
from .robots import free_plate
from .spoken import Speak, say

settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=25)
settings.load_profile("repeatable")


SLOW = (
    *("test_documentation.py", "test_validation.py", "test_reproduce.py", "test_attack.py"),
    *("test_live_browser.py", "test_rig.py", "test_optimal_gait.py", "test_what_if.py"),
    *("test_monarch.py", "test_course.py", "test_command_line.py", "test_damage_study.py"),
    *("test_adaptive_controller.py", "test_robot_parameters.py", "test_stall_delay_invariants.py"),
    *("test_bounds.py", "test_quaternion_base.py", "test_tuned_settings.py", "test_stress.py"),
    *("test_feedback_study.py", "test_crazyflie_log.py", "test_live_stream.py"),
    *("test_linear_strip.py", "test_wingbeat_derivatives.py", "test_first_hour.py"),
    *("test_raw_stream.py", "test_readme.py", "test_flight_fallback.py", "test_cycles.py"),
)
"""Files that take longest, the longest first."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Slow files begin first, so that no worker waits for the last one alone.

    It needs `--no-loadscope-reorder`, which `make test` gives.
    """
    places = {name: place for place, name in enumerate(SLOW)}
    items.sort(key=lambda item: places.get(item.path.name, len(places)))


@pytest.fixture(scope="session")
def plate() -> Robot:
    """A free plate with one strip."""
    return free_plate()


@pytest.fixture(autouse=True)
def fixed_seeds() -> None:
    """The same random numbers in every run, whatever ran before."""
    random.seed(0)
    np.random.seed(0)


@pytest.fixture(autouse=True)
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """A test that reaches beyond this machine fails where it does so."""
    plain = socket.socket.connect

    def refuse(self: socket.socket, address: Any) -> None:
        if isinstance(address, tuple) and address[0] in ("127.0.0.1", "::1"):
            return plain(self, address)
        raise RuntimeError(f"a test reached for the network: {address!r}")

    monkeypatch.setattr(socket.socket, "connect", refuse)


@pytest.fixture
def interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equations run on CasADi's virtual machine: for few states, which take longer to compile.

    Compiled and interpreted equations are compared in tests/core/oracle/test_flight_fallback.py.
    """
    monkeypatch.setenv("PATAGIUM_TOLD_WITHOUT_COMPILER", "none")
    monkeypatch.setenv("PATAGIUM_COMPILER", "none")


@pytest.fixture
def speak(capsys: pytest.CaptureFixture[str]) -> Speak:
    """Say words to the program; get its exit code, its answer and its complaints."""
    return partial(say, capsys)


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator of random numbers with a fixed seed."""
    return np.random.default_rng(20240607)


GLIDER = """
name: glider
gravity: 9.8 m/s^2
bodies:
  hub:
    floating: true
    mass: 20 g
    inertia: {{xx: 4e-5 kg m^2, yy: 4e-5 kg m^2, zz: 4e-5 kg m^2}}
  frame:
    parent: hub
    orientation: [0, 0, {heading} deg]
    mass: 10 g
    center_of_mass: [4 cm, 0, 0]
    shape: {{type: box, size: [10 cm, 2 cm, 1 cm]}}
  tail:
    parent: frame
    at: [-15 cm, 0, 0]
    mass: 1 g
    shape: {{type: box, size: [3 cm, 10 cm, 1 mm]}}
  left_wing:
    parent: frame
    at: [0, 1 cm, 0]
    joints:
      - {{name: left_plunge, axis: x}}
    mass: 2 g
    center_of_mass: [0, 8 cm, 0]
    shape: {{type: plate, axis: y, chord: 8 cm, span: 16 cm, thickness: 1 mm}}
wings:
  - name: left_wing
    segments:
      - body: left_wing
        strips: 2
        stations:
          - {{span: 0 cm, leading: 4 cm, trailing: -4 cm}}
          - {{span: 16 cm, leading: 4 cm, trailing: -4 cm}}
  - name: tail
    segments:
      - body: tail
        strips: 1
        at: [0, -5 cm, 0]
        stations:
          - {{span: 0 cm, leading: 2 cm, trailing: -2 cm, incidence: -20 deg}}
          - {{span: 10 cm, leading: 2 cm, trailing: -2 cm, incidence: -20 deg}}
mirror:
  - {{from: left, to: right}}
"""


@pytest.fixture(scope="session")
def glider() -> Callable[..., Robot]:
    """An undamped glider with two hinged wings, its tail set for loops.

    Its frame is turned by `heading` on a hub as round as a ball: the machine stays the same,
    but its attitude is that of other axes, so that angles are singular elsewhere.
    """

    def made(attitude: str = "euler", heading: int = 0) -> Robot:
        return load_robot_text(GLIDER.format(heading=heading)).with_attitude(attitude)

    return made


ONE_WING = """\
name: one_wing
gravity: 9.8 m/s^2
bodies:
  wing:
    joints:
{joints}
    mass: 4 g
    center_of_mass: [-1 cm, 6 cm, 0]
    shape: {{type: plate, axis: y, chord: 10 cm, span: 12 cm, thickness: 0.25 mm}}
wings:
  - name: wing
    segments:
      - body: wing
        strips: 2
        stations:
          - {{span: 0, leading: 2 cm, trailing: -8 cm}}
          - {{span: 20 cm, leading: 2 cm, trailing: -6 cm}}
"""


@pytest.fixture(scope="session")
def one_wing() -> Callable[..., Robot]:
    """A wing of two strips on the ground, with joints as a robot file describes them."""

    def made(*joints: str) -> Robot:
        lines = [f"      - {{{joint}}}" for joint in joints]
        return load_robot_text(ONE_WING.format(joints="\n".join(lines)))

    return made


@pytest.fixture(scope="session")
def ornithopter_orbit() -> Orbit:
    """Periodic orbit of the ornithopter, computed once per test process; tests do not modify it."""
    return trim(load_robot("ornithopter"))


@pytest.fixture(autouse=True)
def closed_figures() -> Iterator[None]:
    """Figures left open by a test do not pile up."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
