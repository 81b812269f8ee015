"""Nothing in a result's folder is removed or overwritten but files that a run wrote there."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from wideberth.experiments.engine import result_folder, runner
from wideberth.experiments.engine.base import Experiment
from wideberth.experiments.engine.result_folder import listed_files
from wideberth.experiments.engine.runner import draw, run
from wideberth.framework.plugins.io import read_json
from wideberth.framework.plugins.yamlfile import read_config
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
    (out / "shards").mkdir(parents=True)
    for name in ("config.yaml", "provenance.json", "thesis.tex", f"shards/{24 * 'a'}.json"):
        (out / name).write_text("mine: 1\n")
    before = tree(out)
    for fresh in (True, False):
        with pytest.raises(WideberthError) as refused:
            run(coins(), out, fresh=fresh)
        assert "--fresh" not in str(refused.value) and "--out" in str(refused.value)
    assert tree(out) == before


def test_the_manifest_names_every_file(tmp_path: Path) -> None:
    out = tmp_path / "a"
    run(coins(), out)
    draw(out)
    assert listed_files(out) == {path.relative_to(out).as_posix() for path in runner.written(out)}
    assert "figures/share.png" in (listed_files(out) or ()) and not (out / "shards").exists()


def test_fresh_removes_what_the_manifest_names_and_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "a"
    run(coins(), out)
    draw(out)
    mine = ["thesis.tex", "files/seed/notes", "figures/mine.png", ".backup.part", "files/own/x"]
    (out / "files" / "own").mkdir()
    for name in mine:
        (out / name).write_text("mine")
    assert len(run(coins(seeds=1), out, fresh=True).rows) == 1
    assert "kept in" in capsys.readouterr().err
    left = {name for name, data in tree(out).items() if data is not None}
    assert left == {*mine, *(listed_files(out) or ())}
    assert "files/seed/2.bin" not in left and "figures/share.png" not in left
    assert all((out / name).read_text() == "mine" for name in mine)


def test_a_folder_with_nothing_else_is_as_new(tmp_path: Path) -> None:
    run(coins(), tmp_path / "a")
    draw(tmp_path / "a")
    run(coins(seeds=1), tmp_path / "a", fresh=True)
    run(coins(seeds=1), tmp_path / "b")
    for out in ("a", "b"):
        (tmp_path / out / "times.csv").unlink()
    assert tree(tmp_path / "a") == tree(tmp_path / "b")


def test_a_run_keeps_what_lies_among_its_shards(tmp_path: Path) -> None:
    out = tmp_path / "a"
    with pytest.raises(WideberthError):
        run(coins(fails=True), out)
    for name in ("notes.json", ".draft.part", f"{24 * 'g'}.json"):
        (out / "shards" / name).write_text("mine")
    (out / "shards" / f"{24 * '0'}.json").write_text("a shard of another config")
    run(coins(), out, fresh=True)
    assert sorted(path.name for path in (out / "shards").iterdir()) == sorted(
        ["notes.json", ".draft.part", f"{24 * 'g'}.json"]
    )


@pytest.mark.parametrize("name", ["table.csv", "files", "files/seed", "manifest.json", "shards"])
def test_nothing_is_removed_through_a_symbolic_link(tmp_path: Path, name: str) -> None:
    out, elsewhere = tmp_path / "a", tmp_path / "elsewhere"
    run(coins(), out)
    if name == "shards":
        elsewhere.mkdir()
        (elsewhere / f"{24 * '0'}.json").write_text("mine")
    else:
        shutil.move(out / name, elsewhere)
    (out / name).symlink_to(elsewhere)
    before = tree(tmp_path)
    with pytest.raises(WideberthError, match=r"is a symbolic link"):
        run(coins(seeds=1), out, fresh=True)
    assert tree(tmp_path) == before


@pytest.mark.parametrize(
    "names", [["../thesis.tex"], ["/etc/passwd"], [""], [3], {"a": 1}, ["a/../../thesis.tex"]]
)
def test_a_manifest_that_names_other_places(tmp_path: Path, names: object) -> None:
    out = tmp_path / "a"
    run(coins(), out)
    (tmp_path / "thesis.tex").write_text("mine")
    content = {"format": "wideberth/result", "version": 1, "files": names}
    (out / "manifest.json").write_text(json.dumps(content))
    before = tree(tmp_path)
    with pytest.raises(WideberthError, match=r"manifest.json is damaged"):
        run(coins(seeds=1), out, fresh=True)
    assert tree(tmp_path) == before


def test_a_result_of_an_older_version_says_what_to_do(tmp_path: Path) -> None:
    out = tmp_path / "a"
    run(coins(), out)
    (out / "manifest.json").unlink()
    for fresh in (True, False):
        with pytest.raises(WideberthError, match=r"no manifest.json.*by hand.*--out"):
            run(coins(), out, fresh=fresh)
    assert (out / "table.csv").is_file()
    assert draw(out)  # reading it needs no manifest, and nothing is overwritten
    with pytest.raises(WideberthError, match=r"share.* was not written .*move it away"):
        draw(out)


def test_a_config_of_another_version_names_its_file_and_version(tmp_path: Path) -> None:
    out = tmp_path / "a"
    run(coins(), out)
    config = out / "config.yaml"
    config.write_text(config.read_text() + "former_key: 1\n")
    with pytest.raises(WideberthError, match=r"a/config.yaml: former_key: unknown key [^;]*$"):
        draw(out)
    provenance = json.loads((out / "provenance.json").read_text())
    provenance["versions"]["wideberth"] = "0.0.7"
    (out / "provenance.json").write_text(json.dumps(provenance))
    with pytest.raises(WideberthError, match=r"unknown key .*; version 0\.0\.7 wrote this result"):
        draw(out)
    (out / "provenance.json").unlink()
    with pytest.raises(WideberthError, match=r"unknown key [^;]*$"):
        draw(out)


def test_figures_do_not_overwrite_what_somebody_drew(tmp_path: Path) -> None:
    out = tmp_path / "a"
    run(coins(), out)
    (out / "figures").mkdir()
    (out / "figures" / "share.png").write_text("mine")
    with pytest.raises(WideberthError, match=r"share.png was not written .*move it away"):
        draw(out)
    assert (out / "figures" / "share.png").read_text() == "mine"
    assert not (out / "figures" / "share.pdf").exists()


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


def begun_run(kept: Path) -> Callable[[Path], None]:
    """Return what begins a run of another config in a folder, as another process does."""
    run(coins(throws=7), kept)
    settings = read_config(kept / "config.yaml", stored=True)
    origin = read_json(kept / "provenance.json", "provenance", 1)
    return lambda out: result_folder.prepare(out, settings, origin)


@pytest.mark.parametrize("made", ["new", "empty"])
def test_a_folder_that_another_run_begins_at_the_same_moment_is_refused(
    made: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other run comes between the last look at the folder and the step that takes it."""
    out, measured, begun = tmp_path / "out", [], dict[str, bytes | None]()
    if made == "empty":
        out.mkdir()
    steps: dict[str, tuple[Any, str, Callable[..., bool]]] = {
        "new": (os, "rename", lambda source, target: target == out),
        "empty": (Path, "mkdir", lambda folder: folder == out / "shards"),
    }
    place, name, taken = steps[made]
    original, other = getattr(place, name), begun_run(tmp_path / "kept")

    def late(*given: Any, **options: Any) -> None:
        if taken(*given) and not begun:
            begun["."] = None
            other(out)
            begun.update(tree(out))
        original(*given, **options)

    monkeypatch.setattr(runner, "_measure", lambda *given: measured.append(given))
    with monkeypatch.context() as patch:
        patch.setattr(place, name, late)
        with pytest.raises(WideberthError, match=r"begun by another run at the same moment"):
            run(coins(), out)
    assert {".": None, **tree(out)} == begun and not measured
    assert not list(tmp_path.glob(".*.part"))


@pytest.mark.parametrize(
    ("other", "fresh"), [({}, False), ({"throws": 7}, True), ({"seeds": 5}, False)], ids=str
)
def test_a_run_changes_nothing_while_another_is_at_work(
    other: dict[str, Any], fresh: bool, tmp_path: Path
) -> None:
    """Be it to resume, to begin afresh or to extend what is there."""
    out = tmp_path / "out"
    with pytest.raises(WideberthError, match=r"fell on its edge"):
        run(coins(fails=True), out)
    before = tree(out)
    with result_folder.locked(out):
        with pytest.raises(WideberthError, match=r"another run is at work in .*--out"):
            run(coins(fails=True, **other), out, fresh=fresh)
        assert tree(out) == before
