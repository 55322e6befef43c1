"""A table between its knots: straight lines, their corners rounded.

Every result is a mean of the table's values with weights that are never negative: what
is positive (a drag, a share) stays positive between, whatever the values. Four
derivatives are continuous. Neglected: curvature between knots.
"""

from __future__ import annotations

import functools
from typing import Any

import casadi as ca


def table_values(x: Any, knots: ca.SX, values: ca.SX) -> ca.SX:
    """Values at an abscissa, (m, 1); constant before the first knot and after the last.

    Args:
        x: Abscissa, scalar [any unit].
        knots: Ascending abscissas, (n, 1), n >= 2 [of x].
        values: One column a quantity, (n, m) [any unit].
    """
    return table_function(*values.shape)(x, knots, values)


@functools.cache
def table_function(knots: int, columns: int) -> ca.Function:
    """Lines between knots x_k, slopes m_k, rounded within half the shorter interval w_k.

    v(x) = v_0 + sum_k (m_k - m_(k-1)) R_k(x), with R_k zero before x_k - w_k, x - x_k
    after x_k + w_k, and between w (r(t) = t/2 + (35/2 t^2 - 35/4 t^4 + 7/2 t^6 - 5/8 t^8)/32
    + 35/256), t = (x - x_k)/w_k. One call in compiled code: `kernels/table.h`.

    Args:
        knots: n.
        columns: m.

    Returns:
        (x, knots (n,) [of x], values (n, m)) -> values at x (m,).
    """
    x, at = ca.SX.sym("x"), ca.SX.sym("knots", knots)
    values = ca.SX.sym("values", knots, columns)
    steps = [at[k + 1] - at[k] for k in range(knots - 1)]
    result, last = values[0, :], ca.SX.zeros(1, columns)
    for k in range(knots):
        half = ca.fmin(steps[max(k - 1, 0)], steps[min(k, knots - 2)]) / 2
        slope = ca.SX.zeros(1, columns)
        if k + 1 < knots:
            slope = (values[k + 1, :] - values[k, :]) / steps[k]
        result = result + (slope - last) * rounded_ramp(x - at[k], half)
        last = slope
    return ca.Function(
        f"table_{knots}_{columns}",
        [x, at, values],
        [ca.densify(result.T)],
        ["x", "knots", "values"],
        ["at_x"],
        {"never_inline": True},
    )


def rounded_ramp(x: Any, half: Any) -> Any:
    """max(0, x), but a polynomial within the half width of zero.

    Args:
        x: Scalar.
        half: Half width of what is rounded, positive.
    """
    t = ca.fmax(-1.0, ca.fmin(1.0, x / half))
    square = t * t
    even = square * (17.5 + square * (-8.75 + square * (3.5 - 0.625 * square))) / 16.0
    return half * (0.5 * (t + even) + 0.13671875) + ca.fmax(0.0, x - half)
