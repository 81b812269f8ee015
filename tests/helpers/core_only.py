"""What the core depends on, and Python as it is where nothing else is installed."""

import os
import subprocess
import sys
import tomllib
from importlib.metadata import distribution, packages_distributions
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
DEPENDENCIES: list[str] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))[
    "project"
]["dependencies"]

BLOCK = """
import importlib.metadata
import sys

BLOCKED = {blocked!r}
importlib.metadata.entry_points = lambda **_: importlib.metadata.EntryPoints()


class Finder:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BLOCKED:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)


sys.meta_path.insert(0, Finder())
"""


def core() -> set[str]:
    """Return the names of the distributions that the core's dependencies bring, all together."""
    found, waiting = set[str](), [Requirement(one) for one in DEPENDENCIES]
    while waiting:
        requirement = waiting.pop()
        name = canonicalize_name(requirement.name)
        if name in found or (requirement.marker and not requirement.marker.evaluate()):
            continue
        found.add(name)
        for line in distribution(name).requires or ():
            further = Requirement(line)
            extras = {"": "", **dict.fromkeys(requirement.extras, "")}
            if further.marker is None or any(
                further.marker.evaluate({"extra": extra}) for extra in extras
            ):
                further.marker = None
                waiting.append(further)
    return found


def beyond_the_core() -> list[str]:
    """Return the modules of what is installed and the core does not bring."""
    own = core() | {"wideberth"}
    return sorted(
        module
        for module, owners in packages_distributions().items()
        if not any(canonicalize_name(owner) in own for owner in owners)
    )


def python(folder: Path, script: str, *words: str) -> "subprocess.CompletedProcess[str]":
    """Run a script in a folder, where nothing but the core can be imported."""
    return subprocess.run(
        [sys.executable, "-c", BLOCK.format(blocked=beyond_the_core()) + script, *words],
        cwd=folder, capture_output=True, text=True,
        env={**os.environ, "MPLBACKEND": "Agg", "COLUMNS": "300"},
    )  # fmt: skip


def wideberth(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    """Run a command of the command line there."""
    script = "from wideberth.experiments.cli.app import main\nmain(sys.argv[1:])"
    return python(folder, script, *words)
