"""Studies call their seeds alike, and every shown seed is one of the run."""

from dataclasses import fields
from pathlib import Path

import pytest

from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.studies.grid import reduced, shown_of_fewer
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.values.errors import WideberthError

REPLAY = {
    "type": "replay",
    "robot": "unicycle",
    "planners": {"one": {"type": "pure_pursuit", "robot": "unicycle", "reference_speed": 0.7}},
    "settings": {"time_limit": 2.0, "history": 0.0},
    "seeds": 2,
    "first_seed": 3,
}


def test_studies_call_their_seeds_alike() -> None:
    for name in names("experiments"):
        kind = load("experiments", name)
        known = {field.name: field.type for field in fields(kind)}
        assert "episodes" not in known and not ("seeds" in known and "seed" in known), name
        assert known.get("show", tuple[int, ...]) == tuple[int, ...], name


def test_every_shown_seed_is_drawn(tmp_path: Path) -> None:
    run(build("experiments", {**REPLAY, "show": [3, 4]}), tmp_path / "out")
    drawn = {path.stem for path in draw(tmp_path / "out")}
    assert drawn == {"comparison", "run_one_3", "run_one_4", "animation_one_3"}


def test_less_of_other_fields_keeps_what_is_shown() -> None:
    study = build("experiments", {**REPLAY, "show": [3, 4]})
    assert reduced(study, planners=1).show == (3, 4)
    assert reduced(study, planners=1, seeds=1).show == (3,)


def test_what_may_be_shown() -> None:
    study = build("experiments", {**REPLAY, "show": [3]})
    study.check_shown(())
    study.check_shown((4, 3))
    with pytest.raises(WideberthError, match=r"show is \[5\]; wanted seeds in \[3, 5\), as in"):
        study.check_shown((5,))
    with pytest.raises(WideberthError, match="each seed once"):
        study.check_shown((3, 3))
    assert shown_of_fewer((4, 3), 3, 1) == (3,)
    assert shown_of_fewer((4,), 3, 1) == (3,)
    assert shown_of_fewer((), 3, 1) == ()
    assert study.figure_name("a", 3, (3,)) == "a" and study.figure_name("a", 3, (3, 4)) == "a_3"
