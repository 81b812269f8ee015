"""Old keys of configs: read from files, --set and recorded results, and written as new ones."""

from dataclasses import fields
from pathlib import Path

import pytest

from wideberth.experiments.engine.closed_loop import check_shown, figure_name, shown_of_fewer
from wideberth.experiments.engine.result import open_result
from wideberth.experiments.engine.runner import draw, reopen, run
from wideberth.experiments.engine.shipped import read_experiment, shipped
from wideberth.experiments.studies.replay import Replay
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.plugins.former_keys import LISTS, RENAMED, with_new_keys
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.plugins.yamlfile import dump, read_config
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.helpers.sweeps import contents

FOLLOWER = {"type": "pure_pursuit", "robot": "unicycle", "reference_speed": 0.7}
OLD = {
    "type": "replay",
    "robot": "unicycle",
    "planners": {"one": FOLLOWER},
    "settings": {"time_limit": 2.0, "history": 0.0},
    "episodes": 2,
    "seed": 3,
    "show": 1,
}


def test_no_study_has_an_old_key_and_every_new_key_is_one() -> None:
    for (room, name), keys in RENAMED.items():
        known = {field.name for field in fields(load(room, name))}
        assert not known & keys.keys() and set(keys.values()) <= known
    for (room, name), keys in LISTS.items():
        hints = {field.name: field.type for field in fields(load(room, name))}
        assert {str(hints[key]) for key in keys} <= {"tuple[int, ...]", str(tuple[int, ...])}


def test_studies_call_their_seeds_alike() -> None:
    for name in names("experiments"):
        kind = load("experiments", name)
        known = {field.name: field.type for field in fields(kind)}
        assert "episodes" not in known and not ("seeds" in known and "seed" in known), name
        assert known.get("show", tuple[int, ...]) == tuple[int, ...], name
        if "seeds" in known:
            assert kind.growing == ("seeds",), name


def test_shipped_configs_have_no_old_keys() -> None:
    for name in shipped():
        config = read_config(Path(__file__).parents[2] / "experiments/configs" / f"{name}.yaml")
        assert with_new_keys("experiments", config) == config


def test_an_old_file_builds_the_same_experiment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("old.yaml").write_text(dump(OLD))
    made, _ = read_experiment("old.yaml", [])
    assert isinstance(made, Replay)
    assert (made.seeds, made.first_seed, made.show) == (2, 3, (4,))  # it was counted from `seed`
    assert describe(build("experiments", OLD)) == describe(made)
    by_path = {**OLD, "type": "wideberth.experiments.studies.replay:Replay"}
    assert describe(build("experiments", by_path)) == describe(made)
    again, _ = read_experiment("old.yaml", ["episodes=5", "seed=1", "show=2"])
    assert (again.seeds, again.first_seed, again.show) == (5, 1, (2,))  # type: ignore[attr-defined]
    default = build("experiments", {key: OLD[key] for key in OLD if key != "show"})
    assert default.show == (3,)


def test_old_keys_with_set_on_a_shipped_config() -> None:
    made, _ = read_experiment("closed_loop_risk", ["episodes=7"])
    assert made.seeds == 7  # type: ignore[attr-defined]
    made, _ = read_experiment("known_futures", ["show=1"])
    assert made.shown_instant == 1  # type: ignore[attr-defined]
    made, _ = read_experiment("crossing", ["show=1"])
    assert made.show == (1,)  # type: ignore[attr-defined]


def test_both_names_of_a_key_are_refused() -> None:
    with pytest.raises(WideberthError, match="episodes is the old name of seeds; both stand here"):
        build("experiments", {**OLD, "seeds": 3})


def test_a_recorded_result_with_old_keys_is_still_read(tmp_path: Path) -> None:
    result = run(build("experiments", OLD), tmp_path / "out")
    written = read_config(tmp_path / "out" / "config.yaml")
    assert (written["seeds"], written["first_seed"], written["show"]) == (2, 3, [4])
    assert not {"episodes", "seed"} & written.keys()
    drawn = [path.name for path in draw(tmp_path / "out")]
    old = {**written, "episodes": 2, "seed": 3, "show": 1}
    del old["seeds"], old["first_seed"]
    (tmp_path / "out" / "config.yaml").write_text(dump(old))
    experiment, again = reopen(tmp_path / "out")
    assert describe(experiment) == {key: written[key] for key in written if key != "plugins"}
    assert open_result(tmp_path / "out").config == written and str(again.rows) == str(result.rows)
    assert [path.name for path in draw(tmp_path / "out")] == drawn
    before = contents(tmp_path / "out")
    run(experiment, tmp_path / "out")  # the same run: nothing is to be done
    assert contents(tmp_path / "out") == before
    run(build("experiments", {**OLD, "episodes": 3}), tmp_path / "out")
    assert len(open_result(tmp_path / "out").rows) == 3


def test_every_shown_seed_is_drawn(tmp_path: Path) -> None:
    run(build("experiments", {**OLD, "show": [3, 4]}), tmp_path / "out")
    drawn = {path.stem for path in draw(tmp_path / "out")}
    assert drawn == {"comparison", "run_one_3", "run_one_4", "animation_one_3"}


def test_what_may_be_shown() -> None:
    check_shown((), 0, 1)
    check_shown((4, 3), 3, 2)
    with pytest.raises(WideberthError, match=r"show is \[5\]; wanted seeds in \[3, 5\), as in"):
        check_shown((5,), 3, 2)
    with pytest.raises(WideberthError, match="each seed once"):
        check_shown((3, 3), 3, 2)
    assert shown_of_fewer((4, 3), 3, 1) == (3,)
    assert shown_of_fewer((4,), 3, 1) == (3,)
    assert shown_of_fewer((), 3, 1) == ()
    assert figure_name("a", 3, (3,)) == "a" and figure_name("a", 3, (3, 4)) == "a_3"
