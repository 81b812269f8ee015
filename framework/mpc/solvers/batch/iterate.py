"""Arrays of a batch while it is solved. The last axis of each is the instance, B."""

from collections.abc import Mapping
from typing import Any, NamedTuple


class Instances(NamedTuple):
    """Numbers of the instances.

    Attributes
    ----------
    initial : (n, B).
    head : (H, N, B), of stages 1..N.
    target : (B,).
    numbers : kind -> (size, N, K, B), of every slot.
    active : kind -> (K, B), 1 or 0.
    """

    initial: Any
    head: Any
    target: Any
    numbers: Mapping[str, Any]
    active: Mapping[str, Any]


class Primal(NamedTuple):
    """Variables, or a step of them.

    Attributes
    ----------
    states, inputs : (n, N, B) of stages 1..N, and (m, N, B).
    level : (1, B), or (0, B) where none is shared.
    slack : (N, B).
    lifted : kind -> (A, N, K, B), auxiliaries.
    distance : group -> (rows, ..., B), t > 0 of every inequality h - t = 0.
    """

    states: Any
    inputs: Any
    level: Any
    slack: Any
    lifted: Mapping[str, Any]
    distance: Mapping[str, Any]


class Dual(NamedTuple):
    """Multipliers, or a step of them.

    Attributes
    ----------
    dynamics : (n, N, B).
    ties : kind -> (q, N, K, B), of the slots' equalities.
    force : group -> (rows, ..., B), >= 0, of the inequalities.
    """

    dynamics: Any
    ties: Mapping[str, Any]
    force: Mapping[str, Any]


class Iterate(NamedTuple):
    """State of the iteration; every entry but the first two is (B,) unless stated.

    Attributes
    ----------
    scale : factor of the cost.
    penalty : price of slack, scaled.
    barrier : mu.
    shift : last positive shift of the Hessian.
    filter : (F, 2, B), pairs of residual and barrier function; filled : how many.
    highest, lowest : residuals beyond which nothing is accepted, and below which the barrier
        function has to fall; negative: to be set.
    fails : line searches without success.
    count : iterations.
    code : of `Code`.
    """

    primal: Primal
    dual: Dual
    scale: Any
    penalty: Any
    barrier: Any
    shift: Any
    filter: Any
    filled: Any
    highest: Any
    lowest: Any
    fails: Any
    count: Any
    code: Any


class Values(NamedTuple):
    """Functions at a point.

    Attributes
    ----------
    following : (n, N, B), f(x_i, u_i).
    cost : (B,), scaled, without the price of slack.
    rows : group -> (rows, ..., B), inequalities, not softened.
    ties : kind -> (q, N, K, B).
    """

    following: Any
    cost: Any
    rows: Mapping[str, Any]
    ties: Mapping[str, Any]


class Slopes(NamedTuple):
    """Derivatives at a point, z = (x, u) and w = (x's entries, s, auxiliaries) of a slot.

    Attributes
    ----------
    drive_gradient, drive_hessian : (z, N, B) and (z, z, N, B), of the Lagrangian's parts.
    dynamics : (n, z, N, B), Jacobian.
    node_gradient, node_hessian : (n, N, B) and (n, n, N, B).
    level_gradient, level_hessian : (B,).
    hessians : kind -> (w, w, N, K, B), of the constraints' part of the Lagrangian.
    jacobians : group -> (rows, variables, ..., B).
    ties : kind -> (q, w, N, K, B).
    """

    drive_gradient: Any
    drive_hessian: Any
    dynamics: Any
    node_gradient: Any
    node_hessian: Any
    level_gradient: Any
    level_hessian: Any
    hessians: Mapping[str, Any]
    jacobians: Mapping[str, Any]
    ties: Mapping[str, Any]
