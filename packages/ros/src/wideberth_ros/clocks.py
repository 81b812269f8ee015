"""The clocks of a recording: when messages were stamped, and when they were received."""

from dataclasses import dataclass
from typing import final

import numpy as np

from wideberth.framework.values.arrays import Array

JUMP = 1.0
"""s, by which a clock has to change against the other to have been set anew."""
AGREEING = 3
"""Messages in a row that have to agree on a change; fewer are late ones."""
GAP = 1.0
"""s without messages that are a gap, of a topic with at least two in that time otherwise."""
MOST_NOTES = 5
"""Gaps that are named one by one."""


@final
@dataclass(frozen=True, eq=False)
class Stamps:
    """Instants of the messages of one topic.

    Attributes
    ----------
    times : (T,), s, when each was measured, on one clock that was never set anew.
    notes : what was noticed, a clause each.
    """

    times: Array
    notes: tuple[str, ...]


def stamps(stamped: Array, received: Array) -> Stamps:
    """Return when messages were measured, by their stamps and by when they were received.

    A clock that is set while it is recorded shows as a step in stamped - received that lasts. The
    stamps after it are moved back by the step, so that the series goes on. A message that comes
    late by itself keeps its stamp.

    Parameters
    ----------
    stamped : (T,), s, NaN where a message has no stamp of its own; it is then taken to have been
        measured when it was received, up to the median difference of the others.
    received : (T,), s, increasing.
    """
    index = np.flatnonzero(np.isfinite(stamped))
    if not index.size:
        return Stamps(received, gaps(received))
    offset, notes = stamped[index] - received[index], []
    moved, near = np.zeros(len(index)), [float(offset[0])]
    for place in range(len(offset)):
        some = slice(place, place + AGREEING)
        ahead = offset[some] + moved[some] - float(np.median(near[-AGREEING:]))
        if abs(ahead[0]) <= JUMP:
            near.append(float(offset[place] + moved[place]))
            continue
        if len(ahead) == AGREEING and np.ptp(ahead) < JUMP / 2:
            step = float(np.median(ahead))
            moved[place:] -= step
            since = received[index[place]] - received[0]
            notes.append(f"its clock was set by {step:+.3g} s at {since:.3g} s")
    offset += moved
    usual = float(np.median(offset))
    times = received + usual
    times[index] = stamped[index] + moved
    late = int((offset < usual - JUMP).sum())
    if late:
        notes.append(f"{late} messages came more than {JUMP:g} s late")
    return Stamps(times, (*notes, *gaps(times)))


def gaps(times: Array) -> tuple[str, ...]:
    """Say where a series of instants, (T,) in s, is silent, in s from its first one."""
    order = np.sort(times)
    step = np.diff(order)
    usual = float(np.median(step)) if len(step) > 1 else np.inf
    if usual > GAP / 2:
        return ()
    found = np.flatnonzero(step > max(GAP, 5.0 * usual))
    words = [
        f"nothing from {order[i] - order[0]:.3g} s to {order[i + 1] - order[0]:.3g} s"
        for i in found[:MOST_NOTES]
    ]
    more = len(found) - MOST_NOTES
    return (*words, f"{more} more gaps") if more > 0 else tuple(words)
