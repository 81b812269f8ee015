"""Interacting multiple models over all obstacles at once: arrays in, arrays out.

Notation: M models, S components of the state (position, velocity, ...), O obstacles, pi_ij the
probability that model j follows model i after one step.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...framework.values.arrays import Array, BoolArray
from .history import Histories, IntArray
from .kalman_filter import measured_update
from .propagation import cut_steps

FAINTEST = -690.0
"""Least logarithm of a model's probability over that of the likeliest one: 1e-300."""


@dataclass(frozen=True, eq=False)
class ModeBank:
    """Linear models and the chain that switches between them.

    Attributes
    ----------
    transition : (M, S, S), F_j.
    process : (M, S, S), Q_j.
    switching : (M, M), pi_ij; rows sum to 1.
    """

    transition: Array
    process: Array
    switching: Array

    @property
    def models(self) -> Iterator[tuple[Array, Array]]:
        """F_j and Q_j of each model."""
        return zip(self.transition, self.process, strict=True)

    @cached_property
    def squared(self) -> Array:
        """F_j kron F_j, (M, S^2, S^2)."""
        return np.stack([np.kron(transition, transition) for transition in self.transition])


@dataclass(frozen=True, eq=False)
class Beliefs:
    """State estimate of each obstacle under each model.

    Obstacles are the last axis: sums over few models and components then run along memory.

    Attributes
    ----------
    weight : (M, O), model probabilities, mu.
    state : (S, M, O).
    covariance : (S, S, M, O).
    """

    weight: Array
    state: Array
    covariance: Array

    def where(self, chosen: BoolArray, other: "Beliefs") -> "Beliefs":
        """Take these beliefs where ``chosen`` (O,) is True, the other ones elsewhere."""
        if chosen.all():
            return self
        return Beliefs(
            np.where(chosen, self.weight, other.weight),
            np.where(chosen, self.state, other.state),
            np.where(chosen, self.covariance, other.covariance),
        )


def mixed(beliefs: Beliefs, switching: Array) -> Beliefs:
    """Beliefs just before the next step, by the model that will be in force.

    c_j = sum_i pi_ij mu_i,   omega_ij = pi_ij mu_i / c_j,
    x_0j = sum_i omega_ij x_i,   P_0j = sum_i omega_ij (P_i + (x_i - x_0j)(x_i - x_0j)')
    """
    weight = switching.T @ beliefs.weight
    share = switching[:, :, None] * beliefs.weight[:, None] / weight
    state = np.einsum("ijo,sio->sjo", share, beliefs.state)
    gap = beliefs.state[:, :, None] - state[:, None]
    covariance = np.einsum("ijo,abio->abjo", share, beliefs.covariance)
    covariance += np.einsum("aijo,bijo->abjo", share * gap, gap)
    return Beliefs(weight, state, covariance)


def stepped(beliefs: Beliefs, bank: ModeBank) -> Beliefs:
    """Beliefs one step on: mixed, then predicted by each model."""
    before = mixed(beliefs, bank.switching)
    states, modes, count = before.state.shape
    state = bank.transition @ before.state.swapaxes(0, 1)
    # F P F' of all at once: a product of F kron F and the entries of P.
    entries = before.covariance.reshape(states**2, modes, count).swapaxes(0, 1)
    spread = (bank.squared @ entries).reshape(modes, states, states, count)
    spread += bank.process[..., None]
    return Beliefs(before.weight, state.swapaxes(0, 1), np.moveaxis(spread, 0, 2))


def updated(beliefs: Beliefs, measured: Array, variance: Array) -> Beliefs:
    """Beliefs after one measured position, mu_j = c_j Lambda_j / sum of them.

    Parameters
    ----------
    measured, variance : (D, O), m and m^2, along axes on which the errors are independent.
    """
    state, covariance, density = measured_update(
        beliefs.state, beliefs.covariance, measured, variance
    )
    logarithm = np.log(beliefs.weight) + density
    # No model becomes impossible: one that weighs nothing at all could never come back, and
    # after steps much longer than the dwell time nothing would lead to the others.
    weight = np.exp(np.maximum(logarithm - logarithm.max(axis=0), FAINTEST))
    return Beliefs(weight / weight.sum(axis=0), state, covariance)


def filter_modes(past: Histories, noise: Array, bank: ModeBank, speed: float) -> Beliefs:
    """Filter all histories from their first sample on; missing ones are predicted over.

    All models start equally likely with the first sample as position, covariance R, and the
    velocity 0 with ``speed``^2 I (m/s).

    Parameters
    ----------
    past : histories; what was filled in is not used.
    noise : (O, D, D), m^2, positive definite, R.
    """
    count, rows, size = past.positions.shape
    modes, states = bank.transition.shape[:2]
    variance, vectors = np.linalg.eigh(noise)
    local = (past.positions @ vectors).transpose(1, 2, 0).copy()
    spread = np.concatenate([variance.T, np.full((states - size, count), speed**2)])
    first = np.eye(states)[:, :, None, None] * np.repeat(spread[:, None], modes, axis=1)
    beliefs = start = Beliefs(
        np.full((modes, count), 1.0 / modes), np.zeros((states, modes, count)), first
    )
    for column in range(rows):
        ahead = stepped(beliefs, bank)
        measured = updated(ahead, local[column], variance.T)
        beliefs = measured.where(past.observed[:, column], ahead)
        if column <= past.began.max(initial=0):
            place = start.state.copy()
            place[:size] = local[column][:, None]
            fresh = Beliefs(start.weight, place, start.covariance)
            beliefs = fresh.where(np.asarray(column <= past.began), beliefs)
    return _turned(beliefs, vectors)


def _turned(beliefs: Beliefs, vectors: Array) -> Beliefs:
    """Turn states and covariances by the rotations with columns ``vectors``, (O, D, D)."""
    states, modes, count = beliefs.state.shape
    size = vectors.shape[1]
    order = states // size
    state = beliefs.state.reshape(order, size, modes, count)
    blocks = beliefs.covariance.reshape(order, size, order, size, modes, count)
    turn = np.ascontiguousarray(vectors.transpose(1, 2, 0))
    state = np.einsum("abo,kbmo->kamo", turn, state)
    blocks = np.einsum("abo,kblcmo->kalcmo", turn, blocks)
    blocks = np.einsum("dco,kalcmo->kaldmo", turn, blocks)
    return Beliefs(
        beliefs.weight,
        state.reshape(beliefs.state.shape),
        blocks.reshape(beliefs.covariance.shape),
    )


def merged(beliefs: Beliefs, size: int) -> tuple[Array, Array]:
    """Mean (S, O) of the mixture of all models, and covariance (D, D, O) of the position."""
    mean = (beliefs.weight * beliefs.state).sum(axis=1)
    gap = beliefs.state[:size] - mean[:size, None]
    spread = beliefs.covariance[:size, :size] + gap[:, None] * gap
    return mean, np.asarray((beliefs.weight * spread).sum(axis=2))


def merged_path(beliefs: Beliefs, bank: ModeBank, size: int, steps: int) -> tuple[Array, Array]:
    """Mean (O, N, D) and covariance (O, N, D, D) of the position at each step ahead, m, m^2.

    Exact moments of the switching system: mixing keeps the first two moments of every model.
    """
    count = beliefs.weight.shape[1]
    mean, covariance = np.zeros((count, steps, size)), np.zeros((count, steps, size, size))
    for h in range(steps):
        beliefs = stepped(beliefs, bank)
        state, spread = merged(beliefs, size)
        mean[:, h], covariance[:, h] = state[:size].T, spread.transpose(2, 0, 1)
    return mean, covariance


def merged_joint(beliefs: Beliefs, bank: ModeBank, size: int, steps: int, late: IntArray) -> Array:
    """Joint covariance of the positions from step late + 1 to late + N, (O, N*D, N*D), m^2.

    With d_h = s_h - E[s_h], 1_j(h) that model j is in force at step h and
    C_j(h) = E[1_j(h) (d_h; 1) d_i'] for an earlier step i,

    C_j(h+1) = [[F_j, F_j E[s_h] - E[s_{h+1}]], [0, 1]] sum_i pi_ij C_i(h)

    and Cov(s_h, s_i) is the sum of the upper parts of all C_j(h).
    """
    states, modes, count = beliefs.state.shape
    ahead = steps + int(late.max(initial=0))
    joint = np.zeros((count, ahead, size, ahead, size))
    known = np.zeros((states + 1, modes, 0, count))
    centre, _ = merged(beliefs, size)
    for h in range(ahead):
        before, beliefs = centre, stepped(beliefs, bank)
        centre, spread = merged(beliefs, size)
        shift = np.einsum("jst,to->sjo", bank.transition, before) - centre[:, None]
        past = np.einsum("ij,sido->sjdo", bank.switching, known)
        upper = np.einsum("jst,tjdo->sjdo", bank.transition, past[:states])
        upper += shift[:, :, None] * past[states:]
        cross = upper[:size].sum(axis=1).reshape(size, h, size, count)
        joint[:, h, :, :h] = cross.transpose(3, 0, 1, 2)
        joint[:, :h, :, h] = cross.transpose(3, 1, 2, 0)
        joint[:, h, :, h] = spread.transpose(2, 0, 1)
        known = np.concatenate([upper, past[states:]])
        known = np.concatenate([known, _own(beliefs, centre, size)], axis=2)
    flat = joint.reshape(count, ahead * size, ahead * size)
    return cut_steps(flat, steps, size, late)


def _own(beliefs: Beliefs, centre: Array, size: int) -> Array:
    """E[1_j (d; 1) d_p'] of one step, (S + 1, M, D, O), with d_p the position in d."""
    gap = beliefs.state - centre[:, None]
    square = beliefs.covariance[:, :size].swapaxes(1, 2)
    square = square + gap[:, :, None] * gap[:size].swapaxes(0, 1)
    both = np.concatenate([square, gap[:size].swapaxes(0, 1)[None]])
    return np.asarray(beliefs.weight[:, None] * both)
