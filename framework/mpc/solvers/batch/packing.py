"""From lists of instances to the arrays of a batch, and back."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ....values.arrays import Array
from ...ocp.problem import Parameters
from ...ocp.transcription import Guess
from ..base import unwrapped
from .iterate import Instances, Primal
from .program import Kind, Program, pushed


def packed(
    program: Program, parameters: Sequence[Parameters], guesses: Sequence[Guess], push: float
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


def _started(program: Program, guesses: Sequence[Guess], push: float) -> Primal:
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
