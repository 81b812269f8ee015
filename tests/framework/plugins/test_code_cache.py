"""The folder of compiled code: where it is, and that no other user can have written there."""

import os
from collections.abc import Callable
from pathlib import Path

import platformdirs
import pytest

from wideberth.framework.plugins.code_cache import check_private, folder


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that WIDEBERTH_CACHE names."""
    monkeypatch.setenv("WIDEBERTH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def give_away(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Let another user own a file or a folder, by what the system says of it."""
    foreign: set[int] = set()
    real = Path.stat

    def changed(path: Path, **options: bool) -> os.stat_result:
        status = real(path, **options)
        values = list(status)
        if status.st_ino in foreign:
            values[4] = 4711
        return os.stat_result(values)

    monkeypatch.setattr(Path, "stat", changed)
    return lambda path: foreign.add(real(path).st_ino)


def test_the_folder_is_among_the_users_caches(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("WIDEBERTH_CACHE", "~/own")
    assert folder("ros") == tmp_path / "own" / "ros"
    monkeypatch.delenv("WIDEBERTH_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert folder("ros") == tmp_path / "xdg" / "wideberth" / "ros"
    for none in ("", "relative/cache"):
        monkeypatch.setenv("XDG_CACHE_HOME", none)
        assert folder("ros") == tmp_path / ".cache" / "wideberth" / "ros"


def test_a_folder_that_cannot_be_created_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("WIDEBERTH_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.raises(OSError):
        folder("ros")
    monkeypatch.setenv("WIDEBERTH_CACHE", "~nosuchuser/cache")
    with pytest.raises(OSError, match="set WIDEBERTH_CACHE"):
        folder("ros")

    def homeless(*_: object) -> str:
        raise RuntimeError("could not determine the home directory")

    monkeypatch.delenv("WIDEBERTH_CACHE")
    monkeypatch.setattr(platformdirs, "user_cache_dir", homeless)
    with pytest.raises(OSError, match="set WIDEBERTH_CACHE"):
        folder("ros")


def test_the_folder_is_for_its_owner_alone(base: Path) -> None:
    before = os.umask(0)
    try:
        assert folder("ros").stat().st_mode & 0o077 == 0
    finally:
        os.umask(before)


@pytest.mark.parametrize("mode", [0o770, 0o777, 0o702, 0o1777])
def test_a_folder_that_others_may_write_is_refused(mode: int, base: Path) -> None:
    place = folder("ros")
    place.chmod(mode)
    with pytest.raises(PermissionError, match=f"chmod 700 {place}"):
        folder("ros")
    assert folder("other") == base / "other"
    place.chmod(0o700)
    assert folder("ros") == place


def test_a_folder_of_another_user_is_refused(
    base: Path, give_away: Callable[[Path], None]
) -> None:
    give_away(folder("ros"))
    with pytest.raises(PermissionError, match="another user"):
        folder("ros")


@pytest.mark.parametrize("part", [".", ".."], ids=["folder", "parent"])
def test_a_folder_that_is_a_link_is_refused(part: str, base: Path, tmp_path: Path) -> None:
    linked = Path(os.path.normpath(folder("ros") / part))
    linked.rename(tmp_path / "moved")
    linked.symlink_to(tmp_path / "moved")
    with pytest.raises(PermissionError, match="symbolic link"):
        folder("ros")
    linked.unlink()
    linked.symlink_to("nowhere")
    with pytest.raises(PermissionError, match="symbolic link"):
        folder("ros")
    assert not (tmp_path / "nowhere").exists() and not (base.parent / "nowhere").exists()


def test_code_with_a_link_or_an_open_file_is_refused(
    tmp_path: Path, give_away: Callable[[Path], None]
) -> None:
    (tmp_path / "a").touch(0o644)
    check_private(tmp_path, tmp_path / "a")
    for mode in (0o666, 0o620, 0o602):
        (tmp_path / "a").chmod(mode)
        with pytest.raises(PermissionError):
            check_private(tmp_path, tmp_path / "a")
    (tmp_path / "a").chmod(0o644)
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(PermissionError):
        check_private(tmp_path / "b")
    with pytest.raises(FileNotFoundError):
        check_private(tmp_path / "c")
    give_away(tmp_path / "a")
    with pytest.raises(PermissionError):
        check_private(tmp_path / "a")
