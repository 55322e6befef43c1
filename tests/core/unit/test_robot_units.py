"""Quantities are read with their unit, and refused with what was expected and found."""

import math
import subprocess
import sys

import pytest

from patagium.robot import units
from patagium.robot.units import UnitMismatch, in_si


@pytest.mark.parametrize(
    ("written", "unit", "value"),
    [
        ("12 cm", "m", 0.12),
        ("20 g", "kg", 0.020),
        ("20g", "kg", 0.020),
        ("15 Hz", "Hz", 15.0),
        ("5 deg", "rad", math.radians(5)),
        ("1 rad", "rad", 1.0),
        ("-0.5 mm", "m", -5e-4),
        ("4.8 g cm^2", "kg m^2", 4.8e-7),
        ("4.8 g*cm**2", "kg m^2", 4.8e-7),
        ("0.01 N m s/rad", "N m s/rad", 0.01),
        ("0.01 N*m*s", "N m s/rad", 0.01),
        ("9.8 m/s^2", "m/s^2", 9.8),
        ("1e-3", "m", 1e-3),
        (7, "m", 7.0),
        (0.5, "", 0.5),
        ("300 rpm", "Hz", 5.0),
        ("5 rps", "Hz", 5.0),
        ("5 turn/s", "Hz", 5.0),
        (f"{2 * math.pi} rad/s", "Hz", 1.0),
        ("5 1/s", "Hz", 5.0),
        ("60 rpm/s", "Hz/s", 1.0),
        ("30 rpm", "rad/s", math.pi),
    ],
)
def test_a_quantity_becomes_its_si_value(written, unit, value):
    assert in_si(written, unit, "a quantity") == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("written", "unit", "found"),
    [
        ("12 g", "m", r"'12 g', of dimension \[mass\]"),
        ("5 m", "rad", r"of dimension \[length\]"),
        ("5 percent", "rad", "a pure number"),
        ("3 bananas", "kg", "unknown unit 'bananas'"),
        ("3 m", "", "'3 m'"),
        ("8 gr", "kg", "'8 gr'; did you mean g?"),
        ("4 gr cm^2", "kg m^2", "did you mean g?"),
        ("5 Mm", "m", "did you mean mm?"),
        ("2 Hz", "rad/s", "'2 Hz', of dimension"),
        ("twelve cm", "m", "'twelve cm'"),
        ("0,5 g", "kg", "'0,5 g'; write '0.5 g'$"),
        ("0,5e-3 kg m^2", "kg m^2", "write '0.5e-3 kg m.2'$"),
        ("1,2,3 g", "kg", "'1,2,3 g'$"),
        ("1,000.5 g", "kg", "'1,000.5 g'$"),
        ("", "m", "''"),
        ("1 m^999999999", "m", "999"),
        (True, "m", "True"),
        (None, "m", "None"),
        ([1], "m", r"\[1\]"),
        (float("nan"), "m", "nan"),
        (float("inf"), "m", "inf"),
        ("1e999", "m", "1e999"),
        (10**400, "m", "too large"),
    ],
)
def test_a_wrong_quantity_names_what_was_expected_and_found(written, unit, found):
    with pytest.raises(UnitMismatch, match=found) as caught:
        in_si(written, unit, "a length")
    assert "a length" in caught.value.expected


def test_factors_of_common_units_are_those_of_pint():
    for (label, unit), factor in units._COMMON.items():
        base, wanted = (units.pint_units().Quantity(1.0, k).to_base_units() for k in (label, unit))
        assert base.units == wanted.units
        assert factor == base.magnitude / wanted.magnitude  # bit for bit: equations depend on it


def test_a_robot_file_loads_without_the_library_of_units():
    code = "import sys, patagium as pt; pt.load_robot('aerobat'); print('pint' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == "False\n"
