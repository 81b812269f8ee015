"""Does the recommended planner arrive? Prints a table of docs/choose.md, and one of RESULTS.md.

    python benchmarks/recommended.py robots
    python benchmarks/recommended.py scenarios --seeds 4 --first 300
    python benchmarks/recommended.py scenarios --seeds 1 --only doorway crossing

A robot, given by its name, drives 8 m along a straight path: alone, and past a person who walks
across at 1 m/s, aimed at the place where the robot would be. Positions of the person are measured
with an error of 2 cm; the person does not make way for the robot.

A scenario is one of a shipped config, with the robot, its own limits and the settings of that
config, and with ``{<<: recommended, robot: *robot}`` as the controller of every robot: nothing
else is chosen. The seeds were used for no choice. Run it on two commits to compare them.
"""

import argparse
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from loky import get_reusable_executor

from wideberth import Path, names, recommended
from wideberth.experiments.engine.closed_loop import play
from wideberth.experiments.engine.shipped_configs import config_path, shipped
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.plugins.config import build, construct, read_config
from wideberth.framework.plugins.yamlfile import shared_settings
from wideberth.metrics.gaps import gaps
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.measures.episode_measures import verdict
from wideberth.simulation.measures.summary import clearances
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


def robots(_: argparse.Namespace) -> None:
    """Print a row per robot."""
    print("| |", " | ".join(f"{speed:g} m/s" for speed in SPEEDS), "|")
    print("| --- |", " | ".join("---" for _ in SPEEDS), "|")
    for name in names("robots"):
        cells = []
        for speed in SPEEDS:
            alone, met = (drive(recommended(name, speed, quiet=True), w) for w in (False, True))
            cells.append(f"{alone.time:.2f}; {met.time:.2f}, {met.clearance:.2f} m")
        print(f"| `{name}` |", " | ".join(cells), "|", flush=True)


STUDIES = ("comparison", "encounter")
"""Types of configs with scenarios; the config `flight` has one too."""
SIZES = (*(f"n_{n}" for n in range(3, 11)), "none", "twelve", "both_ways", "sixteen", "gaussian")
"""Scenarios that are others at another size, and one without people."""


def places() -> dict[tuple[str, str], tuple[Any, Any, Any]]:
    """Return (config, scenario) -> configs of scenario, robot and settings, each place once."""
    found: dict[str, tuple[str, str]] = {}
    parts: dict[tuple[str, str], tuple[Any, Any, Any]] = {}
    for name in shipped():
        config = read_config(config_path(name))
        if name == "fault_sweep" or not (config["type"] in STUDIES or name == "flight"):
            continue
        several = config["type"] == "comparison"
        settings = config.get("settings", {})
        robot = _first(config["robots"]) if several else config["robot"]
        scenarios = config["scenarios"] if "scenarios" in config else {name: config["scenario"]}
        for label, scenario in scenarios.items():
            if label in SIZES or label.endswith("_sfm"):
                continue
            if found.setdefault(repr(scenario), (name, label)) == (name, label):
                given = _first(settings) if several and settings else settings
                parts[name, label] = scenario, robot, given
    return parts


def episode(place: tuple[Any, Any, Any], seed: int) -> tuple[str, float, float]:
    """Play one episode: its outcome, least clearance, m, and time to the goals, s."""
    logging.getLogger("wideberth").setLevel(logging.ERROR)
    scenario, robot = build("scenarios", place[0]), build("robots", place[1])
    settings = construct(Settings, place[2], "settings")
    recommended = {**shared_settings("recommended"), "robot": robot}
    played = play(scenario, robot, build("controllers", recommended), settings, seed)
    found = verdict(played, settings.time_limit)
    least = min(clearances(played).values(), default=np.nan)
    return str(found["outcome"]), float(least), float(found["success_time"])


def _first(named: Mapping[str, Any]) -> Any:
    return next(iter(named.values()))


def scenarios(given: argparse.Namespace) -> None:
    """Print a row per scenario."""
    seeds = range(given.first, given.first + given.seeds)
    print("| Config, scenario | Collisions | Arrived | Least clearance (m) | Median time (s) |")
    print("| --- | --- | --- | --- | --- |")
    for (name, label), place in places().items():
        if given.only and name not in given.only:
            continue
        played = get_reusable_executor(given.workers).map(partial(episode, place), seeds)
        outcomes, clearances, times = zip(*played, strict=True)
        row = [
            f"`{name}`, {label}",
            f"{outcomes.count('collision')} of {len(seeds)}",
            str(outcomes.count("success")),
            f"{np.nanmin(clearances):.2f}" if np.isfinite(clearances).any() else "",
            f"{np.nanmedian(times):.1f}" if np.isfinite(times).any() else "",
        ]
        print("|", " | ".join(row), "|", flush=True)


def main() -> None:
    """Print one of the tables."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("table", choices=("robots", "scenarios"))
    asked.add_argument("--seeds", type=int, default=6)
    asked.add_argument("--first", type=int, default=300)
    asked.add_argument("--workers", type=int, default=2)
    asked.add_argument("--only", nargs="+", help="names of configs", default=())
    given = asked.parse_args()
    {"robots": robots, "scenarios": scenarios}[given.table](given)


if __name__ == "__main__":
    main()
