"""Parameters by Nav2's names: their kinds and bounds, and the names that mean nothing here."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar, final, get_args, get_origin, get_type_hints

import numpy as np
from annotated_types import Ge, Gt

from wideberth.framework import read_config
from wideberth.framework.values.errors import WideberthError, nearest, short

T = TypeVar("T")
Positive = Annotated[float, Gt(0.0)]
NonNegative = Annotated[float, Ge(0.0)]
Count = Annotated[int, Ge(1)]
Natural = Annotated[int, Ge(0)]
Triple = tuple[float, float, float]

NAMES: dict[str, Any] = read_config(Path(__file__).with_name("names.yaml"))
"""What Nav2's files name beside the parameters of the classes here, see ``names.yaml``."""
MISSPELT = 0.75
"""Ratio of `difflib` from which on an unknown name is taken for a known one that is misspelt."""
_WANTED = {
    "bool_type": "true or false",
    "finite_number": "a finite number",
    "float_type": "a number",
    "greater_than": "a {number} above {gt:g}",
    "greater_than_equal": "a {number} of at least {ge:g}",
    "int_type": "a whole number",
    "literal_error": "{expected}",
    "missing": "3 numbers",
    "string_type": "text",
    "too_long": "3 numbers",
    "tuple_type": "3 numbers",
}
"""Kinds of pydantic's errors -> what was wanted."""


@final
@dataclass(frozen=True)
class Named:
    """Mark of a field that Nav2's files call otherwise than the class.

    Attributes
    ----------
    name : in files.
    """

    name: str


@final
@dataclass(frozen=True)
class Limited:
    """Mark of a field that a limit of the robot binds.

    Attributes
    ----------
    limit : number of `wideberth_nav2.controllers.local_controllers.VelocityLimits`.
    sign : -1 where the field is its negative; 0 where the field stays within its two signs.
    """

    limit: str
    sign: int = 1


class UnknownParameters(WideberthError):
    """Parameters that nothing here has, and that are no misspelt names.

    Attributes
    ----------
    names : of these parameters, as they were given.
    """

    def __init__(self, message: str, names: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.names = names


@cache
def annotations_of(kind: type) -> dict[str, Any]:
    """Return the annotations of the fields that a dataclass is made from, by name."""
    hints = get_type_hints(kind, include_extras=True)
    return {one.name: hints[one.name] for one in fields(kind) if one.init}


def marks_of(kind: type, mark: type[T]) -> dict[str, T]:
    """Return the fields of a dataclass that have such a mark, `Named` or `Limited`."""
    found = annotations_of(kind).items()
    return {name: one for name, hint in found for one in get_args(hint) if isinstance(one, mark)}


def names_of(kind: type) -> dict[str, str]:
    """Return the names of the parameters that a dataclass is made from -> its fields."""
    names = {name: name for name in annotations_of(kind)}
    return {**names, **{mark.name: name for name, mark in marks_of(kind, Named).items()}}


def check_parameters(owner: Any, place: str, other: tuple[str, ...] = ()) -> None:
    """Check the fields of a dataclass by their annotations; called once, when it is made.

    pydantic does so, strictly: text is no number, and no number is true or false. A whole number
    may be written as 20.0, and a tuple as a list. What is stored is of the annotated type.

    Parameters
    ----------
    owner : the dataclass, frozen or not.
    place : what it is called in messages.
    other : fields that hold no parameters.

    Raises
    ------
    WideberthError : a value does not fit; what came, what was wanted.
    """
    from pydantic import ValidationError

    kind: Any = type(owner)
    given = {name: _plain(getattr(owner, name)) for name in annotations_of(kind)}
    try:
        valid = _schema(kind, other).model_validate(given)
    except ValidationError as error:
        first = error.errors()[0]
        name, *rest = first["loc"]
        if first["type"] == "missing":
            rest = []
        where = f"{place}.{name}" + "".join(f"[{index}]" for index in rest)
        number = (
            "whole number" if _bare(annotations_of(kind)[str(name)]) is int else "finite number"
        )
        wanted = _WANTED.get(first["type"], "another value")
        wanted = wanted.format(number=number, **first.get("ctx", {}))
        raise WideberthError(f"{where} is {short(first['input'])}; wanted {wanted}") from None
    for name in valid.model_fields_set:
        object.__setattr__(owner, name, getattr(valid, name))


@cache
def _schema(kind: type, other: tuple[str, ...]) -> Any:
    """Return the model of pydantic that has the annotations of a dataclass."""
    from pydantic import BeforeValidator, ConfigDict, create_model

    hints = {name: hint for name, hint in annotations_of(kind).items() if name not in other}
    for name, hint in hints.items():
        if _bare(hint) is int:
            hints[name] = Annotated[hint, BeforeValidator(_whole)]
        elif get_origin(_bare(hint)) is tuple:
            hints[name] = Annotated[hint, BeforeValidator(_row)]
    wanted: dict[str, Any] = {name: (hint, ...) for name, hint in hints.items()}
    config = ConfigDict(strict=True, allow_inf_nan=False, protected_namespaces=())
    return create_model(kind.__name__, __config__=config, **wanted)


def _bare(hint: Any) -> Any:
    """Return an annotation without its marks and bounds."""
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def _plain(value: Any) -> Any:
    """Return a number or array of NumPy as Python has it."""
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value


def _row(value: Any) -> Any:
    """Return a list as a tuple."""
    return tuple(value) if isinstance(value, list) else value


def _whole(value: Any) -> Any:
    """Return a whole number that is written as a float as what it is."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def made(kind: type[T], place: str, parameters: Mapping[str, Any], **other: Any) -> T:
    """Make a dataclass from parameters by Nav2's names.

    Parameters
    ----------
    kind : the dataclass.
    place : what it is called in messages.
    parameters : name -> value.
    other : fields that hold no parameters.

    Raises
    ------
    WideberthError : an unknown name, or a value that does not fit.
    """
    names = names_of(kind)
    refuse_unknown(place, parameters, names)
    return kind(**{names[name]: value for name, value in parameters.items()}, **other)


def made_critics(
    kinds: Mapping[str, type[T]], names: Iterable[str], parameters: Mapping[str, Any]
) -> tuple[tuple[T, ...], dict[str, Any]]:
    """Make critics from their parameters, and return the parameters that are left.

    Parameters
    ----------
    kinds : name -> class of every critic that there is.
    names : of the critics wanted, in this order.
    parameters : ``Critic.name`` -> value, and others.

    Raises
    ------
    WideberthError : an unknown critic, or a parameter that a critic does not have.
    """
    blocks: dict[str, dict[str, Any]] = {name: {} for name in names}
    rest = {}
    for key, value in parameters.items():
        critic, dot, name = key.partition(".")
        if dot and critic in blocks:
            blocks[critic][name] = value
        elif not (dot and critic in kinds):  # those of critics that are not asked for are let be
            rest[key] = value
    for name, block in blocks.items():
        if name not in kinds:
            raise WideberthError(f"there is no critic {name!r}; {nearest(name, kinds)}")
        refuse_unknown(name, block, names_of(kinds[name]), f"{name}.")
    return tuple(kinds[name](**blocks[name]) for name in names), rest


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
        if near and last not in NAMES["not_modelled"]:
            raise WideberthError(f"{place} has no parameter {prefix + name!r}{near}")
    if unknown:
        message = f"{place} has no parameter {prefix + unknown[0]!r}{nearest(unknown[0], names)}"
        raise UnknownParameters(message, tuple(prefix + name for name in unknown))


def effective(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a controller without those that have no effect here.

    Parameters
    ----------
    parameters : name -> value, names by dots as in ``Critic.name``.
    """
    return {
        name: value
        for name, value in parameters.items()
        if name != "plugin" and name.rpartition(".")[2] not in NAMES["without_effect"]
    }


def at_default(local: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters without those that can have one value alone, here the original's default.

    Parameters
    ----------
    local : name of the controller.
    parameters : name -> value.

    Raises
    ------
    WideberthError : another value.
    """
    only = NAMES["only"][local]
    for name, value in only.items():
        if parameters.get(name, value) != value:
            raise WideberthError(
                f"{local.upper()}'s {name} is {parameters[name]!r}; here it can be {value!r} alone"
            )
    return {name: value for name, value in parameters.items() if name not in only}


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
