"""The study of Nav2's controllers: what is in sight, what is watched, what is beyond chance."""

from dataclasses import dataclass, replace
from pathlib import Path as File

import numpy as np
import pytest

from wideberth.experiments.engine.base import Task
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.framework.controller import Controller
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.predictors import Kalman
from wideberth.robots import Unicycle
from wideberth.simulation.engine.agents import RobotAgent, ScriptedAgent
from wideberth.simulation.engine.episode import Run
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.sensing.channel import Channel
from wideberth_nav2.costmap.local_costmap import CostmapView
from wideberth_nav2.server.navigator import Nav2
from wideberth_nav2.studies.looks import CostmapLook, looks_from_bytes, looks_to_bytes
from wideberth_nav2.studies.nav2_rivals import (
    LimitSet,
    Nav2Rivals,
    adapted,
    compared,
    finding,
    sized,
    with_radius,
)
from wideberth_nav2.studies.same_view import SameView, Watched, in_sight


@pytest.fixture(scope="module")
def study() -> Nav2Rivals:
    experiment, _ = read_experiment("nav2_rivals", [])
    assert isinstance(experiment, Nav2Rivals)
    return experiment


def seen(places: list[tuple[float, float]], walls: tuple[Polygon, ...] = ()) -> Observation:
    ones = tuple(Detection(str(i), np.array(place), None, 0.3) for i, place in enumerate(places))
    return Observation(0.0, np.zeros(5), ones, polygons=walls)


def names(observation: Observation, view: CostmapView) -> list[str]:
    return [one.ident for one in in_sight(observation, np.zeros(2), view)]


def test_who_is_far_hidden_or_beyond_the_window_is_not_seen() -> None:
    view = CostmapView(width=6.0, height=6.0, obstacle_max_range=4.0)
    assert names(seen([(2.0, 0.0), (-2.5, 1.0)]), view) == ["0", "1"]
    assert names(seen([(3.2, 0.0)]), view) == ["0"]  # its near side is within the window
    assert names(seen([(3.4, 0.0)]), view) == []
    wide = replace(view, width=20.0, height=20.0)
    assert names(seen([(4.2, 0.0), (0.0, 4.4)]), wide) == ["0"]  # 3.9 m and 4.1 m to the surface
    assert names(seen([(1.5, 0.0), (3.0, 0.0)]), wide) == ["0"]  # one behind the other
    wall = Polygon(((1.0, -1.0), (1.2, -1.0), (1.2, 1.0), (1.0, 1.0)))
    assert names(seen([(2.0, 0.0), (0.0, 2.0)], (wall,)), wide) == ["1"]


@dataclass(eq=False)
class Keeper(Controller):
    """Stands still and keeps what it observes."""

    period: float = 0.05

    def __post_init__(self) -> None:
        self.kept: list[Observation] = []

    def reset(self) -> None:
        pass

    def set_path(self, path: Path) -> None:
        pass

    def remember(self, observation: Observation) -> None:
        pass

    def command(self, observation: Observation) -> Command:
        self.kept.append(observation)
        return Command((0.0, 0.0))

    @property
    def last_plan(self) -> None:
        return None


def observed(view: CostmapView, tracker: Kalman | None, person: bool = False) -> list[Observation]:
    """What a robot at the origin observes of somebody who passes at 1 m/s, 2 m aside."""
    way = Path(np.array([[-10.0, 2.0], [10.0, 2.0]]))
    settings = Settings(time_limit=20.0, history=0.0, channel=Channel(noise=0.01))
    here = Path(np.array([[0.0, 0.0], [9.0, 0.0]]))
    keeper = Keeper()
    agents = [RobotAgent("robot", Unicycle(), keeper, here, 0.0, reference_speed=0.5)]
    if person:
        away = Path(np.array([[0.0, -50.0], [9.0, -50.0]]))
        agents = [
            replace(agents[0], person=True),
            RobotAgent("other", Unicycle(), Keeper(), away, 0.0, reference_speed=0.5),
        ]
    other = ScriptedAgent("passer", way, 1.0, 0.3)
    world = SameView(settings, view, tracker)
    Run(agents, settings, 1, (other,), (), (), world).advance()
    return keeper.kept


def test_the_world_hides_from_robots_and_not_from_people() -> None:
    view = CostmapView(width=6.0, height=6.0, obstacle_max_range=6.0)
    times = [one.stamp for one in observed(view, None) if one.detections]
    assert times and min(times) > 6.5 and max(times) < 13.5  # |x| up to 3 m, and the disc
    assert all(one.detections for one in observed(view, None, person=True))
    exact = replace(view, exact=True)
    assert all(one.detections for one in observed(exact, None))


def test_velocities_are_those_of_who_moves() -> None:
    view = CostmapView(exact=True)
    found = observed(view, Kalman(acceleration_density=0.01))
    speeds = np.array([one.detections[0].velocity for one in found if one.stamp > 1.0])
    np.testing.assert_allclose(speeds.mean(axis=0), [1.0, 0.0], atol=0.02)
    assert np.abs(speeds - [1.0, 0.0]).max() < 0.15  # differences of noise would be 0.3 m/s
    assert observed(view, None)[-1].detections[0].velocity is None


def test_lengths_of_a_view_grow_with_the_robot() -> None:
    view = CostmapView()
    assert sized(view, 0.22) == view
    large = sized(view, 0.44)
    assert (large.width, large.obstacle_max_range) == (6.0, 5.0)
    assert large.inflation_radius == pytest.approx(0.92)
    assert sized(CostmapView.privileged(), 0.44).width == 12.0


def test_rivals_get_view_limits_and_what_nav2_ships(study: Nav2Rivals) -> None:
    robot = with_radius(Unicycle(), 0.3)
    assert robot.radius == 0.3
    view = CostmapView(width=5.0)
    bound = adapted(study.controllers["dwb"], robot, True, view)
    free = adapted(study.controllers["dwb"], robot, False, view)
    assert isinstance(bound, Nav2) and isinstance(free, Nav2)
    assert bound.settings.view == view and bound.robot == robot
    assert (bound.robot_limits, free.robot_limits) == (True, False)
    assert free.settings.parameters["max_vel_x"] == 0.26
    costmaps = study.controllers["teb_static"]
    assert isinstance(costmaps, Nav2)
    assert costmaps.settings.parameters == {"use_dynamic_obstacles": False}
    ours = adapted(study.controllers["ours"], robot, True, view)
    assert isinstance(ours, Planner)
    assert ours.reference_speed == pytest.approx(Unicycle().max_speed)
    with pytest.raises(WideberthError, match="no radius to set"):
        with_radius(study, 0.3)  # type: ignore[arg-type]


def rows(times: list[float]) -> list[dict[str, object]]:
    """Successful episodes by their times; a time of NaN is a failure."""
    return [
        {
            "seed": i, "success": bool(np.isfinite(t)), "success_time": t,
            "collision": not np.isfinite(t), "clearance": 0.2 if np.isfinite(t) else 0.0,
        }
        for i, t in enumerate(times)
    ]  # fmt: skip


def test_differences_are_named_beyond_chance_alone() -> None:
    base = rows([10.0 + 0.1 * i for i in range(9)])
    slower = compared(rows([11.0 + 0.2 * i for i in range(9)]), base)
    assert slower["p_time"] == pytest.approx(2.0 / 2**9)  # all nine of one sign, exact
    assert slower["finding"] == "slower"
    few = compared(rows([11.0 + 0.2 * i for i in range(7)]), base[:7])
    assert few["p_time"] == pytest.approx(2.0 / 2**7)
    assert few["finding"] == "no difference shown"
    lost = compared(rows([np.nan] * 8 + [10.8]), base)
    assert lost["p_success"] == pytest.approx(2.0 / 2**8) and lost["p_time"] == 1.0
    assert lost["finding"] == "arrives less often"
    assert lost["p_touch"] == lost["p_success"] and slower["p_touch"] == 1.0
    assert lost["clearance_difference_m"] == pytest.approx(-0.2 * 8 / 9)
    assert compared(base, rows([np.nan] * 8 + [10.8]))["finding"] == "arrives more often"
    assert finding({**slower, "time_difference_s": -1.0}) == "faster"
    assert compared(base, base)["finding"] == "no difference shown"


def test_looks_are_read_as_they_were_written() -> None:
    rng = np.random.default_rng(1)
    sampled = rng.random((3, 5, 3)).astype(np.float32).astype(np.float64)
    sampled[1, 3:] = np.nan
    cells = rng.integers(0, 255, (4, 6)).astype(np.uint8)
    looks = [
        CostmapLook(1.5, Costmap(cells, 0.05, (-1.0, 2.0)), np.zeros((0, 3)), sampled),
        CostmapLook(2.0, Costmap(cells[:2], 0.1, (0.0, 0.0)), sampled[0], np.zeros((0, 0, 3))),
    ]
    content = looks_to_bytes(looks)
    assert looks_to_bytes(looks) == content
    for one, two in zip(looks, looks_from_bytes(content), strict=True):
        assert one.time == two.time and one.costmap.origin == two.costmap.origin
        np.testing.assert_array_equal(one.costmap.cells, two.costmap.cells)
        np.testing.assert_array_equal(one.expected, two.expected)
        np.testing.assert_array_equal(one.sampled, two.sampled)


def test_watching_changes_nothing_and_keeps_looks(study: Nav2Rivals) -> None:
    settings = Settings(time_limit=4.0, history=0.0, channel=Channel(noise=0.0))
    way = Path(np.array([[0.0, 0.0], [6.0, 0.0]]))
    wall = Polygon(((2.0, -0.5), (2.5, -0.5), (2.5, 0.5), (2.0, 0.5)))
    robot = Unicycle(radius=0.22)
    plain = adapted(study.controllers["rpp"], robot, True, CostmapView())
    courses = []
    watched = Watched(adapted(study.controllers["rpp"], robot, True, CostmapView()), every=0.5)
    for controller in (plain, watched):
        agent = RobotAgent("robot", robot, controller, way, 0.3)
        played = Run([agent], settings, 1, (), (), (wall,))
        played.advance()
        courses.append(played.episode().robots[0].positions)
    np.testing.assert_array_equal(*courses)
    assert len(watched.seconds) == pytest.approx(4.0 / plain.period, abs=2)
    assert [look.time for look in watched.looks][:3] == pytest.approx([0.0, 0.5, 1.0])
    assert any((look.costmap.cells == 254).any() for look in watched.looks)


def test_a_place_has_room_for_its_robots(study: Nav2Rivals) -> None:
    with pytest.raises(WideberthError, match=r"place\.radius is 0\.9 m"):
        replace(study.places["corridor"], radius=0.9)
    with pytest.raises(WideberthError, match="baseline is 'theirs'"):
        replace(study, baseline="theirs")


def test_the_quick_study_measures_pairs_and_draws(study: Nav2Rivals, tmp_path: File) -> None:
    """Of the shortest kind: one seed, our planner and two rivals, whose costmap is drawn."""
    small = study.quick()
    assert [*small.controllers] == ["ours", "rpp", "mppi"] and len(small.tasks()) == 3
    few = replace(small, controllers={k: small.controllers[k] for k in ("ours", "rpp")})
    result = run(few, tmp_path / "out")
    ours, rpp = result.rows
    assert ours["recoveries"] is None and rpp["recoveries"] is not None
    assert {one["agent"] for one in result.times} == {"left", "right"}
    assert all(one["tick_median"] > 0.0 for one in result.times)
    draw(tmp_path / "out")
    drawn = {path.name for path in (tmp_path / "out" / "figures").glob("*.png")}
    assert "looks_chicken_game-paper-own-rpp-0.png" in drawn and "outcomes.png" in drawn


def test_the_same_seed_has_the_same_numbers(study: Nav2Rivals) -> None:
    settings = {"scenario": "crossing", "limits": "own", "view": "privileged", "controller": "rpp"}
    task = Task("", 0, settings)
    short = {
        name: replace(place, settings=replace(place.settings, time_limit=6.0))
        for name, place in study.places.items()
    }
    small = replace(study, places=short)
    assert repr(small.measure(task).rows) == repr(small.measure(task).rows)
    assert isinstance(study.limits["own"], LimitSet) and not study.limits["own"].bounded


def test_each_controller_is_compared_with_itself_without_forecasts(tmp_path: File) -> None:
    """The summary has a partner of each; what is left out in quick runs has none."""
    whole, _ = read_experiment("nav2_forecasts", [])
    assert isinstance(whole, Nav2Rivals)
    for name, controller in whole.controllers.items():
        plain = whole.partners.get(name, whole.baseline)
        assert isinstance(controller, Nav2) and isinstance(other := whole.controllers[plain], Nav2)
        if name != plain and controller.forecasts is not None:
            assert replace(controller, forecasts=None).settings == other.settings
            assert other.forecasts is None
    quick = whole.quick()
    assert [*quick.controllers] == ["rpp", "rpp_forecasts", "rpp_now"] and not quick.partners
    short = {
        name: replace(place, settings=replace(place.settings, time_limit=3.0))
        for name, place in quick.places.items()
    }
    pair = {k: whole.controllers[k] for k in ("rpp", "graceful", "graceful_forecasts")}
    few = replace(
        quick, places=short, controllers=pair, partners={"graceful_forecasts": "graceful"}, show=()
    )
    result = run(few, tmp_path / "out")
    partners = {line["controller"]: line["partner"] for line in few.summary(result.rows)}
    assert partners == {"rpp": "rpp", "graceful": "rpp", "graceful_forecasts": "graceful"}
    with pytest.raises(WideberthError, match=r"partners\.rpp is 'itself'"):
        replace(few, partners={"rpp": "itself"})
