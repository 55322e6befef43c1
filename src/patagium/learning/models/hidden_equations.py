"""Equations of strips with memory whose numbers are learned: Sigma'_Aero as CasADi functions.

The physics is that of `LiftingLine`, from the same functions: normalwashes, lags and lift of all
strips; learned are its numbers, `hidden_numbers`, and what a perceptron says of each section.
Neglected: camber in the normalwash (the perceptron sees it), separation with a memory of its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from patagium.aerodynamics.induced_velocity import (
    Normalwash,
    VortexSystem,
    attached_lift,
    implicit_lag_step,
    solve_normalwash,
)
from patagium.aerodynamics.lag_states import Lags, Relaxation
from patagium.aerodynamics.local_flow import airspeed, normalwash, strip_motions
from patagium.aerodynamics.polars import SectionFlow, section_flow
from patagium.aerodynamics.smooth_functions import smooth_sign
from patagium.aerodynamics.surface_gain import SURFACE_CONSTANT, surface_gains
from patagium.aerodynamics.trailing_vortices import lattice, strip_chains
from patagium.dynamics.chain import cross, vector
from patagium.dynamics.kinematics import generalized_force
from patagium.learning.models.hidden_numbers import coded_size, learned_air
from patagium.learning.models.strip import parted
from patagium.robot.model import Robot

Array = NDArray[np.float64]

COEFFICIENTS = 8
"""Outputs of the perceptron a strip; see `_wrench`."""
FEATURES = 4
"""Its inputs: direction of the effective and of the geometric flow."""


class Remembered(NamedTuple):
    """What strips remember at a sample; slopes are for the coded numbers memory depends on.

    Attributes:
        time: Of the sample [s].
        state: Lags z, strip by strip, (n_z,) [m/s].
        slopes: Of the lags, (n_z, n_m).
        effective: Normalwash of each strip, (n_strips,) [m/s].
        effective_slopes: Of these, (n_strips, n_m).
        semichords: That each strip flies in a second, (n_strips,) [1/s].
        weights: W_m that all this was found at, (n_m,).
    """

    time: float
    state: Array
    slopes: Array
    effective: Array
    effective_slopes: Array
    semichords: Array
    weights: Array


def hidden_functions(machine: Robot, lags: int) -> list[ca.Function]:
    """Functions begin, step, encode, and slopes, which is called with many directions.

    Args:
        machine: The robot in numbers; those of its symbolic twin are run-time inputs.
        lags: How many a strip.
    """
    air = _Air(machine, lags)
    return [_begin(air), _step(air), _encode(air), _slopes(air)]


class _Air:
    """A robot in the air, as expressions of [q, v], coded numbers and constants."""

    def __init__(self, machine: Robot, lags: int) -> None:
        self.robot, robot_parameters = machine.symbolic()
        self.count, self.lags = len(machine.strips), lags
        size, remembered = coded_size(lags)
        parts = ca.SX.sym("remembered", remembered), ca.SX.sym("others", size - remembered)
        self.remembered, self.coded = parts[0], ca.vertcat(*parts)
        self.x = ca.SX.sym("x", machine.state_size)
        wind, self.density, self.scale = ca.SX.sym("wind", 3), ca.SX.sym("rho"), ca.SX.sym("scale")
        self.constants = ca.vertcat(wind, self.density, self.scale, robot_parameters)
        n_q = machine.coordinate_count
        self.q, v = self.x[:n_q], self.x[n_q:]
        self.numbers = learned_air(self.coded, lags)
        chains = strip_chains(machine)
        self.motions = strip_motions(self.robot, self.q, v, wind)
        net = lattice(self.robot, chains, self.q, v, wind)
        self.vortices = VortexSystem(chains, net, self.motions)
        self.geometric = ca.vertcat(*[normalwash(motion) for motion in self.motions])
        self.gains = surface_gains(machine, self.robot, SURFACE_CONSTANT)
        self.state = ca.SX.sym("state", self.count * lags)
        of_strips = [2 * airspeed(motion) / motion.strip.chord for motion in self.motions]
        self.semichords = ca.vertcat(*of_strips)

    def wash(self, state: ca.SX, lags: Lags) -> Normalwash:
        """Normalwashes of all strips with lags in a state."""
        slope = self.numbers.lift_slope
        return solve_normalwash(self.vortices, self.geometric, state, lags, slope)

    def reached(self, state: ca.SX, step: Any, before: Relaxation) -> tuple[ca.SX, ca.SX]:
        """Lags and effective normalwashes at the end of a step."""
        known = self.vortices, self.geometric, state, step, before
        return implicit_lag_step(*known, self.numbers.lags, self.numbers.lift_slope)

    def repeated(self, of_strips: ca.SX) -> ca.SX:
        """A number of each strip, for each of its lags."""
        return ca.vec(ca.repmat(of_strips.T, self.lags, 1))


def _begin(air: _Air) -> ca.Function:
    """Lags of a flow that was always as it is now: no part of the circulation is held back."""
    effective = air.wash(ca.SX(0, 1), Lags((), (), ())).effective
    slopes = _forward(effective, air.remembered, ca.SX.eye(air.remembered.numel()))
    return _function(
        "begin",
        {"x": air.x, "coded": air.coded, "network_parameters": air.constants},
        {
            "state": air.repeated(effective),
            "slopes": ca.vertcat(*[air.repeated(slopes[:, k]).T for k in range(slopes.shape[1])]).T,
            "effective": effective,
            "effective_slopes": slopes,
            "semichords": air.semichords,
        },
    )


def _step(air: _Air) -> ca.Function:
    """One step of the exponential trapezoid, with its slopes for numbers and where it began."""
    numbers, count = air.remembered.numel(), air.count
    step, state, effective = ca.SX.sym("step"), air.state, ca.SX.sym("effective", count)
    semichords = ca.SX.sym("semichords", count)
    slopes = ca.SX.sym("slopes", state.numel(), numbers)
    effective_slopes = ca.SX.sym("effective_slopes", count, numbers)
    rates = ca.repmat(ca.vertcat(*air.numbers.lags.rate), count, 1)
    before = Relaxation(rates * air.repeated(semichords), air.repeated(effective))
    after, later = air.reached(state, step, before)
    reached = ca.vertcat(after, later)
    seeds = ca.vertcat(slopes, effective_slopes, ca.SX.eye(numbers))
    moved = _forward(reached, ca.vertcat(state, effective, air.remembered), seeds)
    return _function(
        "step",
        {
            "x": air.x,
            "coded": air.coded,
            "network_parameters": air.constants,
            "step": step,
            "state": state,
            "slopes": slopes,
            "effective": effective,
            "effective_slopes": effective_slopes,
            "semichords": semichords,
        },
        {
            "state_after": reached[: state.numel()],
            "slopes_after": moved[: state.numel(), :],
            "effective_after": later,
            "effective_slopes_after": moved[state.numel() :, :],
            "semichords_after": air.semichords,
        },
    )


def _encode(air: _Air) -> ca.Function:
    outputs = ca.SX.sym("m", COEFFICIENTS, air.count)
    features, y = _seen(air, outputs)
    return _function(
        "encode",
        {
            "x": air.x,
            "state": air.state,
            "coded": air.coded,
            "network_parameters": air.constants,
        },
        {"features": features, "readout": ca.jacobian(y, ca.vec(outputs))},
    )


def _slopes(air: _Air) -> ca.Function:
    """Derivatives of features and of y as read out, where lags and coded numbers move.

    What all directions have in common comes last, in one vector.
    """
    outputs = ca.SX.sym("m", COEFFICIENTS, air.count)
    moved = ca.SX.sym("dz", air.state.numel()), ca.SX.sym("dcoded", air.coded.numel())
    features, y = _seen(air, outputs)
    seen, variables = ca.vertcat(ca.vec(features), y), ca.vertcat(air.state, air.coded)
    slope = _forward(seen, variables, ca.vertcat(*moved))
    sample = ca.vertcat(air.x, air.state, air.coded, ca.vec(outputs), air.constants)
    common = ca.SX.sym("sample", sample.numel())
    slope = ca.substitute(slope, sample, common)
    return _function(
        "slopes",
        {"state_moved": moved[0], "coded_moved": moved[1], "sample_parameters": common},
        {"of_features": slope[: features.numel()], "of_y": slope[features.numel() :]},
    )


def _seen(air: _Air, outputs: ca.SX) -> tuple[ca.SX, ca.SX]:
    """What the perceptron sees of each strip, and y as its outputs say."""
    wash = air.wash(air.state, air.numbers.lags)
    seen: list[ca.SX] = []
    wrenches: dict[int, tuple[ca.SX, ca.SX]] = {}
    for i, motion in enumerate(air.motions):
        ahead = (smooth_sign(motion.forward) - 1.0) * (motion.strip.chord / 4)
        flow = section_flow(motion.forward, motion.normal_ahead(ahead))
        effective = section_flow(motion.forward, -wash.lagged[i])
        seen.append(ca.vertcat(_direction(effective), _direction(flow)))
        force, moment = _wrench(air, wash, i, ahead, flow, effective, outputs[:, i])
        body, still = motion.strip.body, (ca.SX.zeros(3, 1), ca.SX.zeros(3, 1))
        total = wrenches.get(body, still)
        wrenches[body] = (total[0] + force, total[1] + moment)
    return ca.horzcat(*seen), generalized_force(air.robot, air.q, wrenches)


def _wrench(
    air: _Air,
    wash: Normalwash,
    i: int,
    ahead: Any,
    flow: SectionFlow,
    effective: SectionFlow,
    m: ca.SX,
) -> tuple[ca.SX, ca.SX]:
    """Force and moment of a strip about its body's origin, body axes, linear in m.

    Attached: m_0 of the lifting line's lift, coefficients m_1 forward, m_2 normal, m_3 along the
    span. Separated: m_4 forward, m_5 normal for the sine of the incidence, m_6 of the moment
    that raises the tail, m_7 along the span.
    """
    motion, strip = air.motions[i], air.motions[i].strip
    forward, normal = vector(strip.forward), vector(strip.normal)
    span, area = cross(normal, forward), strip.chord * strip.width
    sine_square = (effective.normal / effective.speed) ** 2
    separated = 1 / (1 + ca.exp((air.numbers.stall - sine_square) / air.numbers.stall_width))
    attached = 1 - separated
    pressure = air.density * area * air.numbers.lift_slope * airspeed(motion) / 2
    ahead_normal = motion.normal_ahead(ahead)
    lift = attached_lift(air.vortices, wash, i, air.gains[i], pressure, ahead_normal)
    unit = air.scale * air.density * area * flow.speed / 2
    sine, along = -flow.normal / flow.speed, motion.spanwise_ahead(ahead)
    push = unit * flow.speed
    force = forward * (attached * (m[0] * lift[0] + push * m[1]) + separated * push * m[4])
    force += normal * (attached * (m[0] * lift[1] + push * m[2]) + separated * push * sine * m[5])
    force += span * (unit * along * (attached * m[3] + separated * m[7]))
    point = vector(strip.quarter_chord) + forward * ahead
    return force, cross(point, force) - span * (separated * push * strip.chord * m[6])


def _direction(flow: SectionFlow) -> ca.SX:
    return parted(ca.vertcat(flow.forward, flow.normal) / flow.speed)


def _forward(value: ca.SX, variables: ca.SX, seeds: ca.SX) -> ca.SX:
    """d value / d variables . seeds, column by column."""
    return ca.densify(ca.jtimes(value, variables, seeds))


def _function(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    return ca.Function(name, [*inputs.values()], [*outputs.values()], [*inputs], [*outputs])
