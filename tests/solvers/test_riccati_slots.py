"""What slots and slacks contribute in the structured solver against dense linear algebra."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.values.arrays import Array, address
from wideberth.solvers.riccati.workspace import KindTable, ProblemTable
from wideberth.tests.helpers.riccati_parts import Parts, compile_parts

SEEN, OWN, UNEQUAL, EQUAL = (0, 2), 3, 2, 1
"""Of the slots below: entries of x, own variables, inequalities, equalities."""
STATES, STEPS, ACTIVE = 4, 9, (1.0, 0.0, 1.0)
MU, RHO, DELTA, WEIGHT = 0.05, 3.0, 0.2, 0.2
USED = sum(one > 0.0 for one in ACTIVE)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return compile_parts(tmp_path_factory.mktemp("parts"))


@dataclass(frozen=True, eq=False)
class Crowd:
    """Slots of one kind with random numbers, over N stages, and the slacks of the regions."""

    parts: Parts
    shared: int
    lower: Array
    upper: Array
    own: int
    equal: int
    depends: Array

    @classmethod
    def drawn(
        cls, library: Any, own: int, equal: int, shared: int, curved: float = 8.0
    ) -> "Crowd":
        rng, seen = np.random.default_rng(10 * own + shared), np.array(SEEN)
        lower, upper = np.full(own, -np.inf), np.full(own, np.inf)
        lower[:2], upper[1:2] = -1.5, 2.0
        kind = KindTable(
            slots=len(ACTIVE), entries=len(SEEN), inequalities=UNEQUAL, equalities=equal, own=own,
            depends=address(seen), lower=address(lower), upper=address(upper),
        )  # fmt: skip
        problem = ProblemTable(n=STATES, m=2, steps=STEPS, shared=shared)
        parts = Parts(library, problem, kind, ACTIVE)
        crowd = cls(parts, shared, lower, upper, own, equal, seen)
        crowd.parts.numbers(MU, RHO, DELTA, WEIGHT, 0.0)
        crowd.out[:] = rng.normal(size=crowd.out.shape)
        crowd.hessian[:] += crowd.hessian.swapaxes(0, 1).copy()
        crowd.hessian[:] += curved * np.eye(crowd.wide)[..., None]
        for name, rows in (("y", UNEQUAL + equal), ("t", UNEQUAL), ("zl", own), ("zu", own)):
            crowd.slot(name, rows)[:] = rng.uniform(0.2, 2.0, (rows, crowd.columns))
        for name in ("a", "drawn"):
            crowd.slot(name, own)[:] = rng.uniform(-1.0, 1.0, (own, crowd.columns))
        for name in ("eps", "nu"):
            crowd.parts.array(name, 1)[:] = rng.uniform(0.2, 2.0, crowd.parts.wide)
        crowd.slot("zl", own)[lower == -np.inf] = crowd.slot("zu", own)[upper == np.inf] = 0.0
        return crowd

    @property
    def first(self) -> int:
        return len(SEEN) + self.shared

    @property
    def wide(self) -> int:
        return self.first + self.own

    @property
    def columns(self) -> int:
        return USED * int(self.parts.wide)

    def slot(self, name: str, rows: int) -> Array:
        return self.parts.array(f"slots.{name}", rows, self.columns)

    @property
    def stated(self) -> int:
        return UNEQUAL + self.equal

    @property
    def out(self) -> Array:
        return self.slot("out", self.stated * (1 + self.wide) + self.wide**2)

    @property
    def slope(self) -> Array:
        values = self.out[self.stated : self.stated * (1 + self.wide)]
        return values.reshape(self.stated, self.wide, -1)

    @property
    def hessian(self) -> Array:
        return self.out[self.stated * (1 + self.wide) :].reshape(self.wide, self.wide, -1)

    def newton(self, i: int, dx: Array, ds: float) -> SimpleNamespace:
        """Dense Newton step of all that belongs to stage i, and its force on (x, s).

        Unknowns: the slack of the stage, then of every slot its own variables a, and what its
        multipliers will be: lambda of the inequalities, u = -y of the equalities.
        """
        first, own, equal = self.first, self.own, self.equal
        wide = own + self.stated
        matrix, right = np.zeros((1 + USED * wide,) * 2), np.zeros(1 + USED * wide)
        outer = np.concatenate([dx[list(SEEN)], [ds] * self.shared])
        eps, nu = (self.parts.array(name, 1)[0, i] for name in ("eps", "nu"))
        matrix[0, 0], right[0] = nu / eps, MU / eps - RHO
        lam, t = self.slot("y", self.stated), self.slot("t", UNEQUAL)
        for k in range(USED):
            c, at = k * self.parts.wide + i, 1 + k * wide
            a, drawn = self.slot("a", own)[:, c], self.slot("drawn", own)[:, c]
            below, above = a - self.lower, self.upper - a
            mine = slice(at, at + own)
            barrier = self.slot("zl", own)[:, c] / below + self.slot("zu", own)[:, c] / above
            matrix[mine, mine] = self.hessian[first:, first:, c] + np.diag(
                barrier + 2.0 * WEIGHT + DELTA
            )
            right[mine] = -2.0 * WEIGHT * (a - drawn) + MU / below - MU / above
            right[mine] -= self.hessian[first:, :first, c] @ outer
            for j in range(self.stated):
                row, slope = at + own + j, self.slope[j, :, c]
                sign = -1.0 if j < UNEQUAL else 1.0
                matrix[mine, row], matrix[row, mine] = sign * slope[first:], slope[first:]
                right[row] = -self.out[j, c] - slope[:first] @ outer
                if j >= UNEQUAL:
                    matrix[row, row] = -1e-10
                    continue
                # h + J dw + eps + deps = t + dt with t + dt = (mu - t (lam_new - lam)) / lam
                matrix[row, row] = t[j, c] / lam[j, c]
                matrix[row, 0], matrix[0, row] = 1.0, -1.0
                right[row] += (MU + t[j, c] * lam[j, c]) / lam[j, c] - eps
        solved = np.linalg.solve(matrix, right)
        force = np.zeros(self.first)
        own_steps, multipliers = np.zeros((USED, own)), np.zeros((USED, self.stated))
        for k in range(USED):
            c, at = k * self.parts.wide + i, 1 + k * wide
            own_steps[k], multipliers[k] = solved[at : at + own], solved[at + own : at + wide]
            signs = np.r_[-np.ones(UNEQUAL), np.ones(equal)]
            force += self.hessian[:first, :first, c] @ outer
            force += self.hessian[:first, first:, c] @ own_steps[k]
            force += (signs * multipliers[k]) @ self.slope[:, :first, c]
        return SimpleNamespace(
            force=force, slack=solved[0], own=own_steps, multipliers=multipliers
        )


@pytest.mark.parametrize("shared", [0, 1])
@pytest.mark.parametrize(("own", "equal"), [(0, 0), (OWN, 0), (OWN, EQUAL)], ids=str)
def test_condensing_solves_the_full_newton_system(
    own: int, equal: int, shared: int, library: Any
) -> None:
    crowd = Crowd.drawn(library, own, equal, shared)
    parts, first, rng = crowd.parts, crowd.first, np.random.default_rng(3)
    dv, ds = rng.normal(size=(STATES, parts.wide)), float(shared * rng.normal())
    assert library.parts_condense()
    parts.array("dv", STATES)[:] = dv
    parts.numbers(MU, RHO, DELTA, WEIGHT, ds)
    library.parts_expand()
    curve, slope = stages(crowd)
    steps = [parts.multiplier_step(k) for k in range(UNEQUAL * USED)]
    for i in range(STEPS):
        wanted = crowd.newton(i, dv[:, i + 1], ds)
        moved = np.concatenate([dv[list(SEEN), i + 1], [ds] * shared])
        given = curve[: len(SEEN), :, i] @ moved + slope[: len(SEEN), i]
        np.testing.assert_allclose(given, wanted.force[: len(SEEN)], atol=1e-7)
        assert parts.array("deps", 1)[0, i] == pytest.approx(wanted.slack, abs=1e-7)
        for k in range(USED):
            c = k * parts.wide + i
            found = crowd.slot("da", own + equal)[:, c]
            np.testing.assert_allclose(found[:own], wanted.own[k], atol=1e-7)
            np.testing.assert_allclose(found[own:], wanted.multipliers[k, UNEQUAL:], atol=1e-7)
            for j in range(UNEQUAL):
                new = crowd.slot("y", crowd.stated)[j, c] + steps[j * USED + k][i]
                assert new == pytest.approx(wanted.multipliers[k, j], abs=1e-7)
    if shared:  # the level feels all stages
        total = [crowd.newton(i, dv[:, i + 1], ds).force[first - 1] for i in range(STEPS)]
        top = parts.array("top", 1, 2)[0]
        cross = sum(curve[len(SEEN), : len(SEEN), i] @ dv[list(SEEN), i + 1] for i in range(STEPS))
        assert top[0] * ds + cross + top[1] == pytest.approx(sum(total), abs=1e-6)


def stages(crowd: Crowd) -> tuple[Array, Array]:
    """Curvature in (x's entries, s) and slope that the slots of each stage leave behind."""
    w, parts, count = STATES + 2, crowd.parts, len(SEEN)
    curve = np.zeros((crowd.first, crowd.first, STEPS))
    hessian, gradient = parts.array("hessian", w * (w + 1) // 2), parts.array("gradient", w)
    for a, r in enumerate(SEEN):
        for b, c in enumerate(SEEN):
            high, low = max(r, c), min(r, c)
            curve[a, b] = hessian[high * (high + 1) // 2 + low, 1 : STEPS + 1]
        if crowd.shared:
            curve[a, count] = curve[count, a] = parts.array("cross", STATES)[r, 1 : STEPS + 1]
    return curve, gradient[list(SEEN), 1 : STEPS + 1]


def test_wrong_curvature_of_own_variables_is_refused(library: Any) -> None:
    assert not Crowd.drawn(library, OWN, EQUAL, 1, curved=-40.0).parts.library.parts_condense()
