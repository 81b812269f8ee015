"""Reports: whole, harmless whatever a table holds, and the same bytes each time."""

import os
import sys
from pathlib import Path

import pytest

from wideberth.experiments.cli import app as cli
from wideberth.experiments.engine.closed_loop import condense
from wideberth.experiments.engine.column_descriptions import column_texts
from wideberth.experiments.engine.csv_tables import write_table
from wideberth.experiments.engine.runner import run
from wideberth.experiments.report.document import report
from wideberth.framework.plugins.config import build
from wideberth.framework.values.errors import WideberthError

NASTY = "<script>alert('x')</script> & \"quoted\" | piped"


@pytest.fixture
def coins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A finished result."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "helpers")
    folder = tmp_path / "coins"
    run(build("experiments", {"type": "sample_plugin:Coins", "throws": 20}), folder)
    return folder


def test_report_of_results(coins: Path, tmp_path: Path) -> None:
    other = tmp_path / "of two"
    run(build("experiments", {"type": "sample_plugin:Coins", "seeds": 2}), other)
    path = report([coins, other], tmp_path / "all.md")
    assert (coins / "figures" / "share.png").is_file()  # drawn, since it was missing
    text = path.read_text(encoding="utf-8")
    for folder, place in ((coins, "coins"), (other, "of%20two")):
        table = (folder / "summary.md").read_text().partition("\n\n")[2].rstrip()
        assert f"## {folder.name}\n\nA coin falls on either side equally often." in text
        assert f"{table}\n\n![share]({place}/figures/share.png)" in text
    assert text.count("Measured with wideberth ") == 2


def test_same_results_same_bytes(coins: Path, tmp_path: Path) -> None:
    first = report([coins], tmp_path / "first.md").read_bytes()
    assert report([coins], tmp_path / "second.md").read_bytes() == first


def test_text_stays_text(coins: Path, tmp_path: Path) -> None:
    row = {"planner": NASTY, "share": 0.123456, "count": 3, "won": True, "note": None}
    write_table(coins / "summary.csv", [row])
    text = report([coins], tmp_path / "all.md").read_text()
    assert "<script>" not in text and "\\| piped" in text
    assert {line.count(" | ") for line in text.splitlines() if line.startswith("| ")} == {4}


def test_figures_of_an_older_drawing_are_kept(coins: Path, tmp_path: Path) -> None:
    (coins / "figures").mkdir()
    (coins / "figures" / "mine.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    text = report([coins], tmp_path / "all.md").read_text()
    assert "![mine](coins/figures/mine.png)" in text and "share.png" not in text


def test_measured_times_stand_apart(coins: Path, tmp_path: Path) -> None:
    head = "Calls of the controller, as measured:"
    assert head not in report([coins], tmp_path / "all.md").read_text()
    times = {"planner": "a", "median": 0.0015, "p95": 0.002, "p99": 0.002, "max": 0.002}
    write_table(coins / "times.csv", [times])
    text = report([coins], tmp_path / "all.md").read_text()
    assert "| a | 1.5 |" in text.partition(head)[2]


def test_pages_define_columns_by_study() -> None:
    found = {one: column_texts(one) for one in ("planner_parts", "comparison")}
    assert all("unheard_of" not in one for one in found.values())
    assert "area_ratio" not in found["comparison"]
    assert "divided by that of the exact sum" in found["planner_parts"]["area_ratio"]
    assert "surfaces" in found["comparison"]["clearance_min_m"]
    assert "`" not in found["comparison"]["success"]
    assert found["comparison"]["success"].startswith("share of episodes")
    rows = [dict.fromkeys(columns_of_an_episode(), 1.0)]
    assert set(condense(rows)) <= set(column_texts("encounter"))


def columns_of_an_episode() -> list[str]:
    return [
        "time_ratio_worst", "clearance", "plans", "collision", "deadlock", "extra_time_worst",
        "length_ratio_worst", "below_reference", "least_content", "gave_way", "fallbacks",
        "deadline_misses", "errors", "named_forecasts", "coverage",
    ]  # fmt: skip


def test_no_result_is_said_so(coins: Path, tmp_path: Path) -> None:
    out = tmp_path / "all.md"
    with pytest.raises(WideberthError, match="holds no result"):
        report([tmp_path / "nowhere"], out)
    with pytest.raises(WideberthError, match="is a file; wanted the folder"):
        report([coins / "table.csv"], out)
    with pytest.raises(WideberthError, match=r"must end in \.md"):
        report([coins], tmp_path / "all.txt")
    (coins / "table.csv").unlink()
    with pytest.raises(WideberthError, match="not finished"):
        report([coins], out)
    assert not out.exists()


def test_command(
    coins: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(coins.parent)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    monkeypatch.setattr(sys, "path", list(sys.path))

    def shell(*arguments: str) -> tuple[int, str]:
        with pytest.raises(SystemExit) as end:
            cli.main(list(arguments))
        printed = capsys.readouterr()
        code = end.value.code
        return (code if isinstance(code, int) else 0), printed.out + printed.err

    code, words = shell("report", "coins")
    assert code == 0 and "written: report.md" in words
    coins.rename(coins.parent / "moved")
    Path("results").mkdir()
    Path("moved").rename("results/coins")
    assert shell("report", "coins.yaml", "--out", "named.md")[0] == 0  # as `wideberth show` does
    assert "(results/coins/figures/share.png)" in Path("named.md").read_text()
    code, words = shell("report", "absent")
    assert code == 2 and "results/absent holds no result" in words
    code, words = shell("report", "coins", "--out", "no/folder.md")
    assert code == 2 and "cannot be written" in words
