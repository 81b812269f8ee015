"""Compiled code is loaded from where no other user could have put it, and nowhere else."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import platformdirs
import pytest

from wideberth.framework.jit import cache
from wideberth.framework.jit.cached_njit import cached_njit

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


def test_place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("WIDEBERTH_CACHE", "~/own")
    assert cache.folder() == tmp_path / "own" / "jit"
    monkeypatch.delenv("WIDEBERTH_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache.folder() == tmp_path / "xdg" / "wideberth" / "jit"
    for none in ("", "relative/cache"):
        monkeypatch.setenv("XDG_CACHE_HOME", none)
        assert cache.folder() == tmp_path / ".cache" / "wideberth" / "jit"


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


def test_each_folder_of_the_cache_is_checked(place: Path) -> None:
    ros = cache.folder("ros")
    ros.chmod(0o777)
    with pytest.raises(PermissionError, match="chmod 700"):
        cache.folder("ros")
    assert cache.folder() == place


def test_folders_of_code_with_a_link_or_an_open_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a").touch(0o644)
    cache.check_private(tmp_path, tmp_path / "a")
    (tmp_path / "a").chmod(0o666)
    (tmp_path / "b").symlink_to("a")
    for wrong in ("a", "b"):
        with pytest.raises(PermissionError):
            cache.check_private(tmp_path, tmp_path / wrong)
    with pytest.raises(FileNotFoundError):
        cache.check_private(tmp_path / "c")


def twice(x: float) -> float:
    return 2.0 * x


def numba_place(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str | None:
    from numba.core import config

    monkeypatch.setattr(config, "CACHE_DIR", str(folder))
    found: str | None = cached_njit([twice])[0].stats.cache_path
    return found


def test_numba_does_not_unpickle_what_others_may_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "numba"
    folder.mkdir(0o700)
    used = numba_place(folder, monkeypatch)
    assert used is not None and Path(used).parent == folder
    file = Path(used) / "x.nbi"
    file.touch(0o600)
    assert numba_place(folder, monkeypatch) == used
    for path, mode in ((folder, 0o777), (Path(used), 0o777), (file, 0o666)):
        before = path.stat().st_mode
        path.chmod(mode)
        assert numba_place(folder, monkeypatch) is None
        path.chmod(before)
    assert numba_place(folder, monkeypatch) == used


def test_numba_takes_no_cache_from_a_file_of_the_working_folder(tmp_path: Path) -> None:
    (tmp_path / ".numba_config.yaml").write_text("cache_dir: evil\n")
    program = (
        "from wideberth.framework.jit.cached_njit import cached_njit\n"
        "from wideberth.framework.risk.overlap_tables import bilinear\n"
        "print(cached_njit([bilinear])[0].stats.cache_path)"
    )
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "evil" not in done.stdout and not (tmp_path / "evil").exists()
