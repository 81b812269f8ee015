"""Policies for the tests: functions from what is seen to an action."""

import numpy as np


def to_goal(seen):
    """Straight to the goal, for a robot without heading whose unit is 1 m/s."""
    way = seen["goal"]
    return 0.7 * way / max(float(np.linalg.norm(way)), 1.0)


def pushed(seen):
    """To the goal, pushed away by whoever is near."""
    apart = seen["positions"]
    gap = np.linalg.norm(apart, axis=1, keepdims=True) - seen["radii"][:, None]
    push = -(seen["present"][:, None] * apart / np.maximum(gap, 0.05) ** 2).sum(axis=0)
    way = seen["goal"] / max(float(np.linalg.norm(seen["goal"])), 1e-6) + push
    return 0.7 * way / max(float(np.linalg.norm(way)), 1.0)


def wrong_size(seen):
    return [0.0, 0.0, 0.0]


def raises(seen):
    raise RuntimeError("no weights")


LEARNT = 3.0
