"""Whatever is killed, and however full the disk is: what was finished is kept."""

import errno
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from wideberth.experiments.engine.runner import run
from wideberth.framework.values.errors import WideberthError

HERE = Path(__file__).parents[1] / "helpers"
SEEDS, PAUSE = 80, 0.04
YAML = f"type: sample_plugin:Coins\nseeds: {SEEDS}\npause: {PAUSE}\n"


@pytest.fixture(autouse=True)
def sweeps(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(HERE)
    return import_module("sweeps")


def finished(folder: Path) -> set[str]:
    return {path.name for path in (folder / "tasks").glob(24 * "[0-9a-f]")}


def workers_of(made: "subprocess.Popen[str]") -> list[int]:
    """Return the processes of a run's workers, or skip where the system does not list them."""
    listed = Path(f"/proc/{made.pid}/task/{made.pid}/children")
    if not listed.exists():
        made.kill()
        made.communicate()
        pytest.skip("the system does not list children")
    commands = {int(pid): Path(f"/proc/{pid}/cmdline") for pid in listed.read_text().split()}
    return [pid for pid, path in commands.items() if "resource_tracker" not in path.read_text()]


@pytest.mark.parametrize("kills", [3, pytest.param(10, marks=pytest.mark.slow)])
def test_drivers_and_a_worker_killed_at_any_moment_end_with_the_same_table(
    tmp_path: Path, sweeps: ModuleType, kills: int
) -> None:
    (tmp_path / "coins.yaml").write_text(YAML)
    out = tmp_path / "r"
    seed = random.randrange(2**32)
    rng, kept = random.Random(seed), set[str]()

    def begin(workers: int) -> "subprocess.Popen[str]":
        options = ("--out", "r", "--no-figures", "--workers", str(workers))
        return sweeps.wideberth("run", "coins.yaml", *options, cwd=tmp_path)

    def begin_and_kill(kill: int, kept: set[str]) -> None:
        made = begin(1 + kill % 2)
        if kill != 3:  # that one as early as in an import
            sweeps.wait_until(lambda: finished(out) - kept or made.poll() is not None, "a task")
        time.sleep(rng.uniform(0.0, 0.15))
        made.kill()
        made.communicate()

    for kill in range(kills):
        begin_and_kill(kill, kept)
        if not (out / "table.csv").exists():
            assert kept <= finished(out), f"seed {seed}"  # what was kept before is kept now
            kept = finished(out)
    last = begin(2)
    sweeps.wait_until(lambda: finished(out) - kept, "a task")
    os.kill(workers_of(last)[0], signal.SIGKILL)
    _, error = last.communicate(timeout=60)
    assert last.returncode == 0, error
    assert "is done again: its worker was ended by SIGKILL" in error
    run(sweeps.coins(seeds=SEEDS, pause=PAUSE), tmp_path / "whole")
    assert sweeps.contents(out) == sweeps.contents(tmp_path / "whole"), f"seed {seed}"


def test_only_what_is_missing_is_done_again(tmp_path: Path, sweeps: ModuleType) -> None:
    experiment = sweeps.deadly(tmp_path, seeds=30, deadly=17, lives=99)
    code = (
        "import sweeps, sys; from pathlib import Path;"
        "from wideberth.experiments.engine.runner import run;"
        "run(sweeps.deadly(Path(sys.argv[1]), seeds=30, deadly=17, lives=99), Path(sys.argv[2]))"
    )
    command = [sys.executable, "-c", code, str(tmp_path), str(tmp_path / "r")]
    killed = subprocess.run(command, env=sweeps.ENVIRONMENT, capture_output=True)
    assert killed.returncode == -signal.SIGKILL  # one worker is the driver itself
    assert len(finished(tmp_path / "r")) == 17
    (tmp_path / "r" / ".config.yaml.abc12_de.part").write_text("half")
    half = tmp_path / "r" / "tasks" / f".{24 * '0'}.abc12_de.part"
    half.mkdir()
    (half / "rows.json").write_text("half")
    measured: list[int] = []
    original = type(experiment).measure

    def counted(self: Any, task: Any) -> Any:
        measured.append(task.seed)
        return original(self, task)

    for k in range(99):
        (tmp_path / f"death-{k}").touch()  # it has no more lives to take
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(experiment), "measure", counted)
        run(experiment, tmp_path / "r")
    assert measured == list(range(17, 30))
    assert not list((tmp_path / "r").rglob("*.part"))


def test_a_lost_worker_costs_time_only(
    tmp_path: Path, sweeps: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    result = run(sweeps.deadly(tmp_path, deadly=5, lives=2), tmp_path / "r", workers=2)
    assert [row["square"] for row in result.rows] == [seed**2 for seed in range(40)]
    assert len(list(tmp_path.glob("death-*"))) == 2
    line = "task 'seed 5' is done again: its worker was ended by SIGKILL"
    assert capsys.readouterr().err.count(line) == 2
    assert {row["threads"] for row in result.rows} == {1}


def test_a_task_that_ends_its_workers_is_named(tmp_path: Path, sweeps: ModuleType) -> None:
    experiment = sweeps.deadly(tmp_path, deadly=5, lives=99, pause=0.1)
    with pytest.raises(
        WideberthError, match=r"'seed 5' ends every worker that does it .*SIGKILL: the memory"
    ) as caught:
        run(experiment, tmp_path / "r", workers=2)
    assert len(finished(tmp_path / "r")) == 39  # the rest goes on
    assert "39 of 40 tasks are done and kept" in str(caught.value)
    assert len(list(tmp_path.glob("death-*"))) == 3


def test_workers_end_when_their_driver_is_killed(tmp_path: Path, sweeps: ModuleType) -> None:
    (tmp_path / "coins.yaml").write_text(YAML)
    made = sweeps.wideberth("run", "coins.yaml", "--out", "r", "--workers", "2", cwd=tmp_path)
    sweeps.wait_until(lambda: finished(tmp_path / "r"), "a task")
    workers = workers_of(made)
    assert len(workers) == 2
    made.kill()
    made.wait()
    kept = finished(tmp_path / "r")

    def gone(pid: int) -> bool:
        try:
            return ") Z " in Path(f"/proc/{pid}/stat").read_text()
        except OSError:
            return True

    try:
        sweeps.wait_until(lambda: all(map(gone, workers)), "the workers to end", 30.0)
    finally:
        for pid in workers:
            if not gone(pid):
                os.kill(pid, signal.SIGKILL)
        made.communicate()
    assert finished(tmp_path / "r") == kept  # they never write


@pytest.mark.parametrize(
    ("place", "owner", "name", "workers"),
    [
        ("tasks", Path, "write_bytes", 1),
        ("tasks", Path, "write_bytes", 2),
        ("files", Path, "rename", 1),  # the tables are made without workers
        (".table.csv.", tempfile, "mkstemp", 1),
    ],
)
def test_a_full_disk_is_one_message_and_nothing_done_is_lost(
    tmp_path: Path, sweeps: ModuleType, workers: int, place: str, owner: Any, name: str
) -> None:
    out = tmp_path / "r"
    places: list[Path] = []
    real = getattr(owner, name)

    def full(*given: Any, **named: Any) -> Any:
        folders = {"write_bytes": lambda path, data: path, "rename": lambda path, target: target,
                   "mkstemp": lambda suffix, prefix, dir: Path(dir, prefix)}  # fmt: skip
        path = folders[name](*given, **named)
        if str(path).startswith(str(out / place)):
            places.append(path)
            if place != "tasks" or len(places) > 13:  # three files each
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(*given, **named)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(owner, name, full)
        with pytest.raises(WideberthError, match=r"No space left on device") as caught:
            run(sweeps.coins(seeds=9), out, workers=workers)
    kept = len(finished(out))
    assert kept == (9 if place != "tasks" else 4)
    assert str(out) in str(caught.value) and not list(out.rglob("*.part"))
    assert not (out / "table.csv").exists()
    assert not kept or f"{kept} of 9 tasks are done and kept in {out}" in str(caught.value)
    run(sweeps.coins(seeds=9), out)
    run(sweeps.coins(seeds=9), tmp_path / "whole")
    assert sweeps.contents(out) == sweeps.contents(tmp_path / "whole")


def test_two_runs_do_not_share_a_folder(tmp_path: Path, sweeps: ModuleType) -> None:
    (tmp_path / "coins.yaml").write_text(YAML)
    made = sweeps.wideberth("run", "coins.yaml", "--out", "r", cwd=tmp_path)
    sweeps.wait_until(lambda: finished(tmp_path / "r"), "a task")
    for fresh in (False, True):
        with pytest.raises(WideberthError, match=r"another run is at work in .*--out"):
            run(sweeps.coins(seeds=SEEDS, pause=PAUSE), tmp_path / "r", fresh=fresh)
    made.kill()
    made.communicate()
    assert len(run(sweeps.coins(seeds=SEEDS, pause=PAUSE), tmp_path / "r").rows) == SEEDS
