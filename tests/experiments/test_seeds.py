"""Every study that has seeds begins them where it is asked to."""

import dataclasses
from functools import cache
from typing import Any

import pytest

from wideberth.experiments.engine.shipped_configs import read_experiment, shipped
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.values.errors import WideberthError

FIRST, COUNT = 40, 3


def fields(name: str) -> set[str]:
    return {entry.name for entry in dataclasses.fields(load("experiments", name))}


SEEDED = {name for name in names("experiments") if "seeds" in fields(name)}


@cache
def configs() -> dict[type[Any], str]:
    """Return study -> the first shipped config of it."""
    found: dict[type[Any], str] = {}
    for name in shipped():
        experiment, _ = read_experiment(name, [])
        found.setdefault(type(experiment), name)
    return found


def test_the_key_is_known_to_all_that_have_seeds() -> None:
    assert {name for name in names("experiments") if "first_seed" in fields(name)} == SEEDED
    assert len(SEEDED) >= 10


@pytest.mark.parametrize("study", sorted(SEEDED))
def test_the_seeds_begin_there(study: str) -> None:
    kind = load("experiments", study)
    name = configs()[kind]
    asked = [f"first_seed={FIRST}", f"seeds={COUNT}"]
    if "show" in {entry.name for entry in dataclasses.fields(kind)}:
        asked.append(f"show=[{FIRST}]")
    experiment: Any
    experiment, _ = read_experiment(name, asked)
    assert isinstance(experiment, kind)
    played = {task.seed + k for task in experiment.tasks()
              for k in range(task.settings.get("seeds", 1))}  # fmt: skip
    assert played == set(range(FIRST, FIRST + COUNT))
    fewer = {task.seed for task in experiment.quick().tasks()}
    assert min(fewer) == FIRST and fewer <= played
    with pytest.raises(WideberthError, match=r"first_seed is -1"):
        read_experiment(name, ["first_seed=-1"])


@pytest.mark.parametrize("name", ["cascade_crossing", "crossing"])
def test_a_figure_of_a_seed_that_is_not_played_is_refused(name: str) -> None:
    with pytest.raises(WideberthError, match=r"show is \[0\]; wanted .* as in show=\[40\]"):
        read_experiment(name, [f"first_seed={FIRST}"])
