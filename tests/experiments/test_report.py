"""Reports: whole, harmless whatever a table holds, and the same bytes each time."""

import base64
import os
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.cli import app as cli
from wideberth.experiments.engine.runner import run
from wideberth.experiments.report.document import (
    Report,
    gather,
    html_table,
    markdown,
    report,
    report_page,
)
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.io import read_table, write_table
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path as Way
from wideberth.simulation.log.episode_log import AgentLog, CommandLog, Episode

NASTY = "<script>alert('x')</script> & \"quoted\" | piped"
VOID = {"meta", "link", "img", "input", "wbr", "br"}


class Page(HTMLParser):
    """Tags that are balanced, their attributes, and the text of cells."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.cells: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open, self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag, (tag, self.getpos())

    def handle_data(self, data: str) -> None:
        if {"td", "th"} & set(self.open):
            self.cells[-1] += data

    def values(self, tag: str, name: str) -> list[str]:
        return [found[name] or "" for one, found in self.tags if one == tag and name in found]


def episode() -> Episode:
    """One robot that drives straight on and makes no plans."""
    times = np.linspace(0.0, 4.0, 41)
    positions = np.stack([0.5 * times, 0.0 * times], axis=1)
    stamps = np.array([1.0, 2.0])
    commands = CommandLog(stamps, stamps, np.zeros((2, 2)), np.zeros(2), np.zeros(2))
    log = AgentLog(
        name="alone", kind="robot", radius=0.3, positions=positions, headings=0.0 * times,
        speeds=0.5 + 0.0 * times, yaw_rates=0.0 * times, paths=((0.0, Way(positions[[0, -1]])),),
        speed=0.5, period=1.0, reached=4.0, skipped=0, commands=commands, plans=(),
    )  # fmt: skip
    return Episode(times, (log,), "goals", 0.2, 0)


@pytest.fixture
def coins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A finished result with a kept episode."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "helpers")
    folder = tmp_path / "coins"
    run(build("experiments", {"type": "sample_plugin:Coins", "throws": 20}), folder)
    (folder / "files" / "run-0.npz").write_bytes(episode().to_bytes())
    return folder


def made(**changes: object) -> Report:
    """A result in which everything that can be is nasty."""
    row = {"planner": NASTY, "share": 0.123456, "count": 3, "won": True, "note": None}
    return replace(
        Report(
            name=NASTY, claim=NASTY, summary=[row], rows=[row], times=[], pictures=[], episodes=[],
            tail=0.05, config=f"name: {NASTY}\n",
            provenance={"cpu": NASTY, "versions": {"x": NASTY}},
        ),
        **changes,
    )  # fmt: skip


def test_report_of_a_result(coins: Path, tmp_path: Path) -> None:
    page, tables = report([coins], tmp_path / "all.html")
    assert (coins / "figures" / "share.png").is_file()  # drawn, since it was missing
    text = page.read_text(encoding="utf-8")
    found = Page(text)
    drawn = base64.b64encode((coins / "figures" / "share.png").read_bytes()).decode()
    assert found.values("img", "src") == [f"data:image/png;base64,{drawn}"]
    assert found.values("img", "alt") == ["Figure “share” of coins"]
    (link,) = [one for one in found.values("a", "href") if one.startswith("data:text/csv")]
    saved = base64.b64decode(link.partition(",")[2]).decode()
    assert saved == (coins / "table.csv").read_text()
    assert "A coin falls on either side equally often." in text and "throws: 20" in text
    assert found.values("script", "data-name") == ["run-0"]
    assert "## coins" in tables.read_text() and tables == tmp_path / "all.md"


def test_nothing_comes_from_elsewhere(coins: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    run(build("experiments", {"type": "sample_plugin:Coins", "seeds": 1}), other)
    page, _ = report([coins, other], tmp_path / "all.html")
    text = page.read_text(encoding="utf-8")
    found = Page(text)
    for tag, attributes in found.tags:
        for name in ("src", "href", "action", "data", "srcset", "poster"):
            value = attributes.get(name)
            assert value is None or value.startswith(("data:", "#")), (tag, name, value)
    code = "".join(re.findall(r"<(?:script|style)>.*?</(?:script|style)>", text, re.DOTALL))
    assert code and not re.search(r"https?:|@import|url\(|fetch\(|XMLHttp|import\(", code)
    named = {one for _, attributes in found.tags if (one := attributes.get("id"))}
    inside = [one[1:] for one in found.values("a", "href") if one.startswith("#")]
    assert {"result-1", "result-2"} <= named and set(inside) <= named
    ids = [one for _, attributes in found.tags if (one := attributes.get("id"))]
    assert len(ids) == len(named)


def test_same_results_same_bytes(coins: Path, tmp_path: Path) -> None:
    first = [path.read_bytes() for path in report([coins], tmp_path / "first.html")]
    assert [path.read_bytes() for path in report([coins], tmp_path / "second.html")] == first


def test_text_stays_text() -> None:
    text = report_page([made()])
    found = Page(text)
    assert [tag for tag, _ in found.tags].count("script") == 1  # the page's own
    assert "<script>alert" not in text and NASTY in found.cells
    assert found.values("a", "download") == [f"{NASTY}.csv"]
    table = markdown([made()])
    assert "<script>" not in table and "\\| piped" in table
    assert {line.count(" | ") for line in table.splitlines() if line.startswith("| ")} == {4}


def test_table_holds_all_digits_for_sorting_and_headers_for_readers() -> None:
    rows = [
        {"planner": "a", "share": 1 / 3, "won": True, "x": np.nan},
        {"planner": "b", "share": None, "won": False, "late": 2},
    ]
    found = Page(html_table(rows, "caption"))
    assert found.cells[:5] == ["planner", "share", "won", "x", "late"]
    assert found.cells[5:] == ["a", "0.3333", "True", "nan", "", "b", "", "False", "", "2"]
    assert found.values("td", "data-value") == [repr(1 / 3), "1.0", "nan", "0.0", "2.0"]
    assert found.values("th", "scope") == ["col"] * 5
    assert [tag for tag, _ in found.tags].count("button") == 5  # reached by the keyboard
    assert Page(html_table([], "nothing")).cells == []


def test_long_table_is_cut_and_large_one_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [{"seed": seed} for seed in range(50)]
    text = report_page([made(rows=rows)])
    assert "the first 20 of 50 rows" in text and "data:text/csv" in text
    monkeypatch.setattr("wideberth.experiments.report.document._LARGEST", 10)
    text = report_page([made(rows=rows)])
    assert "data:text/csv" not in text and "table.csv in the folder" in text


def test_episodes_that_do_not_fit_are_named(
    coins: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("wideberth.experiments.report.document._PLAYERS", 10)
    found = gather(coins)
    text = report_page([found])
    assert "Too large for this page" in text and f"wideberth play {found.episodes[0]}" in text
    assert Page(text).values("script", "data-name") == []


def test_animations_that_do_not_fit_are_named(
    coins: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wideberth.experiments.report.document._FILMS", 100)
    folder = coins / "figures"
    folder.mkdir(exist_ok=True)
    films = {"large.gif": 90, "small.gif": 40, "tiny.gif": 30}
    for name, size in films.items():
        (folder / name).write_bytes(b"GIF89a" + bytes(size - 6))
    one = replace(gather(coins), pictures=[folder / name for name in films])
    page = Page(text := report_page([one]))
    shown = [source for source in page.values("img", "src") if source.startswith("data:image/gif")]
    assert len(shown) == 2
    assert text.count("large.gif</code>") == 1 and "small.gif</code>" not in text


def test_measured_times_stand_apart(tmp_path: Path) -> None:
    times = [{"planner": "a", "median ms": 1.5}]
    text = report_page([made(times=times)])
    assert "<h3>Measured times</h3>" in text and "differ from run to run" in text
    assert "Calls of the controller, as measured:" in markdown([made(times=times)])
    assert "Measured times" not in report_page([made()])


def test_no_result_is_said_so(coins: Path, tmp_path: Path) -> None:
    out = tmp_path / "all.html"
    with pytest.raises(WideberthError, match="holds no result"):
        report([tmp_path / "nowhere"], out)
    with pytest.raises(WideberthError, match="is a file; wanted the folder"):
        report([coins / "table.csv"], out)
    with pytest.raises(WideberthError, match=r"must end in \.html"):
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
    assert code == 0 and "written: report.html" in words and "written: report.md" in words
    coins.rename(coins.parent / "moved")
    Path("results").mkdir()
    Path("moved").rename("results/coins")
    assert shell("report", "coins.yaml", "--out", "named.html")[0] == 0  # as `wideberth show` does
    code, words = shell("report", "absent")
    assert code == 2 and "results/absent holds no result" in words
    code, words = shell("report", "coins", "--out", "no/folder.html")
    assert code == 2 and "cannot be written" in words


def test_figures_of_an_older_drawing_are_kept(coins: Path) -> None:
    (coins / "figures").mkdir()
    (coins / "figures" / "mine.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"\0" * 30)
    assert [path.name for path in gather(coins).pictures] == ["mine.png"]
    write_table(coins / "summary.csv", [{"planner": NASTY}])
    assert read_table(coins / "summary.csv") == gather(coins).summary
