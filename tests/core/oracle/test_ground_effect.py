"""Wings near the ground: lift and drag of an elliptic wing against lifting-line theory with images.

The oracle solves Prandtl's integral equation of the wing and of its mirror image with a sine
series, at points between; it shares nothing with the program.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import j1

import patagium as pt
from patagium.aerodynamics import DeLaurier, LiftingLine, QuasiSteady, Section
from patagium.aerodynamics.description import aero_from_description
from patagium.aerodynamics.ground import ground_share
from patagium.aerodynamics.indicial import NO_STATE
from patagium.aerodynamics.model import Aerodynamics, aero_functions
from patagium.errors import ParameterError
from patagium.robot import Body, Robot, Strip

AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
ZERO = (0.0, 0.0, 0.0)
ASPECT_RATIO, ANGLE, SPEED = 6.0, 1e-3, 10.0
SPAN = ASPECT_RATIO * np.pi / 4
HEIGHTS = (0.1, 0.25, 0.5)


def elliptic(count: int) -> Robot:
    """Free elliptic wing of root chord 1 m."""
    ends = np.linspace(-1.0, 1.0, count + 1)
    area = np.diff((ends * np.sqrt(1 - ends**2) + np.arcsin(ends)) / 2) * SPAN / 2
    edges = ends * SPAN / 2
    strips = tuple(
        Strip(
            f"wing[{i}]", "wing", 0, False, (0.0, (edges[i] + edges[i + 1]) / 2, 0.0),
            AXES[0], AXES[2], area[i] / (edges[i + 1] - edges[i]), edges[i + 1] - edges[i],
        )
        for i in range(count)
    )  # fmt: skip
    body = Body("wing", -1, ZERO, AXES, (), tuple(range(6)), 0.01, ZERO, (1e-5,) * 3 + (0.0,) * 3)
    names, units = ("x", "y", "z", "roll", "pitch", "yaw"), ("m",) * 3 + ("rad",) * 3
    infinite = (np.inf,) * 6
    return Robot(
        "elliptic", (body,), strips, names, units, (), (0.0,) * 6,
        tuple(-x for x in infinite), infinite, 9.81,
    )  # fmt: skip


def theory(height: float, terms: int = 60) -> float:
    """Lift slope by a sine series of the circulation, wing and image; height over span."""
    n = np.arange(1, terms + 1)
    at = (n - 0.5) * np.pi / terms  # collocation
    fine = (np.arange(4000) + 0.5) * np.pi / 4000
    y, y0 = np.cos(fine) / 2, np.cos(at) / 2  # over the span
    apart = y0[:, None] - y
    kernel = apart / (apart**2 + (2 * height) ** 2)
    slopes = n * np.cos(np.outer(fine, n))  # d Gamma / d theta of sin n theta
    image = kernel @ slopes * (np.pi / 4000) / (4 * np.pi)
    own = n * np.sin(np.outer(at, n)) / np.sin(at)[:, None] / 2
    wash = own + image  # the image's sign is that of the mirrored vortex: it lifts
    chord = np.sin(at) * 4 / (np.pi * ASPECT_RATIO)
    matrix = np.sin(np.outer(at, n)) + np.pi * chord[:, None] * wash
    first = np.linalg.solve(matrix, np.pi * chord)[0]
    return float(first * np.pi / 2 * ASPECT_RATIO)


def coefficients(model: Aerodynamics, height: float, **attitude: float) -> np.ndarray:
    """Lift over pressure and area, and drag, of a wing at a height above the ground [1]."""
    robot = model.robot
    v = SPEED * np.array([np.cos(ANGLE), 0, -np.sin(ANGLE), 0, 0, 0])
    q = robot.coordinates(z=height, **attitude)
    lags = SPEED * np.sin(ANGLE) * np.ones(model.state_size)  # where lags come to rest
    force = aero_functions(model)[0](q, v, lags, np.zeros(3), robot.parameters, model.parameters)
    x, y, z = np.array(force).ravel()[:3]
    area = sum(float(strip.chord * strip.width) for strip in robot.strips)
    pressure = 0.5 * model.air.density * SPEED**2 * area
    lift, drag = z * np.cos(ANGLE) + x * np.sin(ANGLE), z * np.sin(ANGLE) - x * np.cos(ANGLE)
    return np.array([lift, drag, y]) / pressure


def line(air: pt.Air, count: int = 24) -> LiftingLine:
    section = Section(profile_drag=0.0)
    return LiftingLine(elliptic(count), air, lags=NO_STATE, section=section, surface_constant=0.0)


def test_the_theory_far_away_is_the_closed_form() -> None:
    assert theory(1e3) == pytest.approx(2 * np.pi / (1 + 2 / ASPECT_RATIO), rel=1e-6)


@pytest.fixture(scope="module")
def free() -> np.ndarray:
    return coefficients(line(pt.Air()), 0.0)


@pytest.mark.parametrize("height", HEIGHTS)
def test_lift_gain_of_a_lifting_line(free: np.ndarray, height: float) -> None:
    near = coefficients(line(pt.Air(ground=0.3)), 0.3 + height * SPAN)
    gain, wanted = near[0] / free[0], theory(height) / theory(1e3)
    assert gain == pytest.approx(wanted, rel=0.02)
    assert gain - 1 == pytest.approx(wanted - 1, rel=0.05)  # 24 strips
    # induced drag over the square of lift falls by the share of an elliptic loading
    share = near[1] / near[0] ** 2 / (free[1] / free[0] ** 2)
    assert share == pytest.approx(1 - float(ground_share(height, 1.0)), rel=0.02)


@pytest.mark.parametrize("height", HEIGHTS)
def test_blade_elements_take_the_same_share(height: float) -> None:
    """A polar of the finite wing gains what the theory says, within the loading's change."""
    wanted = theory(height) / theory(1e3)
    angle = tuple(np.linspace(-0.3, 0.3, 25))
    lift = tuple(2 * np.pi / (1 + 2 / ASPECT_RATIO) * np.array(angle))
    polar = pt.air.TablePolar(angle, lift, tuple(0.1 + 0 * np.array(angle)))
    for make in (lambda robot, air: QuasiSteady(robot, air, polar=polar), DeLaurier):
        far, near = (make(elliptic(8), air) for air in (pt.Air(), pt.Air(ground=0.0)))
        lift_far, lift_near = (coefficients(model, height * SPAN)[0] for model in (far, near))
        assert lift_near / lift_far == pytest.approx(wanted, rel=0.02)


def test_a_banked_wing_is_pushed_by_the_nearer_half() -> None:
    near = line(pt.Air(ground=0.0), 8)
    rolled = [coefficients(near, 0.3 * SPAN, roll=side * 0.2) for side in (-1, 1)]
    np.testing.assert_allclose(rolled[0][[0, 1]], rolled[1][[0, 1]], rtol=1e-9)
    assert rolled[0][2] == pytest.approx(-rolled[1][2], rel=1e-9)


def test_far_from_the_ground_nothing_changes() -> None:
    far = coefficients(line(pt.Air(ground=0.0), 8), 1e3 * SPAN)
    np.testing.assert_allclose(far, coefficients(line(pt.Air(), 8), 0.0), rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("height", [0.01, 0.02, 0.03, 0.05, 0.1, 0.25, 0.5, 1.0])
def test_the_share_is_that_of_an_elliptic_loading(height: float) -> None:
    """2 int_0^inf J1(k)^2/k exp(-4 k x) dk; at .01 the share was .017 less."""
    wave = np.linspace(0.0, 2000.0, 200_001)[1:]  # .01 apart, beyond it exp(-80)
    loading = 2 * j1(wave) ** 2 / wave * np.exp(-4 * wave * height)
    exact = np.trapezoid(loading, wave)
    assert float(ground_share(height, 1.0)) == pytest.approx(exact, abs=3e-4)  # its docstring's


def test_the_share_is_smooth_and_falls_with_height() -> None:
    heights = np.linspace(-0.2, 3.0, 400)
    shares = np.array([float(ground_share(h, 1.0)) for h in heights])
    assert (np.diff(shares) < 0).all() and shares.max() <= 1 and shares.min() > 0


@pytest.mark.parametrize("make", [QuasiSteady, DeLaurier, LiftingLine])
def test_ground_is_described_and_a_parameter(make: type[Aerodynamics]) -> None:
    robot = elliptic(4)
    aero = pt.air.Inflow(make(robot, pt.Air(ground=0.5)))
    again = aero_from_description(robot, aero.describe())
    assert again.air.ground == 0.5 and "ground" in again.parameter_names
    assert dict(zip(again.parameter_names, again.parameters, strict=True))["ground"] == 0.5
    assert "ground" not in make(robot).parameter_names
    assert "ground" not in make(robot).air.describe()


@pytest.mark.parametrize("make", [QuasiSteady, DeLaurier, LiftingLine])
def test_lift_grows_as_the_ground_comes_near(make: type[Aerodynamics]) -> None:
    robot = elliptic(4)
    lift = [coefficients(make(robot, pt.Air(ground=h)), 1.0)[0] for h in (0.0, 0.1, 0.2)]
    assert (np.diff(lift) > 1e-7).all()


@pytest.mark.usefixtures("interpreted")
def test_the_inflow_of_a_stroke_fades_near_the_ground() -> None:
    robot = pt.load_robot("dragonfly")
    q, v, speeds = robot.coordinates(), np.zeros(robot.dof), []
    v[list(robot.actuated)] = 20.0
    for ground in (None, -0.02):
        air = pt.air.Inflow(pt.QuasiSteady(robot, pt.Air(ground=ground)))
        speeds.append(np.linalg.norm(air.state_derivative(q, v, np.zeros(air.state_size))[:3]))
    assert 0.2 < speeds[1] / speeds[0] < 0.95


def test_refused() -> None:
    with pytest.raises(ParameterError, match="ground"):
        pt.Air(ground=float("nan"))
    with pytest.raises(ParameterError, match="without ground"):
        pt.Air(ground=0.0).require_uniform("aero")
