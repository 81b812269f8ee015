"""A Dask cluster gives the same bytes as one process, whatever becomes of its workers."""

import re
import shutil
import subprocess
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import pytest

from wideberth.experiments.engine import dask_pool as module
from wideberth.experiments.engine.dask_pool import Cluster
from wideberth.experiments.engine.runner import run
from wideberth.framework.values.errors import WideberthError

pytestmark = pytest.mark.skipif(find_spec("distributed") is None, reason="needs Dask")

SETTINGS = {"seeds": 60, "pause": 0.03}
YAML = "type: sample_plugin:Coins\nseeds: 60\npause: 0.03\n"


@pytest.fixture(autouse=True)
def sweeps(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "helpers")
    return import_module("sweeps")


def reports(error: str) -> list[str]:
    """Return the lines of progress, without those on a start that takes longer than a second."""
    return [line for line in error.splitlines() if not line.endswith(" ...")]


def test_same_tables_whatever_becomes_of_the_cluster(tmp_path: Path, sweeps: ModuleType) -> None:
    """One process, and a cluster that is late, loses a worker, and then its scheduler."""
    run(sweeps.coins(**SETTINGS), tmp_path / "one")
    one = sweeps.contents(tmp_path / "one")
    (tmp_path / "coins.yaml").write_text(YAML)

    with sweeps.dask_cluster(tmp_path, workers=0) as cluster:

        def begin(out: str) -> "subprocess.Popen[str]":
            options = ("--out", out, "--no-figures", "--scheduler", cluster.address)
            return sweeps.wideberth("run", "coins.yaml", *options, cwd=tmp_path)

        def some(out: str) -> None:
            tasks = tmp_path / out / "tasks"
            sweeps.wait_until(lambda: len(list(tasks.glob("[!.]*"))) >= 10, "tasks")
            assert not (tmp_path / out / "table.csv").exists()  # in the middle

        made = begin("cluster")
        sweeps.wait_until((tmp_path / "cluster" / "config.yaml").is_file, "the folder")
        cluster.join(2)
        some("cluster")
        cluster.workers[0].kill()
        _, error = made.communicate(timeout=60)
        assert made.returncode == 0, error
        first, *rest = reports(error)
        assert first == f"no worker at {cluster.address}; the work waits for one"
        assert all(re.match(r"\d+ of 60 tasks", line) for line in rest), error
        assert sweeps.contents(tmp_path / "cluster") == one

        made = begin("cut")
        some("cut")
        cluster.scheduler.kill()
        _, error = made.communicate(timeout=60)
    assert made.returncode == 2
    assert f"Error: the scheduler {cluster.address} was lost; " in error
    assert "of 60 tasks are done and kept in cut: once that is corrected" in error
    *before, _ = reports(error)
    assert all(re.match(r"\d+ of 60 tasks", line) for line in before), error
    run(sweeps.coins(**SETTINGS), tmp_path / "cut")
    assert sweeps.contents(tmp_path / "cut") == one


def test_workers_with_another_environment_are_refused_before_any_work(
    tmp_path: Path, sweeps: ModuleType
) -> None:
    other = tmp_path / "other"
    other.mkdir()
    text = (Path(__file__).parents[1] / "helpers" / "sample_plugin.py").read_text()
    (other / "sample_plugin.py").write_text(text + "# edited\n")
    with sweeps.dask_cluster(tmp_path, workers=0) as cluster:

        def refusal() -> str:
            with pytest.raises(WideberthError) as caught:
                run(sweeps.coins(), tmp_path / "r", scheduler=cluster.address)
            cluster.workers[-1].kill()
            cluster.workers[-1].wait()
            assert not (tmp_path / "r").exists()
            return str(caught.value)

        cluster.join(path=other)
        told = refusal()
        assert "the worker tcp://" in told and "differs" in told
        assert "module sample_plugin.py" in told and "numpy" not in told
        cluster.join(path=tmp_path)
        assert "No module named 'sample_plugin'" in refusal()
        cluster.join(1, "--nthreads", "2")
        assert "does 2 tasks at once" in refusal()
        cluster.join(OMP_NUM_THREADS="3")
        assert "OMP_NUM_THREADS is 3" in refusal()


def test_a_task_that_ends_its_workers_is_named(tmp_path: Path, sweeps: ModuleType) -> None:
    with sweeps.dask_cluster(
        tmp_path, DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0"
    ) as cluster:
        experiment = sweeps.deadly(tmp_path, deadly=0, lives=99)
        with pytest.raises(WideberthError, match=r"'seed 0' ends every worker.*lost with it: 1"):
            run(experiment, tmp_path / "r", scheduler=cluster.address)
    assert len(list(tmp_path.glob("death-*"))) <= 2  # on another one, once more


def test_a_scheduler_that_does_not_answer_costs_nothing(
    tmp_path: Path, sweeps: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_PATIENCE", 0.3)
    silent = "tcp://127.0.0.1:9"
    with pytest.raises(
        WideberthError, match=r"no scheduler answers at tcp://127.0.0.1:9 .*nothing"
    ):
        run(sweeps.coins(), tmp_path / "r", scheduler=silent)
    assert not (tmp_path / "r").exists()
    run(sweeps.coins(), tmp_path / "r")
    with pytest.raises(WideberthError, match=r"no scheduler answers"):
        run(sweeps.coins(bias=0.3), tmp_path / "r", fresh=True, scheduler=silent)
    assert len(run(sweeps.coins(), tmp_path / "r", scheduler=silent).rows) == 3  # it is finished


@pytest.mark.parametrize("address", ["127.0.0.1:8786", "http://h:1", "tcp://h", "tcp://h:x", ""])
def test_addresses(address: str) -> None:
    with pytest.raises(WideberthError, match=r"wanted tcp://HOST:PORT or tls://HOST:PORT"):
        Cluster(address, b"")


def test_a_scheduler_has_workers_of_its_own(tmp_path: Path, sweeps: ModuleType) -> None:
    with pytest.raises(WideberthError, match=r"workers is 2, and a scheduler has its own"):
        run(sweeps.coins(), tmp_path / "r", workers=2, scheduler="tcp://h:1")


def test_tls_without_certificates_is_one_message(
    tmp_path: Path, sweeps: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_PATIENCE", 0.3)
    with pytest.raises(WideberthError, match=r"that Dask's config names the certificates"):
        run(sweeps.coins(), tmp_path / "r", scheduler="tls://127.0.0.1:9")
    assert not (tmp_path / "r").exists()


@pytest.mark.skipif(shutil.which("openssl") is None, reason="makes certificates with openssl")
def test_tls(tmp_path: Path, sweeps: ModuleType) -> None:
    """Dask's own config names the files."""
    import dask

    for command in (
        "req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=ca -keyout ca.key -out ca.pem",
        "req -newkey rsa:2048 -nodes -subj /CN=cluster -keyout own.key -out own.csr",
        "x509 -req -in own.csr -CA ca.pem -CAkey ca.key -CAcreateserial -days 2 -out own.pem",
    ):
        subprocess.run(
            ["openssl", *command.split()], cwd=tmp_path, check=True, capture_output=True
        )
    ca, cert, key = (tmp_path / name for name in ("ca.pem", "own.pem", "own.key"))
    files = ("--tls-ca-file", str(ca), "--tls-cert", str(cert), "--tls-key", str(key))
    with sweeps.dask_cluster(tmp_path, 1, ("--protocol", "tls", *files)) as cluster:
        assert cluster.address.startswith("tls://")
        tls = {"tls.ca-file": ca, "tls.client.cert": cert, "tls.client.key": key}
        named = {f"distributed.comm.{name}": str(file) for name, file in tls.items()}
        with dask.config.set(named):
            run(sweeps.coins(), tmp_path / "r", scheduler=cluster.address)
    run(sweeps.coins(), tmp_path / "one")
    assert sweeps.contents(tmp_path / "r") == sweeps.contents(tmp_path / "one")
