"""The interior-point iteration of a batch, all instances in step; those that are done wait.

A primal-dual barrier method on the elastic problem: the region constraints are softened by one
slack per stage at a price that grows until the slack vanishes, or that the problem names.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, TypeVar

from . import newton
from .evaluation import differentiate, evaluate, softened
from .iterate import Dual, Instances, Iterate, Primal
from .model import model
from .optimality import Errors, errors, largest, residuals
from .program import DRIVE, LEVEL, NODE, SLACK, Program
from .search import SLOTS, forget, moved, reach, search

_Tree = TypeVar("_Tree")


class Code(IntEnum):
    """How an instance stands."""

    RUNNING = 0
    SOLVED = 1
    LIMIT = 2
    INFEASIBLE = 3
    FAILED = 4


@dataclass(frozen=True)
class Settings:
    """Settings of the iteration.

    Attributes
    ----------
    iterations : limit.
    tolerance : of the optimality conditions, relative as in IPOPT.
    barrier : mu to begin with; small, because guesses are warm.
    push : how far guesses are moved inside their bounds.
    penalty, top : first and last price of slack where the regions are hard.
    steepest : largest gradient of the cost; it is scaled down to that.
    fails : line searches without success after which an instance is given up.
    """

    iterations: int = 150
    tolerance: float = 1e-6
    barrier: float = 1e-2
    push: float = 1e-2
    penalty: float = 1e4
    top: float = 1e7
    steepest: float = 100.0
    fails: int = 8


def start(program: Program, given: Instances, guess: Primal, done: Any, own: Settings) -> Iterate:
    """First iterate; ``guess`` without distances, ``done`` (B,) are left alone."""
    import jax.numpy as jnp

    one = jnp.ones_like(given.target)
    nothing = _no_forces(program, guess)
    _, slopes = differentiate(program, given, guess, nothing, one)
    steepest = largest([slopes.drive_gradient, slopes.node_gradient], len(one))
    scale = jnp.clip(own.steepest / jnp.maximum(steepest, 1e-12), 1e-8, 1.0)
    soft = program.problem.penalty
    penalty = scale * (own.penalty if soft is None else soft)
    slack, distance = _apart(program, given, guess, own.barrier / penalty, own.push)
    masks = program.masks(given.active)
    force = {name: masks[name] * own.barrier / t for name, t in distance.items()}
    return Iterate(
        primal=guess._replace(slack=slack, distance=distance),
        dual=nothing._replace(force=force),
        scale=scale,
        penalty=penalty,
        barrier=own.barrier * one,
        shift=0.0 * one,
        filter=jnp.full((SLOTS, 2, len(one)), jnp.inf),
        filled=jnp.zeros(len(one), dtype=int),
        highest=-one,
        lowest=0.0 * one,
        fails=jnp.zeros(len(one), dtype=int),
        count=jnp.zeros(len(one), dtype=int),
        code=jnp.where(done, int(Code.SOLVED), int(Code.RUNNING)),
    )


def _apart(
    program: Program, given: Instances, guess: Primal, least: Any, push: float
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


def _no_forces(program: Program, guess: Primal) -> Dual:
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
    return Dual(jnp.zeros_like(guess.states), ties, force)


def advance(program: Program, given: Instances, at: Iterate, most: Any, own: Settings) -> Iterate:
    """Iterate at most ``most`` times, until all instances are done."""
    import jax
    import jax.numpy as jnp

    def body(carry: Any) -> Any:
        at, turn = carry
        return _iteration(program, given, at, own), turn + 1

    def goes_on(carry: Any) -> Any:
        at, turn = carry
        return jnp.any(at.code == Code.RUNNING) & (turn < most)

    return jax.lax.while_loop(goes_on, body, (at, jnp.asarray(0)))[0]


def _iteration(program: Program, given: Instances, old: Iterate, own: Settings) -> Iterate:
    """Judge the iterates, and improve those that are not done."""
    import jax
    import jax.numpy as jnp

    values, slopes = differentiate(program, given, old.primal, old.dual, old.scale)
    rest = residuals(program, given, values.rows, old.primal.slack, old.primal.distance)
    values, slopes, rest = _settled((values, slopes, rest))
    found = errors(program, given, old, values, slopes, rest)
    at = _judged(program, old, found, own)
    at = _lower_barrier(at, found, own)
    system = model(program, given, at, values, slopes, rest)
    at, system = _settled((at, system))
    factors, shift = newton.regular(program, given, system, at)
    at = at._replace(
        code=jnp.where(factors.fine | (at.code > 0), at.code, int(Code.FAILED)),
        shift=jnp.where(shift > 0.0, shift, at.shift),
    )
    steps, turns = newton.step(program, given, at, system, factors, slopes, rest)
    at, steps, turns = _settled((at, steps, turns))
    share = jnp.maximum(0.99, 1.0 - at.barrier)
    longest = reach(at.primal.distance, steps.distance, share)
    dual = reach(at.dual.force, turns.force, share)
    length, at = search(program, given, at, slopes, steps, longest)
    at = _taken(program, given, at, steps, turns, length, dual)
    at = at._replace(
        code=jnp.where((at.fails > own.fails) & (at.code == 0), int(Code.FAILED), at.code)
    )
    # One that is done keeps its point; its code is that of the judgement.
    running = at.code == Code.RUNNING
    kept: Iterate = jax.tree.map(lambda new, was: jnp.where(running, new, was), at, old)
    return kept._replace(code=at.code)


def _settled(values: _Tree) -> _Tree:
    """Return the same; XLA must not copy what is behind it into all that uses it."""
    import jax

    barrier: Callable[[_Tree], _Tree] = jax.lax.optimization_barrier
    return barrier(values)


def _judged(program: Program, at: Iterate, found: Errors, own: Settings) -> Iterate:
    """Set the code; raise the price of slack where it has not vanished."""
    import jax.numpy as jnp

    error = found.at(jnp.zeros_like(at.barrier))
    worst = jnp.max(at.primal.slack, axis=0)
    code = jnp.where(jnp.isfinite(error), int(Code.RUNNING), int(Code.FAILED))
    code = jnp.where(at.count >= own.iterations, int(Code.LIMIT), code)
    met = error <= own.tolerance
    if program.kinds and program.problem.penalty is None:
        tight = worst <= 10.0 * own.tolerance
        last = at.penalty >= own.top * at.scale
        code = jnp.where(met & last, int(Code.INFEASIBLE), code)
        dearer = met & ~tight & ~last
        met = met & tight
        at = _dearer(at, dearer & (at.code == 0))
    code = jnp.where(met, int(Code.SOLVED), code)
    return at._replace(code=jnp.where(at.code > 0, at.code, code))


def _dearer(at: Iterate, where: Any) -> Iterate:
    """Raise the price of slack; the force on it takes what the price gains."""
    import jax.numpy as jnp

    gain = jnp.where(where, 29.0 * at.penalty, 0.0)
    force = {**at.dual.force, SLACK: at.dual.force[SLACK] + gain}
    at = at._replace(
        penalty=at.penalty + gain,
        barrier=jnp.where(where, jnp.maximum(at.barrier, 1e-4), at.barrier),
        dual=at.dual._replace(force=force),
    )
    return forget(at, where)


def _lower_barrier(at: Iterate, found: Errors, own: Settings) -> Iterate:
    """Lower mu as long as its problem is solved well enough."""
    import jax.numpy as jnp

    mu = at.barrier
    for _ in range(4):
        enough = (found.at(mu) <= 10.0 * mu) & (mu > 0.1 * own.tolerance)
        lower = jnp.maximum(0.1 * own.tolerance, jnp.minimum(0.2 * mu, mu**1.5))
        mu = jnp.where(enough, lower, mu)
    return forget(at, mu < at.barrier)._replace(barrier=mu)


def _taken(
    program: Program,
    given: Instances,
    at: Iterate,
    steps: Primal,
    turns: Dual,
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
        force[name] = masks[name] * jnp.clip(pressed[name], 1e-10 * middle, 1e10 * middle)
    other = Dual(
        moved(at.dual.dynamics, turns.dynamics, length),
        moved(at.dual.ties, turns.ties, length),
        force,
    )
    return at._replace(primal=primal, dual=other, count=at.count + 1)
