"""The MPC problem as a stage-wise value, and the numbers of one instance.

`wideberth.framework.mpc.assembly` builds it from a robot and a region; every solver's form is
derived from it.
"""

from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from typing import Any

import numpy as np

from ..arrays import Array
from ..region import Auxiliary
from ..robot import Bounds
from ..symbolic import ca


@dataclass(frozen=True)
class Slots:
    """Room for static polygons in a problem.

    Attributes
    ----------
    count : how many convex polygons.
    width : parameters of each.
    auxiliary : extra variables of each per stage, of all bodies of the robot.
    """

    count: int
    width: int
    auxiliary: Auxiliary


@dataclass(frozen=True, eq=False)
class Problem:
    """A stage-wise optimal control problem; every solver's form is derived from it.

    Its functions take and return CasADi expressions. Per stage i = 1..N the parameters are
    a vector: reference position (D), reference direction (D), reference speed (1), per
    obstacle slot the region's parameters (P), its level (1), whether it is active (1), and
    the guess of its auxiliaries (A), and per slot for a static polygon the same without level.

    Attributes
    ----------
    horizon, dt : N and s.
    states, inputs, dimension : n, m, D.
    capacity : K, obstacle slots; an inactive slot constrains nothing.
    width : P, parameters of a region.
    auxiliary : extra variables per slot and stage, of all bodies of the robot.
    shared : whether one level s is a decision variable.
    minimum : its lower bound.
    penalty : price of one unit of slack on the regions; None for hard constraints.
    state_bounds, input_bounds : of the robot.
    dynamics : (x, u) -> next x.
    input_cost : (x, u, stage parameters of i + 1), at i = 0..N-1.
    input_constraints : (x, u) -> values >= 0, at i = 0..N-1.
    state_cost : (x, auxiliaries, static auxiliaries, stage parameters), at i = 1..N.
    state_constraints : x -> values >= 0, at i = 1..N.
    regions : (x, auxiliaries, s, stage parameters) -> inequalities >= 0, equalities == 0.
    statics : slots for static polygons.
    static_regions : (x, static auxiliaries, stage parameters) -> the same; all hold at
        i = 1..N.
    level_cost : (s, s_ref) -> cost, once.
    """

    horizon: int
    dt: float
    states: int
    inputs: int
    dimension: int
    capacity: int
    width: int
    auxiliary: Auxiliary
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
    regions: Any
    level_cost: Any
    statics: Slots
    static_regions: Any

    @property
    def stage_width(self) -> int:
        """Number of parameters of one stage."""
        per_slot = self.width + 2 + len(self.auxiliary)
        still = self.statics.count * (self.statics.width + 1 + len(self.statics.auxiliary))
        return 2 * self.dimension + 1 + self.capacity * per_slot + still

    @property
    def slacks(self) -> int:
        """Slack variables per stage: 1 where the regions are soft, else 0."""
        return int(self.penalty is not None and self.capacity + self.statics.count > 0)

    @cached_property
    def residuals(self) -> Any:
        """All steps checked at once, for re-checking a plan without a solver.

        (x_i, u_i, x_{i+1}, auxiliaries, static auxiliaries, s, stage parameters), one column
        per step -> gaps of the dynamics, robot limits (>= 0), region inequalities, region
        equalities, and the same two of the static polygons.
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
        outside, tied = self.regions(following, auxiliary, s, stage)
        clear, bound = self.static_regions(following, still, stage)
        single = ca.Function(
            "residuals",
            [x, u, following, auxiliary, still, s, stage],
            [gap, limits, outside, tied, clear, bound],
        )
        return single.map(self.horizon)

    @cached_property
    def key(self) -> str:
        """Hash of the expressions and bounds: what a compiled problem is cached under."""
        functions = (
            self.dynamics,
            self.input_cost,
            self.input_constraints,
            self.state_cost,
            self.state_constraints,
            self.regions,
            self.level_cost,
            self.static_regions,
        )
        text = [function.serialize() for function in functions]
        numbers = (
            self.horizon,
            self.shared,
            self.minimum,
            self.penalty,
            self.auxiliary,
            self.statics,
        )
        text.append(repr((numbers, self.state_bounds, self.input_bounds)))
        return sha256("\n".join(text).encode()).hexdigest()


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

    def stages(self) -> Array:
        """Stage parameters in the problem's order, (N, stage_width)."""
        steps, slots = self.level.shape
        active = np.broadcast_to(self.active, (steps, slots))
        packed = np.concatenate(
            [self.regions, self.level[..., None], active[..., None], self.auxiliaries], axis=2
        )
        on = np.broadcast_to(self.static_active, self.statics.shape[:2])[..., None]
        walls = np.concatenate([self.statics, on, self.static_auxiliaries], axis=2)
        head = [self.reference, self.direction, self.speed[:, None]]
        slots_of = [packed.reshape(steps, -1), walls.reshape(steps, -1)]
        return np.concatenate([*head, *slots_of], axis=1)

    @property
    def target(self) -> float:
        """s_ref, the level that a shared level is drawn to; 0 without obstacles."""
        used = self.level[:, self.active > 0]
        return float(used.mean()) if used.size else 0.0
