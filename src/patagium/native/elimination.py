"""Jacobians by elimination of vertices, which take fewer operations than CasADi's.

The graph of an expression has an edge, a partial derivative, from each operand to the result of
an operation. A vertex is taken out by multiplying each edge that comes in by each that goes out;
when variables and results alone are left, the edges are the Jacobian. The vertex that makes the
fewest new edges is next, and of those the one with the fewest products.

References:
    Griewank & Walther (2008), Evaluating Derivatives, 2nd ed., chapters 9 and 10.
"""

from __future__ import annotations

import functools
import heapq
from collections.abc import Sequence
from typing import TypeAlias

import casadi as ca

from patagium.native.emit import dense_graph

Edge: TypeAlias = ca.SX | float
_LINEAR = {
    ca.OP_ADD: (1.0, 1.0),
    ca.OP_SUB: (1.0, -1.0),
    ca.OP_NEG: (-1.0,),
    ca.OP_TWICE: (2.0,),
}


def jacobian(expression: ca.SX, variables: ca.SX) -> ca.SX:
    """Jacobian of an expression, (m, n), without the entries that are zero for all values.

    Args:
        expression: A column; calls of functions in it are written out.
        variables: A column of symbols.

    Raises:
        RuntimeError: If the expression calls a kernel.
    """
    own = {symbol.element_hash() for symbol in ca.vertsplit(variables)}
    others = [k for k in ca.symvar(expression) if k.element_hash() not in own]
    given = [variables, ca.vertcat(ca.SX(0, 1), *others)]
    graph = dense_graph(ca.Function("graph", given, [ca.cse(expression)]), calls=False)
    values: list[ca.SX] = []
    into: list[dict[int, Edge]] = []
    sources = dict[int, int]()
    for k, node in enumerate(graph.nodes):
        edges = dict[int, Edge]()
        if node.op == ca.OP_CONST:
            values.append(ca.SX(node.detail[0]))
        elif node.op == ca.OP_INPUT:
            which, entry = int(node.detail[0]), int(node.detail[1])
            values.append(given[which][entry])
            if which == 0:
                sources[k] = entry
        else:
            moving = [i in sources or bool(into[i]) for i in node.inputs]
            value, slopes = _operation(node.op, [values[i] for i in node.inputs], any(moving))
            values.append(value)
            for i, slope, moves in zip(node.inputs, slopes, moving, strict=False):
                if moves and not (isinstance(slope, ca.SX) and slope.is_zero()):
                    edges[i] = _combined(ca.OP_ADD, edges[i], slope) if i in edges else slope
        into.append(edges)
    into += [{k: 1.0} if k in sources or into[k] else {} for _, _, k in graph.outputs]
    _eliminate(into, len(values), sources)
    found = ca.SX(expression.numel(), variables.numel())
    for (_, row, _), edges in zip(graph.outputs, into[len(values) :], strict=True):
        for k, edge in edges.items():
            found[row, sources[k]] = edge
    return found


def _operation(op: int, x: list[ca.SX], moves: bool) -> tuple[ca.SX, Sequence[Edge]]:
    """Result of an operation, and its derivative by each operand where one moves."""
    if moves and op != ca.OP_MUL and op not in _LINEAR:
        value, slopes = _partials(op, len(x))(ca.vertcat(*x))
        return value, ca.vertsplit(slopes)
    value = ca.SX.unary(op, x[0]) if len(x) == 1 else ca.SX.binary(op, *x)
    return value, x[::-1] if op == ca.OP_MUL else _LINEAR.get(op, ())


def _combined(op: int, a: Edge, b: Edge) -> Edge:
    """Sum or product of two edges: `SX.binary` takes an eighth of the time of `a * b`."""
    if isinstance(a, float):
        a, b = b, a
    if isinstance(b, float):
        return a if op == ca.OP_MUL and b == 1.0 else a * b if op == ca.OP_MUL else a + b
    return ca.SX.binary(op, a, b)


@functools.cache
def _partials(op: int, operands: int) -> ca.Function:
    """Function of the operands of an operation: its result and its derivative by each."""
    x = ca.SX.sym("x", operands)
    value = ca.SX.unary(op, x) if operands == 1 else ca.SX.binary(op, x[0], x[1])
    return ca.Function("partials", [x], [value, ca.densify(ca.jacobian(value, x).T)])


def _eliminate(into: list[dict[int, Edge]], inner: int, sources: dict[int, int]) -> None:
    """Remove vertices until every edge begins at a variable.

    Args:
        into: Edges into each vertex by where they begin; inner vertices first, then results.
        inner: Number of vertices that are not results.
        sources: Vertices of variables.
    """
    out: list[set[int]] = [set() for _ in into]
    for k, edges in enumerate(into):
        for i in edges:
            out[i].add(k)

    def cost(k: int) -> tuple[int, int, int]:
        pairs = len(into[k]) * len(out[k])
        return pairs - sum(sum(map(into[s].__contains__, into[k])) for s in out[k]), pairs, -k

    queue = [cost(k) for k in range(inner) if k not in sources]
    heapq.heapify(queue)
    gone = set(sources)
    while queue:
        known = heapq.heappop(queue)
        k = -known[2]
        if k in gone:
            continue
        now = cost(k)
        if now > known:
            heapq.heappush(queue, now)
            continue
        gone.add(k)
        for s in out[k]:
            edge = into[s].pop(k)
            for i, before in into[k].items():
                more = _combined(ca.OP_MUL, edge, before)
                into[s][i] = _combined(ca.OP_ADD, into[s][i], more) if i in into[s] else more
                out[i].add(s)
        for i in into[k]:
            out[i].discard(k)
        for near in {*into[k], *out[k]}:
            if near not in gone and near < inner:
                heapq.heappush(queue, cost(near))
        into[k], out[k] = {}, set()
