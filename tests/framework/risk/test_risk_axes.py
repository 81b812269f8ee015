"""Principal axes to the last digits, and probabilities of singular covariances."""

import math
from decimal import Decimal, localcontext
from fractions import Fraction
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from scipy import special

from wideberth.framework.numerics.eigenframe import principal_axes, rim_gap
from wideberth.framework.risk.collision_probability import collision_probability


def thin(rng: np.random.Generator, size: int, count: int) -> Any:
    """Draw turned covariances with conditions up to 1e8, exactly symmetric."""
    turn = np.linalg.qr(rng.standard_normal((count, size, size)))[0]
    root = turn * 10.0 ** -rng.uniform(0, 4, (count, 1, size))
    return root @ np.swapaxes(root, 1, 2)


def minors(matrix: Any, order: int) -> Fraction:
    """Sum of the principal minors: the elementary symmetric function of the eigenvalues."""
    exact = [[Fraction(float(entry)) for entry in row] for row in np.tril(matrix)]
    full = [[exact[max(i, j)][min(i, j)] for j in range(len(exact))] for i in range(len(exact))]

    def determinant(index: tuple[int, ...], rows: tuple[int, ...]) -> Fraction:
        if not index:
            return Fraction(1)
        rest = [(-1) ** k * full[rows[0]][c] for k, c in enumerate(index)]
        below = [determinant(index[:k] + index[k + 1 :], rows[1:]) for k in range(len(index))]
        return sum((a * b for a, b in zip(rest, below, strict=True)), Fraction(0))

    return sum((determinant(c, c) for c in combinations(range(len(full)), order)), Fraction(0))


@pytest.mark.parametrize("size", [2, 3])
def test_eigenvalues_have_the_exact_invariants(size: int) -> None:
    """At a condition of 1e8 eigh's determinant is wrong by 1e-8."""
    covariance = thin(np.random.default_rng(0), size, 300)
    deviations, vectors = principal_axes(covariance)
    assert (np.diff(deviations, axis=1) <= 1e-12).all()
    identity = np.swapaxes(vectors, 1, 2) @ vectors
    assert np.abs(identity - np.eye(size)).max() < 1e-14
    for matrix, spread in zip(covariance, deviations, strict=True):
        values = [Fraction(float(value)) ** 2 for value in spread]
        for order in range(1, size + 1):
            got = sum(math.prod(part, start=Fraction(1)) for part in combinations(values, order))
            assert abs(float(got / minors(matrix, order)) - 1.0) < 1e-13 * 10**order


def test_axes_of_a_diagonal_are_exact() -> None:
    for entries in ((1.0, 4.0), (4.0, 1.0), (0.0, 1.0), (1.0, 0.0), (0.0, 0.0), (2.0, 2.0)):
        deviations, vectors = principal_axes(np.diag(entries))
        assert (deviations == np.sqrt(sorted(entries, reverse=True))).all()
        assert set(np.abs(vectors).ravel()) == {0.0, 1.0}


def test_gap_at_the_rim_is_exact() -> None:
    rng = np.random.default_rng(1)
    for size in (2, 3):
        points = rng.standard_normal((200, size))
        points /= np.linalg.norm(points, axis=1)[:, None]
        for point, got in zip(points, rim_gap(points, np.asarray(1.0)), strict=True):
            want = 1 - sum(Fraction(float(x)) ** 2 for x in point)
            assert float(got) == pytest.approx(float(want), rel=1e-12, abs=1e-31)


def test_turned_thin_covariances() -> None:
    """Against the probability in an eigenframe that 40 decimal digits have found."""
    rng = np.random.default_rng(2)
    covariance = thin(rng, 2, 200)
    place = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.normal(0, 3, (200, 2)))
    want = np.zeros(200)
    for i, ((a, _), (b, c)) in enumerate(covariance):
        with localcontext() as digits:
            digits.prec = 40
            a, b, c = Decimal(float(a)), Decimal(float(b)), Decimal(float(c))
            root = ((a - c) ** 2 + 4 * b * b).sqrt()
            large, small = (a + c + root) / 2, (a + c - root) / 2
            length = (b * b + (large - a) ** 2).sqrt()
            x, y = (Decimal(float(value)) for value in place[i])
            along, across = (b * x + (large - a) * y) / length, ((large - a) * x - b * y) / length
            frame = [float(along), float(across)], np.diag([float(large), float(small)])
        want[i] = collision_probability(*frame, 0.01)
    likely = want > 1e-12
    assert likely.mean() > 0.5
    got = collision_probability(place, covariance, 0.01)
    assert np.abs(got[likely] / want[likely] - 1.0).max() < 1e-9


@pytest.mark.parametrize(("x", "y"), [(2.0, 0.4), (0.1, 1.4999), (0.0, 0.0), (-7.0, -1.0)])
def test_singular_covariances_are_chords(x: float, y: float) -> None:
    chord = math.sqrt(1.5**2 - y**2)
    risk = float(special.ndtr(chord - x) - special.ndtr(-chord - x))
    flat, line = np.diag([1.0, 0.0]), np.diag([1.0, 0.0, 0.0])
    assert float(collision_probability([x, y], flat, 1.5)) == pytest.approx(risk, rel=1e-11)
    found = float(collision_probability([x, y, 0.0], line, 1.5))
    assert found == pytest.approx(risk, rel=1e-11)
    for far in ([x, 1.6], [x, -40.0]):
        assert float(collision_probability(far, flat, 1.5)) == 0.0


def test_nothing_is_too_large_or_small() -> None:
    """No overflow (a warning is an error), and the limits are right."""
    sizes = [0.0, 1e-150, 1e-60, 1e-8, 1.0, 1e8, 1e60, 1e150]
    grid = np.array([(d, s, r) for d in sizes for s in sizes for r in sizes])
    for size in (2, 3):
        place = grid[:, :1] * np.eye(size)[1]
        covariance = (np.minimum(grid[:, 1], 1e70) ** 2)[:, None, None] * np.eye(size)
        risk = collision_probability(place, covariance, grid[:, 2])
        assert np.isfinite(risk).all() and (0.0 <= risk).all() and (risk <= 1.0).all()
        sure = grid[:, 2] > 10.0 * (grid[:, 0] + grid[:, 1])
        assert (risk[sure] > 1.0 - 1e-12).all()
        never = grid[:, 0] > 50.0 * (grid[:, 1] + grid[:, 2])
        assert (risk[never] < 1e-59).all()
