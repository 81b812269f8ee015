"""People who react: beliefs that find the kind, roll-outs that are the simulation's own future."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from wideberth.controllers.constant_velocity import ConstantVelocityController
from wideberth.controllers.orca import Orca
from wideberth.controllers.social_force import SocialForceController
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Scene
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.tracks import Tracks
from wideberth.people.models import CircularForce, Reciprocal, Straight
from wideberth.people.walls import WallField
from wideberth.predictors.core.person_belief import HypothesisSlots, PersonBeliefs
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.reacting_people import Movers, ReactingPeople, on_grid, rolled_out
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.sensing.channel import Channel

DT, PERIOD, SIGMA = 0.2, 0.25, 0.01
KINDS = {
    "straight": ConstantVelocityController,
    "social_force": SocialForceController,
    "orca": Orca,
}
MODELS = {"straight": Straight(), "social_force": CircularForce(), "orca": Reciprocal()}


def tracks_of(positions, stamp=0.0, dt=DT, radius=0.25):
    """Tracks of people at these positions, (O, T, 2), measured to 1 cm."""
    positions = np.asarray(positions, dtype=float)
    count = len(positions)
    ids = tuple(f"p{i}" for i in range(count))
    spread = np.tile(SIGMA**2 * np.eye(2), (count, 1, 1))
    return Tracks(positions, dt, ids, np.full(count, radius), spread, stamp)


def agent(name, kind, start, goal, speed, person=True):
    body = HolonomicVelocity(radius=0.25, max_speed=speed)
    controller = KINDS[kind](body, PERIOD, speed, look_ahead=np.inf)
    path = Path(np.array([start, goal], dtype=float))
    return RobotAgent(name, body, controller, path, speed, person=person)


def crossing(kinds, reach=1e5, radius=4.0, noise=0.0, seconds=8.0, seed=0):
    """Simulate people who cross a circle, and a robot that crosses it too, all of one law each.

    Goals are so far away that nobody's direction changes.
    """
    people = []
    for k, kind in enumerate(kinds):
        angle = 2.0 * np.pi * (k + 0.5) / (len(kinds) + 1) + 0.1 * k
        place = radius * np.array([np.cos(angle), np.sin(angle)])
        people.append(agent(f"p{k}", kind, place, -reach * place / radius, 1.0 + 0.1 * k))
    robot = agent("robot", "straight", (radius, 0.3), (-reach, 0.3), 0.8, person=False)
    settings = Settings(
        time_limit=seconds, history=1.0, plant_step=0.05, channel=Channel(noise=noise)
    )
    episode = run_episode([robot, *people], settings, seed=seed)
    return episode.times, np.array([one.positions for one in episode.agents])


def at(times, positions, wanted):
    """Positions at other times, (O, T, 2), linear between the instants."""
    return np.stack([[np.interp(wanted, times, column) for column in one.T] for one in positions]
                    ).transpose(0, 2, 1)  # fmt: skip


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_roll_out_is_the_simulations_own_future(kind):
    if kind == "orca":
        pytest.importorskip("pyrvo")
    kinds = [kind] * 5
    times, positions = crossing(kinds)
    now, count = 1.0, 20
    steps = now + PERIOD * np.arange(-1, count + 1)
    true = at(times, positions, steps)
    people = true[1:]
    slots = HypothesisSlots((MODELS[kind],), 0.5)
    known = PersonBeliefs.none(slots, [f"p{i}" for i in range(5)], now, PERIOD)
    state = known.state.copy()
    state[..., :2] = people[:, None, 1]
    state[..., 2:4] = (people[:, None, 1] - people[:, None, 0]) / PERIOD
    goal = -people[:, 0] / np.linalg.norm(people[:, 0], axis=1, keepdims=True)
    angle = 2.0 * np.pi * (np.arange(5) + 0.5) / 6 + 0.1 * np.arange(5)
    goal = -np.stack([np.cos(angle), np.sin(angle)], axis=1)
    state[..., 4:] = ((1.0 + 0.1 * np.arange(5))[:, None] * goal)[:, None]
    weight = np.zeros_like(known.weight)
    weight[:, 0] = 1.0  # the first hypothesis sees the robot, if any does
    known = replace(known, state=state, weight=weight)
    robot = Movers(true[:1, 1:], np.array([0.25]), robot=True)
    found, _ = rolled_out(slots, known, np.full(5, 0.25), robot, WallField(), PERIOD)
    assert np.abs(people[:, 1:] - people[:, :1]).max() > 3.0
    assert np.abs(found[:, 0] - people[:, 1:]).max() < (2e-3 if kind == "orca" else 1e-4)


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_the_belief_finds_the_kind(kind):
    if kind == "orca":
        pytest.importorskip("pyrvo")
    likely = []
    for seed in range(2):
        times, positions = crossing([kind] * 6, noise=SIGMA, radius=3.0, seed=seed)
        grid = DT * np.arange(1, 36)
        noise = SIGMA * np.random.default_rng(seed).standard_normal((7, 35, 2))
        seen = at(times, positions, grid) + noise
        people = ReactingPeople()
        for row in range(2, 35):
            tracks = tracks_of(seen[1:, max(0, row - 20) : row + 1], grid[row])
            ahead = positions[0, np.searchsorted(times, grid[row]) :][::4][:20]
            scene = Scene(
                plan=ahead, plan_times=grid[row] + DT * np.arange(len(ahead)), radius=0.25
            )
            people = people.update(tracks, scene)
        likely += [one.kinds[kind] for one in people.beliefs(tracks, scene)]
    assert np.mean(likely) > {"straight": 0.9, "social_force": 0.8, "orca": 0.6}[kind]


def passing(courteous, seconds=7.0, seed=0):
    """Tracks and scenes of somebody who meets a robot, with the rule of a social force."""
    rng = np.random.default_rng(seed)
    model, steps = CircularForce(), int(seconds / DT)
    place, velocity = np.array([[4.0, 0.25]]), np.array([[-1.2, 0.0]])
    robot = np.array([-4.0, 0.0])
    places, robots = [], []
    from wideberth.people.models import Company, Walkers

    for _ in range(steps):
        places.append(place[0].copy())
        robots.append(robot.copy())
        company = Company(
            robot[None], np.array([[0.8, 0.0]]), np.array([0.4]), np.array([[courteous]]),
            np.zeros((1, 0, 3)),
        )  # fmt: skip
        walkers = Walkers(place, velocity, np.array([[-1.2, 0.0]]), np.array([0.25]))
        velocity = model.next_velocity(walkers, company, DT)
        place, robot = place + DT * velocity, robot + np.array([0.8, 0.0]) * DT
    seen = np.array(places) + SIGMA * rng.standard_normal((steps, 2))
    return seen, np.array(robots)


def followed(people, seen, robots, first=2):
    for row in range(first, len(seen)):
        stamp = DT * row
        tracks = tracks_of(seen[None, max(0, row - 20) : row + 1], stamp)
        plan = robots[row] + np.arange(12)[:, None] * np.array([0.8 * DT, 0.0])
        scene = Scene(plan=plan, plan_times=stamp + DT * np.arange(12), radius=0.4)
        people = people.update(tracks, scene)
    return people, tracks, scene


@pytest.mark.parametrize("courteous", [True, False])
def test_courtesy_is_inferred_from_an_encounter(courteous):
    people = ReactingPeople(models=(CircularForce(),))
    people, tracks, scene = followed(people, *passing(courteous))
    (told,) = people.beliefs(tracks, scene)
    assert told.courtesy > 0.9 if courteous else told.courtesy < 0.1


@pytest.mark.parametrize("assumed", [0.0, 1.0])
def test_certainty_about_courtesy_stays_whatever_is_seen(assumed):
    people = ReactingPeople(courtesy=assumed)
    people, tracks, scene = followed(people, *passing(True))
    (told,) = people.beliefs(tracks, scene)
    assert told.courtesy == pytest.approx(assumed, abs=1e-12)
    assert max(told.kinds.values()) > 0.5  # all else is learnt


def test_who_is_taken_for_blind_is_forecast_as_if_there_were_no_robot():
    seen, robots = passing(True, seconds=2.2)
    people, tracks, scene = followed(ReactingPeople(courtesy=0.0), seen, robots)
    assert not people.reaction(tracks, 20, scene).any()


def test_without_an_encounter_courtesy_stays_at_its_prior():
    seen, robots = passing(True)
    people, tracks, scene = followed(ReactingPeople(courtesy=0.3), seen, robots + 50.0)
    assert people.beliefs(tracks, scene)[0].courtesy == pytest.approx(0.3, abs=0.02)


def test_the_reaction_is_what_the_robot_changes():
    seen, robots = passing(True, seconds=2.2)
    tracks, stamp = tracks_of(seen[None], DT * (len(seen) - 1)), DT * (len(seen) - 1)
    plan = robots[-1] + np.arange(26)[:, None] * np.array([0.8 * DT, 0.0])
    scene = Scene(plan=plan, plan_times=stamp + DT * np.arange(26), radius=0.4)
    people = ReactingPeople()
    change = people.reaction(tracks, 25, scene)
    with_it = people.predict(tracks, 25, scene).mean[:, 0]
    anyway = people.predict(tracks, 25, None).mean[:, 0]
    assert np.abs(change).max() > 0.1
    assert change == pytest.approx(with_it - anyway, abs=1e-9)
    blunt = ReactingPeople(models=(Straight(),)).reaction(tracks, 25, scene)
    assert not blunt.any()
    assert not people.reaction(tracks, 25, replace(scene, plan=plan + 100.0)).round(6).any()
    assert not people.reaction(tracks, 25, Scene()).any()


def test_beliefs_carried_on_are_those_of_the_whole_history():
    seen, _ = passing(False)
    people = ReactingPeople()
    for row in range(len(seen)):
        people = people.update(tracks_of(seen[None, : row + 1], DT * row))
    tracks = tracks_of(seen[None], DT * (len(seen) - 1))
    at_once = ReactingPeople().update(tracks)
    assert people.state.weight == pytest.approx(at_once.state.weight, abs=1e-9)
    assert people.state.state == pytest.approx(at_once.state.state, abs=1e-9)
    again = people.update(tracks)
    assert np.array_equal(again.state.state, people.state.state)


def test_everybody_at_once_is_as_one_by_one():
    seen = np.stack([passing(False, seed=k)[0] + 40.0 * k for k in range(4)])
    together = ReactingPeople().predict(tracks_of(seen), 15)
    for row in range(4):
        alone = ReactingPeople().predict(tracks_of(seen[row : row + 1]), 15)
        assert together.mean[row] == pytest.approx(alone.mean[0], abs=1e-9)
        assert together.covariance[row] == pytest.approx(alone.covariance[0], abs=1e-9)


def test_a_straight_walker_is_forecast_as_by_kalman():
    time = DT * np.arange(20)[:, None]
    way = np.array([1.0, 2.0]) + time * np.array([0.9, 0.4])
    tracks = tracks_of(way[None])
    ours, theirs = (one.predict(tracks, 10).mean[0, 0] for one in (ReactingPeople(), Kalman()))
    assert ours == pytest.approx(theirs, abs=0.02)


def test_who_leaps_begins_anew():
    seen, robots = passing(False)
    seen[-4:] += np.array([30.0, -12.0])
    people, tracks, _ = followed(ReactingPeople(), seen, robots)
    assert people.state.samples[0] == 4
    forecast = people.predict(tracks, 10)
    assert np.abs(forecast.mean[0, 0, 0] - seen[-1]).max() < 1.0
    early, tracks, _ = followed(ReactingPeople(), seen[:-2], robots)
    assert "needs 3" in early.predict(tracks, 10).fallback[0]


def needle(angle, thin, long):
    """Covariance with these eigenvalues, the second along a direction."""
    across = np.array([np.cos(angle), np.sin(angle)])
    along = np.array([-across[1], across[0]])
    return thin * np.outer(across, across) + long * np.outer(along, along)


def noisy(noise, dt):
    """Two people on nearly straight ways, one measured to 1 cm, one with this covariance."""
    rng = np.random.default_rng(0)
    steps = dt * np.array([1.0, -0.5]) + 0.1 * dt * rng.standard_normal((2, 12, 2))
    positions = np.cumsum(steps, axis=1)
    positions[1] += 3.0
    spread = np.stack([SIGMA**2 * np.eye(2), noise])
    return Tracks(positions, dt, ("clear", "noisy"), np.full(2, 0.25), spread, 5.0)


@pytest.mark.parametrize(
    ("thin", "long"),
    [(1e-200, 1e200), (0.0, 1e300), (1e-300, 1e16), (0.0, 1e8), (1e-4, 1e4), (1e-4, 99.0)],
)
def test_noise_shaped_as_a_needle_is_served_at_any_orientation(thin, long):
    for angle in np.linspace(0.0, np.pi, 13):
        for dt in (0.02, 0.1, 1.0):
            tracks = noisy(needle(angle, thin, long), dt)
            people = ReactingPeople().update(tracks)
            forecast = people.predict(tracks, 6)
            assert np.isfinite(forecast.mean).all()
            lowest = np.linalg.eigvalsh(forecast.covariance).min(axis=(1, 2, 3))
            assert (lowest >= -1e-9 * np.abs(forecast.covariance).max(axis=(1, 2, 3, 4))).all()
            if long > 100.0:
                assert "no better than 10 m" in forecast.fallback[1]


@pytest.mark.parametrize("deviation", [1e-3, 0.01, 0.04, 0.1, 0.5, 2.0, 7.0])
def test_what_is_believed_has_no_negative_variance(deviation):
    for dt in (0.02, 0.1, 0.25, 1.0):
        for shape in (np.eye(2), needle(0.7, 1e-6, 1.0)):
            tracks = noisy(deviation**2 * shape, dt)
            for last in range(2, 12):
                begun = replace(tracks, positions=tracks.positions[:, :last])
                values = np.linalg.eigvalsh(ReactingPeople().update(begun).state.covariance)
                assert (values[..., 0] >= -1e-9 * values[..., -1]).all()


def test_who_is_measured_too_coarsely_for_a_while_is_believed_again():
    seen, robots = passing(False)
    people, tracks, scene = followed(ReactingPeople(), seen, robots)
    coarse = replace(tracks, stamp=tracks.stamp + DT, noise=15.0**2 * np.eye(2)[None])
    lost = people.update(coarse, scene)
    assert lost.predict(coarse, 5, scene).fallback[0] == (
        "reacting_people: measured to no better than 10 m"
    )
    assert np.array_equal(lost.state.samples, people.state.samples)
    later = replace(tracks, stamp=tracks.stamp + 2 * DT)
    assert lost.update(later, scene).predict(later, 5, scene).fallback[0] is None


def test_who_moves_like_no_model_is_left_to_the_fallback_with_the_reason():
    rng = np.random.default_rng(7)
    jerks = np.cumsum(0.25 * rng.choice([-1.0, 1.0], (40, 2)), axis=0)
    people, tracks, scene = followed(ReactingPeople(), jerks, np.full((40, 2), 50.0))
    forecast = people.predict(tracks, 10, scene)
    assert "like none of straight, social_force, orca" in forecast.fallback[0]
    assert np.array_equal(forecast.mean, Kalman().predict(tracks, 10).mean)
    (told,) = people.beliefs(tracks, scene)
    assert told.strange > 0.5
    sober, tracks, scene = followed(ReactingPeople(), *passing(False))
    assert sober.beliefs(tracks, scene)[0].strange < 0.2


def test_of_two_hundred_people_the_nearest_are_served():
    rng = np.random.default_rng(8)
    place, pace = rng.uniform(-20, 20, (200, 1, 2)), rng.normal(0, 0.7, (200, 1, 2))
    time = DT * np.arange(-9.0, 1.0)[:, None]
    tracks = tracks_of(place + time * pace)
    scene = Scene(plan=np.zeros((10, 2)) + 0.1 * np.arange(10)[:, None], radius=0.3)
    people = ReactingPeople(most=15)
    forecast = people.update(tracks, scene).predict(tracks, 12, scene)
    served = [row for row, why in enumerate(forecast.fallback) if why is None]
    near = np.argsort(np.linalg.norm(tracks.positions[:, -1] - (0.0, 0.0), axis=1))[:15]
    assert len(set(served) ^ set(near.tolist())) <= 2  # of equal distance to a few centimetres
    far = int(np.argmax(np.linalg.norm(tracks.positions[:, -1], axis=1)))
    assert "not among the nearest 15" in forecast.fallback[far]
    assert len(people.update(tracks, scene).state.ids) == 15


def test_nobody_is_forecast_through_a_wall_without_gaps():
    time = DT * np.arange(-14.0, 1.0)[:, None]
    way = np.array([0.0, 0.0]) + time * np.array([1.0, 0.2])
    sides = [((2, -3), (2.2, -3), (2.2, 3), (2, 3)), ((-4, -3), (-3.8, -3), (-3.8, 3), (-4, 3)),
             ((-4, 3), (2.2, 3), (2.2, 3.2), (-4, 3.2)),
             ((-4, -3.2), (2.2, -3.2), (2.2, -3), (-4, -3))]  # fmt: skip
    walls = tuple(Polygon(side, f"w{k}") for k, side in enumerate(sides))
    people = ReactingPeople(models=(CircularForce(), Reciprocal()))
    free = people.predict(tracks_of(way[None]), 20, Scene()).mean[0, 0]
    kept = people.predict(tracks_of(way[None]), 20, Scene(polygons=walls)).mean[0, 0]
    assert free[:, 0].max() > 3.5
    assert kept[:, 0].max() < 2.0


@pytest.mark.parametrize(
    ("tracks", "steps", "words"),
    [
        (tracks_of(np.zeros((2, 5, 2)), dt=3.0), 4, "steps of 3 s, made for 0.02 to 1 s"),
        (tracks_of(np.zeros((2, 5, 2))), 600, "120 s ahead, at most 100 s"),
        (tracks_of(np.zeros((2, 5, 2))), 4, "1 samples on the way, needs 3"),
    ],
)
def test_what_the_models_are_not_made_for_is_left_to_the_fallback(tracks, steps, words):
    people = ReactingPeople()
    forecast = people.update(tracks).predict(tracks, steps)
    assert words in forecast.fallback[0]
    assert np.array_equal(forecast.mean, people.fallback.predict(tracks, steps).mean)


def test_the_predictor_is_a_plug_in_with_its_models():
    wanted = {"type": "reacting_people", "step": 0.2,
              "models": [{"stiffness": 2.0}, {"most_neighbours": 4}]}  # fmt: skip
    people = build("predictors", wanted)
    assert people.models == (CircularForce(stiffness=2.0), Reciprocal(most_neighbours=4))
    assert build("predictors", describe(people)) == people
    seen, robots = passing(False, seconds=3.0)
    people, tracks, scene = followed(people, seen, robots)
    copy = pickle.loads(pickle.dumps(people))
    assert np.array_equal(
        copy.predict(tracks, 9, scene).mean, people.predict(tracks, 9, scene).mean
    )


def test_numbers_out_of_range_are_refused():
    for words, setting in {
        "courtesy": {"courtesy": 1.5},
        "step": {"step": 0.0},
        "models is empty": {"models": ()},
        "most": {"most": 0},
        "fallback": {"fallback": ReactingPeople()},
    }.items():
        with pytest.raises(WideberthError, match=words):
            ReactingPeople(**setting)


def test_courses_are_read_on_straight_lines():
    courses = np.array([[[0.0, 0.0], [1.0, 2.0], [3.0, 2.0]]])
    found = on_grid(courses, 0.5, np.array([0.0, 0.25, 0.75, 1.0]))
    assert found[0].tolist() == [[0.0, 0.0], [0.5, 1.0], [2.0, 2.0], [3.0, 2.0]]
