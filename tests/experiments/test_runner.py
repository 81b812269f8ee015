"""A run gives the same bytes however it is cut up, and never leaves half a file."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from wideberth.experiments.engine.base import Experiment, Task, TaskOutcome
from wideberth.experiments.engine.csv_tables import read_table
from wideberth.experiments.engine.provenance import fingerprint
from wideberth.experiments.engine.runner import draw, left_out, reopen, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.engine.text_tables import print_table
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.plugins.io import read_json, write_json
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.helpers.sweeps import coins, contents

HERE = Path(__file__).parents[1] / "helpers"
pytestmark = pytest.mark.usefixtures("helpers_on_path")


def shell(*arguments: str, cwd: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", "from wideberth.experiments.cli.app import main; main()"]
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [*command, *arguments], cwd=cwd, text=True, env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip


def test_folder_holds_table_summary_files_and_origin(tmp_path: Path) -> None:
    result = run(coins(), tmp_path / "a")
    assert [row["seed"] for row in result.rows] == [0, 1, 2]
    assert result.rows[0]["none"] is None
    assert [row["seed"] for row in result.times] == [0, 1, 2]
    assert result.names() == ["seed/0.bin", "seed/1.bin", "seed/2.bin"]
    assert len(result.read("seed/1.bin")) == 3200
    origin = read_json(tmp_path / "a" / "provenance.json", "provenance", 1)
    assert origin["versions"]["numpy"] and origin["cpu"] and origin["source"]
    summary = read_table(tmp_path / "a" / "summary.csv")
    assert summary[0]["share"] == pytest.approx(sum(r["share"] for r in result.rows) / 3)
    assert "either side" in (tmp_path / "a" / "summary.md").read_text()
    assert not list((tmp_path / "a" / "tasks").rglob("files"))  # they were moved
    with pytest.raises(WideberthError, match=r"no file 'x'.*seed/0\.bin"):
        result.read("x")


def test_same_bytes_with_one_and_two_workers(tmp_path: Path) -> None:
    config = tmp_path / "coins.yaml"
    config.write_text("type: sample_plugin:Coins\nplugins: [sample_plugin]\n")
    made = shell("run", "coins.yaml", "--out", "2", "--workers", "2", cwd=tmp_path)
    out, error = made.communicate(timeout=120)
    assert made.returncode == 0, error
    assert "share.png" in out
    experiment, plugins = read_experiment(str(config), [])
    run(experiment, tmp_path / "1", plugins=plugins)
    draw(tmp_path / "1")
    one, two = contents(tmp_path / "1"), contents(tmp_path / "2")
    assert one == two
    assert "figures/share.pdf" in one


def test_resumes_to_the_same_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = run(coins(), tmp_path / "whole")
    kind = type(coins())
    measure = kind.measure
    seen: list[str] = []

    def stops(self: Experiment, task: Task) -> TaskOutcome:
        seen.append(task.name)
        if len(seen) == 2:
            raise KeyboardInterrupt
        return measure(self, task)

    monkeypatch.setattr(kind, "measure", stops)
    with pytest.raises(KeyboardInterrupt, match=r"1 of 3 tasks done.*goes on"):
        run(coins(), tmp_path / "cut")
    assert not list((tmp_path / "cut").rglob("*.part"))
    assert not (tmp_path / "cut" / "table.csv").exists()
    with pytest.raises(WideberthError, match=r"not finished"):
        reopen(tmp_path / "cut")
    run(coins(), tmp_path / "cut")
    assert seen == ["seed 0", "seed 1", "seed 1", "seed 2"]
    assert contents(tmp_path / "cut") == contents(whole.folder)


def test_finished_run_is_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run(coins(), tmp_path / "a")
    monkeypatch.setattr(type(coins()), "measure", None)
    assert len(run(coins(), tmp_path / "a").rows) == 3


@pytest.mark.parametrize("workers", ["1", "2"])
def test_ctrl_c_leaves_whole_tasks_and_says_how_to_resume(tmp_path: Path, workers: str) -> None:
    settings = "type: sample_plugin:Coins\npause: 0.3\nseeds: 100\n"
    (tmp_path / "slow.yaml").write_text(settings)
    made = shell("run", "slow.yaml", "--out", "r", "--workers", workers, cwd=tmp_path)
    until = time.monotonic() + 60
    while not list((tmp_path / "r" / "tasks").glob("[!.]*")) and time.monotonic() < until:
        time.sleep(0.05)
    os.killpg(made.pid, signal.SIGINT)  # of the workers too, as a terminal does
    _, error = made.communicate(timeout=60)
    assert made.returncode == 2, error
    assert "goes on from there" in error and "Traceback" not in error
    assert not (tmp_path / "r" / "table.csv").exists()
    assert list((tmp_path / "r" / "tasks").glob("[!.]*"))
    for path in (tmp_path / "r" / "tasks").glob("[!.]*/*.json"):
        assert path.read_text().endswith("}\n")


def test_the_folder_may_be_a_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(coins(), "mine").folder == Path("mine")
    assert (tmp_path / "mine" / "table.csv").is_file()


@pytest.mark.parametrize("given", ["crossing", Path("a"), ({}, [])])
def test_what_is_no_experiment_is_refused(given: Any, tmp_path: Path) -> None:
    with pytest.raises(
        WideberthError, match=r"takes an Experiment, and .* given; .wideberth.run. takes"
    ):
        run(given, tmp_path / "a")
    assert not (tmp_path / "a").exists()


def test_a_quick_run_says_what_it_leaves_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(coins(seeds=5), tmp_path / "a", quick=True)
    assert capsys.readouterr().err == "quick: seeds 2, not 5\n"
    run(coins(seeds=2), tmp_path / "b", quick=True)  # the whole one
    assert capsys.readouterr().err == ""
    doorway, _ = read_experiment("doorway", [])
    said = left_out(describe(doorway), describe(doorway.quick()))
    assert said == "seeds 1, not 20; scenarios without robot"


def test_quick_runs_the_reduced_copy(tmp_path: Path) -> None:
    assert len(run(coins(), tmp_path / "q", quick=True).rows) == 2


def test_folder_of_another_config_is_refused_before_any_work(tmp_path: Path) -> None:
    run(coins(), tmp_path / "a")
    with pytest.raises(WideberthError, match=r"another config \(it differs in bias\).*--out"):
        run(coins(bias=0.25), tmp_path / "a")
    assert len(run(coins(seeds=1), tmp_path / "a", fresh=True).rows) == 1


def test_a_name_that_a_module_registers_is_known_when_its_result_is_opened(tmp_path: Path) -> None:
    text = (HERE / "sample_plugin.py").read_text(encoding="utf-8")
    text += 'from wideberth import register\n\nregister("experiments", "own_coins")(Coins)\n'
    (tmp_path / "named_coins.py").write_text(text, encoding="utf-8")
    (tmp_path / "mine.yaml").write_text("type: named_coins:Coins\n")

    def call(*arguments: str) -> None:
        done = shell(*arguments, cwd=tmp_path)
        message = done.communicate(timeout=60)[1]
        assert done.returncode == 0, message

    call("run", "mine.yaml", "--out", "out", "--no-figures")
    stored = (tmp_path / "out" / "config.yaml").read_text()
    assert "type: own_coins\n" in stored and stored.endswith("plugins:\n- named_coins\n")
    call("show", "out")
    older = stored.replace("plugins:\n- named_coins\n", "plugins: []\n")
    (tmp_path / "out" / "config.yaml").write_text(older)
    call("run", "mine.yaml", "--out", "out", "--no-figures")  # still the same config


@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_module_beside_its_config_is_found(tmp_path: Path, workers: str) -> None:
    """The command is given in another folder; a library of the same name keeps its place."""
    inside = tmp_path / "mine"
    inside.mkdir()
    text = (HERE / "sample_plugin.py").read_text(encoding="utf-8")
    (inside / "beside_coins.py").write_text(text, encoding="utf-8")
    (inside / "json.py").write_text("raise ImportError('not this one')", encoding="utf-8")
    (inside / "mine.yaml").write_text("type: beside_coins:Coins\nplugins: [beside_coins]\n")
    arguments = ("run", "mine/mine.yaml", "--out", "out", "--no-figures", "--workers", workers)
    done = shell(*arguments, cwd=tmp_path)
    message = done.communicate(timeout=60)[1]
    assert done.returncode == 0, message
    assert (tmp_path / "out" / "table.csv").is_file()


def test_folder_of_other_source_is_refused(tmp_path: Path) -> None:
    run(coins(), tmp_path / "a")
    path = tmp_path / "a" / "provenance.json"
    write_json(path, "provenance", 1, {**read_json(path, "provenance", 1), "source": "old"})
    with pytest.raises(WideberthError, match=r"other source code.*--fresh"):
        run(coins(), tmp_path / "a")


def test_a_changed_plug_in_or_recording_is_not_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = tmp_path / "own_spread.py"
    text = (HERE / "sample_plugin.py").read_text(encoding="utf-8")
    module.write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    experiment: Experiment = build("experiments", {"type": "own_spread:Coins"})
    for _ in range(2):
        run(experiment, tmp_path / "out")
    module.write_text(text + "\n# changed\n", encoding="utf-8")
    with pytest.raises(WideberthError, match="other source code or data"):
        run(experiment, tmp_path / "out")
    tracks = tmp_path / "people.txt"
    tracks.write_text((HERE.parents[1] / "experiments" / "data" / "crowd.txt").read_text())
    replay = read_experiment("replay", [f"tracks.path={tracks}"])[0]
    assert replay.inputs() == [tracks]
    before = fingerprint(replay.inputs())
    tracks.write_text(tracks.read_text() + "# one more line\n")
    assert fingerprint(replay.inputs()) != before


def test_unusable_folders_are_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("mine")
    with pytest.raises(WideberthError, match=r"holds no result"):
        run(coins(), tmp_path / "full", fresh=True)
    assert (tmp_path / "full" / "thesis.tex").read_text() == "mine"
    with pytest.raises(WideberthError, match=r"--out"):
        run(coins(), tmp_path / "full" / "thesis.tex")
    with pytest.raises(WideberthError, match=r"cannot be written.*--out"):
        run(coins(), tmp_path / "full" / "thesis.tex" / "below")
    with pytest.raises(WideberthError, match=r"workers is 0"):
        run(coins(), tmp_path / "w", workers=0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["full"]


def test_refusal_names_the_task(tmp_path: Path) -> None:
    with pytest.raises(WideberthError, match=r"task 'seed 0': the coin fell on its edge"):
        run(coins(fails=True), tmp_path / "a")


def test_a_plug_ins_exception_names_task_and_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(self: Experiment, task: Task) -> TaskOutcome:
        raise KeyError("boom")

    monkeypatch.setattr(type(coins()), "measure", breaks)
    with pytest.raises(WideberthError, match=r"'seed 0': KeyError: 'boom' \(.*test_runner.py, l"):
        run(coins(), tmp_path / "a")


def test_tables_fold_to_the_terminal_and_keep_their_names(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "90")
    numbers = {f"number_{k}": 3000.0 + k for k in range(30)}
    print_table([{"name": f"row {i}", **numbers} for i in range(6)])
    printed = capsys.readouterr().out
    assert all(len(line) <= 90 for line in printed.splitlines())
    assert printed.count("row 3") > 1  # 30 numbers do not fit beside each other
    assert all(printed.count(f" {name.replace('_', ' ')} ") == 1 for name in numbers)
    assert printed.count(" 3029 ") == 6 and "…" not in printed
    print_table([{"name": "notes", "text": "wanted [/data/a.txt] of [hotel]"}])  # no markup
    assert "wanted [/data/a.txt] of [hotel]" in capsys.readouterr().out


def test_figures_are_the_same_bytes_each_time(tmp_path: Path) -> None:
    run(coins(), tmp_path / "a")
    first = {path.name: path.read_bytes() for path in draw(tmp_path / "a")}
    assert set(first) == {"share.png", "share.pdf"}
    assert first == {path.name: path.read_bytes() for path in draw(tmp_path / "a")}
    assert b"CreationDate" not in first["share.pdf"]
