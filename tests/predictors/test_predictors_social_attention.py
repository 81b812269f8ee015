"""Social attention: the network against a second one written out, its laws, and its training."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Scene
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.core import adam, social_training
from wideberth.predictors.core.density_network import MEMORY, STANDING, Layer, output_count
from wideberth.predictors.core.social_network import (
    AHEAD,
    HEADS,
    PAIR_FEATURES,
    RANGE,
    WIDTH,
    People,
    SocialNetwork,
    outputs,
    pairs,
    straight,
)
from wideberth.predictors.core.social_training import material_of, path_error
from wideberth.predictors.social_attention import SocialAttention, on_step, shipped

DT, OBSERVED, PREDICTED, SCALE = 0.2, 6, 10, 1.3
ALONE = 2 * (OBSERVED - 1) + 2
COMPANY = HEADS * (WIDTH + 1)


def network(seed=0, gain=1.0, observed=OBSERVED):
    """A network of random weights, smaller than a trained one."""
    rng = np.random.default_rng(seed)
    alone = 2 * (observed - 1) + 2
    sizes = [(PAIR_FEATURES, 7), (7, COMPANY), (alone + COMPANY, 9), (9, output_count(1))]
    layers = []
    for before, after in sizes:
        weight = gain * rng.standard_normal((before, after)) / np.sqrt(before)
        bias = 0.3 * gain * rng.standard_normal(after)
        layers.append(Layer(tuple(map(tuple, weight.tolist())), tuple(bias.tolist())))
    centre, width = rng.standard_normal(alone), rng.uniform(0.5, 2.0, alone)
    return SocialNetwork(
        DT, observed, DT * PREDICTED, SCALE, tuple(centre), tuple(width), tuple(layers)
    )


def people(count=5, rows=12, seed=1, size=4.0):
    """People who walk about with some noise."""
    rng = np.random.default_rng(seed)
    velocity = rng.normal(0, 1.0, (count, 1, 2)) + np.cumsum(
        rng.normal(0, 0.1, (count, rows, 2)), axis=1
    )
    places = rng.uniform(-size, size, (count, 1, 2)) + DT * np.cumsum(velocity, axis=1)
    return tracks_of(places, rng.uniform(0.2, 0.4, count))


def tracks_of(places, radius=None, dt=DT, ids=None):
    places = np.asarray(places, dtype=float)
    count = len(places)
    ids = tuple(f"p{i}" for i in range(count)) if ids is None else ids
    radius = np.full(count, 0.3) if radius is None else radius
    return Tracks(places, dt, ids, radius, np.tile(1e-4 * np.eye(2), (count, 1, 1)), 5.0)


def plan_scene():
    plan = np.stack([np.linspace(-2.0, 2.0, 30), 0.3 * np.sin(np.arange(30) / 5)], axis=1)
    return Scene(plan=plan, plan_times=5.0 + DT * np.arange(30), radius=0.35)


def written_out(net, tracks, steps, scene=None, noise_floor=0.01):
    """Means and covariances, one person, pair, head and step at a time, by the formulas."""
    arrays = [(np.array(one.weight), np.array(one.bias)) for one in net.layers]
    velocities = np.diff(tracks.positions[:, -net.observed :], axis=1) / tracks.dt
    weight = np.exp(-tracks.dt * np.arange(net.observed - 1)[::-1] / MEMORY)
    mean_velocity = [(weight[:, None] * one).sum(axis=0) / weight.sum() for one in velocities]
    bodies = [
        (
            [tracks.positions[j, -1] + t * mean_velocity[j] for t in AHEAD],
            mean_velocity[j],
            velocities[j, -1] - mean_velocity[j],
            tracks.radius[j],
            0.0,
        )
        for j in range(len(tracks))
    ]
    if scene is not None:
        times = scene.plan_times - tracks.stamp
        course = [np.array([np.interp(t, times, axis) for axis in scene.plan.T]) for t in AHEAD]
        velocity = (scene.plan[1] - scene.plan[0]) / (times[1] - times[0])
        bodies.append((course, velocity, np.zeros(2), scene.radius, 1.0))
    means, covariances = [], []
    for i in range(len(tracks)):
        d = mean_velocity[i]
        speed = np.hypot(*d)
        certain = speed**2 / (speed**2 + (STANDING * net.scale) ** 2)
        ex = d / speed
        frame = np.array([ex, [-ex[1], ex[0]]])
        jitter = np.sqrt((np.diff(velocities[i], axis=0) ** 2).sum(axis=1).mean())
        flat = [np.sqrt(certain) * frame @ v / net.scale for v in velocities[i]]
        logs = [np.log(speed / net.scale + STANDING), np.log(jitter / net.scale + STANDING)]
        alone = (np.concatenate([*flat, logs]) - net.centre) / net.width
        above, below = np.zeros((HEADS, WIDTH)), np.zeros(HEADS)
        for j, (course, velocity, bend, radius, robot) in enumerate(bodies):
            if j == i:
                continue
            ways = [c - o for c, o in zip(course, bodies[i][0], strict=True)]
            gaps = [max(np.hypot(*way) - tracks.radius[i] - radius, 0.0) for way in ways]
            vectors = [*ways, velocity - d, velocity, bend]
            told = [np.sqrt(certain) * frame @ v / (1 + np.hypot(*v)) for v in vectors]
            scalars = [*np.exp(-np.array(gaps)), np.exp(-gaps[0] / 0.25)]
            x = np.concatenate([*told, scalars, [speed / (1 + speed), robot]])
            share = max(1 - (np.hypot(*ways[0]) / RANGE) ** 2, 0.0) ** 2
            hidden = np.tanh(x @ arrays[0][0] + arrays[0][1])
            out = hidden @ arrays[1][0] + arrays[1][1]
            for h in range(HEADS):
                a = share * np.exp(5 * np.tanh(out[h] / 5))
                below[h] += a
                above[h] += a * np.tanh(out[HEADS + WIDTH * h : HEADS + WIDTH * (h + 1)])
        company = np.concatenate([(above / (1 + below)[:, None]).ravel(), np.log(1 + below)])
        hidden = np.tanh(np.concatenate([alone, company]) @ arrays[2][0] + arrays[2][1])
        raw = hidden @ arrays[3][0] + arrays[3][1]
        length = net.scale * net.horizon
        path = length * np.sqrt(certain) * raw[1:7].reshape(3, 2)
        roots = 5 * np.tanh(raw[7:] / 5).reshape(3, 3)
        rows, spreads = [], []
        for n in range(1, steps + 1):
            s = n * tracks.dt / net.horizon
            powers = [s, s**2, s**3]
            own = sum(p * b for p, b in zip(powers, path, strict=True))
            rows.append(tracks.positions[i, -1] + n * tracks.dt * d + frame.T @ own)
            spread = np.zeros((2, 2))
            for power, (a, b, c) in zip(powers, roots, strict=True):
                root = np.diag(np.exp([a - 2, b - 2])) @ np.array([[1.0, 0.0], [c, 1.0]])
                one = length**2 * root @ root.T
                spread += power * (certain * one + (1 - certain) * np.trace(one) / 2 * np.eye(2))
            noise = tracks.noise[i] + noise_floor**2 * np.eye(2)
            spreads.append(frame.T @ spread @ frame + noise)
        means.append(rows)
        covariances.append(spreads)
    return np.array(means), np.array(covariances)


@pytest.mark.parametrize("scene", [None, plan_scene()], ids=["alone", "with a robot"])
def test_the_forecast_is_the_network_written_out(scene):
    tracks, net = people(), network()
    said = SocialAttention(fitted=net).predict(tracks, PREDICTED, scene)
    mean, covariance = written_out(net, tracks, PREDICTED, scene)
    np.testing.assert_allclose(said.mean[:, 0], mean, atol=1e-10)
    np.testing.assert_allclose(said.covariance[:, 0], covariance, rtol=1e-9, atol=1e-12)
    assert said.fallback == (None,) * len(tracks)


def test_compiled_by_jax_the_network_says_the_same():
    import jax
    import jax.numpy as jnp

    net, rng = network(3), np.random.default_rng(5)
    velocity, radius = rng.standard_normal((4, 2)), rng.uniform(0.2, 0.4, 4)
    shape = 4, 6
    others = (
        rng.standard_normal((*shape, len(AHEAD), 2)), rng.standard_normal((*shape, 2)),
        rng.standard_normal((*shape, 2)), rng.uniform(0.2, 0.4, shape), rng.integers(0, 2, shape),
    )  # fmt: skip
    angle = rng.uniform(-3, 3, 4)
    turn = np.stack([np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)], axis=1)
    turn, certain = turn.reshape(4, 2, 2), rng.uniform(0.2, 1.0, 4)
    inputs = rng.standard_normal((4, ALONE))

    def total(xp, *given):
        told, seen = pairs(xp, straight(xp, velocity, radius), People(*given), turn, certain)
        return outputs(xp, net.arrays, inputs, told, seen)

    with jax.enable_x64(True):
        ours = np.asarray(jax.jit(lambda *given: total(jnp, *given))(*others))
    np.testing.assert_allclose(ours, total(np, *others), atol=1e-12)


@pytest.mark.parametrize("gain", [1.0, 30.0])
def test_any_network_keeps_the_laws(gain):
    check_predictor(SocialAttention(fitted=network(1, gain)), dataset=())


def test_the_shipped_network_keeps_the_laws():
    check_predictor(SocialAttention(), dataset=())


def test_weights_of_zero_are_constant_velocity():
    net = network(gain=0.0)
    tracks = people()
    said = SocialAttention(fitted=net, noise_floor=1e-9).predict(tracks, 5, plan_scene())
    velocities = np.diff(tracks.positions[:, -OBSERVED:], axis=1) / DT
    weight = np.exp(-DT * np.arange(OBSERVED - 1)[::-1] / MEMORY)
    mean = np.einsum("t,otd->od", weight / weight.sum(), velocities)
    times = DT * np.arange(1, 6)[:, None]
    wanted = tracks.positions[:, -1:] + times * mean[:, None]
    np.testing.assert_allclose(said.mean[:, 0], wanted, atol=1e-12)


def test_neighbours_count_and_their_order_does_not():
    tracks, predictor = people(6), SocialAttention(fitted=network())
    said = predictor.predict(tracks, 6)
    order = [3, 0, 5, 1, 4, 2]
    mixed = predictor.predict(tracks.select(order), 6)
    np.testing.assert_allclose(mixed.mean, said.mean[order], atol=1e-12)
    alone = predictor.predict(tracks.select([0]), 6)
    assert np.abs(alone.mean - said.mean[:1]).max() > 1e-3
    robot = predictor.predict(tracks, 6, plan_scene())
    assert np.abs(robot.mean - said.mean).max() > 1e-3


def test_only_the_nearest_count_and_nobody_beyond_the_range():
    places = np.stack([np.array([x, 0.0]) + DT * np.arange(8)[:, None] * [0.0, 1.0]
                       for x in (0.0, 1.0, -2.0, 4.0)])  # fmt: skip
    predictor = SocialAttention(fitted=network(), most=2)
    all_four = predictor.predict(tracks_of(places), 6).mean[0]
    three = predictor.predict(tracks_of(places[:3]), 6).mean[0]
    assert np.array_equal(all_four, three)
    few = replace(predictor, most=1).predict(tracks_of(places[:3]), 6).mean[0]
    assert np.abs(few - three).max() > 1e-4
    away = np.concatenate([places[:1], places[1:2] + np.array([RANGE, 0.0])])
    lone = predictor.predict(tracks_of(places[:1]), 6).mean[0]
    np.testing.assert_allclose(predictor.predict(tracks_of(away), 6).mean[0], lone, atol=1e-12)


def test_who_cannot_be_served_is_left_to_the_fallback_and_is_still_seen():
    tracks = people(4)
    places = tracks.positions.copy()
    places[1, : 12 - 3] = np.nan
    places[2, -5:-1] = np.nan
    tracks = replace(tracks, positions=places)
    predictor = SocialAttention(fitted=network())
    said = predictor.predict(tracks, 4)
    assert said.fallback == (
        None,
        "social_attention: 3 samples, needs 6",
        "social_attention: 2 of 6 samples observed",
        None,
    )
    without = predictor.predict(tracks.select([0, 2, 3]), 4)
    assert np.abs(without.mean[0] - said.mean[0]).max() > 1e-5
    space = Tracks(np.zeros((1, 9, 3)), DT, ("a",), np.array([0.3]), np.eye(3)[None])
    assert predictor.predict(space, 3).fallback == ("social_attention: 3 coordinates, made for 2",)


def test_who_was_not_seen_lately_is_taken_to_have_walked_on():
    times = DT * np.arange(-11, 1)[:, None]
    places = np.array([[0.0, 0.0] + times * [1.0, 0.3], [1.5, 1.0] + times * [-0.9, 0.4]])
    predictor = SocialAttention(fitted=network())
    said = predictor.predict(tracks_of(places), 6).mean
    hidden = places.copy()
    hidden[1, -2:] = np.nan
    late = predictor.predict(tracks_of(hidden), 6).mean
    np.testing.assert_allclose(late[0], said[0], atol=1e-12)


def test_histories_of_another_step_are_resampled():
    """People who walk straight are seen the same at any step of the tracks."""
    begin, velocity = np.array([[0.0, 0.0], [2.0, 1.0]]), np.array([[1.0, 0.2], [-0.8, 0.1]])
    predictor = SocialAttention(fitted=network())

    def said(dt, steps):
        times = dt * np.arange(-20, 1)
        places = begin[:, None] + times[:, None] * velocity[:, None]
        return predictor.predict(tracks_of(places, dt=dt), steps).mean[:, 0, -1]

    np.testing.assert_allclose(said(0.1, 20), said(0.2, 10), atol=1e-9)
    np.testing.assert_allclose(said(0.4, 5), said(0.2, 10), atol=1e-9)


@pytest.mark.parametrize(
    ("setting", "value"),
    [("dt", 0.0), ("observed", 2), ("predicted", 0), ("rounds", 0), ("most", 0),
     ("seed", -1), ("noise_floor", 0.0)],
)  # fmt: skip
def test_settings_out_of_range_are_refused(setting, value):
    with pytest.raises(WideberthError, match=f"social_attention.{setting}"):
        SocialAttention(**{setting: value})


def test_layers_that_do_not_fit_are_refused():
    net = network()
    with pytest.raises(WideberthError, match="fit it again"):
        replace(net, observed=9)
    with pytest.raises(WideberthError, match="fit it again"):
        replace(net, layers=net.layers[1:])


# Training


def swerving(count, rng, robot=False):
    """Scenes of a person and another one to his left or right, from whom he then turns away.

    The other one stands still, or is the robot and sets off from his way to one side.
    """
    scenes = []
    past, ahead = OBSERVED - 1, PREDICTED
    for _ in range(count):
        heading, speed, side = (
            rng.uniform(-np.pi, np.pi),
            rng.uniform(0.8, 1.4),
            rng.choice([-1, 1]),
        )
        turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        times = DT * np.arange(-past, ahead + 1)
        later = np.maximum(times, 0.0)
        way = np.stack([speed * times, -0.5 * side * later], axis=1)
        other = np.tile([1.5, 0.0 if robot else 1.0 * side], (len(times), 1))
        if robot:
            other[:, 1] += side * later
        places = np.stack([way, other]) @ turn.T + rng.uniform(-9, 9, 2)
        ids = "person", "robot" if robot else "other"
        scenes.append(tracks_of(places, ids=ids))
    return scenes


def brief(monkeypatch, updates=50, batch=64):
    monkeypatch.setattr(adam, "UPDATES", updates)
    monkeypatch.setattr(adam, "BATCH", batch)


def plain(**settings):
    return SocialAttention(dt=DT, observed=OBSERVED, predicted=PREDICTED, **settings)


@pytest.mark.parametrize("robot", [False, True], ids=["others", "the robot's plan"])
def test_what_only_the_company_tells_is_learnt(monkeypatch, robot):
    brief(monkeypatch)
    rng = np.random.default_rng(2)
    fitted = plain(rounds=16).fit(swerving(200, rng, robot))
    errors = []
    for scene in swerving(20, rng, robot):
        past = scene.positions[:, :OBSERVED]
        tracks = tracks_of(past, ids=scene.ids)
        known = None
        if robot:
            tracks = tracks.select([0])
            plan = scene.positions[1, OBSERVED - 1 :]
            known = Scene(plan=plan, plan_times=5.0 + DT * np.arange(len(plan)), radius=0.3)
        said = fitted.predict(tracks, PREDICTED, known).mean[0, 0, -1]
        errors.append(np.linalg.norm(said - scene.positions[0, -1]))
    aside = 0.5 * DT * PREDICTED
    assert np.mean(errors) < 0.25 * aside


def test_training_sees_what_a_forecast_sees():
    """Untrained, the network says the same of a window of the training and of its tracks."""
    rng = np.random.default_rng(4)
    places = people(5, 40, seed=8).positions.copy()
    places[2, :13] = np.nan
    places[3, 30:] = np.nan
    ids = ("a", "robot", "b", "c", "d")
    scene = tracks_of(places, rng.uniform(0.2, 0.4, 5), ids=ids)
    data = material_of([scene, scene], OBSERVED, PREDICTED, "robot", "test")
    net = replace(network(6), scale=data.scale)
    every = np.arange(len(data.past))
    plain_ones = np.ones(len(every))
    inputs, present, residual, radius, velocity, turn, certain, *others = data.parts(
        data.past, every, plain_ones, plain_ones > 0
    )
    others = [np.nan_to_num(part) for part in others]
    told, seen = pairs(np, straight(np, velocity, radius), People(*others), turn, certain)
    alone = (inputs - np.array(net.centre)) / net.width
    raw = outputs(np, net.arrays, alone, told, seen * present)
    length = net.scale * net.horizon
    predictor = SocialAttention(fitted=net, noise_floor=1e-6)
    checked = 0
    for w in every[::7]:
        index, row = divmod(int(data.row[w]) % (5 * 40), 40)
        now = row + 1
        order = [i for i in (0, 2, 3, 4) if np.isfinite(places[i, row - 1 : now]).all()]
        tracks = tracks_of(places[:, :now], scene.radius, ids=ids).select(order)
        course = places[1, row:]  # beyond its end both go straight on
        times = 5.0 + DT * np.arange(len(course))
        plan = Scene(plan=course, plan_times=times, radius=float(scene.radius[1]))
        said = predictor.predict(tracks, PREDICTED, plan)
        mine = order.index(index)
        path = length * np.sqrt(certain[w]) * raw[w, 1:7].reshape(3, 2)
        wanted = places[index, row] + DT * PREDICTED * velocity[w] + turn[w].T @ path.sum(axis=0)
        np.testing.assert_allclose(said.mean[mine, 0, -1], wanted, atol=1e-9)
        truth = residual[w, -1] @ turn[w] + places[index, row] + DT * PREDICTED * velocity[w]
        np.testing.assert_allclose(truth, places[index, row + PREDICTED], atol=1e-9)
        checked += 1
    assert checked > 5


def test_losses_equal_scipy_and_the_mean_distance():
    import jax

    rng = np.random.default_rng(0)
    scenes = swerving(120, rng)
    data = material_of(scenes, OBSERVED, PREDICTED, "robot", "test")
    every = np.arange(len(data.past))
    flip = np.ones(len(every))
    parts = data.parts(data.past, every, flip, flip > 0)
    net = network(2)
    alone = (np.array(parts[0]) - net.centre) / net.width
    parts = [alone, *map(np.nan_to_num, parts[1:])]
    inputs, present, residual, radius, velocity, turn, certain, *others = parts
    length, floor, unit = 2.5, 0.02, 1.1
    with jax.enable_x64(True):
        _, losses = social_training._program()
        ours = np.asarray(losses(net.arrays, (length, floor, unit), *map(np.asarray, parts)))
    told, seen = pairs(np, straight(np, velocity, radius), People(*others), turn, certain)
    raw = outputs(np, net.arrays, inputs, told, seen * present)
    for w in (0, 17, 33):
        path = length * np.sqrt(certain[w]) * raw[w, 1:7].reshape(3, 2)
        roots = 5 * np.tanh(raw[w, 7:] / 5).reshape(3, 3)
        likelihood, distance = [], []
        for n in range(1, PREDICTED + 1):
            powers = (n / PREDICTED) ** np.arange(1, 4)
            mean, spread = powers @ path, floor**2 * np.eye(2)
            for power, (a, b, c) in zip(powers, roots, strict=True):
                root = np.diag(np.exp([a - 2, b - 2])) @ np.array([[1.0, 0.0], [c, 1.0]])
                one = length**2 * root @ root.T
                circle = np.trace(one) / 2 * np.eye(2)
                spread += power * (certain[w] * one + (1 - certain[w]) * circle)
            likelihood.append(multivariate_normal(mean, spread).logpdf(residual[w, n - 1]))
            distance.append(np.sqrt(((residual[w, n - 1] - mean) ** 2).sum() + floor**2))
        wanted = -np.mean(likelihood) + np.mean(distance) / unit
        assert ours[w] == pytest.approx(wanted, rel=1e-9)
    given = raw[:3], certain[:3], residual[:3]
    exact, blunt = (path_error(np, *given, length, floor) for floor in (0.0, 0.1))
    assert (exact < blunt).all()


def test_slopes_are_finite_and_those_of_differences():
    """Also for people who stand, exactly, and in one place."""
    import jax

    rng = np.random.default_rng(0)
    scenes = swerving(110, rng)
    still = np.zeros((3, OBSERVED + PREDICTED, 2))
    data = material_of([*scenes, tracks_of(still)], OBSERVED, PREDICTED, "robot", "test")
    every = np.arange(len(data.past))[-40:]
    flip = np.ones(len(every))
    net = network(2)
    parts = data.parts(data.past[every], every, flip, flip > 0)
    parts = [np.nan_to_num(np.asarray(part, dtype=float)) for part in parts]
    sizes = 2.5, 0.02, 1.1
    with jax.enable_x64(True):
        _, losses = social_training._program()

        def total(layers):
            return losses(layers, sizes, *parts).sum()

        slopes = jax.grad(total)(net.arrays)
        assert all(np.isfinite(np.asarray(part)).all() for layer in slopes for part in layer)
        for which, (weight, _) in enumerate(net.arrays):
            place = np.unravel_index(int(np.argmax(np.abs(slopes[which][0]))), weight.shape)
            ends = []
            for step in (1e-5, -1e-5):
                layers = [(one.copy(), bias) for one, bias in net.arrays]
                layers[which][0][place] += step
                ends.append(float(total(layers)))
            wanted = (ends[0] - ends[1]) / 2e-5
            assert float(slopes[which][0][place]) == pytest.approx(wanted, rel=1e-5)


def test_same_seed_same_network(monkeypatch):
    brief(monkeypatch, updates=3, batch=16)
    scenes = swerving(120, np.random.default_rng(1))
    first, second = (plain(rounds=2).fit(scenes) for _ in range(2))
    assert first == second and repr(first) == repr(second)
    assert plain(rounds=2, seed=1).fit(scenes).fitted != first.fitted


def test_nothing_is_learnt_of_the_robot_and_of_too_little():
    scenes = swerving(99, np.random.default_rng(1), robot=True)
    with pytest.raises(WideberthError, match="99 windows of 6 \\+ 10"):
        plain().fit(scenes)
    with pytest.raises(WideberthError, match="coordinates"):
        space = Tracks(np.zeros((1, 90, 3)), DT, ("a",), np.array([0.3]), np.eye(3)[None])
        plain().fit([space])


def test_recordings_are_brought_to_the_step():
    scene = people(2, 11)
    finer = on_step(scene, 0.1)
    assert finer.dt == 0.1 and finer.positions.shape[1] == 21
    np.testing.assert_array_equal(finer.positions[:, ::2], scene.positions)
    middle = 0.5 * (scene.positions[:, 1:] + scene.positions[:, :-1])
    np.testing.assert_allclose(finer.positions[:, 1::2], middle, atol=1e-12)
    assert on_step(scene, DT) is scene
    holed = scene.positions.copy()
    holed[0, 4] = np.nan
    again = on_step(replace(scene, positions=holed), 0.1).positions[0, :, 0]
    assert np.flatnonzero(np.isnan(again)).tolist() == [7, 8, 9]


def test_the_shipped_network_was_trained_on_simulations():
    assert shipped().dt == pytest.approx(0.2) and shipped().horizon == pytest.approx(4.8)
