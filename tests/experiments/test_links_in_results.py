"""Nothing below a result is read, listed, written, moved or removed through a symbolic link."""

import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from wideberth.experiments.cli import app
from wideberth.experiments.engine import runner
from wideberth.experiments.engine.extract import answers, extract
from wideberth.experiments.engine.from_python import open_result
from wideberth.experiments.engine.inside import files_inside, inside
from wideberth.experiments.engine.parquet_table import write_parquet
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.report.document import report
from wideberth.experiments.report.player import find_episodes, result_tail
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.experiments.test_result_folder import tree
from wideberth.tests.helpers.saved import SAVED
from wideberth.tests.helpers.sweeps import coins

pytestmark = pytest.mark.usefixtures("helpers_on_path", "quick_figures")

_TOUCHING = {"open", "os.listdir", "os.scandir", "os.rename", "os.remove", "os.rmdir", "os.mkdir",
             "os.chmod", "os.truncate", "shutil.rmtree"}  # fmt: skip
_watched: list[tuple[str, list[str]]] = []


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    for folder, touched in _watched if event in _TOUCHING else ():
        for part in arguments:
            if isinstance(part, str | os.PathLike):
                path = Path(part)
                itself = event in ("os.rename", "os.remove")  # not what a link leads to
                real = path.parent.resolve() / path.name if itself else path.resolve()
                touched += [f"{event} {path}"] if str(real).startswith(folder) else []


sys.addaudithook(_note)


@contextmanager
def touched_in(folder: Path) -> Iterator[list[str]]:
    """Yield what the block opens, lists, writes, moves or removes in a folder."""
    touched: list[str] = []
    _watched.append((os.path.realpath(folder), touched))
    try:
        yield touched
    finally:
        _watched.pop()


@pytest.fixture
def quick_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a study draw a figure without matplotlib."""

    def figures(self: object, result: object, folder: Path) -> list[Path]:
        (folder / "share.png").write_bytes(bytes(24))
        return [folder / "share.png"]

    from sample_plugin import Coins

    monkeypatch.setattr(Coins, "figures", figures)


def finished(out: Path) -> None:
    """Write a result with everything that there can be."""
    run(coins(seeds=1), out)
    draw(out)


def unfinished(out: Path) -> None:
    """Write a result whose tables are missing: its files are those of its tasks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "_collect", None)
        with pytest.raises(WideberthError, match=r"1 of 1 tasks are done and kept"):
            run(coins(seeds=1), out)


def resumed(out: Path) -> None:
    (out / "table.csv").unlink(missing_ok=True)
    run(coins(seeds=1), out)


def read(out: Path) -> None:
    result = open_result(out)
    for part in ("config", "tables", "figures", "episodes", "rows", "times"):
        with suppress(WideberthError):
            getattr(result, part)
    for name in (*result.names(), "seed/0.bin"):
        result.read(name)


ACTIONS: dict[str, Callable[[Path], object]] = {
    "run": lambda out: run(coins(seeds=1), out),
    "resume": resumed,
    "another config": lambda out: run(coins(throws=7), out),
    "fresh": lambda out: run(coins(seeds=1), out, fresh=True),
    "figures": draw,
    "show": lambda out: app._show(out),
    "show columns": lambda out: (extract(out), extract(out, ["seconds"]), answers(out)),
    "report": lambda out: report([out], out.parent / "report.md"),
    "parquet": write_parquet,
    "read": read,
    "play": find_episodes,
    "tail": result_tail,
}


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("make", [finished, unfinished])
def test_no_link_below_a_result_is_followed(
    tmp_path: Path, make: Callable[[Path], None], action: str
) -> None:
    """Each file and folder in turn is a link to one elsewhere, be it that of a thesis."""
    whole = tmp_path / "whole"
    make(whole)
    (whole / "tasks" / ".lock").unlink()
    names = [path.relative_to(whole) for path in sorted(whole.rglob("*"))]
    assert Path("config.yaml") in names and any("rows.json" in name.parts for name in names)
    for i, name in enumerate(names):
        out, elsewhere = tmp_path / f"{i}", tmp_path / f"elsewhere-{i}"
        shutil.copytree(whole, out)
        shutil.move(out / name, elsewhere)
        (out / name).symlink_to(elsewhere)
        before = tree(tmp_path)
        with touched_in(elsewhere) as touched, suppress(WideberthError):
            ACTIONS[action](out)
        assert not touched, name
        after = tree(tmp_path)
        assert {place: after.get(place) for place in before if place.startswith("elsewhere")} == {
            place: data for place, data in before.items() if place.startswith("elsewhere")
        }


def test_the_check_sees_what_is_done_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "link").symlink_to("elsewhere")
    with touched_in(tmp_path / "elsewhere") as touched:
        (tmp_path / "link" / "a").write_text("")
        (tmp_path / "link" / "a").rename(tmp_path / "link" / "b")
        (tmp_path / "link" / "b").unlink()
        list((tmp_path / "link").iterdir())
    assert {event.split()[0] for event in touched} >= {"open", "os.rename", "os.remove"}
    assert any(event.startswith(("os.listdir", "os.scandir")) for event in touched)


@pytest.mark.parametrize("name", ["figures", "files", "table.csv", "config.yaml", "summary.csv"])
def test_a_link_is_named_and_the_message_says_what_to_do(tmp_path: Path, name: str) -> None:
    out = tmp_path / "a"
    finished(out)
    shutil.move(out / name, tmp_path / "elsewhere")
    (out / name).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(WideberthError, match=rf"a/{name} is a symbolic link.*move the link away"):
        report([out], tmp_path / "report.md")
        resumed(out)  # a report needs no file of a task


def test_the_folder_of_a_result_may_be_a_link(tmp_path: Path) -> None:
    finished(tmp_path / "a")
    (tmp_path / "link").symlink_to("a")
    assert len(open_result(tmp_path / "link").rows) == 1
    assert report([tmp_path / "link"], tmp_path / "report.md")
    draw(tmp_path / "link")


def test_an_episode_behind_a_link_is_no_episode_of_its_result(tmp_path: Path) -> None:
    out = tmp_path / "a"
    shutil.copytree(SAVED / "result", out)
    (episode, *_) = find_episodes(out)
    assert find_episodes(episode) == [episode]
    shutil.move(out / "files", tmp_path / "elsewhere")
    (out / "files").symlink_to(tmp_path / "elsewhere")
    for path in (out, episode):
        with pytest.raises(WideberthError, match=r"files is a symbolic link"):
            find_episodes(path)


@pytest.mark.parametrize("name", ["../a", "/etc/passwd", "a/../../b", "a\0"])
def test_names_that_leave_the_folder(tmp_path: Path, name: str) -> None:
    for look in (inside, files_inside):
        with pytest.raises(WideberthError, match=r"is not the name of a file in this folder"):
            look(tmp_path, name)
