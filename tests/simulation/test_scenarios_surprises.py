"""Sudden changes, recorded people, and the hallways of CrowdSimPlus."""

from pathlib import Path as File

import numpy as np
import pytest

from wideberth.experiments.studies.comparison import Comparison
from wideberth.framework.plugins.config import build
from wideberth.framework.values.errors import WideberthError
from wideberth.metrics.episode import approach
from wideberth.simulation.engine.agents import ReplayAgent
from wideberth.simulation.scenarios import sudden_change
from wideberth.simulation.scenarios.recorded_scene import FILES, SCENES, RecordedScene
from wideberth.simulation.scenarios.sudden_change import SuddenChange


@pytest.mark.parametrize("change", ["stop", "turn"])
@pytest.mark.parametrize("seed", range(6))
def test_the_walker_changes_in_the_robots_way(change, seed) -> None:
    scene = SuddenChange(change=change)
    cast = scene.cast(seed)
    (walker,), (robot,) = cast.bystanders, cast.placements
    assert isinstance(walker, ReplayAgent)
    moment = float(walker.times[1])
    times = np.linspace(0.0, 20.0, 4001)
    driven = robot.path.at(robot.speed * times)
    gap = np.linalg.norm(walker.at(times) - driven, axis=1)
    met = float(times[gap.argmin()])
    assert gap.min() < 0.01  # it is met, on the grid of 5 ms
    assert 2.5 - 0.01 <= met - moment <= 5.0 + 0.01
    before = times < moment
    room = approach(walker.at(times[before]), driven[before]).min()
    assert room >= 0.9 - 0.01  # both radii and 0.3 m
    steps = np.diff(walker.at(moment + np.array([-1.0, 0.0, 1.0])), axis=0)
    speeds = np.hypot(*steps.T)
    assert 0.5 <= speeds[0] <= 1.2
    if change == "stop":
        assert speeds[1] < 1e-9
    else:
        assert speeds[1] == pytest.approx(speeds[0])
        angle = np.arccos(np.clip(steps[0] @ steps[1] / speeds[0] ** 2, -1.0, 1.0))
        assert 0.8 - 1e-6 <= angle <= 2.2 + 1e-6


def test_either_change_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    stops = 0
    for seed in range(40):
        (walker,) = SuddenChange().cast(seed).bystanders
        assert isinstance(walker, ReplayAgent)
        stops += np.array_equal(walker.positions[1], walker.positions[2])
    assert 8 <= stops <= 32
    monkeypatch.setattr(sudden_change, "SPACE", 30.0)
    with pytest.raises(WideberthError, match="no room for the walker"):
        SuddenChange().cast(0)


ROWS = [
    (0, 1, 0.0, 0.0),
    (0, 2, 4.0, 4.0),
    (10, 1, 1.0, 0.0),
    (10, 2, 4.0, 3.0),
    (20, 1, 2.0, 0.0),
]


@pytest.fixture
def tracks(tmp_path):
    file = tmp_path / "tracks.txt"
    file.write_text("\n".join(" ".join(map(str, row)) for row in ROWS), encoding="utf-8")
    return str(file)


def test_a_result_hangs_on_the_users_recording(tracks) -> None:
    scene = RecordedScene(tracks, start=(0.0, 0.0, 0.0), goal=(5.0, 0.0), rows=(0,))
    robot = build("robots", {"type": "unicycle", "radius": 0.4})
    straight = build("controllers", {"type": "constant_velocity", "robot": robot})
    scenes = {"theirs": scene, "shipped": RecordedScene()}
    made = Comparison(scenes, {"one": robot}, {"straight": straight})
    assert made.inputs() == [File(tracks)]  # the shipped one is part of the source


def test_people_walk_as_recorded_from_the_row_of_the_seed(tracks) -> None:
    scene = RecordedScene(tracks, start=(9.0, 0.0, np.pi), goal=(-9.0, 0.0), rows=(0, 1))
    for seed, offset in ((0, 0.0), (1, 0.4), (2, 0.0), (3, 0.4)):
        cast = scene.cast(seed)
        first, second = cast.bystanders
        assert (first.name, second.name) == ("recorded 1", "recorded 2")
        assert first.at(np.array([0.2]) - offset)[0] == pytest.approx([0.5, 0.0])
        assert second.at(np.array([0.4]) - offset)[0] == pytest.approx([4.0, 3.0])
        assert np.isnan(second.at(np.array([0.8]) - offset)).all()  # gone in the last row
        assert first.radius == pytest.approx(0.7071, abs=1e-4)
        path = cast.placements[0].path
        assert path.points[0].tolist() == [9.0, 0.0] and path.goal.tolist() == [-9.0, 0.0]
        assert path.direction(np.zeros(1))[0] == pytest.approx([-1.0, 0.0])


def test_scenes_have_the_published_starts_and_goals(tracks) -> None:
    robot = RecordedScene(tracks, scene="hotel").build(np.random.default_rng(0))[0]
    assert robot.path.points[0].tolist() == [-1.5, 0.0] and robot.path.goal.tolist() == [2.0, -6.0]
    assert robot.path.direction(np.zeros(1))[0] == pytest.approx([0.0, -1.0])
    assert {name: scene[1] for name, scene in SCENES.items()} == {
        "zara1": (3.0, 6.0), "zara2": (14.0, 5.0), "hotel": (2.0, -6.0), "eth": (3.0, 10.0),
        "univ": (11.5, 8.5),
    }  # fmt: skip
    assert SCENES["univ"][2] == (100,) and SCENES["eth"][2] == (100, 200, 300)
    assert FILES.keys() == SCENES.keys()


def test_a_folder_holds_the_scenes_file_and_rows_count_from_its_first(tmp_path) -> None:
    # One sample every ten frames of the video, from frame 780 on: x is the row.
    lines = [f"{780 + 10 * row} 1 {row} 0" for row in range(320)]
    (tmp_path / FILES["eth"]).write_text("\n".join(lines), encoding="utf-8")
    for seed, row in enumerate((100, 200, 300, 100)):
        (person,) = RecordedScene(str(tmp_path), scene="eth").cast(seed).bystanders
        found = person.at(np.array([0.0, 0.8]))
        np.testing.assert_allclose(found, [[row, 0.0], [row + 2.0, 0.0]], atol=1e-9)
    slower = RecordedScene(str(tmp_path), scene="eth", dt=0.5).cast(0).bystanders[0]
    np.testing.assert_allclose(slower.at(np.array([1.0])), [[102.0, 0.0]], atol=1e-9)


def test_with_nothing_stated_the_robot_crosses_the_plaza() -> None:
    cast = RecordedScene().cast(1)
    path = cast.placements[0].path
    assert path.points[0].tolist() == [-9.0, 0.0] and path.goal.tolist() == [9.0, 0.0]
    assert {one.radius for one in cast.bystanders} == {0.3}
    ways = np.stack([one.at(np.arange(0.0, 25.0, 0.4)) for one in cast.bystanders])
    assert np.isfinite(ways).any(axis=(1, 2)).sum() >= 10  # people are there


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda file: RecordedScene(file), "no scene is named, and start and goal and rows"),
        (lambda file: RecordedScene(file, start=(0, 0, 0), rows=(1,)), "goal missing"),
        (lambda file: RecordedScene(file, scene="eth").cast(0), "holds 300, and .* rows 0 to 2"),
        (lambda file: RecordedScene("nowhere.txt", scene="eth").cast(0), "nowhere.txt is no file"),
        (lambda file: RecordedScene("nowhere.txt", scene="eth").inputs(), "the folder that holds"),
        (
            lambda file: RecordedScene(scene="zara1"),
            "scene is 'zara1', and tracks is the synthetic shipped:plaza.txt; state tracks",
        ),
        (
            lambda file: RecordedScene(file, "eth", rows=(0, 2, 7, 1)).cast(0),
            r"rows holds 7, and .* has rows 0 to 2; state earlier ones",
        ),
        (
            lambda file: RecordedScene(str(File(file).parent), scene="univ").cast(0),
            r"holds no 'students003.txt', .* name the file itself",
        ),
        (
            lambda file: RecordedScene(
                str(File(file).parent), start=(0, 0, 0), goal=(1, 1), rows=(0,)
            ).cast(0),
            "is a folder; name a file, or a scene of eth, hotel, univ, zara1, zara2",
        ),
    ],
)
def test_recordings_that_do_not_fit(tracks, make, message) -> None:
    with pytest.raises(WideberthError, match=message):
        make(tracks)
