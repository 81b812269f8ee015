"""The mixture density network as a predictor: time, frames, gaps, files, and in the MPC."""

import json
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.plugins.config import build, describe, load_plugin, save_plugin
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path as Route
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.core.density_network import DensityNetwork, Layer, Modes
from wideberth.predictors.core.propagation import joint_covariance, white_acceleration
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.mixture_density import MixtureDensity
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.fatrop import Fatrop

DT = 0.4
NAN = np.nan


def network(seed=0, modes=3, observed=8, gain=1.0):
    """A network of random numbers: the laws must hold for any."""
    rng = np.random.default_rng(seed)
    inputs = 2 * observed
    sizes = [inputs, 10, modes * 16]
    layers = tuple(
        Layer(
            tuple(map(tuple, (gain / np.sqrt(a) * rng.standard_normal((a, b))).tolist())),
            tuple(rng.standard_normal(b).tolist()),
        )
        for a, b in pairwise(sizes)
    )
    centre, width = rng.standard_normal(inputs), rng.uniform(0.5, 2.0, inputs)
    return DensityNetwork(
        DT, observed, 12 * DT, 1.2, modes, tuple(centre.tolist()), tuple(width.tolist()), layers
    )


def tracks_of(positions, dt=DT, noise=0.02):
    positions = np.asarray(positions, dtype=float)
    count, _, size = positions.shape
    spread = np.tile(noise**2 * np.eye(size), (count, 1, 1))
    ids = tuple(f"o{i}" for i in range(count))
    return Tracks(positions, dt, ids, np.full(count, 0.3), spread)


def walks(count, samples, seed=0):
    rng = np.random.default_rng(seed)
    velocity = rng.standard_normal((count, 1, 2)) + 0.2 * rng.standard_normal((count, samples, 2))
    return DT * np.cumsum(velocity, axis=1) + 10.0 * rng.standard_normal((count, 1, 2))


@pytest.mark.parametrize("modes", [1, 4])
@pytest.mark.parametrize("gain", [1.0, 30.0])
def test_any_network_keeps_the_laws(modes, gain):
    check_predictor(MixtureDensity(fitted=network(1, modes, gain=gain)), dataset=())


def test_unfitted_says_what_it_states():
    rate, heading = 1.3, np.array([0.6, 0.8])
    track = DT * rate * np.arange(10)[:, None] * heading + [5.0, -2.0]
    forecast = MixtureDensity().predict(tracks_of([track]), 12)
    times = DT * np.arange(1, 13)
    wanted = track[-1] + rate * times[:, None] * heading
    np.testing.assert_allclose(forecast.mean[0, 0], wanted, atol=1e-12)
    np.testing.assert_allclose(forecast.weight[0], [0.8, 0.1, 0.1])
    aside = (forecast.mean[0, 1:] - wanted) @ np.array([[-0.8], [0.6]])
    np.testing.assert_allclose(aside[0], -aside[1], atol=1e-12)
    # 35 % of the way, but for the doubt in the heading: 0.05 m/s against 1.3 m/s
    assert aside[0, -1, 0] == pytest.approx(0.35 * 4.8 * rate, rel=1e-3)
    variance = (0.1 * times) ** 2 + 0.02 * times**3 / 3 + 0.02**2 + 0.01**2
    every = np.broadcast_to(variance[:, None, None] * np.eye(2), (3, 12, 2, 2))
    np.testing.assert_allclose(forecast.covariance[0], every, rtol=1e-10, atol=1e-15)


def test_joint_covariance_is_that_of_the_three_processes():
    steps, rng = 9, np.random.default_rng(2)
    roots = rng.standard_normal((3, 2, 2))
    growth = roots @ roots.swapaxes(1, 2)
    horizon = 3.0
    seen = Modes(
        np.ones((1, 1)), np.zeros((1, 2)), np.zeros((1, 1, 3, 2)), growth[None, None], horizon
    )
    times = DT * np.arange(1.0, steps + 1)[None]
    transition, density = white_acceleration(DT, 1.0, 1)
    still, unit = np.zeros((2, 2)), np.diag([0.0, 1.0])
    walk = np.minimum(times[0][:, None], times[0])
    drift = joint_covariance(transition, still, unit, 1, steps)
    white = joint_covariance(transition, density, still, 1, steps)
    parts = (walk / horizon, drift / horizon**2, 3 * white / horizon**3)
    wanted = sum(np.kron(part, one) for part, one in zip(parts, growth, strict=True))
    joint = seen.joint(times)[0, 0]
    np.testing.assert_allclose(joint, wanted, atol=1e-12)
    blocks = joint.reshape(steps, 2, steps, 2)[np.arange(steps), :, np.arange(steps)]
    np.testing.assert_allclose(seen.covariances(times)[0, 0], blocks, atol=1e-12)


def test_joint_of_the_forecast_has_the_steps_covariances_on_its_diagonal():
    forecast = MixtureDensity(fitted=network()).predict(tracks_of(walks(4, 8)), 6)
    joint = forecast.joint.reshape(4, 3, 6, 2, 6, 2)
    each = joint[:, :, np.arange(6), :, np.arange(6)].transpose(1, 2, 0, 3, 4)
    np.testing.assert_allclose(each, forecast.covariance, atol=1e-12)
    assert np.linalg.eigvalsh(forecast.joint).min() > 0


def test_standing_obstacles_are_told_nothing_of_a_direction():
    track = np.tile([3.0, 4.0], (8, 1))
    forecast = MixtureDensity(fitted=network()).predict(tracks_of([track]), 12)
    np.testing.assert_allclose(forecast.mean[0], np.full((3, 12, 2), [3.0, 4.0]), atol=1e-12)
    spread = forecast.covariance[0]
    np.testing.assert_allclose(spread[..., 0, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(spread[..., 0, 0], spread[..., 1, 1], rtol=1e-12)


def test_another_dt_is_the_same_future_on_another_grid():
    fine = walks(5, 15)
    predictor = MixtureDensity(fitted=network())
    coarse = predictor.predict(tracks_of(fine[:, ::2]), 6)
    dense = predictor.predict(tracks_of(fine, dt=DT / 2), 12)
    np.testing.assert_allclose(dense.mean[:, :, 1::2], coarse.mean, atol=1e-9)
    np.testing.assert_allclose(dense.covariance[:, :, 1::2], coarse.covariance, atol=1e-9)
    # and between two samples of a coarser track lie straight lines
    slow = tracks_of(walks(5, 7, seed=3), dt=0.7)
    times = -DT * np.arange(7.0, -1.0, -1.0)
    grid = -0.7 * np.arange(6.0, -1.0, -1.0)
    read = [[np.interp(times, grid, axis) for axis in track.T] for track in slow.positions]
    same = predictor.predict(tracks_of(np.swapaxes(read, 1, 2)), 14)
    far = predictor.predict(slow, 8)
    np.testing.assert_allclose(far.mean[:, :, 3], same.mean[:, :, 6], atol=1e-9)


def test_beyond_the_horizon_the_velocity_is_held_and_the_spread_grows():
    forecast = MixtureDensity(fitted=network()).predict(tracks_of(walks(3, 8)), 30)
    bend = np.diff(forecast.mean, n=2, axis=2)
    assert np.abs(bend[:, :, :10]).max() > 1e-3
    np.testing.assert_allclose(bend[:, :, 12:], 0.0, atol=1e-10)
    growth = np.diff(forecast.covariance, axis=2)
    assert np.linalg.eigvalsh(growth).min() > 0


def test_what_was_not_seen_lately_is_forecast_from_then_on():
    positions = walks(1, 12)
    positions[:, 10:] = NAN
    for predictor in (MixtureDensity(fitted=network()), MixtureDensity()):
        late = predictor.predict(tracks_of(positions), 6)
        early = predictor.predict(tracks_of(positions[:, :10]), 8)
        np.testing.assert_allclose(late.mean, early.mean[:, :, 2:], atol=1e-12)
        np.testing.assert_allclose(late.covariance, early.covariance[:, :, 2:], atol=1e-12)
        kept = early.joint[:, :, 4:, 4:]
        np.testing.assert_allclose(late.joint, kept, atol=1e-12)


def test_what_it_cannot_serve_goes_to_the_fallback():
    positions = walks(4, 8)
    positions[1, :1] = NAN
    positions[2, 1:6] = NAN
    positions[3, [2, 4]] = NAN
    tracks = tracks_of(positions)
    predictor = MixtureDensity(fitted=network(), fallback=Kalman())
    forecast = predictor.predict(tracks, 5)
    assert forecast.fallback == (
        None,
        "mixture_density: 7 samples, needs 8",
        "mixture_density: 3 of 8 samples observed",
        None,
    )
    other = Kalman().predict(tracks, 5)
    for index in (1, 2):
        np.testing.assert_allclose(forecast.mean[index, 0], other.mean[index, 0], atol=1e-12)
        np.testing.assert_array_equal(forecast.weight[index], [1.0, 0.0, 0.0])
    single = MixtureDensity().predict(tracks_of(positions[:, 7:]), 5)
    assert set(single.fallback) == {
        "mixture_density: 1 sample, needs 2; constant_velocity: 1 sample, needs 2"
    }


def test_three_dimensions_go_to_the_fallback():
    positions = np.random.default_rng(0).standard_normal((2, 9, 3)).cumsum(axis=1)
    tracks = tracks_of(positions)
    forecast = MixtureDensity(fitted=network()).predict(tracks, 4)
    other = ConstantVelocity().predict(tracks, 4)
    assert forecast.fallback == ("mixture_density: 3 coordinates, needs 2",) * 2
    np.testing.assert_array_equal(forecast.mean, other.mean)
    np.testing.assert_array_equal(forecast.covariance, other.covariance)


def test_config_and_file_rebuild_the_same_predictor(tmp_path):
    predictor = MixtureDensity(fitted=network())
    assert build("predictor", json.loads(json.dumps(describe(predictor)))) == predictor
    path = save_plugin(tmp_path / "net.json", "predictor", predictor)
    again = load_plugin(path, "predictor")
    assert again == predictor
    tracks = tracks_of(walks(3, 8))
    first, second = predictor.predict(tracks, 12), again.predict(tracks, 12)
    np.testing.assert_array_equal(first.mean, second.mean)
    np.testing.assert_array_equal(first.covariance, second.covariance)


def test_a_forecast_needs_no_jax(tmp_path):
    path = save_plugin(tmp_path / "net.json", "predictor", MixtureDensity(fitted=network()))
    code = (
        "import sys, numpy as np\n"
        "from wideberth.framework.plugins.config import load_plugin\n"
        "from wideberth.framework.values.tracks import Tracks\n"
        f"predictor = load_plugin({str(path)!r}, 'predictor')\n"
        "line = np.arange(8.0)[None, :, None] * np.ones(2)\n"
        "tracks = Tracks(line, 0.4, ('a',), np.ones(1), np.zeros((1, 2, 2)))\n"
        "assert predictor.predict(tracks, 3).fallback == (None,)\n"
        "print('jax' in sys.modules)\n"
    )
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=root, check=True
    )
    assert done.stdout.strip() == "False"


def test_a_damaged_network_is_refused():
    good = network()
    with pytest.raises(WideberthError, match=r"wanted 16 inputs for 8 positions, 48 outputs"):
        replace(good, layers=good.layers[:1])
    with pytest.raises(WideberthError, match="fit it again"):
        replace(good, centre=good.centre[1:])
    with pytest.raises(WideberthError, match=r"density_network\.scale"):
        replace(good, scale=0.0)


@pytest.mark.parametrize(
    ("setting", "value"),
    [("observed", 2), ("predicted", 0), ("modes", 0), ("rounds", 0), ("seed", -1)],
)
def test_numbers_out_of_range_are_refused(setting, value):
    with pytest.raises(WideberthError, match=f"mixture_density.{setting}"):
        MixtureDensity(**{setting: value})


def test_each_mode_has_its_own_region_in_the_plan():
    planner = Planner(
        robot=Unicycle(),
        region=MahalanobisEllipse(),
        predictor=MixtureDensity(),
        level=Fixed(tail=0.5),
        solver=Fatrop(),
        penalty=1e4,
        horizon=8,
    )
    planner.set_path(Route(np.array([[0.0, 0.0], [20.0, 0.0]])))
    for tick in range(5):
        place = np.array([8.0 - 0.25 * tick, 1.0])
        seen = Detection("other", place, 1e-4 * np.eye(2), 0.4)
        state = np.array([0.25 * tick, 0.0, 0.0, 0.5, 0.0])
        planner.command(Observation(0.5 * tick, state, (seen,)))
    plan = planner.plan
    assert plan.ids == ("other",) * 3
    assert plan.content.shape == (8, 3)
    np.testing.assert_allclose(plan.forecast.weight, [[0.8, 0.1, 0.1]])
    # the robot keeps out of the ellipse of every mode
    mean, spread = plan.forecast.mean[0], plan.forecast.covariance[0]
    apart = plan.positions[-8:] - mean
    square = np.einsum("kni,knij,knj->kn", apart, np.linalg.inv(spread), apart)
    assert plan.violation < 1e-4 and square.min() > chi2.ppf(0.5, 2)
