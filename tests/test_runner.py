"""A run gives the same bytes however it is cut up, and never leaves half a file."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from wideberth.experiments.base import Experiment, Outcome, Result, Task
from wideberth.experiments.provenance import fingerprint
from wideberth.experiments.runner import draw, reopen, run, written
from wideberth.experiments.shards import checked_tasks, read_shard, shard_key, write_shard
from wideberth.experiments.shipped import read_experiment
from wideberth.experiments.showing import print_table
from wideberth.framework.config import build
from wideberth.framework.errors import WideberthError
from wideberth.framework.io import read_json, read_table, table_text, write_bytes, write_json

HERE = Path(__file__).parent
TIMED = {"times.csv"}


@pytest.fixture(autouse=True)
def _sample(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(HERE)


def coins(**settings: object) -> Experiment:
    made: Experiment = build("experiments", {"type": "sample_plugin:Coins", **settings})
    return made


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in written(folder)
        if path.name not in TIMED
    }


def shell(*arguments: str, cwd: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", "from wideberth.experiments.cli import main; main()"]
    return subprocess.Popen(
        [*command, *arguments], cwd=cwd, text=True, env={**os.environ, "PYTHONPATH": str(HERE)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
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
    assert not (tmp_path / "a" / "shards").exists()
    with pytest.raises(WideberthError, match=r"no file 'x'.*seed/0\.bin"):
        result.read("x")


def test_same_bytes_with_one_and_two_workers(tmp_path: Path) -> None:
    config = tmp_path / "coins.yaml"
    config.write_text("type: sample_plugin:Coins\nplugins: [sample_plugin]\n")
    for workers in ("1", "2"):
        made = shell(
            "run", "coins.yaml", "--out", workers, "--workers", workers, cwd=tmp_path
        )  # fmt: skip
        out, error = made.communicate(timeout=120)
        assert made.returncode == 0, error
        assert "share.png" in out
    one, two = contents(tmp_path / "1"), contents(tmp_path / "2")
    assert one == two
    assert "figures/share.pdf" in one


def test_resumes_to_the_same_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = run(coins(), tmp_path / "whole")
    kind = type(coins())
    measure = kind.measure
    seen: list[str] = []

    def stops(self: Experiment, task: Task) -> Outcome:
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
def test_ctrl_c_leaves_whole_shards_and_says_how_to_resume(tmp_path: Path, workers: str) -> None:
    settings = "type: sample_plugin:Coins\npause: 0.3\nseeds: 100\n"
    (tmp_path / "slow.yaml").write_text(settings)
    made = shell("run", "slow.yaml", "--out", "r", "--workers", workers, cwd=tmp_path)
    until = time.monotonic() + 60
    while not list((tmp_path / "r" / "shards").glob("*.json")) and time.monotonic() < until:
        time.sleep(0.05)
    made.send_signal(signal.SIGINT)
    _, error = made.communicate(timeout=60)
    assert made.returncode == 2, error
    assert "goes on from there" in error and "Traceback" not in error
    assert not (tmp_path / "r" / "table.csv").exists()
    for path in (tmp_path / "r" / "shards").glob("[!.]*.json"):
        assert path.read_text().endswith("}\n")


def test_quick_runs_the_reduced_copy(tmp_path: Path) -> None:
    assert len(run(coins(), tmp_path / "q", quick=True).rows) == 2


def test_folder_of_another_config_is_refused_before_any_work(tmp_path: Path) -> None:
    run(coins(), tmp_path / "a")
    with pytest.raises(WideberthError, match=r"another config \(it differs in bias\).*--out"):
        run(coins(bias=0.25), tmp_path / "a")
    assert len(run(coins(seeds=1), tmp_path / "a", fresh=True).rows) == 1


def test_folder_of_other_source_is_refused(tmp_path: Path) -> None:
    run(coins(), tmp_path / "a")
    path = tmp_path / "a" / "provenance.json"
    write_json(path, "provenance", 1, {**read_json(path, "provenance", 1), "source": "old"})
    with pytest.raises(WideberthError, match=r"other source code.*--fresh"):
        run(coins(), tmp_path / "a")


def test_a_changed_plug_in_or_recording_is_not_resumed(tmp_path: Path) -> None:
    module = tmp_path / "own_spread.py"
    text = (HERE / "sample_plugin.py").read_text(encoding="utf-8")
    module.write_text(text, encoding="utf-8")
    config = tmp_path / "mine.yaml"
    config.write_text("type: own_spread:Coins\n")
    arguments = ["run", "mine.yaml", "--out", "out", "--no-figures"]
    for changed, code in ((text, 0), (text, 0), (text + "\n# changed\n", 2)):
        module.write_text(changed, encoding="utf-8")
        done = shell(*arguments, cwd=tmp_path)
        _, message = done.communicate(timeout=60)
        assert done.returncode == code, message
    assert "other source code or data" in message
    tracks = tmp_path / "people.txt"
    tracks.write_text((HERE.parent / "experiments" / "data" / "crowd.txt").read_text())
    replay: Experiment = read_experiment("replay", [f"tracks.path={tracks}"])[0]
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
    def breaks(self: Experiment, task: Task) -> Outcome:
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
    assert all(len(line) <= 200 for line in printed.splitlines())
    assert printed.count("row 3") == 2  # 30 numbers do not fit beside each other
    assert "3029" in printed and "…" not in printed
    print_table([{"name": "notes", "text": "wanted [/data/a.txt] of [hotel]"}])  # no markup
    assert "wanted [/data/a.txt] of [hotel]" in capsys.readouterr().out


def test_figures_are_the_same_bytes_each_time(tmp_path: Path) -> None:
    run(coins(), tmp_path / "a")
    first = {path.name: path.read_bytes() for path in draw(tmp_path / "a")}
    assert set(first) == {"share.png", "share.pdf"}
    assert first == {path.name: path.read_bytes() for path in draw(tmp_path / "a")}
    assert b"CreationDate" not in first["share.pdf"]


def test_tasks_must_be_there_and_differ() -> None:
    with pytest.raises(WideberthError, match=r"no task"):
        checked_tasks([])
    with pytest.raises(WideberthError, match=r"two tasks are named 'a'"):
        checked_tasks([Task("a"), Task("a", 1)])


def test_shards(tmp_path: Path) -> None:
    task = Task("a", 1, {"x": 0.1})
    key = shard_key({"type": "e"}, task)
    assert key != shard_key({"type": "e"}, Task("a", 2, {"x": 0.1}))
    assert read_shard(tmp_path, key) is None
    outcome = Outcome([{"x": 0.1, "nan": float("inf")}], [{"t": 1.0}], {"f": b"\x00\xff"})
    write_shard(tmp_path, key, task, outcome)
    assert read_shard(tmp_path, key) == outcome
    path = tmp_path / f"{key}.json"
    path.write_text(path.read_text()[:-20])
    assert read_shard(tmp_path, key) is None  # damaged: done again
    with pytest.raises(WideberthError, match=r"leaves the folder"):
        write_shard(tmp_path, key, task, Outcome(files={"../f": b""}))
    with pytest.raises(WideberthError, match=r"not plain"):
        shard_key({}, Task("a", 0, {"x": object()}))


def test_table_reads_back_what_was_written(tmp_path: Path) -> None:
    rows = [
        {"a": 1, "b": 0.1 + 0.2, "c": "text, with\ncomma", "d": True, "e": None},
        {"a": -3, "b": 1e-300, "c": "1_000", "d": False, "f": float("-inf")},
    ]
    path = write_bytes(tmp_path / "t.csv", table_text(rows).encode())
    back = read_table(path)
    assert back[0] == {**rows[0], "f": None}
    assert back[1] == {**rows[1], "e": None}
    assert table_text([]) == "\n"
    with pytest.raises(WideberthError, match=r"column 'a' holds list"):
        table_text([{"a": []}])
    path.write_text("a,b\n1\n")
    with pytest.raises(WideberthError, match=r"line 2: 1 cells; wanted 2"):
        read_table(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(WideberthError, match=r"cannot be read as a table"):
        read_table(path)


def test_writing_is_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_bytes(tmp_path / "f", b"old")

    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises(WideberthError, match=r"cannot be written: No space left"):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]
    with pytest.raises(WideberthError, match=r"cannot be written"):
        write_bytes(tmp_path / "missing" / "f", b"")


def test_json_header(tmp_path: Path) -> None:
    path = write_json(tmp_path / "j", "plan", 2, {"x": 0.1})
    assert read_json(path, "plan", 2) == {"x": 0.1}
    with pytest.raises(WideberthError, match=r"wanted 'wideberth/episode'"):
        read_json(path, "episode", 2)
    with pytest.raises(WideberthError, match=r"version 2; this package reads 1 to 1"):
        read_json(path, "plan", 1)
    path.write_text("{")
    with pytest.raises(WideberthError, match=r"as JSON"):
        read_json(path, "plan", 2)


def test_result_without_files_or_times(tmp_path: Path) -> None:
    write_bytes(tmp_path / "table.csv", b"a\n1\n")
    result = Result(tmp_path)
    assert result.rows == [{"a": 1}] and result.times == [] and result.names() == []
