"""Reports: whole, harmless whatever a table holds, and the same bytes each time."""

import base64
import inspect
import os
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from fnmatch import fnmatch
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.cli import app as cli
from wideberth.experiments.engine.closed_loop import condense
from wideberth.experiments.engine.column_descriptions import column_descriptions
from wideberth.experiments.engine.csv_tables import read_table, write_table
from wideberth.experiments.engine.runner import run
from wideberth.experiments.report.document import Report, gather, markdown, report, report_page
from wideberth.experiments.report.tables import html_table
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import load, names
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
    assert "<dt>share</dt>" in text  # of a study that names no headline, its first numbers
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
    assert found.cells[5:] == ["a", "0.3333", "yes", "\u2013", "", "b", "", "no", "", "2"]
    assert found.values("td", "data-value") == [repr(1 / 3), "1.0", "nan", "0.0", "2.0"]
    assert found.values("th", "scope") == ["col"] * 5
    assert [tag for tag, _ in found.tags].count("button") == 5  # reached by the keyboard
    assert Page(html_table([], "nothing")).cells == []


def test_what_was_found_comes_first(coins: Path) -> None:
    (coins / "figures").mkdir()
    for name in ("run_a", "views_a"):
        (coins / "figures" / f"{name}.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"\0" * 30)
    rows = [
        {"planner": name, "share": share, "collisions": touched, "clearance_min_m": near}
        for name, share, touched, near in (("a", 1, 0, 0.5), ("b", 1, 2, -0.25), ("c", 1, 0, 0.5))
    ]
    captions = {"views_*": "What it <saw>.", "run_*": "Where it drove."}
    headline = ("collisions", "clearance_min_m", "share")
    one = replace(
        gather(coins), study="encounter", summary=rows, captions=captions, headline=headline
    )
    text = report_page([one])
    found = Page(text)
    places = [
        text.index(words)
        for words in ("A coin falls", 'class="headline"', "What it &lt;saw&gt;.", 'class="player"',
                      "<h3>Summary</h3>", "Where it drove.", "<h3>Where it comes from</h3>")
    ]  # fmt: skip
    assert places == sorted(places)
    assert found.values("img", "alt")[0] == "Figure “views a” of coins: What it <saw>."
    assert "0 to 2<small>least: a and 1 more; most: b; contact</small>" in text
    assert "\u22120.25 to 0.5<small>least: b; most: a and 1 more</small>" in text
    assert "1<small>a, b, c</small>" in text
    # What a column means is that of docs/results.md.
    (said,) = {one for one in found.values("button", "title") if one.startswith("clearance")}
    assert (
        said
        == "clearance_min_m: "
        + column_descriptions("encounter", ["clearance_min_m"])["clearance_min_m"].text
    )
    assert "episode" in said and "2contact" in found.cells


def test_many_quantities_of_few_lines_stand_on_their_side() -> None:
    row = {"planner": "a_b", "episodes": 2, "clearance_min_m": 0.5, "time_ratio": np.nan,
           "fallback_plans": 0.25, "deadlocks": 0, "length_ratio": 12345.6, "mine": 1.0,
           "errors": "", "coverage": 1.0}  # fmt: skip
    known = column_descriptions("encounter", list(row))
    text = html_table([row, {**row, "fallback_plans": 0.0}], "caption", known)
    found = Page(text)
    assert [one["scope"] for tag, one in found.tags if tag == "th"][:3] == ["row", "col", "col"]
    heads = [cell for cell in found.cells if cell.startswith(("Outcome", "clearance", "Other"))]
    assert heads[:2] == ["Outcome", f"clearance min (m){known['clearance_min_m'].text}"]
    assert found.cells.index("deadlocks" + known["deadlocks"].text) < found.cells.index(heads[1])
    assert heads[-1] == "Other"  # of those that no page defines
    assert "25not optimal" in found.cells and "12346" in found.cells
    assert "The same in every line: errors none." in text
    # Of many lines the columns have groups, and those that never differ are one sentence.
    rows = [
        {**row, "planner": name, "mine": i, "deadlocks": i, "coverage": float(i)}
        for i, name in enumerate("abcdefg")
    ]
    text = html_table(rows, "caption", known)
    found = Page(text)
    assert found.cells[:8] == [
        "", "Outcome", "Forecasts", "Other", "planner", "deadlocks", "coverage (%)", "mine",
    ]  # fmt: skip
    assert "What the columns mean" in text and "fallback plans (%) 25 (not optimal)" in text


YIELDED = re.compile(r'yield \(?\s*f?"([\w{}.]+)"')
"""Name of a picture that a generator yields."""


def shared(pictures: Callable[..., object], study: type) -> set[str]:
    """Return the names of the pictures that a study has from generators that it shares."""
    found: set[str] = set()
    for inner in re.findall(r"yield from ([\w.]+)\(", inspect.getsource(pictures)):
        home, name = sys.modules[pictures.__module__], inner.removeprefix("self.")
        function = getattr(home if name == inner else study, name)
        found |= {*YIELDED.findall(inspect.getsource(function)), *shared(function, study)}
    return found


@pytest.mark.parametrize("name", names("experiments"))
def test_every_study_says_what_its_figures_show(name: str) -> None:
    study = load("experiments", name)
    for words in study.captions.values():
        assert words[0].isupper() and words.endswith(".") and len(words) < 200
    own = set(YIELDED.findall(inspect.getsource(sys.modules[study.__module__])))
    others = shared(study.pictures, study) - own  # some of them are drawn for some studies alone
    every = [
        pattern for one in names("experiments") for pattern in load("experiments", one).captions
    ]
    for figures, captions in ((own, study.captions), (others, every)):
        for figure in figures:
            stem = re.sub(r"\{\w+\}", "x", figure).removesuffix(".gif")
            known = figure.endswith(".csv") or any(fnmatch(stem, one) for one in captions)
            assert known, figure
    assert own | others and study.headline


def test_pages_define_columns_by_study() -> None:
    columns = ["area_ratio", "clearance_min_m", "success", "unheard_of"]
    found = {one: column_descriptions(one, columns) for one in ("planner_parts", "comparison")}
    assert all("unheard_of" not in one for one in found.values())
    assert "area_ratio" not in found["comparison"]
    assert "divided by that of the exact sum" in found["planner_parts"]["area_ratio"].text
    assert "surfaces" in found["comparison"]["clearance_min_m"].text
    assert "`" not in found["comparison"]["success"].text
    assert found["comparison"]["success"].text.startswith("share of episodes")
    rows = [dict.fromkeys(columns_of_an_episode(), 1.0)]
    condensed = condense(rows)
    assert set(condensed) == set(column_descriptions("encounter", list(condensed)))


def columns_of_an_episode() -> list[str]:
    return [
        "time_ratio_worst", "clearance", "plans", "collision", "deadlock", "extra_time_worst",
        "length_ratio_worst", "below_reference", "least_content", "gave_way", "fallbacks",
        "deadline_misses", "errors", "named_forecasts", "coverage",
    ]  # fmt: skip


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
    monkeypatch.setattr("wideberth.experiments.report.document.ROOM", 10)
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


def test_the_summary_shows_what_answers_and_folds_the_rest(coins: Path) -> None:
    names = [f"share_{i}" for i in range(5)]
    rows = [
        {"planner": name, "success": success, "collision": 0.0, **dict.fromkeys(names, 1.0)}
        for name, success in (("a", 0.97), ("b", 0.5))
    ]
    text = report_page([replace(gather(coins), study="comparison", summary=rows)])
    before, after = text.split("<details><summary>All columns, 5 more</summary>")
    before = before.partition("<h3>Summary</h3>")[2]
    assert "success (%)" in before and "share_0" not in before and "share 0" not in before
    assert "share 0" in after and 'data-value="0.97">97<' in before
    tables = markdown([replace(gather(coins), study="comparison", summary=rows)])
    assert "| success (%) |" in tables and "| a | 97 | 0 |" in tables
