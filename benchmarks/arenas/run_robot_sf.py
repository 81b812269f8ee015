"""Drive robot_sf's release benchmark with our planner as an arm, and compare arms case by case.

robot_sf_ll7 (https://github.com/ll7/robot_sf_ll7) is GPL-3.0-only. Nothing of it is copied here:
this script imports it from a checkout, and belongs to no wheel of ours. In one environment::

    pip install . ../robot_sf_ll7[benchmark] ../robot_sf_ll7/third_party/python-rvo2
    run="python benchmarks/arenas/run_robot_sf.py"
    $run run --checkout ../robot_sf_ll7 --out results/robot_sf --arm orca
    $run run --checkout ../robot_sf_ll7 --out results/robot_sf --arm wideberth
    $run table --checkout ../robot_sf_ll7 --out results/robot_sf

An arm is ``wideberth`` (`robot_sf_arm.py`, its settings in `robot_sf.yaml`) or a key of their
campaign. Scenarios, seeds, horizon, step and judge are those of the campaign. Each episode is a
file of its own, written whole or not at all; one that is there is not run again.
"""

import argparse
import csv
import json
import math
import os
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from copy import deepcopy
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).resolve().parents[1]))  # the other benchmarks
import numpy as np
from measuring import Row, markdown

from wideberth.experiments.drawing.plotting import PAGE, paper_style, save, subplots
from wideberth.experiments.engine.csv_tables import write_table
from wideberth.framework.plugins.io import write_text
from wideberth.metrics.statistics import clopper_pearson, known_mean, mcnemar

CAMPAIGN = "configs/benchmarks/paper_experiment_matrix_v2_h600_s30_benchmark_data_2026_08.yaml"
OURS = "wideberth"
EVIDENCE = "docs/context/evidence/issue_3810_h600_interpretation_2026-07/source_reports"
SHIPPED = (f"{EVIDENCE}/13268",)
"""Folders of rows per episode that a checkout holds, of seeds 111 to 113."""
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


@dataclass(frozen=True)
class Case:
    """One episode: an arm, a scenario and a seed."""

    arm: str
    scenario: str
    seed: int

    def file(self, out: Path) -> Path:
        """Where its row stands."""
        return out / self.arm / f"{self.scenario}--{self.seed}.json"


@dataclass(frozen=True)
class Campaign:
    """Their campaign as a checkout states it."""

    checkout: Path

    @cached_property
    def stated(self) -> dict[str, Any]:
        """The campaign's file."""
        import yaml

        return dict(yaml.safe_load((self.checkout / CAMPAIGN).read_text(encoding="utf-8")))

    @property
    def matrix(self) -> Path:
        """File of the scenarios."""
        return self.checkout / str(self.stated["scenario_matrix"])

    @cached_property
    def arms(self) -> dict[str, dict[str, Any]]:
        """Their arms by key."""
        return {one["key"]: one for one in self.stated["planners"]}

    @cached_property
    def scenarios(self) -> dict[str, dict[str, Any]]:
        """The scenarios by name, each for a differential drive."""
        from robot_sf.training.scenario_loader import load_scenarios

        found = {}
        for one in load_scenarios(self.matrix):
            robot = {**(one.get("robot_config") or {}), "type": "differential_drive"}
            found[str(one["name"])] = {**one, "robot_config": robot}
        return found


@cache
def campaign_of(checkout: str) -> Campaign:
    """Return the campaign of a checkout, read once in a process."""
    return Campaign(Path(checkout))


def enter(checkout: str) -> None:
    """Make their package importable, quiet, and run from where it finds its files."""
    os.environ["OMP_NUM_THREADS"] = "1"
    root = Path(checkout)
    os.chdir(root)
    sys.path[:0] = [str(root), str(root / "fast-pysf")]
    from loguru import logger

    logger.remove()


def drive(case: Case, checkout: str, settings: str) -> Row:
    """Run one episode by their runner, and return its row."""
    from robot_sf.benchmark.map_runner.map_runner import _run_map_episode
    from robot_sf_arm import Arm

    campaign = campaign_of(checkout)
    stated, known = campaign.stated, campaign.arms
    ours = Arm.of(settings) if case.arm == OURS else None
    theirs = known.get(case.arm, {"algo": "goal"})
    begin = time.process_time()
    record: Any = _run_map_episode(
        deepcopy(campaign.scenarios[case.scenario]),  # their runner writes into it
        case.seed,
        horizon=stated["horizon"],
        dt=stated["dt"],
        record_forces=False,  # of people; no part of the verdict
        snqi_weights=None,
        snqi_baseline=None,
        algo=theirs["algo"],
        algo_config=None if ours is None else {"env_overrides": {"include_route_waypoints": True}},
        algo_config_path=theirs.get("algo_config"),
        scenario_path=campaign.matrix,
        policy_builder=None if ours is None else ours.build,
    )
    spent = time.process_time() - begin
    return {
        **verdict(record, stated["dt"]),
        "cpu_s": spent,
        **({} if ours is None else ours.row()),
    }


def verdict(record: dict[str, Any], dt: float) -> Row:
    """Return their verdict on an episode as a row.

    ``begins_in_contact`` is a collision in the first step, in which the robot moves by less than
    1 cm.
    """
    outcome, metrics = record["outcome"], record["metrics"]
    hit = bool(outcome["collision_event"])
    kind = "collision" if hit else "success" if outcome["route_complete"] else "timeout"
    with_what = "person" if metrics["ped_collision_count"] else "wall"
    steps = int(record["steps"])
    return {
        "outcome": kind,
        "collided_with": with_what if hit else "",
        "begins_in_contact": hit and steps == 1,
        "steps": steps,
        "time_s": steps * dt,
        "least_gap_m": metrics.get("min_clearance"),
    }


def run(options: argparse.Namespace) -> None:
    """Run the cases that have no row yet, and say how it goes."""
    out, options.settings = Path(options.out).resolve(), str(Path(options.settings).resolve())
    options.checkout = str(Path(options.checkout).resolve())
    campaign = campaign_of(options.checkout)
    if not (campaign.checkout / CAMPAIGN).is_file():
        sys.exit(f"--checkout is {campaign.checkout}, without {CAMPAIGN}; wanted robot_sf_ll7")
    enter(options.checkout)
    if options.arm != OURS and options.arm not in campaign.arms:
        sys.exit(f"--arm is {options.arm}; wanted {OURS} or one of {', '.join(campaign.arms)}")
    known = list(campaign.scenarios)
    names = options.scenarios or known
    if unknown := set(names) - set(known):
        sys.exit(f"--scenarios has {sorted(unknown)}; wanted of {', '.join(known)}")
    cases = [Case(options.arm, name, seed) for seed in seeds_of(options.seeds) for name in names]
    left = [case for case in cases if not case.file(out).exists()]
    print(f"{options.arm}: {len(cases)} episodes, {len(left)} to run", flush=True)
    (out / options.arm).mkdir(parents=True, exist_ok=True)
    tally = {"success": 0, "collision": 0, "timeout": 0}
    for done, (case, row) in enumerate(rows(left, options), 1):
        write_text(case.file(out), json.dumps({**asdict(case), **row}) + "\n")
        tally[row["outcome"]] += 1
        words = ", ".join(f"{count} {kind}" for kind, count in tally.items())
        what = f"{row['outcome']} {row['collided_with']}".strip()
        print(f"{done}/{len(left)} {case.scenario} {case.seed}: {what} ({words})", flush=True)


def rows(cases: Sequence[Case], options: argparse.Namespace) -> Iterator[tuple[Case, Row]]:
    """Yield each case with its row, as they come."""
    with ProcessPoolExecutor(
        options.workers, initializer=enter, initargs=(options.checkout,)
    ) as pool:
        waiting = {
            pool.submit(drive, case, options.checkout, options.settings): case for case in cases
        }
        for future in as_completed(waiting):
            yield waiting[future], future.result()


def seeds_of(words: Sequence[str]) -> list[int]:
    """Return the seeds that words like 111 or 111-140 name."""
    found: list[int] = []
    for word in words:
        first, _, last = word.partition("-")
        found += range(int(first), int(last or first) + 1)
    return found


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


def tables(options: argparse.Namespace) -> None:
    """Write the tables of all arms that have rows, and the figure."""
    out, checkout = Path(options.out), Path(options.checkout)
    arms = read(out, seeds_of(options.seeds))
    if OURS not in arms:
        sys.exit(f"{out} has no row of {OURS}; begin with `run --arm {OURS}`")
    text = [
        markdown("How the episodes end", counts(arms)),
        markdown("The same cases", pairs(arms, OURS)),
        markdown("By scenario", by_scenario(arms, OURS)),
        markdown(f"Episodes of {OURS} without success", failures(arms[OURS])),
    ]
    shipped = [
        {"rows": folder, "arm": arm, **agreement(cases, known)}
        for folder in SHIPPED
        for arm, cases in arms.items()
        if (known := shipped_rows(checkout / folder / "seed_episode_rows.csv", arm))
    ]
    text += [markdown("Beside the rows that robot_sf ships", shipped)] if shipped else []
    write_text(out / "robot_sf.md", "\n".join(text))
    write_table(out / "robot_sf.csv", listed(arms))
    print("\n".join(text))
    for file in outcome_figure(arms, out, "robot_sf"):
        print(file)


def main(words: Sequence[str] | None = None) -> None:
    """Do what the words of the command line say."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    commands = parser.add_subparsers(required=True)
    running = commands.add_parser("run", help="run the cases of an arm that have no row yet")
    running.add_argument("--arm", default=OURS)
    running.add_argument("--scenarios", nargs="+", metavar="NAME")
    running.add_argument("--workers", type=int, default=os.cpu_count())
    running.add_argument("--settings", default=str(Path(__file__).with_name("robot_sf.yaml")))
    running.set_defaults(do=run)
    table = commands.add_parser("table", help="compare the arms that have rows")
    table.set_defaults(do=tables)
    for one in (running, table):
        one.add_argument("--checkout", required=True, help="folder of robot_sf_ll7")
        one.add_argument("--out", required=True, help="folder of the rows")
        one.add_argument("--seeds", nargs="+", default=["111-140"], metavar="SEED")
    options = parser.parse_args(words)
    options.do(options)


if __name__ == "__main__":
    main()
