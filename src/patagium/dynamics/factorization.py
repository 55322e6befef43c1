"""Branch-induced sparse factorization of the mass matrix, D = L^T A L.

Elimination runs from the tips to the root, so coordinates of different branches
never fill in. Straight-line: no pivoting, D being positive definite.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca


def solve(matrix: ca.SX, right: ca.SX, parents: Sequence[int]) -> ca.SX:
    """Solution of D x = b with the sparsity of a tree.

    Args:
        matrix: D, (m, m), symmetric positive definite [kg, kg m, kg m^2].
        right: b, (m, k) [N, N m].
        parents: For each row the row before it on the way to the root, -1 at the
            root; D[i, j] is zero unless one is an ancestor of the other.

    Returns:
        x, (m, k).

    References:
        Featherstone (2008), Rigid Body Dynamics Algorithms, section 6.5.
    """
    size = matrix.shape[0]
    ancestors: list[list[int]] = [[] for _ in range(size)]
    for k, above in enumerate(ancestors):
        while (k := parents[k]) >= 0:
            above.append(k)
    order = sorted(range(size), key=lambda k: len(ancestors[k]))
    h = ca.SX(matrix)
    inverse_pivot = ca.SX.zeros(size, 1)
    factor: dict[tuple[int, int], ca.SX] = {}
    x = ca.SX(right)
    for k in reversed(order):
        inverse_pivot[k] = 1 / h[k, k]
        for position, i in enumerate(ancestors[k]):
            ratio = h[k, i] * inverse_pivot[k]
            for j in ancestors[k][position:]:
                h[i, j] = h[j, i] = h[i, j] - ratio * h[k, j]
            factor[k, i] = ratio
            x[i, :] = x[i, :] - ratio * x[k, :]
    x = ca.diag(inverse_pivot) @ x
    for k in order:
        for i in ancestors[k]:
            x[k, :] = x[k, :] - factor[k, i] * x[i, :]
    return x
