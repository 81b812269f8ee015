"""What plans are made from and fall back on, to the step: shapes, clocks, sides, directions."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.progress_robot import progress_robot_of, with_progress
from wideberth.framework.mpc.ocp.reference import Reference
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.emergency import command_of_plan, emergency
from wideberth.framework.mpc.planner.rollout import RobotMotion, sweep
from wideberth.framework.mpc.planner.starts import (
    _headings,
    first_trajectory,
    other_starts,
    remaining_inputs,
)
from wideberth.framework.mpc.planner.stopping import stops
from wideberth.framework.mpc.slots.static_polygons import nearness
from wideberth.framework.predictor import Adaptive, Predictor
from wideberth.framework.tracking.perception import Perception, completed, narrowed, scene_of
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.static import Static
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.planning import approach, at, planner
from wideberth.tests.helpers.problems import set_up


@pytest.mark.parametrize("state", [[1.0, 2.0, 0.3, 0.4, 0.1], [np.nan] * 5, [1.0]], ids=str)
def test_an_emergency_plan_has_the_shape_of_every_plan(state: list[float]) -> None:
    """It stays where it begins: the reference of all N steps is its first position."""
    seen = Observation(0.0, np.zeros(5))
    object.__setattr__(seen, "state", np.array(state))
    plan, command = emergency(Unicycle(), seen, "a test", 7, 0.5)
    assert plan.states.shape == (8, 5) and plan.inputs.shape == (7, 2)
    assert plan.positions.shape == (8, 2) and plan.reference.shape == (7, 2)
    assert plan.auxiliaries.shape[:2] == (7, 0)
    assert plan.level.shape == plan.target.shape == plan.content.shape == (7, 0)
    np.testing.assert_array_equal(plan.reference, np.tile(plan.positions[0], (7, 1)))
    assert np.isfinite(command.linear).all()


def test_a_command_aims_at_the_twist_of_the_next_state() -> None:
    """And at a stop beyond the plan's end."""
    plan, _ = emergency(Unicycle(), Observation(0.0, np.zeros(5)), "a test", 4, 0.5)
    states = plan.states.copy()
    states[:, 3] = 0.1 * np.arange(5.0)
    moving = replace(plan, states=states)
    for step in range(4):
        found = command_of_plan(Unicycle(), moving, step)
        assert found.linear[0] == pytest.approx(0.1 * (step + 1)) and found.ramp == 0.5
    assert command_of_plan(Unicycle(), moving, 4).linear == (0.0, 0.0)


def test_progress_is_along_the_direction_where_the_robot_is() -> None:
    """Round a corner, theta grows by the whole way; a step aside does not count."""
    robot = progress_robot_of(HolonomicVelocity())
    places = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [3.0, 3.0]])
    direction = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0], [1.0, 0.0]])
    reference = Reference(places[1:], direction, np.full(4, 2.0), np.zeros((4, 0)))
    inputs = np.diff(places, axis=0) / 0.5
    found = with_progress(robot, Guess.bare(places, inputs, float("nan")), reference, 3.0, 0.5)
    np.testing.assert_allclose(found.states[:, 2], [3.0, 4.0, 5.0, 6.0, 8.0])
    np.testing.assert_allclose(found.inputs[:, 2], [2.0, 2.0, 2.0, 4.0])
    np.testing.assert_array_equal(found.states[:, :2], places)


def test_a_command_on_its_way_counts_from_when_it_takes_effect() -> None:
    """Asked for at 0.25 s, begun at 0.5 s, reached at 1 s: halfway there at 0.75 s."""
    made = planner(latency=0.25, period=0.25)
    before = made.command(at(0.0, 0.0, v=0.3)).linear[0]  # taken as reached
    after = made.command(at(0.25, 0.075, v=0.3)).linear[0]
    assert abs(after - before) > 0.01
    made.command(at(0.5, 0.15, v=before))
    plan = made.plan
    assert plan is not None and plan.stamp == pytest.approx(0.75)
    halfway = 0.5 * (before + after)
    assert plan.states[0, 3] == pytest.approx(halfway, abs=1e-6)
    assert plan.states[0, 0] == pytest.approx(0.15 + 0.25 * 0.5 * (before + halfway), abs=1e-3)


def test_left_and_right_are_mirrored() -> None:
    """Without a heading they lead aside by 45 degrees at the same speed; with one they turn."""
    start = np.array([0.0, 0.0, 0.3, 0.4])
    left, right = (np.array(sweep(Holonomic(), start, side, 1.0).linear) for side in _SIDES)
    ahead, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    np.testing.assert_allclose(left, 0.5 * (ahead + across) / np.sqrt(2.0))
    np.testing.assert_allclose(right, 0.5 * (ahead - across) / np.sqrt(2.0))
    back = [np.array(sweep(Holonomic(), start, f"back-{one}", 0.2).linear) for one in _SIDES]
    np.testing.assert_allclose(back[0], 0.2 * (-ahead + across) / np.sqrt(2.0))
    np.testing.assert_allclose(back[1], 0.2 * (-ahead - across) / np.sqrt(2.0))
    turning = [sweep(Unicycle(), np.array([0.0, 0.0, 0.3, 0.4, 0.1]), one, 1.5) for one in _SIDES]
    assert [one.angular for one in turning] == [1.5, -1.5]
    assert [one.linear for one in turning] == [(0.4, 0.0)] * 2


_SIDES = ("left", "right")


def test_walls_are_looked_at_as_far_as_a_plan_may_turn_aside() -> None:
    """Body, margin, as far as a plan may turn aside, and 2 deviations of 0.3 m."""
    level = Fixed(0.02275013194817921)  # Phi(-2)
    made = planner(margin=0.1, level=level)
    exact, known = np.zeros((10, 2, 2)), np.tile(np.diag([0.09, 0.01]), (10, 1, 1))
    around = made.robot.radius + made.margin
    assert nearness(around, 2.0, exact, level) == pytest.approx(around + 2.0)
    assert nearness(around, 2.0, known, level) == pytest.approx(around + 2.0 + 0.6)


def test_a_robot_that_stands_goes_aside_from_where_its_path_leads_now() -> None:
    """Not from where it leads behind the next corner: left of east is north-east."""
    robot = HolonomicVelocity()
    problem, parameters, guess = set_up(robot, MahalanobisEllipse(), Fixed(0.05), 1)
    direction = np.tile([0.0, 1.0], (len(parameters.speed), 1))
    direction[0] = 1.0, 0.0
    (left,) = other_starts(
        robot, problem, replace(parameters, direction=direction), guess, ("left",)
    )
    moved = left.states[-1, :2] - left.states[0, :2]
    np.testing.assert_allclose(moved / np.hypot(*moved), np.sqrt([0.5, 0.5]), atol=1e-6)


def test_what_a_plan_breaks_is_listed_worst_first() -> None:
    """Pushed aside from one step on it leaves its dynamics and, far enough, enters the region."""
    made = planner()
    approach(made)
    solve = made.explain()
    meets = int(np.abs(solve.point.states[1:, 0] - 4.0).argmin()) + 1
    lines = []
    for push in (0.5, 3.0):
        states = solve.point.states.copy()
        states[meets:, 1] += push
        states[-1, 3] += 0.2
        text = replace(solve, point=replace(solve.point, states=states)).text()
        lines.append([line for line in text.splitlines() if " at step " in line])
        amounts = [float(line.split(" by ")[1].split()[0]) for line in lines[-1]]
        assert amounts == sorted(amounts, reverse=True), text
    assert any(len(found) == 2 for found in lines), lines


def test_the_last_plan_goes_on_from_where_time_has_come() -> None:
    """Inputs 1, 2, 3 a step: half a step later 1.5, 2.5 and, beyond the end, 1.5."""
    seen = Observation(0.0, np.zeros(4))
    plan = replace(emergency(Holonomic(), seen, "a test", 3, 0.5)[0], stamp=1.0)
    plan = replace(plan, inputs=0.1 * np.array([[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]))
    start = np.array([0.0, 0.0, 0.3, 0.0])

    def left(stamp: float) -> np.ndarray | None:
        return remaining_inputs(Holonomic(), plan, stamp, start, standing=False)

    np.testing.assert_allclose(left(1.25), 0.1 * np.array([[1.5, 0.0], [2.5, 0.0], [1.5, 0.0]]))
    np.testing.assert_array_equal(left(1.0), plan.inputs)
    assert left(0.9) is None  # not yet begun


def test_beyond_its_end_a_plan_coasts_or_stands() -> None:
    """Two steps later, at 0.3 m/s without input: one goes on at that speed, the other brakes."""
    seen = Observation(0.0, np.zeros(4))
    plan, _ = emergency(Holonomic(), seen, "a test", 4, 0.5)
    plan = replace(plan, inputs=np.zeros((4, 2)))
    start = np.array([0.0, 0.0, 0.3, 0.0])
    speeds = []
    for standing in (False, True):
        inputs = remaining_inputs(Holonomic(), plan, 1.0, start, standing=standing)
        speeds.append(first_trajectory(RobotMotion(Holonomic(), 4, 0.5), start, inputs)[0][:, 2])
    np.testing.assert_allclose(speeds[0], 0.3)
    np.testing.assert_allclose(speeds[1][:3], 0.3)
    np.testing.assert_allclose(speeds[1][3:], 0.0, atol=1e-9)


def test_ways_out_of_a_body_without_a_heading_are_along_and_across_its_motion() -> None:
    start = np.array([0.0, 0.0, 0.3, 0.4])
    ahead, left = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    wanted = {"ahead": ahead, "back": -ahead, "left": left, "right": -left}
    found = {name: states for name, states, _ in stops(HolonomicVelocity(), start[:2], 6, 0.5)}
    world = {"ahead": [1.0, 0.0], "back": [-1.0, 0.0], "left": [0.0, 1.0], "right": [0.0, -1.0]}
    for name, way in world.items():  # without inputs it stands: the world's axes
        moved = found[f"{name} for 1.5 s"][-1, :2]
        np.testing.assert_allclose(moved / np.hypot(*moved), way, atol=1e-6)
    found = {name: states for name, states, _ in stops(Holonomic(), start, 60, 0.5)}
    for name, way in wanted.items():
        speed = found[f"{name} for 5 s"][10, 2:]
        np.testing.assert_allclose(speed / np.hypot(*speed), way, atol=1e-3)


def test_ways_out_of_a_robot_with_a_heading_turn_swerve_and_drive_on() -> None:
    """For a sixth, a third and half of the horizon, each then to a stop."""
    start = np.array([0.0, 0.0, 0.3, 0.4, 0.0])
    found = {name: states for name, states, _ in stops(Unicycle(), start, 12, 0.5)}
    ways = ("turning left", "turning right", "swerving left", "swerving right", "ahead", "back")
    lengths = ("1", "2", "3")
    assert list(found) == ["straight", *(f"{way} for {one} s" for way in ways for one in lengths)]
    for way, sign in (("left", 1.0), ("right", -1.0)):
        turning, swerving = found[f"turning {way} for 3 s"], found[f"swerving {way} for 3 s"]
        np.testing.assert_allclose(swerving[:7, 3], 0.4, atol=1e-9)
        assert swerving[6, 4] == pytest.approx(sign * min(1.0, Unicycle().state_bounds().upper[4]))
        assert turning[6, 3] == pytest.approx(0.0, abs=1e-9)
        assert np.sign(turning[6, 2] - 0.3) == sign
    assert found["ahead for 3 s"][6, 3] > 0.4 > 0.0 > found["back for 3 s"][6, 3]


def test_who_has_no_forecast_stays_where_he_was_seen() -> None:
    """Sigma = R + (1 m/s * t)^2 I with t since he was seen, here two steps of 0.5 s ago."""
    places = np.array(
        [[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], [[5.0, 5.0], [np.nan] * 2, [np.nan] * 2]]
    )
    noise = np.stack([0.01 * np.eye(2), np.diag([0.04, 0.09])])
    tracks = Tracks(places, 0.5, ("a", "b"), np.full(2, 0.3), noise)
    known = Forecast.single(np.full((1, 3, 2), 7.0), np.tile(np.eye(2), (1, 3, 1, 1)), 0.5)
    found = completed(known, [0], tracks, (None, "out of order"))
    np.testing.assert_array_equal(found.mean[0], known.mean[0])
    np.testing.assert_array_equal(found.covariance[0], known.covariance[0])
    np.testing.assert_allclose(found.mean[1, 0], [[5.0, 5.0]] * 3)
    wide = np.array([1.5, 2.0, 2.5])[:, None, None] ** 2 * np.eye(2)
    np.testing.assert_allclose(found.covariance[1, 0], noise[1] + wide)
    assert found.fallback == (None, "out of order") and found.weight.tolist() == [[1.0], [1.0]]


@dataclass(frozen=True)
class Told(Adaptive):
    """Forecasts what it is told, in so many steps; raises for names that are in ``bad``."""

    bad: tuple[str, ...] = ()
    change: Any = None
    learnt: int = 0

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        if set(self.bad) & set(tracks.ids):
            raise ValueError("told to")
        if scene is not None and scene.goals is not None:
            assert len(scene.goals) == len(tracks)
        mean = np.tile(np.arange(1.0, steps + 1)[:, None], (len(tracks), 1, 2))
        mean = mean + np.array([10.0 * ord(name) for name in tracks.ids])[:, None, None]
        wide = np.tile(np.eye(2), (len(tracks), steps, 1, 1))
        forecast = Forecast.single(mean, wide, tracks.dt)
        return forecast if self.change is None else self.change(forecast)

    def update(self, tracks: Tracks, scene: Scene | None = None) -> "Told":
        if self.bad:
            raise ValueError("told to")
        return replace(self, learnt=self.learnt + 1)


def perceiving(predictor: Predictor) -> Perception:
    return Perception.initial(predictor, 2, 0.5, 4, 0.25, 3.0)


def observed(time: float, *names: str) -> Observation:
    around = tuple(
        Detection(name, np.array([5.0 * k, 1.0]), 0.01 * np.eye(2), 0.3)
        for k, name in enumerate(names)
    )
    return Observation(time, np.array([0.0, 0.0, 0.0, 0.5, 0.0]), around)


def test_perception_notes_what_the_clock_does() -> None:
    one = perceiving(Told()).take(observed(2.0, "a"))
    assert one.stamp == 2.0 and one.notes == () and list(one.history.logs) == ["a"]
    back = one.take(observed(1.5, "b"))
    assert back.notes == ("clock went back by 0.5 s",) and list(back.history.logs) == ["b"]
    again = back.take(observed(1.5, "b"))
    assert again.notes == back.notes
    empty, notes = again.drained()
    assert empty.notes == () and notes == again.notes and empty.stamp == 1.5
    assert one.take(replace(observed(2.5, "a"), stamp=2.5)).stamp == 2.5
    unknown = observed(3.0, "a")
    object.__setattr__(unknown, "stamp", float("nan"))
    assert one.take(unknown) is one
    coarse = perceiving(Told()).take(observed(2.0**46, "a"))  # steps of 2^-6 s
    assert coarse.notes == (f"clock counts in steps of 0.0156 s at {2.0**46:.3g} s",)
    assert perceiving(Told()).take(observed(2.0**44, "a")).notes == ()


def test_a_predictor_that_raises_while_it_learns_stays_as_it_was() -> None:
    seen = perceiving(Told()).take(observed(0.0, "a"))
    tracks, scene = seen.history.tracks(), Scene(np.zeros(5))
    learnt = seen.learnt(tracks, scene).predictor
    assert isinstance(learnt, Told) and learnt.learnt == 1
    assert seen.learnt(None, scene) is seen
    bad = perceiving(Told(bad=("a",))).take(observed(0.0, "a"))
    after = bad.learnt(tracks, scene)
    assert after.predictor is bad.predictor
    (note,) = after.notes
    assert note.startswith(f"not adapted: ValueError: told to ({__file__}, line ")


def test_a_forecast_reaches_the_last_step_of_the_plan() -> None:
    """0.25 s late, steps of 0.4 s from tracks of 0.5 s: between what was forecast for them."""
    seen = perceiving(Told()).take(observed(0.0, "a", "b"))
    tracks, scene = seen.history.tracks(), Scene(np.zeros(5))
    assert tracks is not None and seen.forecast(None, 0.0, np.ones(1), scene) is None
    grid = 0.4 * np.arange(1.0, 4.0)
    found = seen.forecast(tracks, 0.25, grid, scene)
    assert found is not None and found.dt == pytest.approx(0.4)
    place = (0.25 + grid) / 0.5
    for row, name in enumerate(tracks.ids):
        wanted = np.repeat(10.0 * ord(name) + place[:, None], 2, axis=1)
        np.testing.assert_allclose(found.mean[row, 0], wanted)
    exact = seen.forecast(tracks, 0.0, np.array([0.5, 1.0]), scene)
    assert exact is not None and exact.steps == 2


def test_who_cannot_be_forecast_is_told_apart() -> None:
    seen = perceiving(Told(bad=("b",))).take(observed(0.0, "a", "b", "c"))
    tracks = seen.history.tracks()
    assert tracks is not None
    scene = Scene(np.zeros(5), goals=np.arange(6.0).reshape(3, 2))
    found = seen.forecast(tracks, 0.0, np.array([0.5, 1.0]), scene)
    assert found is not None and found.fallback is not None
    assert found.fallback[::2] == (None, None)
    assert f"ValueError: told to ({__file__}, line " in str(found.fallback[1])
    np.testing.assert_allclose(found.mean[1, 0], tracks.positions[1, -1:].repeat(2, axis=0))
    np.testing.assert_allclose(found.mean[2, 0, :, 0], 990.0 + np.array([1.0, 2.0]))
    with pytest.raises(ValueError, match="told to"):
        broken = perceiving(Told(bad=("a", "b", "c")))
        broken.take(observed(0.0, "a", "b", "c")).forecast(tracks, 0.0, np.array([0.5]), scene)
    assert narrowed(scene, [2, 0]).goals.tolist() == [[4.0, 5.0], [0.0, 1.0]]
    plain = Scene(np.zeros(5))
    assert narrowed(plain, [0]) is plain


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda one: one.mean, "Told.predict returned ndarray"),
        (lambda one: replace(one, dt=0.4), "steps of 0.4 s; asked for 0.5 s"),
        (
            lambda one: Forecast.single(one.mean[:, 0, :1], one.covariance[:, 0, :1], one.dt),
            "forecast 1 obstacles, 1 steps, 2 coordinates; asked for 1, 2, 2",
        ),
    ],
)
def test_a_forecast_of_another_kind_is_refused(change: Any, words: str) -> None:
    seen = perceiving(Told(change=change)).take(observed(0.0, "a"))
    with pytest.raises(WideberthError, match=words):
        seen.forecast(seen.history.tracks(), 0.0, np.array([0.5, 1.0]), Scene(np.zeros(5)))


def test_a_predictor_is_shown_the_last_plan_with_its_times() -> None:
    plan, _ = emergency(Unicycle(), Observation(0.0, np.zeros(5)), "a test", 3, 0.5)
    seen = observed(2.5, "a")
    scene = scene_of(seen, replace(plan, stamp=2.0), 0.4)
    assert scene.radius == 0.4
    np.testing.assert_array_equal(scene.plan, plan.positions)
    np.testing.assert_allclose(scene.plan_times, [2.0, 2.5, 3.0, 3.5])
    np.testing.assert_array_equal(scene.ego, seen.state)
    for known in (None, replace(plan, stamp=2.0**54)):
        bare = scene_of(seen, known, 0.4)
        assert bare.plan is None and bare.plan_times is None


def test_a_direction_of_travel_is_kept_while_standing_and_never_jumps() -> None:
    """A millimetre a second is a motion; a turn past pi goes on past pi."""
    velocities = np.array([[0.0, 0.0], [-1.0, 1e-3], [0.0, 0.0], [-1.0, -1e-3], [0.0, -1e-3]])
    found = _headings(velocities, np.linalg.norm(velocities, axis=1), 3.0)
    wanted = [3.0, np.pi - 1e-3, np.pi - 1e-3, np.pi + 1e-3, 1.5 * np.pi]
    np.testing.assert_allclose(found, wanted, atol=1e-8)
    tiny = np.array([[0.0, 1e-7], [0.0, 1e-5]])
    np.testing.assert_allclose(
        _headings(tiny, np.linalg.norm(tiny, axis=1), 0.3), [0.3, 0.5 * np.pi]
    )


def test_a_pause_far_beyond_the_period_is_said_once() -> None:
    """As where stamps are in ms."""
    known = perceiving(Told())  # called every 0.25 s
    for time in (1000.0, 1005.0):
        known = known.take(observed(time, "a"))
    assert not known.notes  # a pause of 20 periods
    known, notes = known.take(observed(2005.0, "a")).drained()
    assert len(notes) == 1
    assert notes[0].startswith("pause of 1e+03 s between observations, at a period of 0.25 s")
    assert notes[0].endswith("are the stamps in s?")
    assert not known.take(observed(3005.0, "a")).notes
    assert perceiving(Told()).take(observed(0.0)).take(observed(6.0)).notes


@pytest.mark.parametrize(("period", "gap"), [(0.1, 1.25), (0.5, 1.25), (0.8, 2.0)])
def test_two_missing_samples_are_no_gap(period: float, gap: float) -> None:
    """Two and a half of the steps of the tracks, or of the observations if they are longer."""
    assert Perception.initial(Static(), 2, 0.5, 10, period, 3.0).history.gap == pytest.approx(gap)
