"""The right to the processor before other programs, where the system grants it."""

import os

MOST_URGENT = 99
"""Highest real-time priority of Linux."""


def set_realtime_priority(priority: int) -> str:
    """Give the calling thread a real-time priority; return why it has none, "" where it has.

    The policy is Linux' SCHED_RR: the thread runs before all ordinary ones, in turn with those of
    the same priority. Threads and programs that it starts later are ordinary again; a planner's
    calls of its solver, in threads of their own, have the priority of the planner.

    Parameters
    ----------
    priority : 1 to `MOST_URGENT`; 0 makes the thread ordinary.
    """
    if not hasattr(os, "sched_setscheduler"):
        return "this system has no real-time priorities"
    policy = os.SCHED_RR if priority else os.SCHED_OTHER
    try:  # only with privileges could the flag be taken away again
        os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError as error:
        return f"{error.strerror}: the limit is `ulimit -r`, set in /etc/security/limits.conf"
    return ""
