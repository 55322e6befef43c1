"""Normalwashes of strips with memory that feel each other, and how the memory follows them.

What a lifting line and networks built on one have in common: the linear system of all
strips' circulations, the lags it drives, and one step of these lags from sample to sample.
Neglected: as in `lifting_line`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from patagium.aerodynamics.local_flow import StripMotion
from patagium.aerodynamics.smooth_functions import smooth_norm, smooth_sign
from patagium.aerodynamics.trailing_vortices import Lattice, StripChain, horseshoe_function


@dataclass(frozen=True)
class Lags:
    """Numbers of a section's memory, as symbols or values.

    Attributes:
        rate: b_k, how fast each lag fades [1/semichord].
        lift: a_k, part of the lift that each holds back.
        circulation: g_k, part of the circulation that each holds back.
    """

    rate: Sequence[Any]
    lift: Sequence[Any]
    circulation: Sequence[Any]

    @property
    def first_lift(self) -> Any:
        """phi(0), part of the lift without delay."""
        return 1.0 - sum(self.lift, ca.SX(0))

    @property
    def first_circulation(self) -> Any:
        """Gamma(0), part of the circulation without delay."""
        return 1.0 - sum(self.circulation, ca.SX(0))

    def lagged(self, amplitude: Sequence[Any], state: ca.SX, strip: int) -> ca.SX:
        """Sum over a strip's lags of amplitude times lagged normalwash.

        Args:
            amplitude: Of each lag.
            state: Lags strip by strip, (n_z, 1) [m/s].
            strip: Which one.
        """
        terms = [a * state[strip * len(amplitude) + k] for k, a in enumerate(amplitude)]
        return sum(terms, ca.SX(0))


@dataclass(frozen=True)
class Normalwash:
    """Normal velocities of the air at the strips of a lifting line, (n, 1) each [m/s].

    Attributes:
        effective: Of the undisturbed wind at three quarters of the chord and of the wind
            induced by the trailing vortices.
        lagged: What the lift answers to, phi(0) effective + sum_k a_k z_k.
        circulation: Bound circulation along forward x normal [m^2/s].
        induced: Velocity induced by the trailing vortices, lattice axes, (3, n) [m/s].
    """

    effective: ca.SX
    lagged: ca.SX
    circulation: ca.SX
    induced: ca.SX


@dataclass(frozen=True)
class Relaxation:
    """Memory that follows something: dz/dt = rate (target - z), one by one.

    Attributes:
        rate: Never negative, (n_z, 1) [1/s].
        target: What each follows, (n_z, 1), in the unit of z.
    """

    rate: ca.SX
    target: ca.SX

    def derivative(self, state: ca.SX) -> ca.SX:
        """dz/dt, (n_z, 1), in the unit of z a second [1/s].

        Args:
            state: z, (n_z, 1).
        """
        return self.rate * (self.target - state)


def solve_normalwash(
    chains: Sequence[StripChain],
    net: Lattice,
    motions: Sequence[StripMotion],
    geometric: ca.SX,
    state: ca.SX,
    lags: Lags,
    lift_slope: Any,
) -> Normalwash:
    """Normalwashes of all strips; linear in the geometric ones and the state.

    Args:
        chains: Which strips share trailing vortices.
        net: Where the vortices are.
        motions: How each strip moves.
        geometric: Undisturbed normalwash of each strip, (n, 1) [m/s].
        state: Lags strip by strip, (n_z, 1) [m/s].
        lags: Numbers of the memory.
        lift_slope: Of a section, or of each strip in turn [1/rad].
    """
    bound = [
        lags.first_circulation * geometric[i] + lags.lagged(lags.circulation, state, i)
        for i in range(len(motions))
    ]
    feedthrough = lags.first_circulation
    signed, induced = _vortices(chains, net, motions, bound, 1.0, feedthrough, lift_slope)
    effective = geometric + ca.sum1(net.normals * induced).T
    lagged = [
        lags.first_lift * effective[i] + lags.lagged(lags.lift, state, i)
        for i in range(len(motions))
    ]
    return Normalwash(effective, ca.vertcat(*lagged), signed, induced)


def implicit_lag_step(
    chains: Sequence[StripChain],
    net: Lattice,
    motions: Sequence[StripMotion],
    geometric: ca.SX,
    state: ca.SX,
    step: Any,
    before: Relaxation,
    lags: Lags,
    lift_slope: Any,
) -> tuple[ca.SX, ca.SX]:
    """Lags one step later and the effective normalwashes there, found together.

    The step of `lag_step` in which lags and vortices at its end feel each other: still one
    linear system, and where the vortices turn the flow against what makes them, bounded at
    any step.

    Args:
        chains: Which strips share trailing vortices.
        net: Where the vortices are at the end of the step.
        motions: How each strip moves there.
        geometric: Undisturbed normalwash of each strip there, (n, 1) [m/s].
        state: Lags strip by strip at the beginning, (n_z, 1) [m/s].
        step: Its length [s].
        before: What the lags follow at the beginning.
        lags: Numbers of the memory.
        lift_slope: Of a section [1/rad].

    Returns:
        (n_z, 1) and (n, 1) [m/s].
    """
    count, still = len(lags.rate), ca.SX.zeros(len(motions), 1)
    after = lag_relaxation(motions, still, lags)
    fixed = lag_step(state, step, before, after)
    alone = Relaxation(before.rate, 0 * before.target), Relaxation(after.rate, 1 + after.target)
    share = lag_step(0 * state, step, *alone)  # of the effective normalwash at the end
    bound, feedthrough = [], []
    for i in range(len(motions)):
        through = lags.first_circulation + lags.lagged(lags.circulation, share, i)
        held = lags.lagged(lags.circulation, fixed, i)
        feedthrough.append(through)
        bound.append(geometric[i] + held / through)
    _, induced = _vortices(chains, net, motions, bound, feedthrough, 1.0, lift_slope)
    effective = geometric + ca.sum1(net.normals * induced).T
    reached = fixed + share * ca.vec(ca.repmat(effective.T, count, 1))
    return reached, effective


def _vortices(
    chains: Sequence[StripChain],
    net: Lattice,
    motions: Sequence[StripMotion],
    bound: Sequence[Any],
    shares: Any,
    feedthrough: Any,
    lift_slope: Any,
) -> tuple[ca.SX, ca.SX]:
    """Circulation along forward x normal, (n, 1), and velocity induced, (3, n).

    c = 1/2 chord a0 share (bound + feedthrough n . induced) of each strip.
    """
    sizes = tuple(len(chain.strips) for chain in chains)
    order = [i for chain in chains for i in chain.strips]
    right = [sign for chain in chains for sign in chain.right]
    gain = []
    for i, along in zip(order, right, strict=True):
        sign = along * smooth_sign(motions[i].forward)
        share = shares[i] if isinstance(shares, list) else shares
        gain.append(sign * motions[i].strip.chord * lift_slope / 2 * share)
    circulation, induced = horseshoe_function(sizes)(
        *(net.points[:, order], net.normals[:, order]),
        *(net.edges, net.directions, net.core_squares),
        *(ca.vertcat(*gain), ca.vertcat(*[bound[i] for i in order]), feedthrough),
    )
    of_strip = [order.index(i) for i in range(len(order))]
    signed = [circulation[k] * right[k] for k in of_strip]
    return ca.vertcat(*signed), induced[:, of_strip]


def attached_lift(
    motion: StripMotion,
    net: Lattice,
    wash: Normalwash,
    strip: int,
    gain: Any,
    pressure: Any,
    normal: Any,
) -> tuple[Any, Any]:
    """Lift of attached flow along the strip's forward and normal axes [N].

    L = pressure W, perpendicular to the wind at the force: undisturbed, induced by all legs, and
    by the wake shed across the span, (W - w_e) along the lift. Induced drag is the tilt.

    Args:
        motion: How the strip moves.
        net: Where the vortices are.
        wash: Of all strips.
        strip: Which one.
        gain: Of the lifting surface over the line.
        pressure: Lift per normalwash, 1/2 rho c ds a0 U [N s/m].
        normal: Normal velocity of the strip where the force acts [m/s].
    """
    forward, sign = motion.forward, smooth_sign(motion.forward)
    speed = smooth_norm(forward * forward + normal * normal)
    shed = sign * (wash.lagged[strip] - wash.effective[strip]) / speed
    induced = wash.induced[:, strip]
    wind_forward = -forward + gain * ca.dot(net.forwards[:, strip], induced) - shed * normal
    wind_normal = -normal + gain * ca.dot(net.normals[:, strip], induced) + shed * forward
    wind = smooth_norm(wind_forward * wind_forward + wind_normal * wind_normal)
    lift = sign * gain * net.shares[strip] * pressure * wash.lagged[strip] / wind
    return lift * wind_normal, -lift * wind_forward


def lag_relaxation(motions: Sequence[StripMotion], effective: ca.SX, lags: Lags) -> Relaxation:
    """Lagged normalwashes follow the effective ones at 2 U b_k / c.

    Args:
        motions: How each strip moves.
        effective: Normalwash of each strip, (n, 1) [m/s].
        lags: Numbers of the memory.
    """
    rates, targets = [ca.SX(0, 1)], [ca.SX(0, 1)]
    for i, motion in enumerate(motions):
        semichords = 2 * airspeed(motion) / motion.strip.chord
        rates += [semichords * rate for rate in lags.rate]
        targets += [effective[i]] * len(lags.rate)
    return Relaxation(ca.vertcat(*rates), ca.vertcat(*targets))


def lag_step(state: ca.SX, step: Any, before: Relaxation, after: Relaxation) -> ca.SX:
    """Memory one step later by the exponential trapezoid, (n_z, 1).

    z <- e z + (1 - e) (target + target')/2, e = exp(-(rate + rate')/2 step): of second order,
    and a weighted mean at any step, 0 < e <= 1.

    Args:
        state: z at the beginning, (n_z, 1).
        step: Length of the step [s].
        before: What z follows at its beginning.
        after: The same at its end.
    """
    keep = ca.exp(-step * (before.rate + after.rate) / 2)
    return keep * state + (1.0 - keep) * (before.target + after.target) / 2


def normalwash(motion: StripMotion) -> Any:
    """Air through a strip at three quarters of its chord, camber apart [m/s]."""
    return -motion.normal_ahead(collocation(motion))


def collocation(motion: StripMotion) -> Any:
    """Where the normalwash is taken, ahead of the quarter chord [m]."""
    return -(1.0 + smooth_sign(motion.forward)) * (motion.strip.chord / 4)


def airspeed(motion: StripMotion) -> Any:
    """Speed across the span where the normalwash is taken, never zero [m/s]."""
    normal = motion.normal_ahead(collocation(motion))
    return smooth_norm(motion.forward * motion.forward + normal * normal)
