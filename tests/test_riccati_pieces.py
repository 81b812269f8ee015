"""Parts of the structured solver against dense linear algebra.

The compiled functions run as plain Python here, which needs no compilation, and their kernels as
CasADi functions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.arrays import Array
from wideberth.framework.mpc.solvers.structured import condense, memory, riccati, slack, slots
from wideberth.framework.mpc.solvers.structured.elimination import Slot, eliminate, expand
from wideberth.framework.mpc.solvers.structured.sweep import carried, sweep
from wideberth.framework.symbolic import ca

RECURSION = [(4, 2, 5, 1), (5, 2, 3, 0), (6, 3, 4, 1), (2, 2, 1, 1), (5, 1, 6, 1)]
"""n, m, N, whether a level is shared."""
Kernel = Callable[[int, int, Array, Array, Array], None]
SEEN, OWN, UNEQUAL, EQUAL, ACTIVE = (0, 2), 3, 2, 1, 2
"""Of the slots below: entries of x, own variables, inequalities, equalities; slots in use."""


@pytest.fixture(autouse=True)
def interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every compiled function of these modules be the Python function it was made from."""
    for module in (condense, memory, riccati, slack, slots):
        _interpret(module, monkeypatch)
    for caller in (condense, riccati):
        monkeypatch.setattr(caller, "call", lambda kernel, *given: kernel(*given))


def _interpret(module: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in list(vars(module).items()):
        if hasattr(value, "py_func"):
            monkeypatch.setattr(module, name, value.py_func)


def columns(function: Any) -> Kernel:
    """What a CasADi function is compiled to by `numba_source`."""

    def kernel(offset: int, count: int, v: Array, p: Array, out: Array) -> None:
        for c in range(count):
            found = function(v[: function.numel_in(0), offset + c], p[: function.numel_in(1), c])
            out[:, c] = np.asarray(found).ravel()

    return kernel


def recursion(function: Any, handed: int) -> Kernel:
    """What it is compiled to by `recursion_source`."""

    def kernel(offset: int, count: int, v: Array, p: Array, out: Array) -> None:
        for c in range(count - 1, -1, -1):
            found = function(np.concatenate([out[:handed, c + 1], v[:, offset + c]]), p[:, c])
            out[:, c] = np.asarray(found).ravel()

    return kernel


# the recursion over the horizon


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
        size = memory.size_of(n, m, shared, steps, 0, 0, 0)
        block = memory.make_block(size, 1)
        limits = np.array([[-np.inf] * (n + m), [np.inf] * (n + m)])
        path, step, block = memory.make_path(size, limits, block)
        model, _, block = memory.make_model(size, block)
        quadratic, gains, _ = memory.make_newton(size, np.arange(n), block)
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
        return cls(size, np.zeros(13), path, step, model, quadratic, gains, kernel)

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
        return float(self.state[memory.DELTA])

    def backward(self) -> bool:
        given = self.size, self.model, self.quadratic, self.gains, self.state
        return bool(riccati.backward(*given, self.kernel))


@pytest.mark.parametrize("delta", [0.0, 0.3])
@pytest.mark.parametrize("shape", RECURSION, ids=str)
def test_the_recursion_solves_the_dense_system(
    shape: tuple[int, int, int, int], delta: float
) -> None:
    made = Linear.drawn(*shape, np.random.default_rng(sum(shape)), 12.0)
    made.state[memory.DELTA] = delta
    assert made.backward()
    ds = made.state[memory.DS]
    riccati.forward(made.size, made.path, made.step, made.model, made.gains, ds)
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


# what the slots contribute


@dataclass(frozen=True)
class Crowd:
    """Slots of one kind with random numbers, over N stages, and the slacks of the regions."""

    size: Any
    slots: Any
    hessian: Array
    slack: Any
    quadratic: Any
    eliminate: Kernel
    expand: Kernel
    mu: float
    rho: float
    delta: float

    @classmethod
    def drawn(cls, own: int, equal: int, shared: int, curved: float = 8.0) -> "Crowd":
        n, steps, rng = 4, 3, np.random.default_rng(10 * own + shared)
        size = memory.size_of(n, 2, shared, steps, 0, 0, 0)
        active = np.array([1.0, 0.0, 1.0])
        lower, upper = np.full(own, -np.inf), np.full(own, np.inf)
        lower[:2], upper[1:2] = -1.5, 2.0
        kind = (
            np.array(SEEN), np.array([UNEQUAL, equal, 1]), np.array([lower, upper]),
            np.array([0.4]), rng.normal(size=(steps, 3, 2)), np.ones((steps, 3)), active,
            *rng.uniform(-1.0, 1.0, (2, steps, 3, own)),
        )  # fmt: skip
        made = slots.make_slots(size, kind, 0.5, 1e-2)
        assert len(made.active) == ACTIVE
        first = len(SEEN) + shared
        wide, slot = first + own, Slot(first, tuple(lower), tuple(upper), UNEQUAL, equal)
        last = len(made.out) - len(made.condensed)
        hessian = made.out[last - wide**2 : last].reshape(wide, wide, -1)
        for values in (made.value, made.slope, hessian):
            values[:] = rng.normal(size=values.shape)
        hessian[:] = hessian + hessian.swapaxes(0, 1)
        hessian[:] += curved * np.eye(wide)[..., None]
        multipliers = made.v[wide : wide + UNEQUAL + equal]
        multipliers[:] = rng.uniform(0.2, 2.0, multipliers.shape)
        for values in (made.t, made.zl, made.zu):
            values[:] = rng.uniform(0.2, 2.0, values.shape)
        made.zl[lower == -np.inf], made.zu[upper == np.inf] = 0.0, 0.0
        block = memory.make_block(size, 1)
        slacks, _ = memory.make_slack(rng.uniform(0.2, 2.0, block.shape))
        quadratic, _, _ = memory.make_newton(size, np.array(SEEN), block)
        kernels = columns(eliminate(slot)), columns(expand(slot))
        return cls(size, made, hessian, slacks, quadratic, *kernels, 0.05, 3.0, 0.2)

    def condense(self) -> bool:
        given = self.size, self.slots, self.quadratic, self.slack.eps, self.mu, self.delta
        return bool(condense.condense(*given, self.eliminate))

    def newton(self, i: int, dx: Array, ds: float) -> SimpleNamespace:
        """Dense Newton step of all that belongs to stage i, and its force on (x, s).

        Unknowns: the slack of the stage, then of every slot its own variables a, and what its
        multipliers will be: lambda of the inequalities, u = -y of the equalities.
        """
        s, mu, first = self.slots, self.mu, len(SEEN) + self.size.shared
        own, equal = len(s.lower), len(s.tried) - UNEQUAL
        wide = own + UNEQUAL + equal
        matrix, right = np.zeros((1 + ACTIVE * wide,) * 2), np.zeros(1 + ACTIVE * wide)
        outer = np.concatenate([dx[list(SEEN)], [ds] * self.size.shared])
        eps, nu = self.slack.eps[i], self.slack.nu[i]
        matrix[0, 0], right[0] = nu / eps, mu / eps - self.rho
        for k in range(ACTIVE):
            c, at = k * self.size.wide + i, 1 + k * wide
            a, lam = s.v[first : first + own, c], s.v[first + own : first + own + UNEQUAL, c]
            below, above = a - s.lower, s.upper - a
            mine = slice(at, at + own)
            barrier = s.zl[:, c] / below + s.zu[:, c] / above
            diagonal = barrier + 2.0 * s.weight + self.delta
            matrix[mine, mine] = self.hessian[first:, first:, c] + np.diag(diagonal)
            guess = s.v[s.guess : s.guess + own, c]
            right[mine] = -2.0 * s.weight * (a - guess) + mu / below - mu / above
            right[mine] -= self.hessian[first:, :first, c] @ outer
            for j in range(UNEQUAL + equal):
                row, slope = at + own + j, s.slope[j, :, c]
                sign = -1.0 if j < UNEQUAL else 1.0
                matrix[mine, row], matrix[row, mine] = sign * slope[first:], slope[first:]
                right[row] = -s.value[j, c] - slope[:first] @ outer
                if j >= UNEQUAL:
                    matrix[row, row] = -1e-10
                    continue
                # h + J dw + eps + deps = t + dt with t + dt = (mu - t (lam_new - lam)) / lam
                matrix[row, row] = s.t[j, c] / lam[j]
                matrix[row, 0], matrix[0, row] = 1.0, -1.0
                right[row] += (mu + s.t[j, c] * lam[j]) / lam[j] - eps
        solved = np.linalg.solve(matrix, right)
        force = np.zeros(self.size.n + 1)
        own_steps, multipliers = np.zeros((ACTIVE, own)), np.zeros((ACTIVE, UNEQUAL + equal))
        where = [*SEEN, self.size.n][:first]
        for k in range(ACTIVE):
            c, at = k * self.size.wide + i, 1 + k * wide
            own_steps[k], multipliers[k] = solved[at : at + own], solved[at + own : at + wide]
            signs = np.r_[-np.ones(UNEQUAL), np.ones(equal)]
            force[where] += self.hessian[:first, :first, c] @ outer
            force[where] += self.hessian[:first, first:, c] @ own_steps[k]
            force[where] += (signs * multipliers[k]) @ s.slope[:, :first, c]
        return SimpleNamespace(
            force=force, slack=solved[0], own=own_steps, multipliers=multipliers
        )


@pytest.mark.parametrize("shared", [0, 1])
@pytest.mark.parametrize(("own", "equal"), [(0, 0), (OWN, 0), (OWN, EQUAL)], ids=str)
def test_condensing_solves_the_full_newton_system(own: int, equal: int, shared: int) -> None:
    crowd = Crowd.drawn(own, equal, shared)
    size, mine, n = crowd.size, crowd.slots, crowd.size.n
    assert crowd.condense()
    slack.close(size, crowd.quadratic, crowd.slack, crowd.mu, crowd.rho)
    rng = np.random.default_rng(3)
    dv, ds = rng.normal(size=(n, size.wide)), float(shared * rng.normal())
    slack.open_slack(size, crowd.quadratic, crowd.slack, dv, ds, crowd.mu)
    condense.expand(size, mine, crowd.slack, dv, ds, crowd.expand)
    first = len(SEEN) + shared
    lam = mine.v[first + own : first + own + UNEQUAL]
    for i in range(size.steps):
        wanted = crowd.newton(i, dv[:, i + 1], ds)
        low = crowd.quadratic.slots[:, i].reshape(n + 2, n + 2)[: n + 1, : n + 1]
        curve = np.tril(low) + np.tril(low, -1).T
        given = curve @ np.append(dv[:, i + 1], ds) + crowd.quadratic.force[: n + 1, i]
        np.testing.assert_allclose(given, wanted.force, atol=1e-7)
        assert crowd.slack.deps[i] == pytest.approx(wanted.slack, abs=1e-7)
        mine_at = [k * size.wide + i for k in range(ACTIVE)]
        np.testing.assert_allclose(mine.da[:own, mine_at].T, wanted.own, atol=1e-7)
        new = (lam + mine.dlam)[:, mine_at].T
        np.testing.assert_allclose(new, wanted.multipliers[:, :UNEQUAL], atol=1e-7)
        np.testing.assert_allclose(
            mine.da[own:, mine_at].T, wanted.multipliers[:, UNEQUAL:], atol=1e-7
        )


def test_wrong_curvature_of_own_variables_is_refused() -> None:
    assert not Crowd.drawn(OWN, EQUAL, 1, curved=-40.0).condense()
