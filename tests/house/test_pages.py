"""Every code block of a page runs, builds, or is understood by the command line.

Blocks of Python run page by page; those of "write your own" in test_readme.py. Blocks of YAML are
built. The command line itself parses each command of a shell block, and the config that it names
is read with its ``--set``.
"""

import re
import shlex
import shutil
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from wideberth import build, save_plugin
from wideberth.controllers.diagnosis.solve_record import Record
from wideberth.experiments.cli.app import app
from wideberth.experiments.cli.extending import commands
from wideberth.experiments.engine.shipped_configs import config_path, read_experiment
from wideberth.framework.mpc.planner.rungs import Fallback
from wideberth.framework.plugins import registry
from wideberth.framework.plugins.yamlfile import parse, read_config
from wideberth.tests.helpers import nav2_params
from wideberth.tests.house.test_imports import BESIDE

ROOT = Path(__file__).resolve().parents[2]
FILES = [
    ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "packages").glob("*/docs/*.md")), *sorted((ROOT / "packages").glob("*/*.md")),
]  # fmt: skip
PAGES = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in FILES}
TESTED_ELSEWHERE = {"README.md", "docs/write-your-own.md"}  # test_readme.py
NOT_RUN = {"docs/cluster.md"}  # needs SLURM and dask_jobqueue; it is compiled
PLANNER = """
from wideberth import Observation, Path, recommended
planner = recommended("unicycle", predictor="kalman", level="fixed", solver="fatrop")
planner.set_path(Path([(0, 0), (12, 0)]))
observation = Observation(0.0, (0, 0.2, 0, 0.5, 0))
planner.command(observation)
solve = planner.explain()
problem, parameters, guesses = solve.problem(), [solve.parameters], [solve.guesses[0]]
"""
RESULT = """
from pathlib import Path
from wideberth.experiments.engine.runner import run
from wideberth.experiments.engine.shipped_configs import read_experiment
short = ["seeds=1", "settings.time_limit=0.5", "planners.default.solver=fatrop"]
run(read_experiment("crossing", short)[0], Path("results/crossing"))
"""
RECORDINGS = """
from wideberth import Tracks
recordings: list[Tracks] = []
"""
BEFORE = {
    "docs/solving.md": PLANNER, "docs/results.md": RESULT, "docs/write-your-own.md": RECORDINGS,
}  # fmt: skip
"""What a page speaks of without showing it."""


def blocks(page: str, *languages: str) -> list[str]:
    """Return the blocks of a page in these languages."""
    found = re.findall(r"^( *)```(\w+)\n(.*?)^ *```$", PAGES[page], re.DOTALL | re.MULTILINE)
    return [
        re.sub(rf"^{indent}", "", text, flags=re.MULTILINE)
        for indent, language, text in found
        if language in languages
    ]


def having(*languages: str) -> list[str]:
    return [page for page in PAGES if blocks(page, *languages)]


def test_blocks_are_in_languages_that_are_checked() -> None:
    known = {"python", "sh", "bash", "yaml", "text", "toml"}
    known |= {"c"}  # of docs/export.md, run by tests/solvers/test_export_solver.py
    for page, text in PAGES.items():
        for language in re.findall(r"^ *```(\S+)$", text, re.MULTILINE):
            assert language in known or language.startswith("{"), f"{page}: {language}"


@pytest.mark.parametrize("page", sorted(set(having("python")) - TESTED_ELSEWHERE))
def test_python_on_a_page_runs(page: str, folder: Path) -> None:
    needed = {"docs/gymnasium.md": "gymnasium", "docs/results.md": "pandas"}
    needed |= {"docs/physics.md": "mujoco", "packages/ros/docs/ros.md": "rosbags"}
    needed |= {"docs/recordings.md": "pyarrow"}
    if library := needed.get(page):
        pytest.importorskip(library)
    script = "\n".join([BEFORE.get(page, ""), *blocks(page, "python")])
    code = compile(script, page, "exec")
    if page not in NOT_RUN:
        exec(code, {"__name__": "page"})


ROOMS = {
    "planners": "controllers", "controllers": "controllers", "planner": "controllers",
    "predictor": "predictors", "scenario": "scenarios",
}  # fmt: skip


@pytest.mark.parametrize("page", having("yaml"))
def test_yaml_on_a_page_builds(page: str, folder: Path) -> None:
    for block in blocks(page, "yaml"):
        if "plugins:" in block:
            continue  # test_readme.py runs it
        robot = "&robot {type: holonomic_velocity}" if "policy" in block else "&robot unicycle"
        config = parse(f"robot: {robot}\n{block}", page)  # plain YAML knows no `<<: recommended`
        for key, value in config.items():
            if key in ("planners", "controllers"):
                for one in value.values():
                    build(ROOMS[key], one)
            elif key in ROOMS:
                build(ROOMS[key], value)
            elif key == "fallback":
                assert len(Fallback(**value).ladder) == len(value["rungs"])
            elif key in ("cascades", "cases"):
                own = read_config(config_path("perception_faults"))
                build("experiments", {**own, "cases": {}, key: value})
            elif key == "factors":
                tuned = {"planner": config["planner"], "robot": "unicycle", key: value}
                build("experiments", {**read_config(config_path("tuning")), **tuned})
            elif key == "record":
                Record(**value)
            else:
                assert key == "robot", f"{page}: {key}"


@pytest.mark.parametrize("page", having("sh", "bash"))
def test_commands_on_a_page_are_understood(page: str, folder: Path) -> None:
    for block in blocks(page, "sh", "bash"):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line.replace("$scene", "eth"), comments=True)
            if words and words[0] not in ("for", "done"):
                understood(words)


def understood(words: list[str]) -> None:
    """Check one command of a shell block."""
    if words[0] == "wideberth":
        wideberth(words[1:])
    elif words[0] == "make" and words[1] != "-C":
        targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
        assert words[1] in [*targets, *(f"test-{name}" for name in BESIDE)], words
    elif words[0] == "pip":
        for folder, extra in re.findall(r"(\S*)\[([\w,-]+)\]", " ".join(words)):
            place = f"packages/{folder.partition('packages/')[2]}" if "packages/" in folder else ""
            project = tomllib.loads((ROOT / place / "pyproject.toml").read_text())["project"]
            assert set(extra.split(",")) <= set(project["optional-dependencies"]), words
    elif words[0].startswith(("python", ".")) and (scripts := scripts_of(words)):
        assert all((ROOT / script).is_file() for script in scripts), words
    else:
        known = ("make", "dask", "openssl", "git", "cd", ".", "TLS=", "export DASK_", "cc",
                 "source", "python3 -m")  # fmt: skip
        assert " ".join(words).startswith(known), f"{words[0]}: check it here"


def scripts_of(words: list[str]) -> list[str]:
    return [word for word in words if word.endswith((".py", "/run"))]


def wideberth(words: list[str]) -> None:
    """Let the command line parse a command, and read the config that it names."""
    command = commands(app)[words[0]]
    given = command.make_context(words[0], words[1:]).params
    if "config" in given:
        read_experiment(given["config"], list(given.get("set_") or []))
    if words[0] == "new":
        app(words, standalone_mode=False)  # a later line runs what it writes
    if words[0] == "check":
        registry.load(given["room"], given["target"])
    if words[0] == "list" and given.get("room") not in (None, "configs"):
        assert registry.names(given["room"])


def provide(folder: Path) -> None:
    """Write what pages speak of: recordings, own modules, saved plug-ins."""
    people = ROOT / "experiments" / "data" / "plaza.txt"
    places = ["people.txt", "recordings/a.txt", "recordings/b.txt"]
    for place in (*places, "FOLDER/people.txt", "FOLDER/hotel.txt", "FOLDER/people.csv"):
        (folder / place).parent.mkdir(exist_ok=True)
        shutil.copy(people, folder / place)
    for name in ("people", "walkers", "mine"):
        save_plugin(folder / f"{name}.json", "predictor", build("predictors", "kalman"))
    for name in ("my_region", "my_rung"):
        shutil.copy(ROOT / "examples" / f"{name}.py", folder)
    (folder / "nav2_params.yaml").write_text(nav2_params.text_of("nav2_humble"))
    (folder / "mypackage").mkdir()
    own = "from my_region import Disc as Box\n"
    (folder / "mypackage" / "__init__.py").write_text(own)
    (folder / "my_package.py").write_text("def act(seen): ...\n")
    written = blocks("docs/write-your-own.md", "python")
    body = "\n        return build('predictors', 'kalman').predict(tracks, steps, scene)"
    module = "from wideberth import build\n" + written[0].replace(" ...", body, 1)
    module += "".join(one for one in written if "class Gentle(" in one)
    module += "from wideberth.framework.mpc.planner.rungs import FallbackRung\n"
    module += "class SlowDown(FallbackRung):\n    name = 'slow down'\n"
    module += "    def attempt(self, trial): ...\n"
    (folder / "mypackage" / "module.py").write_text(module)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Work in a folder that holds what pages speak of, and forget what runs there registers."""
    provide(tmp_path)
    kept = {room: dict(registry._registered[room]) for room in registry.ROOMS}
    monkeypatch.setattr(registry, "_registered", kept)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if name.split(".")[0] in ("mypackage", "my_package", "my_region", "my_rung"):
            del sys.modules[name]
