"""The recursion over the horizon in the structured solver against dense linear algebra."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from wideberth.framework.plugins.registry import load, names
from wideberth.framework.values.arrays import Array
from wideberth.solvers.riccati.workspace import ProblemTable
from wideberth.tests.helpers.riccati_parts import CORE, Parts, compile_parts

RECURSION = [
    (4, 2, 5, 1), (5, 2, 3, 0), (6, 3, 4, 1), (2, 2, 1, 1), (3, 2, 9, 1), (5, 2, 8, 1),
    (5, 1, 6, 1), (7, 4, 3, 1),
]  # fmt: skip
"""n, m, N, whether a level is shared; the last two are sizes of no shipped robot."""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return compile_parts(tmp_path_factory.mktemp("parts"))


@dataclass(frozen=True)
class Linear:
    """A quadratic over linear dynamics, its recursion, and the same problem dense."""

    parts: Parts
    n: int
    m: int
    steps: int
    shared: int
    delta: float

    @classmethod
    def drawn(
        cls, library: Any, shape: tuple[int, int, int, int], rng: np.random.Generator,
        convex: float, delta: float = 0.0,
    ) -> "Linear":  # fmt: skip
        n, m, steps, shared = shape
        parts = Parts(library, ProblemTable(n=n, m=m, steps=steps, shared=shared))
        parts.numbers(0.0, 0.0, delta, 0.0, 0.0)
        made = cls(parts, n, m, steps, shared, delta)
        made.slopes[:] = rng.normal(scale=0.7, size=made.slopes.shape)
        for name, rows in (("gap", n), ("v", 2 * n + m), ("gradient", n + m)):
            values = parts.array(name, rows)
            values[:] = rng.normal(size=values.shape)
        w = n + m
        for i in range(steps + 1):
            root = rng.normal(size=(w, w))
            made.hessian[:, i] = (0.5 * (root + root.T) + convex * np.eye(w))[np.tril_indices(w)]
        # half of the Hessian and of the gradient come from the stage functions
        made.own[:] = rng.normal(size=made.own.shape)
        made.own[:] += made.own.reshape(w, w, -1).swapaxes(0, 1).reshape(made.own.shape)
        made.own[:] *= 0.3
        made.gradient_of_drive[:] = rng.normal(size=made.gradient_of_drive.shape)
        parts.array("cross", n)[:] = shared * rng.normal(size=(n, parts.wide))
        parts.array("top", 1, 2)[:] = convex * shared, rng.normal()
        return made

    def _drive(self) -> Array:
        n, w = self.n, self.n + self.m
        return self.parts.array("drive", n + 1 + w + n * w + w * w)

    @property
    def gradient_of_drive(self) -> Array:
        return self._drive()[self.n + 1 : self.n + 1 + self.n + self.m]

    @property
    def slopes(self) -> Array:
        first = self.n + 1 + self.n + self.m
        return self._drive()[first : first + self.n * (self.n + self.m)]

    @property
    def own(self) -> Array:
        return self._drive()[-((self.n + self.m) ** 2) :]

    @property
    def hessian(self) -> Array:
        w = self.n + self.m
        return self.parts.array("hessian", w * (w + 1) // 2)

    def stage(self, i: int) -> tuple[Array, Array]:
        """Hessian and gradient of a stage; of the last one without what ``drive`` gives."""
        w, last = self.n + self.m, i == self.steps
        full = np.zeros((w, w))
        full[np.tril_indices(w)] = self.hessian[:, i]
        full += np.tril(full, -1).T
        gradient = self.parts.array("gradient", w)[:, i].copy()
        if last:
            return full[: self.n, : self.n], gradient[: self.n]
        full += self.own[:, i].reshape(w, w)
        return full, gradient + self.gradient_of_drive[:, i]

    def dense(self) -> tuple[Array, Array, Array, Array]:
        """Hessian and gradient in (dw_0, .., dw_N, ds); rows and right-hand side, dx_0 = 0."""
        n, w, steps = self.n, self.n + self.m, self.steps
        total = steps * w + n + 1
        hessian, gradient = np.zeros((total, total)), np.zeros(total)
        cross, top = self.parts.array("cross", n), self.parts.array("top", 1, 2)[0]
        for i in range(steps + 1):
            curve, force = self.stage(i)
            at = slice(i * w, i * w + len(force))
            hessian[at, at] = curve + self.delta * np.eye(len(force))
            gradient[at] = force
            hessian[i * w : i * w + n, -1] = hessian[-1, i * w : i * w + n] = cross[:, i]
        hessian[-1, -1], gradient[-1] = top[0] + self.delta, top[1]
        rows, right = np.zeros(((steps + 1) * n, total)), np.zeros((steps + 1) * n)
        rows[:n, :n] = np.eye(n)
        for i in range(steps):
            at = slice((i + 1) * n, (i + 2) * n)
            rows[at, i * w : (i + 1) * w] = self.slopes[:, i].reshape(n, w)
            rows[at, (i + 1) * w : (i + 1) * w + n] = -np.eye(n)
            right[at] = -self.parts.array("gap", n)[:, i]
        kept = [*range(total - 1), *([total - 1] * self.shared)]
        return hessian[np.ix_(kept, kept)], gradient[kept], rows[:, kept], right

    def backward(self, of_any: bool) -> bool:
        return bool(self.parts.library.parts_backward(int(of_any)))


@pytest.mark.parametrize("of_any", [False, True], ids=["sized", "of any size"])
@pytest.mark.parametrize("delta", [0.0, 0.3])
@pytest.mark.parametrize("shape", RECURSION, ids=str)
def test_the_recursion_solves_the_dense_system(
    shape: tuple[int, int, int, int], delta: float, of_any: bool, library: Any
) -> None:
    made = Linear.drawn(library, shape, np.random.default_rng(sum(shape)), 14.0, delta)
    hessian, gradient, rows, right = made.dense()
    assert made.backward(of_any)
    library.parts_forward(int(of_any))
    none = np.zeros((len(rows), len(rows)))
    matrix = np.block([[hessian, rows.T], [rows, none]])
    solved = np.linalg.solve(matrix, np.concatenate([-gradient, right]))
    n, w, steps = made.n, made.n + made.m, made.steps
    flat = made.parts.array("dv", w)[:, : steps + 1].T.ravel()[: steps * w + n]
    np.testing.assert_allclose(flat, solved[: steps * w + n], atol=1e-9)
    if made.shared:
        level = library.parts_level_step()
        assert level == pytest.approx(solved[len(hessian) - 1], abs=1e-9)
    multipliers = solved[len(hessian) + n :].reshape(steps, n).T
    pi = made.parts.array("v", w + n)[w:]
    found = (made.parts.array("dpi", n) + pi)[:, :steps]
    np.testing.assert_allclose(found, multipliers, atol=1e-8)


@pytest.mark.parametrize("shape", RECURSION, ids=str)
def test_the_recursion_refuses_exactly_the_wrong_curvatures(
    shape: tuple[int, int, int, int], library: Any
) -> None:
    rng, answers, wanted = np.random.default_rng(1), [], []
    for convex in np.linspace(0.0, 8.0, 25):
        made = Linear.drawn(library, shape, rng, float(convex))
        hessian, _, rows, _ = made.dense()
        answers.append(made.backward(of_any=False))
        free = np.linalg.svd(rows)[2][len(rows) :]
        wanted.append(bool(np.linalg.eigvalsh(free @ hessian @ free.T).min() > 0.0))
    assert answers == wanted
    assert True in answers and False in answers


def test_each_shipped_robot_has_a_recursion_of_its_sizes() -> None:
    robots = [load("robots", name)() for name in names("robots")]
    text = (CORE / "sweep.h").read_text(encoding="utf-8")
    for robot in robots:
        n, m = len(robot.states), len(robot.inputs)
        assert f"function(s, {n}, {m})" in text, type(robot)
