"""The history of speed: its statistic against its law, its table, its command on small work."""

import os
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from math import comb, expm1, log
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from wideberth.framework.values.errors import WideberthError

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks" / "history"


@pytest.fixture
def compare(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """Stand where the scripts stand: they import each other by their plain names."""
    before = list(sys.path)
    monkeypatch.syspath_prepend(str(FOLDER))
    yield import_module("compare")
    sys.path[:] = before


def missed(pairs: int, k: int) -> float:
    """Probability that the k-th smallest and largest of some values do not bound the median."""
    return 2.0 * sum(comb(pairs, i) for i in range(k)) / 2.0**pairs


@pytest.mark.parametrize("pairs", range(1, 41))
@pytest.mark.parametrize("allowed", [0.05, 0.05 / 7])
def test_the_interval_is_the_narrowest_that_is_allowed(
    compare: ModuleType, pairs: int, allowed: float
) -> None:
    k = compare.order(pairs, allowed)
    assert missed(pairs, k) <= allowed or k == 0
    assert missed(pairs, k + 1) > allowed


def test_the_interval_holds_the_median_as_often_as_it_says(compare: ModuleType) -> None:
    """Of a skewed law, within three standard errors; the sign test knows no law."""
    rng, runs = np.random.default_rng(0), 4000
    allowed, k = 0.05, compare.order(12, 0.05)
    draws = rng.exponential(size=(runs, 12))
    outside = sum(
        not low <= log(2.0) <= high
        for _, low, high in (compare.interval(one.tolist(), allowed) for one in draws)
    )
    expected = missed(12, k)
    assert abs(outside / runs - expected) < 3.0 * (expected * (1 - expected) / runs) ** 0.5


def times(compare: ModuleType, factor: float, pairs: int = 9, noise: float = 0.02) -> Any:
    """Times of both sides: each pair has its own pace, and this one takes ``factor`` as long."""
    rng = np.random.default_rng(7)
    names = list(compare.WORK)
    pace = rng.lognormal(sigma=0.5, size=(len(names), pairs))  # other loads of the machine

    def side(of: float) -> dict[str, list[float]]:
        own = of * pace * rng.lognormal(sigma=noise, size=pace.shape)
        return dict(zip(names, own.tolist(), strict=True))

    return {"this": side(factor), "other": side(1.0)}, names


@pytest.mark.parametrize(
    ("factor", "word"),
    [(1.2, "slower"), (1 / 1.2, "faster"), (1.0, "no difference that 9 pairs can see")],
)
def test_a_fifth_is_found_and_nothing_is_not(
    compare: ModuleType, factor: float, word: str
) -> None:
    found = compare.verdicts(*times(compare, factor))
    assert {one.word for one in found} == {word} and len(found) == len(compare.WORK)
    for one in found:
        assert one.low <= one.median <= one.high
        assert expm1(one.median) == pytest.approx(factor - 1.0, abs=0.05)


def test_what_is_sure_but_small_is_no_difference(compare: ModuleType) -> None:
    found = compare.verdicts(*times(compare, 1.01, noise=0.001))
    assert all(one.low > 0.0 for one in found)
    assert {one.word for one in found} == {"no difference that 9 pairs can see"}


def test_too_few_pairs_are_refused_before_any_work(
    compare: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compare, "measured", lambda *given: pytest.fail("worked"))
    assert compare.main(["HEAD", "--pairs", "8"]) == 2
    assert "8 pairs bound no median" in capsys.readouterr().err
    assert compare.order(compare.FEWEST, compare.FALSE_ALARM / len(compare.WORK)) == 1
    assert compare.order(compare.FEWEST - 1, compare.FALSE_ALARM / len(compare.WORK)) == 0


def test_a_commit_that_is_none_is_refused(
    compare: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert compare.main(["no-such-commit"]) == 2
    assert "compare: git worktree: " in capsys.readouterr().err


def test_rows_are_recorded_and_replaced(
    compare: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compare, "TABLE", tmp_path / "releases.csv")
    monkeypatch.setattr(compare, "git", lambda *words: words[0])
    every = {name: [2.0] * 9 for name in (*compare.WORK, *compare.REFERENCES)} | {
        "unit": [4.0] * 9
    }
    compare.record([compare.row("0.1.0", "a", {**every, "fatrop": []}, 1.0)])
    compare.record([compare.row("1.0.0", "b", every, 1.0)])
    compare.record([compare.row("0.1.0", "a", {**every, "risk": [8.0] * 9}, 1.0)])
    first, second = compare.read_rows()
    assert (first["release"], second["release"]) == ("1.0.0", "0.1.0")
    assert first["decision"] == first["decision_low"] == first["decision_high"] == "0.5"
    assert (second["risk"], second["fatrop"], first["ipopt"]) == ("2", "1", "1")


def test_the_shipped_table_has_a_row_for_each_release(compare: ModuleType) -> None:
    rows = compare.read_rows()
    head = ["release", "commit", "date", "machine", "pairs"]
    bounds = [f"{name}{end}" for name in compare.RATIOS for end in ("", "_low", "_high")]
    assert rows and list(rows[0]) == head + bounds
    assert len({row["release"] for row in rows}) == len(rows)
    for row in rows:
        for name in compare.RATIOS:
            if row[name]:
                low, middle, high = (float(row[f"{name}{end}"]) for end in ("_low", "", "_high"))
                assert 0.0 < low <= middle <= high, (row["release"], name)


@pytest.mark.parametrize("count", [1, 2, 30])
def test_the_picture_of_one_row_and_of_many(
    compare: ModuleType, count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = import_module("picture")
    (row,) = compare.read_rows()[-1:]
    rows = [{**row, "release": f"1.{k}.0"} for k in range(count)]
    rows[0] = {**rows[0], "fatrop": ""}  # that release could not do it
    monkeypatch.setattr(picture, "read_rows", lambda: rows)
    picture.main(tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 10_000


def test_the_work_is_done_and_what_cannot_be_done_has_a_reason() -> None:
    """A process answers one line for each; it needs nothing but a checkout."""
    root = FOLDER.parents[1]
    link = root / ".editable"
    done = subprocess.run(
        [sys.executable, str(FOLDER / "work.py"), str(link / "wideberth")],
        input="unit\nfilter\nnothing\nrisk\n",
        env={**os.environ, "PYTHONPATH": str(link)},
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    unit, own, none, risk = done.stdout.splitlines()
    assert none == "\"KeyError: 'nothing'\""
    assert all(0.0 < float(one) < 60.0 for one in (unit, own, risk)), done.stderr


def test_another_checkout_than_the_one_asked_for_is_refused(tmp_path: Path) -> None:
    """An editable installation comes before PYTHONPATH, and would be measured in its place."""
    other = tmp_path / "wideberth"
    other.mkdir()
    (other / "__init__.py").write_text('"""Another one."""\n')
    link = FOLDER.parents[1] / ".editable"
    for path, error in ((tmp_path, ""), (link, "this measures")):
        done = subprocess.run(
            [sys.executable, str(FOLDER / "work.py"), str(other)],
            input="nothing\n", env={**os.environ, "PYTHONPATH": str(path)},
            capture_output=True, text=True, timeout=300,
        )  # fmt: skip
        assert (error in done.stderr) if error else done.stdout.startswith('"KeyError')


def test_equal_checkouts_are_compared_and_the_worktree_is_gone(
    compare: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The whole command on its smallest work; it may find what it does: no time is asserted."""
    try:
        before = compare.git("worktree", "list")
    except (WideberthError, OSError):
        pytest.skip("no git checkout")
    monkeypatch.setattr(compare, "FALSE_ALARM", 0.5)  # so that two pairs say something
    monkeypatch.setattr(compare, "LONG", 0.0)
    assert compare.main(["HEAD", "--pairs", "2", "--only", "filter"]) in (0, 1)
    out = capsys.readouterr().out
    assert out.startswith("this checkout over HEAD, processor time, 2 pairs:\nfilter ")
    assert compare.git("worktree", "list") == before
