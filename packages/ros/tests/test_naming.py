"""Obstacles that share one identity, or have none, all reach the planner, each by one name."""

from typing import Any

import numpy as np
import pytest

from wideberth.packages.ros.tests.test_forecast_node import Loop as ForecastLoop
from wideberth.packages.ros.tests.test_node import Loop
from wideberth.tests.helpers.bags import header, obstacle, vector
from wideberth_ros.messages import messages
from wideberth_ros.naming import ObstacleNames
from wideberth_ros.obstacle_sources import MOST_SEEN, ObstacleTopic

pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")

PLACES = ((1.5, 0.0), (6.0, 4.0))
"""m: one right ahead of the robot, one far aside."""


def nav2(loop: Any, places: Any, ident: Any = 0) -> Any:
    found = [obstacle(ident, *place) for place in places]
    stamp = header(loop.stamp(), "odom")
    return messages().make("nav2_dynamic_msgs/msg/ObstacleArray", header=stamp, obstacles=found)


def costmap(loop: Any, places: Any, ident: Any = 0) -> Any:
    known = messages()
    found = []
    for x, y in places:
        point = known.make("geometry_msgs/msg/Point32", x=x, y=y)
        polygon = known.make("geometry_msgs/msg/Polygon", points=[point])
        found.append(
            known.make(
                "costmap_converter_msgs/msg/ObstacleMsg", polygon=polygon, radius=0.3, id=ident
            )
        )
    kind, stamp = "costmap_converter_msgs/msg/ObstacleArrayMsg", header(loop.stamp(), "odom")
    return known.make(kind, header=stamp, obstacles=found)


def gaussians(loop: Any, places: Any, ident: Any = 0) -> Any:
    known = messages()
    poses = [known.make("geometry_msgs/msg/Pose", position=vector("Point", *p)) for p in places]
    found = [known.make("mpc_planner_msgs/msg/ObstacleGMM", id=ident, pose=pose) for pose in poses]
    kind, stamp = "mpc_planner_msgs/msg/ObstacleArray", header(loop.stamp(), "odom")
    return known.make(kind, header=stamp, obstacles=found)


def boxes(loop: Any, places: Any, ident: Any = "") -> Any:
    known = messages()
    found = []
    for place in places:
        centre = known.make("geometry_msgs/msg/Pose", position=vector("Point", *place))
        box = known.make("vision_msgs/msg/BoundingBox3D", center=centre)
        found.append(known.make("vision_msgs/msg/Detection3D", id=ident, bbox=box))
    kind, stamp = "vision_msgs/msg/Detection3DArray", header(loop.stamp(), "odom")
    return known.make(kind, header=stamp, detections=found)


@pytest.mark.parametrize(
    ("make", "ident"),
    [(nav2, 0), (nav2, 7), (costmap, 0), (costmap, 5), (costmap, -1), (gaussians, 0),
     (boxes, ""), (boxes, "person")],
)  # fmt: skip
def test_obstacles_of_one_identity_are_all_seen_and_keep_their_names(
    make: Any, ident: Any
) -> None:
    """The last one was taken: who stood ahead vanished, and the robot drove on."""
    kind = make(Loop(), (), ident).__msgtype__
    loop = Loop(sees=ObstacleTopic(kind=kind))
    loop.path()
    walked: dict[str, list[np.ndarray]] = {}
    for k in range(20):
        places = [(x, y + 0.05 * k) for x, y in PLACES][:: 1 if k % 2 else -1]  # in any order
        loop.come("/obstacles", make(loop, places, ident))
        loop.turn(people=False)
        for one in loop.controller.seen[-1].detections:
            walked.setdefault(one.ident, []).append(one.position)
    assert sorted(map(len, walked.values())) == [20, 20]
    for path in walked.values():
        np.testing.assert_allclose(np.diff(path, axis=0), [[0.0, 0.05]] * 19, atol=1e-6)
    assert loop.node.status == "driving"
    loop.node.publish_diagnostics()
    said = loop.network.wires["/diagnostics"].gone[-1].status[0]
    assert "2 obstacles have no identity of their own" in said.message and said.level == 1
    assert ("without an identity", "2") in {(one.key, one.value) for one in said.values}


def test_identities_that_differ_stay_as_they_are() -> None:
    loop = Loop()
    loop.path()
    loop.turn()
    loop.node.publish_diagnostics()
    said = loop.network.wires["/diagnostics"].gone[-1].status[0]
    assert said.message == "driving" and said.level == 0
    assert loop.controller.seen[-1].detections[0].ident == "01" * 16


def test_the_node_of_forecasts_sees_all_too() -> None:
    loop = ForecastLoop()
    for _ in range(10):
        loop.now = round(loop.now + 0.1, 9)
        loop.odom()
        found = [obstacle(0, *place) for place in PLACES]
        stamp = header(1000.0 + loop.now, "odom")
        kind = "nav2_dynamic_msgs/msg/ObstacleArray"
        loop.come("/obstacles", messages().make(kind, header=stamp, obstacles=found))
    assert loop.node.publish()
    assert all(loop.grid().at(np.array(place), outside=0) == 100 for place in [PLACES[0]])
    assert len(loop.sent("gaussians").obstacles) == 2
    loop.node.publish_diagnostics()
    values = loop.network.wires["/diagnostics"].gone[-1].status[0].values
    assert ("without an identity", "2") in {(one.key, one.value) for one in values}


def test_names_that_are_given_are_no_names_of_the_sender() -> None:
    names = ObstacleNames()
    places = np.array([[0.0, 0.0], [3.0, 0.0], [6.0, 0.0], [9.0, 0.0]])
    found = names.named(0.0, ["1", "", "unnamed 1", "unnamed 2"], places)
    assert len(set(found)) == 4 and found[0] == "1" and names.count == 3


def test_an_identity_that_was_shared_once_is_not_trusted_again() -> None:
    """Else a class name would come and go as an identity with each second person."""
    names = ObstacleNames()
    both = names.named(0.0, ["person", "person"], np.array([[0.0, 0.0], [5.0, 0.0]]))
    assert names.named(0.1, ["person"], np.array([[5.0, 0.1]])) == (both[1],)


def test_an_obstacle_without_a_place_does_not_take_the_name_of_another() -> None:
    names = ObstacleNames()
    places = np.array([[np.nan, 0.0], [2.0, 0.0], [1e300, 0.0]])
    found = names.named(0.0, ["", "", ""], places)
    assert len(set(found)) == 3 and names.named(0.1, [""], places[1:2]) == (found[1],)


def test_obstacles_of_which_nothing_is_known_are_handed_on() -> None:
    """A polygon without corners was left out; a size that is none counted as not stated."""
    loop = Loop(sees=ObstacleTopic(kind="costmap_converter_msgs/msg/ObstacleArrayMsg"))
    loop.path()
    message = costmap(loop, PLACES)
    message.obstacles[0].polygon.points.clear()
    message.obstacles[1].radius = np.nan
    loop.come("/obstacles", message)
    loop.turn(people=False)
    first, second = loop.controller.seen[-1].detections
    assert not np.isfinite(first.position).any() and np.isnan(second.radius)


@pytest.mark.parametrize("bad", [-0.04, np.nan])
def test_a_covariance_that_is_none_is_handed_on_as_it_came(bad: float) -> None:
    """The controller has one rule for it; here it would only be hidden."""
    loop = Loop()
    loop.path()
    message = nav2(loop, PLACES[:1], 1)
    message.obstacles[0].position_covariance[[0, 4]] = bad
    message.obstacles[0].size.x = 80.0
    loop.come("/obstacles", message)
    loop.turn(people=False)
    (seen,) = loop.controller.seen[-1].detections
    assert seen.covariance is not None and seen.flaw and seen.radius == 40.0
    np.testing.assert_array_equal(np.diagonal(seen.covariance), [bad, bad])


def test_the_nearest_of_very_many_are_seen_and_the_rest_is_said() -> None:
    loop = Loop()
    loop.path()
    places = [(50.0 + 0.01 * k, 0.0) for k in range(12 * MOST_SEEN)] + [(2.0, 0.0)]
    message = nav2(loop, places, 1)
    for k, one in enumerate(message.obstacles):
        one.uuid.uuid[:4] = np.frombuffer(np.uint32(k + 1).tobytes(), np.uint8)
    loop.come("/obstacles", message)
    loop.turn(people=False)
    nearest = min(one.position[0] for one in loop.controller.seen[-1].detections)
    assert nearest == 2.0 and len(loop.controller.seen[-1].detections) == MOST_SEEN
    assert loop.node.counts.refused == 1


def test_covariances_turn_with_the_frame_of_the_message() -> None:
    from wideberth.tests.helpers.bags import transform

    loop = Loop()
    loop.path()
    loop.turn()
    loop.come("/tf", transform(1000.0, "odom", "camera", (1.0, 2.0, 0.6)))
    message = nav2(loop, PLACES[:1], 1)
    message.header.frame_id = "camera"
    message.obstacles[0].position_covariance[[0, 1, 3, 4]] = [0.09, 0.01, 0.01, 0.04]
    loop.come("/obstacles", message)
    loop.turn(people=False)
    (seen,) = loop.controller.seen[-1].detections
    assert seen.covariance is not None
    turn = np.array([[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]])
    wanted = turn @ np.array([[0.09, 0.01], [0.01, 0.04]]) @ turn.T
    np.testing.assert_allclose(seen.covariance, wanted, atol=1e-12)
