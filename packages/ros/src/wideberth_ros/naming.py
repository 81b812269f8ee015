"""Names for obstacles whose sender gives them no identity of their own."""

from collections import Counter
from collections.abc import Sequence
from typing import final

import numpy as np

from wideberth.framework.tracking.identities import Identities
from wideberth.framework.values.arrays import FARTHEST, Array

UNNAMED = "unnamed "
"""Begins the names that are given here; a sender's own that begin so are not taken over."""
DEVIATION = 0.05
"""m per axis, of places that are tracked for their names."""


@final
class ObstacleNames:
    """Names the obstacles of one sender, message by message.

    An identity that is empty, or that has occurred more than once in a message, as a class name
    or an id that was left at 0, does not tell them apart. They are named by where they are, see
    `wideberth.framework.tracking.identities.Identities`; all others keep their identities.
    """

    def __init__(self) -> None:
        self.count: int = 0
        """Obstacles of the last message without an identity of their own."""
        self._shared: set[str] = set()
        self._identities: Identities | None = None

    def named(self, time: float, idents: Sequence[str], places: Array) -> tuple[str, ...]:
        """Return the names of the obstacles of one message, each once.

        Parameters
        ----------
        time : s. idents : the sender's identities, "" for none.
        places : (K, 2), m, in a frame that stands still. An obstacle whose place is not finite,
            or beyond `FARTHEST`, has a name that none with a place has.
        """
        self._shared |= {ident for ident, count in Counter(idents).items() if count > 1}
        rows = [i for i, ident in enumerate(idents) if self._nameless(ident)]
        self.count = len(rows)
        names = list(idents)
        if rows:
            if self._identities is None:
                self._identities = Identities(DEVIATION)
            found = iter(self._identities.named(time, places[rows]))
            for i in rows:
                placed = (np.abs(places[i]) <= FARTHEST).all()  # NaN is not
                names[i] = UNNAMED + (next(found).ident if placed else f"without a place {i}")
        return tuple(names)

    def _nameless(self, ident: str) -> bool:
        return not ident or ident in self._shared or ident.startswith(UNNAMED)
