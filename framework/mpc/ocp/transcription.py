"""From the stage-wise problem to the flat vectors that NLP solvers take.

The paper defines the set of step k+i+1 by the state of step k+i, an index slip that would hold
each region one step late; here the regions of step i restrict x_i.

Variables stand stage by stage, (x_0, u_0), (x_1, u_1, aux_1, slack_1), ..., (x_N, aux_N,
slack_N), and so do the constraints, which is the order that structure-exploiting solvers
need. Two forms differ in little:

- ``flat``: x_0 is a parameter and the level s one variable in front (IPOPT);
- ``staged``: x_0 is a variable and s a constant state, so that every constraint touches
  only neighbouring stages (fatrop).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...numerics.symbolic import ca
from ...values.arrays import Array
from .problem import Parameters, Problem, Slots


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Lagrange multipliers of a solution, as the solver that found them lays them out.

    Attributes
    ----------
    steps : (N, P), of dynamics, bounds and limits at each step.
    slots : (N, K, C) of each kind; NaN where nothing is known of a slot.
    """

    steps: Array
    slots: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class Guess:
    """A starting point, or a solution, of a problem.

    Attributes
    ----------
    states : (N + 1, n). inputs : (N, m).
    auxiliaries : (N, K, A) of the slots of each kind; () before they are filled in.
    level : the shared level; ignored where there is none.
    slack : (N,), of soft regions; ignored where they are hard.
    multipliers : of a solution that is near; None where none is known. Solvers that start from
        states and inputs alone ignore them.
    """

    states: Array
    inputs: Array
    auxiliaries: tuple[Array, ...]
    level: float
    slack: Array
    multipliers: Multipliers | None = None

    @classmethod
    def bare(cls, states: Array, inputs: Array, level: float) -> "Guess":
        """Wrap a trajectory; `slots.base.with_auxiliaries` fills in auxiliaries later."""
        return cls(states, inputs, (), level, np.zeros(len(inputs)))

    def pull(self, parameters: Parameters) -> Parameters:
        """Let the regularisation of an instance pull towards the auxiliaries of this guess."""
        pairs = zip(parameters.slots, self.auxiliaries, strict=True)
        return replace(
            parameters, slots=tuple(replace(one, auxiliaries=own) for one, own in pairs)
        )


class Transcription:
    """The NLP of a problem: symbols, bounds, and how to pack and unpack it.

    Parameters
    ----------
    problem : what to transcribe.
    staged : the form, see above.
    symbol : ``ca.SX`` or ``ca.MX``. The paper's program is built on MX; on SX the same
        functions are evaluated about twice as fast. The stage functions inside are SX in
        either form: MX operations throughout, as the paper has them, are slower still.
    """

    def __init__(self, problem: Problem, *, staged: bool, symbol: Any) -> None:
        self.problem: Problem = problem
        self.staged: bool = staged
        self._symbol = symbol
        self._variables: list[Any] = []
        self._rows: list[Any] = []
        self.lower: list[float] = []
        self.upper: list[float] = []
        self.row_lower: list[float] = []
        self.row_upper: list[float] = []
        self.sizes: list[tuple[int, int, int]] = []
        self._where: dict[tuple[str, int], slice] = {}
        self._build()

    def nlp(self) -> dict[str, Any]:
        """Return the NLP as `casadi.nlpsol` takes it."""
        return {
            "x": ca.vertcat(*self._variables),
            "f": self._cost,
            "g": ca.vertcat(*self._rows),
            "p": self._parameters,
        }

    def pack(self, guess: Guess) -> Array:
        """Write a guess into the vector of variables."""
        flat = np.zeros(len(self.lower))
        horizon = self.problem.horizon
        for i in range(horizon + 1):
            pieces = {"x": guess.states[i], "s": [guess.level]}
            if i < horizon:
                pieces["u"] = guess.inputs[i]
            if i > 0:
                pieces["slack"] = guess.slack[i - 1 : i]
                for k, own in enumerate(guess.auxiliaries):
                    pieces[f"aux{k}"] = own[i - 1].ravel()
            for name, values in pieces.items():
                place = self._where.get((name, i))
                if place is not None:
                    flat[place] = values
        return flat

    def unpack(self, flat: Array, parameters: Parameters) -> Guess:
        """Read states, inputs, auxiliaries, level and slack out of the variables."""
        problem, horizon = self.problem, self.problem.horizon
        states = np.empty((horizon + 1, problem.states))
        states[0] = parameters.initial
        slack = np.zeros(horizon)
        auxiliaries = tuple(
            np.zeros((horizon, one.count, len(one.auxiliary))) for one in problem.slots
        )
        inputs = np.stack([flat[self._where["u", i]] for i in range(horizon)])
        for i in range(1, horizon + 1):
            states[i] = flat[self._where["x", i]]
            for k, own in enumerate(auxiliaries):
                if (f"aux{k}", i) in self._where:
                    own[i - 1] = flat[self._where[f"aux{k}", i]].reshape(own.shape[1:])
            if ("slack", i) in self._where:
                slack[i - 1] = flat[self._where["slack", i]][0]
        level = float(flat[self._where["s", 0]][0]) if problem.shared else float("nan")
        return Guess(states, inputs, auxiliaries, level, slack)

    def parameters(self, values: Parameters) -> Array:
        """Write the numbers of one instance into the vector of parameters."""
        head = [*values.initial, values.target]
        return np.concatenate([head, values.stages().ravel()])

    def _build(self) -> None:
        problem, horizon = self.problem, self.problem.horizon
        width = problem.stage_width
        initial = self._symbol.sym("x0", problem.states)
        target = self._symbol.sym("target")
        stages = self._symbol.sym("stages", width, horizon)
        self._parameters = ca.vertcat(initial, target, ca.vec(stages))
        levels = self._levels()
        states = [self._state(i, initial) for i in range(horizon + 1)]
        self._cost = problem.level_cost(levels[0], target)
        for i in range(horizon + 1):
            self._stage(i, states, levels, stages, initial)

    def _levels(self) -> list[Any]:
        """Make the symbol of the level at each stage: one for all, or one per stage."""
        count = int(self.problem.shared)
        if self.staged:
            return [self._symbol.sym(f"s{i}", count) for i in range(self.problem.horizon + 1)]
        single = self._symbol.sym("s", count)
        if count:
            self._add("s", 0, single, [self.problem.minimum], [np.inf])
        return [single] * (self.problem.horizon + 1)

    def _state(self, i: int, initial: Any) -> Any:
        if i == 0 and not self.staged:
            return initial
        return self._symbol.sym(f"x{i}", self.problem.states)

    def _stage(
        self, i: int, states: Sequence[Any], levels: Sequence[Any], stages: Any, initial: Any
    ) -> None:
        """Append the variables, constraints and cost of stage i."""
        problem, last = self.problem, self.problem.horizon
        bounds = problem.state_bounds
        before, rows = len(self.lower), len(self.row_lower)
        if i > 0 or self.staged:
            free = i == 0
            size = problem.states
            lower = [-np.inf] * size if free else bounds.lower
            self._add("x", i, states[i], lower, [np.inf] * size if free else bounds.upper)
        if self.staged and problem.shared:
            self._add("s", i, levels[i], [problem.minimum if i else -np.inf], [np.inf])
        state_size = len(self.lower) - before
        if i < last:
            control = self._symbol.sym(f"u{i}", problem.inputs)
            limits = problem.input_bounds
            self._add("u", i, control, limits.lower, limits.upper)
            self._dynamics(i, states, levels, control)
            if i == 0 and self.staged:
                self._equal(states[0] - initial)
            self._positive(problem.input_constraints(states[i], control))
            self._cost += problem.input_cost(states[i], control, problem.cut(stages[:, i])[0])
        if i > 0:
            self._outside(i, states[i], levels[i], stages[:, i - 1])
        self.sizes.append(
            (state_size, len(self.lower) - before - state_size, len(self.row_lower) - rows)
        )

    def _dynamics(
        self, i: int, states: Sequence[Any], levels: Sequence[Any], control: Any
    ) -> None:
        """Gap of the dynamics, x_{i+1} - f(x_i, u_i) = 0, and of the constant level."""
        gap = states[i + 1] - self.problem.dynamics(states[i], control)
        if self.staged and self.problem.shared:
            gap = ca.vertcat(gap, levels[i + 1] - levels[i])
        self._equal(gap)

    def _outside(self, i: int, state: Any, level: Any, stage: Any) -> None:
        """Variables, constraints and cost that come with the regions of stage i."""
        problem = self.problem
        lifted = [self._extra(f"aux{k}", i, one) for k, one in enumerate(problem.slots)]
        head, numbers = problem.cut(stage)
        parts = list(zip(problem.slots, lifted, numbers, strict=True))
        rows = [one.all_of(state, own, level, given) for one, own, given in parts]
        inequalities = ca.vertcat(*[outside for outside, _ in rows])
        equalities = ca.vertcat(*[tied for _, tied in rows])
        if problem.penalty is not None and problem.slacks:
            slack = self._symbol.sym(f"slack{i}")
            self._add("slack", i, slack, [0.0], [np.inf])
            inequalities = inequalities + slack
            self._cost += problem.penalty * slack
        self._positive(problem.state_constraints(state))
        if i == problem.horizon:
            self._positive(problem.terminal_constraints(state))
        self._positive(inequalities)
        self._equal(equalities)
        self._cost += problem.state_cost(state, head)
        for one, own, given in parts:
            self._cost += one.regularisation(own, given)

    def _extra(self, name: str, i: int, slots: Slots) -> Any:
        """Add the auxiliaries of all slots of a kind and return their symbol."""
        own = slots.auxiliary
        symbol = self._symbol.sym(f"{name}_{i}", slots.count * len(own))
        if symbol.numel():
            self._add(name, i, symbol, own.lower * slots.count, own.upper * slots.count)
        return symbol

    def _add(
        self, name: str, i: int, symbol: Any, lower: Sequence[float], upper: Sequence[float]
    ) -> None:
        begin = len(self.lower)
        self._variables.append(symbol)
        self.lower += list(lower)
        self.upper += list(upper)
        self._where[name, i] = slice(begin, len(self.lower))

    def _equal(self, rows: Any) -> None:
        self._rows.append(rows)
        self.row_lower += [0.0] * rows.numel()
        self.row_upper += [0.0] * rows.numel()

    def _positive(self, rows: Any) -> None:
        self._rows.append(rows)
        self.row_lower += [0.0] * rows.numel()
        self.row_upper += [np.inf] * rows.numel()
