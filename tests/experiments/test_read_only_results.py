"""A finished result that nobody may write any more is reported, played and shown."""

import errno
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from wideberth.experiments.cli import app
from wideberth.experiments.engine.from_python import open_result
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.report.document import report
from wideberth.experiments.report.player import play
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.experiments.test_result_folder import tree
from wideberth.tests.helpers.saved import SAVED
from wideberth.tests.helpers.sweeps import coins

pytestmark = pytest.mark.usefixtures("helpers_on_path")

_CHANGES = {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.chmod", "os.truncate"}
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT
_sealed: list[Path] = []


def _refuse(event: str, arguments: tuple[Any, ...]) -> None:
    """Fail as a file system does that is mounted read-only; it binds root as well."""
    if not _sealed or not arguments or not isinstance(arguments[0], str | os.PathLike):
        return
    changes = event in _CHANGES or (event == "open" and arguments[2] & _WRITES)
    if changes and any(is_below(arguments[0], folder) for folder in _sealed):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(arguments[0]))


sys.addaudithook(_refuse)


def is_below(path: Any, folder: Path) -> bool:
    return Path(os.path.abspath(path)).is_relative_to(folder)


@pytest.fixture
def seal(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], dict[str, bytes | None]]:
    """Return what makes a result read-only, and returns its files."""
    allowed = os.access

    def access(path: Any, mode: int, **more: Any) -> bool:
        writes = mode & os.W_OK and any(is_below(path, folder) for folder in _sealed)
        return not writes and allowed(path, mode, **more)

    def sealed(result: Path) -> dict[str, bytes | None]:
        monkeypatch.setattr(os, "access", access)
        monkeypatch.setattr(sys.modules[__name__], "_sealed", [result])
        return tree(result)

    return sealed


Seal = Callable[[Path], dict[str, bytes | None]]


def test_the_seal_holds(tmp_path: Path, seal: Seal) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "b").write_text("")
    seal(tmp_path / "a")
    for change in (
        lambda: (tmp_path / "a" / "c").write_text(""),
        lambda: (tmp_path / "a" / "c").mkdir(),
        lambda: (tmp_path / "a" / "b").unlink(),
    ):
        with pytest.raises(OSError, match=r"Read-only file system"):
            change()
    assert (tmp_path / "a" / "b").read_text() == ""


@pytest.mark.parametrize("drawn", [False, True])
def test_a_read_only_result_is_reported(tmp_path: Path, seal: Seal, drawn: bool) -> None:
    """Without the figures that there is no place for in the result."""
    result = tmp_path / "coins"
    run(coins(), result)
    if drawn:
        draw(result)
    before = seal(result)
    text = report([result], tmp_path / "report.md").read_text()
    assert tree(result) == before
    assert ("(coins/figures/share.png)" in text) == drawn


def test_a_read_only_result_is_played_shown_and_read(tmp_path: Path, seal: Seal) -> None:
    shutil.copytree(SAVED / "result", result := tmp_path / "result")
    before = seal(result)
    play(result, tmp_path / "play.html")
    app._show(result)
    assert len(open_result(result).rows) and open_result(result).episodes
    assert tree(result) == before
    assert (tmp_path / "play.html").is_file()


@pytest.mark.parametrize(
    ("name", "write"),
    [("page.html", play), ("page.md", lambda result, out: report([result], out))],
)
def test_a_place_that_may_not_be_written_is_refused_before_any_work(
    tmp_path: Path, seal: Seal, name: str, write: Callable[[Path, Path], object]
) -> None:
    shutil.copytree(SAVED / "result", result := tmp_path / "result")
    before = seal(result)
    with pytest.raises(WideberthError, match=r"its folder is read-only; .*--out"):
        write(result, result / name)
    assert tree(result) == before


def test_figures_that_cannot_be_kept_end_in_one_message(tmp_path: Path, seal: Seal) -> None:
    run(coins(), result := tmp_path / "coins")
    before = seal(result)
    with pytest.raises(WideberthError, match=r"coins is complete, its figures cannot be drawn"):
        draw(result)
    assert tree(result) == before
