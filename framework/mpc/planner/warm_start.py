"""Multipliers of the last plan as a start for the next solve.

Where plans follow each other within a fraction of their step, the last plan's multipliers are
nearly those of the next. The solver then begins with a barrier as low as they say, see `Riccati`.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...values.arrays import Array
from ..ocp.problem import Parameters
from ..ocp.transcription import Guess, Multipliers
from ..slots.base import SlotAssignment


@final
@dataclass(frozen=True, eq=False)
class KeptMultipliers:
    """Multipliers of a plan, with the names of what they belong to.

    Attributes
    ----------
    multipliers : of the plan.
    level : that it holds; nan where none is shared.
    names : of the slots in use, of each kind.
    """

    multipliers: Multipliers
    level: float
    names: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, point: Guess, chosen: tuple[SlotAssignment, ...]) -> "KeptMultipliers | None":
        """Keep those of a solution; None where the solver has none."""
        if point.multipliers is None:
            return None
        return cls(point.multipliers, point.level, tuple(one.called for one in chosen))

    def at(
        self, share: float, parameters: Parameters, chosen: tuple[SlotAssignment, ...]
    ) -> Multipliers:
        """Return those of a plan that begins later, for the slots that it has.

        Between two steps they are interpolated; behind the last they stay as they are there. A
        slot whose thing had none before is NaN.

        Parameters
        ----------
        share : of a step by which it begins later.
        parameters, chosen : of the problem that is solved next.
        """
        slots = []
        for held, names, one, new in zip(
            self.multipliers.slots, self.names, parameters.slots, chosen, strict=True
        ):
            known, shape = _numbered(names), (len(held), len(one.active), held.shape[2])
            found = np.full(shape, np.nan)
            places = _numbered(new.called).items()
            pairs = [(known[name], place) for name, place in places if name in known]
            if pairs:
                old, place = np.array(pairs).T
                found[:, place] = held[:, old]
            slots.append(_later(found, share))
        return Multipliers(_later(self.multipliers.steps, share), tuple(slots))


def _numbered(names: tuple[str, ...]) -> dict[tuple[str, int], int]:
    """Return the place of each name; the modes of an obstacle, which share one, are counted."""
    found: dict[tuple[str, int], int] = {}
    counts: dict[str, int] = {}
    for place, name in enumerate(names):
        counts[name] = counts.get(name, -1) + 1
        found[name, counts[name]] = place
    return found


def _later(rows: Array, share: float) -> Array:
    """Interpolate rows at steps (N, ...) that are a share of a step later."""
    last = len(rows) - 1
    place = np.minimum(np.arange(last + 1) + share, last)
    before = place.astype(np.int64)
    weight = (place - before).reshape(-1, *[1] * (rows.ndim - 1))
    return np.asarray((1.0 - weight) * rows[before] + weight * rows[np.minimum(before + 1, last)])
