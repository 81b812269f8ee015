"""Covariance propagation of linear models against closed forms and the matrix exponential."""

import numpy as np
import pytest
from scipy.linalg import expm

from wideberth.predictors.core.propagation import (
    cut_steps,
    joint_covariance,
    step_covariances,
    step_joint,
    white_acceleration,
)
from wideberth.predictors.core.small_matrices import _inside, spectral_radius

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
    late = np.array([0, 2, 0, 1, 3])
    joint = step_joint(*model, start, size, 6, late)
    steps = step_covariances(*model, start, size, 9)
    for i in range(5):
        alone = joint_covariance(*model, start[i], size, 9)
        for h in range(9):
            block = alone[h * size : (h + 1) * size, h * size : (h + 1) * size]
            np.testing.assert_allclose(steps[i, h], block, rtol=1e-12)
        first = late[i] * size
        wanted = alone[first : first + 6 * size, first : first + 6 * size]
        np.testing.assert_allclose(joint[i], wanted, rtol=1e-12)
        np.testing.assert_array_equal(cut_steps(alone[None], 6, size, late[i : i + 1])[0], wanted)
