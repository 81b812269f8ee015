"""Tables in Parquet: what the CSV says, typed, with the origin of the result in the file."""

import importlib
import json
import logging
import sys
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace

import pytest

from wideberth.experiments.cli import app as cli
from wideberth.experiments.engine import parquet_table
from wideberth.experiments.engine.csv_tables import read_table, write_table
from wideberth.experiments.engine.runner import run
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.io import read_json, write_json
from wideberth.framework.values.errors import WideberthError

HERE = Path(__file__).parents[1] / "helpers"


def made(folder: Path, rows: list[dict[str, object]]) -> Path:
    folder.mkdir(exist_ok=True)
    write_table(folder / "table.csv", rows)
    (folder / "config.yaml").write_text("type: made\n")
    write_json(folder / "provenance.json", "provenance", 1, {"commit": "abc"})
    return parquet_table.write_parquet(folder)


def test_columns_keep_their_types(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    nan, huge = float("nan"), 2**70
    rows = [
        {"i": 1, "f": 0.1 + 0.2, "b": True, "t": "a, b", "mixed": 1, "either": 1, "huge": huge},
        {"i": -2, "f": 3, "b": None, "t": None, "mixed": 1.5, "either": "none", "huge": 1},
        {"i": None, "f": float("-inf"), "b": False, "t": "é", "mixed": nan, "either": True},
    ]
    table = parquet.read_table(made(tmp_path, [{**row, "empty": None} for row in rows]))
    kinds = {field.name: str(field.type) for field in table.schema}
    assert kinds == {
        "i": "int64", "f": "double", "b": "bool", "t": "string", "mixed": "double",
        "either": "string", "huge": "string", "empty": "null",
    }  # fmt: skip
    columns = table.to_pydict()
    assert columns["i"] == [1, -2, None] and columns["f"] == [0.1 + 0.2, 3.0, float("-inf")]
    assert columns["b"] == [True, None, False] and columns["t"] == ["a, b", None, "é"]
    assert columns["mixed"][:2] == [1.0, 1.5] and columns["mixed"][2] != columns["mixed"][2]
    assert columns["either"] == ["1", "none", "True"] and columns["huge"] == [str(huge), "1", None]


def test_origin_stands_in_the_file_and_bytes_repeat(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    monkeypatch.syspath_prepend(HERE)
    result = run(build("experiments", {"type": "sample_plugin:Coins"}), tmp_path / "r")
    path = parquet_table.write_parquet(tmp_path / "r")
    first = path.read_bytes()
    table = parquet.read_table(path)
    assert table.to_pylist() == result.rows == read_table(tmp_path / "r" / "table.csv")
    metadata = table.schema.metadata
    config = (tmp_path / "r" / "config.yaml").read_bytes()
    assert metadata[b"config"] == config
    assert metadata[b"config_hash"].decode() == sha256(config).hexdigest()
    origin = read_json(tmp_path / "r" / "provenance.json", "provenance", 1)
    assert json.loads(metadata[b"provenance"]) == origin
    assert parquet_table.write_parquet(tmp_path / "r").read_bytes() == first


def test_a_table_without_rows(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    assert parquet.read_table(made(tmp_path, [])).num_rows == 0


def test_option_adds_the_file_to_a_finished_run_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pyarrow")
    monkeypatch.syspath_prepend(HERE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    Path("coins.yaml").write_text("type: sample_plugin:Coins\n")
    for options, there in (([], False), (["--parquet"], True)):
        with pytest.raises(SystemExit, match="0"):
            cli.main(["run", "coins.yaml", "--no-figures", *options])
        assert ("results/coins/table.parquet" in capsys.readouterr().out) == there
        assert Path("results/coins/table.parquet").exists() == there


def test_without_the_extra_nothing_is_begun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setattr(sys, "path", list(sys.path))
    with pytest.raises(SystemExit, match="2"):
        cli.main(["run", "approximation_error", "--parquet"])
    assert "pip install 'wideberth[parquet]'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    monkeypatch.setitem(sys.modules, "distributed", None)
    module = importlib.import_module("wideberth.experiments.engine.dask_pool")
    with pytest.raises(WideberthError, match=r"pip install 'wideberth\[cluster\]'"):
        module.Cluster("tcp://127.0.0.1:9", b"")


def test_dask_is_silent_as_long_as_we_speak_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    module = importlib.import_module("wideberth.experiments.engine.dask_pool")
    client = SimpleNamespace(close=lambda timeout: None, get_executor=lambda pure: None)
    monkeypatch.setattr(module, "_connect", lambda scheduler: client)
    monkeypatch.setattr(module.Cluster, "_compare", lambda self: None)
    logs = [logging.getLogger(f"distributed.{name}") for name in ("client", "batched")]
    before = [log.level for log in logs]
    cluster = module.Cluster("tcp://127.0.0.1:9", b"")
    assert not any(log.isEnabledFor(logging.ERROR) for log in logs)
    cluster.close()
    assert [log.level for log in logs] == before
