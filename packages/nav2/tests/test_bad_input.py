"""Bad input to every controller in the loop: a status by Nav2's name, a reason, no accident."""

from typing import Any

import numpy as np
import pytest

from wideberth.framework.robot import step
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.robots import Unicycle
from wideberth_nav2.controllers.local_controllers import shipped_parameters
from wideberth_nav2.costmap.local_costmap import CostmapView
from wideberth_nav2.server.navigator import Nav2, Navigation
from wideberth_nav2.server.server import ServerStatus
from wideberth_nav2.server.settings import LoopSettings

ROBOT = Unicycle(0.3, 0.7, 1.5, 2.0, 3.0)
SMALL: dict[str, dict[str, Any]] = {
    "mppi": {"batch_size": 200}, "mppi_foresight": {"batch_size": 200},
    "dwb": {"vx_samples": 6, "vtheta_samples": 9, "max_vel_x": 0.5, "max_speed_xy": 0.5},
}  # fmt: skip
LOCAL = [
    "dwb", "graceful", "mppi", "mppi_foresight", "regulated_pure_pursuit", "rotation_shim",
    "teb", "vector_pursuit",
]  # fmt: skip


def nav2_of(local: str, **other: Any) -> Nav2:
    """Return a loop that gives up at once, and after 4 s without progress."""
    parameters = {**shipped_parameters(local), **SMALL.get(local, {})}
    settings = LoopSettings(
        local, parameters, recoveries={"number_of_retries": 0},
        progress_checker={"movement_time_allowance": 4.0}, **other,
    )  # fmt: skip
    return Nav2(ROBOT, settings)


def ended(
    nav2: Nav2, path: list[tuple[float, float]], seconds: float, *places: tuple[float, float]
) -> list[str]:
    """Drive from the origin; return each reason once, none of which may be an accident."""
    nav2.set_path(Path(path))
    people = tuple(
        Detection(str(i), np.array(place), 1e-4 * np.eye(2), 0.3) for i, place in enumerate(places)
    )
    state, reasons = (0.0,) * 5, []
    for k in range(round(seconds / nav2.period)):
        command = nav2.command(Observation(k * nav2.period, np.array(state), people))
        assert np.isfinite((*command.linear, command.omega)).all()
        if nav2.reason and nav2.reason not in reasons:
            reasons.append(nav2.reason)
        state = step(ROBOT, state, ROBOT.drive(state, command.twist, nav2.period), nav2.period)
        if nav2.navigation in (Navigation.SUCCEEDED, Navigation.FAILED):
            break
    assert not any("Error" in one or "Exception" in one for one in reasons), reasons
    return reasons


@pytest.mark.parametrize("local", LOCAL)
def test_a_path_outside_the_map_is_invalid(local: str) -> None:
    nav2 = nav2_of(local)
    reasons = ended(nav2, [(50.0, 0.0), (52.0, 0.0)], 1.0)
    assert nav2.navigation is Navigation.FAILED
    assert len(reasons) == 1 and reasons[0].startswith(f"{ServerStatus.INVALID_PATH}: no pose")


@pytest.mark.parametrize("local", LOCAL)
def test_a_path_of_two_almost_equal_poses_is_followed_to_its_place(local: str) -> None:
    nav2 = nav2_of(local)
    assert not ended(nav2, [(0.0, 0.0), (1e-7, 0.0)], 1.0)
    assert nav2.navigation is Navigation.SUCCEEDED
    nav2 = nav2_of(local)
    ended(nav2, [(0.8, 0.0), (0.8 + 1e-7, 0.0)], 10.0)
    assert nav2.navigation is Navigation.SUCCEEDED


def test_a_path_of_two_equal_points_is_refused() -> None:
    with pytest.raises(WideberthError, match="repeats the point before it"):
        Path([(1.0, 0.0), (1.0, 0.0)])


@pytest.mark.parametrize("local", LOCAL)
def test_a_goal_in_an_obstacle_ends_in_a_failure_by_its_name(local: str) -> None:
    nav2 = nav2_of(local)
    reasons = ended(nav2, [(0.0, 0.0), (2.0, 0.0)], 40.0, (2.0, 0.0))
    assert nav2.navigation is Navigation.FAILED
    ends = (
        ServerStatus.PATIENCE_EXCEEDED,
        ServerStatus.NO_VALID_CONTROL,
        ServerStatus.FAILED_TO_MAKE_PROGRESS,
    )
    assert reasons and nav2.reason.startswith(tuple(f"{one}: " for one in ends))


@pytest.mark.parametrize("local", LOCAL)
def test_a_costmap_smaller_than_the_look_ahead(local: str) -> None:
    nav2 = nav2_of(local, view=CostmapView(width=0.8, height=0.8))
    reasons = ended(nav2, [(0.0, 0.0), (3.0, 0.0)], 5.0)
    if nav2.navigation is Navigation.FAILED:  # an outline that leaves the map has collided
        assert nav2.reason.startswith(f"{ServerStatus.PATIENCE_EXCEEDED}: no valid control")
    else:  # it looks no farther than the map, and drives, perhaps slowly
        assert local in ("dwb", "graceful", "mppi", "mppi_foresight")
        assert all(one.startswith(ServerStatus.FAILED_TO_MAKE_PROGRESS) for one in reasons)


@pytest.mark.parametrize("local", LOCAL)
def test_it_stands_while_an_obstacle_has_no_place(local: str) -> None:
    nav2 = nav2_of(local)
    found = ended(nav2, [(0.0, 0.0), (3.0, 0.0)], 0.5, (np.nan, 0.0), (np.inf, 1e300))
    assert found == ["seen without a place: '0', '1'"]
    assert nav2.navigation is Navigation.FOLLOWING
