"""Files that were made to exhaust or to crash a reader end in one message, and soon."""

import io
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from wideberth.controllers.diagnosis.solve_record import read_solve
from wideberth.experiments.engine.csv_tables import read_table
from wideberth.experiments.engine.runner import run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.engine.tasks import read_task
from wideberth.framework.plugins.config import build, describe, load_plugin
from wideberth.framework.plugins.io import expanded, read_json
from wideberth.framework.plugins.yamlfile import apply, parse, read_config
from wideberth.framework.values.errors import WideberthError
from wideberth.predictors.data.recordings import read_robot_log, read_tracks
from wideberth.simulation.log.episode_log import Episode

BOMB = "a0: &a0 [1, 1, 1]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 9)
)
"""Eight lists of ten aliases each: a hundred million values."""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 100_000, r"nested too deep; is a bracket left open"),
        ("{a: " * 100_000, r"nested too deep"),
        ("- " * 50_000 + "1", r"nested too deep"),
        ("a: *b", r"undefined alias"),
        ("a: &a {b: *a}", r"line 1, column 4.*holds an alias to itself"),
        (BOMB, r"line 7, column 5.*stands for more than 1000000 values"),
        ("a: " + "7" * 5001, r"'777.*is no number that can be held"),
        ("a: " + "1:" * 100_000 + "1", r"is not the same number to all readers of YAML"),
        ("a: 1e9999", r"column 4.*1e9999 is too large for a number; infinity is written \.inf"),
        ("a: -1.0e+9999", r"too large for a number"),
        ("a: 2020-13-45", r"'2020-13-45' is no number"),
        ("a: !!int x", r"'x' is no number"),
        ("a: !!float [1]", r"is not YAML"),
        ("a: !!bool x", r"'x' is no number"),
        ("a: !!python/object/apply:os.system [ls]", r"could not determine a constructor"),
        ("[1, 2]: 3", r"a key must be one word"),
        ("? {a: 1}\n: 3", r"a key must be one word"),
        ("1: a\n1: b", r"key 1 stands twice"),
        ("a: b\n" + "x" * 300 + ": 1\n" + "x" * 300 + ": 1", r"key 'xxx.* stands twice"),
        ("a: 1\n---\nb: 2", r"is not YAML"),
    ],
)
def test_yaml(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(WideberthError, match=words) as caught:
        read_config(path)
    message = str(caught.value)
    assert message.startswith(str(path)) and len(message) < 500 and "\n" not in message


def test_yaml_that_is_large_and_sound() -> None:
    assert len(parse("".join(f"k{i}: {i}\n" for i in range(4000)), "x")) == 4000
    assert parse("a: .inf\nb: &b {x: 1}\nc: [*b, *b]", "x")["c"] == [{"x": 1}, {"x": 1}]
    assert len(parse("a: [" + "1, " * 12_000 + "]", "x")["a"]) == 12_000


def test_merged_mappings_are_no_repeated_keys() -> None:
    """A mapping that merges a deeper one, which itself merges another."""
    text = "one: {two: {three: &b {<<: &a {x: 1}, x: 2}}}\nlast: {<<: *b, y: 3}"
    assert parse(text, "x")["last"] == {"x": 2, "y": 3}
    assert parse(text, "x")["one"] == {"two": {"three": {"x": 2}}}


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("a=" + "[" * 5000, r"nested too deep"),
        ("list." + "9" * 5000 + "=1", r"no index of it"),
        ("a=" + "7" * 5001, r"is no number that can be held"),
        ("x" * 100_000, r"wanted KEY=VALUE"),
    ],
)
def test_overrides(override: str, words: str) -> None:
    with pytest.raises(WideberthError, match=words) as caught:
        apply({"list": [0]}, override)
    assert len(str(caught.value)) < 5600


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 200_000, r"nested more than 60 deep"),
        ("[" * 61 + "]" * 61, r"nested more than 60 deep"),
        ('{"version": ' + "1" * 5001 + "}", r"cannot be read as JSON"),
        ('{"format": "' + "x" * 10**6 + '"}', r"has format 'xxx"),
        ('{"format": "wideberth/plugin", "version": [[]]}', r"has version \[\[\]\]"),
        ("\0", r"cannot be read as JSON"),
    ],
)  # fmt: skip
def test_json(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "saved.json"
    path.write_text(text)
    with pytest.raises(WideberthError, match=words) as caught:
        load_plugin(path, "predictors")
    assert len(str(caught.value)) < 500


def test_files_that_are_too_large(tmp_path: Path) -> None:
    with (tmp_path / "large").open("wb") as file:
        file.truncate(2**31)
    readers: list[Callable[[Path], object]] = [
        read_config,
        lambda path: read_json(path, "plan", 1),
        read_table,
        lambda path: read_tracks(path, dt=0.4),
        lambda path: read_robot_log(path, 0.4),
    ]
    for read in readers:
        with pytest.raises(WideberthError, match=r"has 2147483648 bytes; wanted at most"):
            read(tmp_path / "large")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_a_pipe_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(WideberthError, match="it is a pipe or a device; wanted a file"):
        read_config(tmp_path / "pipe")


@pytest.mark.parametrize(
    "text", ["[" * 200_000, '{"format": ' + "[" * 300 + "]" * 300 + "}", "1" * 5001, ""]
)
def test_a_finished_task_of_nested_brackets(text: str, tmp_path: Path) -> None:
    (tmp_path / "k").mkdir()
    (tmp_path / "k" / "rows.json").write_text(text)
    with pytest.raises(WideberthError):
        read_task(tmp_path, "k")


@pytest.mark.parametrize("rows", [3, [3], [{"a": []}], [[1]], {"a": 1}, None, "text"])
def test_a_finished_task_whose_rows_are_none(rows: object, tmp_path: Path) -> None:
    content = {"format": "wideberth/task", "version": 1, "task": "t", "files": [], "rows": rows}
    (tmp_path / "k").mkdir()
    (tmp_path / "k" / "rows.json").write_text(json.dumps(content))
    with pytest.raises(WideberthError):
        read_task(tmp_path, "k")


def archive(**arrays: object) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def described(**content: object) -> bytes:
    meta = json.dumps({"format": "wideberth/episode", "version": 1, **content}).encode()
    return archive(meta=np.frombuffer(meta, np.uint8), numbers=np.zeros(3))


def bomb() -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("meta.npy", bytes(2**20))
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", r"no npz archive"),
        (b"PK\x03\x04 and no more", r"damaged npz archive"),
        (archive(), r"it has no array 'meta'"),
        (archive(meta=np.zeros(3)), r"not a saved episode"),
        (archive(numbers=np.zeros(3), meta=np.array([{"a": 1}])), r"damaged npz archive"),
        (archive(meta=np.frombuffer(b"[" * 9999, np.uint8), numbers=np.zeros(1)), r"nested more"),
        (described(), r"episode is damaged \(KeyError: 'polygons'\)"),
        (described(times=3, agents=[]), r"episode is damaged"),
        (described(times={"at": 0, "shape": [10**9, 10**9]}, agents=[]), r"episode is damaged"),
        (described(times={"at": "x", "shape": "y"}, agents=[]), r"episode is damaged"),
        (described(times={"at": 0, "shape": [3]}, agents=3), r"episode is damaged"),
    ],
)  # fmt: skip
def test_an_episode_without_its_arrays(data: bytes, words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        Episode.from_bytes(data)


def test_an_archive_that_unpacks_to_too_much(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wideberth.framework.plugins.io.LARGEST_ARRAYS", 2**19)
    with pytest.raises(WideberthError, match=r"holds arrays of 1048576 bytes; wanted at most"):
        Episode.from_bytes(bomb())


def test_a_recorded_solve_without_its_arrays(tmp_path: Path) -> None:
    head = {"format": "wideberth/solve", "version": 1}
    (tmp_path / "s.json").write_text(json.dumps({**head, "planner": {}, "size": [3], "key": 1}))
    for data in (archive(), archive(a=np.zeros(3)), b"PK", b"", b"\x93NUMPY"):
        (tmp_path / "s.npz").write_bytes(data)
        with pytest.raises(WideberthError, match=r"s\.npz|s\.json"):
            read_solve(tmp_path / "s.json")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0 1 1e300 0\n1 1 2 3\n", r"line 1: x is 1e\+300 m; wanted at most 1e\+08"),
        ("0 1 1e9999 0\n", r"line 1: x is 1e9999"),
        ("0 1 0 0\n1 1 0 0\n1e300 2 0 0\n", r"are \d+ rows for 2 tracks"),
        ("1 " * 100_000, r"line 1: 100000 columns; wanted 4"),
        ("0 " + "x" * 10**6 + " 0 0", r"line 1: id has 1000000 characters"),
        ("0 1 " + "7" * 10**5 + "x 0", r"line 1: x is '777.*wanted a number"),
    ],
)
def test_recordings_of_absurd_numbers(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "r.txt"
    path.write_text(text)
    with pytest.raises(WideberthError, match=words) as caught:
        read_tracks(path, dt=0.4)
    assert len(str(caught.value)) < 800


@pytest.mark.parametrize("times", [(0.0, 1e300), (-1.5e308, 1.5e308), (0.0, 1e12)])
def test_a_robot_log_of_absurd_times(times: tuple[float, float], tmp_path: Path) -> None:
    path = tmp_path / "r.txt"
    path.write_text("".join(f"{time} 0 0 0\n" for time in times))
    with pytest.raises(WideberthError, match=r"rows; wanted at most 1e\+08"):
        read_robot_log(path, 1e-3)


def test_tables(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("a\n" + "7" * 5001 + "\n")
    assert read_table(path) == [{"a": "7" * 5001}]
    path.write_text("a\n" + "x" * 200_000 + "\n")
    with pytest.raises(WideberthError, match=r"cannot be read as a table"):
        read_table(path)


@pytest.mark.parametrize("name", ["a/b", "..", "../../x", "", " ", ".x", "x" * 300, "a\\b", "a\n"])
def test_names_that_name_no_file(name: str) -> None:
    config = describe(read_experiment("crossing", [])[0])
    config["planners"] = {name: config["planners"]["default"]}
    with pytest.raises(WideberthError, match=r"planners: .*cannot be a name: files are named"):
        build("experiments", config)


def test_an_unknown_home(tmp_path: Path) -> None:
    with pytest.raises(WideberthError, match=r"Give the whole path"):
        expanded("~nosuchuser/x")
    with pytest.raises(WideberthError, match=r"Give the whole path"):
        build("predictors", {"saved": "~nosuchuser/x.json"})


def test_nothing_is_made_for_a_config_that_is_refused(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(WideberthError):
        run(read_experiment("crossing", ["settings.time_limit=1e9999"])[0], out)
    assert not out.exists()
