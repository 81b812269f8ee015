"""Drawn futures: what a plan among them risks, from how few of them it follows."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from wideberth.controllers.slots.drawn_futures import DrawnFutures, DrawnHalfPlanes
from wideberth.controllers.slots.scenario_risk import largest_support, risk_of_support
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.reference import Reference
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.slots.base import PlanningContext
from wideberth.framework.plugins.config import build
from wideberth.framework.testing.slot_kind import sample_view
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.robots.unicycle import Unicycle

ROBOT, KIND = Unicycle(radius=0.4), DrawnFutures(risk=0.2, doubt=0.1, scenarios=400)


def view_of(seed: int, people: int = 4) -> PlanningContext:
    """The sample's view, but people walk, with a joint covariance over the steps."""
    rng, given, steps = np.random.default_rng(seed), sample_view(), 12
    places, velocities = rng.uniform(1.0, 6.0, (people, 2)), 0.5 * rng.standard_normal((people, 2))
    walk = places[:, None] + 0.5 * np.arange(-7.0, 1.0)[:, None] * velocities[:, None]
    names, noise = (
        tuple(f"person {k}" for k in range(people)),
        np.tile(1e-4 * np.eye(2), (people, 1, 1)),
    )
    tracks = Tracks(walk, 0.5, names, np.full(people, 0.3), noise)
    forecast = ConstantVelocity(acceleration_density=0.01).predict(tracks, steps)
    laid = given.reference
    shorter = {
        name: getattr(given, name)[:steps] for name in ("times", "planned", "own", "travel")
    }
    reference = Reference(
        *(part[:steps] for part in (laid.position, laid.direction, laid.speed, laid.curve))
    )
    return replace(
        given,
        **shorter,
        tracks=tracks,
        forecast=forecast,
        reference=reference,
        route=given.route[:, :steps],
    )


def broken(drawn: DrawnHalfPlanes, forecast: Forecast, fresh: Array) -> float:
    """Share of fresh futures (S, O, N, D) that pass a half-plane."""
    rows = [int(name.split()[1]) for name in drawn.kept.ids]
    away = fresh[:, rows] - drawn.kept.mean.swapaxes(0, 1)
    along = np.einsum("nod,sond->sno", drawn.planes.normal, away)
    return float((along > drawn.planes.room + 1e-9).any(axis=(1, 2)).mean())


def test_fresh_futures_break_half_planes_no_more_often_than_promised() -> None:
    """But for the doubt. Taken for all draws at once it is 10 % of 200; a few are expected."""
    more, more_unless_discards_count, runs = 0, 0, 60
    for seed in range(runs):
        view = view_of(seed)
        assert view.forecast is not None
        drawn = KIND.half_planes(ROBOT, view)
        fresh = view.forecast.sample(np.random.default_rng(900 + seed), 10_000)
        found = broken(drawn, view.forecast, fresh)
        holding, discarded = drawn.support
        more += found > risk_of_support(holding + discarded, KIND.scenarios, KIND.doubt)
        alone = risk_of_support(holding, KIND.scenarios, KIND.doubt)
        more_unless_discards_count += found > alone
        assert holding + discarded <= largest_support(KIND.risk, KIND.scenarios, KIND.doubt)
    assert more <= binom.ppf(0.999, runs, KIND.doubt)
    assert more_unless_discards_count > binom.ppf(0.999, runs, KIND.doubt)


def test_half_planes_follow_from_holders_and_discarded_alone() -> None:
    """The condition of the promise: any of the others may go, and nothing changes."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        over = rng.standard_normal((400, 6, 5)) @ np.triu(rng.standard_normal((5, 5))) - 0.5
        depth = rng.uniform(-1.0, 1.0, (6, 5))
        height, (holding, discarded) = KIND.discard(over, depth)
        holds = ((over == height) & (height > 0.0)).any(axis=(1, 2))
        gone = (over > height).any(axis=(1, 2))
        assert (int(holds.sum()), int(gone.sum())) == (holding, discarded)
        assert holding and discarded
        kept = holds | gone | (rng.random(len(over)) < 0.3)
        again, support = KIND.discard(over[kept], depth)
        np.testing.assert_array_equal(again, height)
        assert support == (holding, discarded)


def test_without_a_price_nothing_is_discarded() -> None:
    over = np.random.default_rng(5).standard_normal((400, 6, 5))
    height, support = KIND.discard(over, np.full((6, 5), -10.0))
    np.testing.assert_array_equal(height, np.maximum(over.max(axis=0), 0.0))
    assert support.discarded == 0


def test_the_draws_are_new_at_every_stamp_and_the_same_at_one() -> None:
    view = view_of(3)
    first, again = (KIND.half_planes(ROBOT, view) for _ in range(2))
    later = replace(view, observation=replace(view.observation, stamp=0.5))
    np.testing.assert_array_equal(first.planes.room, again.planes.room)
    assert (KIND.half_planes(ROBOT, later).planes.room != first.planes.room).any()
    assert (replace(KIND, seed=1).half_planes(ROBOT, view).planes.room != first.planes.room).any()


def test_an_own_error_of_place_widens_the_room() -> None:
    view = view_of(3)
    unsure = replace(view, own=np.tile(0.25 * np.eye(2), (len(view.times), 1, 1)))
    exact, wide = (KIND.half_planes(ROBOT, one).planes.room for one in (view, unsure))
    assert wide.shape == exact.shape and wide.mean() > exact.mean() + 0.1


def test_too_few_scenarios_are_refused_with_the_number_wanted() -> None:
    with pytest.raises(WideberthError, match=r"scenarios is 300; .* wants at least 385,"):
        DrawnFutures(risk=0.1, doubt=0.01, scenarios=300)
    DrawnFutures(risk=0.1, doubt=0.01, scenarios=385)
    with pytest.raises(WideberthError, match=r"scenarios is 384"):
        DrawnFutures(risk=0.1, doubt=0.01, scenarios=384)


def planner(**changes: object) -> Planner:
    settings = {
        "type": "recommended", "robot": {"type": "unicycle", "radius": 0.3},
        "predictor": {"type": "constant_velocity", "acceleration_density": 0.01},
        "level": "fixed", "further_kinds": [{"type": "drawn_futures"}],
    }  # fmt: skip
    made: Planner = build("controllers", {**settings, **changes})
    made.set_path(Path(np.array([[0.0, 0.0], [8.0, 0.0]])))
    return made


def test_a_shared_level_is_refused() -> None:
    with pytest.raises(WideberthError, match=r"drawn_futures the draws say how far"):
        planner(level="relaxed")


def drive(made: Planner, speed: float, ticks: int) -> None:
    """Let a person cross the way in front of the robot, which stands."""
    for tick in range(ticks):
        place = np.array([2.5, -2.5 + 0.5 * speed * tick])
        seen = (Detection("person", place, 1e-4 * np.eye(2), 0.3),)
        made.command(Observation(0.5 * tick, np.array([0.0, 0.0, 0.0, 0.3, 0.0]), seen))


def test_a_plan_says_what_it_risks_and_keeps_it() -> None:
    made = planner()
    drive(made, 0.6, 6)
    plan, kind = made.plan, DrawnFutures()
    assert plan is not None and plan.rung == "optimal" and plan.forecast is not None
    assert 0.0 < plan.risk <= kind.risk
    assert plan.lowest_content == pytest.approx(1.0 - kind.risk)
    fresh = plan.forecast.sample(np.random.default_rng(1), 20_000)[:, 0]
    apart = np.linalg.norm(fresh - plan.positions[1:], axis=2)
    assert (apart < 0.6 + made.margin - 1e-3).any(axis=1).mean() <= plan.risk


def test_a_plan_that_enters_promises_nothing() -> None:
    made = planner()
    for tick in range(4):
        seen = (Detection("person", np.array([0.9 - 0.1 * tick, 0.0]), 1e-4 * np.eye(2), 0.3),)
        made.command(Observation(0.5 * tick, np.array([0.0, 0.0, 0.0, 0.5, 0.0]), seen))
    assert made.plan is not None and made.plan.violation > 1e-4
    assert np.isnan(made.plan.risk)


def test_other_kinds_promise_no_plan() -> None:
    made = planner(further_kinds=[])
    drive(made, 0.6, 3)
    assert made.plan is not None and np.isnan(made.plan.risk)
    assert isinstance(made.level, Fixed)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("scale", [0.0, 1.0, 1e12, 1e300])
@pytest.mark.parametrize("shift", [0.0, 1e8, 1e200, 1e307])
def test_numbers_of_any_size_become_such_as_a_solver_can_take(scale: float, shift: float) -> None:
    view = view_of(3)
    assert view.forecast is not None
    mean, covariance = view.forecast.mean[:, 0], view.forecast.covariance[:, 0]
    far = Forecast.single(mean + shift, scale * covariance, 0.5)
    found = KIND.choose(ROBOT, replace(view, forecast=far)).numbers.parameters
    assert np.isfinite(found).all() and np.abs(found).max() < 1e7


def test_the_modes_of_a_forecast_are_drawn_by_their_weights() -> None:
    """Where a person goes one way or another, fresh futures of both keep the risk."""
    view = view_of(3, people=1)
    assert view.forecast is not None
    mean, covariance = view.forecast.mean, view.forecast.covariance
    aside = np.zeros_like(mean)
    aside[..., 1] = 3.0
    two = np.concatenate([mean, mean - aside], axis=1), np.concatenate([covariance] * 2, axis=1)
    for light in (1e-6, 0.01, 0.5):
        forecast = Forecast(*two, np.array([[1.0 - light, light]]), 0.5, (None,))
        drawn = KIND.half_planes(ROBOT, replace(view, forecast=forecast))
        fresh = forecast.sample(np.random.default_rng(0), 10_000)
        along = np.einsum("nod,sond->sno", drawn.planes.normal, fresh)
        offset = np.einsum("nod,nod->no", drawn.planes.normal, drawn.kept.mean)
        assert (along > offset + drawn.planes.room).any(axis=(1, 2)).mean() <= KIND.risk


def test_a_plan_passes_who_stands_in_the_way() -> None:
    """The last plan meets the person: the half-planes then lie beside a turned one."""
    made = planner(predictor={"type": "constant_velocity", "acceleration_density": 5e-4})
    person = Detection("person", np.array([3.0, 0.0]), 1e-4 * np.eye(2), 0.3)
    for tick in range(-8, 1):
        state = np.array([0.2 * tick, 0.0, 0.0, 0.4, 0.0])
        seen = Observation(0.5 * tick, state, (person,))
        made.remember(seen)
    made.command(seen)
    assert made.plan is not None and made.plan.rung == "optimal" and made.plan.risk < 0.1
    assert made.plan.positions[-1, 0] > 2.5 and np.abs(made.plan.positions[:, 1]).max() > 0.6
