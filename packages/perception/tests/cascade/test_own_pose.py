"""The error of the own pose: it counts before walls on a map, and cancels for what is seen."""

from typing import Any

import numpy as np
import pytest

from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.rollout import follow
from wideberth.framework.mpc.slots.base import PlanningContext
from wideberth.framework.mpc.slots.static_polygons import StaticPolygons
from wideberth.framework.robot import step
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.predictors.static import Static
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.static.separating_line import StaticSeparatingLine
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.sensing.perceived import MotionEstimate
from wideberth.solvers.fatrop import Fatrop
from wideberth_perception.detection.discs import DiscDetector
from wideberth_perception.state_estimator import Sample, StateEstimator

pytest.importorskip("mujoco", reason="pip install 'wideberth[perception]'")
from wideberth_perception.cascade.cascade import SensingPipeline
from wideberth_perception.cascade.senses import Senses

MEAN = np.array([1.0, -2.0, 0.6, 0.4, 0.0, 0.05])
ROOT = np.random.default_rng(0).standard_normal((6, 12))
DEVIATIONS = np.array([0.06, 0.08, 0.02, 0.02, 1e-4, 0.01]) / np.sqrt((ROOT**2).sum(axis=1))
COVARIANCE = (ROOT @ ROOT.T) * np.outer(DEVIATIONS, DEVIATIONS)
MAP = (Polygon(((3.0, 1.0), (6.0, 1.0), (6.0, 2.0), (3.0, 2.0)), "shelf"),)
SEEN = np.array([4.0, 0.5])
"""m, place of somebody in the robot's own frame."""
CONTENT, BOUND = 0.95, 5.991


class Sure(StateEstimator):
    """Says of any time that the robot is where it is on the map, and how sure that is."""

    def reset(self, pose: np.ndarray, time: float) -> None:
        pass

    def take(self, sample: Sample) -> str:
        return ""

    def at(self, time: float) -> MotionEstimate:
        return MotionEstimate(time, MEAN, COVARIANCE, "map")


def turned(angle: float, points: np.ndarray) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return points @ np.array([[cosine, sine], [-sine, cosine]])


def told(walls: Any, polygons: tuple[Polygon, ...] = MAP) -> Observation:
    """Return what a robot tells its controller, with somebody seen at `SEEN`."""
    cascade = SensingPipeline(
        mechanics="kinematic", state=Sure(), detector=DiscDetector(), walls=walls
    )
    senses = Senses(Unicycle(), cascade, "a", MEAN[:3], 0.0, np.random.default_rng(0))
    place = MEAN[:2] + turned(MEAN[2], SEEN)
    return senses.observation((Detection("b", place, 1e-8 * np.eye(2), 0.3),), polygons)


def viewed(seen: Observation, monkeypatch: pytest.MonkeyPatch) -> PlanningContext:
    """Return what a planner makes of an observation."""
    views: list[PlanningContext] = []
    choose = StaticPolygons.choose

    def watched(self: StaticPolygons, robot: Any, view: PlanningContext) -> Any:
        views.append(view)
        return choose(self, robot, view)

    monkeypatch.setattr(StaticPolygons, "choose", watched)
    planner = Planner(
        Unicycle(),
        MahalanobisEllipse(),
        Static(),
        Fixed(),
        Fatrop(),
        static_region=StaticSeparatingLine(),
    )
    planner.set_path(Path(np.array([[0.0, -2.0], [20.0, 8.0]])))
    planner.command(seen)
    assert planner.plan is not None and not planner.plan.reason
    return views[-1]


def covered(off: np.ndarray, spread: np.ndarray) -> float:
    """Return the share of errors (K, 2) within the region of 95 %."""
    return float((np.einsum("ki,ij,kj->k", off, np.linalg.inv(spread), off) < BOUND).mean())


def test_relative_places_are_as_sure_as_the_planner_takes_them_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Robots drawn from the covariance drive on; where are the shelf and the other from there?"""
    seen = told("known")
    view = viewed(seen, monkeypatch)
    robot, steps, rng, count = Unicycle(), len(view.own), np.random.default_rng(1), 4000
    still = np.zeros((steps, 2))
    believed = follow(robot, seen.state, still, 0.5)
    assert np.allclose(believed[1:, :2], view.planned, atol=1e-6)  # which it is linearised along
    drawn = rng.multivariate_normal(MEAN, COVARIANCE, count)
    other = drawn[:, :2] + np.array([turned(row[2], SEEN) for row in drawn])
    cloud = tuple(drawn[:, [0, 1, 2, 3, 5]].T)
    within = 3.0 * np.sqrt(CONTENT * (1.0 - CONTENT) / count)
    for i in range(steps):
        cloud = step(robot, cloud, (0.0, 0.0), 0.5)
        place = np.stack(cloud[:2], axis=-1)
        corner = MAP[0].points[0]
        on_map = (corner - place) - (corner - believed[i + 1, :2])
        unturned = MEAN[2] - drawn[:, 2]
        pairs = zip(unturned, other - place, strict=True)
        away = np.array([turned(angle, to) for angle, to in pairs])
        from_here = away - (seen.detections[0].position - believed[i + 1, :2])
        assert covered(on_map, view.own_on_map[i]) == pytest.approx(CONTENT, abs=within)
        assert covered(from_here, view.own[i]) == pytest.approx(CONTENT, abs=within)
        if i == 0:  # later ones are uncertain by the speed, which both have
            assert covered(on_map, view.own[i]) < 0.2
            assert covered(from_here, view.own_on_map[i]) > 0.999


def test_the_pose_counts_once_and_where_it_belongs() -> None:
    on_map, from_here = told("known"), told("seen")
    taken = np.ix_([0, 1, 2, 3, 5], [0, 1, 2, 3, 5])
    assert on_map.map_covariance is not None and from_here.map_covariance is None
    assert np.allclose(on_map.map_covariance, COVARIANCE[taken], atol=1e-12)
    for one in (on_map, from_here):
        assert one.covariance is not None and not one.covariance[:3].any()
    assert told("known", ()).map_covariance is None  # there is no map


def test_one_covariance_alone_holds_for_both(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of positions that come by radio: they are known on the map too."""
    seen = told("known")
    radio = Observation(0.0, seen.state, seen.detections, seen.map_covariance, MAP)
    view, both = viewed(radio, monkeypatch), viewed(seen, monkeypatch)
    assert np.array_equal(view.own, view.own_on_map)
    assert np.array_equal(view.own_on_map, both.own_on_map)
