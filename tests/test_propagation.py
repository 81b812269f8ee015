"""Covariance propagation against simulation, closed forms and statsmodels."""

import numpy as np
import pytest
from scipy.linalg import expm

from wideberth.predictors.propagation import (
    cut_steps,
    joint_covariance,
    step_covariances,
    step_joint,
    white_acceleration,
)
from wideberth.predictors.velocity_process import (
    VelocityProcess,
    differenced_noise,
    displacements,
    estimation_joint,
    exact_joint,
    forecast_velocities,
    paper_covariances,
    state_model,
    velocity_covariances,
)

DT, STEPS, RUNS = 0.5, 15, 20_000
QUANTILE = 5.991464547107979  # 95 % of chi-squared with two degrees of freedom
SHOWN = np.array([1, 5, 10, 15]) - 1
PROCESSES = {
    "persistent": (1.2, -0.22),
    "random walk": (1.0, 0.0),
    "AR(1) 0.5": (0.5, 0.0),
    "white": (0.0, 0.0),
}
# Coverage in percent at steps 1, 5, 10, 15 of nominal 95 % ellipses (measured beforehand with
# another implementation), all with the paper's trapezoid mean: literal, paper, rectangle without
# covariances, exact trapezoid.
TABLE = {
    "persistent": ((0, 12, 8, 6), (53, 28, 18, 13), (95, 55, 35, 26), (53, 89, 93, 94)),
    "random walk": ((0, 13, 8, 6), (53, 29, 18, 13), (95, 56, 35, 25), (53, 90, 93, 94)),
    "AR(1) 0.5": ((0, 24, 23, 22), (50, 45, 42, 41), (94, 74, 68, 67), (50, 92, 94, 94)),
    "white": ((0, 44, 48, 50), (45, 73, 75, 76), (91, 95, 95, 95), (45, 92, 93, 94)),
}
RATIO = {"persistent": 4.63, "random walk": 4.70, "AR(1) 0.5": 2.38, "white": 1.44}


def planar(first, second):
    lags = np.stack([first * np.eye(2), second * np.eye(2)])
    return VelocityProcess(lags, 0.01 * np.eye(2), np.zeros(2))


def tilted(size=2, order=2):
    """A stable process that mixes axes, with an intercept."""
    rng = np.random.default_rng(5)
    lags = 0.35 * rng.standard_normal((order, size, size)) / size + 0.35 * np.eye(size)
    root = 0.2 * rng.standard_normal((size, size))
    return VelocityProcess(lags, root @ root.T + 0.01 * np.eye(size), 0.1 * rng.random(size))


def simulate(process, runs, steps, rng, burn=0, start=None):
    """Velocities, (runs, p + steps, D): p known ones, then the future."""
    order, size = process.coefficients.shape[:2]
    root = np.linalg.cholesky(process.innovation)
    path = np.zeros((runs, order + burn + steps, size))
    if start is not None:
        path[:, :order] = start
    for h in range(order, path.shape[1]):
        for lag, matrix in enumerate(process.coefficients):
            path[:, h] += path[:, h - 1 - lag] @ matrix.T
        path[:, h] += process.intercept + rng.standard_normal((runs, size)) @ root.T
    return path[:, burn:]


def coverage(error, covariance):
    """Percent of runs inside the 95 % ellipse, per step; a zero covariance covers nothing."""
    covered = np.zeros(error.shape[1])
    for h, matrix in enumerate(covariance):
        if np.trace(matrix) > 0:
            distance = np.einsum("ri,ij,rj->r", error[:, h], np.linalg.inv(matrix), error[:, h])
            covered[h] = 100 * (distance < QUANTILE).mean()
    return covered


def marginals(joint, size=2):
    steps = len(joint) // size
    return np.stack([joint[size * h :, size * h :][:size, :size] for h in range(steps)])


@pytest.mark.parametrize("name", PROCESSES)
def test_table_of_coverages_on_simulated_tracks(name):
    process = planar(*PROCESSES[name])
    rng = np.random.default_rng(11)
    path = simulate(process, RUNS, STEPS, rng, burn=200)
    truth = DT * np.cumsum(path[:, 2:], axis=1)
    means = np.empty((STEPS, RUNS, 2))
    before, last = path[:, 0], path[:, 1]
    for h in range(STEPS):
        means[h] = PROCESSES[name][0] * last + PROCESSES[name][1] * before
        before, last = last, means[h]
    means = means.swapaxes(0, 1)
    lagged = np.concatenate([path[:, 1:2], means[:, :-1]], axis=1)
    error = {
        "rectangle": truth - DT * np.cumsum(means, axis=1),
        "trapezoid": truth - 0.5 * DT * np.cumsum(means + lagged, axis=1),
    }
    none, start = np.zeros((2, 2)), np.zeros((6, 6))
    exact = marginals(exact_joint(process, DT, STEPS, start, "rectangle"))
    paper = paper_covariances(process, DT, STEPS, none)
    got = [
        coverage(error["trapezoid"], paper_covariances(process, DT, STEPS, none, literal=True)),
        coverage(error["trapezoid"], paper),
        coverage(error["trapezoid"], paper_covariances(process, DT, STEPS, none, "rectangle")),
        coverage(
            error["trapezoid"], marginals(exact_joint(process, DT, STEPS, start, "trapezoid"))
        ),
    ]
    np.testing.assert_allclose(np.stack(got)[:, SHOWN], TABLE[name], atol=1.5)
    np.testing.assert_allclose(coverage(error["rectangle"], exact), 95.0, atol=0.5)
    ratio = np.sqrt(exact[-1, 0, 0] / paper[-1, 0, 0])
    assert ratio == pytest.approx(RATIO[name], abs=0.006)


def test_random_walk_has_the_closed_form_ratio():
    process = planar(1.0, 0.0)
    exact = marginals(exact_joint(process, DT, STEPS, np.zeros((6, 6)), "rectangle"))
    paper = paper_covariances(process, DT, STEPS, np.zeros((2, 2)))
    h = np.arange(1, STEPS + 1)
    np.testing.assert_allclose(
        exact[:, 0, 0] / paper[:, 0, 0], 4 * (h + 1) * (2 * h + 1) / (6 * h), rtol=1e-12
    )


@pytest.mark.parametrize("size", [2, 3])
def test_exact_joint_equals_the_moving_average_form(size):
    process, steps = tilted(size), 6
    companion = process.companion()
    impulse = [np.linalg.matrix_power(companion, i)[:size, :size] for i in range(steps)]
    weights = np.cumsum(impulse, axis=0)
    wanted = np.zeros((steps, size, steps, size))
    for j in range(steps):
        for h in range(steps):
            for shock in range(min(j, h) + 1):
                wanted[j, :, h] += (
                    DT**2 * weights[j - shock] @ process.innovation @ weights[h - shock].T
                )
    got = exact_joint(process, DT, steps, np.zeros((3 * size, 3 * size)), "rectangle")
    np.testing.assert_allclose(got, wanted.reshape(got.shape), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("rule", ["rectangle", "trapezoid"])
def test_joint_covariance_and_mean_match_simulation(rule):
    process, steps, runs = tilted(), 5, 40_000
    rng = np.random.default_rng(3)
    start_velocity = np.array([[0.4, 0.1], [0.3, 0.2]])  # oldest first
    path = simulate(process, runs, steps, rng, start=start_velocity)
    newest = path[:, 1:2]
    if rule == "rectangle":
        position = DT * np.cumsum(path[:, 2:], axis=1)
    else:
        lagged = np.concatenate([newest, path[:, 2:-1]], axis=1)
        position = 0.5 * DT * np.cumsum(path[:, 2:] + lagged, axis=1)
    flat = position.reshape(runs, -1)
    means = forecast_velocities(process, start_velocity[::-1], steps)
    mean = displacements(means, start_velocity[1], DT, rule).ravel()
    joint = exact_joint(process, DT, steps, np.zeros((6, 6)), rule)
    sigma = np.sqrt(np.diag(joint) / runs)
    assert (np.abs(flat.mean(axis=0) - mean) < 3 * sigma + 1e-12).all()
    sample = np.cov(flat.T)
    spread = np.sqrt((np.outer(np.diag(joint), np.diag(joint)) + joint**2) / runs)
    # Fifty-five different entries: at three sigma at most one of them may stick out.
    assert (np.abs(sample - joint) > 3 * spread).sum() <= 2


def test_start_covariance_is_carried_along():
    process, rng = tilted(), np.random.default_rng(4)
    noise = np.array([[4e-4, 1e-4], [1e-4, 2e-4]])
    start = differenced_noise(noise, DT, 2)
    root = np.linalg.cholesky(noise)
    error = rng.standard_normal((40_000, 3, 2)) @ root.T  # of p_k, p_{k-1}, p_{k-2}
    state = np.concatenate(
        [error[:, 0], (error[:, 0] - error[:, 1]) / DT, (error[:, 1] - error[:, 2]) / DT], axis=1
    )
    spread = np.sqrt((np.outer(np.diag(start), np.diag(start)) + start**2) / 40_000)
    assert (np.abs(np.cov(state.T) - start) < 3.5 * spread + 1e-18).all()
    quiet = VelocityProcess(process.coefficients, 1e-30 * np.eye(2), process.intercept)
    transition, _ = state_model(quiet, DT, "rectangle")
    power = np.linalg.matrix_power(transition, 4)
    joint = exact_joint(quiet, DT, 4, start, "rectangle")
    np.testing.assert_allclose(joint[6:, 6:], (power @ start @ power.T)[:2, :2], rtol=1e-12)


@pytest.mark.parametrize("rule", ["rectangle", "trapezoid"])
@pytest.mark.parametrize("extra", [0, 1])
def test_estimation_jacobian_against_finite_differences(rule, extra):
    process, steps = tilted(), 6
    recent = np.array([[0.3, 0.2], [0.4, 0.1]])
    count = 4 + extra
    rng = np.random.default_rng(6)
    root = rng.standard_normal((count, count))
    moments = root @ root.T / 50

    def positions(flat):
        matrix = flat.reshape(count, 2).T  # vec is column by column
        intercept = matrix[:, 0] if extra else process.intercept
        lags = matrix[:, extra:].reshape(2, 2, 2).swapaxes(0, 1)
        changed = VelocityProcess(lags, process.innovation, intercept)
        means = forecast_velocities(changed, recent, steps)
        return displacements(means, recent[0], DT, rule).ravel()

    blocks = [process.intercept[:, None]] if extra else []
    flat = np.concatenate([*blocks, *process.coefficients], axis=1).T.ravel()
    step = 1e-6
    jacobian = np.stack(
        [(positions(flat + step * e) - positions(flat - step * e)) / (2 * step)
         for e in np.eye(len(flat))],
        axis=1,
    )  # fmt: skip
    wanted = jacobian @ np.kron(moments, process.innovation) @ jacobian.T
    got = estimation_joint(process, DT, recent, steps, moments, rule)
    np.testing.assert_allclose(got, wanted, rtol=1e-6, atol=1e-9)


def test_paper_recursion_as_printed():
    process, noise = tilted(), np.diag([0.01, 0.02])
    spread = velocity_covariances(process, STEPS)
    literal, mended, before = [noise], [noise], np.zeros((2, 2))
    for i in range(STEPS):
        literal.append(literal[-1] + DT**2 / 4 * (np.zeros((2, 2)) + before))
        mended.append(mended[-1] + DT**2 / 4 * (spread[i] + before))
        before = spread[i]
    got = paper_covariances(process, DT, STEPS, noise, literal=True)
    np.testing.assert_allclose(got, literal[1:], rtol=1e-13)
    got = paper_covariances(process, DT, STEPS, noise)
    np.testing.assert_allclose(got, mended[1:], rtol=1e-13)


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


def test_radius_says_whether_velocities_explode():
    assert planar(1.2, -0.22).radius() == pytest.approx(np.roots([1, -1.2, 0.22]).max())
    assert planar(1.3, -0.2).radius() > 1


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
