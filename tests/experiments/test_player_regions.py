"""The player's outlines of what plans keep out of: each region's own, at the plan's numbers."""

import re
from dataclasses import replace
from pathlib import Path as File
from typing import Any

import numpy as np
import pytest

from wideberth.draw.shapes import COUNT, outlines
from wideberth.experiments.engine.closed_loop import log_name
from wideberth.experiments.report.player import episode_planner, packed, play
from wideberth.experiments.studies.comparison import Comparison
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.plugins.yamlfile import dump
from wideberth.framework.region import Region
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.footprint import Outline
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.regions import BUILT_IN
from wideberth.tests.helpers.player_samples import (
    NASTY,
    STEPS,
    episode,
    forecast,
    numbers,
    unpacked,
)

ROBOT, PERSON, OWN = 0.3, 0.3, 0.1  # m: both radii of the episode, and the planner's margin
LEVEL = 1.5
CORNERS = Outline(((-0.2, -0.1), (0.2, -0.1), (0.2, 0.1), (-0.2, 0.1)))


def planner(region: str) -> Planner:
    made = build(
        "controllers",
        {
            "type": "mpc", "robot": "unicycle", "region": region, "predictor": "static",
            "level": "fixed", "solver": "riccati", "margin": OWN,
        },
    )  # fmt: skip
    assert isinstance(made, Planner)
    return made


def rims(stored: dict[str, Any]) -> list[np.ndarray]:
    """Outlines of the first plan's one obstacle, (COUNT, 2) each, by step."""
    (entry,) = stored["agents"][0]["plans"][0]["forecast"]
    return [np.stack([numbers(column) for column in rim], axis=1) for rim in entry["sets"]]


def shapes() -> tuple[np.ndarray, np.ndarray]:
    """Means (N, 2) and covariances (N, 2, 2) of the forecast in the episode."""
    known = forecast()
    return known.mean[0, 0], known.covariance[0, 0]


def drawn(region: str) -> list[np.ndarray]:
    found = rims(unpacked(packed(episode(), 0.1, planner(region))))
    assert len(found) == STEPS and all(rim.shape == (COUNT, 2) for rim in found)
    return found


def test_rectangle() -> None:
    """Every point is r + r_d + margin away from the box of half-width z sigma."""
    for rim, mean, covariance in zip(drawn("luetkepohl_rectangle"), *shapes(), strict=True):
        half = LEVEL * np.sqrt(np.diag(covariance))
        beyond = np.maximum(np.abs(rim - mean) - half, 0.0)
        away = np.hypot.reduce(beyond, axis=1)
        np.testing.assert_allclose(away, ROBOT + PERSON + OWN, atol=2e-3)  # to the page's 1 mm


def test_ellipse() -> None:
    """Both semi-axes of the ellipse are longer by r + r_d + margin."""
    for rim, mean, covariance in zip(drawn("mahalanobis_ellipse"), *shapes(), strict=True):
        values, vectors = np.linalg.eigh(covariance)
        axes = LEVEL * np.sqrt(values) + ROBOT + PERSON + OWN
        scaled = ((rim - mean) @ vectors) / axes
        np.testing.assert_allclose(np.hypot.reduce(scaled, axis=1), 1.0, atol=3e-3)


def test_half_plane() -> None:
    """At the distance margin + z h(a) in every direction a."""
    for rim, mean, covariance in zip(drawn("half_plane"), *shapes(), strict=True):
        away = rim - mean
        length = np.hypot.reduce(away, axis=1)
        a = away / length[:, None]
        spread = np.sqrt(np.einsum("ij,jk,ik->i", a, covariance, a))
        np.testing.assert_allclose(length, ROBOT + PERSON + OWN + LEVEL * spread, atol=2e-3)


@pytest.mark.parametrize("name", sorted(BUILT_IN))
def test_every_region_has_its_own_outline(name: str) -> None:
    region = build("regions", name)
    assert isinstance(region, Region)
    mean = np.array([[1.0, -2.0], [0.0, 0.5]])
    covariance = np.array([[[0.5, 0.2], [0.2, 0.3]], [[0.02, 0.0], [0.0, 0.9]]])
    level = np.full(2, region.level(0.05))
    obstacle, margin = GaussianObstacle(mean, covariance), np.array([0.8, 1.1])
    found = outlines(region, obstacle, margin, level)
    numbers_of = region.parameters(obstacle, margin)[:, None]
    for share, inside in ((0.999, True), (1.001, False)):
        points = mean[:, None] + share * (found - mean[:, None])
        assert (region.contains(points, numbers_of, level[:, None]) == inside).all()
    # The polygon of COUNT corners misses less than 2 % of the area, also of a thin one.
    x, y = (found - mean[:, None]).transpose(2, 0, 1)
    area = 0.5 * np.abs((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1))
    np.testing.assert_allclose(area, region.area(numbers_of[:, 0], level), rtol=0.02)


def test_the_corners_of_a_square_are_drawn() -> None:
    region = build("regions", {"type": "luetkepohl_rectangle", "enlargement": "box"})
    assert isinstance(region, Region)
    obstacle, margin = GaussianObstacle(np.ones((1, 2)), 0.3 * np.eye(2)[None]), np.array([0.8])
    level = np.array([region.level(0.05)])
    (rim,) = np.abs(outlines(region, obstacle, margin, level) - 1.0)
    half = 0.5 * float(np.sqrt(region.area(region.parameters(obstacle, margin), level))[0])
    assert (np.abs(rim - half).max(axis=1) < 2e-3).sum() == 4
    np.testing.assert_allclose(rim.max(axis=1), half, atol=2e-3)


def test_an_empty_region_shrinks_to_the_mean() -> None:
    region = build("regions", "risk_contour")
    assert isinstance(region, Region)
    obstacle = GaussianObstacle(np.ones((1, 2)), 4.0 * np.eye(2)[None])
    found = outlines(region, obstacle, np.array([0.1]), np.array([region.level(0.5)]))
    np.testing.assert_allclose(found, 1.0)


def test_bodies_with_corners_and_obstacles_in_no_constraint() -> None:
    made = episode()
    first, *others = made.agents
    cornered = replace(made, agents=(replace(first, footprint=CORNERS), *others))
    for region, room in (("minkowski_sum", ROBOT), ("separating_line", 0.0)):
        rim = rims(unpacked(packed(cornered, 0.1, planner(region))))[0]
        reach = (rim - shapes()[0][0]).max(axis=0)  # of the ellipse: s sqrt(Sigma_ii)
        wanted = LEVEL * np.sqrt(np.diag(shapes()[1][0])) + PERSON + OWN + room
        assert (reach <= wanted + 2e-3).all() and (reach >= 0.98 * wanted).all()
    free = tuple(replace(plan, ids=("else",)) for plan in first.plans)
    loose = replace(made, agents=(replace(first, plans=free), *others))
    (entry,) = unpacked(packed(loose, 0.1, planner("minkowski_sum")))["agents"][0]["plans"][0][
        "forecast"
    ]
    assert entry["name"] == NASTY and entry["sets"] == []


def test_space_has_no_outline_and_many_are_thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    flying = replace(planner("minkowski_sum"), robot=build("robots", "unicycle"))
    stored = unpacked(packed(episode(3), 0.1, flying))
    assert stored["agents"][0]["plans"][0]["forecast"][0]["sets"] == []
    monkeypatch.setattr("wideberth.experiments.report.player._OUTLINES", 20)
    stored = unpacked(packed(episode(), 0.1, flying))  # 6 plans of 8 steps are 48
    (entry,) = stored["agents"][0]["plans"][0]["forecast"]
    assert stored["apart"] == 3 and stored["region"] == "minkowski sum"
    assert [rim is not None for rim in entry["sets"]] == [i % 3 == 1 for i in range(STEPS)]


def test_the_planner_is_that_of_the_result(
    tmp_path: File, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = {"type": "unicycle"}
    mine = {"type": "mpc", "robot": body, "region": "half_plane", "predictor": "static"}
    config = {
        "type": "comparison", "scenarios": {"head_on": {"type": "chicken_game"}},
        "robots": {"a": body}, "seeds": 1, "show": [0],
        "controllers": {
            "mine": {**mine, "level": "fixed", "solver": "riccati"},
            "still": {"type": "pure_pursuit", "robot": body},
        },
    }  # fmt: skip
    experiment = build("experiments", config)
    assert isinstance(experiment, Comparison)
    (tmp_path / "config.yaml").write_text(dump(describe(experiment)), encoding="utf-8")
    files = {task.settings["controller"]: log_name(task) for task in experiment.tasks()}
    folder = tmp_path / "files"
    assert episode_planner(folder / files["mine"]) is None  # the result is not finished
    (tmp_path / "table.csv").touch()
    known = episode_planner(folder / files["mine"])
    assert known is not None and type(known.region).__name__ == "HalfPlane"
    assert episode_planner(folder / files["still"]) is None  # it has none
    assert episode_planner(folder / "other-0.npz") is None
    assert episode_planner(tmp_path / "elsewhere.npz") is None
    # Played as a whole, the page opens with a choice by what differs, in the study's order.
    folder.mkdir()
    for path in files.values():
        (folder / path).write_bytes(episode().to_bytes())
    page = play(tmp_path, tmp_path / "all.html").read_text(encoding="utf-8")
    assert re.findall(r'data-label="(.*?)"', page) == ["mine", "still"]
    assert f"<h1>{tmp_path.name}: 2 runs</h1>" in page
    titles = re.findall(r'data-title="(.*?)"', page)
    assert titles[0] == "head on: controller mine, robot a, nominal, seed 3"
    monkeypatch.setattr("wideberth.experiments.report.player.ROOM", 10)
    with pytest.raises(WideberthError, match=r"too large .* `wideberth play .*mine"):
        play(tmp_path, tmp_path / "all.html")
    alone = play(folder / files["still"], tmp_path / "one.html").read_text(encoding="utf-8")
    assert "<h1>head on: controller still, robot a, nominal, seed 3</h1>" in alone
