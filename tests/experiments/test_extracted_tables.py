"""Parts of a result's tables: which table, which cells, which digits."""

from html import unescape
from math import inf, log10, nan
from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.engine.csv_tables import Row, write_table
from wideberth.experiments.engine.extract import (
    Extract,
    aligned,
    answers,
    extract,
    html_text,
    latex_text,
    markdown_text,
    of_rows,
    study_of,
)
from wideberth.framework.values.errors import WideberthError


def result(folder: Path, **tables: list[Row]) -> Path:
    (folder / "config.yaml").write_text("{type: comparison}\n")
    for name, rows in tables.items():
        write_table(folder / f"{name}.csv", rows)
    return folder


def test_the_first_table_that_has_all_columns_is_taken(tmp_path: Path) -> None:
    folder = result(
        tmp_path,
        summary=[{"controller": "ours", "success": 0.5}],
        table=[{"controller": "ours", "seed": 3, "success": 1.0}],
        times=[{"controller": "ours", "seed": 3, "solve_s": 0.25}],
    )
    assert extract(folder, ["success"]).rows == [{"success": 0.5}]
    assert extract(folder, ["seed", "success"]).rows == [{"seed": 3, "success": 1.0}]
    assert extract(folder, ["solve_s"]).rows == [{"solve_s": 0.25}]
    assert extract(folder).rows == [{"controller": "ours", "success": 0.5}]
    with pytest.raises(WideberthError, match=r"no table of .* has all of success, solve_s"):
        extract(folder, ["success", "solve_s"])
    with pytest.raises(WideberthError, match=r"unknown column 'sucess'.*did you mean 'success'"):
        extract(folder, ["success", "sucess"])
    assert study_of(folder) == "comparison"


def test_columns_and_a_pivot_are_not_asked_for_at_once(tmp_path: Path) -> None:
    folder = result(tmp_path, summary=[{"a": 1.0, "b": 2.0, "c": 3.0, "d": "x"}])
    with pytest.raises(WideberthError, match="--columns and --pivot were both given"):
        extract(folder, ["a"], ["a", "b", "c"])
    for names in (["a", "b"], ["a", "b", "a"], ["a", "b", "c", "d"]):
        with pytest.raises(WideberthError, match="wanted three different columns"):
            extract(folder, pivot=names)
    with pytest.raises(WideberthError, match="the column 'd' holds text"):
        extract(folder, pivot=["a", "b", "d"])


def test_a_cell_of_a_pivot_is_the_mean_of_its_lines(tmp_path: Path) -> None:
    rows: list[Row] = [
        {"controller": name, "speed_mps": speed, "time_mean_s": time}
        for name, speed, time in (
            ("ours", 0.5, 1.0), ("ours", 0.5, 2.0), ("ours", 0.5, 6.0), ("theirs", 1.0, 4.0),
            ("ours", 1.0, 0.25), ("theirs", 2.0, None),
        )
    ]  # fmt: skip
    chosen = extract(
        result(tmp_path, table=rows), pivot=["controller", "speed_mps", "time_mean_s"]
    )
    expected = [["ours", 3.0, 0.25, nan], ["theirs", nan, 4.0, nan]]
    assert [row["controller"] for row in chosen.rows] == ["ours", "theirs"]
    np.testing.assert_array_equal(
        [list(row.values())[1:] for row in chosen.rows], [row[1:] for row in expected]
    )
    assert list(chosen.rows[0]) == ["controller", "0.5 m/s", "1 m/s", "2 m/s"]
    assert chosen.note == "each cell is the mean of up to 3 lines of table.csv"
    assert chosen.measure == "time mean (s)" and not chosen.shares
    two = extract(
        result(tmp_path, table=rows[1:]), pivot=["controller", "speed_mps", "time_mean_s"]
    )
    assert two.note == "each cell is the mean of up to 2 lines of table.csv"
    single = result(tmp_path, table=rows[-3:])
    assert extract(single, pivot=["controller", "speed_mps", "time_mean_s"]).note == ""


@pytest.mark.parametrize("across", ["delay_s", "controller"])
def test_labels_of_a_pivot_that_print_alike_stay_apart(tmp_path: Path, across: str) -> None:
    """Each label has a column, and a line, of its own; those that are not known share one."""
    lines = {"delay_s": "controller", "controller": "delay_s"}[across]
    labels = [1000.1, 1000.2, 1e-9, -0.0, nan, nan]
    rows: list[Row] = [
        {"controller": "controller", "delay_s": label, "time_s": float(i)}
        for i, label in enumerate(labels)
    ]
    chosen = extract(result(tmp_path, table=rows), pivot=[lines, across, "time_s"])
    if across == "delay_s":
        heads = ["controller", "1000.1 s", "1000.2 s", "1e\u221209 s", "0.0 s", "\u2013 s"]
        assert list(chosen.rows[0].items()) == list(
            zip(heads, ["controller", 0.0, 1.0, 2.0, 3.0, 4.5], strict=True)
        )
    else:
        assert [list(row.values()) for row in chosen.rows] == [
            ["1000.1", 0.0], ["1000.2", 1.0], ["1e\u221209", 2.0], ["0.0", 3.0], ["\u2013", 4.5],
        ]  # fmt: skip


def test_a_label_named_as_the_column_of_the_lines_keeps_its_own_column(tmp_path: Path) -> None:
    rows: list[Row] = [{"a": "x", "b": "a", "c": 1.0}, {"a": "x", "b": "a (2)", "c": 2.0}]
    (row,) = extract(result(tmp_path, table=rows), pivot=["a", "b", "c"]).rows
    assert row["a"] == "x" and sorted(row.values(), key=str) == [1.0, 2.0, "x"]


def test_latex_reads_no_line_as_an_option_and_no_minus_as_a_hyphen() -> None:
    """Blanks behind a line's end do not keep LaTeX from reading `[` or `*` as its option."""
    names = ["[1 m]", " [b]", "\n*c", "ours-2"]
    rows: list[Row] = [
        {"controller": name, "x": x}
        for name, x in zip(names, [-1.5, -1e-9, -inf, 2.0], strict=True)
    ]
    lines = latex_text(Extract(rows)).splitlines()[4:-2]
    assert lines == [
        r"{}[1 m] & $-$1.50000 \\", r"{}[b] & 0.00000 \\", r"{}*c & $-$$\infty$ \\",
        r"ours-2 & 2.00000 \\",
    ]  # fmt: skip


def test_a_pivot_of_shares_is_in_per_cent(tmp_path: Path) -> None:
    rows: list[Row] = [{"controller": "ours", "speed_mps": 0.5, "success": 0.875}]
    chosen = extract(result(tmp_path, summary=rows), pivot=["controller", "speed_mps", "success"])
    assert chosen.shares == {"0.5 m/s"} and chosen.measure == "success (%)"
    assert markdown_text(chosen).splitlines()[-1] == "| ours | 87.5 |"


def test_a_table_is_written_for_markdown_html_and_latex() -> None:
    rows: list[Row] = [
        {"controller": "a_1", "success": 0.5, "time_mean_s": 1.25},
        {"controller": "b<c", "success": nan, "time_mean_s": inf},
    ]
    chosen = of_rows("comparison", rows, ["controller", "success", "time_mean_s"])
    assert markdown_text(chosen).splitlines() == [
        "| controller | success (%) | time mean (s) |", "| :-- | --: | --: |",
        "| a_1 | 50 | 1.25 |", "| b&lt;c | \u2013 | inf |",
    ]  # fmt: skip
    assert html_text(chosen) == (
        "<table><tr><th>controller</th><th>success (%)</th><th>time mean (s)</th></tr>"
        "<tr><td>a_1</td><td>50</td><td>1.25</td></tr>"
        "<tr><td>b&lt;c</td><td>\u2013</td><td>inf</td></tr></table>"
    )
    assert latex_text(chosen).splitlines() == [
        r"\begin{tabular}{lrr}", r"\toprule",
        r"controller & success (\%) & time mean (s) \\", r"\midrule",
        r"a\_1 & 50 & 1.25 \\", r"b$<$c & -- & $\infty$ \\", r"\bottomrule", r"\end{tabular}",
    ]  # fmt: skip


def test_lines_without_an_interval_leave_that_of_the_others() -> None:
    ends = [(0.5, 0.7), (None, 0.9), (0.1, None), (0.2, nan), (0.3, 0.7)]
    rows: list[Row] = [{"x_s": 1.0, "x_low_s": low, "x_high_s": high} for low, high in ends]
    errors = of_rows("comparison", rows, ["x_s", "x_low_s", "x_high_s"]).errors
    assert errors == pytest.approx(dict.fromkeys(["x_s", "x_low_s", "x_high_s"], 0.15))
    assert of_rows("comparison", [{"x_s": 1.0, "x_low_s": 0.5}], ["x_s"]).errors == {}


def test_above_a_pivot_stands_its_measure() -> None:
    rows: list[Row] = [{"controller": "a", "x": 1.0, "y": 2.0, "z": 3.0}]
    lines = latex_text(Extract(rows, "time (s)")).splitlines()
    assert lines[2:4] == [
        r" & \multicolumn{3}{c}{time (s)} \\", r"controller & x & y & z \\",
    ]  # fmt: skip
    assert latex_text(Extract(rows)).splitlines()[2] == r"controller & x & y & z \\"
    assert markdown_text(Extract(rows, "time (s)")).startswith("time (s)\n\n| controller |")


def test_answers_are_those_of_the_study(tmp_path: Path) -> None:
    rows: list[Row] = [{"controller": "ours", "success": 0.5}, {"controller": "b", "success": 1.0}]
    chosen = answers(result(tmp_path, summary=rows))
    assert chosen.rows == rows and chosen.shares == {"success"}


@pytest.mark.parametrize(
    ("values", "cells"),
    [
        ([1234.5678, 12.0], ["1235", "12"]),
        ([123.45, 1.0], ["123.5", "1.0"]),
        ([9.87654, 0.5], ["9.877", "0.500"]),
        ([1234.0, 0.51], ["1234.00", "0.51"]),
        ([1234.0, 0.0123], ["1234.00", "0.01"]),
        ([1234.0, 0.00123], ["1234.00", "<0.01"]),
        ([1234.0, 0.0049], ["1234.00", "<0.01"]),
        ([1234.0, 0.0051], ["1234.00", "0.01"]),
        ([-1234.0, -0.00123], ["-1234.00", "0.00"]),
        ([1234.0, 1.26], ["1234.0", "1.3"]),
        ([99.99, 10.0], ["99.99", "10.00"]),
        ([1.0, 2.0], ["1", "2"]),
        ([0.25, 0.5], ["0.25", "0.50"]),
        ([0.0, 0.0], ["0", "0"]),
        ([inf, -inf, 1.5], ["\u221e", "-\u221e", "1.5"]),
        ([True, "words", None, nan], ["True", "words", "", "\u2013"]),
        ([0.00012345], ["0.0001234"]),
    ],
)
def test_a_column_has_four_digits_of_its_largest_number(
    values: list[object], cells: list[str]
) -> None:
    assert aligned(values) == cells


@pytest.mark.parametrize("error", [0.0123, 0.123, 0.5, 1.0, 3.2, 10.0, 45.0, 2e3])
def test_two_digits_of_an_error_are_enough(error: float) -> None:
    cell = aligned([97.65432, 8.125], error)[0]
    digits = len(cell.partition(".")[2])
    wanted = max(1 - int(np.floor(log10(error))), 0)
    assert digits == min(wanted, 2)


def test_without_an_error_there_are_four_digits() -> None:
    assert aligned([97.65432, 8.125]) == ["97.65", "8.12"]


@pytest.mark.parametrize(
    "name", ["_a_", "__b__", "a_b", "a__b", "~~c~~", "$d$ and $e$", "*f*", "[g](h)", "`i`", "<j>"]
)
def test_markdown_shows_a_name_as_it_is(name: str) -> None:
    """Against another library: the table's cell is read back as the plain text of the name."""
    markdown = pytest.importorskip("markdown_it", reason="renders Markdown, of the group docs")
    page = markdown.MarkdownIt("commonmark").enable(["table", "strikethrough"])
    html = page.render(markdown_text(Extract([{"controller": name, "x": 1.0}])))
    cell = html.split("<td")[1].split(">", 1)[1].split("</td>")[0]
    assert unescape(cell) == name and "<" not in cell
    assert "$" not in markdown_text(Extract([{"x": name}])).replace("\\$", "")  # read as formulas
