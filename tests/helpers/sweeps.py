"""What the tests of sweeps share: experiments, the bytes of results, clusters to run on."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from wideberth.experiments.engine.base import Experiment
from wideberth.experiments.engine.runner import written
from wideberth.framework.plugins.config import build

HERE = Path(__file__).parent


def python_path(folder: Path) -> str:
    """Return the search path of this process with a folder in front."""
    return os.pathsep.join([str(folder), *os.environ.get("PYTHONPATH", "").split(os.pathsep)])


ENVIRONMENT = {**os.environ, "PYTHONPATH": python_path(HERE), "OMP_NUM_THREADS": "1"}


def coins(**settings: object) -> Experiment:
    made: Experiment = build("experiments", {"type": "sample_plugin:Coins", **settings})
    return made


def deadly(folder: Path, **settings: object) -> Experiment:
    config = {"type": "deadly_plugin:Deadly", "folder": str(folder), **settings}
    made: Experiment = build("experiments", config)
    return made


def contents(folder: Path) -> dict[str, bytes]:
    """Bytes of every file of a result but the measured times."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in written(folder)
        if path.name != "times.csv"
    }


def wait_until(holds: Callable[[], object], what: str, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, f"waited {seconds} s in vain for {what}"
        time.sleep(0.02)


def wideberth(*arguments: str, cwd: Path) -> "subprocess.Popen[str]":
    """Start the command line as a user would."""
    command = [sys.executable, "-c", "from wideberth.experiments.cli.app import main; main()"]
    return subprocess.Popen(
        [*command, *arguments], cwd=cwd, text=True, env=ENVIRONMENT,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


@dataclass
class DaskCluster:
    """A scheduler and its workers, each a process."""

    address: str
    folder: Path
    options: tuple[str, ...]
    scheduler: "subprocess.Popen[bytes]"
    workers: list["subprocess.Popen[bytes]"] = field(default_factory=list)

    def join(self, count: int = 1, *options: str, path: Path = HERE, **environment: str) -> None:
        """Start workers and wait until they are connected."""
        logs = [self.folder / f"worker-{len(self.workers) + k}.log" for k in range(count)]
        threads = () if "--nthreads" in options else ("--nthreads", "1")
        arguments = (self.address, "--no-nanny", *threads, *options, *self.options)
        environment = {"PYTHONPATH": python_path(path), **environment}
        self.workers += [start("dask_worker", arguments, log, environment) for log in logs]
        for log in logs:
            wait_until(lambda log=log: b"Registered to" in log.read_bytes(), f"a worker ({log})")


def start(
    module: str, arguments: tuple[str, ...], log: Path, environment: Mapping[str, str]
) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-m", f"distributed.cli.{module}", "--no-dashboard", *arguments]
    with log.open("wb") as file:
        return subprocess.Popen(
            command, cwd=log.parent, stdout=file, stderr=file, env={**ENVIRONMENT, **environment}
        )


@contextmanager
def dask_cluster(
    folder: Path, workers: int = 2, options: tuple[str, ...] = (), **environment: str
) -> Iterator[DaskCluster]:
    """Yield a cluster on this machine; all of its processes end with the block."""
    log = folder / "scheduler.log"
    arguments = ("--host", "127.0.0.1", "--port", "0", *options)
    scheduler = start("dask_scheduler", arguments, log, environment)
    cluster = DaskCluster("", folder, tuple(o for o in options if o not in _ONLY), scheduler)
    try:
        wait_until(lambda: b"Scheduler at:" in log.read_bytes(), f"the scheduler ({log})")
        line = next(line for line in log.read_text().splitlines() if "Scheduler at:" in line)
        cluster.address = line.split()[-1]
        cluster.join(workers)
        yield cluster
    finally:
        for process in (*cluster.workers, scheduler):
            process.kill()
            process.wait()


_ONLY = ("--protocol", "tls")
"""Options of the scheduler that a worker does not know: it takes them from the address."""
