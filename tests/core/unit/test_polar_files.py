"""Polars from files: XFOIL's text, comma-separated values, and refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import patagium as pt
from patagium.cli.estimates import air_model
from patagium.cli.main import run
from patagium.errors import PatagiumError

XFOIL = """
       XFOIL         Version 6.99

 Calculated polar for: NACA 0012

 Mach =   0.000     Re =     0.500 e 6     Ncrit =   9.000

   alpha    CL        CD       CDp       CM     Top_Xtr  Bot_Xtr
  ------ -------- --------- --------- -------- -------- --------
   8.000   0.8590   0.00870   0.00260   0.0010   0.3000   0.9900
  -8.000  -0.8590   0.00870   0.00260  -0.0010   0.9900   0.3000
   0.000   0.0000   0.00650   0.00130   0.0000   0.6000   0.6000
"""


def test_a_polar_of_xfoil_makes_a_section(tmp_path: Path) -> None:
    file = tmp_path / "naca0012.txt"
    file.write_text(XFOIL)
    table = pt.air.read_polar(file)
    assert np.allclose(np.degrees(table.angle), [-8, 0, 8])
    assert np.allclose(table.drag, [0.0087, 0.0065, 0.0087])
    assert table.moment is not None and np.allclose(table.moment, [-0.001, 0, 0.001])
    section = pt.air.measured_section(*table)
    assert section.lift_slope == pytest.approx(0.859 / np.sin(np.radians(8)))
    measured = np.isin(section.stalled.angle, table.angle)
    assert np.allclose(np.array(section.static_moment)[measured], table.moment)


def test_a_polar_that_ends_early_goes_on_as_a_plate() -> None:
    angle = np.radians(np.arange(-8.0, 17.0))
    lift, drag = 6.0 * np.sin(angle), 0.02 + 0.1 * np.sin(angle) ** 2
    section = pt.air.measured_section(angle, lift, drag, 0 * angle - 0.05)
    at, separated = np.degrees(section.stalled.angle), section.stalled
    assert at[0] == -90 and at[-1] == 90
    assert separated.drag[0] == separated.drag[-1] == pytest.approx(2.01)  # a long plate
    assert np.allclose([separated.lift[0], separated.lift[-1]], 0.0, atol=1e-12)
    for side, last in ((1, 16.0), (-1, -8.0)):  # Viterna & Janetzke's equations by hand
        end, far = np.radians(abs(last)), np.radians(side * at[at * side > side * last])
        first = (6.0 * np.sin(end) - 2.01 * np.sin(end) * np.cos(end)) * np.tan(end) / np.cos(end)
        wanted = 1.005 * np.sin(2 * far) + first * np.cos(far) ** 2 / np.sin(far)
        found = np.interp(side * np.degrees(far), at, separated.lift)
        share = np.interp(side * np.degrees(far), at, section.separated)
        attached = section.lift_slope * np.sin(far)
        assert np.allclose((1 - share) * attached + side * share * found, wanted)
    moments = np.abs(np.diff(section.static_moment))
    assert moments.max() < 0.1 and abs(section.static_moment[-1]) == pytest.approx(2.01 * 0.175)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("first", [-2.0, 0.0])
def test_the_missing_side_of_a_symmetric_section_is_its_mirror_image(
    side: int, first: float
) -> None:
    degrees = np.arange(-15.0, 16.0)
    angle, lift = np.radians(degrees), 1.1 * np.tanh(degrees / 9)
    whole = lift, 0.01 + lift**4 / 20, -0.01 * lift
    given = side * degrees >= first
    both = pt.air.measured_section(angle, *whole)
    with pytest.warns(
        UserWarning, match=f"ends at {0 - first:.3g} degrees; the other side is taken"
    ):
        one = pt.air.measured_section(angle[given], *(column[given] for column in whole))
    assert np.allclose(one.parameters, both.parameters)


@pytest.mark.parametrize("mark", ["# ", "#", "%", " # "])
def test_a_mark_before_the_header_shifts_no_column(tmp_path: Path, mark: str) -> None:
    """NumPy's savetxt writes one: alpha was C_L, C_L was C_D, and C_m where the flow turns."""
    file = tmp_path / "saved.txt"
    file.write_text(XFOIL.replace("   alpha", mark + "alpha"))
    table = pt.air.read_polar(file)
    assert np.allclose(np.degrees(table.angle), [-8, 0, 8])
    assert table.moment is not None and np.allclose(table.moment, [-0.001, 0, 0.001])


def test_a_side_that_ends_before_its_stall_is_refused() -> None:
    degrees = np.arange(-5.0, 16.0)
    lift = 6.0 * np.sin(np.radians(degrees + 3.0))
    with pytest.raises(
        PatagiumError, match=r"both sides.*aseq.*found '-5 to 15, no lift at -3 deg"
    ):
        pt.air.measured_section(np.radians(degrees), lift, 0.01 + 0 * lift)


@pytest.mark.parametrize("zero", range(-4, 5))
def test_a_polar_that_reaches_just_six_degrees_is_taken(zero: int) -> None:
    """A polar that reaches six degrees was refused where rounding had it below."""
    angle = np.radians(np.arange(zero - 6, zero + 7))
    lift = 2 * np.pi * (angle - np.radians(zero))
    section = pt.air.measured_section(angle, lift, 0.01 + 0.01 * lift**2)
    assert section.zero_lift_angle == pytest.approx(np.radians(zero), abs=1e-12)  # rounding


def test_columns_are_found_by_name_and_a_moment_may_be_missing(tmp_path: Path) -> None:
    file = tmp_path / "polar.csv"
    file.write_text('"analysis_confidence","CD","alpha","CL"\n0.9,0.01,5,0.5\n0.9,0.02,-5,-0.4\n')
    table = pt.air.read_polar(file)
    assert np.allclose(np.degrees(table.angle), [-5, 5]) and np.allclose(table.lift, [-0.4, 0.5])
    assert table.moment is None


NAMES = ["alpha", "alpha [deg]", "Alpha (deg)", "alpha [rad]", "AoA (deg)", "AOA", "alpha_rad"]


@pytest.mark.parametrize("name", [*NAMES, "aoa_deg"])
@pytest.mark.parametrize("apart", [",", " "])
def test_a_unit_shifts_no_column_and_an_empty_cell_leaves_its_row_out(
    tmp_path: Path, name: str, apart: str
) -> None:
    file, size = tmp_path / "polar.csv", np.radians(1) if "rad" in name else 1.0
    rows = [(k * size, "" if k == 3 else k / 10, 0.02, 0.009, -0.05) for k in range(5)]
    kept = [row for row in rows if apart == "," or row[1] != ""]
    lines = [(name, "CL [-]", "CD", "CDp", "CM"), *kept]
    file.write_text("\n".join(apart.join(map(str, line)) for line in lines))
    table = pt.air.read_polar(file)
    assert np.allclose(np.degrees(table.angle), [0, 1, 2, 4])
    assert np.allclose(table.lift, [0, 0.1, 0.2, 0.4])
    assert np.allclose(table.drag, 0.02) and np.allclose(table.moment, -0.05)


@pytest.mark.parametrize(
    "text",
    [
        "alpha;CL;CD\n-1;-0,11;0,0125\n1,5;0,16;0,01\n",
        'name,alpha,CL,CD\n"a, b","-1","-0,11","0,0125"\n"a, b","1,5","0,16","0,01"\n',
        "alpha\tCL\tCD\n-1,0\t-0,11\t0,0125\n1,5\t0,16\t0,01\n",
        "alpha,CL,CD,Re\n-1,-.11,.0125,1e5\n1.5,.16,.01,100000.0\n2,,.01,\n",
    ],
)
def test_commas_in_numbers_and_one_reynolds_number_in_many_spellings(
    tmp_path: Path, text: str
) -> None:
    file = tmp_path / "polar.csv"
    file.write_text(text)
    angle, lift, drag, _ = pt.air.read_polar(file)
    assert np.allclose(np.degrees(angle), [-1, 1.5])
    assert np.allclose(lift, [-0.11, 0.16]) and np.allclose(drag, [0.0125, 0.01])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 2 3\n", "header"),
        ("alpha CL CD\n1 0.1 0.01\n", "two or more rows"),
        ("alpha CL CD\n1 .1 .01\n2 .2 .01\nalpha CD CL\n3 .01 .3\n", "one header.*found 2"),
        ("alpha [turn],CL,CD\n0,0,.01\n1,.1,.01\n", r"\[deg\] or \[rad\], found turn"),
        ("alpha,CL,CD\n0,0, 0,0, 0,01\n1,0, 0,1, 0,01\n", "line 2: expected 3 cells, found 6;"),
        ("alpha,CL,CD\n-.1,-.6,.01\n.1,.6,.01\n", r"alpha: expected degrees.*alpha \[rad\]"),
        ("alpha,Reynolds number,CL,CD\n0,5e4,0,.01\n1,2e5,.1,.01\n", "one Reynolds number"),
        ("alpha,Re,CL,CD\n0,5e4,0,.01\n1,2e5,.1,.01\n", "one Reynolds number, found 50000, 200000"),
    ],
)
def test_what_is_no_polar_is_refused(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "polar.txt"
    file.write_text(text)
    with pytest.raises(PatagiumError, match=said):
        pt.air.read_polar(file)
    with pytest.raises(PatagiumError, match="no such file"):
        pt.air.read_polar(tmp_path / "none.txt")


def test_the_program_takes_a_polar_by_name_or_file(tmp_path: Path) -> None:
    file, robot = tmp_path / "naca0012.txt", pt.load_robot("aerobat")
    file.write_text(XFOIL)
    plain = air_model("quasi-steady", robot, pt.Air())
    insect = air_model("quasi-steady", robot, pt.Air(), ["reynolds"])
    assert plain == pt.QuasiSteady(robot)
    assert insect == pt.QuasiSteady(robot, polar=pt.air.ReynoldsPolar())
    with pytest.raises(
        PatagiumError, match="--density: expected 0.5 to 2 .*viscosity of air.*found 1000"
    ):
        air_model("quasi-steady", robot, pt.Air(density=1000.0), ["reynolds"])
    measured = air_model("quasi-steady", robot, pt.Air(), [str(file)]).polar
    assert measured == pt.air.measured_polar(*pt.air.read_polar(file)[:3])
    assert np.degrees(measured.angle)[[0, -1]] == pytest.approx([-90, 90])
    section = pt.air.measured_section(*pt.air.read_polar(file))
    line = air_model("lifting-line", robot, pt.Air(), [str(file)])
    assert line.describe() == pt.LiftingLine(robot, section=section).describe()


@pytest.mark.parametrize("verb", ["simulate", "trim", "optimize"])
@pytest.mark.parametrize("air", ["quasi-steady", "lifting-line", "delaurier"])
def test_a_polar_that_the_air_does_not_take_is_refused(verb: str, air: str, capsys) -> None:
    polar = "naca0012.txt" if air == "quasi-steady" else "reynolds"
    with pytest.raises(SystemExit) as left:
        run([verb, "aerobat", "--aero", air, "--polar", polar])
    assert left.value.code == 2
    expected = "dickinson, reynolds or a file of a polar"
    if air == "delaurier":
        expected = "none with delaurier, whose strips have no polar: take --aero quasi-steady or li"
    assert f"--polar: expected {expected}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("degrees", "drag", "said"),
    [
        ((-8.0, 0.0, 8.0), -0.01, r"point 2: expected .*drags >= 0.*found '0 degrees, C_L 0.1"),
        ((-180.0, 0.0, 8.0), 0.01, "point 1: expected ascending angles from -90.*'-180 degrees"),
        ((0.0, -8.0, 8.0), 0.01, "point 2: expected ascending"),
    ],
)
def test_the_point_that_no_polar_has_is_named(
    degrees: tuple[float, ...], drag: float, said: str
) -> None:
    with pytest.raises(PatagiumError, match=said):
        pt.air.TablePolar(tuple(np.radians(degrees)), (0.0, 0.1, 0.2), (0.02, drag, 0.02))
    with pytest.raises(PatagiumError, match=r"two or more angles.*found \[3, 2, 3\]"):
        pt.air.TablePolar(tuple(np.radians(degrees)), (0.0, 0.1), (0.02, drag, 0.02))


def test_an_option_without_its_number_is_told_what_one_is(capsys) -> None:
    with pytest.raises(SystemExit):
        run(["simulate", "aerobat", "--added-mass", "-o", "x.nc"])
    assert "--added-mass: expected a number such as 1, found '-o'" in capsys.readouterr().err


@pytest.mark.parametrize("aerodyn", [True, False])
def test_of_a_polar_all_around_the_part_within_90_degrees_is_taken(
    aerodyn: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The tables of wind turbines, of AeroDyn 15 as well."""
    degrees = np.arange(-180.0, 181.0, 5.0)
    sine = np.sin(np.radians(degrees))
    lift = np.where(np.abs(degrees) <= 15, 6 * sine, 1.1 * np.sin(2 * np.radians(degrees)))
    rows = np.column_stack([degrees, lift, 0.01 + 1.3 * sine**2, -0.2 * sine])
    head = "alpha CL CD CM\n"
    if aerodyn:
        head = (
            "! ------------ AirfoilInfo v1.01.x Input File ----------\n"
            "          1   NumTabs    ! Number of airfoil tables in this file.\n"
            "       0.75   Re         ! Reynolds number in millions\n"
            "          0   alpha0     ! 0-lift angle of attack, depends on airfoil.\n"
            "         73   NumAlf     ! Number of data lines in the following table\n"
            "!    Alpha      Cl      Cd        Cm\n!    (deg)      (-)     (-)       (-)\n"
        )
    file = tmp_path / "airfoil.dat"
    file.write_text(head + "\n".join(" ".join(f"{x:.6f}" for x in row) for row in rows) + "\n")
    with pytest.warns(UserWarning, match="36 of 73 rows are beyond 90 degrees"):
        table = pt.air.read_polar(file)
    within = np.abs(degrees) <= 90
    assert np.allclose(np.degrees(table.angle), degrees[within])
    assert np.allclose(table[1:], rows[within, 1:].T, atol=1e-6)
    run_to_end(["check", str(file)])
    said = capsys.readouterr()
    assert "−90.0, 90.0" in said.out and "lift slope 6 1/rad" in said.out
    assert "36 of 73 rows" in said.err


@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_a_polar_from_0_to_360_degrees_is_that_from_minus_180_to_180(
    unit: str, tmp_path: Path
) -> None:
    """Incidences of 270 to 360 degrees were left out, and a cambered section was refused."""
    tables = []
    for first in (0, -180):
        alpha = np.arange(first, first + 361, 2.0)
        lift = 1.1 * np.sin(2 * np.radians(alpha) + 0.06)
        drag = 0.02 + 1.2 * np.sin(np.radians(alpha)) ** 2
        angle = np.radians(alpha) if unit == "rad" else alpha
        table = np.column_stack([angle, lift, drag])
        rows = "\n".join(",".join(f"{x:.6f}" for x in row) for row in table)
        (tmp_path / "polar.csv").write_text(f"alpha [{unit}],CL,CD\n{rows}\n")
        with pytest.warns(UserWarning, match="rows are beyond 90 degrees"):
            tables.append(pt.air.read_polar(tmp_path / "polar.csv"))
    sections = [pt.air.measured_section(*table) for table in tables]
    zero_lift = [section.zero_lift_angle for section in sections]
    assert zero_lift == pytest.approx([-0.03] * 2, abs=1e-4)  # straight between the points
    assert len(tables[0].angle) == pytest.approx(len(tables[1].angle), abs=2)  # 0 = 360 rounded
    drags = [np.interp(np.radians([-80, -3, 0, 50]), *table[::2]) for table in tables]
    assert np.allclose(*drags, atol=1e-4)  # digits in the file


def test_a_polar_is_checked_as_it_is_taken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`check` asked for a mapping, printed 14.999999999999998 degrees, and warned twice."""
    file = tmp_path / "polar.csv"
    file.write_text("alpha,CL,CD\n-10,-1,.02\n0,0,.01\n10,1,.02\n")
    run_to_end(["check", str(file), "--json"])
    assert '"least C_D [1]": 0.01' in capsys.readouterr().out
    file.write_text("alpha,CL,CD\n0,0,.01\n10,1,.02\n15,1.2,.05\n")
    run_to_end(["check", str(file)])
    said = capsys.readouterr()
    assert "0, 15.0" in said.out and said.err.count("symmetric") == 1
    file.write_text("alpha,CL,CD\n100,-1,.02\n110,0,.01\n")
    with pytest.warns(UserWarning), pytest.raises(PatagiumError, match="within 90 degrees"):
        pt.air.read_polar(file)


def run_to_end(words: list[str]) -> None:
    with pytest.raises(SystemExit) as left:
        run(words)
    assert left.value.code in (0, None)
