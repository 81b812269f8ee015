"""Instances made for the benchmark hold what they promise."""

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from wideberth.benchmarks.recorded_instances import Instance, read_instances
from wideberth.framework import names
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.planner.verify import violation
from wideberth.framework.plugins.config import build
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = ROOT / "tests" / "data" / "mpc_instances.npz"


@pytest.fixture
def instances(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    return import_module("instances")


@pytest.fixture
def perturbations(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    return import_module("perturbations")


@pytest.mark.parametrize("region", names("regions"))
def test_the_guess_is_feasible(region: str, instances: ModuleType) -> None:
    """By the planner's own check, for every robot that the region knows."""
    made = build("regions", region)
    for robot in (build("robots", name) for name in names("robots")):
        if robot.dimension in made.dimensions:
            for one in instances.Recipe(robot, made, Fixed(), 2, 15).make(range(2)):
                assert violation(one.problem, one.parameters, one.guess).worst < 1e-9


@pytest.mark.parametrize(("obstacles", "steps"), [(0, 15), (1, 60), (100, 15), (20, 30)])
def test_any_size(obstacles: int, steps: int, instances: ModuleType) -> None:
    recipe = instances.Recipe(
        Unicycle(), MahalanobisEllipse(), Relaxed(weight=1.0, minimum=0.0), obstacles, steps
    )
    first, second = recipe.make(range(2))
    assert first.parameters.slots[0].level.shape == (steps, obstacles)
    assert first.problem is second.problem
    for one in (first, second):
        assert violation(one.problem, one.parameters, one.guess).worst < 1e-9
    if obstacles:
        assert not np.array_equal(
            first.parameters.slots[0].parameters, second.parameters.slots[0].parameters
        )
        spread = first.parameters.slots[0].parameters[
            ..., 6:8
        ]  # deviations grow with the root of time
        np.testing.assert_allclose(spread[-1] / spread[0], np.sqrt(steps), rtol=1e-9)


def test_a_seed_is_an_instance(instances: ModuleType) -> None:
    recipe = instances.Recipe(
        Unicycle(), MahalanobisEllipse(), Relaxed(weight=1.0, minimum=0.0), 5, 15
    )
    (once,), (again,) = recipe.make(range(3, 4)), recipe.make(range(3, 4))
    np.testing.assert_array_equal(once.parameters.stages(), again.parameters.stages())
    np.testing.assert_array_equal(once.guess.states, again.guess.states)


def test_nine_kinds_of_trouble(perturbations: ModuleType, tmp_path: Path) -> None:
    made = tmp_path / "hard.npz"
    perturbations.perturb(SAMPLE, made, 3, seed=1)
    found = list(read_instances(made, MahalanobisEllipse()))
    kinds = list(perturbations.KINDS)
    assert [one.kind for one in found] == 3 * kinds and len(kinds) == 9
    plain = list(read_instances(SAMPLE, MahalanobisEllipse()))
    of = dict(zip(kinds, found[:9], strict=True))
    (origin,) = [
        one
        for one in plain
        if np.array_equal(one.parameters.initial, of["jump"].parameters.initial)
        and np.array_equal(one.parameters.reference, of["jump"].parameters.reference)
    ]
    turn = [of[kind].parameters.initial[2] - origin.parameters.initial[2] for kind in kinds]
    assert turn[kinds.index("wrap2pi")] == pytest.approx(2 * np.pi)
    assert turn[kinds.index("face_back")] == pytest.approx(np.pi)
    np.testing.assert_allclose(of["hugecov"].ellipses[2], 8 * origin.ellipses[2])
    assert of["singcov"].ellipses[2][..., 1].max() == 1e-8
    moved = of["jump"].ellipses[0] - origin.ellipses[0]
    np.testing.assert_allclose(np.linalg.norm(moved[0], axis=-1), 0.8)
    assert of["wrap2pi"].best_cost == origin.best_cost and np.isnan(of["jump"].best_cost)
    stuck = of["x0_inside"]
    assert gauge(stuck, stuck.parameters.initial[:2])[0] < 1.0
    middle = of["guess_inside"]
    assert gauge(middle, middle.guess.states[7, :2])[0] < 1.0
    assert gauge(middle, middle.parameters.initial[:2])[0] > 1.0
    head_on = of["symmetric"]
    assert not head_on.ellipses[0][0, :, 1].any() and not head_on.parameters.initial[1:3].any()


def gauge(instance: Instance, place: np.ndarray) -> np.ndarray:
    """Distance in margins of each obstacle at the first step: below 1 inside whatever s is."""
    mean, _, _, margin = instance.ellipses
    return np.asarray(np.linalg.norm(mean[:, 0] - place, axis=-1) / margin)
