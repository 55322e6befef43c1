"""`patagium study validate`: the page, and the errors it promises."""

from __future__ import annotations

import json
from contextlib import redirect_stdout
from importlib import import_module
from io import StringIO

import numpy as np
import pytest
from tests.validation_page import errors_of_the_page

from patagium.cli.main import run
from patagium.errors import ParameterError, ShapeError
from patagium.robot import load_robot_text
from patagium_lab.validation.cases import bent_wing, folding_tip
from patagium_lab.validation.cases.case import CaseResult
from patagium_lab.validation.cases.plunge import FINITE_LAGS
from patagium_lab.validation.cases.robotic_fly import HORIZONTAL, VERTICAL, measured
from patagium_lab.validation.plan import CASES, ValidationPlan

FEW_STATES = ("measured_wing", "pitching_section")
"""Cases whose equations take longer to compile than to interpret."""


def interpreted_case(compute):
    """The case's function, with equations on CasADi's virtual machine."""

    def interpreted():
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("PATAGIUM_TOLD_WITHOUT_COMPILER", "none")
            patch.setenv("PATAGIUM_COMPILER", "none")
            return compute()

    return interpreted


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """All but the monarch, computed once by the command: text of the page, rows of the errors.

    tests/lab/unit/test_monarch.py computes the monarch, and holds it to the page, and
    tests/lab/unit/test_monarch_feedback.py some of its flights under feedback.
    """
    page = tmp_path_factory.mktemp("validation") / "page.html"
    out = StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        redirect_stdout(out),
        pytest.raises(SystemExit) as left,
    ):
        for case in FEW_STATES:
            module = import_module(f"patagium_lab.validation.cases.{case}")
            patch.setattr(module, "compute", interpreted_case(module.compute))
        only = [word for case in CASES if "monarch" not in case for word in ("--only", case)]
        run(["validate", *only, "-o", str(page), "--json"])
    assert not left.value.code
    return page.read_text("utf-8"), json.loads(out.getvalue())


@pytest.fixture(scope="module")
def errors(command):
    return {(row["case"], row["model"]): row["error"] for row in command[1] if row["ours"]}


def test_errors_against_theory_are_the_ones_promised(errors):
    # Wagner and Theodorsen: what the fitted sets reach, in the limit of a wing without end
    assert errors["Wagner step", "two states"] <= 0.010
    assert errors["Theodorsen", "two states"] <= 0.015
    assert errors["Theodorsen", "four states"] <= 0.005
    assert errors["Theodorsen", "one state"] > 0.02  # and it can tell
    # Kuessner and Sears: no more than the lags' own error
    assert errors["Sharp-edged gust", "two states"] <= 0.010
    assert errors["Sharp-edged gust", "four states"] <= 0.0015
    assert errors["Gust that goes up and down", "two states"] <= 0.015
    assert errors["Gust that goes up and down", "four states"] <= 0.003
    for quantity in ("lift", "induced drag"):
        assert errors[f"Elliptic wing, {quantity}", "40 strips"] < 0.01
        assert errors[f"Rectangular wing, {quantity}", "40 strips"] < 0.01
        assert errors[f"Elliptic wing, {quantity}", "limit of many strips"] < 1e-4
    # Garrick's thrust and Jones' finite wings: what the lags leave
    assert errors["Thrust of a section that heaves and pitches", "four states"] < 0.01
    for ratio in (3, 6):
        case = f"Sudden plunge, wing of aspect ratio {ratio}"
        finite, endless = (errors[case, m] for m in (FINITE_LAGS, "lifting line"))
        assert finite < 0.02 < endless
    # Jones' own exponentials, on the wing without end
    assert errors["Sudden plunge, wing without end", "lifting line"] < 1e-3


def test_the_robotic_fly_is_in_step_with_its_record(errors):
    # a record that is shifted by an eighth of a beat, or has another sign, is more than .9 off
    case = "Robotic wing of a fruit fly, horizontal force"
    assert errors[case, "quasi-steady"] < 0.55
    phase = np.arange(100) / 100
    shifted = measured(HORIZONTAL, phase + 0.125) - measured(HORIZONTAL, phase)
    assert np.sqrt(np.mean(shifted**2) / np.mean(measured(HORIZONTAL, phase) ** 2)) > 0.9
    # its mean is the fly's weight: the robot was scaled to it
    assert measured(VERTICAL, phase).mean() == pytest.approx(1.0, abs=0.03)


def test_a_bending_wing_is_near_its_measurements_and_can_tell_stiffness(errors):
    assert errors["A bending wing, frequencies", "hinged pieces"] < 0.05
    assert errors["A bending wing under weights, bend", "hinged pieces"] < 0.05
    # of another program with the same beam: .102 and .046 (.166 in twist)
    assert errors["A bending wing in the wind, 5 degrees", "lifting line"] < 0.19
    assert errors["A bending wing in the wind, 7 degrees", "lifting line"] < 0.10
    robot = bent_wing.wing(mass=1.0)
    softer = load_robot_text(robot.source.replace("bending: 4.475", "bending: 4.0"))
    sunk = []
    for one in (robot, softer):
        q = bent_wing.at_rest(bent_wing.forces_at_rest(one), one, np.zeros(one.dof))
        sunk.append(-100 * bent_wing.tip(one, q, axis=2)[0] / bent_wing.SPAN)
    # by 12 % softer, sinks by less than 12 % more, as it turns towards the weight; own weight too
    assert 1.07 < sunk[1] / sunk[0] < 1.12


def test_a_tip_folds_the_less_the_more_its_hinge_turns_out(errors):
    # 10 degrees of hinge: 145 degrees of fold over 48 of incidence; 20 degrees: 114 (measured)
    for hinge, reached in ((10.0, 145.1), (20.0, 114.3)):
        measured_folds = folding_tip.FOLDS[hinge]
        assert measured_folds[-1] - measured_folds[0] == pytest.approx(reached, abs=0.1)
        assert errors[f"A folding wing tip, hinge at {hinge:g} degrees", "lifting line"] < 12.0


def test_the_page_of_the_documentation_is_of_these_models(errors):
    shown = errors_of_the_page()
    old = "stale: patagium study validate -o docs/validation.md"
    assert [key for key in errors if key not in shown] == [], old
    for key, error in errors.items():
        # three digits are printed; tiny ones are rounding
        assert shown[key] == pytest.approx(error, rel=0.02, abs=1e-4), (key, old)


def test_the_pitching_section_is_nearer_than_its_static_polar(errors):
    # mean absolute C_l error of the static polar: .122 and .214; without delay .112 and .191
    for loop, static in (("C10l100AM20", 0.122), ("C10m100AM20", 0.214)):
        case = f"A pitching section, {loop}"
        delayed, at_once = (
            errors[case, name] for name in ("lifting line with stall delay", "without delay")
        )
        assert delayed < 0.5 * static
        assert delayed < at_once < static


def test_a_second_section_is_nearer_than_its_static_polar_in_lift_and_drag(errors):
    # mean absolute error of the static polar: lift .194 and .396, drag .0215 and .0397; the moment
    # (.0265 and .0478) is a miss of the page
    for loop, lift, drag in (("6", 0.194, 0.0215), ("10", 0.396, 0.0397)):
        case = f"A pitching section, NACA 23012A by {loop} degrees"
        assert errors[f"{case}, lift", "lifting line with stall delay"] < 0.66 * lift
        assert errors[f"{case}, drag", "lifting line with stall delay"] < 0.8 * drag


def test_the_command_writes_the_page(command, errors):
    page, rows = command
    measured = "A measured flapping wing"
    assert (
        errors[measured, "lifting line, two states and added mass"] <= 0.027
    )  # newton; a vortex lattice: .0291
    strips = errors[measured, "DeLaurier's strips and added mass"]
    assert strips == pytest.approx(0.0225, abs=5e-4)
    assert any(not row["ours"] for row in rows)
    cases = {row["case"] for row in rows}
    assert page.count("<img") == len(cases) and all(case in page for case in cases)


def test_the_command_computes_one_case_alone(tmp_path, capsys):
    with pytest.raises(SystemExit) as left:
        run(["validate", "--only", "wagner", "-o", str(tmp_path / "page.html"), "--json"])
    assert not left.value.code
    assert {row["case"] for row in json.loads(capsys.readouterr().out)} == {"Wagner step"}


def test_an_unknown_case_is_refused():
    with pytest.raises(ParameterError, match="wagner"):
        ValidationPlan(("wager",))


def test_every_module_of_cases_is_named():
    for name in CASES:
        assert callable(import_module(f"patagium_lab.validation.cases.{name}").compute)
    with pytest.raises(ShapeError):
        x = np.zeros(3)
        CaseResult("a", "b", "c", "d", x, x, {"e": np.zeros(2)}, "f", {}, {}, "g")
