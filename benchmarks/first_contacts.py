"""Classify the first contacts of a controller in random crowds, and table why they happen.

The episodes are those of one scenario and controller of a comparison, `random_crowd` by default::

    python benchmarks/first_contacts.py run --out results/first_contacts --seeds 100
    python benchmarks/first_contacts.py table benchmarks/first_contacts_rows.csv

``run`` resumes what was begun, writes ``first_contacts_rows.csv`` into the folder and prints the
tables; ``table`` prints those of rows that there are. docs/metrics.md defines the columns.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from measuring import Row, markdown

from wideberth.experiments.engine.csv_tables import read_table, write_table
from wideberth.experiments.engine.runner import run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.comparison import Comparison
from wideberth.framework.plugins.config import describe
from wideberth.framework.values.arrays import Array
from wideberth.simulation.measures.first_contact import KINDS, LEADS, lead_column

LABELS = ("seed", "outcome", "success_time", "contact_", "other_kind")
PLANNED = ("forecast_error", "forecast_deviations", "forecast_risk", "plan_clear", "plan_gave_way")
KEPT = (*LABELS, "avoidable_", "level_held_", *PLANNED, "plan_rung")
"""How the columns begin that are kept of each episode."""
KNOWN_AFTER = (0.0, 0.2, 0.4)
"""s after a turn, at which it is known."""
LIKELY = 0.01
"""Probability of a touch from which on a forecast is said to have given it."""


def study(config: str, scenario: str, controller: str, first: int, count: int) -> Comparison:
    """Return the study of a config, of one scenario and controller, at other seeds."""
    whole, _ = read_experiment(config, [])
    assert isinstance(whole, Comparison)
    return replace(
        whole,
        scenarios={scenario: whole.scenarios[scenario]},
        controllers={controller: whole.controllers[controller]},
        baseline=controller,
        first_seed=first,
        seeds=count,
        show=(),
    )


def kept(experiment: Comparison, rows: Sequence[Row]) -> list[Row]:
    """Return what is kept of each episode, with the kind of controller of whom it touched."""
    (scenario,) = experiment.scenarios.values()
    found = []
    for row in rows:
        people = {one.name: one for one in scenario.cast(row["seed"]).people}
        other = people.get(row["contact_with"])
        kind = "" if other is None else describe(other.controller)["type"]
        own = {name: value for name, value in row.items() if name.startswith(KEPT)}
        found.append({**own, "other_kind": kind})
    return found


def kinds(rows: Sequence[Row]) -> list[Row]:
    """Count each kind of contact: as the first that holds, and as one of those that hold."""
    touched = [row for row in rows if row["contact_kind"]]
    others = sorted({row["other_kind"] for row in touched if row["other_kind"]})
    lines = []
    for kind in (*KINDS, "other"):
        own = [row for row in touched if row["contact_kind"] == kind]
        holds = (
            own if kind == "other" else [row for row in touched if row[f"contact_{kind}"] is True]
        )
        by = {name: sum(row["other_kind"] == name for row in own) for name in others}
        lines.append(
            {"kind": kind, "first of those that hold": len(own), "holds": len(holds), **by}
        )
    by = {name: sum(row["other_kind"] == name for row in touched) for name in others}
    return [*lines, {"kind": "all", "first of those that hold": len(touched), "holds": "", **by}]


def leads(rows: Sequence[Row]) -> list[Row]:
    """Return, so many s before, what could be done and what was planned; medians and shares."""
    touched = [row for row in rows if row["contact_kind"]]
    lines = []
    for lead in LEADS:
        had = {name: known(touched, lead_column(name, lead)) for name in ("avoidable", *PLANNED)}
        rungs = [row[lead_column("plan_rung", lead)] for row in touched]
        reacting = known(touched, lead_column("avoidable", lead, "_reacting"))
        lines.append({
            "lead_s": lead,
            "contacts": had["avoidable"].size,
            "avoidable": part(had["avoidable"]),
            "reacting": part(reacting),
            "error_m": quartiles(had["forecast_error"]),
            "deviations": quartiles(had["forecast_deviations"]),
            f"risk >= {LIKELY:g}": part(had["forecast_risk"] >= LIKELY),
            "plan clear": part(had["plan_clear"]),
            "gave way": part(had["plan_gave_way"]),
            "though held": part(given_up(touched, lead)),
            "optimal": part(np.array([rung == "optimal" for rung in rungs if rung])),
        })  # fmt: skip
    return lines


def turns(rows: Sequence[Row]) -> list[Row]:
    """Count the turns after which someone who knows them still avoids the contact.

    It is known at the leads alone: at least where it is avoidable at one after the turn is known,
    at most where it is at the last one before.
    """
    turned = [row for row in rows if row["contact_turned"] is True]
    lines = []
    for later in KNOWN_AFTER:
        least = most = 0
        for row in turned:
            left = row["contact_turn_before"] - later
            helps = [at for at in LEADS if row[lead_column("avoidable", at, "_reacting")] is True]
            latest = min(helps, default=np.inf)
            least += latest <= left
            most += latest <= min((lead for lead in LEADS if lead >= left), default=np.inf)
        lines.append({"known_s": later, "turns": len(turned), "at least": least, "at most": most})
    return lines


def given_up(rows: Sequence[Row], lead: float) -> Array:
    """Return, of the plans that gave way, whether another motion would have held the level."""
    gave_way = [row for row in rows if row[lead_column("plan_gave_way", lead)] is True]
    return known(gave_way, lead_column("level_held", lead))


def known(rows: Sequence[Row], name: str) -> Array:
    """Return the known values of a column."""
    values = np.array([np.nan if row[name] is None else row[name] for row in rows], np.float64)
    return np.asarray(values[np.isfinite(values)])


def part(values: Array) -> str:
    """Write how many of all hold."""
    return f"{int(values.sum())} of {values.size}"


def quartiles(values: Array) -> str:
    """Write the median, and the quartiles in brackets."""
    if not values.size:
        return ""
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
    return f"{middle:.2g} [{low:.2g}, {high:.2g}]"


def tables(rows: Sequence[Row]) -> str:
    """Return all tables as text."""
    outcomes = [row["outcome"] for row in rows]
    ends = [{"outcome": one, "episodes": outcomes.count(one)} for one in sorted(set(outcomes))]
    return "\n".join([
        markdown("How the episodes end", ends),
        markdown("Kinds of first contacts", kinds(rows)),
        markdown("Before the contact", leads(rows)),
        markdown("Contacts avoidable once the turn is known", turns(rows)),
    ])  # fmt: skip


def play(options: argparse.Namespace) -> None:
    """Play the episodes, keep the rows and print their tables."""
    asked = options.scenario, options.controller, options.first_seed, options.seeds
    experiment = study(options.config, *asked)
    out = Path(options.out)
    run(experiment, out, workers=options.workers)
    rows = kept(experiment, read_table(out / "table.csv"))
    print(write_table(out / "first_contacts_rows.csv", rows))
    print(tables(rows))


def main(words: Sequence[str] | None = None) -> None:
    """Do what the words of the command line say."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    commands = parser.add_subparsers(required=True)
    playing = commands.add_parser("run", help="play the episodes, or go on, and table them")
    playing.add_argument("--out", required=True, help="folder of the result")
    playing.add_argument("--config", default="random_crowd", help="of a comparison")
    playing.add_argument("--scenario", default="people_10_per_100_m2")
    playing.add_argument("--controller", default="ours")
    playing.add_argument("--first-seed", type=int, default=2000)
    playing.add_argument("--seeds", type=int, default=100)
    playing.add_argument("--workers", type=int, default=1)
    playing.set_defaults(do=play)
    table = commands.add_parser("table", help="table rows that there are")
    table.add_argument("rows", type=Path)
    table.set_defaults(do=lambda options: print(tables(read_table(options.rows))))
    options = parser.parse_args(words)
    options.do(options)


if __name__ == "__main__":
    main()
