"""Stand-ins for numbers of a detection that are of no use: who was seen stays an obstacle."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..values.arrays import FARTHEST, Array, all_finite, checked_covariance
from ..values.errors import WideberthError
from ..values.motion import Detection, Observation

RADIUS = 0.7
"""m, of an obstacle of unknown kind: the disc around a wheelchair of 1.2 m x 0.7 m (ISO 7193)."""
OLDEST = 60.0
"""s. An age beyond it, before or after now, comes from a clock that differs."""
LARGEST = 10.0
"""m; a larger radius is more likely a number of cm."""


class LastGood(NamedTuple):
    """What is remembered of an obstacle: m, and (D, D), m^2, None where it was not stated."""

    radius: float
    covariance: Array | None = None


class Sighting(NamedTuple):
    """The detections of an observation as a controller can use them.

    Attributes
    ----------
    detections : all that have a place, with stand-ins for what is of no use.
    notes : what is of no use, and what stands in for it; their first word is their kind.
    placeless : names of those that were seen and have no place, not even a remembered one. They
        may be anywhere: there is no motion that is known to keep clear of them.
    """

    detections: tuple[Detection, ...]
    notes: list[str]
    placeless: tuple[str, ...]


def sound(
    observation: Observation,
    dimension: int,
    known: Mapping[str, LastGood] | None = None,
    here: Array | None = None,
    oldest: float = OLDEST,
) -> Sighting:
    """Return what a robot in D dimensions can use of all that it sees; nothing seen is lost.

    The last good value of the obstacle stands in for a number that is of no use, and without one

    - for a radius, `RADIUS`;
    - for a covariance, None: it is estimated from what the sensor reports;
    - for a tracked velocity or its covariance, none of either: positions show the motion;
    - for an age below zero, by less than ``oldest``, 0: the clocks differ a little;
    - for a position in space, seen by a robot in the plane, its first two coordinates; for one in
      the plane, seen by a robot in space, the same at the robot's own height.

    A detection whose position is none, or beyond `FARTHEST`, has no place. Nor has one whose age
    is not finite, or more than ``oldest`` from 0: it is not known when the obstacle was there. The
    last measurement of the obstacle stands in, which the controller remembers. An obstacle that is
    not known has no place. A radius above `LARGEST` is kept, and noted.

    Parameters
    ----------
    observation : what is seen. dimension : D.
    known : of obstacles that the controller remembers, by name; None for none.
    here : (D,), m, of the robot; None where it is not known.
    oldest : s.
    """
    remembered = {} if known is None else known
    kept: list[Detection] = []
    notes: list[str] = []
    lost: list[tuple[str, str]] = []
    for one in observation.detections:
        if is_sound(one, dimension, oldest):
            kept.append(one)
            continue
        placed, moved = _placed(one, dimension, here)
        if placed is None:
            lost.append((one.ident, moved))
            continue
        if not abs(one.age) <= oldest:  # NaN is not either
            why = f"age is {one.age:g} s, at most {oldest:g} s: is its stamp of another clock?"
            lost.append((one.ident, why))
            continue
        completed, words = _completed(placed, remembered.get(one.ident))
        kept.append(completed)
        if said := ", ".join(filter(None, (moved, *words))):
            notes.append(f"detection {one.ident!r} taken in part: {said}")
        if LARGEST < one.radius <= FARTHEST:
            notes.append(f"detection {one.ident!r} has a radius of {one.radius:g} m; is it in cm?")
    taken = {one.ident for one in kept}
    placeless: list[str] = []
    for ident, why in lost:
        if ident in remembered and ident not in taken:
            taken.add(ident)
            instead = "its last measurement stands in"
        else:
            placeless.append(ident)
            instead = "it may be anywhere"
        notes.append(f"detection {ident!r} refused: {why}; {instead}")
    return Sighting(tuple(kept), notes, tuple(placeless))


def checked_places(placeless: Sequence[str]) -> None:
    """Refuse to go on while obstacles are seen that have no place, see `Sighting.placeless`.

    Raises
    ------
    WideberthError : there are some.
    """
    if placeless:
        some = ", ".join(map(repr, placeless[:3])) + ", ..." * (len(placeless) > 3)
        raise WideberthError(f"seen without a place: {some}")


def is_sound(one: Detection, dimension: int, oldest: float) -> bool:
    """Whether every number of a detection can be used as it is, see `sound`."""
    if one.flaw or one.radius > LARGEST or one.age > oldest:
        return False
    place = one.position.tolist()
    if len(place) != dimension or max(place) > FARTHEST or min(place) < -FARTHEST:
        return False
    return one.velocity is None or not _motion(one)


def _placed(one: Detection, dimension: int, here: Array | None) -> tuple[Detection | None, str]:
    """Return a detection with a place in D dimensions, if it has one, and what is wrong."""
    position, size = one.position, len(one.position)
    flat = 2 <= size < dimension and here is not None and all_finite(here)
    fitting = position[:dimension]
    words = f"it has {size} coordinates" if size != dimension else ""
    if flat and here is not None:
        fitting = np.concatenate([position, here[size:]])
        words += ", taken at the robot's own height"
    if len(fitting) != dimension:
        return None, words
    if not all_finite(fitting):
        return None, f"position is {position.tolist()}"
    if not _within(fitting, FARTHEST):
        farthest = np.abs(fitting).max()
        return None, f"it is at {farthest:.3g} m, at most {FARTHEST:g} m"
    if size == dimension:
        return one, ""
    covariance = None
    if one.covariance is not None and not flat:
        covariance = one.covariance[:dimension, :dimension]
        words += f", the first {dimension} of which are taken"
    changes: dict[str, Any] = {"velocity": None, "state_covariance": None}
    return replace(one, position=fitting, covariance=covariance, **changes), words


def _completed(one: Detection, last: LastGood | None) -> tuple[Detection, list[str]]:
    """Put stand-ins in the place of a placed detection's other numbers, and name them."""
    changes: dict[str, Any] = {}
    words = []
    if not 0.0 <= one.radius <= FARTHEST:
        changes["radius"] = RADIUS if last is None else last.radius
        words.append(f"radius is {one.radius:g}, taken as {changes['radius']:g} m")
    if one.age < 0.0:
        changes["age"] = 0.0
        words.append(f"age is {one.age:g}, taken as 0 s")
    if one.covariance is not None and (wrong := _no_covariance("covariance", one.covariance)):
        changes["covariance"] = None if last is None else last.covariance
        instead = "estimated" if changes["covariance"] is None else "the last good one"
        words.append(f"its covariance is {instead}: {wrong}")
    if wrong := _motion(one):
        changes |= {"velocity": None, "state_covariance": None}
        words.append(f"its velocity is left out: {wrong}")
    return replace(one, **changes), words


def _motion(one: Detection) -> str:
    """Say what of a tracked motion is of no use; "" where nothing is."""
    velocity, joint = one.velocity, one.state_covariance
    if velocity is None or joint is None:
        return ""
    if not all_finite(velocity):
        return f"velocity is {velocity.tolist()}"
    for name, value, limit in (
        ("velocity", velocity, FARTHEST),
        ("state covariance", joint, FARTHEST**2),
    ):
        if not _within(value, limit) and all_finite(value):
            return f"its {name} holds {np.abs(value).max():.3g}, at most {limit:g}"
    return _no_covariance("state_covariance", joint) if one.flaw else ""


def _no_covariance(name: str, value: Array) -> str:
    """Say why a matrix is no covariance; "" where it is one."""
    try:
        checked_covariance(name, value, value.shape)
    except WideberthError as error:
        return str(error)
    return ""


def _within(value: Array, limit: float) -> bool:
    """Whether no entry of an array is larger than a limit; a few are asked without NumPy."""
    if value.size <= 8:
        return all(-limit <= entry <= limit for entry in value.ravel().tolist())
    return bool(np.abs(value).max(initial=0.0) <= limit)
