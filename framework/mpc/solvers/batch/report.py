"""What is reported of a batch's iterates."""

from typing import Any

from ..riccati.kernels import slot_name
from .evaluation import evaluate
from .iterate import Instances, Iterate
from .optimality import largest
from .program import Program


def report(program: Program, given: Instances, at: Iterate) -> dict[str, Any]:
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
        values = primal.lifted.get(slot_name(k), none)
        lifted[f"auxiliaries{k}"] = jnp.transpose(values, (3, 1, 2, 0))
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
