"""What each way to run a planner shares: it decides in a thread, and brakes before it leaves."""

import threading
import time
from collections.abc import Callable

from .node import PlannerNode

LONGEST_STOP = 3.0
"""s, for which a node that leaves brakes; then it sends zero."""


def decide_forever(planner: PlannerNode, due: threading.Event, over: threading.Event) -> None:
    """Decide by the first odometry after each of the controller's periods, until it is over.

    Where none comes it is decided all the same, as that says why the robot stands.

    Parameters
    ----------
    due : set once a period. over : ends it.
    """
    while not over.is_set():
        if due.wait(1.0):
            due.clear()
            planner.odometry_came.clear()
            planner.odometry_came.wait(1.0 / planner.settings.rate)
            planner.decide()


def brake(
    planner: PlannerNode,
    hurry: Callable[[], bool],
    meanwhile: Callable[[], None] = lambda: None,
) -> None:
    """Brake to a stand as the robot can, or at once where there is hurry.

    Parameters
    ----------
    hurry : whether to send zero now. meanwhile : called once a period.
    """
    planner.active = False
    end, period = time.monotonic() + LONGEST_STOP, 1.0 / planner.settings.rate
    while not planner.stands and not hurry() and time.monotonic() < end:
        planner.publish()
        meanwhile()
        time.sleep(period)
    planner.stop()
