"""The game: rounds of responses, who takes part, and what it says of two who meet."""

import pickle
from dataclasses import dataclass, replace

import numpy as np
import pytest

from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.solver import Solver
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Rung
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.core.best_response import BestResponsePlanner, Player, state_of
from wideberth.predictors.game import Game, Table
from wideberth.predictors.oracle import Oracle
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.holonomic_3d import Holonomic3D

DT = 0.5
EGO = np.array([0.0, 0.0, 0.0, 0.5, 0.0])
GAME = Game()


def driving(places, velocities, samples=20, radius=0.75):
    """Tracks of robots that drive straight and are at these places now."""
    time = DT * np.arange(1 - samples, 1)[:, None]
    positions = np.array(places, float)[:, None] + time * np.array(velocities, float)[:, None]
    count = len(positions)
    ids = tuple(f"o{i}" for i in range(count))
    noise = np.tile(1e-4 * np.eye(2), (count, 1, 1))
    return Tracks(positions, DT, ids, np.full(count, radius), noise)


MEETING = driving([(6.0, 0.3)], [(-0.5, 0.0)])
CROWD = driving(
    [(6.0, 0.3), (3.0, 5.0), (-4.0, 0.5), (30.0, 3.0)],
    [(-0.5, 0.0), (0.0, -0.5), (0.6, 0.0), (-0.5, 0.0)],
)
PLAN = np.stack([0.25 * np.arange(16.0), 0.02 * np.arange(16.0)], axis=1)


class Echo:
    """Stands in for a responder: an agent answers with shares of what the others do."""

    def __init__(self, shares, offset, broken=()):
        self.shares, self.offset, self.broken = shares, offset, broken

    def respond(self, agent, others, radii):
        if agent.radius in self.broken:
            return "no way"
        times = np.arange(4.0)
        places = np.zeros((4, 2))
        if others is not None:
            assert len(radii) == len(others.mean)
            total = others.mean[:, 0].sum(axis=0)
            places[1:] = self.offset + self.shares[agent.radius] * total
        return times, places


def table_of(echo, agents):
    """A table at which all straight motions are zero."""
    straight = Forecast.single(np.zeros((agents - 1, 3, 2)), np.zeros((agents - 1, 3, 2, 2)), 1.0)
    players = tuple(Player(EGO, np.array([1.0, 0.0]), 0.5, float(i)) for i in range(agents))
    return Table(echo, players, tuple(range(agents - 1)), straight, np.arange(1.0, 4.0))


def test_rounds_are_half_steps_towards_the_answers():
    played = table_of(Echo({0: -0.5, 1: 0.4}, 1.0), 2).play(5)
    x, step = np.zeros(2), np.zeros(2)
    for _ in range(5):
        step = 1.0 + np.array([-0.5 * x[1], 0.4 * x[0]]) - x
        x = x + 0.5 * step
    np.testing.assert_allclose(played.bent, np.broadcast_to(x[:, None, None], (2, 3, 2)))
    np.testing.assert_allclose(played.unsettled[:, 0, 0], 0.5 * step)
    assert not played.failures


def test_rounds_settle_where_full_steps_go_to_and_fro():
    # Both give way by 1 where the other does not, and not at all where it does: x = 1 - y.
    played = table_of(Echo({0: -1.0, 1: -1.0}, 1.0), 2).play(30)
    np.testing.assert_allclose(played.bent, 0.5, atol=1e-6)
    np.testing.assert_allclose(played.unsettled, 0.0, atol=1e-6)


def test_who_has_no_plan_keeps_its_way_and_is_still_seen():
    played = table_of(Echo({0: 1.0, 2: 1.0}, 1.0, broken=(1.0,)), 3).play(2)
    assert played.failures == {1: "no way"}
    assert not played.bent[1].any() and not played.unsettled[1].any()
    assert played.bent[0].all() and played.bent[2].all()
    broken = table_of(Echo({}, 1.0, broken=(0.0,)), 2).play(2)
    assert broken.failures == {0: "no way"} and not broken.bent.any()


class Stumbling(Echo):
    """Finds no plan at some of its calls; each round asks the robot (0) first."""

    def __init__(self, *calls):
        super().__init__({0: -0.5, 1: 0.4}, 1.0)
        self.calls, self.asked = calls, -1

    def respond(self, agent, others, radii):
        self.asked += 1
        return "no way" if self.asked in self.calls else super().respond(agent, others, radii)


def test_only_a_failure_of_the_last_round_counts():
    # Calls 0 and 1 are alone; 2 and 3 the first round, 4 and 5 the second.
    assert table_of(Stumbling(2, 3), 2).play(2).failures == {}
    other = table_of(Stumbling(5), 2).play(2)
    assert other.failures == {1: "no way"}
    assert not other.bent[1].any() and other.bent[0].all()
    robot = table_of(Stumbling(4), 2).play(2)
    assert robot.failures == {0: "no way"}
    assert not robot.bent.any() and not robot.unsettled.any()


def test_the_other_is_expected_to_give_way_as_the_robot_does():
    scene = Scene(ego=EGO)
    forecast = GAME.predict(MEETING, 15, scene)
    straight = GAME.planner.predictor.predict(MEETING, 15)
    assert forecast.fallback == (None,)
    robot = EGO[:2] + DT * np.arange(1, 16)[:, None] * (0.5, 0.0)
    apart, before = (
        np.linalg.norm(f.mean[0, 0] - robot, axis=1).min() for f in (forecast, straight)
    )
    assert apart > before + 0.5
    wider = forecast.covariance - straight.covariance
    assert np.linalg.eigvalsh(wider).min() > -1e-12
    joint = forecast.joint[0, 0].reshape(15, 2, 15, 2)
    each = np.arange(15)
    np.testing.assert_allclose(joint[each, :, each], forecast.covariance[0, 0], atol=1e-12)


def test_two_alike_bend_alike():
    responder = BestResponsePlanner(GAME.planner)
    way = np.array([1.0, 0.0])
    one = Player(np.array([-3.0, -0.1, 0.0, 0.5, 0.0]), way, 0.5, 0.75)
    two = Player(np.array([3.0, 0.1, np.pi, 0.5, 0.0]), -way, 0.5, 0.75)
    grid = DT * np.arange(1.0, 16.0)
    places = responder.respond(two, None, ())[1][1:]
    spread = 0.01 * grid[:, None, None] ** 2 * np.eye(2)
    table = Table(
        responder, (one, two), (0,), Forecast.single(places[None], spread[None], DT), grid
    )
    played = table.play(4)
    np.testing.assert_allclose(played.bent[0], -played.bent[1], atol=1e-6)
    assert np.abs(played.bent).max() > 0.2


def test_nobody_in_the_way_leaves_the_straight_forecast():
    tracks = driving([(40.0, 0.0)], [(0.5, 0.0)])
    forecast = GAME.predict(tracks, 15, Scene(ego=EGO))
    straight = GAME.planner.predictor.predict(tracks, 15)
    np.testing.assert_allclose(forecast.mean, straight.mean, atol=1e-4)
    np.testing.assert_allclose(forecast.covariance, straight.covariance, atol=1e-6)


def test_it_turns_with_the_world_and_does_not_mind_the_order():
    scene = Scene(ego=EGO, plan=PLAN, plan_times=DT * np.arange(16) - 0.5, radius=0.75)
    forecast = GAME.predict(CROWD, 15, scene)
    np.testing.assert_array_equal(GAME.predict(CROWD, 15, scene).mean, forecast.mean)
    angle, shift = 1.1, np.array([20.0, -7.0])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    state = np.array([*(turn @ EGO[:2] + shift), EGO[2] + angle, *EGO[3:]])
    moved = replace(scene, ego=state, plan=PLAN @ turn.T + shift)
    tracks = replace(CROWD, positions=CROWD.positions @ turn.T + shift)
    found = GAME.predict(tracks, 15, moved)
    np.testing.assert_allclose(found.mean, forecast.mean @ turn.T + shift, atol=1e-6)
    np.testing.assert_allclose(found.covariance, turn @ forecast.covariance @ turn.T, atol=1e-6)
    order = [2, 0, 3, 1]
    again = GAME.predict(CROWD.select(order), 15, scene)
    np.testing.assert_allclose(again.mean, forecast.mean[order], atol=1e-9)
    assert again.fallback == tuple(forecast.fallback[i] for i in order)
    copy = pickle.loads(pickle.dumps(GAME))
    np.testing.assert_array_equal(copy.predict(CROWD, 15, scene).mean, forecast.mean)


def test_obstacles_that_do_not_take_part_say_why():
    positions = CROWD.positions.copy()
    positions[0] = positions[0, -1]
    positions[1, :-1] = np.nan
    tracks = replace(CROWD, positions=positions)
    forecast = replace(GAME, agents=1).predict(tracks, 6, Scene(ego=EGO))
    assert forecast.fallback[0] == "game: stands (0.00 m/s)"
    assert forecast.fallback[1] == "game: 1 samples, needs 2"
    assert forecast.fallback[2] is None
    assert forecast.fallback[3] == "game: not among the nearest 1"
    straight = GAME.planner.predictor.predict(tracks, 6)
    for row in (0, 1, 3):
        np.testing.assert_allclose(forecast.mean[row], straight.mean[row], atol=1e-12)
        np.testing.assert_allclose(forecast.covariance[row], straight.covariance[row], atol=1e-15)


@pytest.mark.parametrize(
    ("scene", "reason"),
    [
        (None, "the robot's state is not given"),
        (Scene(plan=PLAN), "the robot's state is not given"),
        (Scene(ego=EGO[:4]), "the robot's state has 4 entries, needs 5"),
        (Scene(ego=EGO * np.nan), "the robot's state is not finite"),
    ],
)
def test_without_the_robot_there_is_no_game(scene, reason):
    forecast = GAME.predict(MEETING, 4, scene)
    assert forecast.fallback == (f"game: {reason}",)
    straight = GAME.planner.predictor.predict(MEETING, 4)
    np.testing.assert_allclose(forecast.mean, straight.mean, atol=1e-12)
    space = Tracks(np.zeros((1, 3, 3)), DT, ("a",), np.ones(1), np.eye(3)[None])
    assert GAME.predict(space, 2, scene).fallback == ("game: 3 coordinates, made for 2",)


@dataclass(frozen=True)
class Broken(Solver):
    """A solver that cannot."""

    def solve(self, problem, parameters, guesses, deadline=None):
        raise RuntimeError("out of order")


def test_an_inner_planner_that_fails_is_a_reason():
    game = Game(replace(GAME.planner, solver=Broken()))
    forecast = game.predict(MEETING, 4, Scene(ego=EGO))
    assert "game: no plan for the robot" in forecast.fallback[0]
    assert "out of order" in forecast.fallback[0]


def test_bodies_of_another_size_than_the_robot_keep_the_sum_of_radii():
    responder = BestResponsePlanner(GAME.planner)
    told = GAME.planner.predictor.predict(MEETING, 15)
    way, state = np.array([1.0, 0.0]), state_of(GAME.planner.robot, EGO[:2], EGO[3:], EGO[3:])
    np.testing.assert_allclose(state, EGO, atol=1e-12)
    plans = [
        responder.respond(Player(state, way, 0.5, own), told, (other,))[1]
        for own, other in ((0.75, 0.75), (0.5, 1.0), (0.2, 0.3))
    ]
    np.testing.assert_allclose(plans[0], plans[1], atol=1e-9)
    assert np.abs(plans[0] - plans[2]).max() > 0.1


def test_a_robot_without_heading_plays_where_its_plan_tells_its_way():
    planner = replace(GAME.planner, robot=Holonomic())
    state = np.array([0.0, 0.0, 0.5, 0.0])
    game, scene = Game(planner), Scene(ego=state)
    assert "no heading" in game.predict(MEETING, 15, scene).fallback[0]
    found = game.predict(MEETING, 15, replace(scene, plan=PLAN))
    assert found.fallback == (None,)
    straight = planner.predictor.predict(MEETING, 15)
    assert np.abs(found.mean - straight.mean).max() > 0.3


def test_games_about_games_and_numbers_out_of_range_are_refused():
    for inner in (GAME, Oracle(fallback=GAME)):
        with pytest.raises(WideberthError, match=r"is, or holds, a game"):
            Game(replace(GAME.planner, predictor=inner))
    flying = replace(GAME.planner, robot=Holonomic3D(), static_region=None)  # of the plane
    with pytest.raises(WideberthError, match=r"moves in 3 dimensions; wanted 2"):
        Game(flying)
    for name, value in {"iterations": 0, "agents": 0}.items():
        with pytest.raises(WideberthError, match=f"game.{name}"):
            Game(GAME.planner, **{name: value})


def test_a_config_states_its_planner():
    game = build("predictors", {"type": "game", "iterations": 2, "planner": {"margin": 0.3}})
    assert (game.iterations, game.planner.margin) == (2, 0.3)
    assert game.planner.horizon == GAME.planner.horizon
    config = describe(game)
    assert build("predictors", config) == game != GAME
    assert config["planner"]["predictor"]["type"] == "kalman"
    assert describe(build("predictors", config)) == config


def test_a_planner_that_plays_commands_without_errors():
    planner = replace(GAME.planner, predictor=GAME)
    assert isinstance(planner, Planner)
    planner.set_path(Path(np.array([[0.0, 0.0], [20.0, 0.0]])))
    for tick in range(6):
        other = Detection("b", np.array([6.0 - 0.25 * tick, 0.3]), 1e-4 * np.eye(2), 0.75)
        planner.command(Observation(0.5 * tick, EGO, (other,)))
    plan = planner.plan
    assert plan is not None and plan.rung is Rung.OPTIMAL
    assert plan.fallbacks == (None,)
