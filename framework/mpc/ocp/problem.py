"""The MPC problem as a stage-wise value, and the numbers of one instance.

`wideberth.framework.mpc.assembly` builds it from a robot and a region; every solver's form is
derived from it.
"""

from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from typing import Any

import numpy as np

from ...numerics.symbolic import ca
from ...region import Auxiliary
from ...robot import Bounds
from ...values.arrays import Array


@dataclass(frozen=True, eq=False)
class Slots:
    """Room for obstacles of one kind: Gaussian ones, or static convex polygons.

    The numbers of one slot stand in the order: parameters (width), its level (1, Gaussian ones
    alone), whether it is active (1), the guess of its auxiliaries (A).

    Attributes
    ----------
    count : how many.
    width : parameters of each.
    levelled : whether each has a level among its numbers.
    auxiliary : extra variables of each per stage, of all bodies of the robot.
    constraint : of one slot: (x, its auxiliaries, s, its numbers) -> inequalities >= 0,
        equalities == 0; s is empty where no level is shared. An inactive slot states 1 >= 0.
    """

    count: int
    width: int
    levelled: bool
    auxiliary: Auxiliary
    constraint: Any

    @property
    def size(self) -> int:
        """How many numbers one slot has."""
        return self.width + int(self.levelled) + 1 + len(self.auxiliary)

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
    what the cost has of the path (C), then the numbers of every slot for a Gaussian obstacle,
    then those of every slot for a static polygon, see `Slots`.

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
    obstacles, statics : slots, whose constraints hold at i = 1..N.
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
    obstacles: Slots
    statics: Slots
    heading: int | None

    @property
    def capacity(self) -> int:
        """K, slots for Gaussian obstacles."""
        return self.obstacles.count

    @property
    def auxiliary(self) -> Auxiliary:
        """Extra variables per Gaussian slot and stage."""
        return self.obstacles.auxiliary

    @property
    def head_width(self) -> int:
        """Number of parameters of one stage that belong to no slot."""
        return 2 * self.dimension + 1 + self.curve

    @property
    def stage_width(self) -> int:
        """Number of parameters of one stage."""
        moving, standing = self.obstacles, self.statics
        return self.head_width + moving.count * moving.size + standing.count * standing.size

    @property
    def slacks(self) -> int:
        """Slack variables per stage: 1 where the regions are soft, else 0."""
        return int(self.penalty is not None and self.capacity + self.statics.count > 0)

    def cut(self, stage: Any) -> tuple[Any, Any, Any]:
        """Cut a stage's parameters: head, numbers of the obstacles, numbers of the polygons."""
        first = self.head_width
        second = first + self.obstacles.count * self.obstacles.size
        return stage[:first], stage[first:second], stage[second:]

    @cached_property
    def residuals(self) -> Any:
        """All steps at once, for re-checking and pricing a plan without a solver.

        (x_i, u_i, x_{i+1}, auxiliaries, static auxiliaries, s, stage parameters), one column
        per step -> gaps of the dynamics, robot limits (>= 0), region inequalities, region
        equalities, the same two of the static polygons, and the cost without level and slack.
        """
        x, u, following = (
            ca.SX.sym("x", self.states),
            ca.SX.sym("u", self.inputs),
            ca.SX.sym("next", self.states),
        )
        auxiliary = ca.SX.sym("auxiliary", self.capacity * len(self.auxiliary))
        still = ca.SX.sym("static", self.statics.count * len(self.statics.auxiliary))
        s, stage = ca.SX.sym("s", int(self.shared)), ca.SX.sym("stage", self.stage_width)
        gap = following - self.dynamics(x, u)
        limits = ca.vertcat(self.input_constraints(x, u), self.state_constraints(following))
        head, moving, standing = self.cut(stage)
        outside, tied = self.obstacles.all_of(following, auxiliary, s, moving)
        clear, bound = self.statics.all_of(following, still, s, standing)
        cost = self.input_cost(x, u, head) + self.state_cost(following, head)
        cost += self.obstacles.regularisation(auxiliary, moving)
        cost += self.statics.regularisation(still, standing)
        single = ca.Function(
            "residuals",
            [x, u, following, auxiliary, still, s, stage],
            [gap, limits, outside, tied, clear, bound, cost],
        )
        return single.map(self.horizon)

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
            self.obstacles.constraint,
            self.statics.constraint,
        )
        text = [function.serialize() for function in functions]
        return sha256("\n".join(text).encode()).hexdigest()

    @cached_property
    def key(self) -> str:
        """Hash of the expressions and bounds: what a compiled problem is cached under."""
        slots = [
            (own.count, own.width, own.levelled, own.auxiliary)
            for own in (self.obstacles, self.statics)
        ]
        numbers = (self.horizon, self.shared, self.minimum, self.penalty, slots, self.heading)
        text = repr((self.stage_key, numbers, self.state_bounds, self.input_bounds))
        return sha256(text.encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class Parameters:
    """Numbers of one instance of a `Problem`.

    Attributes
    ----------
    initial : (n,), the state x_0.
    reference : (N, D), m.
    direction : (N, D), unit tangents of the path.
    speed : (N,), m/s.
    regions : (N, K, P), finite also in inactive slots.
    level : (N, K); where the level is shared, its mean is s_ref.
    active : (K,), 1 or 0.
    auxiliaries : (N, K, A), guess that the regularisation pulls towards.
    statics : (N, S, P_s), parameters of static polygons, finite also in inactive slots.
    static_active : (S,), 1 or 0.
    static_auxiliaries : (N, S, A_s), guess.
    curve : (N, C), numbers of the path that the cost needs; (0, 0) where it needs none.
    """

    initial: Array
    reference: Array
    direction: Array
    speed: Array
    regions: Array
    level: Array
    active: Array
    auxiliaries: Array
    statics: Array
    static_active: Array
    static_auxiliaries: Array
    curve: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def stages(self) -> Array:
        """Stage parameters in the problem's order, (N, stage_width)."""
        steps, slots = self.level.shape
        active = np.broadcast_to(self.active, (steps, slots))
        packed = np.concatenate(
            [self.regions, self.level[..., None], active[..., None], self.auxiliaries], axis=2
        )
        on = np.broadcast_to(self.static_active, self.statics.shape[:2])[..., None]
        walls = np.concatenate([self.statics, on, self.static_auxiliaries], axis=2)
        slots_of = [packed.reshape(steps, -1), walls.reshape(steps, -1)]
        return np.concatenate([self.heads(), *slots_of], axis=1)

    def heads(self) -> Array:
        """Parameters of each stage that belong to no slot, (N, head_width)."""
        curve = self.curve.reshape(len(self.speed), -1)
        pieces = [self.reference, self.direction, self.speed[:, None], curve]
        return np.concatenate(pieces, axis=1)

    @property
    def target(self) -> float:
        """s_ref, the level that a shared level is drawn to; 0 without obstacles."""
        used = self.level[:, self.active > 0]
        return float(used.mean()) if used.size else 0.0
