"""The reduced case of the pitching section is what the raw records give."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from patagium.errors import LogError
from patagium_lab.validation.pitching import load_pitching_case, measured_loop

RAW = Path(__file__).parents[3].parent / "shared" / "data" / "osu_unsteady"
needs_raw = pytest.mark.skipif(
    not RAW.is_dir(), reason="the raw records of the pitching section are not beside the repository"
)


@needs_raw
@pytest.mark.parametrize("index", [0, 1])
def test_the_shipped_loops_are_computed_from_the_raw_records(index: int) -> None:
    shipped = load_pitching_case().loops[index]
    file = RAW / f"{shipped.name}_s809_Validacion.txt"
    again = measured_loop(file, shipped.name, shipped.frequency)
    np.testing.assert_allclose(shipped.incidence, again.incidence, atol=6e-6)  # digits shipped
    np.testing.assert_allclose(shipped.lift, again.lift, atol=1e-12)
    for name in ("mean", "amplitude", "samples_per_cycle", "first_phase"):
        assert getattr(shipped, name) == pytest.approx(getattr(again, name), abs=1e-7), name


@needs_raw
def test_the_shipped_polar_is_the_raw_table() -> None:
    case = load_pitching_case()
    lines = (RAW / "S809_AD15.dat").read_text(encoding="latin1").splitlines()
    rows = [line.split() for line in lines if len(line.split()) == 4]
    table = {round(float(r[0]), 1): r for r in rows if r[0].lstrip("-").replace(".", "").isdigit()}
    for angle, lift, drag in zip(case.angle, case.static_lift, case.static_drag, strict=True):
        row = table[round(float(np.degrees(angle)), 1)]
        assert [lift, drag] == [float(row[1]), float(row[2])]


def test_the_fitted_motion_is_the_measured_one() -> None:
    case = load_pitching_case()
    for loop in case.loops:
        assert len(loop.incidence) == len(loop.lift) == 120
        error = loop.motion(loop.phase)[0] - loop.incidence
        assert np.sqrt(np.mean(error**2)) < np.radians(0.4)  # tenths of a degree are recorded
    assert np.degrees(case.loops[1].amplitude) == pytest.approx(10.6836, abs=0.01)  # driver file
    assert np.degrees(case.loops[1].mean) == pytest.approx(18.7768, abs=0.01)


def test_derivatives_of_the_motion_are_those_of_differences() -> None:
    loop = load_pitching_case().loops[0]
    phase, step = np.linspace(0.0, 6.0, 7), 1e-4
    for k in (0, 1):
        slope = (loop.motion(phase + step)[k] - loop.motion(phase - step)[k]) / (2 * step)
        assert np.allclose(slope, loop.motion(phase)[k + 1], atol=1e-8)


def test_a_missing_record_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no such file"):
        measured_loop(tmp_path / "none.txt", "none", 1.0)
