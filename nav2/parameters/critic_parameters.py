"""Parameters of a controller with critics, by the names that stand in Nav2's files."""

from collections.abc import Mapping
from typing import Any, TypeVar

from ...framework.values.errors import WideberthError, nearest
from .parameters import names_of, refuse_unknown

C = TypeVar("C")


def split_critics(
    kinds: Mapping[str, type[C]], names: tuple[str, ...], parameters: Mapping[str, Any]
) -> tuple[tuple[C, ...], dict[str, Any]]:
    """Build critics from their parameters, and return the parameters that are left.

    Parameters
    ----------
    kinds : name -> class of every critic that there is.
    names : of the critics wanted, in this order.
    parameters : ``Critic.name`` -> value, and others.

    Raises
    ------
    WideberthError : an unknown critic, or a parameter that a critic does not have.
    """
    own: dict[str, dict[str, Any]] = {name: {} for name in names}
    rest = {}
    for key, value in parameters.items():
        critic, dot, name = key.partition(".")
        if dot and critic in own:
            own[critic][name] = value
        elif not (dot and critic in kinds):  # those of critics that are not asked for are let be
            rest[key] = value
    for name in names:
        if name not in kinds:
            raise WideberthError(f"there is no critic {name!r}; {nearest(name, kinds)}")
        refuse_unknown(name, own[name], names_of(kinds[name]), f"{name}.")
    return tuple(kinds[name](**own[name]) for name in names), rest
