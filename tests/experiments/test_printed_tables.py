"""Printed tables answer the question first, and write shares, counts and lengths as such."""

import re
from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.cli import app as cli
from wideberth.experiments.engine.column_descriptions import (
    column_meanings,
    column_texts,
    defined_columns,
    shares,
)
from wideberth.experiments.engine.csv_tables import read_table, write_table
from wideberth.experiments.engine.extract import (
    Extract,
    aligned,
    extract,
    latex_text,
    markdown_text,
    of_rows,
)
from wideberth.experiments.engine.text_tables import headed, main_columns, print_table
from wideberth.experiments.studies.comparison import Comparison
from wideberth.experiments.studies.episode_statistics import against, condensed
from wideberth.framework.plugins.registry import load, names
from wideberth.simulation.measures.episode_measures import measures
from wideberth.simulation.measures.summary import summarise
from wideberth.tests.helpers.player_samples import episode

ROW = {"planner": "ours", "goals_in_time": 1, "collisions": 1, "coverage": 0.953, "time_s": 1.0}


def condensed_rows() -> list[dict[str, object]]:
    """Return the summary of a comparison, of two controllers in three episodes each."""
    played = episode()
    row = {**summarise(played), **measures(played, 0.05, 30.0)}
    row |= {"avoidable_2s": None, "contact_kind": "", "errors": ""}
    rows = [{**row, "seed": seed} for seed in range(3)]
    line = condensed(rows) | against(rows, rows)
    return [{"scenario": "field", "controller": name, **line} for name in ("ours", "theirs")]


def test_a_comparison_prints_what_answers_its_question() -> None:
    rows = condensed_rows()
    assert len(rows[0]) > 30
    found = main_columns(rows, Comparison.printed)
    assert found == [
        "scenario", "controller", "episodes", "success", "p_success", "collision", "time_mean_s",
        "time_difference_s", "clearance_median_m", "intrusion_share",
    ]  # fmt: skip
    rows[1] |= {"errors": "KeyError 2", "success": 0.5, "p_success": 0.25}
    found = main_columns(rows, Comparison.printed)  # nine: what does not differ is left out
    assert found == ["scenario", "controller", "success", "p_success", "errors"]


def test_a_study_that_names_no_columns_prints_what_differs() -> None:
    rows = condensed_rows()
    assert main_columns(rows[:1], ()) == list(rows[0])  # a single line stands on its side
    rows[1] |= {"success": 0.5, "frozen": 0.5}
    assert main_columns(rows, ()) == ["scenario", "controller", "success", "frozen"]
    rows[1] |= {name: 7.0 for name in rows[0] if isinstance(rows[0][name], float)}
    many = main_columns(rows, ())
    assert len(many) == 2 + 8 and set(many) <= set(rows[0])


def test_the_digits_of_a_column_follow_its_interval(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text("{type: comparison}\n")
    line = {"controller": "ours", "success": 0.973333, "time_mean_s": 12.34567}
    rows = [
        line | {"success_low": low, "success_high": 0.99, "time_difference_s": 1.23456,
                "time_difference_low_s": 1.2, "time_difference_high_s": 1.27}
        for low in (0.9, 0.93)
    ]  # fmt: skip
    write_table(tmp_path / "summary.csv", rows)
    columns = ["success", "time_mean_s", "time_difference_s", "time_difference_low_s"]
    *_, last, _, _ = latex_text(extract(tmp_path, columns)).splitlines()
    assert last == r"97.3 & 12.35 & 1.235 & 1.2 \\"


@pytest.mark.parametrize(("share", "factor"), [(True, 100.0), (False, 1.0)])
def test_an_error_is_half_of_the_median_width_of_the_intervals(share: bool, factor: float) -> None:
    """Of a row without both ends, or with an end that is unknown, nothing is taken."""
    name = "success" if share else "time_difference_s"
    stem, unit = ("success", "") if share else ("time_difference", "_s")
    widths = [0.02, 0.16, 0.06]
    rows = [
        {
            name: 0.5,
            f"{stem}_low{unit}": 0.5 - 0.25 * width,
            f"{stem}_high{unit}": 0.5 + 0.75 * width,
        }
        for width in widths
    ]
    rows.append({name: 0.5, f"{stem}_low{unit}": 0.0, f"{stem}_high{unit}": float("nan")})
    rows.append({name: 0.5, f"{stem}_low{unit}": None, f"{stem}_high{unit}": 1.0})
    chosen = of_rows("comparison", rows, [name, f"{stem}_low{unit}", f"{stem}_high{unit}"])
    assert list(chosen.errors) == list(rows[0])  # of the ends it is that of the quantity
    for error in chosen.errors.values():
        assert error == pytest.approx(factor * 0.5 * np.median(widths), rel=1e-12)
    for alone in (f"{stem}_high{unit}", f"{stem}_low{unit}"):
        half = [{key: value for key, value in row.items() if key != alone} for row in rows]
        assert not of_rows("comparison", half, [name]).errors


def test_the_median_of_two_widths_is_their_mean() -> None:
    rows = [{"clearance": 1.0, "clearance_low": 0.0, "clearance_high": end} for end in (0.2, 0.6)]
    assert of_rows("comparison", rows, ["clearance"]).errors == {"clearance": pytest.approx(0.2)}


HOSTILE = [
    "a\nb",
    "a\r\nb",
    "a\x0cb",
    "a\u2028b",
    "a\x0bb\x85c",
    "a | b",
    "a & b \\\\ c",
    "[1]",
    "*",
]
"""Names that end a row, or that LaTeX reads as an option of the row's end before."""


@pytest.mark.parametrize("name", HOSTILE)
def test_a_name_stays_in_its_row(name: str) -> None:
    rows: list[dict[str, object]] = [
        {"planner": "ours", "b": 1.0}, {"planner": name, "b": 2.0}, {name: "c"}
    ]  # fmt: skip
    chosen = Extract(rows, measure=name)
    assert len(latex_text(chosen).splitlines()) == 6 + 1 + len(rows)
    for line in latex_text(Extract(rows)).splitlines()[2:-1]:
        assert not line.startswith(("[", "*"))
        assert not line.endswith(r"\\") or len(re.findall(r"(?<!\\)&", line)) == 2
    table = markdown_text(chosen).splitlines()
    assert len(table) == 2 + 2 + len(rows)
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in table[2:]} == {4}


@pytest.mark.parametrize("text", ["=1+1", "+1+1", "-1+1", "@SUM(1)", "=cmd|' /C calc'!A0", "\t=1"])
def test_a_csv_file_holds_text_as_it_is(tmp_path: Path, text: str) -> None:
    """A spreadsheet may take it for a formula, as SECURITY.md says."""
    rows = [{"name": text, "number": -1.5}]
    path = write_table(tmp_path / "t.csv", rows)
    assert read_table(path) == rows
    assert path.read_text() == f"name,number\n{text},-1.5\n"


def test_units_stand_above_a_pivot_too(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text("{type: comparison}\n")
    rows = [{"speed_mps": v, "delay_s": d, "success": 0.5} for v in (0.5, 1.0) for d in (0.1, 0.2)]
    write_table(tmp_path / "summary.csv", [*rows[:3]])
    found = extract(tmp_path, pivot=("speed_mps", "delay_s", "success"))
    assert markdown_text(found).splitlines() == [
        "success (%)", "", "| speed (m/s) | 0.1 s | 0.2 s |", "| --: | --: | --: |",
        "| 0.5 | 50 | 50 |", "| 1 | 50 | \u2013 |",
    ]  # fmt: skip
    assert r" & \multicolumn{2}{c}{success (\%)} \\" in latex_text(found)


def test_what_a_column_means_is_one_command_away(capsys: pytest.CaptureFixture[str]) -> None:
    def printed(*words: str) -> str:
        with pytest.raises(SystemExit):
            cli.main(["show", *words])
        captured = capsys.readouterr()
        return captured.out + captured.err

    assert "p_success (comparison" in printed("column", "p_success")
    assert "McNemar" in printed("column", "p_success")
    assert printed("column", "time_ratio").startswith("time_ratio")
    refused = printed("column", "sucess")
    assert "did you mean 'success'" in refused
    assert "https://wideberth.readthedocs.io/en/latest/results.html" in " ".join(refused.split())
    assert "none was named" in printed("column")
    for name in condensed_rows()[0]:
        assert printed("column", name).startswith(name)


def test_a_meaning_stands_alone() -> None:
    apart = [
        ("tail_nominal", "tail_observed"), ("step_risk", "step_touched"), ("timeout", "deadlock"),
        ("aimed_successors", "lowered_successors"), ("feasible_successors", "lowered_successors"),
        ("infeasible_successors_per_10000", "lowered_successors_per_10000"),
        ("success_low", "collision_low"), ("coverage", "coverage_last"),
    ]  # fmt: skip
    found = column_texts("comparison")
    assert all(found[one] != found[other] for one, other in apart)
    elsewhere = re.compile(
        r"^(the same\b(?! as)|its rung|those )|\b(that|these|those) "
        r"(share|difference|clearance|maximum|regions|outcomes|reasons|areas|errors|seeds)\b"
        r"|\bthere was one\b"
    )
    said = {name: column_meanings(name) for name in defined_columns()}
    meanings = {name: [line.split(": ", 1)[1] for line in lines] for name, lines in said.items()}
    assert [
        name for name, texts in meanings.items() for text in texts if elsewhere.search(text)
    ] == []


@pytest.mark.parametrize("study", names("experiments"))
def test_printed_columns_are_few(study: str) -> None:
    kind = load("experiments", study)
    assert len(kind.printed) <= 11 and len(set(kind.printed)) == len(kind.printed)
    assert {*kind.printed} <= {*defined_columns()}  # `wideberth show column` knows each


def test_the_pages_say_what_is_a_share() -> None:
    columns = list(condensed_rows()[0])
    found = shares("comparison", columns)
    assert found == {
        "success", "success_low", "success_high", "collision", "collision_low", "collision_high",
        "timeout", "deadlock", "avoidable_2s", "intrusion_share", "freeze_share", "coverage",
        "frozen", "fallback_plans",
    }  # fmt: skip
    line = condensed_rows()[0]
    values = [line[name] for name in found if isinstance(line[name], float)]
    assert all(0.0 <= value <= 1.0 for value in values if value == value)
    assert shares("encounter", ["collisions", "deadlocks", "goals_in_time", "kept"]) == {
        "goals_in_time", "kept",
    }  # fmt: skip


def test_shares_are_printed_in_per_cent_and_counts_as_counts(
    capsys: pytest.CaptureFixture[str],
) -> None:
    rows = [ROW, {**ROW, "goals_in_time": float("nan"), "coverage": 1.0}]
    print_table(rows, shares("encounter", list(ROW)))
    cells = [
        line.split("│")[1:-1] for line in capsys.readouterr().out.splitlines() if "ours" in line
    ]
    assert [[cell.strip() for cell in line] for line in cells] == [
        ["ours", "100 %", "1", "95.3 %", "1"], ["ours", "\u2013", "1", "100 %", "1"],
    ]  # fmt: skip


def test_a_cell_that_holds_nothing_is_a_dash(capsys: pytest.CaptureFixture[str]) -> None:
    print_table([{"planner": "ours", "errors": "", "contact_kinds": None, "success": True}])
    line = next(line for line in capsys.readouterr().out.splitlines() if "ours" in line)
    cells = [cell.strip() for cell in line.split("│")[1:-1]]
    assert cells == ["ours", "\u2013", "\u2013", "True"]


def test_the_rest_is_shown_on_request(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "config.yaml").write_text("{type: comparison}\n")
    write_table(tmp_path / "summary.csv", condensed_rows())
    write_table(tmp_path / "table.csv", [{"seed": 0}])
    for options, digits in (([], 10), (["--columns", "all"], len(condensed_rows()[0]))):
        with pytest.raises(SystemExit):
            cli.main(["show", str(tmp_path), "--latex", *options])
        _, _, head, _, *lines = capsys.readouterr().out.splitlines()
        assert head.count("&") == digits - 1 and r"success (\%)" in head
        assert "nan" not in " ".join(lines)


@pytest.mark.parametrize("seed", range(50))
def test_a_column_of_a_paper_has_one_number_of_digits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sizes = 10.0 ** rng.uniform(-8.0, 6.0, 5) * rng.choice([-1.0, 1.0], 5)
    values = [*sizes.tolist(), 0.0, float("nan"), None]
    *known, zero, unknown, empty = aligned(values)
    assert (unknown, empty) == ("\u2013", "")
    assert len({len(text.partition(".")[2]) for text in (*known, zero)}) == 1
    for text, value in zip(known, values, strict=False):
        last = 10.0 ** -len(text.partition(".")[2])
        if text.startswith("<"):
            assert value is not None and 0.0 < value < 0.5 * last == 0.5 * float(text[1:])
        else:
            assert abs(float(text) - value) <= 0.5001 * last


@pytest.mark.parametrize("share", [False, True])
def test_printed_headings_are_names_of_columns(tmp_path: Path, share: bool) -> None:
    (tmp_path / "config.yaml").write_text("{type: comparison}\n")
    rows = condensed_rows()
    write_table(tmp_path / "summary.csv", rows)
    write_table(tmp_path / "table.csv", [{"seed": 0}])
    names = [name for name in rows[0] if (name in shares("comparison", [name])) == share]
    headings = [headed(name, share) for name in names]
    assert list(extract(tmp_path, headings).rows[0]) == names
    for name, heading in zip(names, headings, strict=True):
        if name in defined_columns():
            assert column_meanings(heading) == column_meanings(name)
    pivot = extract(tmp_path, pivot=("scenario", "controller", headed("success", True)))
    assert pivot.measure == "success (%)"


def test_why_a_cell_is_a_dash_can_be_asked(capsys: pytest.CaptureFixture[str]) -> None:
    for name, words in (("time mean (s)", "NaN without one"), ("coverage", "no episode, pair")):
        with pytest.raises(SystemExit):
            cli.main(["show", "column", name])
        printed = " ".join(capsys.readouterr().out.split())
        assert words in printed and "A dash (\u2013)" in printed
