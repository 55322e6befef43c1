"""Generated C: every operation, batches, cache and the life without a compiler."""

from __future__ import annotations

import multiprocessing
import os
import platform
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from patagium.errors import CompilerError, ParameterError, ShapeError
from patagium.native import compiler as compiler_module
from patagium.native import compiler_name, library, load_functions, load_kernel
from patagium.native import emit as emit_module
from patagium.native import function as function_module
from patagium.native.compiler import compiler_accepts, compiler_command
from patagium.native.emit import emit
from patagium.sensing.motion.frame_model import euler_function

needs_compiler = pytest.mark.skipif(compiler_name() is None, reason="no C compiler here")

# the C library and the vectorized sine differ by an ulp; a handful of operations follow
ROUNDING = 1e-14


def every_operation() -> list[ca.Function]:
    x, y = ca.SX.sym("x", 4), ca.SX.sym("y")
    p = ca.SX.sym("p", 2)
    a, b, c, d = ca.vertsplit(x)
    results = [
        ca.sin(a) * ca.cos(ca.sin(b)) + ca.tan(c),
        ca.exp(a) + ca.log(1 + b * b) + ca.log1p(c * c) + ca.expm1(d),
        ca.sqrt(a * a + 2) / (1 + ca.fabs(b)) - ca.floor(3 * c) + ca.ceil(d),
        ca.asin(ca.tanh(a)) + ca.acos(ca.tanh(b)) + ca.atan(c) + ca.atan2(d, a),
        ca.sinh(a) + ca.cosh(b) + ca.sign(c) + ca.copysign(d, a),
        ca.power(ca.fabs(a) + 1, b) + ca.power(c, 2) + 1 / (3 + ca.fabs(d)),
        ca.fmin(a, b) + ca.fmax(c, d) + ca.fmod(a, 0.3) + ca.hypot(b, c),
        ca.if_else(a < b, c, ca.if_else(ca.logic_or(c <= d, a == b), d, -a)),
        ca.if_else(ca.logic_and(ca.logic_not(a > 0), b != c), 2 * a, y),
        p[0] * a + p[1] * y,
        ca.SX(2.5),
        a,
    ]
    matrix = ca.SX(2, 3)
    matrix[0, 1], matrix[1, 2] = a * y, ca.cos(y)
    return [
        ca.Function(
            "many",
            [x, y, p],
            [ca.vertcat(*results), matrix, a + y],
            ["x", "y", "parameters"],
            ["v", "m", "s"],
        )
    ]


def casadi_values(x, y, p):
    vector, matrix, scalar = every_operation()[0](x, y, p)
    return np.array(vector).ravel(), np.array(matrix), float(scalar)


@pytest.mark.parametrize("choice", ["", "none"])
def test_every_operation_agrees_with_casadi(choice, monkeypatch, rng):
    monkeypatch.setenv("PATAGIUM_COMPILER", choice)
    many = load_functions("every operation", every_operation, label="test")["many"]
    p = rng.normal(size=2)
    xs, ys = rng.normal(size=(50, 4)), rng.normal(size=50)
    for x, y in zip(xs, ys, strict=True):
        for ours, theirs in zip(many(x, y, p), casadi_values(x, y, p), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=ROUNDING, atol=ROUNDING)
    for count in (1, 7, 8, 9, 50):
        vectors, matrices, scalars = many.batch(xs[:count], ys[:count], p)
        assert vectors.shape == (count, 12)
        assert matrices.shape == (count, 2, 3)
        assert scalars.shape == (count,)
        for k in range(count):
            vector, matrix, scalar = casadi_values(xs[k], ys[k], p)
            np.testing.assert_allclose(vectors[k], vector, rtol=ROUNDING, atol=ROUNDING)
            np.testing.assert_allclose(matrices[k], matrix, rtol=ROUNDING, atol=ROUNDING)
            np.testing.assert_allclose(scalars[k], scalar, rtol=ROUNDING, atol=ROUNDING)


def each_of_three():
    """Three calls of one function, the third with what the second gave; and its plain form."""
    x, y, held = ca.SX.sym("x", 2), ca.SX.sym("y"), ca.SX.sym("held", 3)
    results = [ca.vertcat(ca.sin(x[0]) * y, x[1] + held[2], held[0] - y), x * held[1]]
    inner = ca.Function("each_piece", [x, y, held], results, {"never_inline": True})
    plain = ca.Function("piece", [x, y, held], results)
    given = ca.SX.sym("given", 4)

    def outer(call):
        first, last = call(given[:2], given[2], ca.SX([0, 1, 2])), []
        for place in (2, 3):
            first = call(given[:2], given[place], first[0])
            last += [first[1]]
        return ca.Function("outer", [given], [ca.vertcat(first[0], *last)], ["given"], ["found"])

    return outer(lambda *values: inner.call(values, False, True)), outer(plain)


@pytest.mark.parametrize("choice", ["", "none"])
def test_a_function_of_each_strip_is_written_once_and_called(choice, monkeypatch, rng):
    monkeypatch.setenv("PATAGIUM_COMPILER", choice)
    called, plain = each_of_three()
    (text,) = emit(called)
    assert text.count("each_piece(const double") == 1
    assert text.count("  each_piece(") == 3
    assert text.count("= {") == 3 + 2  # one list a call, x and the first `held` once
    compiled = load_functions("each of three", lambda: [called], label="test")["outer"]
    for given in rng.normal(size=(20, 4)):
        expected = np.array(plain(given)).ravel()
        np.testing.assert_allclose(compiled(given), expected, rtol=ROUNDING, atol=ROUNDING)
    given = rng.normal(size=(9, 4))
    expected = [np.array(plain(one)).ravel() for one in given]
    np.testing.assert_allclose(compiled.batch(given), expected, rtol=ROUNDING, atol=ROUNDING)


@needs_compiler
def test_a_long_body_in_parts_is_the_same_function(monkeypatch, rng):
    monkeypatch.setitem(emit_module.LONG_BODY, "double", 10)
    monkeypatch.setitem(emit_module.LONG_PART, "double", 6)
    called, plain = each_of_three()
    assert len(emit(called)) > 2 and len(emit(every_operation()[0])) == 1 + emit_module.UNITS
    functions = load_functions("in parts", lambda: [called, *every_operation()], label="test")
    p, xs, ys = rng.normal(size=2), rng.normal(size=(20, 4)), rng.normal(size=20)
    for x, y in zip(xs, ys, strict=True):
        expected = np.array(plain(x)).ravel()
        np.testing.assert_allclose(functions["outer"](x), expected, rtol=ROUNDING, atol=ROUNDING)
        found = functions["many"](x, y, p)
        for one, known in zip(found, casadi_values(x, y, p), strict=True):
            np.testing.assert_allclose(one, known, rtol=ROUNDING, atol=ROUNDING)


@needs_compiler
@pytest.mark.skipif(platform.machine() != "x86_64", reason="the processors are x86-64 ones")
@pytest.mark.parametrize("processor", ["x86-64", "haswell"])
def test_narrower_vectors_give_the_same(processor, tmp_path, monkeypatch, rng):
    if processor == "haswell" and " avx2 " not in Path("/proc/cpuinfo").read_text():
        pytest.skip("this processor has no AVX2")
    p, xs, ys = rng.normal(size=2), rng.normal(size=(21, 4)), rng.normal(size=21)
    here = load_functions("every operation", every_operation, label="test")["many"]
    wide = here.batch(xs, ys, p)
    compiler = tmp_path / "cc"
    real = compiler_command()
    assert real is not None
    compiler.write_text(
        f'#!/bin/sh\nexec {real[0]} $(echo "$@" | sed s/-march=native/-march={processor}/)\n'
    )
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    monkeypatch.setenv("PATAGIUM_CACHE", str(tmp_path))
    many = load_functions("every operation", every_operation, label="test")["many"]
    for narrow, wider in zip(many.batch(xs, ys, p), wide, strict=True):
        np.testing.assert_allclose(narrow, wider, rtol=ROUNDING, atol=ROUNDING)
    for narrow, wider in zip(many(xs[0], ys[0], p), here(xs[0], ys[0], p), strict=True):
        np.testing.assert_allclose(narrow, wider, rtol=ROUNDING, atol=ROUNDING)


def trigonometry() -> list[ca.Function]:
    x = ca.SX.sym("x")
    return [ca.Function("turn", [x], [ca.vertcat(ca.sin(x), ca.cos(x))], ["x"], ["y"])]


@pytest.mark.parametrize("span", [1.0, 10.0, 9e4, 1e9])
def test_sine_and_cosine_are_good_to_one_ulp(span, rng):
    turn = load_functions("trigonometry", trigonometry, label="test")["turn"]
    x = np.concatenate([rng.uniform(-span, span, 20_000), np.arange(-8, 9) * np.pi / 2, [0.0]])
    exact = np.stack([np.sin(x.astype(np.longdouble)), np.cos(x.astype(np.longdouble))], axis=1)
    error = np.abs(turn.batch(x) - exact)
    # one ulp of values below 1 is 1.1e-16; reduction adds a rounding of the angle
    assert float(error.max()) < 1.7e-16


def test_not_a_number_stays_not_a_number():
    turn = load_functions("trigonometry", trigonometry, label="test")["turn"]
    assert np.isnan(turn(np.nan)).all()
    assert np.isnan(turn(np.inf)).all()
    assert np.isnan(turn.batch(np.array([0.0, np.nan, 1.0]))[1]).all()
    assert np.isfinite(turn.batch(np.array([0.0, np.nan, 1.0]))[[0, 2]]).all()


def test_wrong_shapes_and_counts_are_refused():
    many = load_functions("every operation", every_operation, label="test")["many"]
    with pytest.raises(ShapeError, match=r"x: expected shape \(4,\), found \(3,\)"):
        many(np.zeros(3), 0.0, np.zeros(2))
    with pytest.raises(ParameterError, match="3 arguments"):
        many(np.zeros(4), 0.0)
    with pytest.raises(ShapeError, match="leading axis"):
        many.batch(np.zeros((3, 4)), np.zeros(2), np.zeros(2))
    with pytest.raises(ShapeError, match="parameters"):
        many.batch(np.zeros((3, 4)), np.zeros(3), np.zeros((3, 2)))


def test_threads_do_not_mix_their_arguments():
    turn = load_functions("trigonometry", trigonometry, label="test")["turn"]
    wrong = []

    def work(angle: float) -> None:
        for _ in range(2000):
            if abs(turn(angle)[0] - np.sin(angle)) > 1e-15:
                wrong.append(angle)

    threads = [threading.Thread(target=work, args=(0.1 * k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


@needs_compiler
def test_a_second_load_makes_no_expression(tmp_path, monkeypatch):
    monkeypatch.setenv("PATAGIUM_CACHE", str(tmp_path))
    load_functions("cached", trigonometry, label="test")

    def never() -> list[ca.Function]:
        raise AssertionError("built again")

    turn = load_functions("cached", never, label="test")["turn"]
    assert turn(0.0)[1] == 1.0


@needs_compiler
def test_code_for_many_states_is_compiled_when_first_asked_for(tmp_path, monkeypatch):
    monkeypatch.setenv("PATAGIUM_CACHE", str(tmp_path))
    turn = load_functions("late", trigonometry, label="test")["turn"]
    assert len(list(tmp_path.glob("*.so"))) == 1
    turn.batch(np.zeros(3))
    assert len(list(tmp_path.glob("*.so"))) == 2


@needs_compiler
def test_a_compiler_is_asked_before_it_is_given_a_flag():
    compiler = compiler_command()
    assert compiler is not None
    assert compiler_accepts(compiler, ("-O1", "-O2"))
    assert not compiler_accepts(compiler, ("-O1", "-fno-such-thing"))


@needs_compiler
def test_functions_of_many_states_only_are_compiled_at_once_and_serve_one_too(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("PATAGIUM_CACHE", str(tmp_path))
    turn = load_functions("only", trigonometry, label="test", many_only=["turn"])["turn"]
    np.testing.assert_allclose(turn.batch(np.zeros(3))[:, 1], 1.0, rtol=0)
    assert len(list(tmp_path.glob("*.so"))) == 1
    assert turn.address is None
    for angle in (0.3, 0.4):
        np.testing.assert_allclose(turn(angle)[0], np.sin(angle), rtol=ROUNDING)


@needs_compiler
def test_an_inner_function_of_constants_alone_compiles_for_many_states():
    """As derivatives of a polar's table have it: C has no lanes = double - double."""
    a, b, x = ca.SX.sym("a"), ca.SX.sym("b"), ca.SX.sym("x")
    inner = ca.Function("inner", [a, b], [a - b, ca.sin(a), -b], {"never_inline": True})
    whole = ca.Function("outer", [x], [ca.vertcat(*inner(0.5, 0.2), *inner(x, 0.2))], ["x"], ["y"])
    outer = load_functions("constants of a call", lambda: [whole], label="test")["outer"]
    given = np.linspace(0.0, 1.0, 9)
    expected = [[0.3, np.sin(0.5), -0.2, one - 0.2, np.sin(one), -0.2] for one in given]
    np.testing.assert_allclose(outer.batch(given), expected, rtol=ROUNDING, atol=ROUNDING)


def test_results_of_batches_stay_what_they_were():
    turn = load_functions("trigonometry", trigonometry, label="test")["turn"]
    x = np.linspace(-1, 1, 40)
    first = turn.batch(x)
    second = turn.batch(2 * x)
    np.testing.assert_allclose(first[:, 0], np.sin(x), rtol=1e-15)
    np.testing.assert_allclose(second[:, 0], np.sin(2 * x), rtol=1e-15)
    part = turn.batch(x)[5:7]
    turn.batch(3 * x)
    np.testing.assert_allclose(part[:, 0], np.sin(x[5:7]), rtol=1e-15)


@needs_compiler
@pytest.mark.parametrize("count", [1, 8, 63, 64, 65, 72, 203, 1001])
def test_a_long_batch_has_the_same_numbers_on_any_number_of_cores(count, monkeypatch):
    many = load_functions("every operation", every_operation, label="operations")["many"]
    rng = np.random.default_rng(count)
    given = rng.uniform(-1, 1, (count, 4)), rng.uniform(-1, 1, count), np.array([0.3, -0.7])
    monkeypatch.setattr(function_module, "_LONG", np.inf)
    alone = [part.copy() for part in many.batch(*given)]
    monkeypatch.setattr(function_module, "_LONG", -1.0)
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    used = set()
    pooled = ThreadPoolExecutor.submit
    monkeypatch.setattr(
        ThreadPoolExecutor, "submit", lambda *task: used.add(task[2:]) or pooled(*task)
    )
    for one, other in zip(alone, many.batch(*given), strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(used) == min(3, -(-max(count - 64, 0) // 8))  # parts of whole vectors


def _load_in(cache: str, results) -> None:
    import os

    os.environ["PATAGIUM_CACHE"] = cache
    functions = load_functions("parallel", every_operation, label="test")
    results.put(float(functions["many"](np.ones(4), 2.0, np.ones(2))[2]))


@needs_compiler
def test_parallel_processes_share_one_fresh_cache(tmp_path):
    context = multiprocessing.get_context("spawn")
    results = context.Queue()
    workers = [context.Process(target=_load_in, args=(str(tmp_path), results)) for _ in range(3)]
    for worker in workers:
        worker.start()
    assert [results.get(timeout=60) for _ in workers] == [3.0] * 3
    for worker in workers:
        worker.join()
    assert not list(tmp_path.glob("building-*"))


@needs_compiler
def test_a_compiler_error_carries_the_compilers_words(tmp_path, monkeypatch):
    monkeypatch.setenv("PATAGIUM_CACHE", str(tmp_path))
    compiler = compiler_command()
    assert compiler is not None
    with pytest.raises(CompilerError, match="error"):
        compiler_module.build(compiler, {"bad.c": "int x = ;"}, ("-O0",), "a broken file")
    assert not list(tmp_path.glob("building-*"))


def test_a_broken_compiler_is_as_good_as_none(tmp_path, monkeypatch, capsys):
    broken = tmp_path / "broken-cc"
    broken.write_text("#!/bin/sh\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATAGIUM_CACHE", str(tmp_path))
    monkeypatch.setenv("CC", str(broken))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("PATAGIUM_COMPILER", raising=False)
    monkeypatch.delenv("PATAGIUM_TOLD_WITHOUT_COMPILER", raising=False)
    compiler_module._announce_fallback.cache_clear()
    assert compiler_name() is None
    assert load_kernel("march") is None
    turn = load_functions("trigonometry", trigonometry, label="test")["turn"]
    assert turn.address is None
    assert turn(0.0)[1] == 1.0
    notice = capsys.readouterr().err
    assert notice.count("no C compiler") == 1


def test_the_expression_behind_a_function_can_be_differentiated():
    turn = load_functions("trigonometry", trigonometry, label="test")["turn"]
    x = ca.SX.sym("x")
    slope = ca.Function("slope", [x], [ca.jacobian(turn.expression(x), x)])
    np.testing.assert_allclose(np.array(slope(0.3)).ravel(), [np.cos(0.3), -np.sin(0.3)])


def test_kernels_folder_is_part_of_the_package():
    assert (Path(compiler_module.KERNELS) / "lanes.h").exists()


def test_processes_that_need_the_same_entry_wait_for_each_other(tmp_path, monkeypatch):
    from concurrent.futures import ThreadPoolExecutor

    from patagium.native.cache import build_lock

    monkeypatch.setenv("PATAGIUM_CACHE", str(tmp_path))
    within, most = 0, 0

    def make(name: str) -> None:
        nonlocal within, most
        with build_lock(name):
            within += 1
            most = max(most, within)
            time.sleep(0.01)
            within -= 1

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(make, ["a"] * 8))
        assert most == 1
        list(pool.map(make, "abcd"))
    assert most > 1
    assert not list(tmp_path.glob("making-*"))


@pytest.mark.parametrize(("said", "cores"), [("3", 3), ("4,2", 4), (" 2 ", 2), ("0", 1)])
def test_a_number_of_threads_is_read_as_openmp_reads_it(said, cores, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", said)
    assert function_module._cores() == cores
    monkeypatch.setenv("OMP_NUM_THREADS", "many")
    assert function_module._cores() == (os.cpu_count() or 1)


@needs_compiler
def test_texts_for_many_states_alone_are_compiled_briefly_but_for_kernels():
    x = ca.SX.sym("x", 3)
    kernel = ca.Function("table_2_1", [x], [ca.sum1(x)], {"never_inline": True})
    plain, calling = (
        ca.Function(n, [x], [y]) for n, y in (("plain", x * x), ("calling", kernel(x)))
    )
    functions = {one.name(): one for one in (plain, calling)}
    made, texts = [], {"plain": ["text"], "calling": ["text", "(const int[])", "text"]}

    def build(compiler, sources, flags, label, own):
        made.append(own)
        raise KeyboardInterrupt

    def asked():
        with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(library, "build", build)
            patch.setattr(library, "emit_batch", lambda function: texts[function.name()])
            load_functions("brief", lambda: functions.values(), label="t", many_only=[*functions])
        return {*made.pop()}

    assert "(const int[])" in emit_module.emit_batch(calling)[0]
    assert "(const int[])" not in emit_module.emit_batch(plain)[0]
    assert asked() == {"plain_batch.c", "calling_batch.c", "calling_batch2.c"}
    texts["calling"][1] += "fwd1_"  # of a derivative, in a loop of a trim
    assert asked() == {"plain_batch.c"}


def test_what_was_interpreted_without_a_compiler_is_compiled_with_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The autopilot calls it by its address: none was kept for ever, and its first call crashed."""
    with monkeypatch.context() as without:
        without.setenv("PATAGIUM_TOLD_WITHOUT_COMPILER", "none")
        without.setenv("PATAGIUM_COMPILER", "none")
        assert euler_function().address is None
    assert euler_function().address is not None
