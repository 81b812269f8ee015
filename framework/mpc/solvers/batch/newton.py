"""The Newton step of a batch: slots, slack, inputs and level eliminated one after the other.

The condensed system of slot, stage and horizon is each a quadratic in a few variables, see
`wideberth.framework.mpc.solvers.batch.elimination`. Eliminating the inputs stage by stage from the
end
is the Riccati recursion; the shared level is carried along as a state that never changes.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from .elimination import behind, eliminate, product, shifted, spread, substitute
from .evaluation import softened
from .iterate import Dual, Instances, Iterate, Primal, Slopes
from .model import System
from .program import DRIVE, LEVEL, NODE, SLACK, Kind, Program

LEAST, LEAST_OF_SLOTS = 1e-10, 1e-13
"""Smallest pivots of inputs and level, and of what slots eliminate."""
FIRST_SHIFT, LARGEST_SHIFT = 1e-4, 1e20


class Factors(NamedTuple):
    """What the eliminations leave for the step.

    Attributes
    ----------
    slots : kind -> rows of the inner variables.
    slack, inputs, level : rows of these.
    ahead : (N, L, L, B), cost to go over (x_{i+1}, s, 1).
    fine : (B,), whether the curvature is right.
    """

    slots: Mapping[str, tuple[Any, ...]]
    slack: tuple[Any, ...]
    inputs: tuple[Any, ...]
    level: tuple[Any, ...]
    ahead: Any
    fine: Any


def factor(program: Program, given: Instances, system: System, shift: Any) -> Factors:
    """Eliminate everything, the Hessian of auxiliaries, x, u and s shifted by ``shift``."""
    import jax
    import jax.numpy as jnp

    n, m, shared = program.problem.states, program.problem.inputs, int(program.problem.shared)
    stages, fine = system.stages, jnp.ones_like(shift, dtype=bool)
    slots = {}
    for kind in program.kinds:
        rows, found, well = _condensed(program, kind, given, system.slots[kind.name], shift)
        stages, slots[kind.name], fine = stages + found, rows, fine & well
    slack, stages, well = eliminate(stages, [1] * bool(program.kinds), LEAST)
    fine = fine & jnp.all(well, axis=0) if program.kinds else fine
    stages = shifted(stages, [1.0] * n + [0.0] * (shared + 1), shift)
    held = jnp.pad(stages[:, :, :-1], [(m, 0), (m, 0), (1, 0), (0, 0)])
    drives = shifted(system.drives + held, [1.0] * m + [0.0] * (n + shared + 1), shift)

    def back(carry: Any, own: Any) -> Any:
        ahead, fine = carry
        drive, motion = own
        whole = drive + behind(ahead, motion)
        rows, left, well = eliminate(whole, [1] * m, LEAST)
        return (left, fine & well), (rows, ahead)

    along = jnp.moveaxis(drives, 2, 0), jnp.moveaxis(system.motion, 2, 0)
    (whole, fine), (inputs, ahead) = jax.lax.scan(
        back, (stages[:, :, -1], fine), along, reverse=True
    )
    whole = shifted(whole[n:, n:] + system.level, [1.0] * shared + [0.0], shift)
    level, _, well = eliminate(whole, [1] * shared, LEAST)
    return Factors(slots, slack, inputs, level, ahead, fine & well)


def _condensed(program: Program, kind: Kind, given: Instances, matrix: Any, shift: Any) -> Any:
    """Eliminate what belongs to slots, and add the rest to the stages."""
    import jax.numpy as jnp

    a, q, active = kind.shape.auxiliaries, kind.shape.equalities, given.active[kind.name] > 0.0
    inner = [1] * a + [-1] * q
    if a:
        matrix = shifted(matrix, [1.0] * a + [0.0] * (len(matrix) - a), shift)
    rows, rest, well = eliminate(matrix, inner, LEAST_OF_SLOTS)
    fine = jnp.all(well | ~active, axis=(0, 1)) if inner else True
    n, shared = program.problem.states, int(program.problem.shared)
    places = [*(1 + entry for entry in kind.shape.depends), *[1 + n] * shared, 0, 1 + n + shared]
    found = jnp.where(active, rest, 0.0).sum(axis=-2)
    return rows, spread(found, places, n + shared + 2), fine


def step(
    program: Program,
    given: Instances,
    at: Iterate,
    system: System,
    factors: Factors,
    slopes: Slopes,
    rest: Any,
) -> tuple[Primal, Dual]:
    """Return the steps of all variables and multipliers."""
    import jax.numpy as jnp

    one = jnp.ones_like(at.scale)[None]
    level = substitute(factors.level, one)
    states, inputs, dynamics = _forward(system, factors, level)
    wide = [
        jnp.broadcast_to(part[:, None], (len(part), *states.shape[1:])) for part in (level, one)
    ]
    slack = jnp.zeros_like(states[0])
    if program.kinds:
        slack = substitute(factors.slack, jnp.concatenate([states, *wide]))[0]
    before = jnp.pad(states[:, :-1], [(0, 0), (1, 0), (0, 0)])
    moves = {DRIVE: jnp.concatenate([before, inputs]), NODE: states}
    moves |= {LEVEL: level, SLACK: slack[None]}
    lifted, ties = {}, {}
    for kind in program.kinds:
        name, a = kind.name, kind.shape.auxiliaries
        known = [states[jnp.array(kind.shape.depends, dtype=int)], wide[0], slack[None], wide[1]]
        outer = jnp.concatenate(known)[:, :, None]
        outer = jnp.broadcast_to(outer, (len(outer), *at.primal.lifted[name].shape[1:]))
        inner = substitute(factors.slots[name], outer)
        inner = jnp.where(given.active[name] > 0.0, inner, 0.0)
        lifted[name], ties[name] = inner[:a], -inner[a:] - at.dual.ties[name]
        moves[name] = jnp.concatenate([outer[:-2], inner[:a], outer[-2:-1]])
    return _with_distances(
        program, given, at, slopes, rest, moves,
        Primal(states, inputs, level, slack, lifted, {}),
        Dual(dynamics - at.dual.dynamics, ties, {}),
    )  # fmt: skip


def _forward(system: System, factors: Factors, level: Any) -> tuple[Any, Any, Any]:
    """Return steps of states and inputs, and multipliers of the dynamics, stage by stage."""
    import jax
    import jax.numpy as jnp

    n, count = len(system.motion), system.motion.shape[-1]
    rest = jnp.concatenate([level, jnp.ones((1, count))])

    def ahead(x: Any, own: Any) -> Any:
        rows, motion, cost = own
        known = jnp.concatenate([x, rest])
        u = substitute(rows, known)
        following = product(motion, jnp.concatenate([u, known])[:, None])[:, 0]
        known = jnp.concatenate([following, rest])
        return following, (following, u, product(cost[:n], known[:, None])[:, 0])

    along = factors.inputs, jnp.moveaxis(system.motion, 2, 0), factors.ahead
    _, found = jax.lax.scan(ahead, jnp.zeros((n, count)), along)
    states, inputs, dynamics = (jnp.moveaxis(part, 0, 1) for part in found)
    return states, inputs, dynamics


def _with_distances(
    program: Program,
    given: Instances,
    at: Iterate,
    slopes: Slopes,
    rest: Any,
    moves: Mapping[str, Any],
    primal: Primal,
    dual: Dual,
) -> tuple[Primal, Dual]:
    """Add the steps of the inequalities' distances and forces."""
    linear = {
        name: product(jacobian, moves[name][: jacobian.shape[1]][:, None])[:, 0]
        for name, jacobian in slopes.jacobians.items()
    }
    linear = softened(program, linear, primal.slack)
    distance, force = {}, {}
    for name, mask in program.masks(given.active).items():
        t, pressure = at.primal.distance[name], at.dual.force[name]
        distance[name] = mask * (rest[name] + linear.get(name, moves[name]))
        force[name] = mask * (at.barrier / t - pressure - pressure / t * distance[name])
    return primal._replace(distance=distance), dual._replace(force=force)


def regular(
    program: Program, given: Instances, system: System, at: Iterate
) -> tuple[Factors, Any]:
    """Factors with the smallest shift tried that gives the right curvature, and the shift (B,)."""
    import jax
    import jax.numpy as jnp

    shapes = jax.eval_shape(lambda shift: factor(program, given, system, shift), at.scale)
    none = jax.tree.map(lambda one: jnp.zeros(one.shape, one.dtype), shapes)
    known = at.shift > 0.0
    first = jnp.where(known, jnp.maximum(1e-20, at.shift / 3.0), FIRST_SHIFT)
    growth = jnp.where(known, 8.0, 100.0)

    def better(carry: Any) -> Any:
        shift, factors, tries = carry
        grown = jnp.where(shift > 0.0, growth * shift, first)
        shift = jnp.where(factors.fine | (tries == 0), shift, grown)
        found = factor(program, given, system, shift)
        fine = factors.fine
        return (
            shift,
            jax.tree.map(lambda new, old: jnp.where(fine, old, new), found, factors),
            tries + 1,
        )

    def goes_on(carry: Any) -> Any:
        shift, factors, _ = carry
        return jnp.any(~factors.fine & (shift < LARGEST_SHIFT))

    none = none._replace(fine=at.code > 0)
    shift, factors, _ = jax.lax.while_loop(goes_on, better, (0.0 * at.scale, none, 0))
    return factors, shift
