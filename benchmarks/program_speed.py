"""Speed of the evaluator on the recommended problem: ``python benchmarks/program_speed.py``.

It prints for each stage function the operations of its program, the microseconds for 24 columns
and, where valgrind is installed, the instructions. These do not depend on the machine's load.
"""

import re
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from wideberth import Path as Route
from wideberth.framework import Observation, recommended
from wideberth.framework.mpc.ocp.problem import Problem
from wideberth.framework.plugins.config import build
from wideberth.framework.programs import SOURCES, Program
from wideberth.solvers.riccati.compile_once import FLAGS
from wideberth.solvers.riccati.kernels import build as stage_functions

COLUMNS, CALLS = 24, 20_000
ROBOT = {
    "type": "unicycle", "radius": 0.3, "max_speed": 1.5, "max_acceleration": 1.5,
    "max_yaw_rate": 1.5, "max_yaw_acceleration": 3.0,
}  # fmt: skip


def problem() -> Problem:
    """Return a problem of the recommended planner."""
    robot = build("robots", ROBOT)
    planner = recommended(robot, 1.25, quiet=True)
    planner.set_path(Route(np.array([[0.0, 0.0], [9.0, 0.0]])))
    planner.command(Observation(0.0, np.zeros(len(robot.states))))
    *_, made = planner._services.problems._made.values()
    assert isinstance(made, Problem)
    return made


def programs() -> Mapping[str, Program]:
    """Return the programs of the stage functions."""
    functions = stage_functions(problem()).functions
    return {name: Program.of(function, fused=True) for name, function in functions.items()}


def compiled(folder: Path, flags: list[str]) -> Path:
    """Compile the program that runs programs."""
    source, target = Path(__file__).with_suffix(".c"), folder / "program_speed"
    shared = [flag for flag in FLAGS if flag not in ("-std=c99", "-fPIC", "-shared")]
    command = ["cc", "-std=c11", *shared, *flags, f"-I{SOURCES}", str(source), "-o", str(target)]
    subprocess.run([*command, "-lm"], check=True)
    return target


def instructions(command: list[str]) -> int:
    """Return how many instructions one call of each program takes, all together."""
    counter = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
    done = subprocess.run(
        [*counter, "--toggle-collect=run", *command], capture_output=True, text=True, check=True
    )
    return int(re.findall(r"Collected : (\d+)", done.stderr)[0])


def main() -> None:
    """Print a line for each stage function."""
    with TemporaryDirectory() as name:
        tool = compiled(Path(name), ["-march=native"])
        for function, program in programs().items():
            file = Path(name) / "program"
            file.write_bytes(np.int64(len(program.words)).tobytes() + program.words.tobytes())
            run = [str(tool), str(file), str(COLUMNS)]
            done = subprocess.run([*run, str(CALLS)], capture_output=True, text=True, check=True)
            words = f"{function:16s} {program.words[5]:5d} operations {float(done.stdout):8.2f} us"
            if shutil.which("valgrind"):
                words += f" {instructions([*run, '1']):9d} instructions"
            print(words)


if __name__ == "__main__":
    main()
