"""What commands print fits the terminal: broken between words, and nothing is lost."""

import re
from collections.abc import Callable

import pytest

from wideberth.experiments.cli import app as cli
from wideberth.experiments.engine.base import Row
from wideberth.experiments.engine.line_width import width, wrapped
from wideberth.experiments.engine.text_tables import print_table
from wideberth.framework.plugins.registry import ROOMS, names

LONG = "asked 95 %, holds 39 % from step 9 on, because of 'the_lower_robot_of_two'"
SIDEWAYS = [
    {
        "planner": name,
        **{f"a_measure_called_{i}": 0.125 * i for i in range(9)},
        "gave_way": LONG,
    }
    for name in ("recommended", "paper")
]
UPRIGHT = [
    {"predictor": f"number_{i}", "region": "r", **{f"a_measure_{k}": 0.1 + k for k in range(12)},
     "gave_way": LONG}
    for i in range(6)
]  # fmt: skip


@pytest.mark.parametrize("columns", [60, 80, 120])
@pytest.mark.parametrize("rows", [SIDEWAYS, UPRIGHT])
def test_tables_fit_and_break_no_word(
    rows: list[Row],
    columns: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    print_table(rows)
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= columns
    words = set(re.split(r"[\s│┃]+", text))
    assert set(LONG.split()) | {str(row[next(iter(row))]) for row in rows} <= words
    numbers = {f"{value:.4g}" for row in rows for value in row.values() if type(value) is float}
    assert numbers <= words


def test_two_planners_stand_beside_each_other(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    print_table(SIDEWAYS)
    assert capsys.readouterr().out.count("a_measure_called_3") == 1


@pytest.fixture
def printed(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    def call(*arguments: str) -> str:
        with pytest.raises(SystemExit) as end:
            cli.main([*arguments])
        assert end.value.code in (0, None)
        return capsys.readouterr().out

    return call


@pytest.mark.parametrize("arguments", [["list"], ["list", "regions"], ["list", "configs"]])
def test_lists_fit(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, printed: Callable[..., str]
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    piped = printed(*arguments)
    monkeypatch.setenv("COLUMNS", "80")
    shown = printed(*arguments)
    assert max(map(len, piped.splitlines())) > 80 >= max(map(len, shown.splitlines()))
    assert shown.split() == piped.split()


def test_descriptions_fit(monkeypatch: pytest.MonkeyPatch, printed: Callable[..., str]) -> None:
    for room in ROOMS:
        for name in names(room):
            monkeypatch.delenv("COLUMNS", raising=False)
            piped = printed("describe", room, name)
            monkeypatch.setenv("COLUMNS", "80")
            shown = printed("describe", room, name)
            assert shown.split() == piped.split(), name
            long = [line for line in shown.splitlines() if len(line) > 80]
            assert all(len(line.split()) <= 1 for line in long), (name, long)  # a long reference


def test_paragraphs_are_filled_and_formulas_stand_alone() -> None:
    prose = "Words that fill a line of a paragraph to its end, for it goes on in\nthe next one."
    formula = "x = F y + w,  w ~ N(0, Q)"
    text = wrapped(f"{prose}\n\n{formula}\nand more", 40)
    assert text.split() == f"{prose} {formula} and more".split()
    assert f"\n\n{formula}\nand more" in text
    assert "for it goes on in the next one." in text
    assert wrapped(prose, None) == prose == wrapped(prose, 80)
    bullet = "- one two three"
    assert wrapped(f"  {bullet}", 12) == "  - one two\n    three"


def test_the_width_is_that_of_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "70")
    assert width() == 70
    monkeypatch.delenv("COLUMNS")
    assert width() is None  # captured: no terminal
