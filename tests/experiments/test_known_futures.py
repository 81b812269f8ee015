"""One plan against plans for known futures: what must be equal, and what cannot be larger."""

from dataclasses import dataclass, replace
from pathlib import Path as Folder
from typing import final

import numpy as np
import pytest

from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies import known_futures
from wideberth.experiments.studies.known_futures import STARTS, Futures, KnownFutures, measured
from wideberth.experiments.studies.variants import planner_of
from wideberth.framework.controller import Controller
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.predictor import Predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.motion import Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Status
from wideberth.framework.values.tracks import Tracks
from wideberth.metrics.statistics import clopper_pearson
from wideberth.predictors.kalman import Kalman
from wideberth.solvers.fatrop import Fatrop
from wideberth.solvers.riccati.solver import Riccati

INSTANT, TAIL = 8.0, 0.2


@final
@dataclass(frozen=True)
class Mixed(Predictor):
    """The Kalman forecast and one aside of it, each of a weight; its spread times a factor."""

    weight: float = 1.0
    aside: float = 0.0
    spread: float = 1.0
    joint: bool = True

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        one = Kalman(acceleration_density=0.01).predict(tracks, steps, scene)
        assert one.joint is not None
        count = 1 + int(self.weight < 1.0)
        aside = one.mean + np.array([0.0, self.aside])
        mean = np.concatenate([one.mean, aside], axis=1)[:, :count]
        spread = self.spread**2 * np.repeat(one.covariance, count, axis=1)
        joint = self.spread**2 * np.repeat(one.joint, count, axis=1) if self.joint else None
        weight = np.tile([self.weight, 1.0 - self.weight], (len(mean), 1))[:, :count]
        return Forecast(mean, spread, weight, one.dt, one.fallback, joint)


@pytest.fixture(scope="module")
def shipped() -> KnownFutures:
    experiment, _ = read_experiment("known_futures", [])
    assert isinstance(experiment, KnownFutures)
    return experiment


def small(shipped: KnownFutures, **changes: object) -> KnownFutures:
    """Return one planner at a fixed level and one instant, with a solver that compiles nothing."""
    usual = planner_of(shipped.planners["recommended"])
    settings = {"level": Fixed(TAIL), **changes}
    planner: Controller = replace(usual, **settings)  # type: ignore[arg-type]
    few = {"instants": (INSTANT,), "shown_instant": 0, "draws": 40, "solver": Riccati()}
    return replace(shipped, planners={"only": planner}, **few)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def seen(shipped: KnownFutures) -> tuple[Path, list[Observation]]:
    return small(shipped).watched(INSTANT)


def test_without_uncertainty_every_known_future_costs_what_the_one_plan_costs(
    shipped: KnownFutures,
) -> None:
    study = small(shipped, predictor=Mixed(spread=0.0))
    (row,) = study.measure(study.tasks()[0]).rows
    assert row["solved"] == 1.0 and row["cost"] > 10.0
    for name in ("cost_known", "cost_known_q05", "cost_known_q95"):
        assert row[name] == pytest.approx(row["cost"], rel=2e-5)
    assert row["worth"] == pytest.approx(0.0, abs=2e-5 * row["cost"])
    assert row["touched"] == row["speed_spread_mps"] == row["turn_spread_radps"] == 0.0


def test_a_future_inside_the_regions_costs_no_more_than_the_one_plan(
    shipped: KnownFutures, seen: tuple[Path, list[Observation]]
) -> None:
    """The one plan keeps the margin from every point of the content ellipses, which are round."""
    study = small(shipped)
    decision = study.decide("only", *seen)
    futures = Futures.of(decision, np.random.default_rng(1), 60)
    assert decision.solved is not None
    forecast = decision.plan.forecast
    assert forecast is not None
    level = -2.0 * np.log(TAIL)
    gap = futures.draws - forecast.mean[:, 0]
    whitened = np.linalg.solve(forecast.covariance[None, :, 0], gap[..., None])[..., 0]
    inside = ((gap * whitened).sum(axis=-1) < level).all(axis=(1, 2))
    assert 10 < inside.sum() < 60
    one, found = futures.solve(study.solver, decision.solved.point, ())
    assert one.status is Status.SOLVED
    for (own,), contained in zip(found, inside, strict=True):
        if contained:
            assert own.status is Status.SOLVED and own.cost <= one.cost * (1.0 + 1e-5)
            assert own.point.slack.max() < 1e-5
    assert not futures.touched(one.point.states)[inside].any()


def test_share_touched_is_that_of_discs_that_overlap(
    shipped: KnownFutures, seen: tuple[Path, list[Observation]]
) -> None:
    """An independent count of the drawn places along a plan that heeds hardly more than means."""
    study = small(shipped, level=Fixed(0.999))
    decision = study.decide("only", *seen)
    assert decision.solved is not None and decision.plan.forecast is not None
    futures = Futures.of(decision, np.random.default_rng(2), 200)
    one, _ = replace(futures, draws=futures.draws[:0]).solve(
        study.solver, decision.solved.point, ()
    )
    row = measured(futures, one, [one] * 200)
    draws = decision.plan.forecast.sample(np.random.default_rng(2), 200)
    apart = np.linalg.norm(draws[:, 0] - one.point.states[1:, :2], axis=-1)
    close = apart < 2.0 * study.robot.radius
    assert 0.2 < row["touched"] == close.any(axis=1).mean() < 0.8
    assert row["touched_worst_step"] == close.mean(axis=0).max() < row["touched"]
    low, high = clopper_pearson(int(close.any(axis=1).sum()), 200)
    assert (row["touched_low"], row["touched_high"]) == pytest.approx((low, high), rel=1e-3)
    assert row["tail_held"] == pytest.approx(0.999, abs=1e-4)


def test_modes_are_drawn_by_their_weight(
    shipped: KnownFutures, seen: tuple[Path, list[Observation]]
) -> None:
    """One mode 100 m aside: its futures cost what the plan without obstacles costs."""
    study = small(shipped, predictor=Mixed(weight=0.25, aside=100.0))
    decision = study.decide("only", *seen)
    assert decision.solved is not None
    futures = Futures.of(decision, np.random.default_rng(1), 400)
    assert futures.names == ("upper",) and futures.draws.shape[1] == 1
    far = futures.draws[:, 0, -1, 1] > 50.0
    assert 0.68 < far.mean() < 0.82
    assert np.array_equal(far, futures.draws[:, 0, 0, 1] > 50.0)
    few = replace(futures, draws=futures.draws[far][:3])
    one, found = few.solve(study.solver, decision.solved.point, STARTS)
    best = [min(own.cost for own in some) for some in found]
    assert np.ptp(best) < 1e-6 * best[0] and best[0] < 0.1 * one.cost


def test_another_solver_finds_the_same_costs(
    shipped: KnownFutures, monkeypatch: pytest.MonkeyPatch
) -> None:
    """fatrop against the compiled recursion, at a level held by the ellipse."""
    monkeypatch.setattr(known_futures, "STARTS", ())  # from one start
    one = {"means": shipped.planners["means"]}
    study = replace(shipped, planners=one, instants=(INSTANT,), shown_instant=0, draws=3)
    rows = [
        replace(study, solver=solver).measure(study.tasks()[0]).rows[0]
        for solver in (Fatrop(), Riccati())
    ]
    assert rows[0]["solved"] == rows[1]["solved"] == 1.0
    for name in ("cost", "cost_known", "cost_known_q05", "cost_known_q95"):
        # fatrop lets the slack of 15 steps fall to -1e-8 at a price of 1e5: 0.015; the table keeps
        # four digits, and either may be rounded to the next one
        digit = 10.0 ** (np.floor(np.log10(rows[1][name])) - 3)
        assert rows[0][name] == pytest.approx(rows[1][name], abs=0.02 + digit)


def test_rows_and_files_are_those_of_any_process(shipped: KnownFutures, tmp_path: Folder) -> None:
    study = replace(small(shipped), draws=4)
    result = run(study, tmp_path / "one", workers=2)
    made = study.measure(study.tasks()[0])
    assert result.rows == [made.rows[0] | {"remark": None}]  # an empty cell
    assert result.read("futures.npz") == made.files["futures.npz"]
    (png, pdf) = draw(tmp_path / "one")
    assert png.suffix == ".png" and pdf.suffix == ".pdf" and png.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"draws": 0}, "draws is 0; wanted a whole number"),
        ({"instants": ()}, "planners and instants must each name"),
        ({"instants": (8.0, 8.0), "shown_instant": 0}, "wanted each of them once"),
        ({"shown_instant": 9}, "shown_instant is 9; wanted the place of one of 5"),
    ],
)
def test_bad_settings_are_refused(
    shipped: KnownFutures, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(WideberthError, match=message):
        replace(shipped, **changes)  # type: ignore[arg-type]


def test_what_no_constructor_sees_is_refused_before_the_work(
    shipped: KnownFutures, seen: tuple[Path, list[Observation]]
) -> None:
    short = replace(shipped.settings, time_limit=2.0)
    with pytest.raises(WideberthError, match=r"ended at 2 s .* instants holds 8 s: take earlier"):
        replace(small(shipped), settings=short).check()
    with pytest.raises(WideberthError, match="does not say how its steps belong together"):
        small(shipped, predictor=Mixed(joint=False)).check()
    none = small(shipped, most_obstacles=0).decide("only", *seen)
    with pytest.raises(WideberthError, match="holds none of the forecast obstacles"):
        Futures.of(none, np.random.default_rng(0), 1)


def test_an_obstacle_out_of_reach_of_a_narrow_region_has_futures_too() -> None:
    """Of the planner that keeps clear of the means alone, at the first instant of seed 1."""
    study, _ = read_experiment("known_futures", ["seed=1"])
    assert isinstance(study, KnownFutures)
    way, seen = study.watched(min(study.instants))
    futures = Futures.of(study.decide("means", way, seen), np.random.default_rng(0), 3)
    assert futures.names == ("upper",) and len(futures.draws) == 3
