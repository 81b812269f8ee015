"""What one obstacle contributes to the Newton step, everything of its own eliminated.

With slack t, multiplier lambda and the stage's slack eps, the rows of the Newton system that
belong to (t, lambda) are solved by hand: with sigma = lambda / t and r = h + eps - t they add

    sigma (grad h, 1) (grad h, 1)'   and   -(mu / t - sigma r) (grad h, 1)

to the quadratic in (x, s, a, eps). The slot's own variables a, and the multipliers of its
equalities, are then eliminated from a small dense matrix. Both ways are written out as functions
of one slot, and compiled like the kernels of `kernels`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ....numerics.symbolic import ca

_DUAL = 1e-10
"""Regularisation of equalities, so that dependent ones do no harm."""
_LEAST = 1e-13
"""Smallest pivot of an own variable that counts as positive."""


@dataclass(frozen=True)
class Slot:
    """Sizes and bounds of one slot.

    Attributes
    ----------
    outer : entries of (x, s) that it depends on.
    lower, upper : bounds of the own variables.
    unequal, equal : inequalities, equalities.
    """

    outer: int
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    unequal: int
    equal: int

    def symbols(self) -> tuple[dict[str, Any], Any]:
        """Symbols of a slot's variables, and all in a column, in the order of `slots.Slots`."""
        own = len(self.lower)
        counts = {
            "outer": self.outer, "a": own, "lam": self.unequal, "y": self.equal,
            "t": self.unequal, "zl": own, "zu": own, "guess": own, "eps": 1, "mu": 1, "delta": 1,
            "weight": 1, "d_outer": self.outer, "d_eps": 1,
        }  # fmt: skip
        made = {name: ca.SX.sym(name, count) for name, count in counts.items()}
        return made, ca.vertcat(*made.values())

    def derivatives(self) -> tuple[Any, Any, Any, Any]:
        """Symbols of the kernel's results: values, slopes, Hessian; all in a column."""
        rows, wide = self.unequal + self.equal, self.outer + len(self.lower)
        values, slopes = ca.SX.sym("values", rows), ca.SX.sym("slopes", rows * wide)
        hessian = ca.SX.sym("hessian", wide * wide)
        column = ca.vertcat(values, slopes, hessian)
        return values, _square(slopes, rows, wide), _square(hessian, wide, wide), column


def eliminate(slot: Slot) -> Any:
    """(variables, derivatives) -> quadratic in (x, s, eps), its force, back, whether it may be.

    The matrix stands row by row up to the diagonal; ``back`` gives the step of the own variables
    and new multipliers (of -y) from (x, s, eps, 1), row by row; the last entry is 1 where the
    curvature in the own variables is positive.
    """
    own, equal, outer = len(slot.lower), slot.equal, slot.outer + 1
    known, v = slot.symbols()
    values, slopes, hessian, results = slot.derivatives()
    inner = own + equal
    matrix, force = ca.SX(inner + outer, inner + outer), ca.SX(inner + outer, 1)
    place = [*range(inner, inner + slot.outer), *range(own)]  # of (x, s, a)
    matrix[place, place] = hessian
    for r in range(own):
        pull = 2.0 * known["weight"]
        matrix[r, r] += pull + known["delta"]
        force[r] += pull * (known["a"][r] - known["guess"][r])
        for gap, z, sign in _bounds(slot, known, r):
            matrix[r, r] += z / gap
            force[r] -= sign * known["mu"] / gap
    for j in range(slot.unequal):
        t = known["t"][j]
        sigma = known["lam"][j] / t
        weight = known["mu"] / t - sigma * (values[j] + known["eps"] - t)
        gradient = ca.SX(inner + outer, 1)
        gradient[place] = slopes[j, :].T
        gradient[-1] = 1.0
        force -= weight * gradient
        matrix += (sigma * gradient) @ gradient.T
    for j in range(equal):
        row = ca.SX(1, inner + outer)
        row[place] = slopes[slot.unequal + j, :]
        matrix[own + j, :], matrix[:, own + j] = row, row.T
        matrix[own + j, own + j], force[own + j] = -_DUAL, values[slot.unequal + j]
    matrix, force, sound = _reduced(own, inner, matrix, force)
    back = _back(inner, matrix, force)
    kept = [matrix[r, c] for r in range(inner, inner + outer) for c in range(inner, r + 1)]
    out = ca.vertcat(*kept, force[inner:], ca.vec(back.T), sound)
    return ca.Function("eliminate", [v, results], [ca.densify(out)], {"cse": True})


def expand(slot: Slot) -> Any:
    """(variables, derivatives and results of `eliminate`) -> steps of all of its own.

    Steps of a, new multipliers (of -y), steps of t, lambda, zl, zu; 0 where there is no bound.
    """
    own, inner, outer = len(slot.lower), len(slot.lower) + slot.equal, slot.outer + 1
    known, v = slot.symbols()
    values, slopes, _, results = slot.derivatives()
    before = outer * (outer + 1) // 2 + outer
    condensed = ca.SX.sym("condensed", before + inner * (outer + 1) + 1)
    back = _square(condensed[before : before + inner * (outer + 1)], inner, outer + 1)
    given = ca.vertcat(known["d_outer"], known["d_eps"], 1.0)
    new = back @ given
    move, mu = ca.vertcat(known["d_outer"], new[:own]), known["mu"]
    rise = values[: slot.unequal] + slopes[: slot.unequal, :] @ move
    dt = rise + known["eps"] + known["d_eps"] - known["t"]
    lam = known["lam"]
    steps = [new, dt, (mu - lam * dt) / known["t"] - lam]
    bounds = {1.0: [ca.SX(0.0)] * own, -1.0: [ca.SX(0.0)] * own}
    for r in range(own):
        for gap, z, sign in _bounds(slot, known, r):
            bounds[sign][r] = (mu - sign * z * new[r]) / gap - z
    out = ca.vertcat(*steps, *bounds[1.0], *bounds[-1.0])
    p = ca.vertcat(results, condensed)
    return ca.Function("expand", [v, p], [ca.densify(out)], {"cse": True})


def _square(column: Any, rows: int, wide: int) -> Any:
    """Return the matrix whose entries stand row by row."""
    return ca.reshape(column, wide, rows).T


def _bounds(slot: Slot, known: dict[str, Any], r: int) -> list[tuple[Any, Any, float]]:
    """Gap, multiplier and sign of the bounds that an own variable has."""
    a, found = known["a"][r], []
    if np.isfinite(slot.lower[r]):
        found.append((a - slot.lower[r], known["zl"][r], 1.0))
    if np.isfinite(slot.upper[r]):
        found.append((slot.upper[r] - a, known["zu"][r], -1.0))
    return found


def _reduced(own: int, inner: int, matrix: Any, force: Any) -> tuple[Any, Any, Any]:
    """Eliminate the first ``inner`` unknowns, in the part up to the diagonal.

    Own variables need positive pivots and multipliers of equalities negative ones.
    """
    sound, size = ca.SX(1.0), matrix.shape[0]
    for j in range(inner):
        sound *= (matrix[j, j] if j < own else -matrix[j, j]) > _LEAST
        inverse = 1.0 / matrix[j, j]
        for r in range(j + 1, size):
            factor = matrix[r, j] * inverse
            force[r] -= factor * force[j]
            for k in range(j + 1, r + 1):
                matrix[r, k] -= factor * matrix[k, j]
    return matrix, force, sound


def _back(inner: int, matrix: Any, force: Any) -> Any:
    """Solve for the inner unknowns as a function of the outer ones and 1."""
    outer = matrix.shape[0] - inner
    back = ca.SX(inner, outer + 1)
    for j in range(inner - 1, -1, -1):
        value = ca.horzcat(matrix[inner:, j].T, force[j])
        for k in range(j + 1, inner):
            value += matrix[k, j] * back[k, :]
        back[j, :] = -value / matrix[j, j]
    return back
