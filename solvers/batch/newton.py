"""The Newton step of a batch: slots, slack, inputs and level eliminated one after the other.

A quadratic in z is kept as a symmetric matrix over (z, 1): the Hessian, bordered by the
gradient. Arrays are (L, L, ...): the trailing axes are stages, slots and instances, over which
everything is vectorised; the small matrices are worked on row by row. The condensed system of
slot, stage and horizon is each a quadratic in a few variables. Eliminating the inputs stage by
stage from the end is the Riccati recursion; the shared level is carried along as a state that
never changes.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ..interior_point import (
    EQUALITY_REGULARISATION,
    FIRST_GROWTH,
    FIRST_SHIFT,
    LARGEST_SHIFT,
    SHIFT_DECREASE,
    SHIFT_GROWTH,
    SMALLEST_OWN_PIVOT,
    SMALLEST_PIVOT,
    SMALLEST_SHIFT,
)
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
    softened,
)


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
    program: BatchProgram, given: Instances, at: Iterate, values: Values, slopes: Slopes, rest: Any
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
    program: BatchProgram,
    at: Iterate,
    slopes: Slopes,
    bend: Mapping[str, Any],
    pull: Mapping[str, Any],
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


def _drives(program: BatchProgram, slopes: Slopes, bend: Any, pull: Any) -> Any:
    """Quadratic of every stage's input over (u, x, s, 1)."""
    n, m = program.problem.states, program.problem.inputs
    own = quadratic(
        slopes.drive_hessian, slopes.drive_gradient, slopes.jacobians[DRIVE], bend, pull
    )
    top = m + n + int(program.problem.shared)
    return spread(own, [*range(m, m + n), *range(m), top], top + 1)


def _level(
    program: BatchProgram, slopes: Slopes, bend: Mapping[str, Any], pull: Mapping[str, Any]
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
    held = jnp.broadcast_to(
        -EQUALITY_REGULARISATION * jnp.eye(q)[:, :, None, None, None], (q, q, *tie.shape[2:])
    )
    across = jnp.concatenate([tie[:, :a], held, tie[:, a:]], axis=1)
    upright = jnp.swapaxes(tie, 0, 1)
    found = jnp.concatenate([found[:, :a], upright, found[:, a:]], axis=1)
    return jnp.concatenate([found[:a], across, found[a:]])


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


def factor(program: BatchProgram, given: Instances, system: System, shift: Any) -> Factors:
    """Eliminate everything, the Hessian of auxiliaries, x, u and s shifted by ``shift``."""
    import jax
    import jax.numpy as jnp

    n, m, shared = program.problem.states, program.problem.inputs, int(program.problem.shared)
    stages, fine = system.stages, jnp.ones_like(shift, dtype=bool)
    slots = {}
    for kind in program.kinds:
        rows, found, well = _condensed(program, kind, given, system.slots[kind.name], shift)
        stages, slots[kind.name], fine = stages + found, rows, fine & well
    slack, stages, well = eliminate(stages, [1] * bool(program.kinds), SMALLEST_PIVOT)
    fine = fine & jnp.all(well, axis=0) if program.kinds else fine
    stages = shifted(stages, [1.0] * n + [0.0] * (shared + 1), shift)
    held = jnp.pad(stages[:, :, :-1], [(m, 0), (m, 0), (1, 0), (0, 0)])
    drives = shifted(system.drives + held, [1.0] * m + [0.0] * (n + shared + 1), shift)

    def back(carry: Any, own: Any) -> Any:
        ahead, fine = carry
        drive, motion = own
        whole = drive + behind(ahead, motion)
        rows, left, well = eliminate(whole, [1] * m, SMALLEST_PIVOT)
        return (left, fine & well), (rows, ahead)

    along = jnp.moveaxis(drives, 2, 0), jnp.moveaxis(system.motion, 2, 0)
    (whole, fine), (inputs, ahead) = jax.lax.scan(
        back, (stages[:, :, -1], fine), along, reverse=True
    )
    whole = shifted(whole[n:, n:] + system.level, [1.0] * shared + [0.0], shift)
    level, _, well = eliminate(whole, [1] * shared, SMALLEST_PIVOT)
    return Factors(slots, slack, inputs, level, ahead, fine & well)


def _condensed(
    program: BatchProgram, kind: Kind, given: Instances, matrix: Any, shift: Any
) -> Any:
    """Eliminate what belongs to slots, and add the rest to the stages."""
    import jax.numpy as jnp

    a, q, active = kind.shape.auxiliaries, kind.shape.equalities, given.active[kind.name] > 0.0
    inner = [1] * a + [-1] * q
    if a:
        matrix = shifted(matrix, [1.0] * a + [0.0] * (len(matrix) - a), shift)
    rows, rest, well = eliminate(matrix, inner, SMALLEST_OWN_PIVOT)
    fine = jnp.all(well | ~active, axis=(0, 1)) if inner else True
    n, shared = program.problem.states, int(program.problem.shared)
    places = [*(1 + entry for entry in kind.shape.depends), *[1 + n] * shared, 0, 1 + n + shared]
    found = jnp.where(active, rest, 0.0).sum(axis=-2)
    return rows, spread(found, places, n + shared + 2), fine


def step(
    program: BatchProgram,
    given: Instances,
    at: Iterate,
    system: System,
    factors: Factors,
    slopes: Slopes,
    rest: Any,
) -> tuple[Primal, DualVariables]:
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
        DualVariables(dynamics - at.dual.dynamics, ties, {}),
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
    program: BatchProgram,
    given: Instances,
    at: Iterate,
    slopes: Slopes,
    rest: Any,
    moves: Mapping[str, Any],
    primal: Primal,
    dual: DualVariables,
) -> tuple[Primal, DualVariables]:
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
    program: BatchProgram, given: Instances, system: System, at: Iterate
) -> tuple[Factors, Any]:
    """Factors with the smallest shift tried that gives the right curvature, and the shift (B,)."""
    import jax
    import jax.numpy as jnp

    shapes = jax.eval_shape(lambda shift: factor(program, given, system, shift), at.scale)
    none = jax.tree.map(lambda one: jnp.zeros(one.shape, one.dtype), shapes)
    known = at.shift > 0.0
    first = jnp.where(known, jnp.maximum(SMALLEST_SHIFT, at.shift / SHIFT_DECREASE), FIRST_SHIFT)
    growth = jnp.where(known, SHIFT_GROWTH, FIRST_GROWTH)

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


def eliminate(matrix: Any, signs: Sequence[int], least: float) -> tuple[tuple[Any, ...], Any, Any]:
    """Eliminate the first variables at the stationary point of the quadratic.

    Parameters
    ----------
    matrix : (L, L, ...).
    signs : of the pivots wanted, one per variable to eliminate: 1 for a minimum, -1 for a
        multiplier.
    least : size that a pivot must exceed.

    Returns
    -------
    rows : of each variable, its dependence on what stands behind it, for `substitute`.
    rest : the quadratic of the rest.
    fine : (...), whether all pivots have their signs.
    """
    rows, fine = [], True
    for sign in signs:
        pivot = matrix[0, 0]
        fine &= sign * pivot > least
        row = matrix[0, 1:] / pivot
        rows.append(row)
        matrix = matrix[1:, 1:] - matrix[0, 1:][:, None] * row[None]
    return tuple(rows), matrix, fine


def substitute(rows: Sequence[Any], known: Any) -> Any:
    """Values of the eliminated variables, (len(rows), ...); ``known`` are the rest and 1."""
    import jax.numpy as jnp

    for row in reversed(rows):
        value = -(row * known).sum(axis=0)
        known = jnp.concatenate([jnp.broadcast_to(value, known.shape[1:])[None], known])
    return known[: len(rows)]


def product(left: Any, right: Any) -> Any:
    """Matrix products (L, M, ...) x (M, P, ...)."""
    return sum(left[:, j][:, None] * right[j][None] for j in range(left.shape[1]))


def behind(matrix: Any, motion: Any) -> Any:
    """Take a quadratic of (y, r), where y = F (z, r), as one of (z, r).

    Parameters
    ----------
    matrix : (n + L, n + L, ...), with r the last L entries.
    motion : F, (n, Z + L, ...).
    """
    import jax.numpy as jnp

    n, rest = len(motion), ((0, 0),) * (matrix.ndim - 2)
    more = motion.shape[1] - (len(matrix) - n)
    half = product(matrix[:, :n], motion) + jnp.pad(matrix[:, n:], ((0, 0), (more, 0), *rest))
    below = jnp.pad(half[n:], ((more, 0), (0, 0), *rest))
    return product(jnp.swapaxes(motion, 0, 1), half[:n]) + below


def quadratic(hessian: Any, gradient: Any, jacobian: Any, curvature: Any, pull: Any) -> Any:
    """H + J' diag(curvature) J bordered by g - J' pull, (L + 1, L + 1, ...).

    Parameters
    ----------
    hessian, gradient : (L, L, ...) and (L, ...).
    jacobian : (rows, L, ...).
    curvature, pull : (rows, ...).
    """
    for j in range(jacobian.shape[0]):
        row = jacobian[j]
        hessian = hessian + (curvature[j] * row)[:, None] * row[None]
        gradient = gradient - pull[j] * row
    return bordered(hessian, gradient)


def bordered(hessian: Any, gradient: Any) -> Any:
    """Symmetric matrix of a quadratic, its constant 0."""
    import jax.numpy as jnp

    below = jnp.concatenate([gradient, jnp.zeros_like(gradient[:1])])[None]
    return jnp.concatenate([jnp.concatenate([hessian, gradient[:, None]], axis=1), below])


def spread(matrix: Any, places: Sequence[int], size: int) -> Any:
    """Take a quadratic as one of ``size`` - 1 variables, of which it sees those at ``places``."""
    import jax.numpy as jnp

    where = [len(matrix)] * size  # the row of zeros that is appended
    for own, place in enumerate(places):
        where[place] = own
    found = jnp.pad(matrix, [(0, 1), (0, 1), *[(0, 0)] * (matrix.ndim - 2)])
    order = jnp.array(where)
    return found[order][:, order]


def shifted(matrix: Any, diagonal: Sequence[float], weight: Any) -> Any:
    """Add a weight (B,) times a diagonal to matrices (L, L, ..., B)."""
    import jax.numpy as jnp

    where = jnp.diag(jnp.asarray(diagonal, dtype=float))
    return matrix + where.reshape(*where.shape, *(1,) * (matrix.ndim - 2)) * weight
