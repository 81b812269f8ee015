"""The contact to expect, against dense looks, drawn futures, shapely and closed forms."""

from dataclasses import dataclass, replace
from itertools import product
from math import exp, pi

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation

from wideberth.controllers.judging.expected_contact import (
    AHEAD,
    CERTAIN,
    FADING,
    TURNING,
    ContactJudge,
    ExpectedContact,
)
from wideberth.controllers.judging.first_contacts import compiled, expected, passing, walled
from wideberth.framework.plugins.config import build
from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.footprint import Discs
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.tracks import Tracks
from wideberth.robots.unicycle import Unicycle

DT, STEPS = 0.2, 12
ROBOT = Unicycle(0.3, 1.0, 1.0, 0.7, 1.0)
CORNER = Path(np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 6.0]]))
LASTING = np.exp(-np.maximum(DT * (np.arange(STEPS) + 0.5) - CERTAIN, 0.0) / FADING)
EL = Polygon(((0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (1.0, 1.0), (1.0, 2.5), (0.0, 2.5)), "el")
SHED = Polygon(((-3.0, -2.0), (-1.5, -2.5), (-1.0, -1.2), (-2.4, -0.8)), "shed")


def wandering(rng: np.random.Generator, *shape: int, size: int = 2) -> Array:
    """Places of random walks of 12 steps, m."""
    begin = rng.uniform(-2.0, 2.0, (*shape, 1, size))
    steps = rng.normal(0.0, 0.25, (*shape, STEPS, size)) + rng.normal(0.0, 0.2, (*shape, 1, size))
    return np.concatenate([begin, begin + steps.cumsum(axis=-2)], axis=-2)


def looked_at(body: Array, other: Array, looks: int) -> Array:
    """Distance of two that move from step to step, at many looks, (N, looks), m."""
    share = np.linspace(0.0, 1.0, looks)[:, None]
    away = body - other
    between = (1.0 - share) * away[:-1, None] + share * away[1:, None]
    return np.asarray(np.linalg.norm(between, axis=2))


@pytest.mark.parametrize("size", [2, 3])
def test_first_contact_and_least_gap_are_those_of_a_dense_look(size: int) -> None:
    rng, room, apart, touched = np.random.default_rng(size), 0.4, 0.6 * (size - 1), 0
    for _ in range(60):
        body, other = wandering(rng, size=size), wandering(rng, size=size)
        gaps = looked_at(body, other, 10_000).min(axis=1) - apart
        hit, lost = passing(body, other, apart, room, LASTING)
        if np.abs(gaps).min() < 1e-5:
            continue  # the looks miss a graze
        inside = np.flatnonzero(gaps <= 0.0)
        first = inside[0] if inside.size else STEPS
        shares = LASTING[:first] * np.clip(1.0 - gaps[:first] / room, 0.0, 1.0)
        wanted = max([*shares, LASTING[first] if inside.size else 0.0])
        assert hit == (LASTING[first] if inside.size else 0.0)
        assert lost == pytest.approx(wanted, abs=1e-4)
        touched += bool(inside.size)
    assert 10 < touched < 50


def test_two_that_stand_touch_where_their_bodies_do() -> None:
    body, other = np.zeros((STEPS + 1, 2)), np.tile([0.9, 0.0], (STEPS + 1, 1))
    assert passing(body, other, 0.9, 0.2, LASTING) == (1.0, 1.0)
    assert passing(body, other, 0.8, 0.2, LASTING) == pytest.approx((0.0, 0.5))
    assert passing(body, other, 0.7, 0.2, LASTING) == pytest.approx((0.0, 0.0))


def crowd(
    rng: np.random.Generator, size: int = 2, parts: int = 2, people: int = 3, modes: int = 4
) -> tuple[Array, Array, Array, Array]:
    """Discs of five trajectories, rooms, futures and weights, some of which are 0."""
    weights = rng.dirichlet(np.ones(modes), people)
    weights[0, 1] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    rooms = rng.uniform(0.4, 0.9, (parts, people))
    centres = wandering(rng, 5, parts, size=size)
    return centres, rooms, wandering(rng, people, modes, size=size), weights


def asked(
    centres: Array, rooms: Array, futures: Array, weights: Array, *, fast: bool = True
) -> tuple[Array, Array]:
    risk, near = np.zeros(len(centres)), np.zeros(len(centres))
    ask = compiled()[0] if fast else expected
    ask(centres, rooms, futures, weights, 0.3, LASTING, risk, near)
    return risk, near


@pytest.mark.parametrize("size", [2, 3])
def test_drawn_futures_are_spared_as_often_as_expected(size: int) -> None:
    """One mode of each person is drawn: a contact in it, by a dense look, counts g(t) of 1."""
    rng, draws = np.random.default_rng(10 + size), 20_000
    given = centres, rooms, futures, weights = crowd(rng, size)
    risk, _ = asked(*given)
    people, modes = weights.shape
    for c in range(len(centres)):
        counted = np.zeros((people, modes))
        for o, m, b in product(range(people), range(modes), range(len(rooms))):
            met = looked_at(centres[c, b], futures[o, m], 2000).min(axis=1) < rooms[b, o]
            counted[o, m] = max(counted[o, m], LASTING[met.argmax()] if met.any() else 0.0)
        drawn = np.stack([rng.choice(modes, draws, p=own) for own in weights], axis=1)
        hits = rng.random((draws, people)) < counted[np.arange(people), drawn]
        share = hits.any(axis=1).mean()
        deviation = np.sqrt(max(risk[c] * (1.0 - risk[c]), 1e-9) / draws)
        assert abs(share - risk[c]) <= 3.0 * deviation + 1e-12
    assert 0.05 < risk.mean() < 0.95


@pytest.mark.parametrize(("size", "parts", "people"), [(2, 1, 3), (2, 3, 2), (3, 2, 4), (2, 1, 0)])
def test_compiled_loops_give_the_numbers_of_plain_python(
    size: int, parts: int, people: int
) -> None:
    rng = np.random.default_rng(3)
    given = crowd(rng, size, parts, max(people, 1))
    if not people:
        given = given[0], given[1][:, :0], given[2][:0], given[3][:0]
    for one, other in zip(asked(*given), asked(*given, fast=False), strict=True):
        assert one == pytest.approx(other, abs=1e-12)
    corners, radii = np.stack([np.array(SHED.vertices)]), np.full(parts, 0.3)
    risks = [np.zeros(5), np.zeros(5)]
    for ask, risk in zip((compiled()[1], walled), risks, strict=True):
        ask(given[0][..., :2].copy(), radii, corners, risk)
    assert risks[0].tobytes() == risks[1].tobytes()


def test_modes_of_weight_0_say_nothing_even_where_they_are_no_numbers() -> None:
    centres, rooms, futures, weights = crowd(np.random.default_rng(4))
    spoilt = futures.copy()
    spoilt[weights == 0.0] = np.nan
    for one, other in zip(
        asked(centres, rooms, futures, weights), asked(centres, rooms, spoilt, weights),
        strict=True,
    ):  # fmt: skip
        assert one.tobytes() == other.tobytes()


# ---- The whole cost


@dataclass(frozen=True)
class Seen:
    """People whose futures are given, (O, M, N, D), m."""

    futures: Array
    weights: Array
    radius: float = 0.3

    @property
    def forecast(self) -> Forecast:
        count, modes, steps, size = self.futures.shape
        covariance = np.broadcast_to(1e-4 * np.eye(size), (count, modes, steps, size, size))
        return Forecast(self.futures, covariance, self.weights, DT, (None,) * count)

    @property
    def tracks(self) -> Tracks:
        count, size = len(self.futures), self.futures.shape[3]
        names, radii = tuple(map(str, range(count))), np.full(count, self.radius)
        noise = np.broadcast_to(1e-4 * np.eye(size), (count, size, size))
        return Tracks(self.futures[:, :1, 0], DT, names, radii, noise, 0.0)


def judge(
    seen: Seen | None = None,
    *,
    robot: Robot = ROBOT,
    settings: ExpectedContact | None = None,
    path: Path = CORNER,
    arc: float = 0.0,
    walls: tuple[Polygon, ...] = (),
    margins: tuple[float, float] = (0.0, 0.0),
) -> ContactJudge:
    known = None if seen is None else (seen.forecast, seen.tracks)
    made = settings or ExpectedContact()
    return made.judge(robot, DT, (path, arc, 1.0), known, walls, margins)


def straight(
    begin: tuple[float, float] = (0.0, 0.0), heading: float = 0.0, speed: float = 1.0
) -> Array:
    """States of a unicycle that drives straight on, (1, N + 1, 5)."""
    gone = speed * DT * np.arange(STEPS + 1)
    states = np.zeros((1, STEPS + 1, 5))
    states[0, :, 0] = begin[0] + gone * np.cos(heading)
    states[0, :, 1] = begin[1] + gone * np.sin(heading)
    states[0, :, 2:4] = heading, speed
    return states


@pytest.mark.parametrize("heading", [0.0, 0.4, -1.2, 2.0, pi])
@pytest.mark.parametrize("speed", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("begin", [(0.0, 0.0), (1.0, 1.5), (4.0, -0.5), (4.5, 2.5)])
def test_without_people_it_is_way_left_heading_and_slowness(
    begin: tuple[float, float], heading: float, speed: float
) -> None:
    states = straight(begin, heading, speed)
    end = states[0, -1, :2]
    arc = CORNER.project(end)
    left = CORNER.length - arc + np.linalg.norm(end - CORNER.at(np.array(arc)))
    ahead = CORNER.at(np.array(arc + AHEAD)) - end
    off = abs(np.angle(np.exp(1j * (np.arctan2(ahead[1], ahead[0]) - heading))))
    slow = (1.0 - speed) ** 2 / (2.0 * 0.7)
    found = judge(arc=CORNER.project(np.array(begin))).costs(states)
    assert found == pytest.approx([left + off / TURNING + slow], abs=1e-6)


@pytest.mark.parametrize("speed", [1.2, 1.5, 2.0])
def test_nothing_is_gained_by_driving_faster_than_the_reference(speed: float) -> None:
    """Straight along the path all cost the same at its speed and above."""
    path = Path(np.array([[0.0, 0.0], [30.0, 0.0]]))
    usual, faster = (judge(path=path).costs(straight(speed=one)) for one in (1.0, speed))
    assert faster == pytest.approx(usual)


def test_who_is_near_the_goal_may_be_slow_and_look_anywhere() -> None:
    path = Path(np.array([[-3.0, 0.0], [0.1, 0.0]]))
    found = judge(path=path, arc=3.0).costs(straight((0.0, 0.0), 2.5, 0.0))
    assert found == pytest.approx([0.1])


def test_a_robot_without_heading_pays_for_none() -> None:
    robot = build("robots", {"type": "holonomic_velocity", "radius": 0.3})
    found = judge(robot=robot).costs(straight((0.0, 0.0), 1.0)[..., :2])
    end = straight((0.0, 0.0), 1.0)[0, -1, :2]
    arc = CORNER.project(end)
    left = CORNER.length - arc + np.linalg.norm(end - CORNER.at(np.array(arc)))
    assert found == pytest.approx([left])


def test_the_way_left_is_sought_near_the_robot_where_a_path_comes_back() -> None:
    """Its last leg is beside its first one: who is on the first has the whole way to go."""
    path = Path(np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 1.0], [0.0, 1.0]]))
    found = judge(path=path).costs(straight((1.0, 0.6)))
    assert found[0] > path.length - 4.0


def standing(x: float, y: float, weights: tuple[float, ...] = (1.0,)) -> Seen:
    """One person who stands; all modes but the first are far away."""
    futures = np.full((1, len(weights), STEPS, 2), 50.0)
    futures[0, 0] = x, y
    return Seen(futures, np.array([weights]))


def test_a_contact_costs_its_weight_and_less_the_later_it_is() -> None:
    settings = ExpectedContact(25.0, 0.0)
    free = judge(settings=settings).costs(straight())
    before = np.inf
    for x in np.arange(0.7, 2.9, 0.1):
        found = judge(standing(x, 0.0), settings=settings).costs(straight()) - free
        step = np.ceil((x - 0.6) / DT - 1e-9)
        late = max((step - 0.5) * DT - 1.0, 0.0)
        assert found == pytest.approx([25.0 * exp(-late / 1.2)])
        assert found[0] <= before
        before = found[0]
    half = judge(standing(0.7, 0.0, (0.5, 0.5)), settings=settings).costs(straight()) - free
    assert half == pytest.approx([12.5])


@pytest.mark.parametrize("name", ["price", "closeness", "room"])
def test_more_of_each_price_costs_no_less(name: str) -> None:
    rng = np.random.default_rng(5)
    seen = Seen(wandering(rng, 4, 3)[:, :, 1:], rng.dirichlet(np.ones(3), 4))
    states = np.concatenate([straight(heading=angle) for angle in np.linspace(-pi, pi, 15)])
    least, before = ExpectedContact(5.0, 0.5, 0.1), None
    for factor in (1.0, 2.0, 5.0):
        settings = replace(least, **{name: factor * getattr(least, name)})
        found = judge(seen, settings=settings).costs(states)
        assert before is None or ((found >= before - 1e-12).all() and (found > before).any())
        before = found


def test_margins_and_discs_count() -> None:
    """A disc ahead of the axle is touched first; a margin is as good as a larger person."""
    settings = ExpectedContact(25.0, 0.0)
    long = replace(ROBOT, radius=0.6, footprint=Discs(((0.3, 0.0), (-0.3, 0.0)), 0.3))
    for robot, reach in ((ROBOT, 0.3), (long, 0.6)):
        for margin in (0.0, 0.25):
            ends = 2.4 + reach + 0.3 + margin
            for x, hit in ((ends - 1e-6, True), (ends + 1e-6, False)):
                given = {"robot": robot, "settings": settings}
                free = judge(**given).costs(straight())  # type: ignore[arg-type]
                seen = judge(standing(x, 0.0), margins=(margin, 9.0), **given)  # type: ignore[arg-type]
                assert (seen.costs(straight()) > free)[0] == hit
    aside = standing(1.2, 0.75)  # the enclosing disc of 0.6 m would touch it
    assert judge(aside, robot=long, settings=settings).costs(straight()) == pytest.approx(
        judge(robot=long, settings=settings).costs(straight())
    )


def test_a_person_is_where_the_forecast_comes_from_at_first() -> None:
    """Half a step before a straight mode's first place it crosses the way of the robot."""
    gone = DT * np.arange(1, STEPS + 1)
    futures = np.stack([0.5 + 0.0 * gone, 8.0 * (gone - 0.5 * DT) + 0.05], axis=1)[None, None]
    found = judge(Seen(futures, np.ones((1, 1))), settings=ExpectedContact(25.0, 0.0))
    free = judge(settings=ExpectedContact(25.0, 0.0))
    states = straight(speed=0.5)
    assert found.costs(states) - free.costs(states) == pytest.approx([25.0])


def test_walls_count_by_their_distance_however_late() -> None:
    rng = np.random.default_rng(6)
    solid = shapely.union_all([shapely.Polygon(wall.vertices) for wall in (EL, SHED)])
    settings = ExpectedContact(25.0, 0.0)
    hits = 0
    for _ in range(150):
        states = straight(tuple(rng.uniform(-4.0, 4.0, 2)), rng.uniform(-pi, pi))
        places = shapely.points(states[0, 1:, :2])
        inside = np.flatnonzero(shapely.distance(solid, places) < 0.35)
        walled_in = judge(settings=settings, walls=(EL, SHED), margins=(9.0, 0.05))
        more = walled_in.costs(states) - judge(settings=settings).costs(states)
        wanted = 25.0 if inside.size else 0.0
        assert more == pytest.approx([wanted], abs=1e-9)
        hits += bool(inside.size)
    assert 20 < hits < 130


def test_turning_and_moving_the_world_changes_no_cost() -> None:
    rng = np.random.default_rng(7)
    seen = Seen(wandering(rng, 3, 4)[:, :, 1:], rng.dirichlet(np.ones(4), 3))
    turn = np.array(Rotation.from_euler("z", 0.7).as_matrix()[:2, :2])
    shift = np.array([300.0, -200.0])
    states = np.concatenate([straight(heading=angle) for angle in np.linspace(-1.0, 1.0, 9)])
    moved = states.copy()
    moved[..., :2] = states[..., :2] @ turn.T + shift
    moved[..., 2] += 0.7
    other = Seen(seen.futures @ turn.T + shift, seen.weights)
    path = Path(CORNER.points @ turn.T + shift)
    wall = Polygon(tuple(map(tuple, (np.array(EL.vertices) @ turn.T + shift).tolist())), "el")
    one = judge(seen, walls=(EL,)).costs(states)
    assert judge(other, path=path, walls=(wall,)).costs(moved) == pytest.approx(one, abs=1e-7)


@pytest.mark.parametrize("name", ["price", "closeness", "room"])
@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf"), "much"])
def test_prices_that_are_none_are_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(WideberthError, match=f"expected_contact.{name}"):
        ExpectedContact(**{name: value})  # type: ignore[arg-type]
