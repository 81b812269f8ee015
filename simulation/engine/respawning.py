"""People who come anew after they have arrived."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from math import ceil

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.polygon import Polygon
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
    followed by "person 3 (2)", on the same path and with the same body, speed and controller; a
    number that makes the name of another one is left out.

    Where the start is taken (a robot within `ROBOT_ROOM`, or a body that would be touched) they
    stand at the goal until it is free. So there are always as many people as at first.

    Parameters
    ----------
    drivers : who decides; those who come anew have to be added to it.
    others : who else moves.
    polygons : what stands there.
    """

    def __init__(
        self,
        drivers: Sequence[Driver],
        others: Sequence[Bystander],
        polygons: Sequence[Polygon],
    ) -> None:
        self._drivers, self._others, self._polygons = drivers, others, polygons
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
            agent = replace(one.agent, name=self._next(one.name, [d.name for d, _ in found]))
            one.leave()
            driver = Driver(agent, now, len(one.states) - 1)
            period = agent.controller.period
            found.append((driver, ceil((now - agent.phase) / period - _SAME)))
        return found

    def _next(self, name: str, coming: Sequence[str]) -> str:
        """Name of who comes after this one, such as nobody has or had."""
        first, last = self._names[name]
        taken = {one.name for one in (*self._drivers, *self._others, *self._polygons)} | {*coming}
        number = next(n for n in count(last + 1) if f"{first} ({n})" not in taken)
        found = f"{first} ({number})"
        self._names[found] = first, number
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
