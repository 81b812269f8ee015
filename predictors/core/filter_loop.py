"""The steps of `kalman_filter` for one obstacle after the other, compiled by Numba.

Of one obstacle: mu (M,), probabilities of the modes; x (M, sD), state; spread (M, sD, sD),
covariance. Indices: m, i, j of modes; a, b of entries of the state, a = c D + d for component c
of axis d. A mode moves components alike along each axis.
"""

from collections.abc import Callable
from functools import cache
from math import exp, log, sqrt
from typing import Any

import numpy as np

from ...framework.plugins.njit import cached_njit
from ...framework.values.arrays import Array
from ...framework.values.measurements import IntArray

FAINTEST = -690.0
"""Least logarithm of a mode's probability over that of the likeliest one: 1e-300."""


def filter_each(
    begins: IntArray,
    measured: tuple[Array, Array, Array],
    number: IntArray,
    step: IntArray,
    moves: tuple[Array, Array, Array],
    first: tuple[Array, Array],
    modes: tuple[Array, Array, Array],
    origin: Array,
    count: IntArray,
) -> None:
    """Filter the new measurements of all obstacles, in place.

    Parameters
    ----------
    begins : (O + 1,), index of the first measurement of each obstacle among all K.
    measured : (K, D), m, (K, D, D), m^2, and W of each, (K, D, D), see `update`.
    number : (K,), steps since the measurement before; 0 where a filter begins.
    step : (K,), which of L steps they are.
    moves : transition (s, s, M, L), process (s, s, M, L), switching (M, M, L), as in `ModeStep`.
    first : variances of velocity, ... at a filter's first measurement, (s - 1,), and the
        probabilities of the modes, (M,).
    modes : weight (M, O), state (sD, M, O) and covariance (sD, sD, M, O).
    origin, count : (D, O), m, that states are relative to; (O,), measurements used.
    """
    places, noise, whitening = measured
    transition, process, switching = moves
    weight, state, covariance = modes
    entries, number_of_modes, _ = state.shape
    size = len(origin)
    shape = number_of_modes, entries, entries
    mu, x, spread = np.empty(shape[0]), np.empty(shape[:2]), np.empty(shape)
    old_mu, old_x, old_spread = np.empty(shape[0]), np.empty(shape[:2]), np.empty(shape)
    place = np.empty(size)
    for o in range(len(begins) - 1):
        if begins[o] == begins[o + 1]:
            continue
        for m in range(number_of_modes):
            mu[m] = weight[m, o]
            for a in range(entries):
                x[m, a] = state[a, m, o]
                for b in range(entries):
                    spread[m, a, b] = covariance[a, b, m, o]
        for k in range(begins[o], begins[o + 1]):
            if number[k] == 0:
                count[o] = 0
                for d in range(size):
                    origin[d, o] = places[k, d]
                begin(mu, x, spread, noise, k, first[0], first[1])
            else:
                for _ in range(number[k]):
                    if number_of_modes > 1:
                        mix(mu, x, spread, switching, step[k], old_mu, old_x, old_spread)
                    move(x, spread, transition, process, step[k], old_x, old_spread)
                for d in range(size):
                    place[d] = places[k, d] - origin[d, o]
                update(mu, x, spread, place, whitening, k, old_x)
            count[o] += 1
        for m in range(number_of_modes):
            weight[m, o] = mu[m]
            for a in range(entries):
                state[a, m, o] = x[m, a]
                for b in range(entries):
                    covariance[a, b, m, o] = spread[m, a, b]


def begin(
    mu: Array, x: Array, spread: Array, noise: Array, k: int, start: Array, usual: Array
) -> None:
    """Set the modes to those after a first measurement, the one numbered k."""
    size = noise.shape[1]
    for m in range(len(mu)):
        mu[m] = usual[m]
        for a in range(x.shape[1]):
            x[m, a] = 0.0
            for b in range(x.shape[1]):
                spread[m, a, b] = noise[k, a, b] if max(a, b) < size else 0.0
            if a >= size:
                spread[m, a, a] = start[a // size - 1]


def move(
    x: Array,
    spread: Array,
    transition: Array,
    process: Array,
    step: int,
    old_x: Array,
    half: Array,
) -> None:
    """Predict by each mode: f x and f P f' + q.

    Parameters
    ----------
    x, spread : changed in place. step : number of f and q. old_x, half : scratch.
    """
    number, entries = x.shape
    components = len(transition)
    size = entries // components
    for m in range(number):
        for a in range(entries):
            old_x[m, a] = x[m, a]
        for a in range(entries):
            c, d = a // size, a % size
            ahead = 0.0
            for e in range(components):
                ahead += transition[c, e, m, step] * old_x[m, e * size + d]
            x[m, a] = ahead
            for b in range(entries):
                total = 0.0
                for e in range(components):
                    total += transition[c, e, m, step] * spread[m, e * size + d, b]
                half[m, a, b] = total
        for a in range(entries):
            for b in range(a + 1):
                total = 0.0
                for e in range(components):
                    total += half[m, a, e * size + b % size] * transition[b // size, e, m, step]
                if a % size == b % size:
                    total += process[a // size, b // size, m, step]
                spread[m, a, b] = spread[m, b, a] = total


def mix(
    mu: Array,
    x: Array,
    spread: Array,
    switching: Array,
    step: int,
    old_mu: Array,
    old_x: Array,
    old_spread: Array,
) -> None:
    """Set the modes to those just before a step, by the mode that will be in force.

    c_j = sum_i pi_ij mu_i,   omega_ij = pi_ij mu_i / c_j,
    x_0j = sum_i omega_ij x_i,   P_0j = sum_i omega_ij (P_i + (x_i - x_0j)(x_i - x_0j)')

    Parameters
    ----------
    mu, x, spread : changed in place. step : number of pi. old_mu, old_x, old_spread : scratch.
    """
    number, entries = x.shape
    for m in range(number):
        old_mu[m] = mu[m]
        for a in range(entries):
            old_x[m, a] = x[m, a]
            for b in range(entries):
                old_spread[m, a, b] = spread[m, a, b]
    for j in range(number):
        total = 0.0
        for i in range(number):
            total += switching[i, j, step] * old_mu[i]
        mu[j] = total
        for a in range(entries):
            mean = 0.0
            for i in range(number):
                mean += switching[i, j, step] * old_mu[i] / total * old_x[i, a]
            x[j, a] = mean
        for a in range(entries):
            for b in range(a + 1):
                whole = 0.0
                for i in range(number):
                    gaps = (old_x[i, a] - x[j, a]) * (old_x[i, b] - x[j, b])
                    share = switching[i, j, step] * old_mu[i] / total
                    whole += share * (old_spread[i, a, b] + gaps)
                spread[j, a, b] = spread[j, b, a] = whole


def update(
    mu: Array,
    x: Array,
    spread: Array,
    place: Array,
    whitening: Array,
    k: int,
    scratch: Array,
) -> None:
    """Set the modes to those after one measured position, mu_j = c_j Lambda_j / sum of them.

    With W' W = R^-1 the D numbers W z have independent errors of variance 1, and are taken one
    after the other, h = a row of W:

    K = P h / S,  S = h' P h + 1,  P+ = (I - K h') P (I - K h')' + K K'

    (Joseph's form: it stays positive semi-definite but for rounding; after jumps of 1e9 m that
    is larger than 1, so that h' P h is cut at 0.) No mode becomes impossible: one that weighs
    nothing at all could never come back, and after steps much longer than the dwell time nothing
    would lead to the others.

    Parameters
    ----------
    mu, x, spread : changed in place.
    place : (D,), m, relative to the origin.
    whitening : (K, D, D), W, lower triangular, 1/m. k : number of the measurement.
    scratch : (M, sD).
    """
    number, entries = x.shape
    most = -np.inf
    for m in range(number):
        evidence = log(mu[m]) if number > 1 else 0.0
        for r in range(len(place)):
            gap, variance = 0.0, 0.0
            for d in range(r + 1):
                gap += whitening[k, r, d] * (place[d] - x[m, d])
            for a in range(entries):
                column = 0.0
                for d in range(r + 1):
                    column += spread[m, a, d] * whitening[k, r, d]
                scratch[m, a] = column
            for d in range(r + 1):
                variance += scratch[m, d] * whitening[k, r, d]
            variance = max(variance, 0.0) + 1.0
            for a in range(entries):
                gain = scratch[m, a] / variance
                x[m, a] += gain * gap
                for b in range(entries):
                    spread[m, a, b] -= gain * scratch[m, b]
            for a in range(entries):
                rest = -scratch[m, a] / variance
                for d in range(r + 1):
                    rest += spread[m, a, d] * whitening[k, r, d]
                for b in range(entries):
                    spread[m, a, b] -= rest * scratch[m, b] / variance
            evidence -= 0.5 * (log(variance) + gap * gap / variance)
        scratch[m, 0] = evidence
        most = max(most, evidence)
    if number > 1:
        whole = 0.0
        for m in range(number):
            mu[m] = exp(max(scratch[m, 0] - most, FAINTEST))
            whole += mu[m]
        for m in range(number):
            mu[m] /= whole


def whiten(noise: Array, whitening: Array) -> None:
    """Set W, lower triangular, with W' W = R^-1, (K, D, D), for positive definite R, (K, D, D)."""
    size = noise.shape[1]
    root = np.empty((size, size))
    for k in range(len(noise)):
        for i in range(size):
            for j in range(i + 1):
                rest = noise[k, i, j]
                for e in range(j):
                    rest -= root[i, e] * root[j, e]
                root[i, j] = sqrt(rest) if i == j else rest / root[j, j]
        for j in range(size):
            for i in range(size):
                total = 1.0 if i == j else 0.0
                for e in range(j, i):
                    total -= root[i, e] * whitening[k, e, j]
                whitening[k, i, j] = total / root[i, i] if i >= j else 0.0


@cache
def compiled() -> tuple[Callable[..., Any], ...]:
    """Return `filter_each` and `whiten`, compiled."""
    return cached_njit([filter_each, whiten], [mix, move, update, begin])
