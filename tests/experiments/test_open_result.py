"""A result in Python and in a paper: data frames, episodes, columns and pivots."""

from pathlib import Path

import pytest

import wideberth
from wideberth.experiments import open_result
from wideberth.experiments.cli import app as cli
from wideberth.experiments.engine.result import UnknownName
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.helpers.player_samples import episode

SUMMARY = """predictor,region,clearance_min_m,gave_way,extra_time
kalman,disc,0.1000000000000000055,,nan
kalman,box_1,0.25,"asked 95 %, held 50 %",1.5
var,disc,0.5,,inf
var,box_1,-0.75,nan,2.0
"""
TABLE = """predictor,seed,clearance,collision
kalman,0,1.0,False
kalman,1,3.0,True
var,0,nan,False
var,1,1.0,False
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a result as older versions wrote it: no manifest, no provenance."""
    result = tmp_path / "meeting"
    (result / "files").mkdir(parents=True)
    (result / "config.yaml").write_text("{type: a_study_that_is_gone, seeds: 2}\n")
    (result / "summary.csv").write_text(SUMMARY)
    (result / "table.csv").write_text(TABLE)
    (result / "files" / "run-0.npz").write_bytes(episode().to_bytes())
    (result / "files" / "run-1.npz").write_bytes(b"PK, but no archive")
    (result / "files" / "notes.txt").write_text("mine")
    return result


def test_tables_config_and_episodes(folder: Path) -> None:
    result = wideberth.open_result(str(folder))
    assert result.name == "meeting" and result.config["seeds"] == 2
    frame = result.tables["summary"]
    assert frame["clearance_min_m"].tolist() == [0.1, 0.25, 0.5, -0.75]
    assert frame["extra_time"].tolist()[1:] == [1.5, float("inf"), 2.0]
    assert frame["gave_way"].isna().tolist() == [True, False, True, True]
    assert result.tables["table"]["collision"].sum() == 1
    assert list(result.tables) == ["summary", "table"] and "times" not in result.tables
    assert list(result.episodes) == ["run-0"]
    assert result.episodes["run-0"].to_bytes() == episode().to_bytes()
    assert repr(result).splitlines()[1:] == ["  tables: summary, table", "  episodes: run-0"]
    with pytest.raises(UnknownName, match=r"^unknown table 'sumary': did you mean 'summary'"):
        result.tables["sumary"]


def test_what_is_no_result(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(WideberthError, match="did you mean 'meeting'"):
        open_result(folder.parent / "meting")
    monkeypatch.chdir(folder.parents[1])
    folder.parent.rename(folder.parents[1] / "results")
    with pytest.raises(WideberthError, match="did you mean 'results/meeting'"):
        open_result("meeting")
    folder = Path("results") / "meeting"
    (folder / "table.csv").unlink()
    with pytest.raises(WideberthError, match="not finished"):
        open_result(folder)


def shown(folder: Path, *options: str) -> str:
    """Return what `wideberth show` prints."""
    with pytest.raises(SystemExit) as end:
        cli.main(["show", str(folder), *options])
    return "" if end.value.code in (0, None) else str(end.value.code)


def test_columns_and_pivots(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert not shown(folder, "--columns", "region,clearance_min_m,gave_way", "--latex")
    lines = capsys.readouterr().out.splitlines()
    assert lines[:5] == [
        r"\begin{tabular}{lrl}", r"\toprule", r"region & clearance min (m) & gave way \\",
        r"\midrule", r"disc & 0.10 &  \\",
    ]  # fmt: skip
    assert lines[5] == r"box\_1 & 0.25 & asked 95 \%, held 50 \% \\"
    pivot = "predictor,region,clearance_min_m"
    assert not shown(folder, "--pivot", pivot, "--latex")
    out = capsys.readouterr().out
    assert r" & \multicolumn{2}{c}{clearance min (m)} \\" in out
    assert r"predictor & disc & box\_1 \\" in out and r"var & 0.5 & $-$0.75 \\" in out
    assert not shown(folder, "--columns", "predictor,extra_time,gave_way", "--latex")
    out = capsys.readouterr().out  # unknown and endless numbers
    assert r"kalman & -- &  \\" in out and r"var & $\infty$ &  \\" in out
    assert r"var & 2.0 & -- \\" in out and "nan" not in out
    assert not shown(folder, "--pivot", pivot, "--markdown")
    assert capsys.readouterr().out.splitlines() == [
        "clearance min (m)", "", "| predictor | disc | box_1 |", "| :-- | --: | --: |",
        "| kalman | 0.1 | 0.25 |", "| var | 0.5 | -0.75 |",
    ]  # fmt: skip
    assert not shown(folder, "--pivot", "predictor,collision,clearance")  # table.csv has it
    assert "│ kalman" in capsys.readouterr().out
    assert not shown(folder, "--pivot", "collision,predictor,clearance", "--markdown")
    printed = capsys.readouterr()  # the seed without a clearance is not left out of its mean
    assert "| False | 1 | \u2013 |" in printed.out and "| True | 3 | \u2013 |" in printed.out
    assert printed.err == "each cell is the mean of up to 2 lines of table.csv\n"


def test_a_list_of_columns_may_have_spaces(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not shown(folder, "--columns", "region,clearance_min_m")
    printed = capsys.readouterr().out
    assert not shown(folder, "--columns", "region, clearance min (m)")
    assert capsys.readouterr().out == printed
    assert not shown(folder, "--pivot", "predictor, region, clearance_min_m")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--columns", "regoin"), "unknown column 'regoin': did you mean 'region'?"),
        (("--columns", "region,seed"), "has all of region, seed"),
        (("--pivot", "predictor,region"), "wanted three different columns"),
        (("--pivot", "predictor,region,gave_way"), "holds text"),
        (("--latex", "--markdown"), "give one of them"),
    ],
)
def test_bad_choices(
    folder: Path, options: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert shown(folder, *options) == "2"
    refused = capsys.readouterr().err
    assert message in refused
    assert ("--columns all` prints all" in refused) == ("unknown column" in refused)
    assert "Known:" not in refused  # a hundred names would hide the near one
