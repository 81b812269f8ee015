"""ACP, CC and ECP: the contract, each formula by hand, and the faults of the published code."""

import re
from functools import partial

import numpy as np
import pytest

from wideberth.framework.plugins.config import build, describe
from wideberth.framework.testing.controller import check_controller
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.contracts import Contract
from wideberth_arenas.controllers.acp import EPISODE, AdaptiveConformalPlanner
from wideberth_arenas.controllers.cc import ConformalController
from wideberth_arenas.controllers.ecp import EgocentricConformalPlanner
from wideberth_arenas.controllers.sampled_paths import SampledPaths, SeenPeople, clearance

ROBOT = Unicycle(0.4, 0.8, 0.7, 1e3, 1e3)
KINDS = (AdaptiveConformalPlanner, ConformalController, EgocentricConformalPlanner)
FEW = {"paths": 60}

CONTRACT = Contract(
    {
        f"{name}, {robot}, as_published={published}": partial(
            build,
            "controllers",
            {"type": name, "robot": robot, "as_published": published, **FEW},
        )
        for name in ("acp", "cc", "ecp")
        for robot, published in (
            ("unicycle", False),
            ("unicycle", True),
            ("differential_drive", False),
        )
    },
    check_controller.laws,
)


@pytest.mark.parametrize(("name", "law"), CONTRACT.cases())
def test_contract(name, law):
    CONTRACT.check(name, law)


@pytest.mark.parametrize("name", ["acp", "cc", "ecp"])
def test_config_and_refusals(name):
    config = describe(build("controllers", {"type": name, "robot": "unicycle"}))
    assert describe(build("controllers", config)) == config
    for robot in ("holonomic", "bicycle", "holonomic_3d"):
        with pytest.raises(WideberthError, match="robots that turn on the spot"):
            build("controllers", {"type": name, "robot": robot})
    with pytest.raises(WideberthError, match="paths is 0"):
        build("controllers", {"type": name, "robot": "unicycle", "paths": 0})


def person(name, *place):
    return Detection(name, np.array(place, dtype=float), np.zeros((2, 2)), 0.5)


def seen_at(stamp, *people, state=(0.0, 0.0, 0.0, 0.0, 0.0)):
    return Observation(stamp, np.array(state), people)


def ready(kind, **settings):
    made = kind(ROBOT, **{**FEW, **settings})
    made.set_path(Path(np.array([[0.0, 0.0], [8.0, 0.0]])))
    return made


def people(row, now, ahead, radius=0.5):
    now, ahead = np.array(now, dtype=float), np.array(ahead, dtype=float)
    return SeenPeople(row, tuple("abc"[: len(now)]), np.full(len(now), radius), now, ahead)


def test_paths_are_eulers_and_their_cost_is_the_sum():
    rng = np.random.default_rng(3)
    velocities = rng.uniform(-1.0, 1.0, (5, 7, 2)).astype(np.float32)
    paths = SampledPaths.rolled_out(np.array([1.0, -2.0, 0.3]), velocities, 0.4)
    goal = np.array([3.0, 1.0])
    for points, own, cost in zip(paths.points, velocities, paths.goal_cost(goal), strict=True):
        place, heading, total = np.array([1.0, -2.0]), 0.3, 0.0
        for k, (v, w) in enumerate(own):
            np.testing.assert_allclose(points[k], place, atol=1e-5)
            total += np.sum((place - goal) ** 2) + 0.001 * (v**2 + w**2)
            place = place + 0.4 * v * np.array([np.cos(heading), np.sin(heading)])
            heading += 0.4 * w
        assert cost == pytest.approx(total + 10.0 * np.sum((place - goal) ** 2), rel=1e-5)


def test_clearance_is_that_of_the_nearest_surface():
    rng = np.random.default_rng(4)
    points, others = rng.normal(size=(6, 3, 2)), rng.normal(size=(4, 3, 2))
    radius = rng.uniform(0.1, 0.9, 4)
    for p in range(6):
        for k in range(3):
            gaps = [np.hypot(*(points[p, k] - others[o, k])) - radius[o] for o in range(4)]
            assert clearance(points, others, radius)[p, k] == pytest.approx(min(gaps))


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_gives_the_same_commands(kind):
    def commands(seed):
        made = ready(kind, seed=seed)
        crowd = (person("a", 14.0, 0.3), person("b", 5.0, -16.0))
        return [made.command(seen_at(0.4 * k, *crowd)) for k in range(4)]

    assert commands(1) == commands(1) != commands(2)


@pytest.mark.parametrize("kind", KINDS)
def test_the_last_decision_is_tried_again_one_step_later(kind):
    """As published the steps are taken for blocks: half as fast."""
    pose = np.zeros(3)
    for published in (False, True):
        made = ready(kind, as_published=published)
        made.command(seen_at(0.0))
        last = made._last.copy()
        first = made._drawn(pose).velocities[0]
        if published:
            np.testing.assert_array_equal(first, np.repeat(last[1:7], 2, axis=0))
        else:
            np.testing.assert_array_equal(first, np.vstack([last[1:], last[-1:]]))


@pytest.mark.parametrize("kind", [AdaptiveConformalPlanner, EgocentricConformalPlanner])
def test_a_robot_without_an_allowed_path_stands_and_says_so(kind):
    made = ready(kind)
    ring = [person(str(k), 1.0 * np.cos(k), 1.0 * np.sin(k)) for k in range(6)]
    command = made.command(seen_at(0.0, *ring))
    assert command.linear == (0.0, 0.0) and command.omega == 0.0
    assert made.reason == "none of 60 paths is allowed"
    made.command(seen_at(40.0))
    assert not made.reason


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("stamp", "x", "reason"), [(0.0, 1e200, r"holds 1e\+200"), (1.7e308, 0.0, "^$")]
)
def test_numbers_near_the_largest_do_not_overflow(kind, stamp, x, reason):
    """An instant whose number is no float any more is not learnt from."""
    made = ready(kind)
    with np.errstate(over="raise"):
        made.command(seen_at(stamp, person("a", 3.0, 0.0), state=(x, 0.0, 0.0, 0.0, 0.0)))
    assert re.search(reason, made.reason)


def test_acp_scores_and_alphas_by_hand():
    """One person is off by 0.1 m at step 1; the radii are bounds until there are scores."""
    made = ready(AdaptiveConformalPlanner, steps=2, tail=0.5, rate=0.1)
    made.learn(people(0, [[0, 0]], [[[1, 0], [2, 0]]]), np.zeros(2))
    np.testing.assert_allclose(made._radius, [0.6, 1.2])
    made.learn(people(1, [[1, 0.1]], [[[2, 0], [3, 0]]]), np.zeros(2))
    # ceil(2 * 0.5) = 1 of one score; it was within the bound of 0.6 m.
    np.testing.assert_allclose(made._radius, [0.1, 1.2])
    np.testing.assert_allclose(made._alpha, [0.55, 0.5])
    made.learn(people(2, [[2, 0.3]], [[[3, 0], [4, 0]]]), np.zeros(2))
    # 0.3 m off at step 1 where 0.1 m was promised; ceil(3 * 0.45) = 2 of (0.1, 0.3).
    np.testing.assert_allclose(made._radius, [0.3, 0.3])
    np.testing.assert_allclose(made._alpha, [0.5, 0.55])


@pytest.mark.parametrize("alpha", [0.05, 0.1, 0.2, 0.5])
def test_acp_radius_has_the_finite_sample_rank(alpha):
    """The smallest score that 1 - alpha of exchangeable ones do not exceed, on average."""
    made = ready(AdaptiveConformalPlanner, steps=1, tail=alpha)
    rng = np.random.default_rng(7)
    for count in (5, 9, 10, 30):
        made._scores = [rng.uniform(0.0, 0.6, count).tolist()]
        radius, ordered = made._quantile(0), sorted(made._scores[0])
        kept = sum(score <= radius for score in ordered) / (count + 1)
        if radius == pytest.approx(0.6):
            assert count / (count + 1) < 1.0 - alpha  # not even the largest score is enough
        else:
            assert kept >= 1.0 - alpha - 1e-9 > kept - 1 / (count + 1) - 1e-9


@pytest.mark.parametrize(("alpha", "published", "mended"), [(-0.1, 0.6, 0.6), (1.2, 0.0, 0.0)])
def test_acp_beyond_the_levels(alpha, published, mended):
    for as_published, wanted in ((True, published), (False, mended)):
        made = ready(AdaptiveConformalPlanner, steps=1, as_published=as_published)
        made._scores, made._alpha = [[0.2] * 20], np.array([alpha])
        assert made._quantile(0) == pytest.approx(wanted)


def test_acp_misses_as_often_as_it_says_in_the_long_run():
    """The law of its source, whatever the errors do: they grow tenfold here."""
    made = ready(AdaptiveConformalPlanner, steps=1, tail=0.2)
    rng, missed = np.random.default_rng(8), []
    for row in range(3000):
        size = 0.01 * (1.0 + 9.0 * row / 3000)
        radius = made._radius[0]
        place = rng.normal(0.0, size, 2)
        made.learn(people(row, [place], [[[0.0, 0.0]]]), np.zeros(2))
        missed.append(np.hypot(*place) > radius)
    # |mean - alpha| <= (largest alpha + gamma) / (gamma T), Gibbs and Candes.
    assert abs(np.mean(missed) - 0.2) <= (0.8 + 0.05) / (0.05 * 3000)


def test_acp_draws_from_one_generator_in_all_episodes_of_a_process():
    """The numbers drawn depend on nothing but how many scores there are."""
    rng = np.random.RandomState(0)
    for _ in range(2):  # two episodes by the published code's own order of draws
        for count in range(EPISODE):
            for step in range(12):
                scores = max(0, count - step)
                if scores < 12:
                    rng.choice([1.0] * 12, size=12 - scores)
                else:
                    rng.choice(np.arange(scores), size=12)
    made = ready(AdaptiveConformalPlanner, as_published=True, earlier=2)
    np.testing.assert_array_equal(made._global.get_state()[1], rng.get_state()[1])
    assert made._global.get_state()[2] == rng.get_state()[2]


def test_acp_calls_a_forecast_without_anyone_left_right_as_published():
    for flag, scores in ((True, [0.0]), (False, [])):
        made = ready(AdaptiveConformalPlanner, steps=1, as_published=flag)
        made.learn(people(0, [[0, 0]], [[[1, 0]]]), np.zeros(2))
        made.learn(people(1, np.zeros((0, 2)), np.zeros((0, 1, 2))), np.zeros(2))
        assert made._scores == [scores]


def test_cc_weight_by_hand():
    """lambda - eta (epsilon + distance), from the next instant on, at least 0.01."""
    made = ready(ConformalController, risk=-2.0, rate=10.0)
    weights = []
    for k, away in enumerate((1.5, 1.9, 2.2, 2.6)):
        made.learn(people(k, [[away, 0.0], [9.0, 0.0]], np.zeros((2, 1, 2))), np.zeros(2))
        weights.append(made._weight)
    np.testing.assert_allclose(weights, [1.0, 6.0, 7.0, 5.0])
    assert made._next == pytest.approx(0.01)


def test_cc_pays_for_distance():
    made = ready(ConformalController, steps=1)
    velocities = np.array([[[0.5, 0.0]], [[-0.5, 0.0]]], dtype=np.float32)
    paths = SampledPaths.rolled_out(np.zeros(3), velocities, 0.4)
    cost = made.cost(paths, np.zeros(2), people(0, [[2.0, 0.0]], [[[2.0, 0.0]]]))
    np.testing.assert_allclose(cost, [-1.8, -2.2], rtol=1e-6)


def test_ecp_scores_count_only_who_comes_nearer():
    made = ready(EgocentricConformalPlanner, steps=1, tail=0.4, rate=0.1, window=4)
    errors = (0.1, 0.4, -0.3, 0.2)
    for row, nearer in enumerate((0.0, *errors)):
        # Forecast at (1, 0), really nearer to the robot's point (0, 0) by that much.
        made.learn(people(row, [[1.0 - nearer, 0.0]], [[[1.0, 0.0]]]), np.zeros(2))
    points = np.zeros((2, 2, 2), dtype=np.float32)
    points[1, 1] = 1.0, 5.0  # far to the side: nothing comes nearer
    margin = made._margins(points, 4)
    # ceil(5 * 0.6) = 3 of (0, 0.1, 0.2, 0.4)
    np.testing.assert_allclose(margin[0], [0.2], atol=1e-6)
    assert 0.0 <= margin[1, 0] < 0.02


def test_ecp_alpha_follows_the_share_of_paths_that_were_missed():
    made = ready(EgocentricConformalPlanner, steps=1, tail=0.4, rate=0.1)
    made.learn(people(0, [[1.0, 0.0]], [[[1.0, 0.0]]]), np.zeros(2))
    points = np.zeros((4, 2, 2), dtype=np.float32)
    points[3, 1] = -50.0, 400.0
    paths = SampledPaths(points, np.zeros((4, 1, 2), dtype=np.float32))
    made.cost(paths, np.zeros(4), people(0, [[1.0, 0.0]], [[[1.0, 0.0]]]))
    made.learn(people(1, [[0.1, 0.0]], [[[1.0, 0.0]]]), np.zeros(2))  # 0.9 m nearer than said
    np.testing.assert_allclose(made._alpha, [0.4 + 0.1 * (0.4 - 0.75)])


def test_ecp_as_published_drives_at_full_speed_or_stands():
    for flag in (True, False):
        made, found = ready(EgocentricConformalPlanner, as_published=flag), set()
        for k in range(30):
            place = person("a", 12.0 - 0.2 * k, 0.1)
            found.add(round(made.command(seen_at(0.4 * k, place)).linear[0], 6))
        assert found == {0.0, 0.8} if flag else len(found - {0.0, 0.8}) > 3


def test_no_path_is_drawn_that_drives_backwards_further_than_the_robot_may():
    """Else what is driven is not what was held against people."""
    made = AdaptiveConformalPlanner(Unicycle(0.4, 0.8, 0.7, 1e3, 1e3, max_reverse_speed=0.1))
    speeds = made._drawn(np.zeros(3)).velocities[..., 0]
    assert -0.1 <= speeds.min() < -0.09 and speeds.max() > 0.79
