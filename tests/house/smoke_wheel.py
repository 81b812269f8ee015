"""Try what was built in fresh environments, away from the checkout.

    smoke_wheel.py DIST [PYTHON...]

DIST is the folder with wheels and source archives of the core and the packages beside it. Each
Python, a version or a path, gets the core alone, and with the extra `all`; without any, the
running one does. With the first Python each package is installed on top of a core alone, and the
commands of its README run. The core's source archive is installed once, and scripts are checked by
pyright against the last environment. With COMMANDS=1 in the environment, the commands and scripts
of all pages are run there as well.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from wideberth.tests.house import page_commands, typed_scripts
from wideberth.tests.house.test_imports import BESIDE
from wideberth.tests.house.test_pages import ROOT, blocks

UV = Path(sys.executable).with_name("uv")
EXAMPLES = {
    "predictor": "my_predictor:Braking --dimensions 2", "region": "my_region:Disc",
    "robot": "my_robot:Cart",
    "slot_kind": "my_slot_kind:Carts --set "
    "'outlines={a: [[-1, 0], [0, -1], [1, 0]], b: [[-1, 0], [0, -1], [1, 0]]}'",
}  # fmt: skip
"""Room -> what `wideberth check` is asked to check."""


@dataclass(frozen=True)
class Environment:
    """A fresh environment in a folder of its own, `env`, beside which its programs run."""

    folder: Path

    @classmethod
    def made(cls, folder: Path, python: str, *wanted: str) -> "Environment":
        """Install a package into a new environment, with its modules compiled as pip does."""
        folder.mkdir()
        made = cls(folder)
        subprocess.run([UV, "venv", "-q", "--python", python, folder / "env"], check=True)
        made.install("--compile-bytecode", *wanted)
        return made

    @property
    def python(self) -> Path:
        """Its interpreter."""
        return self.folder / "env" / "bin" / "python"

    def install(self, *words: str) -> None:
        """Let uv install something into it."""
        command = [UV, "pip", "install", "-q", "--python", self.python, *words]
        subprocess.run(command, check=True)

    def call(self, *words: str) -> str:
        """Run a program of the environment in its folder; its output."""
        program, *rest = words
        done = subprocess.run(
            [self.python.with_name(program), *rest], cwd=self.folder, text=True,
            capture_output=True, env={**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": ""},
        )  # fmt: skip
        assert not done.returncode, f"{' '.join(words)}: {done.stderr[-2000:]}"
        return done.stdout

    def size(self) -> tuple[float, int]:
        """Return MB in its site-packages, and how many packages there are beside ours."""
        (packages,) = self.folder.glob("env/lib/python*/site-packages")
        files = [file for file in packages.rglob("*") if file.is_file()]
        count = len(list(packages.glob("*.dist-info"))) - 1
        return sum(file.stat().st_size for file in files) / 1e6, count


def draws(made: Environment) -> None:
    """Import what was compiled, and run the README's script."""
    where = made.call("python", "-c", "import wideberth; print(wideberth.__file__)")
    assert Path(where.strip()).is_relative_to(made.folder.resolve()), where
    for module in ("framework.programs._evaluator", "solvers.riccati._core"):
        made.call("python", "-c", f"import wideberth.{module}")
    (script,) = blocks("README.md", "python")
    made.call("python", "-c", script)
    assert (made.folder / "plan.png").stat().st_size > 10_000


def tried(made: Environment) -> None:
    """Run the README's script, a study, and checks of the examples."""
    draws(made)
    made.call("wideberth", "run", "crossing", "--quick")
    assert list(made.folder.glob("results/crossing-quick/figures/*.png"))
    for room, target in EXAMPLES.items():
        module = target.split(":")[0]
        shutil.copy(ROOT / "examples" / f"{module}.py", made.folder)
        made.call("wideberth", "check", room, *shlex.split(target))


def extended(made: Environment, package: str) -> None:
    """Run the commands that the README of a package beside the core shows."""
    text = (ROOT / "packages" / package / "README.md").read_text(encoding="utf-8")
    commands = re.findall(r"^wideberth .*", text, re.MULTILINE)
    assert commands, package
    for command in commands:
        made.call(*shlex.split(command))


def found(python: str) -> bool:
    """Tell whether this machine has a Python of that version."""
    command = [UV, "python", "find", "-q", "--no-python-downloads", python]
    return not subprocess.run(command, stdout=subprocess.DEVNULL).returncode


def main(dist: Path, pythons: Sequence[str]) -> None:
    """Try the wheel with every Python, and the source archive with the first."""
    (wheel,) = dist.resolve().glob("wideberth-*.whl")
    (archive,) = dist.resolve().glob("wideberth-*.tar.gz")
    here = ("--find-links", str(dist.resolve()))
    missing = [one for one in pythons if not found(one)]
    assert not missing, f"no Python {', '.join(missing)} here"
    with tempfile.TemporaryDirectory() as name:
        for k, python in enumerate(pythons):
            begin = perf_counter()
            core = Environment.made(Path(name) / f"core{k}", python, str(wheel))
            size, count = core.size()
            tried(core)
            words = f"{core.call('python', '--version').strip()}: {size:.0f} MB, {count} packages"
            print(words, end="; ", flush=True)
            whole = Environment.made(Path(name) / f"all{k}", python, *here, f"{wheel}[all]")
            tried(whole)
            print("with all extras {:.0f} MB, {} packages".format(*whole.size()), end="; ")
            print(f"{perf_counter() - begin:.0f} s")
            if not k:
                core.install("--no-deps", "--reinstall", str(archive))
                draws(core)
                for package in BESIDE:
                    words = (*here, f"{wheel}[{package}]")
                    extended(Environment.made(Path(name) / package, python, *words), package)
        assert not typed_scripts.check(whole.python), "scripts have errors of types"
        if os.environ.get("COMMANDS"):
            assert not page_commands.run(whole.python, Path(name) / "pages"), (
                "commands of pages fail"
            )
    print(f"{wheel.name} and {archive.name} work in fresh environments")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or [sys.executable])
