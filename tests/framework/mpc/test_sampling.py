"""Sampled starts: what they get through, what they never cost, and how they fail."""

import subprocess
import sys
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any, ClassVar, final

import numpy as np
import pytest

from wideberth.framework.mpc.costs.base import Weights
from wideberth.framework.mpc.costs.contouring import Contouring
from wideberth.framework.mpc.costs.tracking import Tracking
from wideberth.framework.mpc.fallback.instance_check import Outcome
from wideberth.framework.mpc.fallback.rollout import follow
from wideberth.framework.mpc.fallback.verify import violation
from wideberth.framework.mpc.levels.discounted import Discounted
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.planner import cycle, multistart
from wideberth.framework.mpc.planner.contingency import Contingency
from wideberth.framework.mpc.planner.cycle import Decision, PlannerState, Services, remember, step
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.sampling import Sampling, better, worth_sampling
from wideberth.framework.mpc.solvers.fatrop import Fatrop
from wideberth.framework.mpc.solvers.ipopt import Ipopt
from wideberth.framework.mpc.solvers.riccati.solver import Riccati
from wideberth.framework.mpc.solvers.watchdog import LeftBehind
from wideberth.framework.people.models import Company, PersonModel, Walkers
from wideberth.framework.people.reactions import reactions
from wideberth.framework.people.walls import WallField
from wideberth.framework.people.ways import walkers_of
from wideberth.framework.predictor import Predictor
from wideberth.framework.tracking.perception import scene_of
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Rung
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors import Kalman, ReactingPeople
from wideberth.regions import MahalanobisEllipse, MinkowskiSum
from wideberth.regions.static.separating_line import SeparatingLine
from wideberth.robots import Bicycle, Holonomic3D, HolonomicVelocity, Unicycle

PATH = Path(np.array([[0.0, 0.0], [9.0, 0.0]]))
DT, N, ROOM = 0.2, 20, 0.3
ASIDE = 1.3
WALLS = tuple(
    Polygon(((2.8, sign * 1.7), (3.2, sign * 1.7), (3.2, sign * 6.0), (2.8, sign * 6.0)))
    for sign in (1.0, -1.0)
)


@final
@dataclass(frozen=True)
class Polite(PersonModel):
    """Stands, and steps aside from a robot that would be within 0.78 m in a second."""

    name: ClassVar[str] = "polite"

    def next_velocity(self, walkers: Walkers, company: Company, duration: float) -> Array:
        soon = company.place[..., -1, :] + company.velocity[..., -1, :]
        apart = np.linalg.norm(walkers.place - soon[..., None, :], axis=-1)
        moved = np.linalg.norm(company.velocity[..., -1, :], axis=-1)[..., None] > 0.05
        begun = np.abs(walkers.place[..., 1]) > 0.36
        goes = ((apart < 0.78) & moved | begun) & (np.abs(walkers.place[..., 1]) < ASIDE)
        aside = np.where(goes, 0.5 * np.sign(walkers.place[..., 1]), 0.0)
        return np.stack([np.zeros_like(aside), aside], axis=-1)


@final
@dataclass(frozen=True)
class Foreseeing(Predictor):
    """Forecasts polite people by the robot's plan, with a deviation of 0.15 m."""

    broken_for: float = np.inf

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        people = walkers_of(tracks, tracks.stamp, 1.0)
        way = np.full((1, steps + 1, 2), 99.0)
        if scene is not None and scene.plan is not None and scene.plan_times is not None:
            times = tracks.stamp + tracks.dt * np.arange(steps + 1)
            columns = [np.interp(times, scene.plan_times, one) for one in scene.plan.T]
            way = np.stack(columns, axis=1)[None]
            if scene.plan[-1, 0] > self.broken_for:
                raise ValueError("not beyond there")
        found = reactions(Polite(), people, way, 0.25, WallField(), tracks.dt)[0, :, 1:]
        return Forecast.single(found, np.tile(0.15**2 * np.eye(2), (*found.shape[:2], 1, 1)), DT)


def planner(**changes: Any) -> Planner:
    settings = {
        "robot": Unicycle(radius=0.25, max_speed=0.6, max_yaw_rate=1.0, max_acceleration=0.25),
        "region": MahalanobisEllipse(), "predictor": Foreseeing(), "solver": Riccati(),
        "level": Discounted(tail=0.05, final_tail=0.9, full_steps=N), "penalty": 1e4,
        "horizon": N, "dt": DT, "period": DT, "track_dt": DT, "history": 6,
        "reference_speed": 0.5, "cost": Tracking(Weights(1.0, 0.01, 0.1, 0.1)),
        "static_region": SeparatingLine(), "sampling": Sampling(samples=150, model=Polite()),
    }  # fmt: skip
    return Planner(**{**settings, **changes})  # type: ignore[arg-type]


def seen(k: int, state: Array, people: Array, walls: tuple[Polygon, ...] = WALLS) -> Observation:
    found = tuple(
        Detection(f"p{i}", place, 1e-6 * np.eye(2), ROOM) for i, place in enumerate(people)
    )
    return Observation(DT * k, state, found, polygons=walls)


def driven(settings: Planner, seconds: float) -> tuple[float, float, list[Decision]]:
    """Drive towards two polite people in a gap: how far, the least gap, and the decisions."""
    services, state = Services.of(settings), PlannerState.initial(settings, PATH)
    ego, least, decisions = np.array([0.5, 0.0, 0.0, 0.5, 0.0]), np.inf, []
    people = np.array([[3.0, 0.35], [3.0, -0.35]])
    for k in range(3):
        state = remember(settings, state, seen(k, ego, people))
    for k in range(3, 3 + round(seconds / DT)):
        state, found = step(settings, state, seen(k, ego, people), services)
        decisions.append(found)
        way = np.stack([ego[:2], found.plan.positions[1]])[None]
        walkers = Walkers(people, np.zeros((2, 2)), np.zeros((2, 2)), np.full(2, ROOM))
        people = reactions(Polite(), walkers, way, 0.25, WallField(), DT)[0, :, 1]
        ego = found.plan.states[1]
        least = min(least, float(np.linalg.norm(people - ego[:2], axis=1).min()) - ROOM - 0.25)
    return float(ego[0]), least, decisions


def test_a_robot_that_waits_before_two_people_for_ever_gets_through_by_a_sampled_way() -> None:
    """They step aside for a robot that comes, and the plan that waits never comes."""
    stuck, _, decisions = driven(planner(sampling=None), 16.0)
    assert stuck < 2.3
    assert {one.plan.rung for one in decisions} == {Rung.OPTIMAL}
    through, gap, decisions = driven(planner(), 16.0)
    assert through > 4.0
    assert gap > 0.0
    chosen = [one for one in decisions if one.plan.reason.startswith("sampled way instead")]
    assert chosen


def ready(settings: Planner, speed: float = 0.4) -> tuple[PlannerState, Observation, Services]:
    """Return a state from which a sampled way is driven: before the people, at a standstill."""
    people = np.array([[3.0, 0.35], [3.0, -0.35]])
    ego = np.array([1.9, 0.0, 0.0, 0.0, 0.0])[: len(settings.robot.states)]
    state = PlannerState.initial(settings, PATH)
    for k in range(5):
        state = remember(settings, state, seen(k, ego, people))
    return state, seen(5, ego, people), Services.of(settings)


def decided(settings: Planner) -> tuple[PlannerState, Decision]:
    state, observation, services = ready(settings)
    return step(settings, state, observation, services)


def test_the_plan_is_held_against_the_forecast_for_its_own_way() -> None:
    settings = planner()
    plain = decided(planner(sampling=None))[1]
    state, found = decided(settings)
    plan, solved = found.plan, found.solved
    assert plan.reason.startswith("sampled way instead of optimal at cost")
    assert plan.rung is Rung.OPTIMAL and solved is not None and plan.forecast is not None
    assert plan.cost < plain.plan.cost
    assert violation(solved.check.problem, solved.check.parameters, solved.point).worst < 1e-4
    observation = ready(settings)[1]
    tracks = state.perception.history.tracks()
    assert settings.sampling is not None
    way = settings.sampling.best(settings.robot, plain.plan, tracks, observation, 0.5)
    assert way is not None and tracks is not None
    inputs = follow(settings.robot, plain.plan.states[0], way.inputs, DT)
    assert np.allclose(inputs, way.states, atol=1e-9)  # it can be driven
    there = replace(plain.plan, states=way.states, positions=way.positions)
    scene = scene_of(observation, there, settings.robot.radius)
    own = settings.predictor.predict(tracks, N, scene)
    assert np.allclose(own.mean, plan.forecast.mean, atol=1e-9)
    assert np.abs(plan.forecast.mean[:, 0, -1, 1]).min() > 1.2  # who has stepped aside
    assert np.abs(plain.plan.forecast.mean[:, 0, -1, 1]).max() < 0.4  # type: ignore[union-attr]


PLAIN = Kalman(acceleration_density=0.005)


def crossings(count: int) -> list[tuple[Array, Array]]:
    """Places and velocities of people in random encounters."""
    rng = np.random.default_rng(7)
    return [
        (rng.uniform((1.0, -1.2), (3.5, 1.2), (4, 2)), 0.3 * rng.standard_normal((4, 2)))
        for _ in range(count)
    ]


def encounter(settings: Planner, crowd: tuple[Array, Array]) -> Decision:
    services, state = Services.of(settings), PlannerState.initial(settings, PATH)
    ego = np.array([0.0, 0.0, 0.0, 0.4, 0.0])
    places = [crowd[0] + DT * k * crowd[1] for k in range(6)]
    for k in range(5):
        state = remember(settings, state, seen(k, ego, places[k], ()))
    return step(settings, state, seen(5, ego, places[5], ()), services)[1]


@pytest.mark.parametrize("starts", [(), "auto"], ids=["last plan alone", "auto"])
def test_no_plan_costs_more_than_without_where_the_forecast_stays(starts: Any) -> None:
    """Kalman does not look at the robot: the way is one more start of the same instance."""
    cheaper = 0
    for crowd in crossings(8):
        on = planner(predictor=PLAIN, starts=starts, sampling=Sampling())
        off = replace(on, sampling=None)
        without, found = encounter(off, crowd), encounter(on, crowd)
        assert found.notes == without.notes == ()
        assert found.plan.forecast is not None and without.plan.forecast is not None
        assert np.array_equal(found.plan.forecast.mean, without.plan.forecast.mean)
        if found.plan.reason.startswith("sampled way"):
            assert found.plan.violation <= 1e-4
            cheaper += 1
        else:
            assert np.array_equal(found.plan.states, without.plan.states)
        if without.plan.violation <= 1e-4:
            assert found.plan.violation <= 1e-4
            assert found.plan.cost <= without.plan.cost
    assert cheaper >= (1 if starts == () else 0)


def test_where_nothing_is_in_the_way_nothing_is_sampled(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError("sampled")

    monkeypatch.setattr(Sampling, "best", never)
    far = np.array([[0.0, 4.0], [3.0, -4.0]]), np.zeros((2, 2))
    found = encounter(planner(predictor=Kalman()), far)
    plain = encounter(planner(predictor=Kalman(), sampling=None), far)
    assert found.notes == ()
    assert np.array_equal(found.plan.states, plain.plan.states)
    near = np.array([[2.0, 0.05]]), np.zeros((1, 2))
    found = encounter(planner(predictor=Kalman()), near)
    assert found.notes == ("sampling: AssertionError: sampled",)


def test_sampling_is_worth_it_where_something_is_in_the_way_of_a_plan_that_feels_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    outcomes: list[Outcome] = []
    monkeypatch.setattr(cycle, "worth_sampling", lambda one: outcomes.append(one))
    decided(planner())
    found = outcomes[0]
    assert found.obstacle_in_way and worth_sampling(found)
    assert not worth_sampling(replace(found, obstacle_in_way=False))
    assert not worth_sampling(replace(found, solutions=()))
    assert not worth_sampling(replace(found, note="from another start Riccati did not return"))
    first = found.candidates[0]
    assert first.solution is not None
    none = replace(first.solution.point.multipliers, slots=())  # type: ignore[type-var]
    free = replace(first.solution, point=replace(first.solution.point, multipliers=none))
    assert not worth_sampling(replace(found, candidates=(replace(first, solution=free),)))


def fingerprint() -> str:
    """Hash of a decision with a sampled way."""
    found = decided(planner())[1]
    return sha256(found.plan.states.tobytes() + found.plan.inputs.tobytes()).hexdigest()


def test_the_same_state_gives_the_same_bytes_in_every_process() -> None:
    here = fingerprint()
    script = f"from {__name__} import fingerprint; print(fingerprint())"
    ran = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=240, check=True
    )
    assert ran.stdout.split() == [here]
    settings = planner(sampling=Sampling(samples=150, model=Polite(), seed=1))
    assert not np.array_equal(decided(settings)[1].plan.states, decided(planner())[1].plan.states)


@final
@dataclass(frozen=True)
class Broken(PersonModel):
    """Raises, returns no numbers, or too many of them."""

    name: ClassVar[str] = "broken"
    how: str = "raises"

    def next_velocity(self, walkers: Walkers, company: Company, duration: float) -> Array:
        if self.how == "raises":
            raise RuntimeError("no idea")
        if self.how == "nan":
            return np.full_like(walkers.place, np.nan)
        return np.zeros((3, 3))


@pytest.mark.parametrize(
    ("how", "words"),
    [("raises", "RuntimeError: no idea"), ("nan", "finite cost"), ("shape", "ValueError")],
)
def test_a_model_that_fails_leaves_the_plan_and_a_note(how: str, words: str) -> None:
    plain = decided(planner(sampling=None))[1]
    found = decided(planner(sampling=Sampling(samples=20, model=Broken(how))))[1]
    assert len(found.notes) == 1
    assert found.notes[0].startswith("sampling: ") and words in found.notes[0]
    assert np.array_equal(found.plan.states, plain.plan.states)


def test_a_predictor_that_raises_when_asked_anew_leaves_the_plan() -> None:
    plain = decided(planner(sampling=None))[1]
    found = decided(planner(predictor=Foreseeing(broken_for=2.5)))[1]
    assert found.notes == ("sampling: ValueError: not beyond there",)
    assert np.array_equal(found.plan.states, plain.plan.states)


def test_a_model_that_hangs_is_left_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    limits: list[float] = []

    def hangs(call: object, limit: float) -> None:
        limits.append(limit)
        raise LeftBehind(f"did not return within {limit:g} s")

    monkeypatch.setattr(cycle, "watched", hangs)
    found = decided(planner(patience=3.0))[1]
    assert found.notes == ("sampling: did not return within 3 s",)
    assert found.plan.rung is Rung.OPTIMAL
    decided(planner(deadline=50.0))
    assert 0.0 < limits[1] < 50.0


@pytest.mark.parametrize(
    ("deadline", "sampling", "sampled", "forecasts"),
    [(400.0, 100.0, 1, 2), (400.0, 190.0, 1, 1), (190.0, 0.0, 0, 1), (None, 1e3, 1, 2)],
    ids=["enough", "too little for a forecast", "too little to sample", "no deadline"],
)
def test_what_there_is_no_time_for_is_not_begun(
    deadline: float | None,
    sampling: float,
    sampled: int,
    forecasts: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By a clock of the test's own: a forecast takes 100 s, and 0.9 of the deadline counts."""
    now, begun = [0.0], {"best": 0, "predict": 0}

    def counted(kind: type, name: str, seconds: float) -> None:
        real = getattr(kind, name)

        def slow(*asked: Any, **more: Any) -> Any:
            now[0] += seconds
            begun[name] += 1
            return real(*asked, **more)

        monkeypatch.setattr(kind, name, slow)

    settings = planner(deadline=deadline)
    state, observation, services = ready(settings)
    monkeypatch.setattr(multistart, "perf_counter", lambda: now[0])
    counted(Sampling, "best", sampling)
    counted(Foreseeing, "predict", 100.0)
    found = step(settings, state, observation, services)[1]
    assert begun == {"best": sampled, "predict": forecasts}
    assert found.notes == () and found.plan.rung is Rung.OPTIMAL
    assert found.plan.reason.startswith("sampled way instead") is (forecasts == 2)


@pytest.mark.parametrize("solver", [Fatrop(), Ipopt()], ids=lambda one: type(one).__name__)
def test_every_solver_takes_a_sampled_way(solver: Any) -> None:
    found = decided(planner(solver=solver, static_region=SeparatingLine()))[1]
    assert found.plan.reason.startswith("sampled way instead"), found.plan
    assert found.notes == () and found.plan.violation <= 1e-4


@pytest.mark.parametrize(
    "changes",
    [
        {"cost": Contouring()},
        {"level": Relaxed(weight=100.0, minimum=0.0)},
        {"region": MinkowskiSum(), "level": Fixed(), "penalty": None},
        {"robot": HolonomicVelocity(radius=0.25, max_speed=0.6)},
        {"robot": Bicycle()},
        {"latency": 0.1},
        {"withdraw": True},
        {"stop_at_end": True},
        {"predictor": ReactingPeople(), "sampling": Sampling()},
    ],
    ids=lambda one: "-".join(one),
)
def test_other_settings_take_a_sampled_way_or_leave_it(changes: dict[str, Any]) -> None:
    found = decided(planner(**changes))[1]
    assert found.notes == ()
    plan, solved = found.plan, found.solved
    assert solved is not None
    if plan.rung is Rung.OPTIMAL:
        assert violation(solved.check.problem, solved.check.parameters, solved.point).worst < 1e-4


def test_the_better_plan_by_hand() -> None:
    plan = decided(planner(sampling=None))[1].plan
    own = replace(plan, cost=10.0, violation=0.0)
    dear, cheap = replace(own, cost=9.5), replace(own, cost=9.4)  # 5 % of 1 + 10 are 0.55
    assert better(cheap, own) and not better(dear, own)
    assert better(dear, replace(own, violation=1e-3, cost=1.0))
    assert better(dear, replace(own, cost=float("nan")))
    assert not better(replace(cheap, violation=1e-3), own)
    assert not better(replace(cheap, cost=float("nan")), own)


def test_settings_that_do_not_fit_are_refused() -> None:
    for name, value in {"samples": 3, "people": -1, "memory": 0.0, "seed": -1}.items():
        with pytest.raises(WideberthError, match=f"sampling.{name}"):
            Sampling(**{name: value})  # type: ignore[arg-type]
    with pytest.raises(WideberthError, match=r"sampling.samples is 20000; wanted at most 10000"):
        Sampling(samples=20_000)
    with pytest.raises(WideberthError, match="wanted a PersonModel"):
        Sampling(model="social_force")  # type: ignore[arg-type]
    with pytest.raises(WideberthError, match="leave one of them out"):
        planner(predictor=ReactingPeople(), contingency=Contingency())
    with pytest.raises(WideberthError, match=r"horizon is 1; wanted at least 2 with planner.sam"):
        planner(horizon=1)
    assert planner(horizon=1, sampling=None).horizon == 1
    with pytest.raises(WideberthError, match="in the plane"):
        planner(robot=Holonomic3D(), static_region=None, predictor=Kalman())
