"""Steady wings in closed form, and how the error falls with the number of strips."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from patagium.aerodynamics import Air, Indicial, LiftingLine, Section
from patagium.aerodynamics.indicial import NO_STATE, TWO_STATE
from patagium.aerodynamics.model import aero_functions
from patagium.robot import Body, Robot, Strip

AIRSPEED, ANGLE = 10.0, 1e-4  # small, so that the closed forms are those of small angles
PLAIN = Section(profile_drag=0.0)


def wing(ends: np.ndarray, chord: np.ndarray) -> Robot:
    """A free plate with a straight quarter-chord line, its strips between the ends."""
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    inertia = (1e-5, 1e-5, 1e-5, 0.0, 0.0, 0.0)
    zero = (0.0, 0.0, 0.0)
    body = Body("plate", -1, zero, axes, (), tuple(range(6)), 0.01, zero, inertia)
    strips = tuple(
        Strip(
            f"wing[{i}]", "wing", 0, False, (0.0, float(ends[i] + ends[i + 1]) / 2, 0.0),
            (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), float(c), float(ends[i + 1] - ends[i]),
        )
        for i, c in enumerate(chord)
    )  # fmt: skip
    names, units = ("x", "y", "z", "roll", "pitch", "yaw"), ("m",) * 3 + ("rad",) * 3
    infinite = (np.inf,) * 6
    return Robot(
        "plate", (body,), strips, names, units, (), (0.0,) * 6,
        tuple(-x for x in infinite), infinite, 9.81,
    )  # fmt: skip


def elliptic(aspect_ratio: float, count: int) -> Robot:
    """Root chord 1, each strip with the chord that keeps its area."""
    span = aspect_ratio * np.pi / 4
    ends = np.linspace(-1.0, 1.0, count + 1)
    area = (ends * np.sqrt(1 - ends**2) + np.arcsin(ends)) / 2
    return wing(ends * span / 2, np.diff(area) / np.diff(ends))


def rectangular(aspect_ratio: float, count: int) -> Robot:
    return wing(np.linspace(-0.5, 0.5, count + 1) * aspect_ratio, np.ones(count))


def moved(robot: Robot, sweep: float, place: tuple[float, float], name: str = "wing") -> Robot:
    """The same wing, its quarter chord swept back and its root at x, z."""
    strips = []
    for i, strip in enumerate(robot.strips):
        y = strip.quarter_chord[1]
        at = (place[0] - abs(y) * float(np.tan(sweep)), y, place[1])
        strips.append(replace(strip, name=f"{name}[{i}]", wing=name, quarter_chord=at))
    return replace(robot, strips=tuple(strips))


def vortex_lattice(
    sweep: float, aspect_ratio: float, places: list[tuple[float, float]]
) -> list[float]:
    """Lift slope of rectangular wings of chord 1 by 24 x 4 ring-free horseshoes, at 1e-3 rad.

    Katz and Plotkin (2001), Low-Speed Aerodynamics, section 12.1: x backward, z up.
    """
    edges = -np.cos(np.linspace(0, np.pi, 25)) * aspect_ratio / 2
    a, b, p = [], [], []
    for x, z in places:
        for left, right in zip(edges[:-1], edges[1:], strict=True):
            for k in range(4):
                at = [-x - 0.25 + (k + 0.25) / 4 + abs(y) * np.tan(sweep) for y in (left, right)]
                a.append((at[0], left, z))
                b.append((at[1], right, z))
                middle = (left + right) / 2
                p.append((-x - 0.25 + (k + 0.75) / 4 + abs(middle) * np.tan(sweep), middle, z))
    a, b, p = np.array(a), np.array(b), np.array(p)[:, None]
    far = np.array([1e4, 0.0, 0.0])

    def filament(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        r, s = p - begin, p - end
        cross = np.cross(r, s)
        unit = r / np.linalg.norm(r, axis=2)[..., None] - s / np.linalg.norm(s, axis=2)[..., None]
        along = (unit * (end - begin)).sum(axis=2) / ((cross**2).sum(axis=2) + 1e-12)
        return along * cross[..., 2] / (4 * np.pi)

    down = filament(a + far, a) + filament(a, b) + filament(b, b + far)
    circulation = np.linalg.solve(down, np.full(len(a), -1.0))
    lift = (2 * circulation * (b - a)[:, 1]).reshape(len(places), -1).sum(axis=1) / aspect_ratio
    return list(lift)


def force_of(robot: Robot, velocity: np.ndarray) -> np.ndarray:
    """Force of the air on a robot in pure translation, computed by CasADi, (3,) [N]."""
    aero = LiftingLine(robot, lags=NO_STATE, section=PLAIN, surface_constant=0.0)
    v, still = [*velocity, 0.0, 0.0, 0.0], np.zeros(3)
    function = aero_functions(aero)[0]
    force = function(np.zeros(6), v, ca.DM(0, 1), still, robot.parameters, aero.parameters)
    return np.array(force).ravel()[:3]


def coefficients(robot: Robot) -> np.ndarray:
    """Lift and induced drag coefficient over angle and squared angle, on the virtual machine."""
    x, _, z = force_of(robot, AIRSPEED * np.array([np.cos(ANGLE), 0, -np.sin(ANGLE)]))
    area = sum(s.chord * s.width for s in robot.strips)
    lift, drag = z * np.cos(ANGLE) + x * np.sin(ANGLE), z * np.sin(ANGLE) - x * np.cos(ANGLE)
    return np.array([lift / ANGLE, drag / ANGLE**2]) / (0.5 * 1.225 * AIRSPEED**2 * area)


@pytest.mark.parametrize("aspect_ratio", [4, 20])
def test_elliptic_wing_converges_with_order_three_halves(aspect_ratio: float) -> None:
    lift = 2 * np.pi / (1 + 2 / aspect_ratio)
    exact = np.array([lift, lift**2 / (np.pi * aspect_ratio)])
    values = np.array([coefficients(elliptic(aspect_ratio, n)) for n in (10, 20, 40, 80)])
    error = np.abs(values / exact - 1)
    order = np.log2(error[:-1] / error[1:])
    assert (order[-1] > 1.3).all()
    limit = values[-1] + (values[-1] - values[-2]) / (2**1.5 - 1)
    # of 80 strips at order 3/2; at aspect ratio 20 they are not yet many
    assert np.abs(limit / exact - 1).max() < (3e-5 if aspect_ratio < 20 else 2e-4)


# lift and induced drag at an angle of .1 of a rectangular wing (Glauert's series)
RECTANGULAR = {4: (0.40279, 0.013280), 6: (0.45299, 0.011413), 8: (0.48372, 0.009940)}


@pytest.mark.parametrize("aspect_ratio", list(RECTANGULAR))
def test_rectangular_wing_within_one_percent_at_twenty_strips(aspect_ratio: int) -> None:
    lift, drag = RECTANGULAR[aspect_ratio]
    values = coefficients(rectangular(aspect_ratio, 20)) * [0.1, 0.01]
    assert np.abs(values / [lift, drag] - 1).max() < 0.01


@pytest.mark.parametrize("sweep", [-0.5, 0.3, 0.8, 1.0])
def test_a_swept_wing_loses_lift_as_on_a_vortex_lattice(sweep: float) -> None:
    straight = rectangular(6, 12)
    lift, drag = coefficients(moved(straight, sweep, (0.0, 0.0)))
    kept = lift / coefficients(straight)[0]
    expected = vortex_lattice(sweep, 6, [(0.0, 0.0)])[0] / vortex_lattice(0.0, 6, [(0.0, 0.0)])[0]
    assert kept == pytest.approx(expected, rel=0.03)  # the lattice has a root and tips of its own
    assert 0.9 < lift**2 / (np.pi * 6 * drag) <= 1.0  # Munk: none better than the elliptic wing
    finer = coefficients(moved(rectangular(6, 24), sweep, (0.0, 0.0)))
    assert finer == pytest.approx(
        [lift, drag], rel=0.05
    )  # the kink is two strips of 12, then of 24


@pytest.mark.parametrize("sweep", [-0.4, 0.6])
@pytest.mark.parametrize("sideslip", [0.0, 0.3])
def test_a_swept_wing_without_end_is_a_straight_one_that_yaws(
    sweep: float, sideslip: float
) -> None:
    ends = np.linspace(-5e5, 5e5, 4)  # chord 1, two-dimensional to 1e-5
    straight = wing(ends / np.cos(sweep), np.full(3, np.cos(sweep)))
    swept = wing(ends, np.ones(3))
    strips = [
        replace(s, quarter_chord=(-s.quarter_chord[1] * float(np.tan(sweep)), *s.quarter_chord[1:]))
        for s in swept.strips
    ]
    turn = np.array(
        [[np.cos(sweep), -np.sin(sweep), 0], [np.sin(sweep), np.cos(sweep), 0], [0, 0, 1]]
    )
    wind = AIRSPEED * np.array([np.cos(sideslip), np.sin(sideslip), -0.1])
    expected = turn @ force_of(straight, turn.T @ wind)
    found = force_of(replace(swept, strips=tuple(strips)), wind)
    assert found == pytest.approx(expected, abs=2e-5 * np.linalg.norm(expected))
    assert abs(found[1]) > 0.01 * np.linalg.norm(found)  # suction pulls along the span


@pytest.mark.parametrize(("behind", "above"), [(1.5, 0.2), (1.2, 0.4), (1.0, 1.2), (10.0, 0.2)])
@pytest.mark.usefixtures("interpreted")
def test_tandem_wings_feel_each_other_as_on_a_vortex_lattice(behind: float, above: float) -> None:
    places = [(0.0, 0.0), (-behind, above)]
    wings = [
        moved(rectangular(8, 10), 0.0, at, name) for at, name in zip(places, "ab", strict=True)
    ]
    robot = replace(wings[0], strips=wings[0].strips + wings[1].strips)
    aero = LiftingLine(robot, lags=NO_STATE, section=PLAIN, surface_constant=0.0)
    v = AIRSPEED * np.array([1.0, 0, -ANGLE, 0, 0, 0])
    force = aero.strips(np.zeros(6), v)["strip_force"][:, 2]
    lift = force.reshape(2, -1).sum(axis=1) / (0.5 * 1.225 * AIRSPEED**2 * 8 * ANGLE)
    expected = np.array(vortex_lattice(0.0, 8, places))
    alone = vortex_lattice(0.0, 8, places[:1])[0]
    off = np.abs(lift - expected) / alone
    assert off.max() < 0.1  # of the lift of one alone: points at the quarter chord alone
    assert expected[1] < 0.75 * alone  # what there is to feel


def test_low_aspect_ratio_takes_lift_off() -> None:
    robot = rectangular(2.0, 12)
    function = [aero_functions(LiftingLine(robot, lags=NO_STATE, section=PLAIN,
                surface_constant=k))[0] for k in (0.0, 13.5)]  # fmt: skip
    v = [5.0, 0.0, -0.1, 0.0, 0.0, 0.0]
    line = 1 / (2 * np.pi) + 1 / (np.pi * 2.0)
    lift = []
    for k, f in zip((0.0, 13.5), function, strict=True):
        aero = LiftingLine(robot, lags=NO_STATE, section=PLAIN, surface_constant=k)
        force = f(np.zeros(6), v, ca.DM(0, 1), np.zeros(3), robot.parameters, aero.parameters)
        lift.append(float(force[2]))
    gain = line / (line + 13.5 * np.pi / (180 * 4))
    assert lift[1] / lift[0] == pytest.approx(gain, rel=1e-3)  # beside the tilt of the force


@pytest.mark.parametrize("k", [0.05, 0.2, 1.0])
@pytest.mark.parametrize("lags", [TWO_STATE], ids=["two"])
def test_a_wing_without_end_has_the_lift_of_its_lags(k: float, lags: Indicial) -> None:
    robot = wing(np.linspace(-5e5, 5e5, 4), np.ones(3))  # chord 1, two-dimensional to 1e-5
    aero = LiftingLine(robot, Air(), lags=lags, section=PLAIN, surface_constant=0.0)
    system = aero.state_space(np.zeros(6), [AIRSPEED, 0, 0, 0, 0, 0])
    omega = k * AIRSPEED / 0.5
    transfer = (
        system.c @ np.linalg.solve(1j * omega * np.eye(len(system.a)) - system.a, system.b)
        + system.d
    )
    steady = 0.5 * 1.225 * AIRSPEED * 2 * np.pi * robot.strips[1].width
    assert transfer[1, 1] / steady == pytest.approx(lags.lift_transfer(k)[0], abs=1e-5)
    assert np.abs(transfer[1, 0]) < 1e-5 * steady
