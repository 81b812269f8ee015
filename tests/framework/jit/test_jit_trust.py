"""Compiled code is loaded from where no other user could have put it, and nowhere else."""

import os
from collections.abc import Callable
from pathlib import Path

import platformdirs
import pytest

DOUBLE = """define double @double(double %x) {
  %y = fadd double %x, %x
  ret double %y
}
"""


Again = Callable[[str], list[str]]
pytestmark = pytest.mark.usefixtures("place")


def entry(place: Path) -> Path:
    (found,) = place.glob("wideberth_*")
    return found


@pytest.fixture
def stranger(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Let another user own a file or folder: the paths named, by what the system says of them."""
    chosen: set[int] = set()

    def of_another(found: os.stat_result) -> os.stat_result:
        values = list(found)
        if found.st_ino in chosen:
            values[4] = 4711
        return os.stat_result(values)

    real_stat, real_fstat = Path.stat, os.fstat
    monkeypatch.setattr(Path, "stat", lambda path, **how: of_another(real_stat(path, **how)))
    monkeypatch.setattr(os, "fstat", lambda handle: of_another(real_fstat(handle)))
    return lambda path: chosen.add(real_stat(path).st_ino)


def test_everything_is_for_its_owner_alone(again: Again, place: Path) -> None:
    before = os.umask(0)
    try:
        again(DOUBLE)
    finally:
        os.umask(before)
    made = [place, *place.rglob("*")]
    assert len(made) >= 3
    assert all(path.stat().st_mode & 0o077 == 0 for path in made)
    assert again(DOUBLE) == []


def test_a_folder_of_another_user_is_not_used(
    again: Again, place: Path, stranger: Callable[[Path], None]
) -> None:
    again(DOUBLE)
    before = entry(place).stat().st_mtime_ns
    stranger(place)
    (line,) = again(DOUBLE)
    assert "this run only" in line and "another user" in line
    assert entry(place).stat().st_mtime_ns == before


def test_what_another_user_put_there_is_compiled_again(
    again: Again, place: Path, stranger: Callable[[Path], None]
) -> None:
    again(DOUBLE)
    stranger(entry(place))
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


@pytest.mark.parametrize("mode", [0o620, 0o602])
def test_a_file_that_others_may_write_is_made_again(mode: int, again: Again, place: Path) -> None:
    again(DOUBLE)
    entry(place).chmod(mode)
    assert len(again(DOUBLE)) == 1 and again(DOUBLE) == []


def test_a_link_is_not_followed(again: Again, place: Path, tmp_path: Path) -> None:
    again(DOUBLE)
    code = entry(place)
    code.rename(tmp_path / "code")
    code.symlink_to(tmp_path / "code")
    assert len(again(DOUBLE)) == 1 and again(DOUBLE) == []
    assert (tmp_path / "code").is_file() and not code.is_symlink()
    code.unlink()
    code.symlink_to("nowhere")
    assert len(again(DOUBLE)) == 1 and again(DOUBLE) == []


def test_a_pipe_is_not_waited_for(again: Again, place: Path) -> None:
    again(DOUBLE)
    code = entry(place)
    code.unlink()
    os.mkfifo(code)
    assert len(again(DOUBLE)) == 1 and again(DOUBLE) == []


def test_a_folder_in_the_place_of_code(again: Again, place: Path) -> None:
    again(DOUBLE)
    code = entry(place)
    code.unlink()
    code.mkdir()
    first, second = again(DOUBLE)
    assert "damaged" in first and "this run only" in second


def test_no_place(again: Again, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("WIDEBERTH_CACHE", str(tmp_path / "file" / "cache"))
    (line,) = again(DOUBLE)
    assert "this run only" in line
    monkeypatch.setenv("WIDEBERTH_CACHE", "~nosuchuser/cache")
    (line,) = again(DOUBLE)
    assert "this run only" in line and "set WIDEBERTH_CACHE" in line

    def homeless(*_: object) -> str:
        raise RuntimeError("could not determine the home directory")

    monkeypatch.delenv("WIDEBERTH_CACHE")
    monkeypatch.setattr(platformdirs, "user_cache_dir", homeless)
    (line,) = again(DOUBLE)
    assert "this run only" in line and "set WIDEBERTH_CACHE" in line


@pytest.mark.parametrize("part", [".", ".."], ids=["folder", "parent"])
def test_a_folder_that_is_a_link_is_not_used(
    part: str, again: Again, place: Path, tmp_path: Path
) -> None:
    again(DOUBLE)
    linked = Path(os.path.normpath(place / part))
    linked.rename(tmp_path / "moved")
    linked.symlink_to(tmp_path / "moved")
    before = sorted((tmp_path / "moved").rglob("*"))
    (line,) = again(DOUBLE)
    assert "this run only" in line and "symbolic link" in line and "WIDEBERTH_CACHE" in line
    assert sorted((tmp_path / "moved").rglob("*")) == before
    linked.unlink()
    linked.symlink_to("nowhere")
    (line,) = again(DOUBLE)
    assert "symbolic link" in line and not (tmp_path / "nowhere").exists()
