"""The bench of the air: models beside each other, and a robot with other strips."""

from __future__ import annotations

import numpy as np
import pytest

from patagium.aerodynamics import QuasiSteady
from patagium.native import compiler_name
from patagium.robot import load_robot
from patagium_lab.bench.air import restriped, strip_results


@pytest.mark.parametrize("name", ["aerobat", "yeo-wing"])
def test_other_strips_cover_the_same_wing(name: str) -> None:
    robot = load_robot(name)
    many = restriped(robot, 40)
    assert len(many.strips) == 40
    for wing in {strip.wing for strip in robot.strips}:
        old, new = ([s for s in r.strips if s.wing == wing] for r in (robot, many))
        assert sum(s.width for s in new) == pytest.approx(sum(s.width for s in old))
        area = [sum(s.width * s.chord for s in strips) for strips in (old, new)]
        assert area[1] == pytest.approx(area[0], rel=0.02)  # chords between the old ones
    v = np.zeros(robot.dof)
    wind = [-4.0, 0.0, 0.5]
    force, finer = (
        QuasiSteady(r).strips(np.zeros(robot.dof), v, wind=wind)["strip_force"].sum(axis=0)
        for r in (robot, many)
    )
    assert np.allclose(finer, force, rtol=0.03, atol=1e-6)


@pytest.mark.skipif(compiler_name() is None, reason="needs a C compiler")
def test_lines_of_few_strips_are_whole() -> None:
    first, second = strip_results(load_robot("aerobat"), (2, 4))
    assert first.against is None and first.value is not None and first.value > 0
    assert second.against == first.name
    assert second.ratio == pytest.approx(second.value / first.value)
