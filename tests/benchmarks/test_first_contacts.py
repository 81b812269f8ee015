"""Tables of first contacts: counts by hand, and the shipped rows behind the page."""

from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from wideberth.experiments.engine.csv_tables import read_table
from wideberth.simulation.measures.first_contact import KINDS, LEADS, lead_column

ROOT = Path(__file__).resolve().parents[2]
BENCHMARKS = ROOT / "benchmarks"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Stand where the script stands: it imports others by their plain names."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return import_module("first_contacts")


def row(kind: str, *more: str, who: str = "orca", **planned: Any) -> dict[str, Any]:
    """One contact of a kind, for which more kinds hold; the same at every lead."""
    made: dict[str, Any] = {"outcome": "collision", "contact_kind": kind, "other_kind": who}
    made |= {f"contact_{name}": name in (kind, *more) for name in KINDS}
    values = {
        **{"avoidable": False, "forecast_error": 0.5, "forecast_deviations": 2.0},
        **{"forecast_risk": 0.02, "plan_clear": None, "plan_gave_way": False},
        **{"plan_rung": "optimal", "level_held": True, **planned},
    }
    for lead in LEADS:
        made |= {lead_column(name, lead): value for name, value in values.items()}
        made[lead_column("avoidable", lead, "_reacting")] = lead >= 1.5
    return made


def test_kinds_and_leads_are_counted(script: Any) -> None:
    nothing = row("") | {"outcome": "success", "contact_kind": None}
    rows = [
        nothing,
        row("turned", "faster", avoidable=True, forecast_error=1.5),
        row("faster", who="social_force", plan_gave_way=True, plan_rung="brake"),
        row("other", plan_gave_way=True, level_held=False, forecast_risk=0.001),
    ]
    lines = {line.pop("kind"): line for line in script.kinds(rows)}
    assert lines["faster"] == {
        "first of those that hold": 1, "holds": 2, "orca": 0, "social_force": 1,
    }  # fmt: skip
    assert lines["other"]["holds"] == 1 and lines["stood"]["holds"] == 0
    assert lines["all"]["first of those that hold"] == 3 and lines["all"]["orca"] == 2
    by_lead = {line["lead_s"]: line for line in script.leads(rows)}
    late = by_lead[0.5]
    assert (late["avoidable"], late["reacting"]) == ("1 of 3", "0 of 3")
    assert by_lead[2.0]["reacting"] == "3 of 3"
    assert late["error_m"] == "0.5 [0.5, 1]" and late["plan clear"] == "0 of 0"
    assert (late["gave way"], late["though held"]) == ("2 of 3", "1 of 2")
    assert (late["risk >= 0.01"], late["optimal"]) == ("2 of 3", "2 of 3")


def test_turns_are_held_against_what_avoids_them(script: Any) -> None:
    """Each is avoidable 1.5 s before, and not 1 s before."""
    rows = [row("turned") | {"contact_turn_before": when} for when in (2.0, 1.2, 0.9)]
    rows.append(row("faster") | {"contact_turn_before": 2.0})
    lines = [tuple(line.values()) for line in script.turns(rows)]
    assert lines == [(0.0, 3, 1, 2), (0.2, 3, 1, 1), (0.4, 3, 1, 1)]


def test_the_study_is_the_shipped_one_at_other_seeds(script: Any) -> None:
    made = script.study("random_crowd", "people_10_per_100_m2", "orca", 3, 2)
    assert list(made.controllers) == ["orca"] == [made.baseline] and made.show == ()
    assert [task.seed for task in made.tasks()] == [3, 4]
    people = made.scenarios["people_10_per_100_m2"].cast(3).people
    played = [
        {"seed": 3, "contact_with": people[2].name, "duration": 1.0, "contact_kind": "other"}
    ]
    (found,) = script.kept(made, played)
    assert found["other_kind"] in ("orca", "social_force", "constant_velocity")
    assert "duration" not in found and found["contact_kind"] == "other"


def test_the_page_has_the_shipped_rows(script: Any) -> None:
    rows = read_table(BENCHMARKS / "first_contacts_rows.csv")
    assert [one["seed"] for one in rows] == list(range(2000, 2100))
    page = (ROOT / "docs" / "random-crowds.md").read_text(encoding="utf-8")
    for lines in (script.kinds(rows), script.leads(rows), script.turns(rows)):
        table = script.markdown("", lines).splitlines()[2:]
        assert set(table) <= set(page.splitlines())
