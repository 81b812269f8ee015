"""Model predictive contouring control: progress along the path is the plan's own to choose."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, final

import numpy as np

from ...framework.mpc.costs.base import Moment, ProgressCost, Weights, effort, speed_error
from ...framework.mpc.ocp.reference import Reference, lay_reference
from ...framework.mpc.ocp.stage import ReferenceSymbols
from ...framework.numerics.symbolic import ca
from ...framework.values.arrays import positive, whole
from ...framework.values.path import Path
from .curve import curve_at, curve_width, lay_curve


@final
@dataclass(frozen=True)
class Contouring(ProgressCost):
    r"""Stay near the path, and come along at the reference speed where nothing is in the way.

    The arc length theta of a point on the path is a state and its rate an input. With the
    curve c(theta), its slope t = c'(theta) and the error e = p - c(theta)::

        w_p (|e|^2 - (t.e)^2) + w_l (t.e)^2        contouring and lag error
        + w_r (rate - v_ref)^2                     the reward for progress
        + w_v (v - rate)^2 + w_a |a|^2 + w_alpha alpha^2

    (a robot without heading: w_v \|v - rate t\|^2). A robot that waits lets theta wait with it, at
    w_r v_ref^2 a step however long it takes; nothing runs away, so there is nothing to make up
    for. Without obstacles the speed approaches v_ref with the time constant sqrt(w_a / w_r),
    2.2 s at the defaults, from one side: w_l / w_r is large enough for theta to stay with the
    robot.

    The references reward progress linearly; a quadratic has its optimum at v_ref, so that no
    bound on the rate has to be active all the time. The curve rounds the corners of the path, see
    `wideberth.controllers.costs.curve`: one curve for all starting points of a call and, of one
    path, for all calls, where lines laid at the guess's theta would price each start differently
    and lead straight on past a corner at which the robot has waited. The point stops at the goal,
    and theta runs on at no price.

    Parameters
    ----------
    weights : w_p, of the contouring error alone, w_v, w_a, w_alpha; the paper's by default.
    lag : w_l, 1/m^2.
    rate : w_r, s^2/m^2.
    knots : corners of the curve within a plan's reach, at least 5; the more, the closer to the
        path and the slower.
    """

    reference: ClassVar[str] = "lam2010contouring,liniger2015optimization,brito2019contouring"

    weights: Weights = field(default_factory=Weights)
    lag: float = 1e4
    rate: float = 2e3
    knots: int = 12

    def __post_init__(self) -> None:
        positive("contouring.lag", self.lag)
        positive("contouring.rate", self.rate)
        whole("contouring.knots", self.knots, least=5)

    def scaled(self, k: float) -> "Contouring":
        """Return the cost for a robot that is k times as fast, see `Weights.scaled`."""
        return replace(self, weights=self.weights.scaled(k), rate=self.rate / k**2)

    def lay(self, path: Path, arc: float, speed: float, steps: int, dt: float) -> Reference:
        """Lay the curve; the points are those that a robot at the reference speed would pass."""
        points = lay_reference(path, arc, speed, steps, dt)
        curve = lay_curve(path, arc, speed * steps * dt, self.knots)
        return replace(points, speed=np.full(steps, speed), curve=np.tile(curve, (steps, 1)))

    def terms(self, moment: Moment, reference: ReferenceSymbols) -> Sequence[Any]:
        """Contouring and lag, progress, speed, effort."""
        weights = self.weights
        place, slope, share = curve_at(reference.curve, moment.progress, self.knots)
        error = ca.vertcat(*moment.pose.position) - place
        along = ca.dot(slope, error) ** 2
        rate = share * moment.rate  # of the point, which stops at the goal
        return (
            weights.position * (ca.sumsqr(error) - along) + self.lag * along,
            self.rate * (moment.rate - reference.speed) ** 2,
            weights.speed * speed_error(moment, rate, rate * slope),
            effort(weights, moment.acceleration),
        )

    def curve_width(self, dimension: int) -> int:
        """Numbers of the curve."""
        return curve_width(self.knots, dimension)
