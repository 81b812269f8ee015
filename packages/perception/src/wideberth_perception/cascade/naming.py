"""Which true body each believed obstacle is."""

from collections.abc import Sequence

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.simulation.log.perception_log import TrueBody

NEAR = 1.0
"""m; an obstacle that is believed farther from every body than this matches none."""


def named(
    places: Sequence[Array], idents: Sequence[str], bodies: Sequence[TrueBody]
) -> dict[str, str]:
    """Return the body of each believed obstacle: the nearest within `NEAR`, each body once.

    Nearest pairs go first, so that of two beliefs in one body the better one has its name.
    """
    who = dict.fromkeys(idents, "")
    if not places or not bodies:
        return who
    apart = np.linalg.norm(
        np.array(places)[:, None] - np.array([one.position for one in bodies]), axis=2
    )
    taken: set[int] = set()
    for flat in np.argsort(apart, axis=None, kind="stable"):
        i, j = divmod(int(flat), len(bodies))
        if apart[i, j] > NEAR:
            break
        if not who[idents[i]] and j not in taken:
            who[idents[i]] = bodies[j].name
            taken.add(j)
    return who
