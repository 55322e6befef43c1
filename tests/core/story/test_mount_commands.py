"""Arms, paths, load cells and URDFs as a person meets them on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import patagium as pt

from ...spoken import Speak

FLY = ("--duration", "0.02", "--time-step", "1e-3")


CARRIED = (
    *("--gait", "still", "--mount", "arm", "--path", "figure-of-eight", "--path-center"),
    *("0.65,0,0.2", "--path-size", "90,30 cm", "--path-along", "0,1,0", "--path-across", "0,0,1"),
    *("--arm-turn", "0,-90 deg,0"),
)


def test_simulate_on_an_arm(tmp_path: Path, speak: Speak) -> None:
    path = tmp_path / "carried.nc"
    words = ("simulate", "aerobat", *CARRIED, *FLY, "-o", path, "--json")
    cells = ("--load-cell", "body", "--load-cell", "left_humerus")
    answer = speak(*words, "--path-speed", "2 m/s", *cells)
    assert answer.code == 0 and json.loads(answer.out)["mount"] == "arm", answer.err
    flight = pt.load_flight(path)
    speed = np.linalg.norm(flight["v"].values[0, :3])
    assert speed == pytest.approx(2.0, rel=1e-12)  # it begins where it crosses
    assert flight["load_cell_wrench"].shape == (flight.sizes["time"], 2, 6)
    refused = speak(*words, "--path-speed", "3 m/s")
    assert refused.code == 2 and "expected speed within 3.142 rad/s, found" in refused.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--mount", "carried"), "--path"),
        (("--path", "circle"), "--mount arm or carried"),
        (("--arm", "ur5e"), "--arm: expected --mount arm with it"),
        (("--mount", "carried", "--path", "circle", "--path-size", "1,2 m"), "a circle's radius"),
        (("--mount", "carried", "--path", "line", "--path-frequency", "1"), "--path-frequency"),
        (("--mount", "carried", "--path", "gone.csv"), "gone.csv"),
        (("--load-cell", "body"), "a body that something holds"),
    ],
)
def test_a_mount_that_contradicts_itself_is_refused(
    words: tuple[str, ...], said: str, tmp_path: Path, speak: Speak
) -> None:
    refused = speak("simulate", "aerobat", "--gait", "still", *words, *FLY, "-o", tmp_path / "f.nc")
    assert refused.code == 2 and said in refused.err


@pytest.mark.parametrize(
    "words",
    [
        ("line", "--path-size", "10,0,5 cm", "--path-speed", "0.5"),
        ("circle", "--path-size", "20 cm", "--path-speed", "2", "--path-along", "0,1,0"),
        ("sinusoid", "--path-frequency", "2", "--path-amplitude", "z=5 cm"),
    ],
)
def test_simulate_along_other_paths(words: tuple[str, ...], tmp_path: Path, speak: Speak) -> None:
    path = tmp_path / "f.nc"
    carried = ("--gait", "still", "--mount", "carried", "--path", *words)
    assert speak("simulate", "aerobat", *carried, *FLY, "-o", path).code == 0
    assert np.abs(pt.load_flight(path)["a"].values[:, :3]).max() > 0.1


def test_a_urdf_is_told_with_what_it_lost(tmp_path: Path, speak: Speak) -> None:
    mass = "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"
    links = f"<link name='a'/><link name='b'>{mass}</inertial></link>"
    joint = "<joint name='j' type='continuous'><parent link='a'/><child link='b'/>"
    rough = "<dynamics friction='1'/></joint>"
    path = tmp_path / "swing.urdf"
    path.write_text(f"<robot name='swing'>{links}{joint}{rough}</robot>")
    answer = speak("robots", path, "--json")
    assert answer.code == 0 and json.loads(answer.out)["coordinates"] == 1
    assert "joint j: its Coulomb friction is left out" in answer.err
    assert speak("check", path).code == 0
