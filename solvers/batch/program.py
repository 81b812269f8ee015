"""A problem in JAX: its kernels, the arrays of a batch, and all functions with derivatives.

The last axis of each array is the instance, B. Bounds are stated as constraints, so that the
method knows one kind of inequality alone.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod
from typing import Any, NamedTuple

import numpy as np

from ...framework.jit import JAX_IMPORTS, jax_source
from ...framework.mpc.ocp.problem import Parameters, Problem, Slots
from ...framework.mpc.ocp.transcription import Guess
from ...framework.mpc.solver import unwrapped
from ...framework.numerics.symbolic import ca
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
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
class BatchProgram:
    """A problem ready for `method`.

    Attributes
    ----------
    problem : as it was given.
    kernels : name -> function of JAX arrays (v, p), of
        `wideberth.solvers.riccati.kernels`.
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


def program(problem: Problem) -> BatchProgram:
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
    return BatchProgram(problem, kernels, *sizes, kinds, bounds)


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
        slots=tuple(_bounded_slots(problem, slots) for slots in problem.slots),
    )


def _bounded_slots(problem: Problem, slots: Slots) -> Slots:
    """Append the bounds of the auxiliaries."""
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


class Instances(NamedTuple):
    """Numbers of the instances.

    Attributes
    ----------
    initial : (n, B).
    head : (H, N, B), of stages 1..N.
    target : (B,).
    numbers : kind -> (size, N, K, B), of every slot.
    active : kind -> (K, B), 1 or 0.
    """

    initial: Any
    head: Any
    target: Any
    numbers: Mapping[str, Any]
    active: Mapping[str, Any]


class Primal(NamedTuple):
    """Variables, or a step of them.

    Attributes
    ----------
    states, inputs : (n, N, B) of stages 1..N, and (m, N, B).
    level : (1, B), or (0, B) where none is shared.
    slack : (N, B).
    lifted : kind -> (A, N, K, B), auxiliaries.
    distance : group -> (rows, ..., B), t > 0 of every inequality h - t = 0.
    """

    states: Any
    inputs: Any
    level: Any
    slack: Any
    lifted: Mapping[str, Any]
    distance: Mapping[str, Any]


class DualVariables(NamedTuple):
    """Multipliers, or a step of them.

    Attributes
    ----------
    dynamics : (n, N, B).
    ties : kind -> (q, N, K, B), of the slots' equalities.
    force : group -> (rows, ..., B), >= 0, of the inequalities.
    """

    dynamics: Any
    ties: Mapping[str, Any]
    force: Mapping[str, Any]


class Iterate(NamedTuple):
    """State of the iteration; every entry but the first two is (B,) unless stated.

    Attributes
    ----------
    scale : factor of the cost.
    penalty : price of slack, scaled.
    barrier : mu.
    shift : last positive shift of the Hessian.
    filter : (F, 2, B), pairs of residual and barrier function; filled : how many.
    highest, lowest : residuals beyond which nothing is accepted, and below which the barrier
        function has to fall; negative: to be set.
    fails : line searches without success.
    count : iterations.
    code : of `Code`.
    """

    primal: Primal
    dual: DualVariables
    scale: Any
    penalty: Any
    barrier: Any
    shift: Any
    filter: Any
    filled: Any
    highest: Any
    lowest: Any
    fails: Any
    count: Any
    code: Any


class Values(NamedTuple):
    """Functions at a point.

    Attributes
    ----------
    following : (n, N, B), f(x_i, u_i).
    cost : (B,), scaled, without the price of slack.
    rows : group -> (rows, ..., B), inequalities, not softened.
    ties : kind -> (q, N, K, B).
    """

    following: Any
    cost: Any
    rows: Mapping[str, Any]
    ties: Mapping[str, Any]


class Slopes(NamedTuple):
    """Derivatives at a point, z = (x, u) and w = (x's entries, s, auxiliaries) of a slot.

    Attributes
    ----------
    drive_gradient, drive_hessian : (z, N, B) and (z, z, N, B), of the Lagrangian's parts.
    dynamics : (n, z, N, B), Jacobian.
    node_gradient, node_hessian : (n, N, B) and (n, n, N, B).
    level_gradient, level_hessian : (B,).
    hessians : kind -> (w, w, N, K, B), of the constraints' part of the Lagrangian.
    jacobians : group -> (rows, variables, ..., B).
    ties : kind -> (q, w, N, K, B).
    """

    drive_gradient: Any
    drive_hessian: Any
    dynamics: Any
    node_gradient: Any
    node_hessian: Any
    level_gradient: Any
    level_hessian: Any
    hessians: Mapping[str, Any]
    jacobians: Mapping[str, Any]
    ties: Mapping[str, Any]


def packed(
    program: BatchProgram, parameters: Sequence[Parameters], guesses: Sequence[Guess], push: float
) -> tuple[Instances, Primal]:
    """Stack instances and starting points, which are moved inside their bounds."""
    problem = program.problem
    pairs = zip(parameters, guesses, strict=True)
    starts = [unwrapped(problem, one, guess) for one, guess in pairs]
    stages = np.stack([one.stages() for one in parameters], axis=-1).swapaxes(0, 1)
    head, pieces = problem.cut(stages)
    numbers, active = {}, {}
    for kind in program.kinds:
        own, part = problem.slots[kind.place], pieces[kind.place]
        cut = part.reshape(own.count, own.size, *part.shape[1:])
        numbers[kind.name] = np.ascontiguousarray(np.moveaxis(cut, 0, 2))
        active[kind.name] = numbers[kind.name][own.active, 0]
    given = Instances(
        initial=_stack([one.initial for one in parameters]),
        head=np.ascontiguousarray(head),
        target=np.array([one.target for one in parameters]),
        numbers=numbers,
        active=active,
    )
    return given, _started(program, starts, push)


def _started(program: BatchProgram, guesses: Sequence[Guess], push: float) -> Primal:
    """Stack starting points; distances and slack come later."""
    problem = program.problem
    state, control = problem.state_bounds, problem.input_bounds
    states = pushed(np.stack([one.states[1:] for one in guesses]), state.lower, state.upper, push)
    inputs = pushed(np.stack([one.inputs for one in guesses]), control.lower, control.upper, push)
    level = np.array([[one.level] for one in guesses])[:, : int(problem.shared)]
    level = pushed(level, [problem.minimum] * level.shape[1], [np.inf] * level.shape[1], push)
    lifted = {kind.name: _lifted(kind, guesses, push) for kind in program.kinds}
    slack = np.zeros((problem.horizon, len(guesses)))
    return Primal(states.T, inputs.T, level.T, slack, lifted, {})


def _lifted(kind: Kind, guesses: Sequence[Guess], push: float) -> Array:
    """Auxiliaries of the slots of one kind, (A, N, K, B)."""
    if not kind.lower:  # a bare guess has no slots either
        return np.zeros((0, len(guesses[0].inputs), kind.count, len(guesses)))
    values = [guess.auxiliaries[kind.place] for guess in guesses]
    return np.transpose(pushed(np.stack(values), kind.lower, kind.upper, push), (3, 1, 2, 0))


def _stack(values: Sequence[Any]) -> Array:
    """Instances along the last axis."""
    return np.stack(values, axis=-1)


def evaluate(program: BatchProgram, given: Instances, primal: Primal, scale: Any) -> Values:
    """Functions without derivatives."""
    import jax.numpy as jnp

    kernels, n = program.kernels, program.problem.states
    head = _with_scale(given, scale)
    drive = kernels["drive_values"](jnp.concatenate([before(given, primal), primal.inputs]), head)
    node = kernels["node_values"](primal.states, head)
    cost = drive[n].sum(axis=0) + node[0].sum(axis=0) + _level(program, given, primal, scale)[0]
    rows = {DRIVE: drive[n + 1 :], NODE: node[1:]} | _own_rows(program, primal)
    ties = {}
    for kind in program.kinds:
        out = kernels[f"{kind.name}_values"](
            jnp.concatenate(_variables(kind, primal)), given.numbers[kind.name]
        )
        rows[kind.name] = out[: kind.shape.inequalities]
        ties[kind.name] = out[kind.shape.inequalities :]
        if kind.shape.auxiliaries:
            away = (apart(kind, given, primal) ** 2).sum(axis=0) * given.active[kind.name]
            cost = cost + kind.regularisation * scale * away.sum(axis=(0, 1))
    return Values(drive[:n], cost, rows, ties)


def differentiate(
    program: BatchProgram, given: Instances, primal: Primal, dual: DualVariables, scale: Any
) -> tuple[Values, Slopes]:
    """Functions with derivatives; the cost is left out, 0."""
    import jax.numpy as jnp

    n, z = program.problem.states, program.problem.states + program.problem.inputs
    head, force = _with_scale(given, scale), dual.force
    v = jnp.concatenate([before(given, primal), primal.inputs, dual.dynamics, force[DRIVE]])
    c, g = program.inputs, program.always + program.final
    f, _, drive_gradient, dynamics, drive_hessian, on_input, by_input = _cut(
        program.kernels["drive"](v, head), [(n,), (), (z,), (n, z), (z, z), (c,), (c, z)]
    )
    v = jnp.concatenate([primal.states, force[NODE]])
    _, node_gradient, node_hessian, on_state, by_state = _cut(
        program.kernels["node"](v, head), [(), (n,), (n, n), (g,), (g, n)]
    )
    rows = {DRIVE: on_input, NODE: on_state} | _own_rows(program, primal)
    jacobians, ties = {DRIVE: by_input, NODE: by_state}, {}
    hessians, tied = {}, {}
    for kind in program.kinds:
        name = kind.name
        rows[name], ties[name], jacobians[name], tied[name], hessians[name] = _slots(
            program, kind, given, primal, dual
        )
    level = _level(program, given, primal, scale)
    slopes = Slopes(
        drive_gradient, drive_hessian, dynamics, node_gradient, node_hessian,
        level[1], level[2], hessians, jacobians, tied,
    )  # fmt: skip
    return Values(f, jnp.zeros_like(scale), rows, ties), slopes


def before(given: Instances, primal: Primal) -> Any:
    """States of stages 0..N-1, (n, N, B)."""
    import jax.numpy as jnp

    return jnp.concatenate([given.initial[:, None], primal.states[:, :-1]], axis=1)


def apart(kind: Kind, given: Instances, primal: Primal) -> Any:
    """Auxiliaries minus the guess they are drawn to, (A, N, K, B)."""
    first = kind.shape.guess
    guess = given.numbers[kind.name][first : first + kind.shape.auxiliaries]
    return primal.lifted[kind.name] - guess


def softened(program: BatchProgram, rows: Any, slack: Any) -> dict[str, Any]:
    """Inequalities with the slack added where it softens them."""
    import jax.numpy as jnp

    found = dict(rows)
    for kind in program.kinds:
        own = found[kind.name]
        soft = own[: kind.soft] + slack[:, None]
        found[kind.name] = jnp.concatenate([soft, own[kind.soft :]])
    return found


def _slots(
    program: BatchProgram, kind: Kind, given: Instances, primal: Primal, dual: DualVariables
) -> tuple[Any, ...]:
    """Inequalities, equalities, their Jacobians, and the Hessian of slots of one kind."""
    import jax.numpy as jnp

    shape, name = kind.shape, kind.name
    w = len(shape.depends) + int(program.problem.shared) + shape.auxiliaries
    h, q = shape.inequalities, shape.equalities
    v = jnp.concatenate([*_variables(kind, primal), dual.force[name], dual.ties[name]])
    out = program.kernels[name](v, given.numbers[name])
    values, jacobian, hessian = _cut(out, [(h + q,), (h + q, w), (w, w)])
    return values[:h], values[h:], jacobian[:h], jacobian[h:], hessian


def _variables(kind: Kind, primal: Primal) -> list[Any]:
    """Arguments of a slot's kernel: x's entries, s, auxiliaries."""
    import jax.numpy as jnp

    lifted = primal.lifted[kind.name]
    entries = primal.states[jnp.asarray(kind.shape.depends, dtype=int)][:, :, None]
    level = primal.level[:, None, None]
    return [
        jnp.broadcast_to(part, (part.shape[0], *lifted.shape[1:])) for part in (entries, level)
    ] + [lifted]


def _own_rows(program: BatchProgram, primal: Primal) -> dict[str, Any]:
    """Inequalities that need no kernel."""
    rows = {}
    if program.levelled:
        rows[LEVEL] = primal.level - program.problem.minimum
    if program.kinds:
        rows[SLACK] = primal.slack[None]
    return rows


def _level(program: BatchProgram, given: Instances, primal: Primal, scale: Any) -> Any:
    """Cost of the level with its two derivatives, (3, B)."""
    import jax.numpy as jnp

    s = primal.level if program.problem.shared else jnp.zeros_like(scale)[None]
    return program.kernels["level"](s, jnp.stack([given.target, scale]))


def _with_scale(given: Instances, scale: Any) -> Any:
    import jax.numpy as jnp

    steps, count = given.head.shape[1:]
    return jnp.concatenate([given.head, jnp.broadcast_to(scale, (1, steps, count))])


def _cut(out: Any, shapes: Sequence[tuple[int, ...]]) -> list[Any]:
    """Pieces of a kernel's result, in rows of the given shapes."""
    pieces, first = [], 0
    for shape in shapes:
        size = prod(shape)
        pieces.append(out[first : first + size].reshape(*shape, *out.shape[1:]))
        first += size
    return pieces
