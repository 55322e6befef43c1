"""Steady wings in closed form, and how the error falls with the number of strips."""

from __future__ import annotations

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


def coefficients(robot: Robot) -> np.ndarray:
    """Lift and induced drag coefficient over angle and squared angle, on the virtual machine."""
    aero = LiftingLine(robot, lags=NO_STATE, section=PLAIN, surface_constant=0.0)
    v = AIRSPEED * np.array([np.cos(ANGLE), 0, -np.sin(ANGLE), 0, 0, 0])
    function = aero_functions(aero)[0]
    force = function(np.zeros(6), v, ca.DM(0, 1), np.zeros(3), robot.parameters, aero.parameters)
    x, _, z = np.array(force).ravel()[:3]
    area = sum(s.chord * s.width for s in robot.strips)
    lift, drag = z * np.cos(ANGLE) + x * np.sin(ANGLE), z * np.sin(ANGLE) - x * np.cos(ANGLE)
    return np.array([lift / ANGLE, drag / ANGLE**2]) / (0.5 * 1.225 * AIRSPEED**2 * area)


@pytest.mark.parametrize("aspect_ratio", [4, 6, 20])
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
