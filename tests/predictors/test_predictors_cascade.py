"""The cascade: the first healthy stage serves, the reasons name the others."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import pytest

from wideberth.framework.plugins.config import build, describe
from wideberth.framework.predictor import Fittable, Predictor
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.cascade import FallbackChain, FallbackStage
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.static import Static
from wideberth.predictors.var import VectorAutoregression

DT = 0.5
STEPS = 4


def tracks_of(histories: Sequence[np.ndarray], rows: int = 70) -> Tracks:
    """Tracks whose ends are the given histories."""
    positions = np.full((len(histories), rows, 2), np.nan)
    for place, history in zip(positions, histories, strict=True):
        if len(history):
            place[-len(history) :] = history
    noise = np.tile(1e-4 * np.eye(2), (len(histories), 1, 1))
    ids = tuple(f"o{i}" for i in range(len(histories)))
    return Tracks(positions, DT, ids, np.full(len(histories), 0.3), noise)


def walk(samples: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    velocity = np.array([0.8, -0.3]) + np.cumsum(0.02 * rng.standard_normal((samples, 2)), axis=0)
    return np.cumsum(DT * velocity, axis=0)


@dataclass(frozen=True)
class Modes(Predictor):
    """Two modes, the second of weight 0 or not; it refuses those whose x is above a limit."""

    weight: float = 0.5
    limit: float = np.inf
    step: float = 1.0

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        plain = Static().predict(tracks, steps)
        ahead = self.step * np.arange(1, steps + 1)[:, None] * np.eye(2)[0]
        mean = np.concatenate([plain.mean, plain.mean + ahead], axis=1)
        covariance = np.repeat(plain.covariance, 2, axis=1)
        weight = np.tile([1 - self.weight, self.weight], (len(tracks), 1))
        far = tracks.positions[:, -1, 0] > self.limit
        reasons = tuple("modes: too far" if x else None for x in far)
        return Forecast(mean, covariance, weight, tracks.dt, reasons)


@dataclass(frozen=True)
class Broken(Predictor):
    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        raise ValueError("always")


@dataclass(frozen=True)
class Learner(Fittable):
    scenes: int = 0

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        return replace(self, scenes=self.scenes + len(dataset))

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        return Static().predict(tracks, steps, scene)


@dataclass(frozen=True)
class Counted(Predictor):
    """Notes how many obstacles it was asked for."""

    calls: list[int]
    base: Predictor

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        self.calls.append(len(tracks))
        return self.base.predict(tracks, steps, scene)


def test_the_length_of_the_history_chooses() -> None:
    stages = (
        FallbackStage(VectorAutoregression(), 60),
        FallbackStage(Kalman(), 3),
        FallbackStage(Static()),
    )
    tracks = tracks_of([walk(70), walk(59, 1), walk(3, 2), walk(2, 3), walk(0)])
    got = FallbackChain(stages).predict(tracks, STEPS)
    served = [stages[0], stages[1], stages[1], stages[2], stages[2]]
    for index, stage in enumerate(served):
        wanted = stage.predictor.predict(tracks.select([index]), STEPS)
        assert np.allclose(got.mean[index], wanted.mean[0], rtol=0, atol=1e-12)
        assert np.allclose(got.covariance[index], wanted.covariance[0], rtol=1e-9)
        assert got.joint is not None and wanted.joint is not None
        assert np.allclose(got.joint[index], wanted.joint[0], rtol=1e-9)
    assert got.fallback == (
        None,
        "var: 59 samples, needs 60",
        "var: 3 samples, needs 60",
        "var: 2 samples, needs 60; kalman: 2 samples, needs 3",
        "var: 0 samples, needs 60; kalman: 0 samples, needs 3; static: never observed",
    )


def test_samples_before_a_long_gap_do_not_count() -> None:
    history = walk(70)
    history[40:60] = np.nan
    got = FallbackChain((FallbackStage(Kalman(), 11), FallbackStage(Static()))).predict(
        tracks_of([history]), STEPS
    )
    assert got.fallback == ("kalman: 10 samples, needs 11",)


def test_a_reason_of_its_own_passes_the_stage_over() -> None:
    """The straight line has no VAR; var's own fallback would have been constant velocity."""
    line = np.outer(np.arange(70.0), [0.4, 0.2])
    var = VectorAutoregression(fallback=ConstantVelocity())
    got = FallbackChain((FallbackStage(var), FallbackStage(Kalman()))).predict(
        tracks_of([line, walk(70)]), STEPS
    )
    assert got.fallback[0] is not None and "collinear" in got.fallback[0]
    assert got.fallback[1] is None
    wanted = Kalman().predict(tracks_of([line]), STEPS)
    assert np.array_equal(got.mean[0], wanted.mean[0])


def test_the_last_stage_serves_whatever_it_says() -> None:
    got = FallbackChain((FallbackStage(ConstantVelocity()),)).predict(tracks_of([walk(1)]), STEPS)
    assert got.fallback == ("constant_velocity: 1 sample, needs 2",)


@pytest.mark.parametrize(("limit", "served"), [(1.9, False), (2.1, True)])
def test_speed_counts_every_possible_mode(limit: float, served: bool) -> None:
    tracks = tracks_of([walk(5)])
    stages = (FallbackStage(Modes(step=1.0), max_speed=limit), FallbackStage(Static()))
    got = FallbackChain(stages).predict(tracks, STEPS)
    assert (got.fallback[0] is None) == served
    if not served:
        assert "Modes: predicted speed 2 m/s, at most 1.9" in str(got.fallback[0])
    unused = replace(stages[0], predictor=Modes(weight=0.0))
    assert FallbackChain((unused, stages[1])).predict(tracks, STEPS).fallback == (None,)


def test_speed_counts_the_time_since_the_newest_sample() -> None:
    """Three steps unseen at 1 m/s are 2 m at the first step: no 4 m/s."""
    path = np.outer(DT * np.arange(20.0), [1.0, 0.0])
    path[-3:] = np.nan
    stages = (FallbackStage(ConstantVelocity(), max_speed=1.001), FallbackStage(Static()))
    got = FallbackChain(stages).predict(tracks_of([path]), STEPS)
    assert got.fallback == (None,)
    slower = replace(stages[0], max_speed=0.999)
    got = FallbackChain((slower, stages[1])).predict(tracks_of([path]), STEPS)
    assert got.fallback == ("constant_velocity: predicted speed 1 m/s, at most 0.999",)


def test_modes_and_single_gaussians_stand_side_by_side() -> None:
    tracks = tracks_of([walk(5), walk(5) + 100.0])
    got = FallbackChain((FallbackStage(Modes(limit=50.0)), FallbackStage(Kalman()))).predict(
        tracks, STEPS
    )
    assert got.fallback == (None, "modes: too far")
    assert got.weight.tolist() == [[0.5, 0.5], [1.0, 0.0]]
    wanted = Kalman().predict(tracks.select([1]), STEPS)
    assert np.array_equal(got.mean[1, 0], wanted.mean[0, 0])


def test_a_stage_that_raises_is_passed_over() -> None:
    got = FallbackChain((FallbackStage(Broken(), 3), FallbackStage(Kalman()))).predict(
        tracks_of([walk(5), walk(2)]), STEPS
    )
    reasons = [str(reason) for reason in got.fallback]
    assert f"Broken: ValueError: always ({__file__}, line " in reasons[0]
    assert reasons[1].endswith("Broken: 2 samples, needs 3")
    assert np.array_equal(got.mean, Kalman().predict(tracks_of([walk(5), walk(2)]), STEPS).mean)


def test_each_stage_is_asked_once_for_those_still_open() -> None:
    calls: tuple[list[int], ...] = ([], [], [])
    bases = (Modes(limit=50.0), Kalman(), Static())
    stages = tuple(
        FallbackStage(Counted(asked, base), least)
        for asked, base, least in zip(calls, bases, (1, 3, 1), strict=True)
    )
    tracks = tracks_of([walk(5), walk(2) + 100.0, walk(5) + 100.0, walk(5)])
    FallbackChain(stages).predict(tracks, STEPS)
    assert calls == ([4], [2], [1])
    FallbackChain(stages).predict(tracks_of([walk(2) + 100.0]), STEPS)
    assert calls == ([4, 1], [2], [1, 1]), "nobody may use the second stage"


def test_goals_follow_the_obstacles() -> None:
    @dataclass(frozen=True)
    class ToGoal(Predictor):
        def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
            assert scene is not None and scene.goals is not None
            plain = Static().predict(tracks, steps)
            mean = np.broadcast_to(scene.goals[:, None, None], plain.mean.shape)
            return replace(plain, mean=mean, fallback=(None,) * len(tracks))

    goals = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    tracks = tracks_of([walk(9), walk(2), walk(3)])
    got = FallbackChain((FallbackStage(Kalman(), 4), FallbackStage(ToGoal()))).predict(
        tracks, 1, Scene(goals=goals)
    )
    assert np.array_equal(got.mean[1:, 0, 0], goals[1:])


def test_fit_reaches_the_stages_that_learn_and_leaves_the_original() -> None:
    cascade = FallbackChain((FallbackStage(Learner(), 5, 2.0), FallbackStage(Static())))
    fitted = cascade.fit([tracks_of([walk(9)])] * 3)
    assert fitted.stages == (FallbackStage(Learner(3), 5, 2.0), FallbackStage(Static()))
    assert cascade.stages[0].predictor == Learner()


def test_laws_and_config() -> None:
    stages = (
        FallbackStage(VectorAutoregression(), 20, 3.0),
        FallbackStage(Kalman(), 2, 3.0),
        FallbackStage(Static()),
    )
    check_predictor(FallbackChain(stages), dimensions=(2,))
    config = {
        "type": "wideberth.predictors.cascade:FallbackChain",
        "stages": [
            {"predictor": "var", "minimum_samples": 30},
            {"predictor": {"type": "kalman"}, "max_speed": 3},
        ],
    }
    made = build("predictors", config)
    assert made == FallbackChain(
        (FallbackStage(VectorAutoregression(), 30), FallbackStage(Kalman(), 1, 3.0))
    )
    assert build("predictors", describe(made)) == made


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: FallbackChain(()), "wanted one stage at least"),
        (lambda: FallbackStage(Static(), 0), "stage.minimum_samples is 0"),
        (lambda: FallbackStage(Static(), 1, -1.0), "stage.max_speed is -1"),
    ],
)
def test_bad_settings(make, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(WideberthError, match=words):
        make()
