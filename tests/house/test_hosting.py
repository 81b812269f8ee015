"""What runs where the repository is hosted: it calls make, and names what there is."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from wideberth.tests.house.test_packaging import ROOT, SETTINGS

HOSTED = ROOT / ".github"
WORKFLOWS = {path.stem: path for path in sorted((HOSTED / "workflows").glob("*.yml"))}
FILES = [*sorted(HOSTED.rglob("*.yml")), ROOT / ".readthedocs.yaml"]
FILES += [ROOT / ".pre-commit-config.yaml", ROOT / "CITATION.cff"]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
TARGETS = set(re.findall(r"^([a-z]+):", MAKEFILE, re.MULTILINE))
PINNED = re.compile(r"[\w-]+/[\w-]+@(v\d+(\.\d+\.\d+)?|release/v\d+)")
"""As `actions/checkout@v5`: a major version, or a whole one where there is no tag of that."""


def read(path: Path) -> Any:
    """Return the content of a YAML file; ``on`` is no truth value in a workflow."""
    return yaml.load(path.read_text(encoding="utf-8"), yaml.BaseLoader)


def jobs(name: str) -> dict[str, Any]:
    found: dict[str, Any] = read(WORKFLOWS[name])["jobs"]
    return found


def steps() -> list[dict[str, Any]]:
    """Return the steps of all workflows and of the action that they share."""
    found = [step for name in WORKFLOWS for job in jobs(name).values()
             for step in job.get("steps", [])]  # fmt: skip
    actions = [read(path) for path in sorted((HOSTED / "actions").rglob("action.yml"))]
    return [*found, *(step for action in actions for step in action["runs"]["steps"])]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_hosted_file_can_be_read(path: Path) -> None:
    assert isinstance(read(path), dict)


def test_workflows_may_only_read_and_call_make() -> None:
    assert set(WORKFLOWS) == {"docs", "lint", "release", "tests", "wheel"}
    assert all(read(path)["permissions"] == {"contents": "read"} for path in WORKFLOWS.values())
    called = [step["run"] for step in steps() if "run" in step]
    called += read(ROOT / ".readthedocs.yaml")["build"]["commands"]
    hooks = read(ROOT / ".pre-commit-config.yaml")["repos"]
    called += [hook["entry"] for repo in hooks for hook in repo["hooks"]]
    assert {command.split()[0] for command in called} == {"make"}
    assert {command.split()[1] for command in called} <= TARGETS
    given = {name for command in called for name in re.findall(r" (\w+)=", command)}
    assert given == {"PY", "BIN", "SITE"}
    assert all(re.search(rf"^{name} +(\?|:)?=", MAKEFILE, re.MULTILINE) for name in given)


def test_actions_of_others_are_pinned_and_ours_are_there() -> None:
    used = [step["uses"] for step in steps() if "uses" in step]
    ours = [action for action in used if action.startswith("./")]
    assert ours and all((ROOT / action / "action.yml").is_file() for action in ours)
    assert all(PINNED.fullmatch(action) for action in used if action not in ours)


@pytest.mark.parametrize("name", ["tests", "wheel"])
def test_workflows_run_the_pythons_that_the_metadata_names(name: str) -> None:
    classifiers = " ".join(SETTINGS["project"]["classifiers"])
    every = (job.get("strategy", {}).get("matrix", {}) for job in jobs(name).values())
    pythons = {version for matrix in every for version in matrix.get("python", [])}
    assert pythons == set(re.findall(r"Python :: (3\.\d+)", classifiers))


def test_systems_that_are_not_promised_may_fail() -> None:
    others = jobs("tests")["others"]
    assert others["continue-on-error"] == "true"
    systems = {entry["system"] for entry in others["strategy"]["matrix"]["include"]}
    assert systems == {"macos-latest", "windows-latest"}
    assert "continue-on-error" not in jobs("tests")["linux"]


def test_only_a_published_release_goes_to_the_index() -> None:
    release = read(WORKFLOWS["release"])
    assert release["on"] == {"release": {"types": ["published"]}}
    trusted = {name: job.get("permissions") for name, job in release["jobs"].items()}
    assert trusted == {"build": None, "publish": {"id-token": "write"}}
    assert release["jobs"]["build"]["uses"] == "./.github/workflows/wheel.yml"


def test_wheels_are_built_for_every_system_and_import_what_was_compiled() -> None:
    systems = jobs("wheel")["binaries"]["strategy"]["matrix"]["system"]
    kinds = {"ubuntu-latest", "ubuntu-24.04-arm", "macos-latest", "windows-latest"}
    assert kinds <= set(systems)
    tried = SETTINGS["tool"]["cibuildwheel"]["test-command"]
    assert "programs._evaluator" in tried and "riccati._core" in tried
