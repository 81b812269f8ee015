"""Nothing in a result's folder is removed or overwritten but files that a run wrote there."""

import contextlib
import errno
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import filelock
import pytest

from wideberth.experiments.engine import result_folder, runner
from wideberth.experiments.engine.base import Experiment
from wideberth.experiments.engine.result_folder import own_files
from wideberth.experiments.engine.runner import draw, run
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.helpers.sweeps import coins

HERE = Path(__file__).parents[1] / "helpers"
pytestmark = pytest.mark.usefixtures("helpers_on_path")


def tree(folder: Path) -> dict[str, bytes | None]:
    """Every file below a folder with its content, and every folder and link."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def test_fresh_keeps_a_folder_that_is_no_result(tmp_path: Path) -> None:
    """Any Hydra project has a config.yaml; a thesis beside it was lost."""
    out = tmp_path / "project"
    (out / "tasks" / (24 * "a")).mkdir(parents=True)
    rows = f"tasks/{24 * 'a'}/rows.json"
    for name in ("config.yaml", "provenance.json", "thesis.tex", rows):
        (out / name).write_text("mine: 1\n")
    before = tree(out)
    for fresh in (True, False):
        with pytest.raises(WideberthError) as refused:
            run(coins(), out, fresh=fresh)
        assert "--fresh" not in str(refused.value) and "--out" in str(refused.value)
    assert tree(out) == before


def ours(out: Path) -> set[str]:
    return {path.relative_to(out).as_posix() for path in own_files(out) if path.is_file()}


def test_every_file_of_a_result_is_known_as_our_own(tmp_path: Path) -> None:
    out = tmp_path / "a"
    run(coins(), out)
    draw(out)
    every = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert ours(out) == every - {"tasks/.lock"}
    assert {path.relative_to(out).as_posix() for path in runner.written(out)} == {
        name for name in every if not name.startswith("tasks/")
    }
    assert "figures/share.png" in every


def test_fresh_removes_what_runs_wrote_and_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "a"
    run(coins(), out)
    draw(out)
    mine = ["thesis.tex", "files/seed/notes", "figures/mine.png", ".backup.part", "files/own/x"]
    mine += ["tasks/notes.json", f"tasks/{24 * 'g'}/rows.json"]
    for name in ("files/own", f"tasks/{24 * 'g'}"):
        (out / name).mkdir()
    for name in mine:
        (out / name).write_text("mine")
    assert len(run(coins(seeds=1), out, fresh=True).rows) == 1
    assert "kept in" in capsys.readouterr().err
    left = {name for name, data in tree(out).items() if data is not None}
    assert left == {*mine, *ours(out), "tasks/.lock"}
    assert "files/seed/2.bin" not in left and "figures/share.png" not in left
    assert all((out / name).read_text() == "mine" for name in mine)


def test_a_folder_with_nothing_else_is_as_new(tmp_path: Path) -> None:
    run(coins(), tmp_path / "a")
    draw(tmp_path / "a")
    run(coins(seeds=1), tmp_path / "a", fresh=True)
    run(coins(seeds=1), tmp_path / "b")
    for out in ("a", "b"):
        for path in (tmp_path / out).rglob("times.*"):
            path.unlink()
    assert tree(tmp_path / "a") == tree(tmp_path / "b")


def test_a_run_keeps_what_lies_among_its_tasks(tmp_path: Path) -> None:
    out = tmp_path / "a"
    with pytest.raises(WideberthError):
        run(coins(fails=True), out)
    for name in ("notes.json", ".draft.part", f"{24 * 'g'}.json"):
        (out / "tasks" / name).write_text("mine")
    (out / "tasks" / (24 * "0")).mkdir()
    (out / "tasks" / (24 * "0") / "rows.json").write_text("a task of another config")
    run(coins(seeds=1), out, fresh=True)
    names = {path.name for path in (out / "tasks").iterdir() if path.is_file()}
    assert names == {"notes.json", ".draft.part", f"{24 * 'g'}.json", ".lock"}
    assert not (out / "tasks" / (24 * "0")).exists()


def test_a_file_that_lies_in_the_place_of_one_of_a_task_stays(tmp_path: Path) -> None:
    out = tmp_path / "a"
    (out / "files" / "seed").mkdir(parents=True)
    with pytest.raises(WideberthError, match=r"holds no result"):
        run(coins(), out)
    shutil.rmtree(out)
    with pytest.raises(WideberthError, match=r"fell on its edge"):
        run(coins(fails=True), out)
    shutil.rmtree(out / "tasks")
    (out / "config.yaml").unlink()
    (out / "files" / "seed").mkdir(parents=True)
    (out / "files" / "seed" / "1.bin").write_text("mine")
    for fresh in (False, True):
        with pytest.raises(WideberthError, match=r"seed/1.bin was not written .*move it away"):
            run(coins(), out, fresh=fresh)
        assert (out / "files" / "seed" / "1.bin").read_text() == "mine"
    (out / "files" / "seed" / "1.bin").unlink()
    assert len(run(coins(), out).rows) == 3


@pytest.mark.parametrize(
    "name", ["table.csv", "files", "files/seed", "provenance.json", "tasks", "config.yaml"]
)
def test_nothing_is_removed_through_a_symbolic_link(tmp_path: Path, name: str) -> None:
    out, elsewhere = tmp_path / "a", tmp_path / "elsewhere"
    run(coins(), out)
    shutil.move(out / name, elsewhere)
    (out / name).symlink_to(elsewhere)
    before = tree(tmp_path)
    with pytest.raises(WideberthError, match=r"is a symbolic link"):
        run(coins(seeds=1), out, fresh=True)
    assert tree(tmp_path) == before


@pytest.mark.parametrize(
    "names", [["../thesis.tex"], ["/etc/passwd"], [""], [3], {"a": 1}, ["a/../../thesis.tex"]]
)
def test_a_record_that_names_other_places(tmp_path: Path, names: object) -> None:
    out = tmp_path / "a"
    run(coins(seeds=1), out)
    result_folder.note_figures(out, ["figures/share.png"])
    (tmp_path / "thesis.tex").write_text("mine")
    for record, words in (
        ("figures", r"figures.json is damaged"),
        ("rows", r"seed/0.bin was not written by this package"),  # it is not known whose it was
    ):
        (path,) = (out / "tasks").rglob(f"{record}.json")
        whole = path.read_text()
        path.write_text(json.dumps({**json.loads(whole), "files": names}))
        before = tree(tmp_path)
        with pytest.raises(WideberthError, match=words):
            run(coins(seeds=1, throws=7), out, fresh=True)
        if record == "figures":
            assert tree(tmp_path) == before
            path.write_text(whole)
    assert (tmp_path / "thesis.tex").read_text() == "mine"


def test_a_config_of_another_version_names_its_file_and_version(tmp_path: Path) -> None:
    out = tmp_path / "a"
    run(coins(), out)
    config = out / "config.yaml"
    config.write_text(config.read_text() + "former_key: 1\n")
    with pytest.raises(WideberthError, match=r"a/config.yaml: unknown key 'former_key'[^;]*$"):
        draw(out)
    provenance = json.loads((out / "provenance.json").read_text())
    provenance["versions"]["wideberth"] = "0.0.7"
    (out / "provenance.json").write_text(json.dumps(provenance))
    with pytest.raises(WideberthError, match=r"unknown key .*; version 0\.0\.7 wrote this result"):
        draw(out)
    (out / "provenance.json").unlink()
    with pytest.raises(WideberthError, match=r"unknown key [^;]*$"):
        draw(out)


def test_an_interrupted_removal_is_finished_with_fresh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "a"
    run(coins(), out)
    unlink, count = Path.unlink, 0

    def fails(path: Path, missing_ok: bool = False) -> None:
        nonlocal count
        count += 1
        if count == 3:
            raise KeyboardInterrupt
        unlink(path, missing_ok)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Path, "unlink", fails)
        run(coins(seeds=1), out, fresh=True)
    with pytest.raises(WideberthError, match=r"without its config.yaml.*--fresh"):
        run(coins(), out)
    assert len(run(coins(seeds=1), out, fresh=True).rows) == 1


def a_link(place: Path) -> Path:
    (place / "real").mkdir()
    (place / "link").symlink_to(place / "real")
    return place / "link"


def a_broken_link(place: Path) -> Path:
    (place / "link").symlink_to(place / "nowhere")
    return place / "link"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (a_link, r"is a symbolic link; give the folder"),
        (a_broken_link, r"is a symbolic link; give the folder"),
        (lambda place: place / "below" / ("x" * 300), r"cannot be written to .*--out"),
        (lambda place: place / "below" / ("x" * 240), r"at most 200 bytes.*--out"),
        (lambda place: place / "be\0low", r"none of them zero.*--out"),
        (lambda place: HERE / "sweeps.py", r"is a file .*give another folder with --out"),
        (lambda place: HERE / "sweeps.py" / "x" / "y", r"sweeps.py is no folder.*--out"),
    ],
)
def test_places_that_are_refused_before_any_work(
    make: Callable[[Path], Path], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment, out = coins(), make(tmp_path)
    monkeypatch.setattr(type(experiment), "tasks", None)
    before = tree(tmp_path)
    for fresh in (False, True):
        with pytest.raises(WideberthError, match=words):
            run(experiment, out, fresh=fresh)
    assert tree(tmp_path) == before


def test_an_empty_folder_is_used_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    inode = os.stat(".").st_ino
    assert len(run(coins(), Path()).rows) == 3
    assert os.stat(tmp_path).st_ino == inode and (tmp_path / "table.csv").is_file()


def test_a_config_that_cannot_be_opened_again_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(room: str, value: dict[str, object]) -> Experiment:
        raise WideberthError("unknown experiment 'coins'")

    measured = []
    monkeypatch.setattr(runner, "_measure", lambda *given: measured.append(given))
    for changed, words in ((refuse, "unknown experiment"), (lambda *_: coins(throws=7), "throws")):
        monkeypatch.setattr(result_folder, "build", changed)
        with pytest.raises(WideberthError, match=f"could not be opened again.*{words}"):
            run(coins(), tmp_path / "out")
        assert not measured and not tree(tmp_path)


def test_a_folder_that_another_run_begins_at_the_same_moment_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other run comes between the last look at the folder and the step that takes it."""
    out, begun = tmp_path / "out", dict[str, bytes | None]()
    original = result_folder.prepare

    def late(*given: Any) -> None:
        with monkeypatch.context() as patch:
            patch.setattr(runner, "prepare", original)
            patch.setattr(runner, "locked", lambda folder: contextlib.nullcontext())
            run(coins(throws=7), out)
        begun.update(tree(out))
        original(*given)

    monkeypatch.setattr(runner, "prepare", late)
    with pytest.raises(WideberthError, match=r"another config \(it differs in throws\)"):
        run(coins(), out)
    assert begun and tree(out) == begun


@pytest.mark.parametrize(("other", "fresh"), [({}, False), ({"throws": 7}, True)], ids=str)
def test_a_run_changes_nothing_while_another_is_at_work(
    other: dict[str, Any], fresh: bool, tmp_path: Path
) -> None:
    """Be it to resume or to begin afresh."""
    out = tmp_path / "out"
    with pytest.raises(WideberthError, match=r"fell on its edge"):
        run(coins(fails=True), out)
    before = tree(out)
    with result_folder.locked(out):
        with pytest.raises(WideberthError, match=r"another run is at work in .*--out"):
            run(coins(fails=True, **other), out, fresh=fresh)
        assert tree(out) == before


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOTSUP])
def test_a_disk_without_locks_holds_results(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(filelock.FileLock, "acquire", refuse)
    run(coins(), tmp_path / "out")
    assert (tmp_path / "out" / "table.csv").is_file()
