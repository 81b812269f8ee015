"""A plug-in that changes the working folder changes it for no other part of a run."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from wideberth.experiments.cli.app import main
from wideberth.experiments.engine.from_python import open_result
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.report.document import report
from wideberth.tests.helpers.sweeps import coins, contents

pytestmark = pytest.mark.usefixtures("helpers_on_path")


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder beside the working folder, which is empty."""
    (tmp_path / "here").mkdir()
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "elsewhere"


@pytest.mark.parametrize("method", ["tasks", "inputs", "check", "measure", "summary", "figures"])
def test_a_study_that_changes_the_working_folder(
    elsewhere: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    from sample_plugin import Coins

    original: Callable[..., Any] = getattr(Coins, method)

    def wandering(self: object, *given: object) -> object:
        os.chdir(elsewhere)
        return original(self, *given)

    run(coins(), "whole")
    draw(Path("whole"))
    with monkeypatch.context() as patch:
        patch.setattr(Coins, method, wandering)
        run(coins(), "a")
        draw(Path("a"))
        report([Path("a"), Path("a")], Path("report.md"))
    assert Path.cwd() == elsewhere.parent / "here" and not list(elsewhere.iterdir())
    assert contents(Path("a")) == contents(Path("whole"))
    assert len(open_result("a").rows) == 3 and Path("report.md").is_file()


def test_each_task_finds_the_same_working_folder(
    elsewhere: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or else a task that reads a relative path fails after one that went away."""
    from sample_plugin import Coins

    original, places = Coins.measure, list[Path]()

    def wandering(self: Coins, task: Any) -> Any:
        places.append(Path.cwd())
        os.chdir(elsewhere)
        return original(self, task)

    monkeypatch.setattr(Coins, "measure", wandering)
    run(coins(), "a")
    assert places == 3 * [elsewhere.parent / "here"]


def test_a_module_that_changes_it_when_it_is_imported(
    elsewhere: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "wandering.py").write_text(
        f"import os\nfrom sample_plugin import Coins\nos.chdir({str(elsewhere)!r})\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    Path("coins.yaml").write_text("type: wandering:Coins\nplugins: [wandering]\n")
    for command in (
        ["run", "coins.yaml", "--out", "a"],
        ["figures", "a"],
        ["report", "a", "--out", "report.md"],
    ):
        with pytest.raises(SystemExit) as left:
            main(command)
        assert not left.value.code
    assert not list(elsewhere.iterdir())
    assert Path("a", "figures", "share.png").is_file() and Path("report.md").is_file()
