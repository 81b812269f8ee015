"""Results hang on the files that scenarios read, in every experiment that has scenarios."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, final, get_args, get_type_hints

import numpy as np
import pytest

from wideberth.experiments.engine.runner import run
from wideberth.experiments.engine.shipped_configs import config_path, read_experiment, shipped
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.plugins.yamlfile import read_config
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path as Way
from wideberth.simulation.scenarios.base import Placement, Scenario


@final
@dataclass(frozen=True)
class Reads(Scenario):
    """Hangs on a file."""

    file: str = ""

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        return (Placement("robot", Way(np.array([[0.0, 0.0], [5.0, 0.0]])), 0.5),)

    def inputs(self) -> tuple[Path, ...]:
        return (Path(self.file),)


def scenario_field(name: str) -> str | None:
    """Name of the field with one scenario or several; None where there is none."""
    hints: dict[str, Any] = get_type_hints(load("experiments", name))
    found = [key for key, hint in hints.items() if Scenario in (hint, *get_args(hint))]
    return found[0] if found else None


WITH = {name: field for name in names("experiments") if (field := scenario_field(name))}


@cache
def configs() -> dict[str, str]:
    """A shipped config of each study."""
    return {read_config(config_path(one))["type"]: one for one in shipped()}


def test_all_are_found() -> None:
    assert len(WITH) >= 7 and set(WITH.values()) == {"scenario", "scenarios"}


@pytest.mark.parametrize("name", WITH)
def test_what_scenarios_read_is_an_input(name: str) -> None:
    experiment: Any = read_experiment(configs()[name], [])[0]
    assert list(experiment.inputs()) == []  # what is shipped is part of the source
    if WITH[name] == "scenario":
        changed = replace(experiment, scenario=Reads("a.txt"))
        assert list(changed.inputs()) == [Path("a.txt")]
    else:
        changed = replace(experiment, scenarios={"one": Reads("a.txt"), "two": Reads("b.txt")})
        assert list(changed.inputs()) == [Path("a.txt"), Path("b.txt")]


def test_a_result_of_another_recording_is_not_continued(tmp_path: Path) -> None:
    """The folder of a run with one recording is refused to a run with another."""
    file = tmp_path / "tracks.txt"
    file.write_text("".join(f"{frame} 1 {frame} 50\n" for frame in range(0, 100, 10)))
    scene = f"type: recorded_scene, start: [0, 0, 0], goal: [1, 0], rows: [0], tracks: {file}"
    overrides = [f"scenarios={{x: {{{scene}}}}}", "robot.radius=0.4", "settings.time_limit=1.0"]
    experiment = read_experiment("dynamic_matters", [*overrides, "predictors={s: static}"])[0]
    run(experiment, tmp_path / "out", quick=True)
    file.write_text(file.read_text() + "100 1 100 50\n")
    with pytest.raises(WideberthError, match="other source code or data"):
        run(experiment, tmp_path / "out", quick=True)
