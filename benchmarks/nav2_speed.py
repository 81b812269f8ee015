"""A whole tick of Nav2's loop with each local controller, among ten people who walk to and fro."""

import sys
from argparse import Namespace
from dataclasses import dataclass
from itertools import product
from time import process_time

import numpy as np
from measuring import Tables, spread

from wideberth.framework.robot import step
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Detection, Observation, Twist
from wideberth.framework.values.path import Path
from wideberth.robots import Unicycle
from wideberth_nav2.controllers.local_controller import Answer, LocalController
from wideberth_nav2.controllers.local_controller import Tick as Asked
from wideberth_nav2.controllers.local_controllers import LOCAL, shipped_parameters
from wideberth_nav2.costmap.local_costmap import CostmapView
from wideberth_nav2.server.navigator import Nav2, Navigation
from wideberth_nav2.server.settings import LoopSettings

ROBOT = Unicycle(0.3, 0.7, 1.5, 2.0, 3.0)
PERSONS, RADIUS, SPEED = 10, 0.3, 0.5
"""Number; m; m/s, standard deviation of each component of their velocities."""
AREA = np.array([[0.8, 9.0], [-2.5, 2.5]])
"""m, in x and y, where they walk; the robot's path runs through the middle."""
TARGET = 50.0
"""ms, the period of 20 Hz."""
_ALONE = "the loop alone"
_WARM = 20
"""Ticks that are not counted: whatever is compiled is compiled then."""


@dataclass(eq=False)
class Straight(LocalController):
    """Commands the same whatever comes: what is left of a tick is the loop."""

    def reset(self) -> None:
        """Forget nothing."""

    def new_path(self, path: Array) -> None:
        """Look at nothing."""

    def limit_speed(self, value: float, percentage: bool) -> None:
        """Keep the speed."""

    def velocity(self, tick: Asked) -> Answer:
        """Drive on."""
        return Answer(Twist((0.2, 0.0), 0.0))


def settings(name: str, view: CostmapView) -> LoopSettings:
    """Return what Nav2 ships with a controller."""
    if name == _ALONE:
        return LoopSettings("nav2_speed:Straight", view=view)
    parameters = shipped_parameters(name)
    return LoopSettings(name, parameters, view=view)


def people(seed: int, time: float) -> list[Detection]:
    """Return who is where: each walks straight and turns back at the borders of the area."""
    rng = np.random.default_rng(seed)
    begin = rng.uniform(AREA[:, 0], AREA[:, 1], (PERSONS, 2))
    begin += time * rng.normal(0.0, SPEED, (PERSONS, 2))
    size = AREA[:, 1] - AREA[:, 0]
    places = AREA[:, 0] + size - np.abs((begin - AREA[:, 0]) % (2.0 * size) - size)
    spread_of = 1e-4 * np.eye(2)
    return [Detection(f"p{i}", place, spread_of, RADIUS) for i, place in enumerate(places)]


def episode(name: str, view: CostmapView, seed: int, ticks: int) -> list[float]:
    """Drive for so many ticks; return the processor time of those that asked a controller, ms."""
    nav2, state, found = Nav2(ROBOT, settings(name, view)), (0.0,) * 5, []
    nav2.set_path(Path([(0.0, 0.0), (12.0, 0.0)]))
    for k in range(ticks):
        seen = Observation(k * nav2.period, np.array(state), tuple(people(seed, k * nav2.period)))
        begin = process_time()
        command = nav2.command(seen)
        taken = 1e3 * (process_time() - begin)
        if nav2.answer is not None and k >= _WARM:
            found.append(taken)
        if nav2.navigation is Navigation.FAILED:
            break
        state = step(ROBOT, state, ROBOT.drive(state, command.twist, nav2.period), nav2.period)
    return found


def tables(options: Namespace) -> Tables:
    """Return one row per view and controller."""
    views = {"local": CostmapView(), "privileged": CostmapView.privileged()}
    rows = []
    for view, name in product(views, [_ALONE, *LOCAL]):
        print(f"{name}, {view} view", file=sys.stderr)
        own = episode(name, views[view], 0, 24 if options.quick else 220)
        row = {"view": view, "controller": name, "ticks": len(own), **spread(own)}
        rows.append(row | {"within": float(np.mean(np.array(own) <= TARGET))})
    return {"nav2": ("Ticks of Nav2's loop, ten people around", rows)}
