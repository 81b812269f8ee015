"""The recursion over the horizon in the structured solver against dense linear algebra."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.values.arrays import Array
from wideberth.solvers.riccati import _core as core
from wideberth.solvers.riccati import _protocol as protocol
from wideberth.solvers.riccati.kernels import carried, sweep
from wideberth.tests.helpers.interpreted import Kernel, interpret, recursion

RECURSION = [(4, 2, 5, 1), (5, 2, 3, 0), (6, 3, 4, 1), (2, 2, 1, 1), (5, 1, 6, 1)]
"""n, m, N, whether a level is shared."""


@pytest.fixture(autouse=True)
def interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is compiled here, which would take longer than the tests."""
    interpret(monkeypatch, core)


@dataclass(frozen=True)
class Linear:
    """A quadratic over linear dynamics, its recursion, and the same problem dense."""

    size: Any
    state: Array
    path: Any
    step: Any
    model: Any
    quadratic: Any
    gains: Any
    kernel: Kernel

    @classmethod
    def drawn(
        cls, n: int, m: int, steps: int, shared: int, rng: np.random.Generator, convex: float
    ) -> "Linear":
        size = core.size_of(protocol.Sizes(n, m, shared, 0, 0, 0), steps)
        block = core.make_block(size, 1)
        limits = np.array([[-np.inf] * (n + m), [np.inf] * (n + m)])
        path, step, block = core.make_path(size, limits, block)
        model, _, block = core.make_model(size, block)
        quadratic, gains, _ = core.make_newton(size, np.arange(n), block)
        rows = slice(size.jacobian, size.jacobian + n * size.w)
        model.drive[rows] = rng.normal(scale=0.7, size=(n * size.w, size.wide))
        model.drive[size.jacobian] = 1.0  # which the recursion is told
        model.gap[:] = rng.normal(size=model.gap.shape)
        path.v[:] = rng.normal(size=path.v.shape)
        for i in range(steps + 1):
            root = rng.normal(size=(size.w, size.w))
            quadratic.hessian[:, i] = (0.5 * (root + root.T) + convex * np.eye(size.w)).ravel()
        quadratic.gradient[:] = rng.normal(size=quadratic.gradient.shape)
        quadratic.cross[:] = shared * rng.normal(size=quadratic.cross.shape)
        quadratic.top[:] = convex * shared, rng.normal()
        results = ca.SX.sym("results", size.value)
        told = ca.vertcat(results[: size.jacobian], 1.0, results[size.jacobian + 1 :])
        drive = ca.Function("drive", [results, ca.SX.sym("p", 0)], [told])
        kernel = recursion(sweep(n, m, drive), carried(n))
        return cls(size, np.zeros(core.SCALARS), path, step, model, quadratic, gains, kernel)

    def dense(self) -> tuple[Array, Array, Array, Array]:
        """Hessian and gradient in (dw_0, .., dw_N, ds); rows and right-hand side, dx_0 = 0."""
        size, given = self.size, self.quadratic
        n, w, steps = size.n, size.w, size.steps
        total = (steps + 1) * w + 1
        hessian, gradient = np.zeros((total, total)), np.zeros(total)
        for i in range(steps + 1):
            used = w if i < steps else n
            at = slice(i * w, i * w + used)
            stage = given.hessian[:, i].reshape(w, w)[:used, :used]
            hessian[at, at] = stage + self.delta * np.eye(used)
            gradient[at] = given.gradient[:used, i]
            hessian[i * w : i * w + n, -1] = hessian[-1, i * w : i * w + n] = given.cross[:, i]
        hessian[-1, -1], gradient[-1] = given.top[0] + self.delta, given.top[1]
        rows, right = np.zeros(((steps + 1) * n, total)), np.zeros((steps + 1) * n)
        rows[:n, :n] = np.eye(n)
        for i in range(steps):
            at = slice((i + 1) * n, (i + 2) * n)
            slopes = self.model.drive[size.jacobian : size.jacobian + n * w, i].reshape(n, w)
            rows[at, i * w : (i + 1) * w] = slopes
            rows[at, (i + 1) * w : (i + 1) * w + n] = -np.eye(n)
            right[at] = -self.model.gap[:, i]
        kept = [k for k in range(total - 1) if k < steps * w + n] + [total - 1] * size.shared
        return hessian[np.ix_(kept, kept)], gradient[kept], rows[:, kept], right

    @property
    def delta(self) -> float:
        return float(self.state[core.DELTA])

    def backward(self) -> bool:
        given = self.size, self.model, self.quadratic, self.gains, self.state
        return bool(core.backward(*given, self.kernel))


@pytest.mark.parametrize("delta", [0.0, 0.3])
@pytest.mark.parametrize("shape", RECURSION, ids=str)
def test_the_recursion_solves_the_dense_system(
    shape: tuple[int, int, int, int], delta: float
) -> None:
    made = Linear.drawn(*shape, np.random.default_rng(sum(shape)), 12.0)
    made.state[core.DELTA] = delta
    assert made.backward()
    ds = made.state[core.DS]
    core.forward(made.size, made.path, made.step, made.model, made.gains, ds)
    hessian, gradient, rows, right = made.dense()
    none = np.zeros((len(rows), len(rows)))
    matrix = np.block([[hessian, rows.T], [rows, none]])
    solved = np.linalg.solve(matrix, np.concatenate([-gradient, right]))
    n, w, steps = made.size.n, made.size.w, made.size.steps
    flat = made.step.v[:, : steps + 1].T.ravel()[: steps * w + n]
    np.testing.assert_allclose(flat, solved[: steps * w + n], atol=1e-9)
    if made.size.shared:
        assert ds == pytest.approx(solved[len(hessian) - 1], abs=1e-9)
    multipliers = solved[len(hessian) + n :].reshape(steps, n).T
    np.testing.assert_allclose(
        (made.step.pi + made.path.v[w : w + n])[:, :steps], multipliers, atol=1e-8
    )


@pytest.mark.parametrize("shape", RECURSION, ids=str)
def test_the_recursion_refuses_exactly_the_wrong_curvatures(
    shape: tuple[int, int, int, int],
) -> None:
    rng, told, known = np.random.default_rng(1), [], []
    for convex in np.linspace(0.0, 6.0, 25):
        made = Linear.drawn(*shape, rng, float(convex))
        told.append(made.backward())
        hessian, _, rows, _ = made.dense()
        free = np.linalg.svd(rows)[2][len(rows) :]
        known.append(bool(np.linalg.eigvalsh(free @ hessian @ free.T).min() > 0.0))
    assert told == known
    assert True in told and False in told
