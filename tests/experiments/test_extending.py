"""More seeds: what is measured is taken over, and the result is that of a fresh run."""

import os
import shutil
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from wideberth.experiments.engine.base import Experiment, Task, TaskOutcome
from wideberth.experiments.engine.result_folder import own_files
from wideberth.experiments.engine.runner import draw, run
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.helpers.sweeps import coins, contents

pytestmark = pytest.mark.usefixtures("helpers_on_path")


def uneven(measure: Callable[..., TaskOutcome]) -> Callable[..., TaskOutcome]:
    """Return a `measure` whose tasks differ in lines and columns, with awkward text."""

    def changed(self: Experiment, task: Task) -> TaskOutcome:
        made = measure(self, task)
        first = {**made.rows[0], f"only {task.seed % 2}": "0012"}
        rows = [first, {"seed": task.seed, "share": 0.5, "words": 'a "b",\nc', "whole": 1e22}]
        return TaskOutcome(rows[: 1 + task.seed % 2], made.times * (task.seed % 2), made.files)

    return changed


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the names of the tasks that are measured from now on."""
    seen: list[str] = []
    kind = type(coins())
    measure = uneven(kind.measure)

    def notes(self: Experiment, task: Task) -> TaskOutcome:
        seen.append(task.name)
        return measure(self, task)

    monkeypatch.setattr(kind, "measure", notes)
    return seen


def test_more_seeds_give_the_bytes_of_a_fresh_run(
    tmp_path: Path, measured: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    whole = contents(run(coins(seeds=5), tmp_path / "whole").folder)
    out = tmp_path / "grown"
    run(coins(seeds=2), out)
    draw(out)  # of two seeds: it must not stay
    times = (out / "times.csv").read_text()
    (out / "notes.txt").write_text("mine")
    measured.clear()
    run(coins(seeds=5), out)
    assert measured == ["seed 2", "seed 3", "seed 4"]
    assert "extended: 2 of 5 tasks are done" in capsys.readouterr().err
    assert contents(out) == {**whole, "notes.txt": b"mine"}
    assert (out / "times.csv").read_text().startswith(times)
    assert out / "files" / "seed" / "4.bin" in own_files(out)


def test_an_unfinished_run_is_extended_too(
    tmp_path: Path, measured: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = contents(run(coins(seeds=4), tmp_path / "whole").folder)
    kind = type(coins())
    measure = kind.measure

    def stops(self: Experiment, task: Task) -> TaskOutcome:
        if task.seed == 2:
            raise KeyboardInterrupt
        return measure(self, task)

    with monkeypatch.context() as patch:
        patch.setattr(kind, "measure", stops)
        with pytest.raises(KeyboardInterrupt):
            run(coins(seeds=3), tmp_path / "cut")
    measured.clear()
    assert contents(run(coins(seeds=4), tmp_path / "cut").folder) == whole
    assert measured == ["seed 2", "seed 3"]


def test_killed_at_any_moment_it_is_the_old_result_or_the_new_one(
    tmp_path: Path, measured: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    small = contents(run(coins(seeds=2), tmp_path / "small").folder)
    large = contents(run(coins(seeds=3), tmp_path / "large").folder)
    begun = tmp_path / "begun"
    for last in count():
        shutil.copytree(tmp_path / "small", begun)
        with monkeypatch.context() as patch:
            killed = _killed_after(patch, last)
            try:
                run(coins(seeds=3), begun)
            except KeyboardInterrupt:
                pass
        assert killed() or contents(begun) == large
        if not killed():
            assert last > 20, last
            return
        again = shutil.copytree(begun, tmp_path / "again")
        try:  # the old command, unless the folder is the new result's by now
            assert contents(run(coins(seeds=2), again).folder).items() >= small.items()
        except WideberthError as error:
            assert "differs in seeds" in str(error)
        assert contents(run(coins(seeds=3), begun).folder) == large
        shutil.rmtree(begun)
        shutil.rmtree(again)


def _killed_after(patch: pytest.MonkeyPatch, changes: int) -> Callable[[], bool]:
    """Stop the process before any further change of the disk."""
    left = [changes]

    def limited(change: Callable[..., Any]) -> Callable[..., Any]:
        def attempt(*given: Any, **named: Any) -> Any:
            left[0] -= 1
            if left[0] < 0:
                raise KeyboardInterrupt
            return change(*given, **named)

        return attempt

    for owner, name in (
        (os, "replace"), (os, "rename"), (Path, "unlink"), (Path, "rmdir"), (Path, "mkdir"),
        (Path, "rename"), (Path, "write_bytes"),
    ):  # fmt: skip
        patch.setattr(owner, name, limited(getattr(owner, name)))
    return lambda: left[0] < 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seeds": 1}, "differs in seeds"),
        ({"seeds": 4, "bias": 0.25}, "differs in bias, seeds"),
    ],
)
def test_nothing_else_is_taken_over(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    before = contents(run(coins(seeds=2), tmp_path / "a").folder)
    with pytest.raises(WideberthError, match=message):
        run(coins(**change), tmp_path / "a")
    assert contents(tmp_path / "a") == before


def test_a_result_of_other_source_is_not_extended(tmp_path: Path) -> None:
    out = run(coins(seeds=2), tmp_path / "a").folder
    (out / "provenance.json").write_text('{"format": "wideberth/provenance", "version": 1}')
    before = contents(out)
    with pytest.raises(WideberthError, match="other source"):
        run(coins(seeds=3), out)
    assert contents(out) == before


@pytest.mark.parametrize("lost", ["files/seed/1.bin", "tasks/*/rows.json"])
def test_what_is_lost_of_a_result_is_measured_again(
    tmp_path: Path, measured: list[str], lost: str
) -> None:
    whole = contents(run(coins(seeds=3), tmp_path / "whole").folder)
    out = run(coins(seeds=2), tmp_path / "a").folder
    (seed,) = [1] if "1.bin" in lost else [0]
    keys = sorted(path.parent for path in out.glob("tasks/*/rows.json"))
    path = next(key for key in keys if f'"seed {seed}"' in (key / "rows.json").read_text())
    if "1.bin" in lost:
        (out / lost).unlink()
    else:
        (path / "rows.json").unlink()
        (out / "files" / "seed" / "0.bin").unlink()  # it is not known whose it was
    measured.clear()
    assert contents(run(coins(seeds=3), out).folder) == whole
    assert measured == [f"seed {seed}", "seed 2"]


def test_the_last_block_that_was_not_full_is_another_task(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its file has the name of that of the full block."""

    def blocks(self: Any) -> list[Task]:
        return [
            Task(f"block {k}", k, {"bias": 0.5, "last": min(k + 2, self.seeds)})
            for k in range(0, self.seeds, 2)
        ]

    monkeypatch.setattr(type(coins()), "tasks", blocks)
    whole = contents(run(coins(seeds=4), tmp_path / "whole").folder)
    out = run(coins(seeds=3), tmp_path / "a").folder
    assert contents(run(coins(seeds=4), out).folder) == whole
    assert len(list((out / "tasks").glob("*/rows.json"))) == 2
