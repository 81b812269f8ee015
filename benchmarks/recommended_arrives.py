"""Does the recommended planner arrive, with every robot? Prints a table of docs/choose.md.

    python benchmarks/recommended_arrives.py

A robot, given by its name, drives 8 m along a straight path: alone, and past a person who walks
across at 1 m/s, aimed at the place where the robot would be. Positions of the person are measured
with an error of 2 cm; the person does not make way for the robot.
"""

from dataclasses import dataclass

import numpy as np

from wideberth import Path, names, recommended
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.metrics.gaps import gaps
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.sensing.channel import Channel

SPEEDS = (0.3, 0.5, 1.0, 1.5)
"""m/s."""
LENGTH, RADIUS, WALK = 8.0, 0.3, 1.0
"""m of the path, m and m/s of the person."""


@dataclass(frozen=True)
class Drive:
    """How one drive ended: time over the free one, way over the path, least clearance, m."""

    time: float
    way: float
    clearance: float


def drive(planner: Planner, walker: bool, length: float = LENGTH) -> Drive:
    """Drive along a straight path; the time is NaN for a robot that does not arrive."""
    robot, speed, size = planner.robot, planner.reference_speed, planner.robot.dimension
    path = Path(np.pad([[0.0], [length]], ((0, 0), (0, size - 1))))
    free = length / speed
    times = np.arange(-30.0, 6.0 * free, 0.2)
    steps = np.zeros((len(times), size))
    steps[:, 0], steps[:, 1] = 0.5 * length, WALK * (times - 0.5 * free)
    episode = run_episode(
        [RobotAgent("robot", robot, planner, path, speed)],
        Settings(time_limit=6.0 * free, history=6.0, channel=Channel(noise=0.02)),
        others=[ReplayAgent("walker", times, steps, RADIUS)] if walker else (),
    )
    log = episode.robots[0]
    way = float(np.linalg.norm(np.diff(log.positions, axis=0), axis=1).sum())
    clearance = float(np.nanmin(gaps(log, episode.agents[1]))) if walker else float("nan")
    return Drive(log.reached / free, way / length, clearance)


def main() -> None:
    """Print a row per robot."""
    print("| |", " | ".join(f"{speed:g} m/s" for speed in SPEEDS), "|")
    print("| --- |", " | ".join("---" for _ in SPEEDS), "|")
    for name in names("robots"):
        cells = []
        for speed in SPEEDS:
            alone, met = (drive(recommended(name, speed, quiet=True), w) for w in (False, True))
            cells.append(f"{alone.time:.2f}; {met.time:.2f}, {met.clearance:.2f} m")
        print(f"| `{name}` |", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
