"""Models of people: against the library of ORCA, the controllers of simulations, and by hand."""

import numpy as np
import pytest

from wideberth.controllers.social_force import SocialForceController
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon, separation
from wideberth.people._half_planes import compiled, velocities
from wideberth.people.models import (
    CircularForce,
    Company,
    PersonModel,
    Reciprocal,
    Straight,
    Walkers,
)
from wideberth.people.walls import WallField
from wideberth.robots.holonomic_velocity import HolonomicVelocity

MODELS = (Straight(), CircularForce(), Reciprocal())
DT = 0.25


def drawn(rng, count, side=8.0, walls=0):
    """People in a square, each of whom sees all others."""
    place, velocity, wanted = (scale * rng.standard_normal((count, 2)) for scale in (side, 1, 1))
    radius = rng.uniform(0.2, 0.3, count)
    beside = rng.standard_normal((count, walls, 3))
    beside[..., 1:] /= np.linalg.norm(beside[..., 1:], axis=2, keepdims=True)
    seen = ~np.eye(count, dtype=bool)
    company = Company(place, velocity, radius, seen, beside)
    return Walkers(place, velocity, wanted, radius), company


def alone(place=(0.0, 0.0), velocity=(1.0, 0.0), wanted=(1.0, 0.0), bodies=(), walls=()):
    """One walker of 0.25 m among bodies (x, y, vx, vy) of the same size."""
    around = np.reshape(np.array(bodies, float), (-1, 4))
    seen = np.ones((1, len(around)), dtype=bool)
    beside = np.reshape(np.array(walls, float), (1, -1, 3))
    company = Company(around[:, :2], around[:, 2:], np.full(len(around), 0.25), seen, beside)
    one = (np.array([value], float) for value in (place, velocity, wanted))
    return Walkers(*one, np.array([0.25])), company


def test_orca_is_that_of_the_library():
    pyrvo = pytest.importorskip("pyrvo")
    rng, gaps = np.random.default_rng(0), []
    for _ in range(60):
        walkers, company = drawn(rng, int(rng.integers(2, 25)), rng.uniform(1.0, 6.0))
        fastest = np.linalg.norm(walkers.wanted, axis=1)
        world = pyrvo.RVOSimulator(DT, 10.0, 10, 5.0, 5.0, 0.3, 1.3)
        for i, place in enumerate(walkers.place):
            size = walkers.radius[i] + 0.01
            pace = tuple(walkers.velocity[i])
            world.add_agent(tuple(place), 10.0, 10, 5.0, 5.0, size, fastest[i], pace)
            world.set_agent_pref_velocity(i, tuple(walkers.wanted[i]))
        world.do_step()
        asked = [world.get_agent_velocity(i) for i in range(len(fastest))]
        wanted = np.array([(one.x, one.y) for one in asked])
        gaps += list(np.abs(Reciprocal().next_velocity(walkers, company, DT) - wanted).max(axis=1))
    assert np.quantile(gaps, 0.98) < 2e-5
    assert max(gaps) < 5e-3  # the library counts in single precision


def test_the_force_is_that_of_the_people_in_simulations():
    rng = np.random.default_rng(1)
    for _ in range(5):
        walkers, company = drawn(rng, 6, 1.5)
        speed = float(np.linalg.norm(walkers.wanted[0]))
        body = HolonomicVelocity(radius=float(walkers.radius[0]), max_speed=speed)
        person = SocialForceController(body, DT, speed, look_ahead=np.inf)
        here = walkers.place[0]
        person.set_path(Path(np.stack([here, here + 100.0 * walkers.wanted[0]])))
        for back in (DT, 0.0):
            seen = [
                Detection(f"{i}", place - back * pace, 1e-4 * np.eye(2), float(size))
                for i, (place, pace, size) in enumerate(
                    zip(walkers.place, walkers.velocity, walkers.radius, strict=True)
                )
                if i
            ]
            person.remember(Observation(5.0 - back, here, tuple(seen)))
        person._velocity = walkers.velocity[0]
        told = person.command(Observation(5.0, here, tuple(seen))).linear
        found = CircularForce().next_velocity(walkers, company, DT)[0]
        assert found == pytest.approx(np.array(told), abs=1e-9)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_many_at_once_are_each_as_alone(model: PersonModel):
    walkers, company = drawn(np.random.default_rng(2), 30, 2.0, walls=3)
    together = model.next_velocity(walkers, company, DT)
    for i in range(30):
        row = slice(i, i + 1)
        one = Walkers(*(getattr(walkers, name)[row] for name in vars(walkers)))
        around = Company(
            company.place, company.velocity, company.radius, company.seen[row], company.walls[row]
        )
        assert np.array_equal(model.next_velocity(one, around, DT)[0], together[i])


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_turning_the_world_turns_the_velocity(model: PersonModel):
    walkers, company = drawn(np.random.default_rng(3), 12, 2.0, walls=2)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    moved = Walkers(*(getattr(walkers, n) @ turn.T for n in ("place", "velocity", "wanted")),
                    walkers.radius)  # fmt: skip
    beside = np.concatenate([company.walls[..., :1], company.walls[..., 1:] @ turn.T], axis=2)
    around = Company(company.place @ turn.T, company.velocity @ turn.T, company.radius,
                     company.seen, beside)  # fmt: skip
    found = model.next_velocity(moved, around, DT)
    assert found == pytest.approx(model.next_velocity(walkers, company, DT) @ turn.T, abs=1e-9)


def test_who_meets_nobody_walks_as_he_wants():
    walkers, company = alone(velocity=(0.2, 0.0), wanted=(0.0, 1.0))
    assert Straight().next_velocity(walkers, company, DT)[0].tolist() == [0.0, 1.0]
    assert Reciprocal().next_velocity(walkers, company, DT)[0].tolist() == [0.0, 1.0]
    pulled = CircularForce().next_velocity(walkers, company, DT)[0]
    assert pulled == pytest.approx([0.2 * (1 - DT), DT])


def test_who_is_not_seen_plays_no_part():
    walkers, company = drawn(np.random.default_rng(4), 5, 0.5)
    blind = Company(company.place, company.velocity, company.radius,
                    np.zeros((5, 5), dtype=bool), company.walls)  # fmt: skip
    nobody = Company(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0),
                     np.zeros((5, 0), dtype=bool), company.walls)  # fmt: skip
    for model in MODELS:
        found = model.next_velocity(walkers, blind, DT)
        assert np.array_equal(found, model.next_velocity(walkers, nobody, DT))


def test_orca_reaches_a_wall_no_sooner_than_its_horizon():
    # 1.0 m from the centre to the wall ahead; 1.0 - 0.26 m from the surface, in 5 s.
    walkers, company = alone(walls=[(1.0, -1.0, 0.0)])
    found = Reciprocal().next_velocity(walkers, company, DT)[0]
    assert found == pytest.approx([(1.0 - 0.26) / 5.0, 0.0])


def test_a_wall_pushes_as_written():
    walkers, company = alone(walls=[(0.27, -1.0, 0.0)])
    found = CircularForce().next_velocity(walkers, company, DT)[0]
    assert found == pytest.approx([1.0 - DT * 2.0 * np.exp((0.26 - 0.27) / 0.025), 0.0])


def test_two_in_one_place_have_no_direction_and_finite_velocities():
    walkers, company = alone(bodies=[(0.0, 0.0, 1.0, 0.0)])
    for model in MODELS:
        assert np.isfinite(model.next_velocity(walkers, company, DT)).all()
    assert Reciprocal().next_velocity(walkers, company, DT)[0].tolist() == [1.0, 0.0]


def test_exactly_head_on_both_pass_on_the_same_side():
    meeting = [(2.0, 0.0, -1.0, 0.0)]
    found = Reciprocal().next_velocity(*alone(bodies=meeting), DT)[0]
    other = Reciprocal().next_velocity(
        *alone((2.0, 0.0), (-1.0, 0.0), (-1.0, 0.0), [(0.0, 0.0, 1.0, 0.0)]), DT
    )[0]
    assert found[1] != 0.0
    assert other == pytest.approx(-found)


def test_the_nearest_count_where_there_are_many():
    leaving = [(-1.0 - 0.5 * k, 0.0, -1.0, 0.0) for k in range(3)]
    crowd = [(4.0, 0.1, -1.0, 0.0), *leaving]
    few = Reciprocal(most_neighbours=3).next_velocity(*alone(bodies=crowd), DT)[0]
    assert few.tolist() == [1.0, 0.0]
    assert Reciprocal(most_neighbours=4).next_velocity(*alone(bodies=crowd), DT)[0][1] != 0.0
    short = Reciprocal(neighbour_distance=3.0).next_velocity(*alone(bodies=crowd), DT)[0]
    assert short.tolist() == [1.0, 0.0]


def test_plain_and_compiled_are_the_same():
    walkers, company = drawn(np.random.default_rng(5), 14, 1.0, walls=2)
    others = np.concatenate([company.place, company.velocity, company.radius[:, None]], axis=1)
    settings = np.array([10.0, 10, 5.0, 5.0, DT])
    given = (walkers.place, walkers.velocity, walkers.wanted, np.ones(14), walkers.radius, others,
             company.seen, company.walls, settings)  # fmt: skip
    assert compiled()(*given) == pytest.approx(velocities(*given), abs=1e-12)


def test_walls_are_as_far_as_their_nearest_part():
    el = Polygon(((0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)), "el")
    box = Polygon(((5, 0), (6, 0), (6, 1), (5, 1)), "box")
    places = np.array([[2.0, 2.0], [-1.0, 0.5], [5.5, 4.0]])
    found = WallField((el, box)).beside(places)
    for place, row in zip(places, found, strict=True):
        for wall, polygon in zip(row, (el, box), strict=True):
            gaps = [separation(place[None], part) for part in polygon.parts]
            distance, away = min(gaps, key=lambda one: float(one[0]))
            assert wall == pytest.approx(np.array([float(distance), *away]))
    assert WallField((el, box)).nearest(places[2:], 1).polygons == (box,)
    assert WallField().beside(places).shape == (3, 0, 3)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: CircularForce(stiffness=0.0), "circular_force.stiffness"),
        (lambda: CircularForce(strength=-1.0), "circular_force.strength"),
        (lambda: Reciprocal(most_neighbours=0), "reciprocal.most_neighbours"),
        (lambda: Reciprocal(time_horizon=0.0), "reciprocal.time_horizon"),
    ],
)
def test_numbers_out_of_range_are_refused(make, words):
    with pytest.raises(WideberthError, match=words):
        make()
