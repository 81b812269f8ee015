"""Compiled code is loaded from where no other user could have put them, and nowhere else."""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from wideberth.framework.jit import folder

DOUBLE = """define double @double(double %x) {
  %y = fadd double %x, %x
  ret double %y
}
"""


Again = Callable[[str], list[str]]
pytestmark = pytest.mark.usefixtures("place")


def entry(place: Path) -> Path:
    (found,) = (path for path in place.iterdir() if not path.name.startswith("."))
    return found


@pytest.fixture
def stranger(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Let another user own a file or folder: the paths named, by what the system says of them."""
    chosen: set[Path] = set()

    def of_another(found: os.stat_result) -> os.stat_result:
        values = list(found)
        values[4] = 4711
        return os.stat_result(values)

    real_lstat, real_stat = Path.lstat, Path.stat

    def lstat(path: Path) -> os.stat_result:
        found = real_lstat(path)
        return of_another(found) if path in chosen else found

    def plain(path: Path, *, follow_symlinks: bool = True) -> os.stat_result:
        found = real_stat(path, follow_symlinks=follow_symlinks)
        return of_another(found) if path in chosen else found

    monkeypatch.setattr(Path, "lstat", lstat)
    monkeypatch.setattr(Path, "stat", plain)
    return chosen.add


def test_everything_is_for_its_owner_alone(again: Again, place: Path, tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        again(DOUBLE)
    finally:
        os.umask(before)
    made = [place.parent, place, *place.rglob("*")]
    assert len(made) >= 5
    assert all(path.stat().st_mode & 0o077 == 0 for path in made)
    assert again(DOUBLE) == []


def test_a_folder_of_another_user_is_not_used(
    again: Again, place: Path, stranger: Callable[[Path], None]
) -> None:
    again(DOUBLE)
    (code,) = entry(place).rglob("*.o")
    before = code.stat().st_mtime_ns
    stranger(place)
    (line,) = again(DOUBLE)
    assert "this run only" in line and "another user" in line
    assert code.stat().st_mtime_ns == before


@pytest.mark.parametrize("suffix", ["", ".o", ".json"])
def test_what_another_user_put_there_is_compiled_again(
    suffix: str, again: Again, place: Path, stranger: Callable[[Path], None]
) -> None:
    again(DOUBLE)
    found = entry(place)
    stranger(next(found.rglob(f"*{suffix}")) if suffix else found)
    (line,) = again(DOUBLE)
    assert "not yours alone" in line


@pytest.mark.parametrize("mode", [0o770, 0o777, 0o702, 0o1777])
def test_a_folder_that_others_may_write_is_not_used(mode: int, again: Again, place: Path) -> None:
    again(DOUBLE)
    place.chmod(mode)
    (line,) = again(DOUBLE)
    assert "this run only" in line and f"chmod 700 {place}" in line
    place.chmod(0o700)
    assert again(DOUBLE) == []


@pytest.mark.parametrize("suffix", [".o", ".json"])
def test_a_file_that_others_may_write_is_made_again(
    suffix: str, again: Again, place: Path
) -> None:
    again(DOUBLE)
    path = next(entry(place).rglob(f"*{suffix}"))
    path.chmod(path.stat().st_mode | 0o020)
    assert len(again(DOUBLE)) == 1 and again(DOUBLE) == []


def test_a_folder_above_that_everybody_may_write(again: Again, place: Path) -> None:
    again(DOUBLE)
    place.parent.chmod(0o777)
    (line,) = again(DOUBLE)
    assert "this run only" in line and "everybody may write" in line
    place.parent.chmod(0o1777)  # as /tmp: nobody can rename what others own there
    assert again(DOUBLE) == []


def test_links(
    again: Again,
    place: Path,
    tmp_path: Path,
    stranger: Callable[[Path], None],
) -> None:
    again(DOUBLE)
    (code,) = entry(place).rglob("*.o")
    code.rename(tmp_path / "code")
    code.symlink_to(tmp_path / "code")
    assert len(again(DOUBLE)) == 1 and again(DOUBLE) == []
    assert (tmp_path / "code").is_file()
    place.rename(tmp_path / "elsewhere")
    place.symlink_to(tmp_path / "elsewhere")
    assert again(DOUBLE) == []  # a link of this user's own
    stranger(place)
    (line,) = again(DOUBLE)
    assert "symbolic link that another user made" in line


@pytest.mark.parametrize("text", ["[" * 100_000, "[[1]]", "[]", "1" * 5001, '"' + "x" * 10**6])
def test_a_seal_that_is_none(text: str, again: Again, place: Path) -> None:
    again(DOUBLE)
    (entry(place) / "seal.json").write_text(text)
    assert len(again(DOUBLE)) == 1 and again(DOUBLE) == []


def test_a_seal_that_is_a_pipe(again: Again, place: Path) -> None:
    again(DOUBLE)
    (entry(place) / "seal.json").unlink()
    os.mkfifo(entry(place) / "seal.json")
    assert len(again(DOUBLE)) == 1 and again(DOUBLE) == []


def test_no_place(again: Again, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WIDEBERTH_CACHE", "~nosuchuser/cache")
    (line,) = again(DOUBLE)
    assert "this run only" in line and "set WIDEBERTH_CACHE" in line

    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("WIDEBERTH_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    (line,) = again(DOUBLE)
    assert "this run only" in line


def test_a_file_in_the_place_of_a_module(again: Again, place: Path) -> None:
    again(DOUBLE)
    module = entry(place)
    for path in sorted(module.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
    module.rmdir()
    module.symlink_to("nowhere")
    assert len(again(DOUBLE)) == 1 and again(DOUBLE) == []


def test_other_folders_are_not_pruned(again: Again, place: Path) -> None:
    again(DOUBLE)
    mine = place / "mine"
    mine.mkdir()
    (mine / "seal.json").write_text(json.dumps({"a": "b"}))
    folder.prune(place, keep=entry_of_module(place), budget=0)
    assert mine.is_dir()


def entry_of_module(place: Path) -> Path:
    return next(path for path in place.iterdir() if path.name.startswith("wideberth_"))


def test_place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("WIDEBERTH_CACHE")
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert folder.home() == tmp_path / "wideberth" / "jit"
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    assert folder.home() == Path.home() / ".cache" / "wideberth" / "jit"
    monkeypatch.setattr(sys, "platform", "darwin")
    assert folder.home() == Path.home() / "Library" / "Caches" / "wideberth" / "jit"
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    assert folder.home() == tmp_path / "wideberth" / "jit"
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative/cache")
    assert folder.home() == Path.home() / ".cache" / "wideberth" / "jit"
