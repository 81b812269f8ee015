"""Processes of a real ROS 2 in a network of their own, with logs that are kept."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[4]
DISTRIBUTIONS = ("kilted", "jazzy")
ROBOT = ROOT / "packages" / "ros" / "tests" / "helpers" / "rclpy_robot.py"
PATIENCE = 30.0
"""s, for which something is waited for, unless a test says otherwise."""
LONGEST = 1800
"""s, after which a node ends whose test was killed."""
OVERLAY = (
    "import json, sys\n"
    "before = set(sys.path)\n"
    "from wideberth.packages.ros.tests.helpers import compile_messages\n"
    "print(json.dumps([place for place in sys.path if place not in before]))"
)


def python_of(distribution: str) -> Path:
    """Return the Python of an environment that `make ros` makes."""
    return ROOT / ".venv" / f"ros-{distribution}" / "bin" / "python"


@cache
def overlay(distribution: str) -> list[str]:
    """Return the folders of compiled messages, as of a workspace that is sourced."""
    python = str(python_of(distribution))
    found = subprocess.run([python, "-c", OVERLAY], capture_output=True, text=True, check=True)
    return list(json.loads(found.stdout.splitlines()[-1]))


@dataclass
class Process:
    """A process that was started; its log holds what it printed."""

    child: subprocess.Popen[str]
    log: Path

    def say(self, line: str) -> None:
        """Write a line to its input."""
        assert self.child.stdin is not None
        self.child.stdin.write(line + "\n")
        self.child.stdin.flush()

    def signal(self, number: int) -> None:
        """Send a signal to it and to what it started."""
        os.killpg(self.child.pid, number)

    def ended(self, seconds: float = PATIENCE) -> int:
        """Wait for its end; return its exit status."""
        return self.child.wait(seconds)

    def prints(self, text: str, seconds: float = PATIENCE) -> None:
        """Wait until it has printed a text."""
        end = time.monotonic() + seconds
        while text not in self.text():
            assert self.child.poll() is None and time.monotonic() < end, self.text()
            time.sleep(0.02)

    def text(self) -> str:
        """Return what it printed."""
        return self.log.read_text(encoding="utf-8", errors="replace")


@dataclass
class Robot(Process):
    """The robot of rclpy_robot.py; `rows` is what it noted, a row each 0.05 s."""

    trace: Path
    seen: list[dict[str, Any]] = field(default_factory=list)
    size: int = 0
    """Bytes of the trace that were read."""

    def rows(self) -> list[dict[str, Any]]:
        """Return all that was noted so far."""
        if self.trace.is_file():
            with self.trace.open("rb") as file:
                file.seek(self.size)
                whole, newline, _ = file.read().rpartition(b"\n")
            self.size += len(whole + newline)
            self.seen += map(json.loads, whole.splitlines())
        return self.seen

    def until(
        self, wanted: Callable[[dict[str, Any]], bool], seconds: float = PATIENCE
    ) -> dict[str, Any]:
        """Wait for a row from now on that is wanted; return it."""
        place, end = len(self.rows()), time.monotonic() + seconds
        while time.monotonic() < end:
            for row in self.rows()[place:]:
                place += 1
                if wanted(row):
                    return row
            assert self.child.poll() is None, self.text()
            time.sleep(0.02)
        raise AssertionError(f"not within {seconds:g} s; the last was {self.rows()[-1:]}")

    def says(self, status: str, seconds: float = PATIENCE) -> dict[str, Any]:
        """Wait for diagnostics from now on that hold a text; return the row."""
        said = self.rows()[-1]["said"] if self.rows() else 0
        return self.until(lambda row: row["said"] > said and status in row["status"], seconds)


@dataclass
class Network:
    """A network of one distribution, for one test."""

    distribution: str
    folder: Path
    domain: int
    keeper: int | None
    """Process that holds the network; None for this computer's own."""
    started: list[Process] = field(default_factory=list)

    def start(self, *arguments: object, name: str, **environment: str) -> Process:
        """Start the Python of the distribution; ``name`` is that of the log."""
        log = self.folder / f"{name}-{len(self.started)}.log"
        inside = ["nsenter", "-t", str(self.keeper), "-U", "-n", "-m", "--preserve-credentials"]
        command = [str(one) for one in (python_of(self.distribution), *arguments)]
        with log.open("w") as out:
            child = subprocess.Popen(
                [*(inside if self.keeper else []), *command],
                stdin=subprocess.PIPE, stdout=out, stderr=subprocess.STDOUT, text=True,
                env=self._environment() | environment, cwd=self.folder, start_new_session=True,
            )  # fmt: skip
        process = Process(child, log)
        self.started.append(process)
        return process

    def messages(self) -> dict[str, str]:
        """Return the environment in which the compiled messages are found, as if sourced."""
        folders = overlay(self.distribution)
        return {
            "PYTHONPATH": os.pathsep.join(folders),
            "LD_LIBRARY_PATH": os.pathsep.join(
                str(place) for folder in folders for place in Path(folder).iterdir()
            ),
        }

    def robot(self, *arguments: object, **environment: str) -> Robot:
        """Start the robot; its arguments are those of rclpy_robot.py."""
        trace = self.folder / f"robot-{len(self.started)}.jsonl"
        process = self.start(
            ROBOT, trace, *arguments, name="robot", **self.messages(), **environment
        )
        return Robot(process.child, process.log, trace)

    def node(self, config: Path, *arguments: object, **environment: str) -> Process:
        """Start `wideberth node`."""
        command = python_of(self.distribution).with_name("wideberth")
        words = (command, "node", config, "--seconds", LONGEST, *arguments)
        return self.start(*words, name="node", **environment)

    def close(self) -> None:
        """End all that was started."""
        for process in self.started:
            if process.child.poll() is None:
                process.signal(signal.SIGKILL)
            process.child.wait()
            if process.child.stdin is not None:
                process.child.stdin.close()
            print(f"--- {process.log.name}\n{process.text()[-3000:]}")

    def _environment(self) -> dict[str, str]:
        return os.environ | {
            "ROS_DOMAIN_ID": str(self.domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET" if self.keeper else "LOCALHOST",
            "ROS_LOG_DIR": str(self.folder / "log"),
            "PYTHONUNBUFFERED": "1",
        }


def keeper() -> subprocess.Popen[str] | None:
    """Start a process that holds a network of its own; None where the kernel lets us not."""
    if sys.platform != "linux" or not all(map(shutil.which, ("unshare", "nsenter", "ip"))):
        return None
    # With multicast: by single addresses Fast DDS finds no more than some thirty participants. It
    # also passes messages by shared memory, whose names are those of ports.
    script = (
        "mount -t tmpfs tmpfs /dev/shm && ip link set lo up multicast on && "
        "ip route add 224.0.0.0/4 dev lo && echo up && exec cat"
    )
    child = subprocess.Popen(
        ["unshare", "-rnm", "sh", "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, text=True, start_new_session=True,
    )  # fmt: skip
    assert child.stdin is not None and child.stdout is not None
    with child.stdout:
        if child.stdout.readline() == "up\n":
            return child
    child.stdin.close()
    child.wait()
    return None
