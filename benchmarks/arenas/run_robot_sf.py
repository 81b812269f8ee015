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
import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from copy import deepcopy
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).resolve().parents[1]))  # the other benchmarks
from arms import (
    Row,
    agreement,
    by_scenario,
    counts,
    failures,
    listed,
    outcome_figure,
    pairs,
    read,
    shipped_rows,
)
from measuring import markdown

from wideberth.experiments.engine.csv_tables import write_table
from wideberth.framework.plugins.io import write_text

CAMPAIGN = "configs/benchmarks/paper_experiment_matrix_v2_h600_s30_benchmark_data_2026_08.yaml"
OURS = "wideberth"
EVIDENCE = "docs/context/evidence/issue_3810_h600_interpretation_2026-07/source_reports"
SHIPPED = (f"{EVIDENCE}/13268",)
"""Folders of rows per episode that a checkout holds, of seeds 111 to 113."""


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
