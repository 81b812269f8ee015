"""Gaussian mixtures: closed forms, a plain second implementation, and known clusters."""

import numpy as np
import pytest
from numpy.random import RandomState
from scipy.stats import multivariate_normal

from wideberth_arenas.controllers.gaussian_mixture import SPREAD, clustered, fitted_mixture


def drawn(seed, count=400):
    """Scores of two components, with the component of each."""
    rng = np.random.default_rng(seed)
    first = rng.uniform(size=count) < 0.3
    near = rng.multivariate_normal([0.0, 0.0], [[1.0, 0.4], [0.4, 0.5]], count)
    far = rng.multivariate_normal([6.0, -4.0], [[0.3, 0.0], [0.0, 2.0]], count)
    return np.where(first[:, None], near, far), first


def plain_rounds(scores, share, rounds):
    """Rounds of expectation and maximisation, a sum at a time."""
    size = scores.shape[1]
    for _ in range(rounds):
        weight, mean, covariance = [], [], []
        for k in range(share.shape[1]):
            total = sum(share[:, k])
            middle = sum(r * s for r, s in zip(share[:, k], scores, strict=True)) / total
            outer = [r * np.outer(s - middle, s - middle)
                     for r, s in zip(share[:, k], scores, strict=True)]  # fmt: skip
            weight.append(total / len(scores))
            mean.append(middle)
            covariance.append(sum(outer) / total + SPREAD * np.eye(size))
        parts = zip(weight, mean, covariance, strict=True)
        density = np.array([w * multivariate_normal(m, c).pdf(scores) for w, m, c in parts])
        share = (density / density.sum(axis=0)).T
    return np.array(weight), np.array(mean), np.array(covariance), density.T


def test_one_component_is_the_sample_mean_and_covariance():
    scores, _ = drawn(1)
    mixture = fitted_mixture(scores, 1, RandomState(0))
    np.testing.assert_allclose(mixture.weight, [1.0])
    np.testing.assert_allclose(mixture.mean[0], scores.mean(axis=0))
    wanted = np.cov(scores.T, bias=True) + SPREAD * np.eye(2)
    np.testing.assert_allclose(mixture.covariance[0], wanted)
    peak = multivariate_normal(mixture.mean[0], wanted).logpdf(mixture.mean[0])
    np.testing.assert_allclose(mixture.log_peaks(), [peak])


def test_clusters_far_apart_are_found():
    scores, first = drawn(2)
    cluster = clustered(scores, 2, RandomState(0))
    assert ((cluster == cluster[first][0]) == first).all()


@pytest.mark.parametrize("seed", [3, 4])
def test_is_a_fixed_point_of_plain_rounds(seed):
    scores, _ = drawn(seed, 200)
    mixture = fitted_mixture(scores, 2, RandomState(0))
    share = np.exp(mixture.log_densities(scores))
    share /= share.sum(axis=1, keepdims=True)
    weight, mean, covariance, _ = plain_rounds(scores, share, 30)
    np.testing.assert_allclose(mixture.weight, weight, atol=0.02)
    np.testing.assert_allclose(mixture.mean, mean, atol=0.05)
    np.testing.assert_allclose(mixture.covariance, covariance, atol=0.1)


def test_densities_are_those_of_scipy():
    scores, _ = drawn(5, 100)
    mixture = fitted_mixture(scores, 3, RandomState(0))
    parts = zip(mixture.weight, mixture.mean, mixture.covariance, strict=True)
    wanted = [np.log(w) + multivariate_normal(m, c).logpdf(scores) for w, m, c in parts]
    np.testing.assert_allclose(mixture.log_densities(scores), np.transpose(wanted))


def test_first_round_from_clusters_is_the_plain_one():
    """With scores in one cluster each, the mixture stops after one round."""
    scores, first = drawn(6, 120)
    apart = scores + np.where(first[:, None], 0.0, 100.0)
    share = np.eye(2)[clustered(apart, 2, RandomState(0))]
    weight, mean, covariance, _ = plain_rounds(apart, share, 2)
    mixture = fitted_mixture(apart, 2, RandomState(0))
    np.testing.assert_allclose(mixture.weight, weight, rtol=1e-9)
    np.testing.assert_allclose(mixture.mean, mean, rtol=1e-9)
    np.testing.assert_allclose(mixture.covariance, covariance, rtol=1e-6, atol=1e-9)


def test_fewer_scores_than_components():
    mixture = fitted_mixture(np.array([[0.0], [5.0]]), 7, RandomState(0))
    np.testing.assert_allclose(np.sort(mixture.mean.ravel()), [0.0, 5.0])


def test_same_draws_same_bytes():
    scores, _ = drawn(7)
    first, second = (fitted_mixture(scores, 5, RandomState(3)) for _ in range(2))
    assert first.mean.tobytes() == second.mean.tobytes()
    assert first.covariance.tobytes() == second.covariance.tobytes()
