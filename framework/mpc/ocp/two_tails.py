"""A plan with two tails as one problem: one beginning for both, then one trajectory for each.

Of two instances that differ in what they keep clear of, a first and a second one, the problem
of both is

    minimise    w J_1(x, u) + (1 - w) J_2(y, v)
    subject to  x_{i+1} = f(x_i, u_i),   x_0 = y_0,   x, u within their limits,   (x, u) clear of
                what the first keeps clear of,
                y_{i+1} = f(y_i, v_i),   y, v within their limits,   (y, v) clear of what the
                second keeps clear of,
                v_i = u_i  for i < H,

with one slack per stage, the larger of both, at its full price. It is a `Problem` like any other:
the state is (x, y, c), the input (u, v). c counts the stages that are still to be shared, and the
second trajectory is driven by

    f(y, u + a (v - u)),    a = 1 where c < 1/2, else 0.

While a = 0, v is drawn to u by (1 - a) |v - u|^2, which is 0 at the solution. So the beginning
has the same inputs in both tails whatever the solver's tolerance is.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...numerics.symbolic import ca
from ...region import Auxiliary
from ...robot import Bounds
from ...values.arrays import probability, whole
from ...values.errors import WideberthError
from .problem import Parameters, Problem, SlotNumbers, Slots
from .transcription import Guess

DRAWN = 1.0
"""Price of one unit, squared, that an input not in use is away from the one in its place."""


def two_tails(first: Problem, second: Problem) -> Problem:
    """Return the problem of two instances with a common beginning.

    Parameters
    ----------
    first, second : of the same robot, cost and kinds; the numbers of slots may differ.

    Raises
    ------
    WideberthError : problems that differ in more than that.
    """
    if (first.stage_key, first.horizon, len(first.slots)) != (
        second.stage_key, second.horizon, len(second.slots),
    ):  # fmt: skip
        raise WideberthError(
            "the problems of two tails differ in robot, cost, regions or horizon; wanted two of "
            "one planner, that differ in the numbers of their slots alone"
        )
    n, m, head = first.states, first.inputs, ca.SX.sym("head", first.head_width + 1)
    x, u = ca.SX.sym("x", 2 * n + 1), ca.SX.sym("u", 2 * m)
    one, other, left = x[:n], x[n : 2 * n], x[2 * n]
    apart = left < 0.5
    own, shared = u[:m], u[:m] + apart * (u[m:] - u[:m])
    following = [first.dynamics(one, own), first.dynamics(other, shared), left - 1.0]
    shares, plain = (head[-1], 1.0 - head[-1]), head[:-1]
    by_input = shares[0] * first.input_cost(one, own, plain)
    by_input += shares[1] * first.input_cost(other, shared, plain)
    by_input += (1.0 - apart) * DRAWN * ca.sumsqr(u[m:] - u[:m])
    by_state = shares[0] * first.state_cost(one, plain)
    by_state += shares[1] * first.state_cost(other, plain)
    on_input = [first.input_constraints(one, own), first.input_constraints(other, shared)]
    return replace(
        first,
        states=2 * n + 1,
        inputs=2 * m,
        curve=first.curve + 1,
        state_bounds=_twice(first.state_bounds, 1),
        input_bounds=_twice(first.input_bounds, 0),
        dynamics=ca.Function("dynamics", [x, u], [ca.vertcat(*following)]),
        input_cost=ca.Function("input_cost", [x, u, head], [by_input]),
        input_constraints=ca.Function("input_constraints", [x, u], [ca.vertcat(*on_input)]),
        state_cost=ca.Function("state_cost", [x, head], [by_state]),
        state_constraints=_of_both(first.state_constraints, x, one, other),
        terminal_constraints=_of_both(first.terminal_constraints, x, one, other),
        slots=tuple(
            _slots(mine, theirs.count, x, one, other)
            for mine, theirs in zip(first.slots, second.slots, strict=True)
        ),
        heading=None,
    )


def _twice(bounds: Bounds, free: int) -> Bounds:
    """Return the bounds twice, and ``free`` entries without any behind them."""
    return Bounds((*bounds.lower * 2, *[-np.inf] * free), (*bounds.upper * 2, *[np.inf] * free))


def _of_both(function: Any, x: Any, one: Any, other: Any) -> Any:
    rows = ca.vertcat(function(one), function(other))
    return ca.Function(function.name(), [x], [rows])


def _slots(slots: Slots, others: int, x: Any, one: Any, other: Any) -> Slots:
    """Make slots for either tail: a further parameter of each is 0 for the first, else 1.

    Tails are no kinds of their own, since compiled solvers are made for a number of kinds.
    """
    lifted, s = ca.SX.sym("auxiliary", len(slots.auxiliary)), ca.SX.sym("s", _level_size(slots))
    numbers = ca.SX.sym("numbers", slots.size + 1)
    which = numbers[slots.width]
    plain = ca.vertcat(numbers[: slots.width], numbers[slots.width + 1 :])
    rows = slots.constraint(one + which * (other - one), lifted, s, plain)
    own = slots.auxiliary
    half = Auxiliary(own.lower, own.upper, own.start, 0.5 * own.regularisation)
    return replace(
        slots,
        count=slots.count + others,
        width=slots.width + 1,
        auxiliary=half,
        constraint=ca.Function("constraint", [x, lifted, s, numbers], list(rows)),
    )


def _level_size(slots: Slots) -> int:
    return int(slots.constraint.size1_in(2))


@dataclass(frozen=True, eq=False)
class Tails:
    """Two instances that are solved as one.

    Parameters
    ----------
    problem : of both, see `two_tails`.
    first, second : numbers of the instances, which begin in the same state.
    share : w, of the first one's cost.
    head : H, stages whose inputs are shared, at least 1.

    Raises
    ------
    WideberthError : a share outside [0, 1], H below 1, instances that begin in different states.
    """

    problem: Problem
    first: Parameters
    second: Parameters
    share: float
    head: int

    def __post_init__(self) -> None:
        probability("tails.share", self.share, closed=True)
        whole("tails.head", self.head)
        if not np.array_equal(self.first.initial, self.second.initial):
            raise WideberthError(
                f"two tails begin at {self.first.initial} and {self.second.initial}; wanted one "
                "state"
            )

    @property
    def parameters(self) -> Parameters:
        """Numbers of the problem of both."""
        one, other = self.first, self.second
        share = np.full((len(one.speed), 1), self.share)
        curve = np.concatenate([one.curve.reshape(len(share), -1), share], axis=1)
        pairs = zip(one.slots, other.slots, strict=True)
        return replace(
            one,
            initial=np.concatenate([one.initial, other.initial, [float(self.head)]]),
            slots=tuple(_side_by_side(*pair) for pair in pairs),
            curve=curve,
        )

    def guess(self, first: Guess, second: Guess) -> Guess:
        """Join a guess of each instance; the beginning is the second one's."""
        inputs = first.inputs.copy()
        inputs[: self.head] = second.inputs[: self.head]
        states = first.states.copy()
        states[: self.head + 1] = second.states[: self.head + 1]
        steps = len(inputs)
        left = self.head - np.arange(steps + 1.0)
        return Guess(
            np.concatenate([states, second.states, left[:, None]], axis=1),
            np.concatenate([inputs, second.inputs], axis=1),
            tuple(
                np.concatenate(pair, axis=1)
                for pair in zip(first.auxiliaries, second.auxiliaries, strict=True)
            ),
            second.level,
            second.slack,
        )

    def cut(self, point: Guess) -> tuple[Guess, Guess]:
        """Cut a solution of both into that of each; the beginning is one and the same."""
        n, m = len(self.first.initial), point.inputs.shape[1] // 2
        states, inputs = point.states[:, n : 2 * n].copy(), point.inputs[:, m:].copy()
        inputs[: self.head] = point.inputs[: self.head, :m]
        other, driven = point.states[:, :n].copy(), point.inputs[:, :m].copy()
        other[: self.head + 1] = states[: self.head + 1]
        counts = [len(one.active) for one in self.first.slots]
        parts = list(zip(point.auxiliaries, counts, strict=True))
        return (
            Guess(other, driven, tuple(a[:, :k] for a, k in parts), point.level, point.slack),
            Guess(states, inputs, tuple(a[:, k:] for a, k in parts), point.level, point.slack),
        )


def _side_by_side(first: SlotNumbers, second: SlotNumbers) -> SlotNumbers:
    """Return the slots of both, the first one's before the second one's."""
    numbers = [
        np.concatenate([one.parameters, np.full((*one.parameters.shape[:2], 1), which)], axis=2)
        for one, which in ((first, 0.0), (second, 1.0))
    ]
    level = None
    if first.level is not None and second.level is not None:
        level = np.concatenate([first.level, second.level], axis=1)
    return SlotNumbers(
        np.concatenate(numbers, axis=1),
        np.concatenate([first.active, second.active]),
        np.concatenate([first.auxiliaries, second.auxiliaries], axis=1),
        level,
    )
