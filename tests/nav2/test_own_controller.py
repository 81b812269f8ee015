"""Controllers of ours in Nav2's loop: what they see, when they decide, and what they cannot do."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from wideberth.controllers.constant_velocity import ConstantVelocityController
from wideberth.framework.controller import Controller
from wideberth.framework.plugins.yamlfile import shared_settings
from wideberth.framework.robot import step
from wideberth.framework.testing import check_controller
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan
from wideberth.framework.values.polygon import Polygon
from wideberth.nav2.controllers.local_controller import INVALID_PATH, NO_VALID_CONTROL
from wideberth.nav2.controllers.local_controllers import built
from wideberth.nav2.controllers.own_controller import OwnController
from wideberth.nav2.costmap.local_costmap import CostmapView
from wideberth.nav2.server.navigator import Nav2, Navigation
from wideberth.nav2.server.settings import LoopSettings
from wideberth.robots import Unicycle
from wideberth.tests.nav2.ticks import straight, tick

ROBOT = Unicycle(0.3, 0.7, 1.5, 2.0, 3.0)
TURNING = Command((0.4, 0.0), 0.2, ramp=0.2)
AHEAD = Path([(0.0, 0.0), (4.0, 0.0)])


@dataclass(eq=False)
class Noting(Controller):
    """Notes what it is asked, and commands the same each time."""

    robot: Unicycle = ROBOT
    wanted: Command = TURNING
    period: float = 0.2
    seen: list[Observation] = field(default_factory=list, init=False)

    def reset(self) -> None:
        """Keep everything."""

    def set_path(self, path: Path) -> None:
        self.path = path

    def remember(self, observation: Observation) -> None:
        """Note nothing."""

    def command(self, observation: Observation) -> Command:
        self.seen.append(observation)
        return self.wanted

    @property
    def plan(self) -> Plan | None:
        return None


def person(name: str, x: float, y: float) -> Detection:
    return Detection(name, np.array([x, y]), 1e-4 * np.eye(2), 0.3)


def observed(time: float, *people: Detection, polygons: tuple[Polygon, ...] = ()) -> Observation:
    return Observation(time, np.zeros(5), people, polygons=polygons)


def test_it_decides_at_its_own_period_and_keeps_to_the_ramp_between() -> None:
    own = OwnController(Noting())
    own.new_path(straight(2.0))
    found = [
        own.velocity(tick(straight(2.0), time=0.05 * i, observation=observed(0.05 * i))).twist
        for i in range(6)
    ]
    speeds = [one.linear[0] for one in found if one is not None]
    assert speeds == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.4, 0.4])
    assert isinstance(own.controller, Noting)
    assert [seen.stamp for seen in own.controller.seen] == pytest.approx([0.0, 0.2])
    own.reset()
    again = own.velocity(tick(straight(2.0), time=0.3, observation=observed(0.3)))
    assert again.twist is not None and again.twist.linear[0] == pytest.approx(0.1)


def test_it_learns_of_those_alone_whom_the_costmap_shows() -> None:
    noting = Noting(period=0.05)
    for view, wanted in (
        (CostmapView(), {"near", "beside"}),
        (CostmapView.privileged(), {"near", "beside", "hidden", "away"}),
    ):
        nav2 = Nav2(ROBOT, LoopSettings("own", {"controller": noting}, view=view))
        nav2.set_path(AHEAD)
        box = Polygon(((-1.2, -0.3), (-0.9, -0.3), (-0.9, 0.3), (-1.2, 0.3)), "box")
        far = Polygon(((40.0, 0.0), (41.0, 0.0), (41.0, 1.0)), "far")
        people = (
            person("near", 0.9, 0.0), person("hidden", 1.7, 0.0), person("beside", 0.0, 1.2),
            person("away", 4.0, 3.0), person("very far", 9.0, 0.0),
        )  # fmt: skip
        nav2.command(observed(0.0, *people, polygons=(box, far)))
        own = nav2._server.controller
        assert isinstance(own, OwnController) and isinstance(own.controller, Noting)
        seen = own.controller.seen[-1]
        assert {one.ident for one in seen.detections} == wanted
        assert [one.name for one in seen.polygons] == ["box"]


def test_who_comes_is_seen_at_the_next_look() -> None:
    nav2 = Nav2(ROBOT, LoopSettings("own", {"controller": Noting(period=0.05)}))
    nav2.set_path(AHEAD)
    counts = []
    for i in range(6):
        people = [person("one", 1.0, 0.0)] if i else []
        nav2.command(observed(0.05 * i, *people))
        own = nav2._server.controller
        assert isinstance(own, OwnController) and isinstance(own.controller, Noting)
        counts.append(len(own.controller.seen[-1].detections))
    assert counts == [0, 0, 0, 0, 1, 1]


def test_a_limit_of_speed_slows_it_along_its_arc() -> None:
    own = OwnController(Noting(wanted=Command((0.4, 0.0), 0.2)))
    own.new_path(straight(2.0))
    now = tick(straight(2.0), observation=observed(0.0))
    for value, percentage, wanted in (
        (0.1, False, (0.1, 0.05)), (50.0, True, (0.2, 0.1)), (9.0, False, (0.4, 0.2)),
        (0.0, True, (0.4, 0.2)),
    ):  # fmt: skip
        own.limit_speed(value, percentage)
        twist = own.velocity(now).twist
        assert twist is not None
        assert (twist.linear[0], twist.angular) == pytest.approx(wanted)


def test_what_it_cannot_decide_is_refused_with_a_reason() -> None:
    own = OwnController(Noting())
    seen = tick(straight(1.0), observation=observed(0.0))
    assert own.velocity(seen).error == INVALID_PATH
    own.new_path(np.zeros((2, 3)))  # two equal poses
    assert own.velocity(seen).error == INVALID_PATH
    own.new_path(straight(1.0))
    blind = own.velocity(replace(seen, observation=None))
    assert blind.error == NO_VALID_CONTROL and "observation" in blind.reason
    other = OwnController(ConstantVelocityController(ROBOT))
    other.new_path(straight(1.0))
    short = replace(seen, observation=Observation(0.0, np.zeros(2)))
    assert "the state has 2 entries" in other.velocity(short).reason


def test_it_is_made_of_a_config_for_the_robot_of_the_loop() -> None:
    config = {"type": "constant_velocity", "robot": "unicycle"}
    nav2 = Nav2(ROBOT, LoopSettings("own", {"controller": config}))
    own = nav2._server.controller
    assert isinstance(own, OwnController) and isinstance(
        own.controller, ConstantVelocityController
    )
    assert own.controller.robot == ROBOT
    with pytest.raises(WideberthError, match="did you mean 'controller'"):
        built("own", {"controler": config})
    with pytest.raises(WideberthError, match="no controller"):
        built("own", {})


def test_it_keeps_the_laws_of_controllers() -> None:
    config = {"type": "orca", "robot": "unicycle"}
    check_controller(Nav2(ROBOT, LoopSettings("own", {"controller": config})), cycles=4)


def test_the_recommended_planner_drives_in_the_loop_and_keeps_clear() -> None:
    config = {**shared_settings("recommended"), "robot": "unicycle"}
    nav2 = Nav2(
        ROBOT,
        LoopSettings("own", {"controller": config}, view=CostmapView.privileged()),
        robot_limits=True,
    )  # fmt: skip
    nav2.set_path(AHEAD)
    state, apart = (0.0,) * 5, []
    for k in range(300):
        time = 0.05 * k
        someone = person("one", 4.0 - 0.4 * time, 0.1)
        command = nav2.command(Observation(time, np.array(state), (someone,)))
        assert nav2.reason == ""
        state = step(ROBOT, state, ROBOT.drive(state, command.twist, 0.05), 0.05)
        apart.append(float(np.hypot(*(np.array(state[:2]) - someone.position))) - 0.6)
        if nav2.navigation is not Navigation.FOLLOWING:
            break
    assert nav2.navigation is Navigation.SUCCEEDED and min(apart) > 0.0


def test_a_detection_is_passed_on_as_it_came() -> None:
    """The controller completes it by what it remembers, and its plan says so."""
    planner = {**shared_settings("recommended"), "robot": "unicycle"}
    for inner in (Noting(), planner):
        settings = LoopSettings("own", {"controller": inner}, view=CostmapView.privileged())
        nav2 = Nav2(ROBOT, settings)
        nav2.set_path(AHEAD)
        own = nav2._server.controller
        assert isinstance(own, OwnController)
        for k, radius in enumerate((0.3, np.nan)):
            someone = replace(person("one", 2.0, 0.5), radius=radius)
            nav2.command(observed(own.controller.period * k, someone))
        if isinstance(own.controller, Noting):
            assert own.controller.seen[-1].detections == (someone,)
        else:
            assert own.controller.plan is not None
            assert "radius is nan, taken as 0.3 m" in own.controller.plan.reason


def test_what_is_seen_without_a_place_reaches_the_controller() -> None:
    own = {"controller": {"type": "pure_pursuit", "robot": "unicycle"}}
    found = []
    for places in ([], [(np.nan, 0.0)]):
        nav2 = Nav2(ROBOT, LoopSettings("own", own))
        nav2.set_path(Path([(0.0, 0.0), (3.0, 0.0)]))
        people = tuple(Detection("a", np.array(place), None, 0.3) for place in places)
        for k in range(4):
            command = nav2.command(Observation(k * nav2.period, np.zeros(5), people))
        found.append(float(np.hypot(*command.linear)))
    assert found[0] > 0.0 and found[1] == 0.0
