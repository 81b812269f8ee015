"""Bad input to regions: one clear error each, that says what came and what was wanted."""

import math
import re
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from wideberth.framework.plugins import config, registry
from wideberth.framework.region import Region
from wideberth.framework.risk.level_for_risk import level_for_risk
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.polygon import Polygon
from wideberth.regions.bhattacharyya import _inner
from wideberth.regions.density import checked_spread
from wideberth.tests.helpers.region_variants import variants

REGIONS = [
    one for name in registry.names("regions") for one in variants(registry.load("regions", name))
]
every = pytest.mark.parametrize("region", REGIONS, ids=repr)


@pytest.mark.parametrize(
    ("mean", "covariance", "words"),
    [
        (1.0, np.eye(2), r"obstacle\.mean has shape \(\); wanted"),
        (np.zeros(2), np.eye(3), r"covariance has shape \(3, 3\); wanted \(2, 2\)"),
        (np.zeros(2), np.ones(2), r"covariance has shape \(2,\); wanted \(2, 2\)"),
        (np.zeros((4, 2)), np.eye(2), r"shape \(2, 2\); wanted \(4, 2, 2\)"),
        (np.zeros(2), [[1, 0.2], [0.1, 1]], "not symmetric; .* equal its transpose"),
        (np.zeros(2), [[1, 0], [0, -0.5]], r"eigenvalue -0\.5; .* clip"),
        (np.zeros(2), [[1, 2], [2, 1]], "eigenvalue -1; .* positive semi-definite"),
        (np.zeros((2, 2)), [np.eye(2), -np.eye(2)], r"covariance\[1\] has eigenvalue -1"),
        (np.zeros(2), [[math.nan, 0], [0, 1]], r"covariance\[0, 0\] is nan; .* finite"),
        (np.zeros(2), [[math.inf, 0], [0, 1]], r"covariance\[0, 0\] is inf; .* finite"),
        ([0.0, math.nan], np.eye(2), r"mean\[1\] is nan; .* finite"),
        (["a", "b"], np.eye(2), "mean is not an array of numbers"),
        (np.zeros(2), "round", "covariance is not an array of numbers"),
    ],
)
def test_obstacle(mean: Any, covariance: Any, words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        GaussianObstacle(mean, covariance)


def refusal(call: Callable[..., object], *given: object) -> str:
    """What is said of an argument, or that nothing is."""
    try:
        call(*given)
    except WideberthError as error:
        return str(error)
    return f"takes {given}"


@every
def test_margin(region: Region) -> None:
    """Of one obstacle and of a batch."""
    obstacle = GaussianObstacle(np.zeros((2, 2)), np.stack([np.eye(2), 2.0 * np.eye(2)]))
    for margin in (-1e-9, -1.0, math.nan, math.inf, [0.5, -0.5]):
        said = refusal(region.parameters, obstacle, np.asarray(margin))
        assert re.search(r"^margin is .*; wanted .* at least 0$", said)


@every
def test_margins_of_another_batch(region: Region) -> None:
    obstacle = GaussianObstacle(np.zeros((2, 2)), np.stack([np.eye(2)] * 2))
    with pytest.raises(WideberthError, match=r"margin has shape \(3,\); wanted"):
        region.parameters(obstacle, np.ones(3))


@every
def test_dimension(region: Region) -> None:
    for size in {1, 2, 3, 4} - set(region.dimensions):
        obstacle = GaussianObstacle(np.zeros(size), np.eye(size))
        with pytest.raises(WideberthError, match=rf"obstacle has {size} coordinates; this region"):
            region.parameters(obstacle, np.asarray(1.0))


@every
def test_tail(region: Region) -> None:
    for tail, words in (
        (0.0, "tail is 0; a probability must lie strictly in"),
        (1.0, "tail is 1; a probability must lie strictly in"),
        (1.5, "tail is 1.5; a probability must lie strictly in"),
        (-0.05, "tail is -0.05; wanted"),
        (math.nan, "tail is nan; wanted"),
        (math.inf, "tail is inf; wanted"),
        ("five percent", "tail is 'five percent'; wanted a number"),
        (None, "tail is None; wanted a number"),
    ):
        for size in region.dimensions:
            assert words in refusal(region.level, tail, size)


@every
def test_risk(region: Region) -> None:
    for risk in (0.0, 1.0, -0.1, 2.0, math.nan):
        assert refusal(level_for_risk, region, risk).startswith("risk is ")


@every
def test_a_singular_covariance_is_taken_or_refused_with_advice(region: Region) -> None:
    for size in region.dimensions:
        obstacle = GaussianObstacle(np.zeros(size), np.diag([1.0, *[0.0] * (size - 1)]))
        if region.singular_covariances:
            assert np.isfinite(region.parameters(obstacle, np.asarray(1.0))).all()
            continue
        with pytest.raises(WideberthError, match=r"singular.*minkowski_sum"):
            region.parameters(obstacle, np.asarray(1.0))


@every
def test_options(region: Region) -> None:
    """Every option of every region refuses a wrong type, a wrong value and a wrong name."""
    kind: Any = type(region)
    with pytest.raises(WideberthError, match=r"^region.*radius"):
        named = {"type": registry.name_of("regions", kind), "radius": 1.0}
        config.build("regions", named, "region")
    for one in fields(kind):
        for value in (-1.0, math.nan, "wrong"):
            with pytest.raises(WideberthError, match=one.name):
                kind(**{one.name: value})


@pytest.mark.parametrize(
    ("vertices", "words"),
    [
        ([(0, 0), (1, 1), (2, 2)], "lie on a line"),
        ([(0, 0), (1, 0)], "wanted at least 3"),
        ([(0, 0), (2, 2), (2, 0), (0, 2)], "cross or touch themselves"),
        ([(0, 0), (1, 0), (math.nan, 1)], "finite"),
    ],
)
def test_polygon(vertices: Any, words: str) -> None:
    """All cases stand with the polygons; these are the ones that regions rely on."""
    with pytest.raises(WideberthError, match=words):
        Polygon(vertices)


def test_a_covariance_is_thin_below_a_share_of_1e_12() -> None:
    for share, refused in ((1e-10, False), (1e-13, True)):
        obstacle = GaussianObstacle(np.zeros(2), np.diag([1.0, share]))
        if refused:
            with pytest.raises(WideberthError, match="singular"):
                checked_spread(obstacle, "density")
        else:
            np.testing.assert_allclose(checked_spread(obstacle, "density"), [1.0, share])


def test_an_empty_ellipse_of_bhattacharyya_s_is_a_millionth_of_a_deviation() -> None:
    rest, size = _inner(np.array([1.0, 2.0, 0.5]), np.array([0.4, 0.5, 1.0]))
    assert rest.tolist() == [1.0, 2.0]
    np.testing.assert_allclose(size, [1e-6, 1e-6, 2.0])
