"""Risk in closed loop: the crowds follow their models, what is counted, and the shipped config."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.engine.base import Result
from wideberth.experiments.engine.csv_tables import write_table
from wideberth.experiments.engine.runner import run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.closed_loop_risk import (
    COUNTED,
    ClosedLoopRisk,
    allowed,
)
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.values.errors import WideberthError
from wideberth.metrics.statistics import ratio_interval
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.simulation.scenarios import model_crowd
from wideberth.simulation.scenarios.model_crowd import (
    Autoregression,
    ModelCrowd,
    WhiteAcceleration,
)
from wideberth.tests.helpers.sweeps import contents

DT = 0.5


def walks(motion, count, draws=4000):
    rng = np.random.default_rng(3)
    return np.array([motion.walk(rng, count, DT) for _ in range(draws)])


def near(sample, wanted, draws=4000, sigmas=4.0):
    """Sample variances (zero mean) against the true ones; both axes are draws."""
    assert np.abs(sample - wanted).max() < sigmas * np.max(wanted) * np.sqrt(2 / (2 * draws))


def test_white_acceleration_is_the_integral_of_its_noise():
    """Var p(t) = s^2 t^2 + q t^3 / 3 and Var(p(t + dT) - p(t)) from v(t) and one step's noise."""
    motion = WhiteAcceleration(acceleration_density=0.05, speed=0.4)
    way = walks(motion, 9)
    for k in (1, 4, 8):
        t = k * DT
        near((way[:, k] ** 2).mean(), 0.4**2 * t**2 + 0.05 * t**3 / 3)
    step = way[:, 8] - way[:, 7]
    near((step**2).mean(), DT**2 * (0.16 + 0.05 * 7 * DT) + 0.05 * DT**3 / 3)


def test_autoregression_is_stationary_with_its_covariances():
    """Yule-Walker: g1 = a1 g0 / (1 - a2), g0 = a1 g1 + a2 g2 + s^2, g2 = a1 g1 + a2 g0."""
    a, b, square = 0.6, 0.2, 0.04
    share = a / (1 - b)
    variance = square / (1 - a * share - b * (a * share + b))
    velocity = np.diff(walks(Autoregression((a, b), square), 12), axis=1) / DT
    for k in (0, 5, 10):
        near((velocity[:, k] ** 2).mean(), variance)
    near((velocity[:, 3] * velocity[:, 4]).mean(), share * variance)


def test_places_are_uniform_and_say_nothing_of_the_motion(monkeypatch):
    monkeypatch.setattr(model_crowd, "WALKERS", 4)
    monkeypatch.setattr(model_crowd, "ROOM", 0.0)
    crowd = ModelCrowd()
    agents = [crowd.cast(seed).bystanders for seed in range(400)]
    starts = np.array([[one.at(np.zeros(1))[0] for one in some] for some in agents]).reshape(-1, 2)
    moves = np.array([[one.at(np.array([1.0]))[0] for one in some] for some in agents])
    moves = moves.reshape(-1, 2) - starts
    assert starts[:, 0].min() >= 0.0 and starts[:, 0].max() <= model_crowd.REACH
    assert np.abs(starts[:, 1]).max() <= model_crowd.ASIDE
    share = 1 / np.sqrt(len(starts))
    assert abs(starts[:, 0].mean() / model_crowd.REACH - 0.5) < 4 * share * np.sqrt(1 / 12)
    correlation = np.corrcoef(np.concatenate([starts, moves], axis=1).T)[:2, 2:]
    assert np.abs(correlation).max() < 4 * share
    monkeypatch.setattr(model_crowd, "ROOM", 1.5)
    far = ModelCrowd()
    assert all(np.hypot(*one.at(np.zeros(1))[0]) >= 1.5 for one in far.cast(1).bystanders)


def test_bad_crowds_are_refused(monkeypatch):
    with pytest.raises(WideberthError, match="unit circle"):
        Autoregression((1.0, 0.1))
    with pytest.raises(WideberthError, match="unit circle"):
        Autoregression(())
    with pytest.raises(WideberthError, match="innovation"):
        Autoregression(innovation=0.0)
    monkeypatch.setattr(model_crowd, "ROOM", 50.0)
    with pytest.raises(WideberthError, match="no room"):
        ModelCrowd().cast(0)


def shipped(*overrides: str) -> ClosedLoopRisk:
    """The shipped config with a solver that needs no compiling."""
    overrides = ("planner.solver=fatrop", *overrides)
    experiment, _ = read_experiment("closed_loop_risk", list(overrides))
    assert isinstance(experiment, ClosedLoopRisk)
    return experiment


def test_the_config_states_each_model_to_its_predictor():
    """Or nominal would not be nominal."""
    experiment = shipped()
    white, auto = experiment.crowds["white acceleration"], experiment.crowds["autoregression"]
    kalman, known = white.predictors["kalman"], auto.predictors["known"]
    motion = white.scenario.motion
    assert isinstance(motion, WhiteAcceleration)
    assert kalman.acceleration_density == motion.acceleration_density
    assert (
        kalman.speed == motion.speed and kalman.noise_floor < 0.01 * white.settings.channel.noise
    )
    assert white.scenario.before == white.settings.history  # the filter starts where they do
    law = auto.scenario.motion
    assert isinstance(law, Autoregression)
    assert known.fitted.coefficients == law.coefficients
    assert known.fitted.innovation == law.innovation
    assert known.fitted.dt == ModelCrowd().dt == experiment.planner.dt
    assert auto.settings.channel.noise == 0.0
    assert experiment.seeds >= 2000


def test_quick_runs_and_counts(tmp_path: Path):
    experiment = shipped().quick()
    tasks = experiment.tasks()
    rows = [row for task in tasks for row in experiment.measure(task).rows]
    assert experiment.measure(tasks[1]).rows == rows[4:8]
    steps = range(1, experiment.planner.horizon + 1)
    for row in rows:
        assert row["kept"] <= row["plans"] and row["pairs"] <= row["kept"] * 3
        for name in COUNTED:
            assert all(0.0 <= row[f"{name}_{i}"] <= row["pairs"] for i in steps)
        assert all(row[f"near_touched_{i}"] <= row[f"touched_{i}"] for i in steps)
    lines = experiment.summary(rows)
    by_name = {(line["predictor"], line["steps"]): line for line in lines}
    assert by_name["paper", "all"]["outside"] > 0.3
    assert by_name["kalman", "all"]["outside"] < 0.25
    for line in lines:
        assert line["outside_nominal"] == pytest.approx(0.05)
        assert line["outside_low"] <= line["outside"] <= line["outside_high"]
    write_table(tmp_path / "table.csv", rows)
    drawn = experiment.figures(Result(tmp_path), tmp_path / "figures")
    assert {path.suffix for path in drawn} == {".png", ".pdf"}


def test_outside_is_the_mahalanobis_distance_of_the_content():
    """Of one plan, by another formula: chi-squared with two degrees of freedom."""
    experiment = shipped("levels={content_5: {type: fixed, tail: 0.05}}", "seeds=3")
    task = next(task for task in experiment.tasks() if task.settings["predictor"] == "paper")
    crowd = experiment.crowds["autoregression"]
    planner = replace(experiment.planner, predictor=crowd.predictors["paper"])
    from wideberth.experiments.engine.closed_loop import play

    count = np.zeros(planner.horizon)
    for seed in range(3):
        planner = replace(planner, level=experiment.levels["content_5"])
        episode = play(crowd.scenario, planner.robot, planner, crowd.settings, seed)
        walkers = {one.name: one for one in crowd.scenario.cast(seed).bystanders}
        for plan in episode.robots[0].plans:
            if plan.below_reference is False:
                times = plan.stamp + plan.dt * np.arange(1, planner.horizon + 1)
                for o, name in enumerate(plan.tracked):
                    error = walkers[name].at(times) - plan.forecast.mean[o, 0]
                    whitened = np.linalg.solve(plan.forecast.covariance[o, 0], error[..., None])
                    square = np.einsum("nd,nd->n", error, whitened[..., 0])
                    count += square >= -2 * np.log(0.05)
    rows = experiment.measure(task).rows
    wanted = [sum(row[f"outside_{i}"] for row in rows) for i in range(1, planner.horizon + 1)]
    assert count.tolist() == wanted


def test_what_a_level_allows():
    planner = shipped().planner
    assert isinstance(planner, Planner)
    risk = shipped().levels["risk_5"]
    exact = replace(planner, region=MinkowskiSum(), level=risk)
    assert allowed(exact) == pytest.approx(0.05)
    assert allowed(replace(planner, level=risk)) == pytest.approx(0.05)
    content = replace(planner, level=shipped().levels["content_5"])
    assert allowed(content) == pytest.approx(0.00718, abs=1e-5)  # Phi(-2.4477)


def test_intervals_count_episodes_not_pairs():
    """Episodes of ten pairs that fare alike: ten times the pairs, the same interval."""
    rng = np.random.default_rng(0)
    hits = (rng.random(400) < 0.2).astype(float)
    one = ratio_interval(hits, np.ones(400))
    assert ratio_interval(10 * hits, np.full(400, 10.0)) == pytest.approx(one)
    assert one[1] - one[0] == pytest.approx(2 * 1.96 * np.sqrt(0.16 / 400), rel=0.15)
    assert ratio_interval(np.zeros(5), np.zeros(5)) == (0.0, 0.0)


def test_settings_that_make_no_experiment_are_refused():
    experiment = shipped()
    with pytest.raises(WideberthError, match="fixed"):
        replace(experiment, levels={"loose": Relaxed(weight=1.0, minimum=0.0)})
    with pytest.raises(WideberthError, match="at least one"):
        replace(experiment, crowds={})


def test_more_seeds_extend_a_result_whose_last_block_is_not_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from wideberth.experiments.studies import closed_loop_risk

    monkeypatch.setattr(closed_loop_risk, "BLOCK", 2)
    played: list[int] = []
    play = closed_loop_risk._play

    def noted(crowd: object, planner: object, seed: int) -> object:
        played.append(seed)
        return play(crowd, planner, seed)

    monkeypatch.setattr(closed_loop_risk, "_play", noted)
    level = "levels={content_5: {type: fixed, tail: 0.05}}"
    few, more = shipped(level, "seeds=3"), shipped(level, "seeds=5")
    whole = contents(run(more, tmp_path / "whole").folder)
    run(few, tmp_path / "grown")
    played.clear()
    run(more, tmp_path / "grown")
    assert sorted(set(played)) == [2, 3, 4]  # 2 stood alone in its block
    assert contents(tmp_path / "grown") == whole
