"""The MPC problem as a stage-wise value, and the numbers of one instance.

`wideberth.framework.mpc.assembly` builds it from a robot and a region; every solver's form is
derived from it.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from hashlib import sha256
from typing import Any

import numpy as np

from ...numerics.symbolic import Mapped, ca
from ...programs.evaluate import ColumnFunctions
from ...region import Auxiliary
from ...robot import Bounds
from ...values.arrays import Array


@dataclass(frozen=True, eq=False)
class Slots:
    """Room for things of one kind that the robot keeps clear of, see `slots.base.SlotKind`.

    The numbers of one slot stand in the order: parameters (width), its level (1, of kinds with
    levels alone), whether it is active (1), the guess of its auxiliaries (A).

    Attributes
    ----------
    name : of one such thing: a word that can be part of a name in C.
    count : how many slots.
    width : parameters of each.
    levelled : whether each has a level among its numbers.
    auxiliary : extra variables of each per stage, of all bodies of the robot.
    constraint : of one slot: (x, its auxiliaries, s, its numbers) -> inequalities >= 0,
        equalities == 0; s is empty where no level is shared. An inactive slot states 1 >= 0.
    """

    name: str
    count: int
    width: int
    levelled: bool
    auxiliary: Auxiliary
    constraint: Any

    @cached_property
    def inequalities(self) -> int:
        """How many inequalities one slot has."""
        return int(self.constraint.size1_out(0))

    @cached_property
    def own(self) -> int:
        """How many extra variables one slot has."""
        return len(self.auxiliary)

    @property
    def size(self) -> int:
        """How many numbers one slot has."""
        return self.guess + len(self.auxiliary)

    @property
    def active(self) -> int:
        """Where among the numbers of a slot 1 (used) or 0 (empty) stands."""
        return self.width + int(self.levelled)

    @property
    def guess(self) -> int:
        """Where among them the guess of its auxiliaries begins."""
        return self.active + 1

    def all_of(self, x: Any, lifted: Any, s: Any, numbers: Any) -> tuple[Any, Any]:
        """State the constraints of all slots: inequalities and equalities, slot by slot.

        Parameters
        ----------
        x, s : state and shared level.
        lifted : auxiliaries of all slots, one after the other.
        numbers : of all slots, one after the other.
        """
        own, size = len(self.auxiliary), self.size
        found = [
            self.constraint(
                x, lifted[k * own : (k + 1) * own], s, numbers[k * size : (k + 1) * size]
            )
            for k in range(self.count)
        ]
        return ca.vertcat(*[one[0] for one in found]), ca.vertcat(*[one[1] for one in found])

    def regularisation(self, lifted: Any, numbers: Any) -> Any:
        """Price of leaving the guess of the auxiliaries, of all slots."""
        own, size = len(self.auxiliary), self.size
        if not own:
            return 0
        guesses = [numbers[(k + 1) * size - own : (k + 1) * size] for k in range(self.count)]
        return self.auxiliary.regularisation * ca.sumsqr(lifted - ca.vertcat(*guesses))


@dataclass(frozen=True, eq=False)
class Problem:
    """A stage-wise optimal control problem; every solver's form is derived from it.

    Its functions take and return CasADi expressions. The parameters of stage i = 1..N are a
    vector: a head of reference position (D), reference direction (D), reference speed (1) and
    what the cost has of the path (C), then the numbers of every slot, kind by kind, see `Slots`.

    Attributes
    ----------
    horizon, dt : N and s.
    states, inputs, dimension : n, m, D.
    curve : C, numbers of the path that the cost needs of a stage.
    shared : whether one level s is a decision variable.
    minimum : its lower bound.
    penalty : price of one unit of slack on the regions; None for hard constraints.
    state_bounds, input_bounds : of the robot.
    dynamics : (x, u) -> next x.
    input_cost : (x, u, head of i + 1), at i = 0..N-1.
    input_constraints : (x, u) -> values >= 0, at i = 0..N-1.
    state_cost : (x, head), at i = 1..N.
    state_constraints : x -> values >= 0, at i = 1..N.
    terminal_constraints : x -> values >= 0, at i = N alone.
    level_cost : (s, s_ref) -> cost, once.
    slots : of each kind of things to keep clear of; their constraints hold at i = 1..N.
    heading : which state is the robot's heading, an angle that may be shifted by full turns;
        None where there is none.
    """

    horizon: int
    dt: float
    states: int
    inputs: int
    dimension: int
    curve: int
    shared: bool
    minimum: float
    penalty: float | None
    state_bounds: Bounds
    input_bounds: Bounds
    dynamics: Any
    input_cost: Any
    input_constraints: Any
    state_cost: Any
    state_constraints: Any
    terminal_constraints: Any
    level_cost: Any
    slots: tuple[Slots, ...]
    heading: int | None

    @property
    def head_width(self) -> int:
        """Number of parameters of one stage that belong to no slot."""
        return 2 * self.dimension + 1 + self.curve

    @property
    def stage_width(self) -> int:
        """Number of parameters of one stage."""
        return self.head_width + sum(one.count * one.size for one in self.slots)

    @property
    def slacks(self) -> int:
        """Slack variables per stage: 1 where the regions are soft, else 0."""
        return int(self.penalty is not None and any(one.count for one in self.slots))

    @cached_property
    def no_auxiliaries(self) -> tuple[Array, ...]:
        """Auxiliaries of each kind of slots where no slot has any, (N, K, 0); else ()."""
        if any(len(one.auxiliary) for one in self.slots):
            return ()
        return tuple(np.zeros((self.horizon, one.count, 0)) for one in self.slots)

    @cached_property
    def levels_alone(self) -> bool:
        """Whether no slot with a level has auxiliaries: at any level the same point is held."""
        return not any(one.levelled and len(one.auxiliary) for one in self.slots)

    @cached_property
    def ends_at_rest(self) -> bool:
        """Whether the last state has constraints of its own."""
        return bool(self.terminal_constraints.size1_out(0))

    def cut(self, stage: Any) -> tuple[Any, list[Any]]:
        """Cut a stage's parameters: the head, and the numbers of the slots of each kind."""
        begin, pieces = self.head_width, []
        for one in self.slots:
            pieces.append(stage[begin : begin + one.count * one.size])
            begin += one.count * one.size
        return stage[: self.head_width], pieces

    @cached_property
    def stage_costs(self) -> Mapped:
        """Cost of all steps at once, without level and slack, for pricing a plan without a solver.

        (x_i, u_i, x_{i+1}, stage parameters, auxiliaries of each kind of slots), one row per step
        -> (N, 1).
        """
        x, u, following = (
            ca.SX.sym("x", self.states),
            ca.SX.sym("u", self.inputs),
            ca.SX.sym("next", self.states),
        )
        lifted = [ca.SX.sym("auxiliary", one.count * len(one.auxiliary)) for one in self.slots]
        stage = ca.SX.sym("stage", self.stage_width)
        head, numbers = self.cut(stage)
        cost = self.input_cost(x, u, head) + self.state_cost(following, head)
        for one, own, given in zip(self.slots, lifted, numbers, strict=True):
            cost += one.regularisation(own, given)
        single = ca.Function("stage_costs", [x, u, following, stage, *lifted], [cost])
        return Mapped(single.map(self.horizon))

    @cached_property
    def constraint_values(self) -> ColumnFunctions:
        """Constraints at many columns: `motion` of a step, and `slotK` of one slot of kind K.

        ``motion`` is of (x_i, u_i, x_{i+1}): gaps of the dynamics, then robot limits (>= 0) and
        room to each finite bound of x_{i+1} and u_i (>= 0); ``slotK`` of (x, auxiliaries, s) and
        the numbers of a slot: inequalities, then equalities.
        """
        return ColumnFunctions(self.constraint_functions)

    @property
    def constraint_functions(self) -> dict[str, Any]:
        """Functions of two vectors, by name, which `constraint_values` evaluates."""
        x, u, following = (
            ca.SX.sym("x", self.states),
            ca.SX.sym("u", self.inputs),
            ca.SX.sym("next", self.states),
        )
        rows = ca.vertcat(
            following - self.dynamics(x, u),
            self.input_constraints(x, u),
            self.state_constraints(following),
            self._room(following, u),
        )
        none = ca.SX.sym("none", 0)
        functions = {"motion": _of_two(ca.vertcat(x, u, following), none, rows)}
        s = ca.SX.sym("s", int(self.shared))
        for k, one in enumerate(self.slots):
            if one.count:
                own = ca.SX.sym("auxiliary", len(one.auxiliary))
                numbers = ca.SX.sym("numbers", one.size)
                stated = ca.vertcat(*one.constraint(following, own, s, numbers))
                given = ca.vertcat(following, own, s)
                functions[f"slot{k}"] = _of_two(given, numbers, stated)
        return functions

    @cached_property
    def stop_values(self) -> Mapped:
        """`terminal_constraints` of an array, (1, n)."""
        return Mapped(self.terminal_constraints)

    def _room(self, x: Any, u: Any) -> Any:
        """How far a state and an input are from each of their finite bounds."""
        rows = [ca.SX(0, 1)]
        for values, bounds in ((x, self.state_bounds), (u, self.input_bounds)):
            for i, (lower, upper) in enumerate(zip(bounds.lower, bounds.upper, strict=True)):
                rows += [values[i] - lower] * bool(np.isfinite(lower))
                rows += [upper - values[i]] * bool(np.isfinite(upper))
        return ca.vertcat(*rows)

    @cached_property
    def stage_key(self) -> str:
        """Hash of the expressions: of every stage function, whatever horizon and slots."""
        functions = (
            self.dynamics,
            self.input_cost,
            self.input_constraints,
            self.state_cost,
            self.state_constraints,
            self.terminal_constraints,
            self.level_cost,
            *(one.constraint for one in self.slots),
        )
        text = [function.serialize() for function in functions]
        return sha256("\n".join(text).encode()).hexdigest()

    @cached_property
    def key(self) -> str:
        """Hash of the expressions and bounds: what a compiled problem is cached under."""
        slots = [(own.count, own.width, own.levelled, own.auxiliary) for own in self.slots]
        numbers = (self.horizon, self.shared, self.minimum, self.penalty, slots, self.heading)
        text = repr((self.stage_key, numbers, self.state_bounds, self.input_bounds))
        return sha256(text.encode()).hexdigest()


def _of_two(v: Any, p: Any, result: Any) -> Any:
    return ca.Function("kernel", [v, p], [ca.densify(result)])


@dataclass(frozen=True, eq=False)
class SlotNumbers:
    """Numbers of the slots of one kind in one instance.

    Attributes
    ----------
    parameters : (N, K, P), finite also in empty slots.
    active : (K,), 1 where a slot is used, 0 where it is empty.
    auxiliaries : (N, K, A), guess that the regularisation pulls towards.
    level : (N, K), of kinds with levels; None for the others.
    """

    parameters: Array
    active: Array
    auxiliaries: Array
    level: Array | None = None

    @staticmethod
    @lru_cache(maxsize=16)
    def none(steps: int, width: int = 0, *, levelled: bool = False) -> "SlotNumbers":
        """No slot at all."""
        empty = np.zeros((steps, 0, width))
        level = np.zeros((steps, 0)) if levelled else None
        return SlotNumbers(empty, np.zeros(0), np.zeros((steps, 0, 0)), level)

    def ending_in(self, last: Array | None) -> "SlotNumbers":
        """Return the same with other parameters (K, P) at step N; with None these."""
        if last is None:
            return self
        return replace(self, parameters=np.concatenate([self.parameters[:-1], last[None]]))

    def stages(self) -> Array:
        """Numbers of all slots, slot by slot in the order of `Slots`, (N, K size)."""
        steps, count = self.parameters.shape[:2]
        active = np.broadcast_to(self.active, (steps, count))
        level = [] if self.level is None else [self.level[..., None]]
        pieces = [self.parameters, *level, active[..., None], self.auxiliaries]
        return np.concatenate(pieces, axis=2).reshape(steps, -1)

    @cached_property
    def columns(self) -> Array:
        """The same with a column for each step and slot, (size, N K)."""
        steps, count, width = self.parameters.shape
        levels, own = int(self.level is not None), self.auxiliaries.shape[2]
        found = np.empty((width + levels + 1 + own, steps, count))
        found[:width] = self.parameters.transpose(2, 0, 1)
        if self.level is not None:
            found[width] = self.level
        found[width + levels] = self.active
        found[width + levels + 1 :] = self.auxiliaries.transpose(2, 0, 1)
        return found.reshape(len(found), -1)

    def columns_at(self, shares: Array) -> Array:
        """`columns` at each of S shares of the levels, one after the other, (size, S N K)."""
        found = np.repeat(self.columns[:, None], len(shares), axis=1)
        if self.level is not None:
            found[self.parameters.shape[2]] = shares[:, None] * self.level.ravel()
        return found.reshape(len(found), -1)


@dataclass(frozen=True, eq=False)
class Parameters:
    """Numbers of one instance of a `Problem`.

    Attributes
    ----------
    initial : (n,), the state x_0.
    reference : (N, D), m.
    direction : (N, D), unit tangents of the path.
    speed : (N,), m/s.
    slots : numbers of the slots of each kind, in the problem's order.
    curve : (N, C), numbers of the path that the cost needs; (0, 0) where it needs none.
    """

    initial: Array
    reference: Array
    direction: Array
    speed: Array
    slots: tuple[SlotNumbers, ...]
    curve: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def stages(self) -> Array:
        """Stage parameters in the problem's order, (N, stage_width); not to be written to."""
        return self._stages

    @cached_property
    def _stages(self) -> Array:
        found = np.concatenate([self.heads(), *(one.stages() for one in self.slots)], axis=1)
        found.setflags(write=False)
        return found

    def heads(self) -> Array:
        """Parameters of each stage that belong to no slot, (N, head_width)."""
        curve = self.curve.reshape(len(self.speed), -1)
        pieces = [self.reference, self.direction, self.speed[:, None], curve]
        return np.concatenate(pieces, axis=1)

    @cached_property
    def target(self) -> float:
        """s_ref, the level that a shared level is drawn to: the mean of all; 0 without any."""
        levels = [one.level[:, one.active > 0] for one in self.slots if one.level is not None]
        if not levels:
            return 0.0
        used = levels[0] if len(levels) == 1 else np.concatenate(levels, axis=1)
        return float(np.add.reduce(used, axis=None) / used.size) if used.size else 0.0
