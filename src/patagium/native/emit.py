"""C text of a CasADi function: straight-line, shared subexpressions once.

Each function can be written for one state, and for many, a vector of them side by side
(`<name>_batch`). All sines and cosines whose angles are known at the same time are taken in one
branch-free vector call. A function that CasADi was told never to inline stays one call of a kernel
written by hand (`KERNELS`), if there is one: its SX form is the kernel's oracle and its fallback.
One named `each_...` is a C function of its own in code for one state, written once and called for
each strip. The operations and their order are CasADi's.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import casadi as ca

from patagium.errors import ParameterError

SHARED_SUFFIX = "parameters"

KERNELS = {f"{way}{name}": name for name in ("horseshoes", "table") for way in ("", "fwd1_")}
"""Inner calls and the header of `kernels/` that holds them: functions named
`<kernel>_<size>_<size>...`, a first derivative `fwd1_<kernel>_<size>...` as CasADi names it."""

EACH = "each_"
"""Beginning of the names of inner functions that are C functions of their own."""

LONG_BODY = {"lanes": 600, "double": 12_000}
"""Most statements in one C function of many states, and of one: a longer body is cut into parts.
One of one state then takes some percent longer to run, and two thirds as long to compile."""
LONG_PART = {"lanes": 600, "double": 1000}
"""Statements in each part."""
_TAKES = "const double *const *arg, double *const *res"
UNITS = 4
"""Texts, beside the first, that the parts of a long body are written to."""
_VALUES = re.compile(r"\b(?:t\d+|(?:co)?sine\d+_\d+)\b")
_ARRAYS = re.compile(r"\b(?:angle\d+|(?:co)?sine\d+|call\d+_[ar]\d+)\b")

_FORMS = {
    ca.OP_ADD: "({0} + {1})",
    ca.OP_SUB: "({0} - {1})",
    ca.OP_MUL: "({0} * {1})",
    ca.OP_DIV: "({0} / {1})",
    ca.OP_NEG: "(-{0})",
    ca.OP_SQ: "({0} * {0})",
    ca.OP_TWICE: "({0} + {0})",
    ca.OP_INV: "(1.0 / {0})",
}
_NAMES = (
    "exp log log1p expm1 sqrt tan asin acos atan sinh cosh tanh fabs floor ceil sign not pow atan2 "
    "fmin fmax fmod hypot copysign lt le eq ne and or if_else_zero"
)
_CALLS = {getattr(ca, f"OP_{name.upper()}"): name for name in _NAMES.split()}
_CALLS[ca.OP_CONSTPOW] = "pow"
_COMMUTATIVE = {ca.OP_ADD, ca.OP_MUL, ca.OP_FMIN, ca.OP_FMAX, ca.OP_EQ, ca.OP_NE}


class _Node(NamedTuple):
    op: int
    inputs: tuple[int, ...]
    detail: tuple[float, ...] = ()
    callee: str = ""


class _Array(NamedTuple):
    """Declaration of an array in C.

    Attributes:
        kind: C type of a number.
        name: Its name in C.
        size: Number of its entries.
        values: C texts of them; none where a call writes them.
    """

    kind: str
    name: str
    size: int
    values: Sequence[str] = ()

    def __str__(self) -> str:
        given = f" = {{{', '.join(self.values)}}}" if self.values else ""
        return f"  {self.kind} {self.name}[{self.size}]{given};"


class _Graph:
    """Nodes of a function, each distinct operation once, and what it writes.

    Args:
        function: The function.
        calls: Whether functions named `each_...` stay calls.
    """

    def __init__(self, function: ca.Function, calls: bool) -> None:
        self._calls = calls
        self.nodes: list[_Node] = []
        self.callees: dict[str, ca.Function] = {}
        self._known: dict[_Node, int] = {}
        self.outputs = self._read(function)  # result, entry, node

    def _read(
        self, function: ca.Function, given: Mapping[tuple[int, int], int] | None = None
    ) -> list[tuple[int, int, int]]:
        """Nodes of a function whose inputs are new, or nodes given; what it writes."""
        outputs: list[tuple[int, int, int]] = []
        work: dict[int, int] = {}
        steps = ca.vertsplit(function.instructions_sx()) if function.find_functions() else []
        for k in range(function.n_instructions()):
            op, read = function.instruction_id(k), function.instruction_input(k)
            written = function.instruction_output(k)
            if op == ca.OP_OUTPUT:
                result, entry = written
                outputs.append((result, entry, work[read[0]]))
                continue
            if op == ca.OP_CONST:
                found = [self._place(_Node(op, (), (function.instruction_constant(k),)))]
            elif op == ca.OP_INPUT:
                place = (read[0], read[1])
                found = [self._place(_Node(op, (), place)) if given is None else given[place]]
            else:
                inputs = tuple(work[i] for i in read)
                if op == ca.OP_CALL:
                    found = self._call(steps[k].which_function(), inputs)
                else:
                    ordered = tuple(sorted(inputs)) if op in _COMMUTATIVE else inputs
                    found = [self._place(_Node(op, ordered))]
            work.update(zip(written, found, strict=True))
        return outputs

    def _place(self, node: _Node) -> int:
        """Position of a node, which is new or known; of constants (in a call) their value."""
        given = [self.nodes[i].detail for i in node.inputs if self.nodes[i].op == ca.OP_CONST]
        if node.op != ca.OP_CALL and 0 < len(given) == len(node.inputs):
            of = ca.SX.unary if len(given) == 1 else ca.SX.binary
            node = _Node(ca.OP_CONST, (), (float(of(node.op, *(x for (x,) in given))),))
        if node not in self._known:
            self._known[node] = len(self.nodes)
            self.nodes.append(node)
        return self._known[node]

    def _call(self, callee: ca.Function, inputs: tuple[int, ...]) -> list[int]:
        """Positions of all numbers that an inner call gives; without a kernel it is written out."""
        name = callee.name()
        if kernel_of(name)[0] not in KERNELS and not (self._calls and name.startswith(EACH)):
            places = [(k, i) for k in range(callee.n_in()) for i in range(callee.nnz_in(k))]
            found = self._read(callee, dict(zip(places, inputs, strict=True)))
            return [node for _, _, node in sorted(found)]
        self.callees[name] = callee
        call = self._place(_Node(ca.OP_CALL, inputs, (), name))
        return [
            self._place(_Node(ca.OP_CALL, (call,), (result, entry)))
            for result in range(callee.n_out())
            for entry in range(callee.nnz_out(result))
        ]

    def angle_levels(self) -> list[list[int]]:
        """Angles of all sines and cosines, grouped by the number of such calls before."""
        level = [0] * len(self.nodes)
        angles: dict[int, int] = {}
        for k, node in enumerate(self.nodes):
            level[k] = max((level[i] for i in node.inputs), default=0)
            if node.op in (ca.OP_SIN, ca.OP_COS):
                angles[node.inputs[0]] = level[k]
                level[k] += 1
        groups: list[list[int]] = [[] for _ in range(max(angles.values(), default=-1) + 1)]
        for angle, group in angles.items():
            groups[group].append(angle)
        return [group for group in groups if group]

    def needed_for(self, targets: list[int]) -> set[int]:
        """The targets and all they are computed from."""
        needed: set[int] = set()
        pending = list(targets)
        while pending:
            k = pending.pop()
            if k not in needed:
                needed.add(k)
                pending += self.nodes[k].inputs
        return needed


def kernel_of(name: str) -> tuple[str, list[str]]:
    """Kernel and sizes of an inner call.

    Args:
        name: `<kernel>_<size>_<size>...`
    """
    words = name.split("_")
    sizes = [word for word in words if word.isdecimal()]
    return "_".join(words[: len(words) - len(sizes)]), sizes


def calls_kernels(function: ca.Function) -> bool:
    """Whether a function calls a kernel."""
    return any(kernel_of(one.name())[0] in KERNELS for one in function.find_functions())


def dense(function: ca.Function) -> ca.Function:
    """The function with every argument and result written out, zeros too."""
    inputs = [ca.SX.sym(name, *function.size_in(name)) for name in function.name_in()]
    outputs = [ca.densify(output) for output in function.call(inputs, True, False)]
    return ca.Function(function.name(), inputs, outputs)


def dense_graph(function: ca.Function, calls: bool) -> _Graph:
    """Nodes of a function all of whose results are written, zeros too.

    Args:
        function: The function.
        calls: Whether functions named `each_...` stay calls.
    """
    return _Graph(dense(function), calls)


def emit(function: ca.Function) -> list[str]:
    """C texts of a function of one state, the first of which defines `name`.

    A very long body is several texts, which compile at the same time.

    Args:
        function: An SX function.
    """
    graph, texts = dense_graph(function, calls=True), dict[str, str]()
    head = f"void {function.name()}({_TAKES})"
    pointers, statements = _pointers(function), _statements_of_one(graph, texts)
    top = [*_header(function), *_includes(graph), *texts.values()]
    if len(statements) <= LONG_BODY["double"]:
        return ["\n".join([*top, f"{head} {{", *pointers, *map(str, statements), "}", ""])]
    parts = _in_parts(function.name(), "double", {}, pointers, statements)
    main = [*(f"{one};" for one in parts.heads), f"{head} {{", *parts.calls, "}"]
    return _units(top, [*top, *main], parts)


def _statements_of_one(graph: _Graph, texts: dict[str, str]) -> list[str | _Array]:
    """Statements of code for one state; texts of functions that it calls are added to `texts`."""
    for name, callee in graph.callees.items():
        if name.startswith(EACH) and name not in texts:
            inner = _Graph(callee, calls=True)
            lines = [*_pointers(callee), *map(str, _statements_of_one(inner, texts))]
            head = f"static __attribute__((noinline)) void {name}({_TAKES}) {{"
            texts[name] = "\n".join([*_includes(inner), head, *lines, "}"])
    return _Writer(graph).statements()


def emit_batch(function: ca.Function) -> list[str]:
    """C texts of a function of many states, several side by side, that define `name_batch`.

    A long body is several texts, which compile at the same time.

    Args:
        function: An SX function. Inputs whose name ends in `parameters` are the
            same for all states.
    """
    name, graph = function.name(), dense_graph(function, calls=False)
    shared = [k.endswith(SHARED_SUFFIX) for k in function.name_in()]
    sizes = [function.numel_in(k) for k in range(function.n_in())]
    tiles = [
        f"  double x{k}[{max(size, 1)} * LANES]; gather(a{k}, {size}, k, count, x{k});"
        for k, size in enumerate(sizes)
        if not shared[k]
    ]
    statements = _LanesWriter(graph, shared).statements()
    top, parts = [*_header(function), *_includes(graph)], _Parts([], [], [])
    if len(statements) > LONG_BODY["lanes"]:
        given = [f"  const double *const x{k} = tile[{k}]; (void)x{k};" for k in range(len(sizes))]
        more = {"tile": "const double *const *", "k": "long", "stride": "long"}
        parts = _in_parts(name, "lanes", more, [*_pointers(function), *given], statements)
        held = ", ".join("0" if common else f"x{k}" for k, common in enumerate(shared))
        statements = [f"  const double *const tile[] = {{{held}}};", *parts.calls]
    lines = [
        *_header(function),
        " /* arguments state by state, results entry by entry (rows of `stride` states) */",
        *_includes(graph),
        *(f"{head};" for head in parts.heads),
        f"void {name}_batch({_TAKES}, long count, long stride) {{",
        *_pointers(function),
        "  for (long k = 0; k < count; k += LANES) {",
        *tiles,
        *map(str, statements),
        "  }",
        "}",
    ]
    return _units(top, lines, parts)


class _Parts(NamedTuple):
    """Functions that a long body is cut into.

    Attributes:
        heads: Head of each.
        texts: Each, as text.
        calls: Statements that call them.
    """

    heads: list[str]
    texts: list[str]
    calls: list[str]


def _in_parts(
    name: str,
    kind: str,
    more: Mapping[str, str],
    pointers: list[str],
    statements: Sequence[str | _Array],
) -> _Parts:
    """Long body as functions of some statements each.

    Compilers hand out registers in a time that grows with the square of a function's length.
    What a part computes for later ones goes through memory, in places used again when free.

    Args:
        name: Name of the function.
        kind: C type of a number.
        more: Types of what parts are given besides, by name.
        pointers: Statements that each part begins with.
        statements: The body.
    """
    arrays, most = dict[str, int](), 0
    lines = list[str]()
    for one in statements:
        if isinstance(one, _Array):
            arrays[one.name] = most
            most += one.size
            lines += [f"  {one.name}[{k}] = {value};" for k, value in enumerate(one.values)]
        else:
            lines.append(one)
    length = LONG_PART[kind]
    pieces = [lines[k : k + length] for k in range(0, len(lines), length)]
    words = [set(_VALUES.findall("\n".join(piece))) for piece in pieces]
    last = {word: k for k, found in enumerate(words) for word in found}
    places, free, parts = dict[str, int](), list[int](), _Parts([], [], [])
    takes = [_TAKES, f"{kind} *held", *(f"{of} {one}" for one, of in more.items())]
    for k, piece in enumerate(pieces):
        used = sorted(set(_ARRAYS.findall("\n".join(piece))) & arrays.keys())
        body = [f"  double *const {array} = held + {arrays[array]};" for array in used]
        kept = sorted(words[k] & places.keys())
        body += [f"  const {kind} {word} = held[{places[word]}];" for word in kept]
        free += [places.pop(word) for word in kept if last[word] == k]
        body += piece
        for word in sorted(word for word in words[k] - set(kept) if last[word] > k):
            places[word] = free.pop() if free else most
            most = max(most, places[word] + 1)
            body.append(f"  held[{places[word]}] = {word};")
        head = f"void {name}_part{k}({', '.join(takes)})"
        parts.heads.append(f'__attribute__((visibility("hidden"))) {head}')
        parts.texts.append("\n".join([f"{parts.heads[k]} {{", *pointers, *body, "}"]))
        parts.calls.append(f"  {name}_part{k}({', '.join(['arg, res, held', *more])});")
    parts.calls.insert(0, f"  {kind} held[{max(most, 1)}];")
    return parts


def _units(top: list[str], first: list[str], parts: _Parts) -> list[str]:
    """C files: that of the function itself, then those of its parts, all with the same includes."""
    groups = (parts.texts[k::UNITS] for k in range(min(UNITS, len(parts.texts))))
    return ["\n".join([*unit, ""]) for unit in (first, *([*top, *group] for group in groups))]


def _header(function: ca.Function) -> list[str]:
    given = ["{} {}x{}".format(name, *function.size_in(name)) for name in function.name_in()]
    found = ["{} {}x{}".format(name, *function.size_out(name)) for name in function.name_out()]
    return [
        "/* Generated by patagium from a symbolic function. Do not edit.",
        f" * inputs (dense, column-major): {', '.join(given)}",
        f" * outputs: {', '.join(found)} */",
    ]


def _includes(graph: _Graph) -> list[str]:
    called = (kernel_of(name)[0] for name in graph.callees)
    kernels = sorted({KERNELS[name] for name in called if name in KERNELS})
    return [f'#include "{name}.h"' for name in ("operations", *kernels)]


def _pointers(function: ca.Function) -> list[str]:
    arguments = [
        f"  const double *restrict a{k} = arg[{k}]; (void)a{k};" for k in range(function.n_in())
    ]
    results = [f"  double *restrict r{k} = res[{k}]; (void)r{k};" for k in range(function.n_out())]
    return arguments + results


def _operand(graph: _Graph, k: int) -> str:
    node = graph.nodes[k]
    return _literal(node.detail[0]) if node.op == ca.OP_CONST else f"t{k}"


def _literal(value: float) -> str:
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "(-INFINITY)"
    return repr(value) if value >= 0 else f"({value!r})"


class _Writer:
    """Statements of a graph in an order that lets each group of angles be taken at once.

    They are of one state; methods and the names here differ in code for many.

    Attributes:
        kind: C type of a number: "double" or "lanes".
        prefix: Prefix of the names of C functions.
        angle_value: Format of a sine or cosine: stem, number of the group, place in it.
    """

    kind, prefix, angle_value = "double", "scalar_", "{0}{1}[{2}]"

    def __init__(self, graph: _Graph) -> None:
        self._graph = graph
        self._lines: list[str | _Array] = []
        self._written = [node.op == ca.OP_CONST for node in graph.nodes]
        self._angles: dict[int, tuple[int, int]] = {}
        self._lists: dict[tuple[int, ...], str] = {}
        self._stores: dict[int, list[tuple[int, int]]] = {}
        for result, entry, k in graph.outputs:
            self._stores.setdefault(k, []).append((result, entry))

    def statements(self) -> list[str | _Array]:
        """All statements of the graph."""
        graph = self._graph
        for number, group in enumerate(graph.angle_levels()):
            for k in sorted(graph.needed_for(group)):
                self._write(k)
            self._lines += self._angle_block(group, number)
            self._angles |= {angle: (number, position) for position, angle in enumerate(group)}
        for k in range(len(graph.nodes)):
            self._write(k)
        for k in self._stores:
            if graph.nodes[k].op == ca.OP_CONST:
                self._lines += self._stored(k, self._argument(k))
        return self._lines

    def _write(self, k: int) -> None:
        """Statements of a node that is not written yet."""
        if self._written[k]:
            return
        self._written[k] = True
        if not self._graph.nodes[k].callee:
            self._lines += self._statements(k)
            return
        block = self._call_block(k)
        own = k + 1  # its results are the nodes that follow
        while own < len(self._graph.nodes) and self._graph.nodes[own].inputs == (k,):
            block += self._statements(own)
            own += 1
        if self.kind == "lanes":  # whose arrays no part finds in another
            block = ["\n".join(map(str, block))]
        self._lines += block

    def _call_block(self, k: int) -> list[str | _Array]:
        """Statements that call a kernel, `<kernel>_<kind>(count, sizes, in, out)`, or `each_...`.

        Numbers that `each_` was given before, or gave, are not copied again.
        """
        callee = self._graph.callees[self._graph.nodes[k].callee]
        kind, each = self.kind, callee.name().startswith(EACH)
        block, given, results = list[str | _Array](), list[str](), list[str]()
        first, own = 0, k + 1
        for place in range(callee.n_in()):
            held = self._graph.nodes[k].inputs[first : first + callee.nnz_in(place)]
            first += len(held)
            if not each or held not in self._lists:
                name = self._lists[held] = f"call{k}_a{place}"
                values = [self._argument(i) for i in held] or [self._alike("0.0")]
                block.append(_Array(kind, name, len(values), values))
            given.append(self._lists[held])
        for place in range(callee.n_out()):
            count, name = callee.nnz_out(place), f"call{k}_r{place}"
            self._lists[tuple(range(own, own + count))] = name
            own += count
            block.append(_Array(kind, name, count))
            results.append(name)
        into = f"(const {kind} *const[]){{{', '.join(given)}}}"
        out = f"({kind} *const[]){{{', '.join(results)}}}"
        if each:
            return [*block, f"  {callee.name()}({into}, {out});"]
        kernel, sizes = kernel_of(callee.name())
        listed = f"(const int[]){{{', '.join(sizes)}}}"
        return [*block, f"  {kernel}_{kind}({len(sizes)}, {listed},\n    {into}, {out});"]

    def _statements(self, k: int) -> list[str]:
        """Statements of the value of a node, and of the results that it is."""
        self._written[k] = True
        value = f"  const {self.kind} t{k} = {self._value(self._graph.nodes[k])};"
        return [value, *self._stored(k, f"t{k}")]

    def _stored(self, k: int, value: str) -> list[str]:
        """Statements that write a node's value to the results that it is."""
        return [self._store(*place, value) for place in self._stores.get(k, ())]

    def _argument(self, k: int) -> str:
        text = _operand(self._graph, k)
        return self._alike(text) if self._graph.nodes[k].op == ca.OP_CONST else text

    def _value(self, node: _Node) -> str:
        """C expression of a node."""
        if node.op == ca.OP_INPUT:
            return self._load(int(node.detail[0]), int(node.detail[1]))
        if node.op == ca.OP_CALL:
            return f"call{node.inputs[0]}_r{node.detail[0]}[{node.detail[1]}]"
        if node.op in (ca.OP_SIN, ca.OP_COS):
            number, position = self._angles[node.inputs[0]]
            stem = "sine" if node.op == ca.OP_SIN else "cosine"
            return self.angle_value.format(stem, number, position)
        if node.op in _FORMS:
            return _FORMS[node.op].format(*[_operand(self._graph, i) for i in node.inputs])
        if node.op not in _CALLS:
            raise ParameterError("expression", "operations that C can express", node.op)
        arguments = ", ".join(self._argument(i) for i in node.inputs)
        return f"{self.prefix}{_CALLS[node.op]}({arguments})"

    def _alike(self, number: str) -> str:
        """C text of a number that is the same in all states."""
        return number

    def _load(self, argument: int, entry: int) -> str:
        """C text that reads an entry of an argument."""
        return f"a{argument}[{entry}]"

    def _store(self, result: int, entry: int, value: str) -> str:
        """C statement that writes an entry of a result."""
        return f"  r{result}[{entry}] = {value};"

    def _angle_block(self, group: list[int], number: int) -> list[str | _Array]:
        """Statements that take the sines and cosines of a group of angles."""
        padded = -(-len(group) // 8) * 8
        angles = [*(_operand(self._graph, k) for k in group), *["0.0"] * (padded - len(group))]
        names = [f"{stem}{number}" for stem in ("angle", "sine", "cosine")]
        arrays = [_Array("double", one, padded) for one in names]
        arrays[0] = arrays[0]._replace(values=angles)
        return [*arrays, f"  sincos_many({padded}, {', '.join(names)});"]


class _LanesWriter(_Writer):
    """Statements of code for many states; `shared` are the arguments that all have in common."""

    kind, prefix, angle_value = "lanes", "lanes_", "{0}{1}_{2}"

    def __init__(self, graph: _Graph, shared: Sequence[bool]) -> None:
        super().__init__(graph)
        self._shared = shared

    def _alike(self, number: str) -> str:
        return f"lanes_broadcast({number})"

    def _load(self, argument: int, entry: int) -> str:
        if self._shared[argument]:
            return self._alike(super()._load(argument, entry))
        return f"lanes_load(x{argument} + {entry} * LANES)"

    def _store(self, result: int, entry: int, value: str) -> str:
        return f"  lanes_store(r{result} + {entry} * stride + k, {value});"

    def _angle_block(self, group: list[int], number: int) -> list[str | _Array]:
        block = list[str | _Array]()
        for position, angle in enumerate(group):
            sine, cosine = f"sine{number}_{position}", f"cosine{number}_{position}"
            call = f"  lanes_sincos({_operand(self._graph, angle)}, &{sine}, &{cosine});"
            block.append(f"  lanes {sine}, {cosine};\n{call}")
        return block
