"""Functions of many columns: by the evaluator, and by CasADi where it was not built."""

import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.programs import ColumnFunctions, evaluate

V, P = ca.SX.sym("v", 3), ca.SX.sym("p", 2)
ROWS = ca.vertcat(ca.sin(V[0]) * P[0] + V[1] / P[1], ca.exp(V[2]), V[0] - 2.0, 7.0)
FUNCTIONS = {
    "both": ca.Function("both", [V, P], [ROWS]),
    "bare": ca.Function("bare", [V, P[:0]], [V[0] * V[1] + ca.sqrt(V[2])]),
    "sparse": ca.Function("sparse", [V, P], [ca.sparsify(ca.vertcat(V[0], 0, P[1] * V[2]))]),
    "none": ca.Function("none", [V, P], [ca.SX(0, 1)]),
    "lacking": ca.Function("lacking", [V, P], [ca.vertcat(ca.erfinv(V[0] / 9.0), P[0])]),
}
EXACT = [name for name in FUNCTIONS if name != "lacking"]


def numbers(times: int, count: int, seed: int = 0) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0.1, 2.0, (3, times, count)), rng.uniform(0.1, 2.0, (2, count))


def wanted(name: str, v: Any, p: Any) -> Any:
    """CasADi's results, one column after the other."""
    f = FUNCTIONS[name]
    _, times, count = v.shape
    out = np.empty((f.nnz_out(0), times, count))
    for s in range(times):
        for c in range(count):
            out[:, s, c] = f(v[:, s, c], p[: f.nnz_in(1), c]).nonzeros()
    return out


@pytest.mark.parametrize("built", [True, False])
@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (2, 24), (1, 100), (2, 0), (0, 4)], ids=str)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_numbers_are_those_of_casadi(
    name: str, shape: tuple[int, int], built: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not built:
        monkeypatch.setattr(evaluate, "_evaluator", None)
    elif evaluate._evaluator is None:
        pytest.skip("the evaluator was not built")
    v, p = numbers(*shape)
    found = ColumnFunctions(FUNCTIONS)(name, v, np.zeros((0, 0)) if name == "bare" else p)
    np.testing.assert_array_equal(found, wanted(name, v, p))


def test_programs_are_used_where_the_evaluator_was_built() -> None:
    if evaluate._evaluator is None:
        pytest.skip("the evaluator was not built")
    programs = ColumnFunctions(FUNCTIONS)._programs
    assert [name for name, program in programs.items() if program is not None] == EXACT


def test_without_the_module_casadi_evaluates() -> None:
    """In a process that cannot import it."""
    script = (
        "import sys; sys.modules['wideberth.framework.programs._evaluator'] = None\n"
        "import numpy as np\n"
        "from wideberth.framework.numerics.symbolic import ca\n"
        "from wideberth.framework.programs import ColumnFunctions\n"
        "v, p = ca.SX.sym('v', 2), ca.SX.sym('p', 1)\n"
        "functions = ColumnFunctions({'f': ca.Function('f', [v, p], [v[0] * v[1] + p])})\n"
        "assert functions._programs == {'f': None}\n"
        "print(functions('f', np.full((2, 1, 3), 2.0), np.ones((1, 3))).ravel().tolist())\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout == "[5.0, 5.0, 5.0]\n", done.stderr


def test_other_processes_make_their_own_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    v, p = numbers(2, 9)
    functions = ColumnFunctions(FUNCTIONS)
    packed, expected = pickle.dumps(functions), functions("both", v, p)
    monkeypatch.setattr(evaluate, "_evaluator", None)
    again = pickle.loads(packed)
    assert set(again._programs.values()) == {None}
    np.testing.assert_array_equal(again("both", v, p), expected)


def test_threads_do_not_disturb_each_other() -> None:
    functions = ColumnFunctions(FUNCTIONS)
    inputs = [numbers(2, 5 + seed, seed) for seed in range(40)]
    expected = [functions("both", *pair) for pair in inputs]
    with ThreadPoolExecutor(8) as pool:
        for _ in range(10):
            found = list(pool.map(lambda pair: functions("both", *pair), inputs))
            for one, other in zip(found, expected, strict=True):
                np.testing.assert_array_equal(one, other)
