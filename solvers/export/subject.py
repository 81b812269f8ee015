"""What is exported, and how the example evaluates it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...framework.mpc.costs.base import Cost
from ...framework.mpc.ocp.problem import Parameters, Problem
from ...framework.mpc.ocp.transcription import Guess
from ...framework.mpc.slots.base import SlotKind
from ...framework.robot import Robot
from ...framework.values.arrays import Array
from .layout import Define, Layout, identifiers
from .routines import Routine, flat_routines, stage_routines


@dataclass(frozen=True, eq=False)
class Subject:
    """A problem, one instance of it, and what its numbers are called.

    Attributes
    ----------
    problem : what is exported.
    parameters, guess : the instance that the example evaluates, and near where.
    robot, kinds, cost : the plug-ins that the problem was assembled from; they
        give names, units and descriptions alone.
    config : the planner's resolved config.
    source : name of the config and of the planner in it.
    """

    problem: Problem
    parameters: Parameters
    guess: Guess
    robot: Robot
    kinds: tuple[SlotKind, ...]
    cost: Cost
    config: Mapping[str, Any]
    source: str

    @cached_property
    def layout(self) -> Layout:
        """Where everything stands."""
        return Layout(self.problem, self.parameters)

    @cached_property
    def entries(self) -> list[Define]:
        """What each entry of states and inputs is, with its unit."""
        kinds = (
            ("STATE", self.robot.states, self.problem.states),
            ("INPUT", self.robot.inputs, self.problem.inputs),
        )
        found: list[Define] = []
        for kind, quantities, count in kinds:
            names = [quantity.name for quantity in quantities][:count]
            units = [quantity.unit for quantity in quantities][:count]
            further = count - len(names)  # what the problem adds to the robot's own
            names += [f"extra {i}" for i in range(further)]
            units += ["-"] * further
            for i, (one, unit) in enumerate(zip(identifiers(names), units, strict=True)):
                found.append((f"{kind}_{one}", i, unit))
        return found

    @cached_property
    def stage(self) -> list[Routine]:
        """The functions of one stage."""
        return stage_routines(self.problem)

    @cached_property
    def flat(self) -> list[Routine]:
        """The functions of the whole NLP."""
        return flat_routines(self.layout.form)

    @cached_property
    def variables(self) -> Array:
        """The NLP's variables near the guess, moved so that no gap or slack is zero by chance."""
        guess = self.layout.form.pack(self.guess)
        return guess + 0.01 * (1.0 + np.sin(np.arange(len(guess))))

    @cached_property
    def point(self) -> Guess:
        """The same, in pieces."""
        return self.layout.form.unpack(self.variables, self.parameters)

    @cached_property
    def numbers(self) -> Array:
        """The NLP's parameters of the instance."""
        return self.layout.form.parameters(self.parameters)

    @cached_property
    def multipliers(self) -> Array:
        """Weights of the rows in the example's Hessians: no two neighbours are alike."""
        return 0.5 + np.arange(len(self.layout.form.row_lower)) % 7 / 8.0

    def values(self, routine: Routine) -> Array:
        """Evaluate a function of one stage at (x_1, u_0), or one of the NLP, in CasADi."""
        given = [self.argument(routine, name) for name in routine.arguments]
        return np.array(routine.function(*given).nonzeros(), dtype=np.float64)

    def argument(self, routine: Routine, name: str) -> Array:
        """Numbers that the example hands to one argument of a function."""
        problem, flat = self.problem, self.variables
        names = [one.name for one in problem.slots]
        kind = names.index(routine.slots) if routine.slots else 0
        stage = self.numbers[problem.states + 1 :][: problem.stage_width]
        rows = routine.function.size1_in(len(routine.arguments) - 1)
        simple: dict[str, Callable[[], Array]] = {
            "state": lambda: self.point.states[1],
            "input": lambda: self.point.inputs[0],
            "head": lambda: stage[: problem.head_width],
            "auxiliary": lambda: self.point.auxiliaries[kind][0, 0],
            "level": lambda: flat[: int(problem.shared)],
            "numbers": lambda: problem.cut(stage)[1][kind][: problem.slots[kind].size],
            "target": lambda: self.numbers[problem.states : problem.states + 1],
            "weights": lambda: self.multipliers[:rows],
            "variables": lambda: flat,
            "parameters": lambda: self.numbers,
            "weight": lambda: np.ones(1),
            "multipliers": lambda: self.multipliers,
        }
        return np.asarray(simple[name]())
