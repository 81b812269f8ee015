"""What only the first episode would show is said before the work, and before a folder is made."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Self, final

import numpy as np
import pytest

from wideberth.experiments.cli import app as cli
from wideberth.experiments.engine.base import Experiment, Result, Row, Task, TaskOutcome
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment, shipped
from wideberth.experiments.studies.comparison import Comparison
from wideberth.experiments.studies.planner_parts import PlannerParts
from wideberth.experiments.studies.tuning import Tuning
from wideberth.framework.plugins.config import build
from wideberth.framework.values.errors import WideberthError
from wideberth.simulation.scenarios.base import Placement, Scenario

NO_ROOM = "no situation can be drawn: in 10000 draws there was no room for person"
CROWD = "{type: crowdnav, humans: 60, robot_radius: 0.75}"


@pytest.mark.parametrize(
    ("config", "override", "message"),
    [
        ("crowdnav", f"scenarios={{x: {CROWD}}}", f"scenarios.x, seed 0: {NO_ROOM}"),
        ("crossing", f"scenario={CROWD}", f"scenario, seed 0: {NO_ROOM}"),
        (
            "tuning",
            "planner.static_region=null;scenario={type: doorway, robot_radius: 0.75}",
            "of base can begin: .*static_region",
        ),
        ("corridor", "controllers.ours.static_region=null", "episode of ours .*static_region"),
        ("dynamic_matters", f"scenarios={{x: {CROWD}}}", NO_ROOM),
        ("conservativeness", f"scenarios={{x: {CROWD}}}", NO_ROOM),
        ("cost_comparison", f"scenarios={{x: {CROWD}}}", NO_ROOM),
        ("level_policies", f"scenarios={{x: {CROWD}}}", NO_ROOM),
        ("region_price", f"scenarios={{x: {CROWD}}}", NO_ROOM),
        ("flight", "scenarios={x: {type: crossing}}", "has 2 coordinates; its robot moves in 3"),
        (
            "recorded_scene",
            "scenarios={x: {type: recorded_scene, scene: eth, tracks: nowhere.txt}}",
            "^recorded_scene.tracks: nowhere.txt is no file; give the recording, or the folder",
        ),
        (
            "recorded_scene",
            "scenarios.recorded.rows=[10, 5000]",
            "scenarios.recorded, seed 0: .*rows holds 5000, and shipped:plaza.txt has rows 0 to",
        ),
    ],
)
def test_an_episode_that_cannot_begin(
    config: str, override: str, message: str, tmp_path: Path
) -> None:
    if config in ("crowdnav", "corridor") or CROWD in override:
        pytest.importorskip("pyrvo")
    experiment, _ = read_experiment(config, override.split(";"))
    with pytest.raises(WideberthError, match=message):
        run(experiment, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_first_seed_is_looked_at() -> None:
    experiment, _ = read_experiment("sudden_change", [])
    assert isinstance(experiment, Comparison)

    @final
    @dataclass(frozen=True)
    class Torn(Scenario):
        """Fails at one seed."""

        def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
            raise ZeroDivisionError("by a plug-in")

    settings = {"scenarios": {"torn": Torn()}, "robots": experiment.robots, "first_seed": 7}
    torn = Comparison(controllers=experiment.controllers, show=(), **settings)  # type: ignore[arg-type]
    with pytest.raises(WideberthError, match=r"torn, seed 7: .*ZeroDivisionError: by a plug-in"):
        torn.check()


@pytest.mark.parametrize("name", shipped())
def test_quick_settings_are_not_cut_short(name: str) -> None:
    """Nobody would have arrived, and the tables would say nothing."""
    experiment, _ = read_experiment(name, [])
    small = experiment.quick()
    if isinstance(experiment, Comparison) and isinstance(small, Comparison):
        (label, settings), *_ = experiment.settings.items()
        assert small.settings == {label: settings}
    for kind in (Tuning, PlannerParts):
        if isinstance(experiment, kind) and isinstance(small, kind):
            assert small.settings == experiment.settings


def test_a_quick_comparison_shows_arrivals(tmp_path: Path) -> None:
    pytest.importorskip("pyrvo")
    experiment, _ = read_experiment("sudden_change", [])
    assert isinstance(experiment, Comparison)
    rivals = {name: experiment.controllers[name] for name in ("orca", "constant_velocity")}
    small = replace(experiment, controllers=rivals, baseline="")
    result = run(small, tmp_path / "out", quick=True)
    arrived = {row["controller"]: row["success"] for row in result.rows}
    assert arrived == {"orca": True, "constant_velocity": False}


@final
@dataclass(frozen=True)
class Rude(Experiment):
    """Fails where it is told to."""

    claim: ClassVar[str] = "Nothing."
    where: str = ""

    def __post_init__(self) -> None:
        self._fail("init")

    def _fail(self, where: str) -> None:
        if self.where == where:
            raise ZeroDivisionError(f"rude in {where}")
        if self.where == f"exit in {where}":
            raise SystemExit(3)

    def tasks(self) -> list[Task]:
        self._fail("tasks")
        return [Task("first"), Task("second", 1)]

    def inputs(self) -> tuple[Path, ...]:
        self._fail("inputs")
        return ()

    def check(self) -> None:
        self._fail("check")

    def measure(self, task: Task) -> TaskOutcome:
        if task.seed:
            self._fail("measure")
        rows: list[Row] = [{"one": object() if self.where == "cell" else 1}]
        return rows if self.where == "rows" else TaskOutcome(rows)  # type: ignore[return-value]

    def summary(self, rows: list[Row]) -> list[Row]:
        self._fail("summary")
        return rows

    def figures(self, result: Result, folder: Path) -> list[Path]:
        self._fail("figures")
        return []

    def quick(self) -> Self:
        self._fail("quick")
        return self


@pytest.mark.parametrize(
    "where", ["quick", "tasks", "inputs", "check", "exit in check", "exit in tasks"]
)
def test_a_plug_in_that_fails_before_the_work(where: str, tmp_path: Path) -> None:
    message = "SystemExit: 3" if "exit" in where else f"ZeroDivisionError: rude in {where}"
    with pytest.raises(WideberthError, match=rf"^{message} \(.*test_before_the_work\.py, line"):
        run(Rude(where), tmp_path / "out", quick=True)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ("measure", r"task 'second': ZeroDivisionError.*; 1 of 2 tasks are done and kept"),
        ("exit in measure", r"task 'second': SystemExit: 3.*; 1 of 2 tasks are done and kept"),
        ("summary", r"ZeroDivisionError: rude in summary.*; 2 of 2 tasks are done and kept"),
        ("cell", r"task 'first': column 'one' holds object"),
        ("rows", r"task 'first': measure returned \[\{'one': 1\}\]; wanted TaskOutcome\(rows="),
    ],
)
def test_a_plug_in_that_fails_at_work(where: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(WideberthError, match=message):
        run(Rude(where), tmp_path / "out")


def test_figures_that_fail_leave_the_result(tmp_path: Path) -> None:
    run(Rude("figures"), tmp_path / "out")
    with pytest.raises(WideberthError, match=r"is complete, its figures cannot be drawn: Zero"):
        draw(tmp_path / "out")
    assert (tmp_path / "out" / "table.csv").is_file()


def test_a_plug_in_that_cannot_be_made() -> None:
    with pytest.raises(WideberthError, match=r"Rude cannot be made \(ZeroDivisionError: rude in"):
        build("experiments", {"type": f"{__name__}:Rude", "where": "init"})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: ["explain", str(path)], "is no recorded solve"),
        (lambda path: ["play", str(path)], r"not a saved episode \(it is no npz archive\)"),
        (lambda path: ["figures", str(path.parent)], "holds no result"),
        (lambda path: ["run", ""], "is a folder"),
        (
            lambda path: ["run", "crossing", "--set", "settngs.a=1", "--set", "plugins=3"],
            "plugins is 3; wanted a list",
        ),
        (lambda path: ["run", "crossing", "--set", "plugins=0"], "plugins is 0; wanted a list"),
        (lambda path: ["run", "crossing", "--set", "plugins={}"], "plugins is {}; wanted a list"),
        (
            lambda path: ["run", "crowdnav", "--set", "settings.crowdnvav.time_limit=5"],
            "did you mean 'crowdnav'.*to add one, give it whole: settings.crowdnvav=",
        ),
        (
            lambda path: ["run", "tuning", "--set", "factors.level.weight.0=1"],
            "unknown name 'level'.*names with dots are changed in a file or all at once: factors=",
        ),
    ],
)
def test_one_message_from_the_shell(
    make: Callable[[Path], list[str]],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = tmp_path / "notes.yaml"
    file.write_text("type: nothing\n")
    with pytest.raises(SystemExit) as stop:
        cli.main(make(file))
    error = capsys.readouterr().err
    assert stop.value.code == 2
    with pytest.raises(WideberthError, match=message):
        raise WideberthError(error.strip())
    assert error.startswith("Error: ") and error.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "robot: unicycle",
            r"^key 'scenario' is missing; .*; wanted one of: .*cross",
        ),
        (
            "scenarioo: crossing",
            r"unknown key 'scenarioo': did you mean 'scenario'\? Known: first_seed",
        ),
        (
            "scenario: crossing\nrobot: unicycle",
            r"^key 'planners' is missing.* each of the controllers, .*: .*orca",
        ),
    ],
)
def test_a_config_without_a_key_is_told_what_may_stand_there(
    tmp_path: Path, text: str, message: str
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(f"type: encounter\n{text}\n")
    with pytest.raises(WideberthError, match=message):
        read_experiment(str(file), [])
