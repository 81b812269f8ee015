"""Step lengths of a batch: fraction to the boundary, and a filter line search.

The search is that of Waechter and Biegler (`waechter2006filter`): a step is taken where it
lowers either the residuals theta or the barrier function phi, unless an earlier iterate was better
in both.
"""

from typing import Any, NamedTuple

from .evaluation import apart, evaluate
from .iterate import Instances, Iterate, Primal, Slopes
from .optimality import residuals
from .program import Program

SLOTS = 32
"""Pairs that a filter holds; then the oldest goes."""
TRIALS = 13
MARGIN, ARMIJO = 1e-5, 1e-8
FINEST, ROUNDING = 1e-9, 1e-12
"""Residual below which, and relative change of phi within which, a step may do nothing."""


class Merit(NamedTuple):
    """Sum of the residuals and barrier function, (B,) each."""

    theta: Any
    phi: Any


def reach(values: Any, steps: Any, share: Any) -> Any:
    """Largest step up to 1 that keeps all values positive, going ``share`` of the way, (B,)."""
    import jax.numpy as jnp

    longest = jnp.ones_like(share)
    for name, value in values.items():
        down = steps[name] < 0.0
        limit = jnp.where(down, -share * value / jnp.where(down, steps[name], -1.0), 1.0)
        axes = tuple(range(limit.ndim - 1))
        longest = jnp.minimum(longest, jnp.min(limit, axis=axes, initial=1.0))
    return longest


def moved(point: Any, steps: Any, length: Any) -> Any:
    """Point + length step, for all arrays of a tree."""
    import jax

    return jax.tree.map(lambda value, change: value + length * change, point, steps)


def merit(program: Program, given: Instances, at: Iterate, primal: Primal) -> Merit:
    """Residuals and barrier function at a trial point."""
    import jax.numpy as jnp

    values = evaluate(program, given, primal, at.scale)
    rest = residuals(program, given, values.rows, primal.slack, primal.distance)
    theta = jnp.abs(values.following - primal.states).sum(axis=(0, 1))
    phi = values.cost
    for kind in program.kinds:
        tie = jnp.abs(values.ties[kind.name]) * given.active[kind.name]
        theta = theta + tie.sum(axis=(0, 1, 2))
    for name, t in primal.distance.items():
        axes = tuple(range(t.ndim - 1))
        theta = theta + jnp.abs(rest[name]).sum(axis=axes)
        phi = phi - at.barrier * jnp.log(t).sum(axis=axes)
    if program.kinds:
        phi = phi + at.penalty * primal.slack.sum(axis=0)
    return Merit(theta, phi)


def slope(program: Program, given: Instances, at: Iterate, slopes: Slopes, steps: Primal) -> Any:
    """Return the derivative of the barrier function along the step, (B,)."""
    import jax.numpy as jnp

    before = jnp.pad(steps.states[:, :-1], [(0, 0), (1, 0), (0, 0)])
    drive = jnp.concatenate([before, steps.inputs])
    total = (slopes.drive_gradient * drive).sum(axis=(0, 1))
    total = total + (slopes.node_gradient * steps.states).sum(axis=(0, 1))
    if program.problem.shared:
        total = total + slopes.level_gradient * steps.level[0]
    if program.kinds:
        total = total + at.penalty * steps.slack.sum(axis=0)
    for kind in program.kinds:
        own = (apart(kind, given, at.primal) * steps.lifted[kind.name]).sum(axis=0)
        own = (own * given.active[kind.name]).sum(axis=(0, 1))
        total = total + 2.0 * kind.regularisation * at.scale * own
    for name, t in at.primal.distance.items():
        part = (steps.distance[name] / t).sum(axis=tuple(range(t.ndim - 1)))
        total = total - at.barrier * part
    return total


def search(
    program: Program, given: Instances, at: Iterate, slopes: Slopes, steps: Primal, longest: Any
) -> tuple[Any, Iterate]:
    """Length of the step, (B,), and the iterate with its filter brought up to date."""
    import jax
    import jax.numpy as jnp

    now = merit(program, given, at, at.primal)
    descent = slope(program, given, at, slopes, steps)
    unset = at.highest < 0.0
    size = jnp.maximum(1.0, now.theta)
    at = at._replace(
        highest=jnp.where(unset, 1e4 * size, at.highest),
        lowest=jnp.where(unset, 1e-4 * size, at.lowest),
    )

    def falls(length: Any) -> Any:  # the step is one for the barrier function
        enough = length * jnp.maximum(-descent, 0.0) ** 2.3 > now.theta**1.1
        return (descent < 0.0) & (now.theta <= at.lowest) & enough

    def shorter(carry: Any) -> Any:
        length, fine, tries = carry
        length = jnp.where(fine | (tries == 0), length, 0.5 * length)
        trial = merit(program, given, at, moved(at.primal, steps, length))
        return length, fine | _accepted(at, now, trial, descent, length, falls), tries + 1

    def goes_on(carry: Any) -> Any:
        return ~jnp.all(carry[1]) & (carry[2] < TRIALS)

    done = at.code > 0
    length, fine, _ = jax.lax.while_loop(goes_on, shorter, (longest, done, 0))
    noted = fine & ~falls(length)
    pair = jnp.stack([(1.0 - MARGIN) * now.theta, now.phi - MARGIN * now.theta])
    place = (jnp.arange(SLOTS)[:, None] == at.filled % SLOTS) & noted
    kept = jnp.where(place[:, None], pair[None], at.filter)
    at = at._replace(filter=kept, filled=at.filled + noted, fails=at.fails + ~fine)
    # Where nothing is acceptable the step is taken whole, or half, and the filter forgotten.
    blind = longest * jnp.where(at.fails < 3, 1.0, 0.5)
    return jnp.where(fine, length, blind), forget(at, ~fine)


def forget(at: Iterate, where: Any) -> Iterate:
    """Empty the filters of some instances."""
    import jax.numpy as jnp

    return at._replace(
        filter=jnp.where(where, jnp.inf, at.filter),
        filled=jnp.where(where, 0, at.filled),
        highest=jnp.where(where, -1.0, at.highest),
    )


def _accepted(at: Iterate, now: Merit, trial: Merit, descent: Any, length: Any, falls: Any) -> Any:
    """Whether a trial point is acceptable, (B,)."""
    import jax.numpy as jnp

    theta, phi = trial
    rounding = 0.1 * ROUNDING * jnp.abs(now.phi)
    lower = phi <= now.phi + ARMIJO * length * descent + rounding
    either = (theta <= (1.0 - MARGIN) * now.theta) | (
        phi <= now.phi - MARGIN * now.theta + rounding
    )
    beaten = jnp.any((theta >= at.filter[:, 0]) & (phi >= at.filter[:, 1]), axis=0)
    fine = jnp.where(falls(length), lower, either) & ~beaten & (theta <= at.highest)
    still = jnp.abs(phi - now.phi) <= ROUNDING * jnp.abs(now.phi)
    tiny = (now.theta <= FINEST) & (theta <= FINEST) & still
    return (fine | tiny) & jnp.isfinite(theta) & jnp.isfinite(phi)
