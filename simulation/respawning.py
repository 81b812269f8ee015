"""People who come anew after they have arrived."""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil

import numpy as np

from ..framework.arrays import Array
from .agents import Bystander
from .driver import Driver

ROBOT_ROOM = 5.0
"""m between the centres of a robot and of somebody who appears; pedestrian_simulator's."""

_SAME = 1e-9
"""s; instants closer together than this are one."""


class Respawning:
    """Brings people back to where they started, one instant after they arrived.

    Who comes anew is somebody else: another name, a log of its own, nothing remembered. So
    nobody sees anybody jump: for the others one person is no longer detected and another one
    comes into sight, and in the log each is absent (NaN) while it is not there. "person 3" is
    followed by "person 3 (2)", on the same path and with the same body, speed and controller.

    Where the start is taken (a robot within `ROBOT_ROOM`, or a body that would be touched) they
    stand at the goal until it is free. So there are always as many people as at first.

    Parameters
    ----------
    drivers : who decides; those who come anew have to be added to it.
    others : who else moves.
    """

    def __init__(self, drivers: Sequence[Driver], others: Sequence[Bystander]) -> None:
        self._drivers, self._others = drivers, others
        self._names = {one.name: (one.name, 1) for one in drivers if one.agent.respawn}

    def newcomers(self, now: float) -> list[tuple[Driver, int]]:
        """Let those leave who had arrived before ``now``, s, where the way is free for another.

        Returns
        -------
        newcomers : who appears at this instant, each with the number of its first tick.
        """
        found: list[tuple[Driver, int]] = []
        arrived = [
            one
            for one in self._drivers
            if one.agent.respawn and one.present and one.reached < now - _SAME
        ]
        for one in arrived:
            if not self._free(one, now, [driver for driver, _ in found]):
                continue
            first, count = self._names[one.name]
            agent = replace(one.agent, name=f"{first} ({count + 1})")
            self._names[agent.name] = first, count + 1
            one.leave()
            driver = Driver(agent, now, len(one.states) - 1)
            period = agent.controller.period
            found.append((driver, ceil((now - agent.phase) / period - _SAME)))
        return found

    def _free(self, one: Driver, now: float, coming: Sequence[Driver]) -> bool:
        """Whether somebody can appear where this one started."""
        start = one.agent.path.points[0]
        for other in (*self._drivers, *coming):
            room = one.radius + other.radius if other.agent.person else ROBOT_ROOM
            # Who has left is at NaN, and so in nobody's way.
            if other is not one and _distance(start, other.positions[-1]) < room:
                return False
        asked = np.array([now])
        return not any(
            _distance(start, other.at(asked)[0]) < one.radius + other.radius
            for other in self._others
        )


def _distance(first: Array, second: Sequence[float] | Array) -> float:
    return float(np.linalg.norm(np.asarray(first) - np.asarray(second)))
