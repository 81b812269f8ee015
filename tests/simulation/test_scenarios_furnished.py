"""Walls, walkers and routes beside another scenario."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from wideberth.framework import build
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.polygon import Polygon
from wideberth.simulation.engine.agents import ScriptedAgent
from wideberth.simulation.scenarios import chicken_game
from wideberth.simulation.scenarios.chicken_game import ChickenGame
from wideberth.simulation.scenarios.furnished import SLOPE, Furnished, Walker

SHELF = Polygon(((-3.0, -0.6), (3.0, -0.6), (3.0, 0.6), (-3.0, 0.6)), "shelf")
GAME = ChickenGame(distance=(14.0, 14.0))


@pytest.fixture(autouse=True)
def together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both robots come to the middle at the same time."""
    monkeypatch.setattr(chicken_game, "LAG", (0.0, 0.0))


def furnished(**settings: object) -> Furnished:
    made = build("scenarios", {"type": "furnished", **settings})
    assert isinstance(made, Furnished)
    return made


def test_without_anything_it_is_the_other_scenario() -> None:
    plain, own = GAME.cast(3), furnished(scenario=GAME).cast(3)
    for one, other in zip(plain.placements, own.placements, strict=True):
        assert one.name == other.name and one.phase == other.phase
        np.testing.assert_array_equal(one.path.points, other.path.points)
    assert not own.bystanders and not own.polygons


def test_routes_keep_their_room_and_lead_from_start_to_goal() -> None:
    room, cell = 0.8, 0.1
    scene = furnished(scenario=GAME, routes="smoothed", room=room, resolution=cell)
    scene = replace(scene, walls=(SHELF,))
    straight = {one.name: one.path for one in GAME.cast(0).placements}
    for one in scene.cast(0).placements:
        away = shapely.LineString(one.path.points).distance(shapely.Polygon(SHELF.points))
        assert room - 1.5 * cell <= away <= room + SLOPE + 1.5 * cell
        ends = one.path.points[[0, -1]] - straight[one.name].points[[0, -1]]
        assert np.abs(ends).max() <= cell
        assert one.path.length > straight[one.name].length


def test_a_wall_at_the_goal_leaves_no_route() -> None:
    fence = Polygon(((6.0, -2.0), (8.0, -2.0), (8.0, 2.0), (6.0, 2.0)))
    scene = Furnished(GAME, walls=(fence,), routes=build("route_planners", "navfn"))
    with pytest.raises(WideberthError, match=r"no route for left .*smaller room"):
        scene.cast(0)


def test_walkers_are_drawn_from_their_ranges() -> None:
    walker = Walker(((0.0, -5.0), (0.0, 5.0)), speed=(0.8, 1.2), start=(1.0, 3.0), radius=0.25)
    scene = Furnished(GAME, walkers=(walker, walker))
    seen = [one for seed in range(30) for one in scene.cast(seed).bystanders]
    assert {one.name for one in seen} == {"walker 1", "walker 2"}
    assert all(isinstance(one, ScriptedAgent) for one in seen)
    speeds = [one.speed for one in seen if isinstance(one, ScriptedAgent)]
    starts = [one.start for one in seen if isinstance(one, ScriptedAgent)]
    assert 0.8 <= min(speeds) < 0.9 and 1.1 < max(speeds) <= 1.2
    assert 1.0 <= min(starts) < 1.3 and 2.7 < max(starts) <= 3.0
    one, again = (scene.cast(7).bystanders[0] for _ in range(2))
    np.testing.assert_array_equal(one.at(np.arange(9.0)), again.at(np.arange(9.0)))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"room": 0.0}, "furnished.room"),
        ({"resolution": -1.0}, "furnished.resolution"),
        ({"scenario": {"type": "crowdnav"}}, "draws its situation as a whole"),
        ({"walkers": [{"way": [[0, 0]]}]}, "path"),
        ({"walkers": [{"way": [[0, 0], [1, 0]], "speed": [2.0, 1.0]}]}, "walker.speed"),
        ({"walkers": [{"way": [[0, 0], [1, 0]], "radius": 0.0}]}, "walker.radius"),
    ],
)
def test_what_makes_no_scene_is_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        furnished(**settings)


def test_routes_that_would_lead_through_the_walls_within_are_refused() -> None:
    within = furnished(scenario=GAME, walls=(SHELF,))
    with pytest.raises(WideberthError, match="routes lead around its walls alone"):
        furnished(scenario=within, routes={"type": "navfn"}).cast(0)
