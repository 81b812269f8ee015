"""What does `<<: recommended` do in every shipped scenario? Prints a table of docs/choose.md.

    python benchmarks/recommended_scenarios.py --seeds 6 --first 300
    python benchmarks/recommended_scenarios.py --seeds 1 --only doorway crossing

A row is a scenario of a shipped config, with the robot, its own limits and the settings of that
config, and with ``{<<: recommended, robot: *robot}`` as the controller of every
robot: nothing else is chosen. The seeds were used for no choice. Run it on two commits to compare
them.
"""

import argparse
import logging
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from loky import get_reusable_executor

from wideberth.experiments.engine.closed_loop import play
from wideberth.experiments.engine.shipped_configs import config_path, shipped
from wideberth.framework.plugins.config import build, construct, read_config
from wideberth.framework.plugins.yamlfile import shared_settings
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.measures.episode_measures import verdict
from wideberth.simulation.measures.summary import clearances

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


def main() -> None:
    """Print a row per scenario."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--seeds", type=int, default=6)
    asked.add_argument("--first", type=int, default=300)
    asked.add_argument("--workers", type=int, default=2)
    asked.add_argument("--only", nargs="+", help="names of configs", default=())
    given = asked.parse_args()
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


if __name__ == "__main__":
    main()
