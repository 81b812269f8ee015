"""CasADi functions written for LLVM mean the same."""

import ctypes
from collections.abc import Callable
from functools import reduce
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wideberth.framework.jit import (
    kernel_source,
    machine,
    module_source,
    recursion_source,
)
from wideberth.framework.jit.operations import FAST
from wideberth.framework.numerics.integration import runge_kutta
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.plugins import registry
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Pose
from wideberth.regions import BUILT_IN as REGIONS
from wideberth.robots import BUILT_IN as ROBOTS

SPECIAL = [
    -np.inf,
    -1e300,
    -2.5,
    -1.0,
    -0.4,
    -0.0,
    0.0,
    5e-324,
    0.4,
    1.0,
    1.5,
    2.5,
    np.inf,
    np.nan,
]
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


def load(source: str, name: str) -> int:
    """Compile a function and return its address."""
    return machine.loaded(machine.object_code(source, machine.host()), [name])[name]


def function(rows: Any, *arguments: Any) -> Any:
    """A function of v and p."""
    return ca.Function("f", list(arguments), [rows])


def wanted(f: Any, v: Any, p: Any) -> Any:
    """CasADi's own results, one column after the other."""
    pairs = zip(v.T, p.T, strict=True)
    return np.array([f(*pair).nonzeros() for pair in pairs]).T.reshape(-1, v.shape[1])


def by_llvm(f: Any, v: Any, p: Any, fast: str = FAST, offset: int = 2) -> Any:
    source = module_source([kernel_source(f, "kernel")]).replace(FAST, fast)
    place = load(source, "kernel")
    shifted = np.concatenate([np.full((len(v), offset), np.nan), v], axis=1)
    out = np.full((f.nnz_out(0), v.shape[1] + 1), 7.0)
    run(place, offset, v.shape[1], shifted, np.ascontiguousarray(p), out)
    assert (out[:, -1] == 7.0).all(), "wrote beyond its columns"
    return out[:, :-1]


def by_llvm_as_it_stands(f: Any, v: Any, p: Any) -> Any:
    """The same text, which takes minutes to optimise for a large function."""
    text = module_source([kernel_source(f, "kernel")])
    code = machine.object_code(text, machine.host(), optimise=False)
    out = np.full((f.nnz_out(0), v.shape[1]), np.nan)
    run(machine.loaded(code, ["kernel"])["kernel"], 0, v.shape[1], v, p, out)
    return out


def run(place: int, offset: int, count: int, *arrays: Any) -> None:
    """Call a compiled kernel by its address, see `columns.SIGNATURE`."""
    run_record(np.array([place]), offset, count, *arrays)


def run_record(record: Any, offset: int, count: int, *arrays: Any) -> None:
    """Call a kernel as the core does."""
    words = [word for one in arrays for word in (one.ctypes.data, one.strides[0])]
    call = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 9)(int(record[0]))
    call(record.ctypes.data, offset, count, *words)


def draw(f: Any, count: int = 13) -> tuple[Any, Any]:
    rng = np.random.default_rng(1)
    return tuple(rng.uniform(0.2, 0.9, (f.nnz_in(i), count)) for i in range(2))  # type: ignore[return-value]


def every_operation() -> tuple[Any, Any, Any]:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    f = function(ca.vertcat(*(g(x) for g in UNARY), *(g(x, y) for g in BINARY)), x, y)
    x_grid, y_grid = np.array(list(product(SPECIAL, SPECIAL))).T
    return f, x_grid[None], y_grid[None]


def test_every_operation_at_every_special_number() -> None:
    f, x, y = every_operation()
    np.testing.assert_allclose(by_llvm(f, x, y, ""), wanted(f, x, y), rtol=1e-14, atol=0)
    found, expected = by_llvm(f, x, y), wanted(f, x, y)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    signs = UNARY.index(ca.sign)
    np.testing.assert_array_equal(np.signbit(found[signs]), np.signbit(expected[signs]))
    signed = (x != 0.0) & (y != 0.0)  # without a sign of zero, 1 / -0 is infinity
    np.testing.assert_allclose(found[:, signed[0]], expected[:, signed[0]], rtol=1e-14, atol=0)


leaves = st.one_of(st.integers(0, 3), st.floats(-3, 3).map(float))
trees = st.recursive(
    leaves,
    lambda deeper: st.one_of(
        st.tuples(st.sampled_from(UNARY), deeper),
        st.tuples(st.sampled_from(BINARY), deeper, deeper),
    ),
    max_leaves=12,
)


def grown(tree: Any, symbols: Any) -> Any:
    if isinstance(tree, tuple):
        return tree[0](*(grown(branch, symbols) for branch in tree[1:]))
    return symbols[tree] if isinstance(tree, int) else ca.SX(tree)


@settings(
    max_examples=6, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
@given(st.lists(trees, min_size=10, max_size=20))
def test_random_expressions(drawn: list[Any]) -> None:
    v, p = ca.SX.sym("v", 2), ca.SX.sym("p", 2)
    f = function(
        ca.vertcat(*(grown(tree, ca.vertsplit(v) + ca.vertsplit(p)) for tree in drawn)), v, p
    )
    numbers = np.random.default_rng(0).uniform(-3.0, 3.0, (2, 2, 25))
    np.testing.assert_allclose(by_llvm(f, *numbers), wanted(f, *numbers), rtol=1e-12, atol=0)


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
    agree(f, *draw(f))


@pytest.mark.parametrize("name", REGIONS)
def test_constraint_with_both_derivatives(name: str) -> None:
    region = registry.load("regions", name)()
    count = region.parameter_count(2)
    v, p = ca.SX.sym("v", 3 + len(region.auxiliary(2))), ca.SX.sym("p", count + 1)
    pose = Pose((v[0], v[1]), v[2])
    parts = region.constraint(pose, p[:count], p[count], v[3:])
    rows = [*parts.inequalities, *parts.equalities]
    large = name in {"risk_contour", "whitened_box"}  # 44 000 and 3 000 operations
    made = [derivatives(ca.SX(row), v)[: 1 + v.numel() if large else None] for row in rows]
    f = function(ca.vertcat(*made), v, p)
    agree(f, *draw(f), by_llvm_as_it_stands if large else by_llvm)


def derivatives(row: Any, v: Any) -> Any:
    hessian, gradient = ca.hessian(row, v)
    return ca.vertcat(row, ca.densify(gradient), ca.densify(ca.vec(hessian)))


def agree(f: Any, v: Any, p: Any, by: Callable[..., Any] = by_llvm) -> None:
    np.testing.assert_allclose(by(f, v, p), wanted(f, v, p), rtol=1e-12, atol=1e-12)


def test_a_recursion_hands_results_to_the_column_before() -> None:
    v, p = ca.SX.sym("v", 3), ca.SX.sym("p", 1)
    # the second result is what the first variable was: they are handed on at once
    f = function(ca.vertcat(v[1] * p + ca.sin(v[2]), v[0], v[0] * v[1], 2.0), v, p)
    place = load(module_source([recursion_source(f, "kernel", 2)]), "kernel")
    given, parameters = np.random.default_rng(3).uniform(size=(2, 1, 6))
    for record in [np.array([place])]:
        out = np.full((4, 5), 0.3)
        run_record(record, 1, 4, given, parameters, out)
        for c in range(3, -1, -1):
            found = f(np.array([*out[:2, c + 1], given[0, 1 + c]]), parameters[:, c]).nonzeros()
            np.testing.assert_allclose(out[:, c], found, rtol=1e-14)
        assert (out[:, 4] == 0.3).all()


def test_rows_are_the_nonzeros_column_by_column() -> None:
    v, p = ca.SX.sym("v", 2), ca.SX.sym("p", 0)
    full = ca.blockcat([[v[0], 0, v[1]], [ca.SX(1, 1), v[0] * v[1], 3]])
    f = function(ca.sparsify(full), v, p)
    values = by_llvm(f, np.array([[2.0], [5.0]]), np.zeros((0, 1)))[:, 0]
    rows, columns = f.sparsity_out(0).get_triplet()
    dense = np.zeros((2, 3))
    dense[rows, columns] = values
    np.testing.assert_array_equal(dense, [[2, 0, 5], [0, 10, 3]])


def test_constants_are_exact() -> None:
    numbers = [0.1, 1 / 3, np.pi, 1e-320, 1.7976931348623157e308, np.inf, -np.inf, np.nan]
    v = ca.SX.sym("v", 0)
    f = function(ca.vertcat(*numbers), v, v)
    none = np.zeros((0, 4))
    np.testing.assert_array_equal(by_llvm(f, none, none), np.tile(numbers, (4, 1)).T)


def test_the_same_is_computed_once() -> None:
    v, p = ca.SX.sym("v", 2), ca.SX.sym("p", 1)
    again = [ca.sin(v[0] * p[0]) + v[1], v[1] + ca.sin(p[0] * v[0])]
    source = kernel_source(function(ca.vertcat(*again), v, p), "kernel")
    assert source.count("@llvm.sin.f64") == 1


def test_matrix_functions_are_expanded() -> None:
    inner = ca.Function("inner", [a := ca.SX.sym("a", 2)], [ca.sin(a)])
    v, p = ca.MX.sym("v", 2), ca.MX.sym("p", 2)
    f = function(reduce(lambda x, _: inner(x) * p, range(3), v), v, p)
    agree(f, *draw(f))


def test_what_cannot_be_written_is_named() -> None:
    v, p = ca.SX.sym("v", 2), ca.SX.sym("p", 1)
    with pytest.raises(WideberthError, match="OP_ERFINV"):
        kernel_source(function(ca.erfinv(v), v, p), "kernel")
    inner = ca.Function("inner", [v], [ca.sin(v)], {"never_inline": True})
    with pytest.raises(WideberthError, match="OP_CALL"):
        kernel_source(function(inner(v), v, p), "kernel")
    with pytest.raises(WideberthError, match="1 arguments"):
        kernel_source(function(v, v), "kernel")
    with pytest.raises(WideberthError, match=r"depends on \['p'\]"):
        kernel_source(ca.Function("f", [v, v[:0]], [v * p], {"allow_free": True}), "kernel")
    with pytest.raises(WideberthError, match="argument p"):
        kernel_source(function(v, v, ca.SX.sym("p", 2, 2)), "kernel")
