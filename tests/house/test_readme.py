"""What README and "write your own" show runs as it stands there, and what pages name exists."""

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
from wideberth.tests.house.test_pages import FILES, PAGES, ROOT, blocks

RunPage = Callable[[str, str, str], None]
IMPORTS = (
    "from wideberth import Observation, Path, build\nfrom wideberth.framework.testing import *"
)
WRITTEN = {
    "Straying Resting": "for one in (Straying(), Widened(), Resting()):\n    check_predictor(one)",
    "Gate Gate": """
check_scenario(Gate())
assert len(Gate().cast(3).bystanders) == 1
try:
    Gate(width=0.8)
except WideberthError:
    pass
else:
    raise SystemExit("a narrow gate")
""",
    "TwoStage TwoStage": "check_level(TwoStage())",
    "Gentle Gentle": """
settings = {"type": "constant_velocity", "robot": "holonomic_velocity", "period": 0.25}
gentle = build("controllers", {"type": "gentle", "controller": settings})
check_controller(gentle)
plain = build("controllers", settings)
seen = Observation(0.0, (0, 0))
for one in (gentle, plain):
    one.set_path(Path([(0, 0), (12, 0)]))
halved = tuple(0.5 * part for part in plain.command(seen).linear)
assert gentle.command(seen).linear == halved != (0.0, 0.0)
""",
    "StraightOn StraightOn": "check_route_planner(StraightOn())",
    "Steady Steady": "check_cost(Steady())",
    "AdaptiveIpopt AdaptiveIpopt": """
planner = build("controllers", {"type": "mpc", "robot": "unicycle", "predictor": "kalman",
    "region": "mahalanobis_ellipse", "level": "fixed", "solver": {"type": "adaptive_ipopt"}})
planner.set_path(Path([(0, 0), (12, 0)]))
planner.command(Observation(0.0, (0, 0.2, 0, 0.5, 0)))
assert planner.plan.rung == "optimal", planner.plan.reason
""",
    "SlowDown SlowDown": """
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
""",
    "Fronts Fronts": """
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
""",
}
"""First and last class of some blocks -> what holds of them.

`Gentle` drives at half the speed of what it wraps, a planner reaches its first rung with
`AdaptiveIpopt`, `SlowDown` holds where the solver fails and the road is free, and one of `Fronts`
that comes nearer pushes the robot ahead.
"""


@pytest.fixture
def run_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RunPage]:
    """Run the blocks from the one that defines a class to that of another, and a check.

    They are a module `page`, which is forgotten afterwards, and so is what it registers.
    """
    monkeypatch.setattr(registry, "_registered", {room: {} for room in registry.ROOMS})
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)

    def run(first: str, last: str, check: str) -> None:
        parts = own_blocks("python")
        ends = [next(i for i, one in enumerate(parts) if f"class {name}(" in one)
                for name in (first, last)]  # fmt: skip
        script = "\n".join([*parts[ends[0] : ends[1] + 1], IMPORTS, check])
        (tmp_path / "page.py").write_text(script, encoding="utf-8")
        import_module("page")

    yield run
    sys.modules.pop("page", None)


def own_blocks(language: str) -> list[str]:
    return blocks("docs/write-your-own.md", language)


def program(
    words: list[str], folder: Path, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder; it has to succeed."""
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, text=True, capture_output=True, timeout=300,
        env={**os.environ, **environment},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return done


def test_first_script_draws_a_picture(tmp_path: Path) -> None:
    (script,) = blocks("README.md", "python")
    done = program(["-W", "error::UserWarning", "-c", script], tmp_path, MPLBACKEND="Agg")
    lines = done.stderr.splitlines()
    assert [one for one in lines if not one.startswith("compiling wideberth.")] == []  # no warning
    (picture,) = tmp_path.glob("*.png")
    assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 10_000


@pytest.mark.parametrize("ends", WRITTEN)
def test_a_plug_in_is_written_as_the_page_says(ends: str, run_page: RunPage) -> None:
    run_page(*ends.split(), WRITTEN[ends])


@pytest.mark.parametrize(
    ("module", "name", "overrides", "made"),
    [
        ("my_scenario", "Gate", ("seeds=1", "settings.time_limit=2"), "figures/run_ours.png"),
        ("my_study", "AreaByTail", (), "figures/area_by_tail.png"),
    ],
)
def test_a_plug_in_is_played_from_the_config_on_the_page(
    module: str, name: str, overrides: tuple[str, ...], made: str, tmp_path: Path
) -> None:
    (config,) = [one for one in own_blocks("yaml") if f"plugins: [{module}]" in one]
    (tmp_path / "own.yaml").write_text(config, encoding="utf-8")
    (block,) = [one for one in own_blocks("python") if name in one]
    (tmp_path / f"{module}.py").write_text(block, encoding="utf-8")
    main = "from wideberth.experiments.cli.app import main; main()"
    given = [word for one in overrides for word in ("--set", one)]
    program(["-c", main, "run", "own.yaml", "--out", "found", *given], tmp_path)
    assert (tmp_path / "found" / made).exists()
    if name == "AreaByTail":
        table = (tmp_path / "found" / "table.csv").read_text(encoding="utf-8")
        assert len(table.splitlines()) == 6 and "area_m2" in table


def test_links_lead_somewhere() -> None:
    for page in {*ROOT.glob("*.md"), *FILES}:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_files_that_pages_name_exist() -> None:
    """Paths such as framework/region.py."""
    rooms = "|".join(CORE)
    for page in FILES:
        text = page.read_text(encoding="utf-8")
        for name in re.findall(rf"`((?:{rooms}|benchmarks|examples|tests|docs)/[\w./-]*)`", text):
            made = name.startswith("docs/_build/")  # by `make docs`
            assert made or "NAME" in name or (ROOT / name).exists(), f"{page.name} names {name}"


def test_the_table_of_extras_names_them_all() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = settings["project"]["optional-dependencies"]
    (table,) = re.findall(r"\| Extra \|.*?\n\n", PAGES["README.md"], re.DOTALL)
    first = [line.split("|")[1] for line in table.strip().splitlines()[2:]]
    assert sorted(re.findall(r"`([\w-]+)`", " ".join(first))) == sorted(extras)
