"""What slots and slacks contribute in the structured solver against dense linear algebra."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.values.arrays import Array
from wideberth.solvers.riccati import _core as core
from wideberth.solvers.riccati import _protocol as protocol
from wideberth.solvers.riccati.kernels import Slot, eliminate, expand
from wideberth.tests.helpers.interpreted import columns, interpret

SEEN, OWN, UNEQUAL, EQUAL, ACTIVE = (0, 2), 3, 2, 1, 2
"""Of the slots below: entries of x, own variables, inequalities, equalities; slots in use."""


@pytest.fixture(autouse=True)
def interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is compiled here, which would take longer than the tests."""
    interpret(monkeypatch, core)


@dataclass(frozen=True)
class Crowd:
    """Slots of one kind with random numbers, over N stages, and the slacks of the regions."""

    size: Any
    slots: Any
    hessian: Array
    slack: Any
    quadratic: Any
    mu: float
    rho: float
    delta: float

    @classmethod
    def drawn(cls, own: int, equal: int, shared: int, curved: float = 8.0) -> "Crowd":
        n, steps, rng = 4, 3, np.random.default_rng(10 * own + shared)
        size = core.size_of(protocol.Sizes(n, 2, shared, 0, 0, 0), steps)
        active = np.array([1.0, 0.0, 1.0])
        lower, upper = np.full(own, -np.inf), np.full(own, np.inf)
        lower[:2], upper[1:2] = -1.5, 2.0
        first = len(SEEN) + shared
        wide, slot = first + own, Slot(first, tuple(lower), tuple(upper), UNEQUAL, equal)
        kind = protocol.SlotArguments(
            (None, None, columns(eliminate(slot)), columns(expand(slot))),
            np.array(SEEN), np.array([UNEQUAL, equal, 1]), np.array([lower, upper]),
            np.array([0.4]), rng.normal(size=(steps, 3, 2)), np.ones((steps, 3)), active,
            *rng.uniform(-1.0, 1.0, (2, steps, 3, own)), None, None, None,
        )  # fmt: skip
        made = core.make_slots(size, kind, 0.5, 1e-2)
        assert len(made.active) == ACTIVE
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
        block = core.make_block(size, 1)
        slacks, _ = core.make_slack(rng.uniform(0.2, 2.0, block.shape))
        quadratic, _, _ = core.make_newton(size, np.array(SEEN), block)
        return cls(size, made, hessian, slacks, quadratic, 0.05, 3.0, 0.2)

    def condense(self) -> bool:
        given = self.size, self.slots, self.quadratic, self.slack.eps, self.mu, self.delta
        return bool(core.condense_slots(*given))

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
    core.eliminate_slack(size, crowd.quadratic, crowd.slack, crowd.mu, crowd.rho)
    rng = np.random.default_rng(3)
    dv, ds = rng.normal(size=(n, size.wide)), float(shared * rng.normal())
    core.recover_slack(size, crowd.quadratic, crowd.slack, dv, ds, crowd.mu)
    core.expand_slots(size, mine, crowd.slack, dv, ds)
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
