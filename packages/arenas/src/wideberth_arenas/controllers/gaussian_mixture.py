"""A Gaussian mixture of scores, fitted by expectation and maximisation from clusters."""

from dataclasses import dataclass

import numpy as np
from numpy.random import RandomState
from numpy.typing import NDArray

from wideberth.framework.values.arrays import Array

MOST_ROUNDS = 300, 100
"""Of the clusters, and of expectation and maximisation."""
CLUSTERS_STILL = 1e-4
"""Share of the scores' mean variance that the centres move at most when they are settled, m^2."""
MIXTURE_STILL = 1e-3
"""Change of the mean log-likelihood at which the mixture is settled."""
SPREAD = 1e-6
"""m^2, added to the variances, so that one score alone is a component with an inverse."""


@dataclass(frozen=True, eq=False)
class GaussianMixture:
    """Weighted Gaussians over P scores.

    Attributes
    ----------
    weight : (K,), sums to 1.
    mean : (K, P).
    covariance : (K, P, P).
    """

    weight: Array
    mean: Array
    covariance: Array

    def log_peaks(self) -> Array:
        """Logarithm of each component's weighted density at its mean, (K,)."""
        determinant = np.linalg.slogdet(2.0 * np.pi * self.covariance)[1]
        return np.asarray(np.log(self.weight) - 0.5 * determinant)

    def log_densities(self, scores: Array) -> Array:
        """Logarithm of each component's weighted density at scores (n, P), (n, K)."""
        inverse = np.linalg.inv(np.linalg.cholesky(self.covariance))
        apart = np.einsum("kpq,nkq->nkp", inverse, scores[:, None] - self.mean)
        return np.asarray(self.log_peaks() - 0.5 * _squared(apart))


def fitted_mixture(scores: Array, components: int, draws: RandomState) -> GaussianMixture:
    """Fit a mixture to scores (n, P).

    Every round computes the share r_nk that component k has in the density at score n, and then
    the components that these shares make most likely, w_k = sum_n r_nk / n and so on, beginning
    with the clusters of `clustered`.

    Parameters
    ----------
    components : K; no more than there are scores.
    draws : from which the clusters start; with the same state scikit-learn's
        ``GaussianMixture`` arrives at the same mixture.
    """
    share = np.eye(min(components, len(scores)))[clustered(scores, components, draws)]
    mixture, before = _likeliest(scores, share), -np.inf
    for _ in range(MOST_ROUNDS[1]):
        log_density = mixture.log_densities(scores)
        total = np.logaddexp.reduce(log_density, axis=1)
        mixture = _likeliest(scores, np.exp(log_density - total[:, None]))
        if abs(total.mean() - before) < MIXTURE_STILL:
            break
        before = total.mean()
    return mixture


def _likeliest(scores: Array, share: Array) -> GaussianMixture:
    """Fit components to scores (n, P) of which each has a share, (n, K)."""
    held = share.sum(axis=0) + 10.0 * np.finfo(np.float64).eps
    mean = (share.T @ scores) / held[:, None]
    apart = scores[:, None] - mean
    covariance = np.einsum("nk,nkp,nkq->kpq", share, apart, apart) / held[:, None, None]
    covariance += SPREAD * np.eye(scores.shape[1])
    return GaussianMixture(held / held.sum(), mean, covariance)


def clustered(scores: Array, clusters: int, draws: RandomState) -> NDArray[np.int64]:
    """Return the cluster, (n,), of scores (n, P): k-means from centres far apart."""
    scores = scores - scores.mean(axis=0)
    centres = _far_apart(scores, min(clusters, len(scores)), draws)
    nearest = np.full(len(scores), -1)
    for _ in range(MOST_ROUNDS[0]):
        before, nearest = nearest, _nearest(scores, centres)
        moved = np.array([scores[nearest == k].mean(axis=0) if (nearest == k).any() else centre
                          for k, centre in enumerate(centres)])  # fmt: skip
        shift, centres = _squared(moved - centres).sum(), moved
        if np.array_equal(nearest, before):
            return nearest
        if shift <= CLUSTERS_STILL * scores.var(axis=0).mean():
            break
    return _nearest(scores, centres)


def _nearest(scores: Array, centres: Array) -> NDArray[np.int64]:
    return np.asarray(_squared(scores[:, None] - centres).argmin(axis=1))


def _far_apart(scores: Array, clusters: int, draws: RandomState) -> Array:
    """Draw centres among the scores, (K, P).

    Each is the best of a few candidates, drawn with a probability in proportion to the squared
    distance from the nearest centre so far: the one that leaves the least sum of these.
    """
    even = np.full(len(scores), 1.0 / len(scores))
    centres = [scores[draws.choice(len(scores), p=even)]]
    square = _squared(scores - centres[0])
    for _ in range(1, clusters):
        drawn = draws.uniform(size=2 + int(np.log(clusters))) * square.sum()
        candidates = np.minimum(np.searchsorted(np.cumsum(square), drawn), len(scores) - 1)
        left = np.minimum(square, _squared(scores[candidates, None] - scores))
        best = int(left.sum(axis=1).argmin())
        centres.append(scores[candidates[best]])
        square = left[best]
    return np.array(centres)


def _squared(apart: Array) -> Array:
    """Squared length of vectors (..., P)."""
    return np.asarray((apart**2).sum(axis=-1))
