"""The README's first script runs as it stands there, and draws its picture."""

import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

import pytest

from wideberth.framework.plugins import registry
from wideberth.tests.house.test_imports import CORE
from wideberth.tests.house.test_pages import FILES

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
RunPage = Callable[[str, str, str], None]
SCRIPTS = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)


@pytest.fixture
def run_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RunPage]:
    """Run the blocks from the one that defines a class to that of another, and a check.

    They are a module `page`, which is forgotten afterwards, and so is what it registers.
    """
    monkeypatch.setattr(registry, "_registered", {room: {} for room in registry.ROOMS})
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)

    def run(first: str, last: str, check: str) -> None:
        script = "\n".join([*blocks_of(first, last), check])
        (tmp_path / "page.py").write_text(script, encoding="utf-8")
        import_module("page")

    yield run
    sys.modules.pop("page", None)


def blocks_of(first: str, last: str) -> list[str]:
    page = (ROOT / "docs" / "write-your-own.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    ends = [
        next(i for i, block in enumerate(blocks) if f"class {name}(" in block)
        for name in (first, last)
    ]
    return blocks[ends[0] : ends[1] + 1]


def test_first_script_draws_a_picture(tmp_path: Path) -> None:
    script = SCRIPTS[0]
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", script], cwd=tmp_path, text=True,
        capture_output=True, env={**os.environ, "MPLBACKEND": "Agg"}, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    lines = done.stderr.splitlines()
    assert [one for one in lines if not one.startswith("compiling wideberth.")] == []  # no warning
    (picture,) = tmp_path.glob("*.png")
    assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 10_000


def test_predictors_that_learn_are_written_as_the_page_says(run_page: RunPage) -> None:
    """The blocks that define `Straying`, `Widened`, `Resting`; the contract check runs on all."""
    check = "from wideberth.framework.testing import check_predictor\n"
    check += "for one in (Straying(), Widened(), Resting()):\n    check_predictor(one)\n"
    run_page("Straying", "Resting", check)


def test_a_scenario_is_written_as_the_page_says(run_page: RunPage) -> None:
    """The block that defines `Gate`; the contract check runs on it, and it refuses narrow ways."""
    check = "from wideberth.framework.testing import check_scenario\n"
    check += "check_scenario(Gate())\nassert len(Gate().cast(3).bystanders) == 1\n"
    check += "try:\n    Gate(width=0.8)\nexcept WideberthError:\n    pass\n"
    check += "else:\n    raise SystemExit('a narrow gate')\n"
    run_page("Gate", "Gate", check)


def test_a_level_policy_is_written_as_the_page_says(run_page: RunPage) -> None:
    check = "from wideberth.framework.testing import check_level\ncheck_level(TwoStage())\n"
    run_page("TwoStage", "TwoStage", check)


def test_a_wrapper_of_a_controller_is_written_as_the_page_says(run_page: RunPage) -> None:
    """`Gentle` keeps the laws, and drives at half the speed of what it wraps."""
    check = """
from wideberth import Observation, Path, build
from wideberth.framework.testing import check_controller

settings = {"type": "constant_velocity", "robot": "holonomic_velocity", "period": 0.25}
gentle = build("controllers", {"type": "gentle", "controller": settings})
check_controller(gentle)
plain = build("controllers", settings)
seen = Observation(0.0, (0, 0))
for one in (gentle, plain):
    one.set_path(Path([(0, 0), (12, 0)]))
halved = tuple(0.5 * part for part in plain.command(seen).linear)
assert gentle.command(seen).linear == halved != (0.0, 0.0)
"""
    run_page("Gentle", "Gentle", check)


def test_a_route_planner_is_written_as_the_page_says(run_page: RunPage) -> None:
    check = "from wideberth.framework.testing import check_route_planner\n"
    check += "check_route_planner(StraightOn())\n"
    run_page("StraightOn", "StraightOn", check)


def test_a_cost_is_written_as_the_page_says(run_page: RunPage) -> None:
    check = "from wideberth.framework.testing import check_cost\ncheck_cost(Steady())\n"
    run_page("Steady", "Steady", check)


def test_a_solver_is_written_as_the_page_says(run_page: RunPage) -> None:
    """The block that defines `AdaptiveIpopt`; a planner reaches its first rung with it."""
    check = """
from wideberth import Observation, Path, build

planner = build("controllers", {"type": "mpc", "robot": "unicycle", "predictor": "kalman",
    "region": "mahalanobis_ellipse", "level": "fixed", "solver": {"type": "adaptive_ipopt"}})
planner.set_path(Path([(0, 0), (12, 0)]))
planner.command(Observation(0.0, (0, 0.2, 0, 0.5, 0)))
assert planner.plan.rung == "optimal", planner.plan.reason
"""
    run_page("AdaptiveIpopt", "AdaptiveIpopt", check)


def test_a_rung_is_written_as_the_page_says(run_page: RunPage) -> None:
    """The block that defines `SlowDown`; it holds where the solver fails and the road is free."""
    check = """
from wideberth import Observation, Path, build
from wideberth.framework.mpc.solver import Solver


class Unavailable(Solver):
    def solve(self, problem, parameters, guesses, deadline=None):
        raise RuntimeError("no licence")


planner = build("controllers", {"type": "mpc", "robot": "unicycle", "predictor": "static",
    "region": "mahalanobis_ellipse", "level": "fixed", "solver": Unavailable(),
    "fallback": {"rungs": ["optimal", "page:SlowDown", "brake"]}})
planner.set_path(Path([(0, 0), (12, 0)]))
planner.command(Observation(0.0, (0, 0, 0, 0.5, 0)))
assert planner.plan.rung == "slow down", planner.plan.reason
"""
    run_page("SlowDown", "SlowDown", check)


def test_a_slot_kind_is_written_as_the_page_says(run_page: RunPage) -> None:
    """The block that defines `Fronts`; a front that comes nearer pushes the robot ahead."""
    check = """
from wideberth import Observation, Path, build
from wideberth.framework.testing import check_slot_kind

check_slot_kind(Fronts(((0.0, -1.0, 0.0), (1.5, -1.5, 0.0))))
planner = build("controllers", {"type": "mpc", "robot": {"type": "unicycle", "radius": 0.4},
    "predictor": "static", "region": "mahalanobis_ellipse", "level": "fixed", "solver": "fatrop",
    "horizon": 8, "reference_speed": 0.2, "margin": 0.1, "latency": 0.1,
    "further_kinds": [{"type": "fronts", "fronts": [[0.0, -1.0, 0.4]]}]})
planner.set_path(Path([(0, 0), (12, 0)]))
planner.command(Observation(0.0, (0, 0, 0, 0.3, 0)))
assert planner.plan.rung == "optimal", planner.plan.reason
border = -1.0 + 0.4 * (0.1 + 0.5 * np.arange(1, 9))
gap = planner.plan.positions[1:, 0] - border - 0.5
assert gap.min() > -1e-6 and gap[-1] < 1e-2, gap
"""
    run_page("Fronts", "Fronts", check)


def test_a_scenario_is_played_from_the_config_on_the_page(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "write-your-own.md").read_text(encoding="utf-8")
    (config,) = re.findall(r"```yaml\n(plugins: \[my_scenario\].*?)```", page, re.DOTALL)
    (block,) = [
        one for one in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "Gate" in one
    ]
    (tmp_path / "gate.yaml").write_text(config, encoding="utf-8")
    (tmp_path / "my_scenario.py").write_text(block, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", "from wideberth.experiments.cli.app import main; main()",
         "run", "gate.yaml", "--out", "found", "--set", "seeds=1", "--set",
         "settings.time_limit=2"],
        cwd=tmp_path, text=True, capture_output=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    assert (tmp_path / "found" / "figures" / "run_ours.png").exists()


def test_a_study_is_written_as_the_page_says(tmp_path: Path) -> None:
    """The block that defines `AreaByTail` runs from the config on the page, with a figure."""
    page = (ROOT / "docs" / "write-your-own.md").read_text(encoding="utf-8")
    (config,) = [
        one for one in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL) if "my_study" in one
    ]
    (tmp_path / "area.yaml").write_text(config, encoding="utf-8")
    (block,) = [
        one for one in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "AreaByTail" in one
    ]
    (tmp_path / "my_study.py").write_text(block, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", "from wideberth.experiments.cli.app import main; main()",
         "run", "area.yaml", "--out", "found"],
        cwd=tmp_path, text=True, capture_output=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    table = (tmp_path / "found" / "table.csv").read_text(encoding="utf-8")
    assert len(table.splitlines()) == 6 and "area_m2" in table
    assert (tmp_path / "found" / "figures" / "area_by_tail.png").exists()


def test_links_lead_somewhere() -> None:
    for page in {*ROOT.glob("*.md"), *FILES}:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_files_and_modules_that_pages_name_exist() -> None:
    """Paths such as framework/region.py, and names such as wideberth.framework.testing."""
    rooms = "|".join(CORE)
    for page in FILES:
        text = page.read_text(encoding="utf-8")
        for name in re.findall(rf"`((?:{rooms}|benchmarks|examples|tests|docs)/[\w./-]*)`", text):
            made = name.startswith("docs/_build/")  # by `make docs`
            assert made or "NAME" in name or (ROOT / name).exists(), f"{page.name} names {name}"
        for name in re.findall(r"wideberth((?:\.\w+)+)", text):
            parts = name.strip(".").split(".")
            if parts[0] not in rooms.split("|"):
                continue
            found = [
                ROOT.joinpath(*parts[:n])
                for n in range(len(parts), 0, -1)
                if ROOT.joinpath(*parts[:n]).is_dir()
                or ROOT.joinpath(*parts[:n]).with_suffix(".py").is_file()
            ]
            assert found and len(found[0].relative_to(ROOT).parts) >= len(parts) - 1, (
                f"{page.name} names wideberth{name}"
            )


def test_the_table_of_extras_names_them_all() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = settings["project"]["optional-dependencies"]
    (table,) = re.findall(r"\| Extra \|.*?\n\n", TEXT, re.DOTALL)
    first = [line.split("|")[1] for line in table.strip().splitlines()[2:]]
    assert sorted(re.findall(r"`([\w-]+)`", " ".join(first))) == sorted(extras)
