"""The interior-point iteration of a batch, all instances in step; those that are done wait.

A primal-dual barrier method on the elastic problem: the region constraints are softened by one
slack per stage at a price that grows until the slack vanishes, or that the problem names. Steps
are accepted by the filter of Waechter and Biegler (`waechter2006filter`): a step is taken where it
lowers either the residuals theta or the barrier function phi, unless an earlier iterate was better
in both. The constants are those of the compiled method, see `interior_point`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, TypeVar

from .. import interior_point as constants
from ..riccati.kernels import slot_name
from . import newton
from .program import (
    DRIVE,
    LEVEL,
    NODE,
    SLACK,
    BatchProgram,
    DualVariables,
    Instances,
    Iterate,
    Kind,
    Primal,
    Slopes,
    Values,
    apart,
    differentiate,
    evaluate,
    softened,
)

_Tree = TypeVar("_Tree")

LOWERED = 6
"""Times that the barrier may be lowered in one iteration: from the first value to the last."""


class ExitCode(IntEnum):
    """How an instance stands."""

    RUNNING = 0
    SOLVED = 1
    LIMIT = 2
    INFEASIBLE = 3
    FAILED = 4


@dataclass(frozen=True)
class MethodSettings:
    """Limit of iterations, and tolerance of the optimality conditions."""

    iterations: int = constants.ITERATIONS
    tolerance: float = constants.TOLERANCE


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


class Merit(NamedTuple):
    """Sum of the residuals and barrier function, (B,) each."""

    theta: Any
    phi: Any


def start(
    program: BatchProgram, given: Instances, guess: Primal, done: Any, own: MethodSettings
) -> Iterate:
    """First iterate; ``guess`` without distances, ``done`` (B,) are left alone."""
    import jax.numpy as jnp

    one = jnp.ones_like(given.target)
    nothing = _no_forces(program, guess)
    _, slopes = differentiate(program, given, guess, nothing, one)
    steepest = largest([slopes.drive_gradient, slopes.node_gradient], len(one))
    scale = jnp.clip(constants.LARGEST_GRADIENT / jnp.maximum(steepest, 1e-12), 1e-8, 1.0)
    soft = program.problem.penalty
    penalty = scale * (constants.START_PENALTY if soft is None else soft)
    slack, distance = _apart(
        program, given, guess, constants.START_BARRIER / penalty, constants.START_DISTANCE
    )
    masks = program.masks(given.active)
    force = {name: masks[name] * constants.START_BARRIER / t for name, t in distance.items()}
    return Iterate(
        primal=guess._replace(slack=slack, distance=distance),
        dual=nothing._replace(force=force),
        scale=scale,
        penalty=penalty,
        barrier=constants.START_BARRIER * one,
        shift=0.0 * one,
        filter=jnp.full((constants.FILTER_SIZE, 2, len(one)), jnp.inf),
        filled=jnp.zeros(len(one), dtype=int),
        highest=-one,
        lowest=0.0 * one,
        fails=jnp.zeros(len(one), dtype=int),
        count=jnp.zeros(len(one), dtype=int),
        code=jnp.where(done, int(ExitCode.SOLVED), int(ExitCode.RUNNING)),
    )


def _apart(
    program: BatchProgram, given: Instances, guess: Primal, least: Any, push: float
) -> tuple[Any, dict[str, Any]]:
    """Slack that suits a guess, ``least`` at least, and distances of all inequalities.

    Distances of bounds are exact, and stay so; the others begin at ``push`` at least.
    """
    import jax.numpy as jnp

    masks, rows = program.masks(given.active), evaluate(program, given, guess, least).rows
    deepest = jnp.zeros_like(guess.slack)
    for kind in program.kinds:
        soft = jnp.where(masks[kind.name] > 0.0, rows[kind.name], 0.0)[: kind.soft]
        deepest = jnp.minimum(deepest, jnp.min(soft, axis=(0, 2), initial=0.0))
    slack = jnp.maximum(least, 1e-8) - deepest
    if program.kinds:
        rows = softened(program, {**rows, SLACK: slack[None]}, slack)
    distance = {}
    for name, value in rows.items():
        exact = jnp.isin(jnp.arange(len(value)), jnp.array(program.bounds[name], dtype=int))
        exact = exact.reshape(-1, *(1,) * (value.ndim - 1))
        inside = jnp.where(exact, value, jnp.maximum(value, push))
        distance[name] = jnp.where(masks[name] > 0.0, inside, 1.0)
    return slack, distance


def _no_forces(program: BatchProgram, guess: Primal) -> DualVariables:
    """Multipliers that are all zero."""
    import jax.numpy as jnp

    steps, count = guess.slack.shape
    rows = program.always + program.final
    sizes: dict[str, tuple[int, ...]] = {DRIVE: (program.inputs, steps), NODE: (rows, steps)}
    if program.levelled:
        sizes[LEVEL] = (1,)
    if program.kinds:
        sizes[SLACK] = (1, steps)
    ties = {}
    for kind in program.kinds:
        slots = guess.lifted[kind.name].shape[2]
        sizes[kind.name] = (kind.shape.inequalities, steps, slots)
        ties[kind.name] = jnp.zeros((kind.shape.equalities, steps, slots, count))
    force = {name: jnp.zeros((*size, count)) for name, size in sizes.items()}
    return DualVariables(jnp.zeros_like(guess.states), ties, force)


def advance(
    program: BatchProgram, given: Instances, at: Iterate, most: Any, own: MethodSettings
) -> Iterate:
    """Iterate at most ``most`` times, until all instances are done."""
    import jax
    import jax.numpy as jnp

    def body(carry: Any) -> Any:
        at, turn = carry
        return _iteration(program, given, at, own), turn + 1

    def goes_on(carry: Any) -> Any:
        at, turn = carry
        return jnp.any(at.code == ExitCode.RUNNING) & (turn < most)

    return jax.lax.while_loop(goes_on, body, (at, jnp.asarray(0)))[0]


def _iteration(
    program: BatchProgram, given: Instances, old: Iterate, own: MethodSettings
) -> Iterate:
    """Judge the iterates, and improve those that are not done."""
    import jax
    import jax.numpy as jnp

    values, slopes = differentiate(program, given, old.primal, old.dual, old.scale)
    rest = residuals(program, given, values.rows, old.primal.slack, old.primal.distance)
    values, slopes, rest = _settled((values, slopes, rest))
    found = errors(program, given, old, values, slopes, rest)
    at = _judged(program, old, found, own)
    at = _lower_barrier(at, found, own)
    system = newton.model(program, given, at, values, slopes, rest)
    at, system = _settled((at, system))
    factors, shift = newton.regular(program, given, system, at)
    at = at._replace(
        code=jnp.where(factors.fine | (at.code > 0), at.code, int(ExitCode.FAILED)),
        shift=jnp.where(shift > 0.0, shift, at.shift),
    )
    steps, turns = newton.step(program, given, at, system, factors, slopes, rest)
    at, steps, turns = _settled((at, steps, turns))
    share = jnp.maximum(constants.BOUNDARY_SHARE, 1.0 - at.barrier)
    longest = reach(at.primal.distance, steps.distance, share)
    dual = reach(at.dual.force, turns.force, share)
    length, at = search(program, given, at, slopes, steps, longest)
    at = _taken(program, given, at, steps, turns, length, dual)
    at = at._replace(
        code=jnp.where(
            (at.fails > constants.FAILURES) & (at.code == 0), int(ExitCode.FAILED), at.code
        )
    )
    # One that is done keeps its point; its code is that of the judgement.
    running = at.code == ExitCode.RUNNING
    kept: Iterate = jax.tree.map(lambda new, was: jnp.where(running, new, was), at, old)
    return kept._replace(code=at.code)


def _settled(values: _Tree) -> _Tree:
    """Return the same; XLA must not copy what is behind it into all that uses it."""
    import jax

    barrier: Callable[[_Tree], _Tree] = jax.lax.optimization_barrier
    return barrier(values)


def _judged(program: BatchProgram, at: Iterate, found: Errors, own: MethodSettings) -> Iterate:
    """Set the code; raise the price of slack where it has not vanished."""
    import jax.numpy as jnp

    error = found.at(jnp.zeros_like(at.barrier))
    worst = jnp.max(at.primal.slack, axis=0)
    code = jnp.where(jnp.isfinite(error), int(ExitCode.RUNNING), int(ExitCode.FAILED))
    code = jnp.where(at.count >= own.iterations, int(ExitCode.LIMIT), code)
    met = error <= own.tolerance
    if program.kinds and program.problem.penalty is None:
        tight = worst <= constants.SLACK_LEFT * own.tolerance
        last = at.penalty >= constants.MOST_PENALTY * at.scale
        code = jnp.where(met & last, int(ExitCode.INFEASIBLE), code)
        dearer = met & ~tight & ~last
        met = met & tight
        at = _dearer(at, dearer & (at.code == 0))
    code = jnp.where(met, int(ExitCode.SOLVED), code)
    return at._replace(code=jnp.where(at.code > 0, at.code, code))


def _dearer(at: Iterate, where: Any) -> Iterate:
    """Raise the price of slack; the force on it takes what the price gains."""
    import jax.numpy as jnp

    gain = jnp.where(where, (constants.DEARER - 1.0) * at.penalty, 0.0)
    force = {**at.dual.force, SLACK: at.dual.force[SLACK] + gain}
    at = at._replace(
        penalty=at.penalty + gain,
        barrier=jnp.where(where, jnp.maximum(at.barrier, constants.DEARER_BARRIER), at.barrier),
        dual=at.dual._replace(force=force),
    )
    return forget(at, where)


def _lower_barrier(at: Iterate, found: Errors, own: MethodSettings) -> Iterate:
    """Lower mu as long as its problem is solved well enough."""
    import jax.numpy as jnp

    mu, least = at.barrier, constants.LAST_BARRIER * own.tolerance
    for _ in range(LOWERED):
        enough = (found.at(mu) <= constants.BARRIER_TEST * mu) & (mu > least)
        lower = jnp.minimum(constants.BARRIER_FACTOR * mu, mu**constants.BARRIER_POWER)
        lower = jnp.maximum(least, lower)
        mu = jnp.where(enough, lower, mu)
    return forget(at, mu < at.barrier)._replace(barrier=mu)


def _taken(
    program: BatchProgram,
    given: Instances,
    at: Iterate,
    steps: Primal,
    turns: DualVariables,
    length: Any,
    dual: Any,
) -> Iterate:
    """Take the steps; forces stay within a huge factor of mu over their distance."""
    import jax.numpy as jnp

    primal, masks = moved(at.primal, steps, length), program.masks(given.active)
    pressed = moved(at.dual.force, turns.force, dual)
    force = {}
    for name, t in primal.distance.items():
        middle = at.barrier / t
        force[name] = masks[name] * jnp.clip(
            pressed[name], middle / constants.MULTIPLIER_RANGE, middle * constants.MULTIPLIER_RANGE
        )
    other = DualVariables(
        moved(at.dual.dynamics, turns.dynamics, length),
        moved(at.dual.ties, turns.ties, length),
        force,
    )
    return at._replace(primal=primal, dual=other, count=at.count + 1)


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


def merit(program: BatchProgram, given: Instances, at: Iterate, primal: Primal) -> Merit:
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


def slope(
    program: BatchProgram, given: Instances, at: Iterate, slopes: Slopes, steps: Primal
) -> Any:
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
    program: BatchProgram,
    given: Instances,
    at: Iterate,
    slopes: Slopes,
    steps: Primal,
    longest: Any,
) -> tuple[Any, Iterate]:
    """Length of the step, (B,), and the iterate with its filter brought up to date."""
    import jax
    import jax.numpy as jnp

    now = merit(program, given, at, at.primal)
    descent = slope(program, given, at, slopes, steps)
    unset = at.highest < 0.0
    size = jnp.maximum(1.0, now.theta)
    at = at._replace(
        highest=jnp.where(unset, constants.LARGEST_RESIDUAL * size, at.highest),
        lowest=jnp.where(unset, constants.SMALL_RESIDUAL * size, at.lowest),
    )

    def falls(length: Any) -> Any:  # the step is one for the barrier function
        enough = length * jnp.maximum(-descent, 0.0) ** constants.SLOPE_POWER
        enough = enough > now.theta**constants.RESIDUAL_POWER
        return (descent < 0.0) & (now.theta <= at.lowest) & enough

    def shorter(carry: Any) -> Any:
        length, fine, tries = carry
        length = jnp.where(fine | (tries == 0), length, 0.5 * length)
        trial = merit(program, given, at, moved(at.primal, steps, length))
        return length, fine | _accepted(at, now, trial, descent, length, falls), tries + 1

    def goes_on(carry: Any) -> Any:
        return ~jnp.all(carry[1]) & (carry[2] < constants.TRIALS)

    done = at.code > 0
    length, fine, _ = jax.lax.while_loop(goes_on, shorter, (longest, done, 0))
    noted = fine & ~falls(length)
    pair = jnp.stack(
        [(1.0 - constants.MARGIN) * now.theta, now.phi - constants.MARGIN * now.theta]
    )
    place = (
        jnp.arange(constants.FILTER_SIZE)[:, None] == at.filled % constants.FILTER_SIZE
    ) & noted
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
    rounding = constants.ROUNDING * jnp.abs(now.phi)
    lower = phi <= now.phi + constants.ARMIJO * length * descent + rounding
    either = (theta <= (1.0 - constants.MARGIN) * now.theta) | (
        phi <= now.phi - constants.MARGIN * now.theta + rounding
    )
    beaten = jnp.any((theta >= at.filter[:, 0]) & (phi >= at.filter[:, 1]), axis=0)
    fine = jnp.where(falls(length), lower, either) & ~beaten & (theta <= at.highest)
    still = jnp.abs(phi - now.phi) <= constants.STILL_CHANGE * jnp.abs(now.phi)
    tiny = (jnp.maximum(now.theta, theta) <= constants.STILL_RESIDUAL) & still
    return (fine | tiny) & jnp.isfinite(theta) & jnp.isfinite(phi)


def residuals(
    program: BatchProgram, given: Instances, rows: Any, slack: Any, distance: Any
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
    program: BatchProgram, given: Instances, at: Iterate, values: Values, slopes: Slopes, rest: Any
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


def _gradient(program: BatchProgram, given: Instances, at: Iterate, slopes: Slopes) -> list[Any]:
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
    return newton.product(jnp.swapaxes(jacobian, 0, 1), force[:, None])[:, 0]


def report(program: BatchProgram, given: Instances, at: Iterate) -> dict[str, Any]:
    """Fields of `BatchSolution`, and ``code``; the first axis is the instance."""
    import jax.numpy as jnp

    problem, primal = program.problem, at.primal
    one = jnp.ones_like(at.scale)
    values = evaluate(program, given, primal, one)
    masks = program.masks(given.active)
    below = [masks[name] * jnp.minimum(rows, 0.0) for name, rows in values.rows.items()]
    ties = [values.ties[kind.name] * given.active[kind.name] for kind in program.kinds]
    gap = values.following - primal.states
    cost = values.cost + (problem.penalty or 0.0) * primal.slack.sum(axis=0)
    states = jnp.concatenate([given.initial[:, None], primal.states], axis=1)
    lifted = {}
    for k, slots in enumerate(problem.slots):
        none = jnp.zeros((len(slots.auxiliary), problem.horizon, slots.count, len(one)))
        rows = primal.lifted.get(slot_name(k), none)
        lifted[f"auxiliaries{k}"] = jnp.transpose(rows, (3, 1, 2, 0))
    return {
        "states": states.T,
        "inputs": primal.inputs.T,
        **lifted,
        "level": primal.level[0] if problem.shared else jnp.nan * one,
        "slack": primal.slack.T,
        "cost": cost,
        "violation": largest([gap, *below, *ties], len(one)),
        "iterations": at.count,
        "code": at.code,
    }
