"""Our planner as an arm of robot_sf: their observation in, an acceleration out."""

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import shapely
import yaml

import wideberth
from wideberth import Identities, Observation, Path, Rerouting
from wideberth.controllers.withdrawing import Withdrawing

STEP = 0.1
"""s, of their simulation."""


class Arm:
    """A policy of theirs, new for each episode.

    Parameters
    ----------
    settings : ``speed``, m/s, and what `wideberth.recommended` takes beside robot and speed.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.settings = settings
        self.people = Identities()
        self.now = 0.0
        self.ticks = 0
        self.times: list[float] = []
        self.rungs: dict[str, int] = {}

    @classmethod
    def of(cls, file: str) -> "Arm":
        """Return an arm with the settings of a file."""
        with open(file, encoding="utf-8") as lines:
            return cls(yaml.safe_load(lines))

    def build(self, _: str, __: Any, **known: Any) -> tuple[Callable[..., Any], dict[str, Any]]:
        """Return the policy as their runner takes it, with the description of their simplest."""
        from robot_sf.benchmark.map_runner.map_runner import build_map_policy

        _, description = build_map_policy("goal", {}, **known)

        def policy(observation: Mapping[str, Any]) -> Any:
            return self.act(observation)

        policy._planner_bind_env = self.enter  # type: ignore[attr-defined]
        policy._planner_native_env_action = True  # type: ignore[attr-defined]  # accelerations
        return policy, description

    def enter(self, env: Any) -> None:
        """Take robot and walls from their simulator."""
        simulator = env.simulator
        limits, shapes = simulator.robots[0].config, []
        for obstacle in simulator.map_def.obstacles:
            shapes += obstacle.iter_polygons()
        self.walls = wideberth.walls_of_shapes(shapely.union_all(shapes))
        robot = {
            "type": "unicycle",
            "radius": limits.radius,
            "max_speed": limits.max_linear_speed,
            "max_reverse_speed": 0.0,
            "max_yaw_rate": limits.max_angular_speed,
            "max_acceleration": limits.max_linear_accel,
            "max_yaw_acceleration": limits.max_angular_accel,
        }
        self.planner = Withdrawing(wideberth.recommended(robot, quiet=True, **self.settings))
        self.hold = round(self.planner.period / STEP)
        self.routes = Rerouting(self.walls, limits.radius)
        self.path: Path | None = None

    def act(self, seen: Mapping[str, Any]) -> Any:
        """Return (a, alpha), m/s^2 and rad/s^2, that hold until the next decision."""
        if self.ticks % self.hold == 0:
            begin = time.perf_counter()
            self.decided = self.decide(seen)
            self.times.append(time.perf_counter() - begin)
            rung = str(self.planner.plan.rung) if self.planner.last_plan else "none"
            self.rungs[rung] = self.rungs.get(rung, 0) + 1
        self.ticks += 1
        self.now = STEP * self.ticks
        return self.decided

    def decide(self, seen: Mapping[str, Any]) -> Any:
        """Plan from what is seen."""
        place, (heading,) = seen["robot_position"], seen["robot_heading"]
        speed, turning = seen["robot_speed"]
        count = int(seen["pedestrians_count"][0])
        cosine, sine = np.cos(heading), np.sin(heading)
        turned = np.array([[cosine, sine], [-sine, cosine]])  # theirs are in the robot's frame
        people = self.people.named(
            self.now,
            seen["pedestrians_positions"][:count],
            seen["pedestrians_velocities"][:count] @ turned,
            seen["pedestrians_radius"][0],
        )
        ahead = [one for one in seen["route_waypoints"][1:] if one.any()]  # the rest is padding
        route = self.routes.update(self.now, place, ahead, people)
        if route.path is not None and route.path is not self.path:
            self.path = route.path
            self.planner.set_path(route.path)
        command = self.planner.command(
            Observation(self.now, (*place, heading, speed, turning), people, polygons=self.walls)
        )
        within = command.ramp or STEP  # s in which the velocity is to be reached
        wanted = np.array([command.linear[0] - speed, command.omega - turning]) / within
        return wanted.astype(np.float32)

    def row(self) -> dict[str, Any]:
        """Return what an episode's row says of the planner."""
        spent = 1e3 * np.array(self.times)
        return {
            "decision_ms": float(spent.mean()),
            "decision_ms_most": float(spent.max()),
            "rungs": self.rungs,
        }
