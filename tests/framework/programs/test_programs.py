"""Programs and straight-line C mean what CasADi means."""

import ctypes
import os
import shutil
from collections.abc import Callable, Iterator
from functools import reduce
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wideberth.framework.numerics.integration import runge_kutta
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.plugins import registry
from wideberth.framework.programs import Program, listing_of
from wideberth.framework.programs.operations import OPERATIONS
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Pose
from wideberth.regions import BUILT_IN as REGIONS
from wideberth.robots import BUILT_IN as ROBOTS
from wideberth.solvers.c_text import c_source
from wideberth.solvers.riccati.compile_once import compile_once

_evaluator = pytest.importorskip("wideberth.framework.programs._evaluator")

SPECIAL = [
    -np.inf, -1e300, -2.5, -1.0, -0.4, -1e-310, -0.0, 0.0, 5e-324, 1e-310, 0.4, 1.0, 1.5, 2.5,
    np.inf, np.nan,
]  # fmt: skip
UNARY: list[Callable[[Any], Any]] = [
    ca.exp, ca.expm1, ca.log, ca.log1p, ca.sqrt, ca.sin, ca.cos, ca.tan, ca.asin, ca.acos, ca.atan,
    ca.sinh, ca.cosh, ca.tanh, ca.asinh, ca.acosh, ca.atanh, ca.erf, ca.fabs, ca.sign, ca.floor,
    ca.ceil, ca.logic_not, lambda x: -x, lambda x: x * x, lambda x: x + x, lambda x: 1 / x,
    lambda x: x**3, lambda x: x**2.5, lambda x: x**-0.5,
]  # fmt: skip
BINARY: list[Callable[[Any, Any], Any]] = [
    lambda x, y: x + y, lambda x, y: x - y, lambda x, y: x * y, lambda x, y: x / y,
    lambda x, y: x**y, lambda x, y: x < y, lambda x, y: x <= y, lambda x, y: x == y,
    lambda x, y: x != y, ca.logic_and, ca.logic_or, ca.fmod, ca.remainder, ca.copysign, ca.fmin,
    ca.fmax, ca.atan2, ca.hypot, lambda x, y: ca.if_else(x, y, 0),
    lambda x, y: ca.if_else(x, x, y),
]  # fmt: skip
Evaluate = Callable[..., Any]


def function(rows: Any, *arguments: Any) -> Any:
    """A function of v and p."""
    return ca.Function("f", list(arguments), [rows])


def by_casadi(f: Any, v: Any, p: Any) -> Any:
    """CasADi's own results, one column after the other."""
    pairs = zip(v.T, p.T, strict=True)
    return np.array([f(*pair).nonzeros() for pair in pairs]).reshape(v.shape[1], f.nnz_out(0)).T


def called(run: Callable[..., None], rows: int, v: Any, p: Any, offset: int = 2) -> Any:
    """Call a function with the arguments of `wb_function` that follow the program."""
    shifted = np.concatenate([np.full((len(v), offset), np.nan), v], axis=1)
    p = np.ascontiguousarray(p)
    out = np.full((rows, v.shape[1] + 1), 7.0)
    words = [word for array in (shifted, p, out) for word in (array.ctypes.data, array.strides[0])]
    run(offset, v.shape[1], *words)
    assert (out[:, -1] == 7.0).all(), "wrote beyond its columns"
    return out[:, :-1]


def exactly(f: Any, v: Any, p: Any) -> Any:
    """By the module of the re-check."""
    program = Program.of(f)
    run = _evaluator.evaluate
    return called(lambda *words: run(program.address, *words), program.results, v, p)


FUSED = """#include "evaluator.h"
void run(const int64_t *program, int64_t offset, int64_t count, const double *v, int64_t v_row,
    const double *p, int64_t p_row, double *out, int64_t out_row, double *work)
{ wb_evaluate(program, offset, count, v, v_row, p, p_row, out, out_row, work); }
int64_t work(const int64_t *program) { return wb_work(program); }
"""
KERNEL = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 10)
compiles = pytest.mark.skipif(
    shutil.which((os.environ.get("CC") or "cc").split()[0]) is None, reason="no C compiler"
)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv("WIDEBERTH_CACHE", str(folder))
        yield folder


@pytest.fixture(scope="module")
def fused(cache: Path) -> Evaluate:
    """The evaluator with the solver's flags and joined operations."""
    places = compile_once(FUSED, ["run", "work"])
    run = KERNEL(places["run"])
    size = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)(places["work"])

    def evaluate(f: Any, v: Any, p: Any) -> Any:
        program = Program.of(f, fused=True)
        work = np.full(size(program.address) + 16, np.nan)
        start = 8 - work.ctypes.data // 8 % 8
        end = start + size(program.address)
        address = work.ctypes.data + 8 * start
        found = called(lambda *words: run(program.address, *words, address), program.results, v, p)
        assert np.isnan(work[:start]).all() and np.isnan(work[end:]).all(), "wrote beyond its work"
        return found

    return evaluate


@pytest.fixture(scope="module")
def straight(cache: Path) -> Evaluate:
    """Straight-line C by the system's compiler."""

    def evaluate(f: Any, v: Any, p: Any) -> Any:
        run = KERNEL(compile_once(c_source({"f": f}), ["f"])["f"])
        return called(lambda *words: run(0, *words, 0), f.nnz_out(0), v, p)

    return evaluate


def draw(f: Any, count: int = 13) -> tuple[Any, Any]:
    rng = np.random.default_rng(1)
    v, p = (rng.uniform(0.2, 0.9, (f.nnz_in(i), count)) for i in range(2))
    return v, p


def every_operation() -> tuple[Any, Any, Any]:
    """All of them in one function, at all pairs of special numbers and at random ones."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    f = function(ca.vertcat(*(g(x) for g in UNARY), *(g(x, y) for g in BINARY)), x, y)
    rng = np.random.default_rng(3)
    drawn = rng.standard_normal((2, 3000)) * 10.0 ** rng.integers(-5, 5, (2, 3000))
    x_values, y_values = np.concatenate([drawn, np.array([*product(SPECIAL, SPECIAL)]).T], axis=1)
    return f, x_values[None], y_values[None]


def assert_same_bits(found: Any, wanted: Any) -> None:
    """Equal, signs of zeros included; NaN has no sign."""
    np.testing.assert_array_equal(found, wanted)
    number = ~np.isnan(wanted)
    np.testing.assert_array_equal(np.signbit(found)[number], np.signbit(wanted)[number])


def test_the_table_has_every_operation() -> None:
    f, _, _ = every_operation()
    used = {operation.name for operation, _ in listing_of(f).operations.values()}
    assert used == {name for name in OPERATIONS if hasattr(ca, f"OP_{name}")}


def test_every_operation_to_the_bit() -> None:
    f, x, y = every_operation()
    assert_same_bits(exactly(f, x, y), by_casadi(f, x, y))


@pytest.mark.parametrize("count", [0, 1, 2, 7, 8, 9, 15, 16, 23, 24, 25, 31, 47, 100])
def test_any_number_of_columns(count: int) -> None:
    f, x, y = every_operation()
    x, y = (np.ascontiguousarray(values[:, 3100 : 3100 + count]) for values in (x, y))
    assert_same_bits(exactly(f, x, y), by_casadi(f, x, y))


@compiles
@pytest.mark.parametrize("by", ["fused", "straight"])
def test_every_operation_with_leave_to_round(by: str, request: pytest.FixtureRequest) -> None:
    f, x, y = every_operation()
    found, wanted = request.getfixturevalue(by)(f, x, y), by_casadi(f, x, y)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(wanted))
    signed = ((x != 0.0) & (y != 0.0))[0]  # without a sign of zero, 1 / -0 is infinity
    np.testing.assert_allclose(found[:, signed], wanted[:, signed], rtol=1e-14, atol=0)


leaves = st.one_of(st.integers(0, 3), st.floats(-3, 3).map(float))
trees = st.recursive(
    leaves,
    lambda deeper: st.one_of(
        st.tuples(st.sampled_from(UNARY), deeper),
        st.tuples(st.sampled_from([*BINARY[:4] * 3, *BINARY]), deeper, deeper),
    ),
    max_leaves=12,
)


def grown(tree: Any, symbols: Any) -> Any:
    if isinstance(tree, tuple):
        return tree[0](*(grown(branch, symbols) for branch in tree[1:]))
    return symbols[tree] if isinstance(tree, int) else ca.SX(tree)


def expressions(drawn: list[Any]) -> tuple[Any, Any, Any]:
    v, p = ca.SX.sym("v", 2), ca.SX.sym("p", 2)
    rows = [grown(tree, ca.vertsplit(v) + ca.vertsplit(p)) for tree in drawn]
    numbers = np.random.default_rng(0).uniform(-3.0, 3.0, (2, 2, 27))
    return function(ca.vertcat(*rows), v, p), *numbers


@settings(max_examples=60, derandomize=True, deadline=None)
@given(st.lists(trees, min_size=10, max_size=30))
def test_random_expressions_to_the_bit(drawn: list[Any]) -> None:
    f, v, p = expressions(drawn)
    assert_same_bits(exactly(f, v, p), by_casadi(f, v, p))


@compiles
@settings(
    max_examples=25, derandomize=True, deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)  # fmt: skip
@given(st.lists(trees, min_size=10, max_size=30))
def test_random_expressions_with_joined_operations(fused: Evaluate, drawn: list[Any]) -> None:
    f, v, p = expressions(drawn)
    found, wanted = fused(f, v, p), by_casadi(f, v, p)
    # a rounded argument may be on the other side of a step, such as a floor
    smooth = np.isclose(by_casadi(f, v * (1 + 1e-13), p * (1 - 1e-13)), wanted, rtol=1e-9, atol=0)
    np.testing.assert_allclose(found[smooth], wanted[smooth], rtol=1e-8, atol=1e-300)


JOINED: dict[str, Callable[..., Any]] = {
    "MULADD": lambda a, b, c, d: a * b + c,
    "MULSUB": lambda a, b, c, d: a * b - c,
    "NEGMULADD": lambda a, b, c, d: c - a * b,
    "MULADDMUL": lambda a, b, c, d: a * b + c * d,
    "NEGMULADDMUL": lambda a, b, c, d: a * b - c * d,
    "ADDADD": lambda a, b, c, d: c + (a + b),
    "MULMUL": lambda a, b, c, d: c * (a * b),
    "MULTWICE": lambda a, b, c, d: b * (a + a),
    "ADDMUL": lambda a, b, c, d: c * (a + b),
    "SUBMUL": lambda a, b, c, d: (a - b) * c,
    "MULDIV": lambda a, b, c, d: a * b / c,
    "DIVMUL": lambda a, b, c, d: c * (a / b),
    "SINCOS": lambda a, b, c, d: ca.cos(a) + ca.sin(a),
}


def codes(program: Program) -> set[int]:
    constants, reads, steps = program.words[3:6]
    start = 8 + constants + 2 * reads
    return set(program.words[start : start + 3 * steps].view(np.int32)[::6].tolist())


@compiles
def test_operations_are_joined(fused: Evaluate) -> None:
    fewer = {name for name in OPERATIONS if not hasattr(ca, f"OP_{name}")}
    assert set(JOINED) == fewer
    v, p = ca.SX.sym("v", 3), ca.SX.sym("p", 1)
    for name, expression in JOINED.items():
        f = function(expression(*ca.vertsplit(v), p), v, p)
        names = {list(OPERATIONS)[code] for code in codes(Program.of(f, fused=True))}
        assert names & fewer == {name}
        np.testing.assert_allclose(fused(f, *draw(f)), by_casadi(f, *draw(f)), rtol=1e-14)
        assert not codes(Program.of(f)) & {OPERATIONS[each].code for each in fewer}


@compiles
def test_what_is_used_twice_is_not_joined(fused: Evaluate) -> None:
    v, p = ca.SX.sym("v", 2), ca.SX.sym("p", 1)
    product_of = v[0] * v[1]
    for rows in ([product_of + p, product_of], [product_of + p, product_of - p],
                 [(v[0] - v[1]) ** 2], [(v[0] * v[1]) ** 2 + p]):  # fmt: skip
        f = function(ca.vertcat(*rows), v, p)
        np.testing.assert_allclose(fused(f, *draw(f)), by_casadi(f, *draw(f)), rtol=1e-14)


@pytest.mark.parametrize("name", ROBOTS)
def test_motion_with_both_derivatives(name: str) -> None:
    robot = registry.load("robots", name)()
    n, m = len(robot.states), len(robot.inputs)
    v, p = ca.SX.sym("v", n + m), ca.SX.sym("p", n)
    parts = ca.vertsplit(v)
    following = ca.vertcat(*runge_kutta(robot.derivative, parts[:n], parts[n:], 0.5))
    hessian = ca.hessian(ca.dot(p, following), v)[0]
    pieces = [following, ca.vec(ca.jacobian(following, v)), ca.vec(ca.tril(hessian))]
    f = function(ca.sparsify(ca.vertcat(*pieces)), v, p)
    assert_same_bits(exactly(f, *draw(f)), by_casadi(f, *draw(f)))


def constraint(name: str) -> Any:
    """A region's constraint with both derivatives."""
    region = registry.load("regions", name)()
    count = region.parameter_count(2)
    v, p = ca.SX.sym("v", 3 + len(region.auxiliary(2))), ca.SX.sym("p", count + 1)
    parts = region.constraint(Pose((v[0], v[1]), v[2]), p[:count], p[count], v[3:])
    rows = [*parts.inequalities, *parts.equalities]
    return function(ca.vertcat(*(derivatives(ca.SX(row), v) for row in rows)), v, p)


def derivatives(row: Any, v: Any) -> Any:
    hessian, gradient = ca.hessian(row, v)
    return ca.vertcat(row, ca.densify(gradient), ca.densify(ca.vec(hessian)))


@pytest.mark.parametrize("name", REGIONS)
def test_constraint_with_both_derivatives(name: str) -> None:
    f = constraint(name)
    assert_same_bits(exactly(f, *draw(f)), by_casadi(f, *draw(f)))


@compiles
@pytest.mark.parametrize("name", ["mahalanobis_ellipse", "minkowski_sum", "whitened_box"])
@pytest.mark.parametrize("by", ["fused", "straight"])
def test_constraint_with_leave_to_round(
    by: str, name: str, request: pytest.FixtureRequest
) -> None:
    f = constraint(name)
    found = request.getfixturevalue(by)(f, *draw(f))
    np.testing.assert_allclose(found, by_casadi(f, *draw(f)), rtol=1e-11, atol=1e-11)


@compiles
def test_straight_line_code_at_any_number_of_columns(straight: Evaluate) -> None:
    v, p = ca.SX.sym("v", 2), ca.SX.sym("p", 1)
    angle = ca.sin(v[0]) + v[1]
    f = function(ca.vertcat(ca.cos(angle) * v[0], angle, p, 2.0, -1.5 * v[1], v[0]), v, p)
    for count in (0, 1, 7, 24, 25, 50):
        numbers = draw(f, count)
        found, wanted = straight(f, *numbers), by_casadi(f, *numbers)
        np.testing.assert_allclose(found, wanted, rtol=1e-14)


def test_rows_are_the_nonzeros_column_by_column() -> None:
    v, p = ca.SX.sym("v", 2), ca.SX.sym("p", 0)
    full = ca.blockcat([[v[0], 0, v[1]], [ca.SX(1, 1), v[0] * v[1], 3]])
    f = function(ca.sparsify(full), v, p)
    values = exactly(f, np.array([[2.0], [5.0]]), np.zeros((0, 1)))[:, 0]
    rows, columns = f.sparsity_out(0).get_triplet()
    dense = np.zeros((2, 3))
    dense[rows, columns] = values
    np.testing.assert_array_equal(dense, [[2, 0, 5], [0, 10, 3]])


@compiles
def test_constants_are_exact(straight: Evaluate) -> None:
    numbers = [0.1, 1 / 3, np.pi, 1e-320, 1.7976931348623157e308, np.inf, -np.inf, np.nan, -2.0]
    v = ca.SX.sym("v", 0)
    f = function(ca.vertcat(*numbers), v, v)
    none = np.zeros((0, 4))
    for evaluate in (exactly, straight):
        np.testing.assert_array_equal(evaluate(f, none, none), np.tile(numbers, (4, 1)).T)


def test_the_same_is_computed_once() -> None:
    v, p = ca.SX.sym("v", 2), ca.SX.sym("p", 1)
    again = [ca.sin(v[0] * p[0]) + v[1], v[1] + ca.sin(p[0] * v[0])]
    listing = listing_of(function(ca.vertcat(*again), v, p))
    assert [each.name for each, _ in listing.operations.values()] == ["MUL", "SIN", "ADD"]


def test_registers_are_used_again() -> None:
    v, p = ca.SX.sym("v", 1), ca.SX.sym("p", 1)
    value = reduce(lambda x, _: ca.sin(x) * p, range(100), v)
    registers = int(Program.of(function(value, v, p)).words[6])
    assert registers == 3  # v, p, and what is computed


def test_matrix_functions_are_expanded() -> None:
    inner = ca.Function("inner", [a := ca.SX.sym("a", 2)], [ca.sin(a)])
    v, p = ca.MX.sym("v", 2), ca.MX.sym("p", 2)
    f = function(reduce(lambda x, _: inner(x) * p, range(3), v), v, p)
    assert_same_bits(exactly(f, *draw(f)), by_casadi(f, *draw(f)))


def test_what_cannot_be_written_is_named() -> None:
    v, p = ca.SX.sym("v", 2), ca.SX.sym("p", 1)
    with pytest.raises(WideberthError, match="OP_ERFINV"):
        Program.of(function(ca.erfinv(v), v, p))
    inner = ca.Function("inner", [v], [ca.sin(v)], {"never_inline": True})
    with pytest.raises(WideberthError, match="OP_CALL"):
        Program.of(function(inner(v), v, p))
    with pytest.raises(WideberthError, match="1 arguments"):
        Program.of(function(v, v))
    with pytest.raises(WideberthError, match=r"depends on \['p'\]"):
        Program.of(ca.Function("f", [v, v[:0]], [v * p], {"allow_free": True}))
    with pytest.raises(WideberthError, match="argument p"):
        Program.of(function(v, v, ca.SX.sym("p", 2, 2)))


def test_another_layout_of_programs_is_refused() -> None:
    v, p = ca.SX.sym("v", 1), ca.SX.sym("p", 1)
    program = Program.of(function(v + p, v, p))
    program.words[0] += 1
    with pytest.raises(ValueError, match="version"):
        _evaluator.evaluate(program.address, 0, 0, 0, 0, 0, 0, 0, 0)
