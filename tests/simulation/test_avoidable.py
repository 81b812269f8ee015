"""Contacts that can be avoided by construction, and contacts that cannot."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from wideberth.controllers.constant_velocity import ConstantVelocityController
from wideberth.framework.controller import Controller
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Command, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan
from wideberth.framework.values.polygon import Polygon
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import Run, run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.measures.avoidable import (
    _EXTREME,
    _drawn,
    _Takeover,
    _Tried,
    avoidable,
)
from wideberth.simulation.measures.first_contact import LEADS, first_contact, lead_column
from wideberth.simulation.scenarios.random_crowd import RandomCrowd

SETTINGS = Settings(time_limit=12.0, history=0.0)
COLUMNS = ("avoidable_2s", "avoidable_2s_reacting", "avoidable_1s", "avoidable_1s_reacting")
EAST = Path(np.array([[0.0, 0.0], [8.0, 0.0]]))


def driver(speed: float = 1.0, acceleration: float = 0.0) -> RobotAgent:
    """Drives east and looks at nobody; without inertia where no acceleration is given."""
    robot: HolonomicVelocity | Unicycle = HolonomicVelocity(0.3, speed)
    if acceleration:
        robot = Unicycle(0.3, speed, 0.1, acceleration, 0.1)
    return RobotAgent("robot", robot, ConstantVelocityController(robot, 0.1, speed), EAST, speed)


def body(name: str, places: Array, radius: float) -> ReplayAgent:
    """Passes these places, (13, 2), a second apart."""
    return ReplayAgent(name, np.linspace(0.0, 12.0, len(places)), places, radius)


def standing(place: tuple[float, float]) -> ReplayAgent:
    return body("post", np.tile(place, (13, 1)).astype(float), 0.3)


def columns(
    agents: list[RobotAgent], others: tuple[ReplayAgent, ...] = (),
    polygons: tuple[Polygon, ...] = (), settings: Settings = SETTINGS,
) -> list[bool | float]:  # fmt: skip
    episode = run_episode(agents, settings, others=others, polygons=polygons)
    found = avoidable(episode, agents, settings, others, (), polygons)
    held = [found.pop(lead_column("level_held", lead)) for lead in LEADS]
    assert np.isnan(held).all()  # there is no plan
    assert len(found) == 2 * len(LEADS) and set(COLUMNS) <= set(found)
    return list(found.values())


def test_who_can_stop_could_have_avoided_a_post() -> None:
    """Without inertia a tenth of a second would do."""
    assert columns([driver()], (standing((4.0, 0.0)),)) == [True] * 10


def test_nobody_escapes_a_body_too_wide_and_too_fast() -> None:
    """A disc of 8 m comes at 12 m/s; who has 1 m/s would have to start 8 s before."""
    train = np.stack([np.linspace(80.0, -64.0, 13), np.zeros(13)], axis=1)
    assert columns([driver()], (body("train", train, 8.0),)) == [False] * 10


@pytest.mark.parametrize("acceleration, least", [(0.9, 0.75), (0.6, 1.0), (0.38, 1.5), (0.2, 9)])
def test_braking_has_to_begin_in_time(acceleration: float, least: float) -> None:
    """v / (2 a) s before the wall: 0.56, 0.83, 1.32 and 2.5 s; the wall is too wide to pass."""
    wall = Polygon(((5.0, -9.0), (6.0, -9.0), (6.0, 9.0), (5.0, 9.0)), "wall")
    robot = driver(1.0, acceleration)
    blind = RobotAgent("robot", robot.robot, Blind(0.1, 1.0), EAST, 1.0)
    assert columns([blind], (), (wall,)) == [lead >= least for lead in LEADS for _ in range(2)]


@dataclass
class Blind(Controller):
    """Goes straight on, whatever stands there."""

    period: float
    speed: float

    def reset(self) -> None:
        """Nothing to forget."""

    def set_path(self, path: Path) -> None:
        """Nothing to follow."""

    def remember(self, observation: Observation) -> None:
        """Nothing to see."""

    def command(self, observation: Observation) -> Command:
        """Go on."""
        return Command((self.speed, 0.0))

    @property
    def last_plan(self) -> Plan | None:
        """No plan."""
        return None


@dataclass
class Hunter(Blind):
    """Heads for the nearest body it sees, without inertia."""

    def command(self, observation: Observation) -> Command:
        """Go for it."""
        if not observation.detections:
            return Command((0.0, 0.0))
        way = observation.detections[0].position - observation.state[:2]
        velocity = self.speed * way / max(float(np.hypot(*way)), 1e-9)
        return Command((float(velocity[0]), float(velocity[1])))


def test_a_hunter_is_avoided_on_paper_alone() -> None:
    """Where it went, nobody else would have been; but it follows, and is three times as fast."""
    runner = HolonomicVelocity(0.3, 3.0)
    way = Path(np.array([[8.0, 6.0], [0.0, 6.0]]))
    hunter = RobotAgent("hunter", runner, Hunter(0.1, 3.0), way, 0.0, person=True)
    assert columns([driver(), hunter]) == [True, False] * 5


def test_what_is_known_only_where_it_can_be() -> None:
    robot, post = driver(), standing((4.0, 0.0))
    assert np.isnan(columns([robot], (standing((4.0, 3.0)),))).all()  # nothing touched
    episode = run_episode([robot], SETTINGS, others=(post,))
    met = first_contact(episode)
    assert met is not None and met.time == pytest.approx(3.4, abs=0.021)
    other = avoidable(episode, [driver(0.9)], SETTINGS, (post,))
    assert np.isnan(list(other.values())).all()  # not the episode that was played
    same = [avoidable(episode, [robot], SETTINGS, (post,)) for _ in range(2)]
    assert same[0] == same[1]
    late = run_episode([robot], SETTINGS, others=(standing((1.2, 0.0)),))
    found = avoidable(late, [robot], SETTINGS, (standing((1.2, 0.0)),))
    assert found["avoidable_2s"] is True  # from its first decision on, 0.6 s before


@dataclass
class Counting(Blind):
    """Counts its commands, which a copy of it adds to as well."""

    seen: list[float] = field(default_factory=list)

    def command(self, observation: Observation) -> Command:
        """Go on."""
        self.seen.append(observation.stamp)
        return super().command(observation)


def test_robots_repeat_what_they_commanded_and_are_not_asked_again() -> None:
    counting = Counting(0.1, 1.0)
    robot, post = RobotAgent("robot", driver().robot, counting, EAST, 1.0), standing((4.0, 0.0))
    episode = run_episode([robot], SETTINGS, others=(post,))
    before = len(counting.seen)
    assert before > 10
    found = avoidable(episode, [robot], SETTINGS, (post,))
    assert found["avoidable_1s_reacting"] is True and len(counting.seen) == before


def test_the_first_contact_is_that_of_a_pair_that_touches() -> None:
    short = replace(SETTINGS, time_limit=5.0)
    aside, ahead = body("aside", np.tile((2.0, 3.0), (13, 1)), 0.3), standing((4.0, 0.0))
    assert first_contact(run_episode([driver()], short, others=(aside,))) is None
    found = first_contact(run_episode([driver()], short, others=(aside, ahead)))
    assert found is not None and (found.robots, found.other) == (("robot",), "post")
    assert found.time == pytest.approx(3.4, abs=0.021)


def test_others_go_on_after_a_contact_that_ends_the_episode() -> None:
    """A wall of a body that follows for ever; to delay the contact is not to avoid it."""
    train = np.stack([np.linspace(-20.0, 52.0, 13), np.zeros(13)], axis=1)
    ends = replace(SETTINGS, stop_on_collision=True)
    assert columns([driver()], (body("train", train, 9.0),), settings=ends) == [False] * 10


def test_twists_are_drawn_between_the_ends_and_often_at_one() -> None:
    ends, rng = [[-2.0, 0.0, 1.0], [3.0, 4.0]], np.random.default_rng(0)
    drawn = np.array([_drawn(rng, ends) for _ in range(4000)])
    for values, possible in zip(drawn.T, ends, strict=True):
        low, high = possible[0], possible[-1]
        assert low <= values.min() and values.max() <= high
        at_end = np.isin(values, possible)
        spread = 3.0 * np.sqrt(0.25 / 4000)
        assert abs(at_end.mean() - _EXTREME) <= spread
        for one in possible:
            assert abs((values == one).mean() - _EXTREME / len(possible)) <= spread
        between = (values[~at_end] - low) / (high - low)
        assert abs(between.mean() - 0.5) <= 3.0 / np.sqrt(12.0 * len(between))


def test_what_helps_late_helps_early(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the last instant that helps on, no more is tried; what was done until then is known."""
    tried: list[float] = []
    of = _Takeover.tried

    def counted(self: _Takeover, name: str, record: Episode, seed: int) -> list[_Tried]:
        tried.append(float(record.times[self.first]))
        return of(self, name, record, seed)

    monkeypatch.setattr(_Takeover, "tried", counted)
    assert columns([driver()], (standing((4.0, 0.0)),)) == [True] * 10
    assert tried == pytest.approx([2.9], abs=0.01)  # 0.5 s before it


@pytest.mark.parametrize("solve_time", ["zero", 0.06])
def test_a_copied_run_goes_on_as_its_original(solve_time: float) -> None:
    """People who remember, noise and late commands included; neither changes the other."""
    settings = Settings(time_limit=5.0, solve_time=solve_time)
    cast = RandomCrowd().cast(3)
    robot = HolonomicVelocity(0.3, 0.7)
    agents = [
        one.agent(robot, ConstantVelocityController(robot), False) for one in cast.placements
    ]
    run = Run([*agents, *cast.people], settings, 3, (), (), ())
    run.advance_to(2.03)
    twin = run.clone()
    before = len(run.clock)
    twin.advance_to(np.inf)
    assert len(run.clock) == before and run.ended == ""
    run.advance_to(np.inf)
    assert twin.episode().to_bytes() == run.episode().to_bytes()
    thrice = Run([*agents, *cast.people], settings, 3, (), (), ())
    thrice.advance()
    assert thrice.episode().to_bytes() == run.episode().to_bytes()
