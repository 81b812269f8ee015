"""Ours and its rivals in random crowds with the limits of three robots.

    python benchmarks/crowd_rivals.py tune     # every setting of `GRIDS`; resumes where it stopped
    python benchmarks/crowd_rivals.py count    # the best ones at seeds that were not looked at
    python benchmarks/crowd_rivals.py table    # prints what both found, and pairs ours with each
    python benchmarks/crowd_rivals.py figure FOLDER   # random_crowds.png and .pdf

A rival is at its best of a stated grid; ours are those of the config `random_crowd` as they are.
Plant, noise and time limit are those of the shipped config `random_crowd`; an episode ends at the
first contact, which changes no verdict. Tuned at 10 people per 100 m^2: the best setting is the
one that arrives most often, the faster of two that arrive as often. A row per episode goes to
``crowd_rivals_rows.csv``; ``crowd_rivals_tuning.csv`` has a row per setting.
"""

import csv
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from measuring import Row, markdown

from wideberth.experiments.drawing.plotting import PAGE, paper_style, save, subplots
from wideberth.experiments.engine.closed_loop import group, play
from wideberth.experiments.engine.csv_tables import write_table
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.agility import AGILITY, agile
from wideberth.framework import build
from wideberth.framework.controller import driving
from wideberth.metrics.statistics import clopper_pearson, mcnemar
from wideberth.simulation.measures.episode_measures import measures

GRIDS: dict[str, dict[str, tuple[float, ...]]] = {
    "orca": {
        "reference_speed": (0.7, 1.0),
        "time_horizon": (2.0, 5.0),
        "safety_space": (0.1, 0.2),
    },
    "social_force": {
        "reference_speed": (0.7, 1.0),
        "strength": (3.0, 9.0),
        "reach": (0.18, 0.35),
    },
    "bilevel_orca": {
        "reference_speed": (0.7, 1.0),
        "people_speed": (0.5, 1.5),
    },
}
"""Controller -> parameter -> values. ORCA was also tried at 1 s and at 0.01 m: never the best."""
BEYOND = {
    "orca": (
        {"reference_speed": 1.0, "time_horizon": 2.0, "safety_space": 0.3},
        {"reference_speed": 1.0, "time_horizon": 3.0, "safety_space": 0.2},
    )
}
"""Settings beside the best one, which was at the edge of its grid."""
SLOW = "bilevel_orca"
"""Takes 3 s of processor time an episode: it has fewer seeds, and is tuned and counted with the
shipped limits alone, at the lower density."""
TUNED = {"orca": range(100, 120), "social_force": range(100, 110), SLOW: range(100, 110)}
"""Controller -> seeds of the choice."""
COUNTED, COUNTED_SLOW = range(3000, 3100), range(3000, 3020)
"""Seeds of the rivals' count."""
COUNTED_OURS = range(4000, 4100)
"""Seeds of ours, and of `CLOSEST` as well."""
CLOSEST = "orca"
"""The best rival."""
CROWDS = {10: "people_10_per_100_m2", 20: "people_20_per_100_m2"}
"""People per 100 m^2 -> scenario of the config."""
OURS = ("ours", "ours_watching", "straight_on")
"""Controllers of the config."""
HERE = Path(__file__).parent
TUNING, ROWS = HERE / "crowd_rivals_tuning.csv", HERE / "crowd_rivals_rows.csv"


def grid(controller: str) -> Iterator[dict[str, float]]:
    """Return every setting of a controller's grid."""
    values = GRIDS[controller]
    for chosen in product(*values.values()):
        yield dict(zip(values, chosen, strict=True))
    yield from BEYOND.get(controller, ())


def verdicts(
    limits: str, people: int, name: str, given: dict[str, float], seeds: Iterable[int]
) -> Iterator[Row]:
    """Play episodes; return verdict and time of each, as rows."""
    study, _ = read_experiment("random_crowd", [])
    made: Any = study
    (robot,), (settings,) = made.robots.values(), made.settings.values()
    robot = agile(robot, limits, "robots")
    if name in OURS:
        controller = driving(made.controllers[name], robot)
    else:
        controller = build("controllers", {"type": name, "robot": robot, **given})
    settings = replace(settings, stop_on_collision=True)
    scenario = made.scenarios[CROWDS[people]]
    for seed in seeds:
        episode = play(scenario, robot, controller, settings, seed)
        found = measures(episode, 0.05, settings.time_limit)
        verdict = {"success": "arrived", "collision": "contact"}.get(found["outcome"], "late")
        time = round(float(found["success_time"]), 2)
        yield {"limits": limits, "people": str(people), "controller": name} | {
            "seed": seed, "verdict": verdict, "time_s": time
        }  # fmt: skip


def read(path: Path) -> list[Row]:
    """Return the rows of a table; none where there is no file."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def condensed(rows: list[Row]) -> Row:
    """Return how many arrive, touch and are late, and the mean time of those that arrive."""
    times = [float(row["time_s"]) for row in rows if row["verdict"] == "arrived"]
    words = [row["verdict"] for row in rows]
    shares = {word: words.count(word) for word in ("arrived", "contact", "late")}
    return {"seeds": len(rows), **shares, "time_mean_s": float(np.mean(times or [np.nan]))}


def tune(names: list[str]) -> None:
    """Play every setting that the table lacks."""
    lines = read(TUNING)
    for name, limits in product(names, AGILITY):
        if name == SLOW and limits != "shipped":
            continue
        for given in grid(name):
            key = {"limits": limits, "controller": name, "setting": worded(given)}
            if any(all(line[k] == v for k, v in key.items()) for line in lines):
                continue
            found = condensed(list(verdicts(limits, 10, name, given, TUNED[name])))
            lines.append(key | found)
            write_table(TUNING, lines)
            print(*lines[-1].values(), flush=True)


def worded(given: dict[str, float]) -> str:
    """Return a setting as text."""
    return " ".join(f"{key}={value:g}" for key, value in given.items())


def best(limits: str, name: str) -> dict[str, float]:
    """Return the best setting of a controller with these limits."""
    if name in OURS:
        return {}
    lines = group(read(TUNING), "controller", "limits")[name, limits]
    chosen = max(lines, key=lambda line: (int(line["arrived"]), -float(line["time_mean_s"])))
    return {key: float(v) for key, v in (part.split("=") for part in chosen["setting"].split())}


def count(names: list[str]) -> None:
    """Play the best settings at the seeds of the count, those that the table lacks."""
    rows = read(ROWS)
    for name, people, limits in product((*OURS, *names), CROWDS, AGILITY):
        key = {"limits": limits, "people": str(people), "controller": name}
        played = {int(row["seed"]) for row in rows if all(row[k] == v for k, v in key.items())}
        if name == SLOW and (people, limits) != (10, "shipped"):
            continue
        seeds = [seed for seed in counted_seeds(name, limits) if seed not in played]
        rows += verdicts(limits, people, name, best(limits, name), seeds)
        write_table(ROWS, rows)
        print(name, people, limits, flush=True)


def counted_seeds(name: str, limits: str) -> list[int]:
    """Return the seeds of a controller's count."""
    if name in OURS:
        return list(COUNTED_OURS)
    if name == SLOW:
        return list(COUNTED_SLOW)
    return [*COUNTED, *(COUNTED_OURS if (name, limits) == (CLOSEST, "shipped") else ())]


def table() -> None:
    """Print the chosen settings and the count."""
    lines, counted = [], group(read(ROWS), "controller", "people", "limits")
    for (name, people, limits), own in counted.items():
        found = condensed(own)
        low, high = clopper_pearson(found["arrived"], len(own))
        found["p"] = paired(counted.get(("ours", people, limits), []), own)
        lines.append({
            "controller": name, "people": people, "limits": limits, **found,
            "low": low, "high": high, "setting": worded(best(limits, name)),
        })  # fmt: skip
    print(markdown("Random crowds", lines))


def paired(ours: list[Row], own: list[Row]) -> float:
    """Return the p value of "both arrive as often", from the seeds that both have."""
    first, second = ({row["seed"]: row["verdict"] == "arrived" for row in some}
                     for some in (ours, own))  # fmt: skip
    both = sorted(first.keys() & second.keys())
    if not both:
        return float("nan")
    return mcnemar([first[seed] for seed in both], [second[seed] for seed in both])


def figure(folder: str) -> None:
    """Draw who arrives of those with the shipped limits."""
    counted = group(read(ROWS), "controller", "people", "limits")
    names = list(dict.fromkeys(name for name, _, limits in counted if limits == "shipped"))
    with paper_style():
        page, panels = subplots(1, len(CROWDS), figsize=(PAGE, 2.2))
        for panel, people in zip(np.ravel(panels), CROWDS, strict=True):
            known = [name for name in names if (name, str(people), "shipped") in counted]
            for place, name in enumerate(reversed(known)):
                rows = counted[name, str(people), "shipped"]
                arrived = condensed(rows)["arrived"]
                low, high = clopper_pearson(arrived, len(rows))
                share = arrived / len(rows)
                panel.barh(place, share, color="0.6" if name == "ours" else "0.9", edgecolor="k")
                panel.plot([low, high], [place, place], "k-", linewidth=1.0)
                panel.text(1.02, place, f"{100 * share:.0f} %", va="center")
            panel.set_yticks(range(len(known)), list(reversed(known)))
            panel.set_xlim(0.0, 1.0)
            panel.set_xlabel("share that arrives without a contact")
            panel.set_title(f"{people} people per 100 m²")
        save(page, Path(folder), "random_crowds")


def main(task: str, *names: str) -> None:
    """Do one of the tasks."""
    if task == "figure":
        figure(*names)
    else:
        tasks = {"tune": tune, "count": count, "table": lambda _: table()}
        tasks[task](list(names or GRIDS))


if __name__ == "__main__":
    main(*sys.argv[1:])
