"""The symbolic constraint of a region as a function of numbers."""

from typing import Any, Protocol, TypeAlias

import numpy as np

from ..numerics.symbolic import ca
from ..region import Region
from ..values.arrays import Array
from ..values.motion import Pose

ConstraintValues: TypeAlias = tuple[Array, Array, Array]
"""Smallest inequality, its gradient, largest |equality|, per point."""


class NumericConstraint(Protocol):
    """Evaluates a constraint: smallest inequality, its gradient, largest |equality|."""

    def __call__(
        self, points: Array, numbers: Array, at: float, auxiliaries: Array | None = None
    ) -> ConstraintValues:
        """Evaluate one region at points; with the best auxiliaries unless some are given."""
        ...


def compile_constraint(region: Region, size: int) -> NumericConstraint:
    """Compile the symbolic constraint of one pose."""
    x, level = ca.SX.sym("x", size), ca.SX.sym("level")
    parameters = ca.SX.sym("parameters", region.parameter_count(size))
    auxiliary = ca.SX.sym("auxiliary", len(region.auxiliary(size)))
    pose = Pose(tuple(x[i] for i in range(size)), 0.0 if size == 2 else None)
    stated = region.constraint(pose, parameters, level, auxiliary)
    inequalities = ca.vertcat(*stated.inequalities)
    outputs: list[Any] = [
        inequalities,
        ca.vec(ca.jacobian(inequalities, x)),
        ca.vertcat(*stated.equalities),
    ]
    function = ca.Function("region", [x, parameters, level, auxiliary], outputs)

    def evaluate(
        points: Array, numbers: Array, at: float, auxiliaries: Array | None = None
    ) -> ConstraintValues:
        start = auxiliaries
        if start is None:
            start = region.auxiliary_start(Pose.of(points), numbers, np.asarray(at))
        count = len(points)
        if not count:
            return np.zeros(0), np.zeros((0, size)), np.zeros(0)
        given = [points.T, np.tile(numbers[:, None], count), np.full((1, count), at), start.T]
        kept, slopes, ties = (np.asarray(out.full()) for out in function.map(count)(*given))
        least = kept.argmin(axis=0)
        gradients = slopes.reshape(size, -1, count)[:, least, np.arange(count)].T
        return kept.min(axis=0), gradients, np.abs(ties).max(axis=0, initial=0.0)

    return evaluate
