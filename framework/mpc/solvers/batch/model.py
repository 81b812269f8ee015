"""The quadratic models of a batch, before anything is eliminated."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from .elimination import bordered, quadratic, shifted, spread
from .evaluation import apart
from .iterate import Instances, Iterate, Slopes, Values
from .program import DRIVE, LEVEL, NODE, SLACK, Kind, Program

TIE = 1e-10
"""Makes equalities of slots soft by this much, so that their pivots are never zero."""


class System(NamedTuple):
    """The quadratic models, before anything is eliminated.

    Attributes
    ----------
    slots : kind -> (L, L, N, K, B), over (auxiliaries, multipliers, x's entries, s, slack, 1).
    stages : (L, L, N, B), over (slack, x, s, 1) of stages 1..N; without slack where it is hard.
    drives : (L, L, N, B), over (u, x, s, 1) of stages 0..N-1.
    motion : (n, L, N, B), x_{i+1} as linear function of the same.
    level : (L, L, B), over (s, 1).
    """

    slots: Mapping[str, Any]
    stages: Any
    drives: Any
    motion: Any
    level: Any


def model(
    program: Program, given: Instances, at: Iterate, values: Values, slopes: Slopes, rest: Any
) -> System:
    """Quadratic models at an iterate; ``rest`` are the residuals of the inequalities."""
    masks, distance, mu = program.masks(given.active), at.primal.distance, at.barrier
    bend = {name: at.dual.force[name] / t for name, t in distance.items()}
    pull = {name: masks[name] * (mu / t - bend[name] * rest[name]) for name, t in distance.items()}
    gap = values.following - at.primal.states
    return System(
        slots={
            kind.name: _slots(kind, given, at, values, slopes, bend[kind.name], pull[kind.name])
            for kind in program.kinds
        },
        stages=_stages(program, at, slopes, bend, pull),
        drives=_drives(program, slopes, bend[DRIVE], pull[DRIVE]),
        motion=_motion(slopes.dynamics, gap, int(program.problem.shared)),
        level=_level(program, slopes, bend, pull),
    )


def _stages(
    program: Program, at: Iterate, slopes: Slopes, bend: Mapping[str, Any], pull: Mapping[str, Any]
) -> Any:
    """Quadratic of every stage over (slack, x, s, 1), but for the slots."""
    soft = int(bool(program.kinds))
    top = soft + program.problem.states + int(program.problem.shared)
    own = quadratic(
        slopes.node_hessian, slopes.node_gradient, slopes.jacobians[NODE], bend[NODE], pull[NODE]
    )
    stages = spread(own, [*range(soft, soft + program.problem.states), top], top + 1)
    if not soft:
        return stages
    price = bordered(bend[SLACK][None], at.penalty - pull[SLACK])
    return stages + spread(price, [0, top], top + 1)


def _drives(program: Program, slopes: Slopes, bend: Any, pull: Any) -> Any:
    """Quadratic of every stage's input over (u, x, s, 1)."""
    n, m = program.problem.states, program.problem.inputs
    own = quadratic(
        slopes.drive_hessian, slopes.drive_gradient, slopes.jacobians[DRIVE], bend, pull
    )
    top = m + n + int(program.problem.shared)
    return spread(own, [*range(m, m + n), *range(m), top], top + 1)


def _level(
    program: Program, slopes: Slopes, bend: Mapping[str, Any], pull: Mapping[str, Any]
) -> Any:
    """Quadratic over (s, 1)."""
    hessian, gradient = slopes.level_hessian, slopes.level_gradient
    if program.levelled:
        hessian, gradient = hessian + bend[LEVEL][0], gradient - pull[LEVEL][0]
    first = 1 - int(program.problem.shared)
    return bordered(hessian[None, None], gradient[None])[first:, first:]


def _motion(dynamics: Any, gap: Any, shared: int) -> Any:
    """x_{i+1} as linear function of (u, x, s, 1), (n, m + n + 2, N, B); s where it is shared."""
    import jax.numpy as jnp

    n = len(gap)
    level = [jnp.zeros_like(gap[:, None])] * shared
    return jnp.concatenate([dynamics[:, n:], dynamics[:, :n], *level, gap[:, None]], axis=1)


def _slots(
    kind: Kind, given: Instances, at: Iterate, values: Values, slopes: Slopes, bend: Any, pull: Any
) -> Any:
    """Quadratic of every slot of a kind over (a, z, x's entries, s, slack, 1)."""
    import jax.numpy as jnp

    name, a, q = kind.name, kind.shape.auxiliaries, kind.shape.equalities
    hessian, jacobian, tied = slopes.hessians[name], slopes.jacobians[name], slopes.ties[name]
    width = len(hessian)
    order = jnp.array([*range(width - a, width), *range(width - a)], dtype=int)
    hessian = hessian[order][:, order]
    soft = jnp.zeros_like(jacobian[:, :1]).at[: kind.soft].set(1.0)
    jacobian = jnp.concatenate([jacobian[:, order], soft], axis=1)
    weight = 2.0 * kind.regularisation * at.scale
    gradient = jnp.zeros((width + 1, *hessian.shape[2:]))
    gradient = gradient.at[:a].set(weight * apart(kind, given, at.primal))
    hessian = jnp.pad(hessian, [(0, 1), (0, 1), (0, 0), (0, 0), (0, 0)])
    hessian = shifted(hessian, [1.0] * a + [0.0] * (width + 1 - a), weight)
    found = quadratic(hessian, gradient, jacobian, bend, pull)
    if not q:
        return found
    tie = jnp.concatenate(
        [tied[:, order], jnp.zeros_like(tied[:, :1]), values.ties[name][:, None]], axis=1
    )
    held = jnp.broadcast_to(-TIE * jnp.eye(q)[:, :, None, None, None], (q, q, *tie.shape[2:]))
    across = jnp.concatenate([tie[:, :a], held, tie[:, a:]], axis=1)
    upright = jnp.swapaxes(tie, 0, 1)
    found = jnp.concatenate([found[:, :a], upright, found[:, a:]], axis=1)
    return jnp.concatenate([found[:a], across, found[a:]])
