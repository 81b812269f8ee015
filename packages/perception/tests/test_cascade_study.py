"""Robots that see for themselves as a study: cases, paired changes, and what is drawn."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.experiments.drawing.animation import animate
from wideberth.experiments.drawing.beliefs import (
    DrawnBelief,
    belief_at,
    beliefs_of,
    discs,
    magnified,
    rims,
)
from wideberth.experiments.drawing.episodes import draw_views
from wideberth.experiments.engine.base import Row
from wideberth.experiments.engine.csv_tables import read_table
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.report.player import content
from wideberth.framework.values.errors import WideberthError
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.scenarios import crossing
from wideberth.simulation.scenarios.crossing import Crossing
from wideberth_perception.studies.cascade import (
    MEASURES,
    CascadeStudy,
    arrivals,
    changes,
    largest,
    sentence,
)

pytest.importorskip("mujoco", reason="the extra `perception` is not installed")

NEAR = Crossing()


@pytest.fixture(scope="module", autouse=True)
def near() -> Iterator[None]:
    """The robots begin as near to each other as they may."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(crossing, "DISTANCE", (12.0, 12.0))
        yield


def shipped(name: str) -> CascadeStudy:
    experiment, _ = read_experiment(name, [])
    assert isinstance(experiment, CascadeStudy)
    return experiment


@pytest.fixture(scope="module")
def price() -> CascadeStudy:
    return replace(shipped("price_of_perception"), scenarios={"crossing": NEAR}, seeds=2)


@pytest.fixture(scope="module")
def episode() -> Episode:
    """One episode of robots with sensors, half a minute long."""
    study = replace(shipped("cascade_crossing"), scenarios={"crossing": NEAR})
    case = next(one for one in study.played() if one.label == "recommended-box")
    started = study._begun(case, 0)
    started.advance()
    return started.episode()


def test_stages_of_the_price_are_peeled_off_one_by_one() -> None:
    study = shipped("price_of_perception")
    found = list(study.cascades.values())
    assert study.stepwise and study.seeds >= 40
    parts = ("mechanics", "noise", "detector", "tracker", "state", "body")
    for one, after in pairwise(found):
        changed = [
            part for part in parts if repr(getattr(one, part)) != repr(getattr(after, part))
        ]
        if after is not found[-1]:
            assert [part for part in changed if part != "noise"] in ([], *([p] for p in parts))
    whole = found[-2]
    assert whole.mechanics == "physics" and None not in (
        whole.state,
        whole.detector,
        whole.tracker,
    )


def test_steps_add_up_and_a_quick_run_is_drawn(price: CascadeStudy, tmp_path: Path) -> None:
    few = {name: price.cascades[name] for name in ("truth", "noise", "detection")}
    result = run(replace(price, cascades=few, seeds=1), tmp_path / "out")
    lines = read_table(tmp_path / "out" / "summary.csv")
    assert [line["cascade"] for line in lines] == list(few)
    assert all(line["collisions"] == 0 and line["goals_in_time"] == 1.0 for line in lines)
    for measure in MEASURES:
        ends = [
            np.mean([row[measure.source] for row in result.rows if row["cascade"] == name])
            for name in ("truth", "detection")
        ]
        total = sum(line[f"{measure.name}_change"] for line in lines)
        assert total == pytest.approx(ends[1] - ends[0], abs=1e-12)
    drawn = {path.name for path in draw(tmp_path / "out")}
    assert drawn >= {"changes.png", "changes.pdf", "largest_changes.csv"}


def test_quick_settings_keep_the_question() -> None:
    assert [case.label for case in shipped("cascade_crossing").quick().played()] == [
        *("recommended-cylinder", "recommended-box", "paper-cylinder", "paper-box"),
    ]
    assert [case.cascade for case in shipped("price_of_perception").quick().played()] == [
        *("truth", "boxes"),
    ]
    faults = shipped("perception_faults").quick()
    assert len(faults.played()) == 2 and faults.seeds == 1


def test_routes_of_the_warehouse_meet_in_one_aisle() -> None:
    study = shipped("warehouse")
    walls = {wall.name: wall for wall in study.scenarios["aisle"].cast(0).polygons}
    for seed in (0, 1):
        for one in study.scenarios["aisle"].cast(seed).placements:
            middle = one.path.points[np.abs(one.path.points[:, 0]) < 2.0]
            assert (middle[:, 1] > walls["middle shelf"].points[:, 1].max()).all()
            assert (middle[:, 1] < walls["upper shelf"].points[:, 1].min()).all()


def rows_of(values: list[float], **others: Any) -> list[Row]:
    return [
        {"seed": i, "clearance": v, "time_s": 30.0 + v, "coverage": float("nan"),
         "below_reference": 0.3, **others}
        for i, v in enumerate(values)
    ]  # fmt: skip


def test_changes_are_of_pairs() -> None:
    """Seeds that differ much among themselves, and by 0.5 within each pair, differ by 0.5."""
    before = rows_of([1.0, 5.0, 9.0, 2.0])
    line = changes(rows_of([1.5, 5.5, 9.5, 2.5, 77.0]), before[::-1])
    for name in ("clearance", "time"):
        found = [line[f"{name}_change{end}"] for end in ("", "_low", "_high")]
        assert found == pytest.approx([0.5, 0.5, 0.5])
    assert line["given_up_change"] == 0.0
    assert np.isnan(line["coverage_change"]) and np.isnan(line["coverage_change_low"])


def change(value: float, low: float, high: float) -> Row:
    none = {
        f"{one.name}_change{end}": 0.0 for one in MEASURES for end in ("", "_low", "_high")
    }  # fmt: skip
    own = {f"clearance_change{e}": v for e, v in zip(("", "_low", "_high"), (value, low, high),
                                                     strict=True)}  # fmt: skip
    return none | own


def test_what_matters_most_is_beyond_chance() -> None:
    """The larger change whose interval holds 0 is not named."""
    lines = {
        "loud": change(-0.9, -2.0, 0.1),
        "sure": change(-0.2, -0.3, -0.1),
        "small": change(0.1, 0.05, 0.2),
    }
    told = sentence(largest("crossing", lines))
    assert told == (
        "crossing: sure changes clearance most, by \u22120.2 (\u22120.3 to \u22120.1); nothing "
        "changes time or coverage or level given up beyond chance."
    )


def test_arrival_in_truth_and_as_believed(episode: Episode) -> None:
    away = [np.linalg.norm(log.positions[-1] - log.paths[0][1].goal) for log in episode.robots]
    found = arrivals(episode, 120.0, 0.5)
    assert found["goal_error"] == max(away) < 0.5
    assert found["time_s"] == max(log.reached for log in episode.robots)
    assert 1.0 < found["time_ratio_true_worst"] < 2.0
    strict = arrivals(episode, 120.0, 0.01)
    assert strict["time_ratio_true_worst"] == float("inf")


def test_beliefs_lie_where_the_others_are(episode: Episode) -> None:
    """In the world's frame: within centimetres, although each robot's own frame has drifted."""
    found = beliefs_of(episode)
    assert set(found) == {"lower", "upper"}
    for name, other in (("lower", "upper"), ("upper", "lower")):
        belief = belief_at(found[name], 12.0)
        assert belief is not None and len(belief.idents) == 1 and 11.85 < belief.time <= 12.0
        truth = episode.at(episode.agent(other), np.array([belief.time]))[0]
        assert np.linalg.norm(belief.places[0] - truth) < 0.3
        away = np.linalg.norm(belief.points - truth, axis=1)
        assert (away < 0.85).all()  # all points of the scan are on the other's box
    assert belief_at(found["lower"], -0.1) is None
    assert belief_at(found["lower"], found["lower"][-1].time + 5.0) is None


def test_ellipses_are_magnified_until_they_are_seen() -> None:
    spread = np.diag([1e-4, 4e-4])
    place, none = np.array([[1.0, 2.0]]), np.zeros((0, 2, 2))
    one = DrawnBelief(0.0, np.zeros((0, 2)), ("7",), place, spread[None], np.ones(1), none)
    scale = magnified({"a": [one]}, 0.05)
    assert scale == 2.0  # 2 cm x 2.448 is 4.9 cm; 20 cm at most
    (rim,) = rims(one, 0.05, scale)
    reach = np.abs(rim - one.places[0]).max(axis=0)
    np.testing.assert_allclose(reach, scale * np.sqrt(5.991 * np.diag(spread)), rtol=2e-3)
    (disc,) = discs(one)
    np.testing.assert_allclose(np.linalg.norm(disc - one.places[0], axis=1), 1.0)
    assert magnified({}, 0.05) == 1.0


def test_views_and_film_show_what_is_believed(episode: Episode) -> None:
    figure = draw_views(episode, distance=5.0, tail=0.05)
    words = [text.get_text() for panel in figure.axes for text in panel.texts]
    assert words.count("track 1") == 2
    (legend,) = figure.legends
    told = [text.get_text() for text in legend.get_texts()]
    assert {"points of the scan", "body as it is tracked"} <= set(told)
    assert "obstacle as it is, and its trail" in told
    film = animate(episode, tail=0.05, rate=2.0, seconds_per_second=20.0)
    bare = animate(replace(episode, perception={}), tail=0.05, rate=2.0, seconds_per_second=20.0)
    assert film[:6] == b"GIF89a" and film != bare


def test_a_false_track_is_in_the_player_with_the_size_it_was_taken_for(episode: Episode) -> None:
    agents = tuple(
        replace(log, name="stranger") if log.name == "upper" else log for log in episode.agents
    )
    stored = content(replace(episode, agents=agents), 0.05)
    radii = {
        entry["radius"]
        for agent in stored["agents"]
        for plan in agent.get("plans", ())
        for entry in plan["forecast"]
        if entry["name"] == "upper"
    }
    assert radii and min(radii) > 0.7 and max(radii) < 0.8


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"cases": {"a": {"cascde": "whole"}}}, "cases.a: .*cascade"),
        ({"cases": {"a": {"cascade": "hole"}}}, "cases.a.cascade: .*whole"),
        ({"cases": {}, "settings": {"seen": Settings()}}, "history: 0"),
        ({"cascades": {}}, "cascades is empty"),
        ({"show": (40,)}, "show"),
        ({"true_tolerance": 0.0}, "true_tolerance"),
    ],
)
def test_settings_that_make_no_study_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        replace(shipped("perception_faults"), **settings)
