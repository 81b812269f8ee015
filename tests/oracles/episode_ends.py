"""How an episode ended, computed from its log alone: the engine finds the same as it runs."""

import numpy as np

from wideberth.framework.values.arrays import Array, BoolArray


def deadlock_time(
    times: Array, speeds: Array, done: BoolArray, *, still: float = 0.02, after: float = 10.0
) -> float:
    """Moment at which a deadlock is found, s; NaN if there is none.

    A deadlock: every robot that is not at its goal (there is at least one) has been slower
    than ``still`` m/s for more than ``after`` seconds on end. Turning on the spot is
    standing. An episode that only ends at its time limit counts as a deadlock too; that is
    for the caller to add, who knows the limit.

    Parameters
    ----------
    times : (T,), s.
    speeds : (R, T), m/s.
    done : (R, T), whether the robot is, or was before, at its goal.
    """
    moving = ((np.asarray(speeds) >= still) & ~done).any(axis=0) | done.all(axis=0)
    moved = np.where(moving, times, -np.inf)
    moved[0] = max(moved[0], times[0])
    stood = times - np.maximum.accumulate(moved)
    found = np.flatnonzero(stood > after)
    return float(times[found[0]]) if found.size else float("nan")


def time_to_goal(times: Array, positions: Array, goal: Array, tolerance: float) -> float:
    """First instant at which the centre is within ``tolerance`` m of the goal; NaN if never."""
    near = np.flatnonzero(np.linalg.norm(positions - goal, axis=1) <= tolerance)
    return float(times[near[0]]) if near.size else float("nan")
