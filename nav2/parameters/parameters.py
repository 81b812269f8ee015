"""Parameters by Nav2's names: one check of their values, and the names that mean nothing here."""

from collections.abc import Iterable, Mapping
from dataclasses import fields
from math import isfinite
from types import UnionType
from typing import Any, Literal, get_args, get_origin

import numpy as np

from ...framework.values.arrays import number, positive, whole
from ...framework.values.errors import WideberthError, nearest

WITHOUT_EFFECT = frozenset(
    """
    cancel_deceleration critic_index_to_visualize debug_trajectory_details inflation_layer_name
    map_frame min_lookahead odom_topic publish_cost_grid_pc publish_critics_stats
    publish_evaluation publish_global_plan publish_local_plan publish_optimal_trajectory
    publish_trajectories publish_transformed_plan stateful transform_tolerance
    use_cancel_deceleration visualize
    """.split()
)
"""Parameters of controllers that draw, that belong to ROS, or that have no effect here."""
MISSPELT = 0.75
"""Ratio of `difflib` from which on an unknown name is taken for a known one that is misspelt."""
NOT_MODELLED = frozenset(
    """
    clear_threshold coarse_xy_goal_tolerance cost_scaling_factor_left cost_scaling_factor_right
    final_rotation fine_xy_goal_tolerance initial_rotation_min_angle
    max_allowed_time_to_collision max_scaling_factor near_collision_cost obstacle_range
    raytrace_range required_movement_angle use_approach_linear_velocity_scaling
    """.split()
)
"""Names that some version of Nav2 has, which look like misspelt ones of those modelled here."""


def effective(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a controller without those that have no effect here.

    Parameters
    ----------
    parameters : name -> value, names by dots as in ``Critic.name``.
    """
    return {
        name: value
        for name, value in parameters.items()
        if name != "plugin" and name.rpartition(".")[2] not in WITHOUT_EFFECT
    }


def names_of(kind: type) -> list[str]:
    """Return the names of the parameters that a dataclass is made from."""
    return [one.name for one in fields(kind) if one.init]


class UnknownParameters(WideberthError):
    """Parameters that nothing here has, and that are no misspelt names.

    Attributes
    ----------
    names : of these parameters, as they were given.
    """

    def __init__(self, message: str, names: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.names = names


def refuse_unknown(
    place: str, given: Iterable[str], known: Iterable[str], prefix: str = ""
) -> None:
    """Refuse names that are not known, and name the nearest to the first of them.

    Parameters
    ----------
    place : what has these parameters, in the message.
    given, known : names.
    prefix : stands before each given name where it came from, as ``Critic.``.

    Raises
    ------
    WideberthError : a name that is nearly a known one of its block, at least `MISSPELT` alike.
    UnknownParameters : others; a reader of files may go on without them.
    """
    names = list(known)
    unknown = [name for name in given if name not in names]
    for name in unknown:
        block, _, last = name.rpartition(".")
        inside = [one for one in names if one.rpartition(".")[0] == block]
        near = nearest(name, inside, MISSPELT)
        if near and last not in NOT_MODELLED:
            raise WideberthError(f"{place} has no parameter {prefix + name!r}{near}")
    if unknown:
        message = f"{place} has no parameter {prefix + unknown[0]!r}{nearest(unknown[0], names)}"
        raise UnknownParameters(message, tuple(prefix + name for name in unknown))


def at_default(
    place: str, parameters: Mapping[str, Any], only: Mapping[str, Any]
) -> dict[str, Any]:
    """Return parameters without those that can have one value alone, here the original's default.

    Parameters
    ----------
    place : what the controller is called in messages.
    parameters : name -> value.
    only : name -> the value that it can have.

    Raises
    ------
    WideberthError : another value.
    """
    for name, value in only.items():
        if parameters.get(name, value) != value:
            raise WideberthError(
                f"{place}'s {name} is {parameters[name]!r}; here it can be {value!r} alone"
            )
    return {name: value for name, value in parameters.items() if name not in only}


def check_parameters(
    owner: Any, place: str, above: Iterable[str] = (), from_zero: Iterable[str] = ()
) -> None:
    """Check the fields of a dataclass by their annotations; called once, when it is made.

    A ``float`` has to be a finite number, an ``int`` a whole one, a ``bool`` true or false, a
    ``str`` text, a ``Literal`` one of its values, a tuple of floats a list of as many. Where None
    is allowed it stays. A number is stored as its annotation says; fields of other types are left
    to the class.

    Parameters
    ----------
    owner : the dataclass, frozen or not.
    place : what it is called in messages.
    above, from_zero : names of fields that have to be above 0, or at least 0.

    Raises
    ------
    WideberthError : a value does not fit; what came, what was wanted.
    """
    for one in fields(owner):
        if one.init:
            value = _fitting(f"{place}.{one.name}", getattr(owner, one.name), one.type)
            object.__setattr__(owner, one.name, value)
    for names, zero in ((above, False), (from_zero, True)):
        for name in names:
            value = getattr(owner, name)
            if isinstance(value, int):
                whole(f"{place}.{name}", value, least=0 if zero else 1)
            else:
                positive(f"{place}.{name}", value, zero=zero)


def check_work(place: str, names: str, count: float, most: float) -> None:
    """Refuse parameters that together ask for more work per tick than is ever of use.

    Parameters
    ----------
    place, names : what they are called in the message.
    count, most : how many steps they ask for, and how many are allowed.

    Raises
    ------
    WideberthError : it is too much.
    """
    if not count <= most:
        raise WideberthError(
            f"{place}: {names} together ask for {count:.3g} steps per tick; wanted at most "
            f"{most:.3g}; choose coarser steps"
        )


def _fitting(name: str, value: Any, kind: Any) -> Any:
    """Return a value as its annotation says, or raise."""
    if kind is float:
        return _finite(name, value)
    if kind is int:
        found = _finite(name, value)
        if found != int(found):
            raise WideberthError(f"{name} is {value!r}; wanted a whole number")
        return int(found)
    if kind is bool and not isinstance(value, bool | np.bool_):
        raise WideberthError(f"{name} is {value!r}; wanted true or false")
    if kind is str and not isinstance(value, str):
        raise WideberthError(f"{name} is {value!r}; wanted text")
    choices, origin = get_args(kind), get_origin(kind)
    if origin is Literal and value not in choices:
        *some, last = map(repr, choices)
        raise WideberthError(f"{name} is {value!r}; wanted {', '.join(some)} or {last}")
    if origin is UnionType and type(None) in choices and value is not None:
        return _fitting(name, value, next(one for one in choices if one is not type(None)))
    if origin is tuple and choices and all(one is float for one in choices):
        if not isinstance(value, list | tuple | np.ndarray) or len(value) != len(choices):
            raise WideberthError(f"{name} is {value!r}; wanted {len(choices)} numbers")
        return tuple(_finite(f"{name}[{i}]", entry) for i, entry in enumerate(value))
    return value


def _finite(name: str, value: Any) -> float:
    """Return a finite number, or raise."""
    if isinstance(value, bool | np.bool_):
        raise WideberthError(f"{name} is {value!r}; wanted a number")
    found = number(name, value)
    if not isfinite(found):
        raise WideberthError(f"{name} is {found:g}; wanted a finite number")
    return found
