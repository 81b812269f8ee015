"""A problem's functions and derivatives at the points of a batch."""

from collections.abc import Sequence
from math import prod
from typing import Any

from .iterate import Dual, Instances, Primal, Slopes, Values
from .program import DRIVE, LEVEL, NODE, SLACK, Kind, Program


def evaluate(program: Program, given: Instances, primal: Primal, scale: Any) -> Values:
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
    program: Program, given: Instances, primal: Primal, dual: Dual, scale: Any
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


def softened(program: Program, rows: Any, slack: Any) -> dict[str, Any]:
    """Inequalities with the slack added where it softens them."""
    import jax.numpy as jnp

    found = dict(rows)
    for kind in program.kinds:
        own = found[kind.name]
        soft = own[: kind.soft] + slack[:, None]
        found[kind.name] = jnp.concatenate([soft, own[kind.soft :]])
    return found


def _slots(
    program: Program, kind: Kind, given: Instances, primal: Primal, dual: Dual
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


def _own_rows(program: Program, primal: Primal) -> dict[str, Any]:
    """Inequalities that need no kernel."""
    rows = {}
    if program.levelled:
        rows[LEVEL] = primal.level - program.problem.minimum
    if program.kinds:
        rows[SLACK] = primal.slack[None]
    return rows


def _level(program: Program, given: Instances, primal: Primal, scale: Any) -> Any:
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
