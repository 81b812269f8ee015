"""The hallways of CrowdSimPlus: draws of all layouts, walls, doors, and what is refused."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from wideberth.framework.plugins.config import build
from wideberth.framework.values.errors import WideberthError
from wideberth.simulation.scenarios import hallway
from wideberth.simulation.scenarios.hallway import Hallway
from wideberth.simulation.scenarios.placing import wall_distance

LAYOUTS = ["open", "static", "static_with_back", "bottleneck", "squeeze"]


def ways(layout: str, case: int) -> list[np.ndarray]:
    """Start, places in between, and goal of each person, before anybody walks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hallway, "HEAD_START", 0.0)
        people = Hallway(layout=layout).cast(case).people
    return [person.path.points for person in people]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_draws_are_those_recorded_from_the_original(layout: str, dense_folder: Path) -> None:
    text = (dense_folder / "crowdsimplus_golden.json").read_text(encoding="utf-8")
    cases = json.loads(text)["layouts"][layout]["attributes_fixed"]
    assert cases
    for recorded in cases:
        drawn = ways(layout, recorded["case"])
        for way, person in zip(drawn, recorded["people"], strict=True):
            np.testing.assert_allclose(way[0], person["start"], rtol=0.0, atol=1e-11)
            np.testing.assert_allclose(way[1], person["heads_for"], rtol=0.0, atol=1e-11)
            np.testing.assert_allclose(way[-1], person["goal"], rtol=0.0, atol=1e-11)


def walls_of(layout: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Segments of a layout, written down from the description of the original's defaults."""
    if layout == "squeeze":
        chains = [[(k, -3.75), (0.5 * k, 0.0), (k, 3.75)] for k in (-1, 1)]
    else:
        chains = [[(k, -4.0), (k, 4.0)] for k in (-1, 1)]
    if layout == "bottleneck":
        chains += [[(k, 0.0), (0.5 * k, 0.0)] for k in (-1, 1)]
    if layout.startswith("static"):
        block = [(1.0, -1.0), (0.875, -1.0), (0.5, -0.2), (0.5, 0.2), (0.875, 1.0), (1.0, 1.0)]
        chains += [[(k * x, y) for x, y in block] for k in (-1, 1)]
    if layout == "static_with_back":
        chains += [[(-1.0, y), (1.0, y)] for y in (-2.0, 2.0)]
    return [(np.array(a, float), np.array(b, float)) for c in chains for a, b in pairwise(c)]


def clearance(place: np.ndarray, walls: list[tuple[np.ndarray, np.ndarray]]) -> float:
    """Distance from a place to the nearest segment, m."""
    distances = []
    for a, b in walls:
        share = np.clip((place - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        distances.append(float(np.linalg.norm(place - a - share * (b - a))))
    return min(distances)


def heading(layout: str, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """What a person at the start heads for."""
    low, high = sorted((start[1], goal[1]))
    door = layout in ("static", "static_with_back", "bottleneck")
    passes = door and low < -0.2 and high > 0.2 and np.hypot(*start) > 0.5
    return np.zeros(2) if passes else goal


def drawn_again(layout: str, case: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Starts and goals of three people, written down anew from the description."""
    rng = np.random.default_rng(1000 + case)
    walls, robot_start, robot_goal = walls_of(layout), np.array([0, -1.5]), np.array([0, 1.5])
    people: list[tuple[np.ndarray, np.ndarray]] = []
    while len(people) < 3:
        height = 4.0
        while True:
            down = 1 if rng.random() < 0.15 else -1
            likely = 0.8 if down > 0 else 1 - 0.8
            side = -1 if rng.random() < likely else 1
            crossing = 1 - 0.3 if rng.random() < likely else 0.3
            other = -side if rng.random() < crossing else side
            start = rng.random(2) * [0.5 * side * 1.4, 0.25 * down * 1.5 * (height - 0.6)]
            free = np.linalg.norm(start - robot_start) >= 0.75 and clearance(start, walls) >= 0.31
            if free and all(np.linalg.norm(start - a) >= 0.6 for a, _ in people):
                goal = rng.random(2) * [0.5 * other * 1.4, -0.5 * down * 1.5 * (height - 0.6)]
                heads = [heading(layout, a, b) for a, b in people]
                free = np.linalg.norm(goal - robot_goal) >= 0.55 and clearance(goal, walls) >= 0.3
                if free and all(np.linalg.norm(goal - place) >= 0.6 for place in heads):
                    people.append((start, goal))
                    break
            height *= 1.1
    return people


@pytest.mark.parametrize("layout", LAYOUTS)
def test_draws_are_those_of_the_description(layout: str) -> None:
    for case in range(40):
        for way, (start, goal) in zip(ways(layout, case), drawn_again(layout, case), strict=True):
            np.testing.assert_allclose(way[[0, -1]], [start, goal], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("layout", "gap", "above"),
    [("open", 1.0, 1.0), ("static", 0.5, 0.5), ("bottleneck", 0.5, 1.0), ("squeeze", 0.5, 0.6)],
)
def test_hallway_walls_by_hand(layout, gap, above) -> None:
    walls = Hallway(layout=layout).hall.polygons()
    if layout == "squeeze":  # an edge at (0.5, 0), a wall from there to (1, 3.75)
        above = abs(3.75 * (0.0 - 0.5) - 0.5 * 0.2) / np.hypot(0.5, 3.75)
    elif layout == "bottleneck":
        above = np.hypot(0.5, 0.2 - 0.01)  # the jamb's end is 0.02 m thick
    assert wall_distance(np.zeros(2), walls) == pytest.approx(gap)
    assert wall_distance(np.array([0.0, 0.2]), walls) == pytest.approx(above)


def test_people_head_for_the_door_first() -> None:
    scene = Hallway(layout="bottleneck")
    below, above = np.array([0.5, -1.0]), np.array([0.3, 1.2])
    assert scene._route(below, above).points.tolist() == [[0.5, -1.0], [0.0, 0.0], [0.3, 1.2]]
    assert len(scene._route(np.array([0.2, -0.3]), above).points) == 2  # in the door already
    assert len(scene._route(np.array([0.5, 0.5]), above).points) == 2
    assert len(Hallway()._route(below, above).points) == 2


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Hallway(layout="bottleneck", robot_radius=0.5), "does not fit through it"),
        (lambda: Hallway(layout="squeeze", robot_radius=0.5), "does not fit through it"),
        (lambda: build("scenarios", {"type": "hallway", "layout": "funnel"}), "layout"),
    ],
)
def test_hallways_that_cannot_be(make, message) -> None:
    with pytest.raises(WideberthError, match=message):
        make()
