"""Covariance propagation of linear models against closed forms and the matrix exponential."""

import numpy as np
import pytest
from scipy.linalg import expm

from wideberth.predictors.core.kalman_filter import ModeStates, Start, forecast
from wideberth.predictors.core.propagation import (
    cut_steps,
    joint_covariance,
    white_acceleration,
)
from wideberth.predictors.core.small_matrices import _inside, spectral_radius
from wideberth.predictors.kalman import DriftingVelocity

DT = 0.5


@pytest.mark.parametrize("size", range(1, 7))
def test_matrices_within_a_radius_are_told_by_their_eigenvalues(size):
    rng = np.random.default_rng(size)
    matrix = rng.standard_normal((400, size, size)) * 0.8 / np.sqrt(size)
    largest = np.abs(np.linalg.eigvals(matrix)).max(axis=1)
    for radius in (0.5, 0.9, 1.3):
        clear = np.abs(largest - radius) > 1e-3
        found = _inside(matrix, radius)
        np.testing.assert_array_equal(found[clear], (largest < radius)[clear])
        assert 0 < found.sum() < 400
        wanted = np.maximum(largest, radius)
        np.testing.assert_allclose(spectral_radius(matrix, radius), wanted, rtol=2e-3)
    np.testing.assert_allclose(spectral_radius(matrix), largest)


def test_white_acceleration_against_the_matrix_exponential():
    drift, density = np.array([[0.0, 1.0], [0.0, 0.0]]), 0.3
    inflow = np.diag([0.0, density])
    block = expm(DT * np.block([[-drift, inflow], [np.zeros((2, 2)), drift.T]]))  # Van Loan
    transition, process = white_acceleration(DT, density, 3)
    np.testing.assert_allclose(transition, np.kron(block[2:, 2:].T, np.eye(3)))
    wanted = np.kron(block[2:, 2:].T @ block[:2, 2:], np.eye(3))
    np.testing.assert_allclose(process, wanted, atol=1e-15)


def test_no_steps_give_an_empty_covariance():
    transition, process = white_acceleration(DT, 0.1, 2)
    assert joint_covariance(transition, process, np.eye(4), 2, 0).shape == (0, 0)


@pytest.mark.parametrize("size", [2, 3])
def test_all_obstacles_at_once_are_each_alone(size):
    rng = np.random.default_rng(size)
    model = white_acceleration(0.4, 0.3, size)
    root = rng.normal(size=(5, 2 * size, 2 * size))
    start = root @ root.swapaxes(1, 2)
    late, state = np.array([0, 2, 0, 1, 3]), rng.normal(size=(5, 2, size))
    blocks = start.reshape(5, 2, size, 2, size).transpose(1, 2, 3, 4, 0)[..., None, :]
    modes = ModeStates(np.ones((1, 5)), state.transpose(1, 2, 0)[:, :, None], blocks)
    motion, unseen = DriftingVelocity(0.3, 1.0), np.zeros(5, dtype=np.bool_)
    said = forecast(Start(modes, np.zeros((size, 5)), late, unseen, motion, 0.4), 6, "all")
    assert said.joint is not None
    for i in range(5):
        alone = joint_covariance(*model, start[i], size, 9)
        first = late[i] * size
        wanted = alone[first : first + 6 * size, first : first + 6 * size]
        np.testing.assert_allclose(said.joint[i, 0], wanted, rtol=1e-12)
        for h in range(6):
            block = wanted[h * size : (h + 1) * size, h * size : (h + 1) * size]
            np.testing.assert_allclose(said.covariance[i, 0, h], block, rtol=1e-12)
            place = state[i, 0] + 0.4 * (late[i] + h + 1) * state[i, 1]
            np.testing.assert_allclose(said.mean[i, 0, h], place, rtol=1e-12)
        np.testing.assert_array_equal(cut_steps(alone[None], 6, size, late[i : i + 1])[0], wanted)
