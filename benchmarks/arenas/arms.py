"""Rows of episodes of several arms, compared case by case."""

import csv
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wideberth.experiments.drawing.plotting import PAGE, paper_style, save, subplots
from wideberth.metrics.statistics import clopper_pearson, known_mean, mcnemar

Row = dict[str, Any]
Cases = Mapping[tuple[str, int], Row]
"""Rows of one arm by scenario and seed."""
ENDS = {
    "success": ("white", ""),
    "begin in contact": ("0.85", "...."),
    "hit a wall": ("0.6", "////"),
    "hit a person": ("0.25", ""),
    "timeout": ("0.8", "\\\\\\\\"),
}
"""How an episode may end -> colour and hatch of its bar."""


def read(folder: Path, seeds: Iterable[int]) -> dict[str, dict[tuple[str, int], Row]]:
    """Read the rows of each arm, those with one of some seeds."""
    wanted, found = set(seeds), dict[str, dict[tuple[str, int], Row]]()
    for file in sorted(folder.glob("*/*.json")):
        row = json.loads(file.read_text(encoding="utf-8"))
        if row["seed"] in wanted:
            found.setdefault(row["arm"], {})[row["scenario"], row["seed"]] = row
    return found


def listed(arms: Mapping[str, Cases]) -> list[Row]:
    """One row per episode with its verdict alone, sorted."""
    columns = "arm", "scenario", "seed", "outcome", "collided_with", "begins_in_contact", "steps"
    rows = (row for cases in arms.values() for _, row in sorted(cases.items()))
    return [{name: row[name] for name in columns} for row in rows]


def counts(arms: Mapping[str, Cases]) -> list[Row]:
    """One row per arm: how its episodes end, and how long those take that succeed."""
    table = []
    for arm, cases in arms.items():
        rows = list(cases.values())
        hits = [row for row in rows if row["outcome"] == "collision"]
        started = sum(row["begins_in_contact"] for row in hits)
        moving = [row["collided_with"] for row in hits if not row["begins_in_contact"]]
        done = [row for row in rows if row["outcome"] == "success"]
        low, high = clopper_pearson(len(done), len(rows))
        table.append(
            {
                "arm": arm,
                "episodes": len(rows),
                "success": len(done),
                "share": f"{len(done) / len(rows):.3f} [{low:.3f}, {high:.3f}]",
                "begin in contact": started,
                "hit a wall": moving.count("wall"),
                "hit a person": moving.count("person"),
                "timeout": len(rows) - len(done) - len(hits),
                "time_s": known_mean([row["time_s"] for row in done]),
                "decision_ms": known_mean([row.get("decision_ms", math.nan) for row in rows]),
            }
        )
    return table


def pairs(arms: Mapping[str, Cases], base: str) -> list[Row]:
    """One row per other arm: success in the same cases, who alone has it, and McNemar's p."""
    table = []
    for arm, cases in arms.items():
        shared = sorted(set(cases) & set(arms[base])) if arm != base else []
        if not shared:
            continue
        ours, theirs = (succeeds(arms[one], shared) for one in (base, arm))
        both = [key for key, a, b in zip(shared, ours, theirs, strict=True) if a and b]
        spent = [arms[base][key]["time_s"] - cases[key]["time_s"] for key in both]
        table.append(
            {
                "arm": arm,
                "episodes": len(shared),
                base: int(ours.sum()),
                "its": int(theirs.sum()),
                f"{base} alone": int((ours & ~theirs).sum()),
                "it alone": int((theirs & ~ours).sum()),
                "p": mcnemar(ours, theirs),
                "longer_s": known_mean(spent),
            }
        )
    return table


def by_scenario(arms: Mapping[str, Cases], base: str) -> list[Row]:
    """One row per scenario: successes of each arm, and McNemar's p against the base."""
    table = []
    for name in sorted({scenario for cases in arms.values() for scenario, _ in cases}):
        row: Row = {"scenario": name}
        for arm, cases in arms.items():
            here = sorted(key for key in cases if key[0] == name)
            row[arm] = f"{int(succeeds(cases, here).sum())} of {len(here)}"
            if arm != base:
                shared = [key for key in here if key in arms[base]]
                pair = succeeds(arms[base], shared), succeeds(cases, shared)
                row[f"p, {arm}"] = mcnemar(*pair) if shared else math.nan
        table.append(row)
    return table


def failures(cases: Cases) -> list[Row]:
    """One row per scenario and way to fail, the most frequent first, with its seeds."""
    found: dict[tuple[str, str], list[int]] = {}
    for (name, seed), row in sorted(cases.items()):
        if row["outcome"] != "success":
            how = "begins in contact" if row["begins_in_contact"] else row["outcome"]
            words = f"{how} {row['collided_with']}".strip()
            found.setdefault((name, words), []).append(seed)
    return [
        {"scenario": name, "how": how, "episodes": len(seeds), "seeds": ", ".join(map(str, seeds))}
        for (name, how), seeds in sorted(found.items(), key=lambda one: (-len(one[1]), one[0]))
    ]


def agreement(cases: Cases, shipped: Cases) -> Row:
    """How many of the episodes that both have end alike, and which do not."""
    shared = sorted(set(cases) & set(shipped))
    other = [key for key in shared if cases[key]["outcome"] != shipped[key]["outcome"]]
    names = ", ".join(f"{name} {seed}" for name, seed in other)
    alike = len(shared) - len(other)
    share = alike / len(shared) if shared else math.nan
    return {"episodes": len(shared), "alike": alike, "share": share, "others": names}


def shipped_rows(file: Path, arm: str) -> dict[tuple[str, int], Row]:
    """Read the outcomes of an arm that robot_sf ships, by scenario and seed."""
    found = {}
    with file.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            if row["planner_key"] == arm:
                good, hit = float(row["success"]) > 0.0, float(row["collision"]) > 0.0
                outcome = "success" if good else "collision" if hit else "timeout"
                found[row["scenario_id"], int(row["seed"])] = {"outcome": outcome}
    return found


def outcome_figure(arms: Mapping[str, Cases], folder: Path, name: str) -> list[Path]:
    """Draw how the episodes of each arm end, as a bar of 100 %; PNG and PDF."""
    with paper_style():
        figure, panel = subplots(figsize=(PAGE, 0.7 + 0.35 * len(arms)))
        rows = counts(arms)
        left = np.zeros(len(rows))
        for kind, (colour, hatch) in ENDS.items():
            part = np.array([100.0 * row[kind] / row["episodes"] for row in rows])
            panel.barh([row["arm"] for row in rows], part, left=left, color=colour, hatch=hatch,
                       edgecolor="black", linewidth=0.4, label=kind)  # fmt: skip
            left += part
        panel.set(xlim=(0.0, 100.0), xlabel="episodes, %")
        panel.invert_yaxis()
        figure.legend(loc="outside upper center", ncols=len(ENDS))
        return save(figure, folder, name)


def succeeds(cases: Cases, keys: Sequence[tuple[str, int]]) -> Any:
    """Whether each of some cases succeeds, (K,) of bool."""
    return np.array([cases[key]["outcome"] == "success" for key in keys], dtype=np.bool_)
