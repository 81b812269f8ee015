"""What is compiled of a problem for batches: its kernels in JAX, and their sizes.

Bounds are stated as constraints, so that the solver knows one kind of inequality alone.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ....jit import JAX_IMPORTS, jax_source
from ....numerics.symbolic import ca
from ....values.arrays import Array
from ....values.errors import WideberthError
from ...ocp.problem import Problem, Slots
from ..riccati.kernels import SlotShape, build, slot_name

DRIVE, NODE, LEVEL, SLACK = "drive", "node", "level", "slack"
"""Groups of inequalities: of (x_i, u_i), i < N; of x_i, i > 0; s >= minimum; slack >= 0. Those
of the slots bear the name of their kind."""
MOST_OPERATIONS = 10_000
"""Of one kernel; all regions but `risk_contour` take a third of it at most."""


@dataclass(frozen=True)
class Kind:
    """Slots of one kind.

    Attributes
    ----------
    place : which of the problem's kinds it is.
    name : of its kernel and of its group of inequalities.
    count : how many slots.
    shape : sizes of its kernel; the inequalities include the bounds of the auxiliaries.
    soft : how many of the inequalities the slack softens; the bounds stand behind them.
    lower, upper : bounds of the auxiliaries.
    regularisation : weight that draws them to their guess.
    """

    place: int
    name: str
    count: int
    shape: SlotShape
    soft: int
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    regularisation: float


@dataclass(frozen=True, eq=False)
class Program:
    """A problem ready for `wideberth.framework.mpc.solvers.batch.solve`.

    Attributes
    ----------
    problem : as it was given.
    kernels : name -> function of JAX arrays (v, p), of
        `wideberth.framework.mpc.solvers.riccati.kernels`.
    always, final : number of constraints on x_i, and on x_N beside those.
    kinds : slots, of those kinds that there are any of.
    bounds : group -> its rows that are bounds of variables.
    """

    problem: Problem
    kernels: Mapping[str, Callable[[Any, Any], Any]]
    inputs: int
    always: int
    final: int
    kinds: tuple[Kind, ...]
    bounds: Mapping[str, range]

    @property
    def levelled(self) -> bool:
        """Whether the level is a variable with a lower bound."""
        return self.problem.shared and bool(np.isfinite(self.problem.minimum))

    def masks(self, active: Mapping[str, Any]) -> dict[str, Any]:
        """Group -> 1 where a row counts, 0 where not; they broadcast with its values."""
        rows = self.always + self.final
        node = np.ones((rows, self.problem.horizon, 1))
        node[self.always :, :-1] = 0.0
        one = np.ones((1, 1, 1))
        masks: dict[str, Any] = {DRIVE: one, NODE: node}
        if self.levelled:
            masks[LEVEL] = one[0]
        if self.kinds:
            masks[SLACK] = one
        return masks | {kind.name: active[kind.name][None, None] for kind in self.kinds}


def program(problem: Problem) -> Program:
    """Differentiate a problem and write its kernels for JAX."""
    found = build(_bounded(problem))
    kinds = tuple(
        _kind(k, slots, found.slots[k]) for k, slots in enumerate(problem.slots) if slots.count
    )
    bounds = {
        DRIVE: range(problem.input_constraints.numel_out(0), found.input_rows),
        NODE: range(problem.state_constraints.numel_out(0), found.node_rows),
        LEVEL: range(1),
        SLACK: range(1),
    }
    bounds |= {kind.name: range(kind.soft, kind.shape.inequalities) for kind in kinds}
    kernels = {name: _kernel(function, name) for name, function in found.functions.items()}
    sizes = found.input_rows, found.node_rows, found.final_rows
    return Program(problem, kernels, *sizes, kinds, bounds)


def _kind(place: int, slots: Slots, shape: SlotShape) -> Kind:
    own = slots.auxiliary
    soft = slots.constraint.numel_out(0)
    bounds = own.lower, own.upper, own.regularisation
    return Kind(place, slot_name(place), slots.count, shape, soft, *bounds)


def _kernel(function: Any, name: str) -> Callable[[Any, Any], Any]:
    """Write a kernel for JAX."""
    count = function.n_instructions()
    if count > MOST_OPERATIONS:
        raise WideberthError(
            f"the derivatives of one {name} take {count} operations; wanted at most "
            f"{MOST_OPERATIONS}, or XLA compiles for many minutes: solve one by one, or take a "
            "simpler region"
        )
    names: dict[str, Any] = {}
    exec(JAX_IMPORTS + jax_source(function, name), names)
    kernel: Callable[[Any, Any], Any] = names[name]
    return kernel


def _bounded(problem: Problem) -> Problem:
    """Append the bounds to the constraints."""
    x, u = ca.SX.sym("x", problem.states), ca.SX.sym("u", problem.inputs)
    own = problem.input_bounds
    by_input = ca.vertcat(problem.input_constraints(x, u), _inside(u, own.lower, own.upper))
    own = problem.state_bounds
    by_state = ca.vertcat(problem.state_constraints(x), _inside(x, own.lower, own.upper))
    return replace(
        problem,
        input_constraints=ca.Function("input_constraints", [x, u], [by_input]),
        state_constraints=ca.Function("state_constraints", [x], [by_state]),
        slots=tuple(_lifted(problem, slots) for slots in problem.slots),
    )


def _lifted(problem: Problem, slots: Slots) -> Slots:
    """Append those of the auxiliaries."""
    x, s = ca.SX.sym("x", problem.states), ca.SX.sym("s", int(problem.shared))
    own = slots.auxiliary
    a, numbers = ca.SX.sym("a", len(own)), ca.SX.sym("numbers", slots.size)
    clear, tied = slots.constraint(x, a, s, numbers)
    rows = ca.vertcat(clear, _inside(a, own.lower, own.upper))
    return replace(slots, constraint=ca.Function("constraint", [x, a, s, numbers], [rows, tied]))


def _inside(variables: Any, lower: Any, upper: Any) -> Any:
    """Finite bounds as rows >= 0."""
    rows = [variables[i] - value for i, value in enumerate(lower) if value > -np.inf]
    rows += [value - variables[i] for i, value in enumerate(upper) if value < np.inf]
    return ca.vertcat(ca.SX(0, 1), *rows)


def pushed(values: Array, lower: Any, upper: Any, push: float) -> Array:
    """Values (..., rows) moved inside their bounds by ``push``, relative to bounds or range."""
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    range_ = np.where(np.isfinite(high) & np.isfinite(low), high - low, np.inf)
    floor, roof = np.full(low.shape, -np.inf), np.full(high.shape, np.inf)
    for edge, bound, sign in ((floor, low, 1.0), (roof, high, -1.0)):
        finite = np.isfinite(bound)
        room = push * np.minimum(np.maximum(1.0, np.abs(bound[finite])), range_[finite])
        edge[finite] = bound[finite] + sign * room
    return np.clip(values, floor, roof)
