"""How far the points of a batch are from optimal."""

from typing import Any, NamedTuple

from .elimination import product
from .evaluation import apart, softened
from .iterate import Instances, Iterate, Slopes, Values
from .program import DRIVE, LEVEL, NODE, SLACK, Kind, Program


class Errors(NamedTuple):
    """Violations of the optimality conditions, each (B,).

    Attributes
    ----------
    primal, dual : largest violation of constraints and gradient of the Lagrangian.
    low, high : smallest and largest product of distance and force.
    scaling : by which dual and products are divided, as IPOPT does: the mean multiplier over
        100, where that is more than 1.
    """

    primal: Any
    dual: Any
    low: Any
    high: Any
    scaling: Any

    def at(self, barrier: Any) -> Any:
        """Error of the barrier problem."""
        import jax.numpy as jnp

        product = jnp.maximum(self.high - barrier, barrier - self.low)
        return jnp.maximum(jnp.maximum(self.dual, product) / self.scaling, self.primal)


def residuals(
    program: Program, given: Instances, rows: Any, slack: Any, distance: Any
) -> dict[str, Any]:
    """Inequalities minus their distances, 0 where they do not count."""
    masks = program.masks(given.active)
    rows = softened(program, rows, slack)
    return {name: masks[name] * (rows[name] - t) for name, t in distance.items()}


def largest(parts: Any, count: int) -> Any:
    """Largest absolute entry of each instance, (B,)."""
    import jax.numpy as jnp

    worst = jnp.zeros(count)
    for part in parts:
        axes = tuple(range(part.ndim - 1))
        worst = jnp.maximum(worst, jnp.max(jnp.abs(part), axis=axes, initial=0.0))
    return worst


def errors(
    program: Program, given: Instances, at: Iterate, values: Values, slopes: Slopes, rest: Any
) -> Errors:
    """Errors at an iterate."""
    import jax.numpy as jnp

    count, masks = len(at.scale), program.masks(given.active)
    ties = [values.ties[kind.name] * given.active[kind.name] for kind in program.kinds]
    gap = values.following - at.primal.states
    low, high = jnp.full(count, jnp.inf), jnp.zeros(count)
    gaps = gap.shape[0] * gap.shape[1]
    rows, total = jnp.full(count, float(gaps)), jnp.abs(at.dual.dynamics).sum(axis=(0, 1))
    for name, t in at.primal.distance.items():
        force, mask = at.dual.force[name], jnp.broadcast_to(masks[name], t.shape)
        axes = tuple(range(t.ndim - 1))
        both = t * force
        low = jnp.minimum(low, jnp.min(both, axis=axes, initial=jnp.inf, where=mask > 0.0))
        high = jnp.maximum(high, jnp.max(both, axis=axes, initial=0.0, where=mask > 0.0))
        if name != SLACK:  # its forces are near the price, which says nothing of the problem
            total, rows = total + force.sum(axis=axes), rows + mask.sum(axis=axes)
    return Errors(
        primal=largest([gap, *rest.values(), *ties], count),
        dual=largest(_gradient(program, given, at, slopes), count),
        low=jnp.minimum(low, high),
        high=high,
        scaling=jnp.maximum(1.0, total / rows / 100.0),
    )


def _gradient(program: Program, given: Instances, at: Iterate, slopes: Slopes) -> list[Any]:
    """Gradient of the Lagrangian, in pieces."""
    import jax.numpy as jnp

    n, force, pi = program.problem.states, at.dual.force, at.dual.dynamics
    drive = slopes.drive_gradient + _pulled(slopes.dynamics, pi)
    drive = drive - _pulled(slopes.jacobians[DRIVE], force[DRIVE])
    node = slopes.node_gradient - _pulled(slopes.jacobians[NODE], force[NODE]) - pi
    node = node + jnp.pad(drive[:n, 1:], [(0, 0), (0, 1), (0, 0)])
    level = slopes.level_gradient
    if program.levelled:
        level = level - force[LEVEL][0]
    price = at.penalty - force[SLACK][0] if program.kinds else jnp.zeros_like(pi[0])
    own = []
    for kind in program.kinds:
        forces = force[kind.name]
        back = _pulled(slopes.jacobians[kind.name], forces)
        back = back + _pulled(slopes.ties[kind.name], at.dual.ties[kind.name])
        seen = len(kind.shape.depends)
        whole = back.sum(axis=-2)
        node = node.at[jnp.array(kind.shape.depends, dtype=int)].add(-whole[:seen])
        if program.problem.shared:
            level = level - whole[seen].sum(axis=0)
        price = price - forces[: kind.soft].sum(axis=(0, -2))
        own.append(_drawn(kind, given, at) - back[len(back) - kind.shape.auxiliaries :])
    level = level if program.problem.shared else jnp.zeros_like(level)
    own = [part * given.active[kind.name] for kind, part in zip(program.kinds, own, strict=True)]
    return [drive[n:], node, level[None], price, *own]


def _drawn(kind: Kind, given: Instances, at: Iterate) -> Any:
    """Gradient of what draws auxiliaries to their guess."""
    return 2.0 * kind.regularisation * at.scale * apart(kind, given, at.primal)


def _pulled(jacobian: Any, force: Any) -> Any:
    """J' force, (variables, ...)."""
    import jax.numpy as jnp

    if not len(jacobian):
        return jnp.zeros(jacobian.shape[1:])
    return product(jnp.swapaxes(jacobian, 0, 1), force[:, None])[:, 0]
