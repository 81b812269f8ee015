"""The velocity process: its mean and covariances against simulation and closed forms."""

import numpy as np
import pytest

from wideberth.predictors.core.propagation import joint_covariance
from wideberth.predictors.core.velocity_process import (
    Estimation,
    VelocityProcess,
    differenced_noise,
    displacements,
    process_covariances,
    process_joint,
    velocity_path,
)
from wideberth.predictors.var import paper_covariances, velocity_covariances

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
    return VelocityProcess(lags[None], 0.01 * np.eye(2)[None])


def tilted(size=2, order=2):
    """A stable process that mixes axes."""
    rng = np.random.default_rng(5)
    lags = 0.35 * rng.standard_normal((order, size, size)) / size + 0.35 * np.eye(size)
    root = 0.2 * rng.standard_normal((size, size))
    innovation = root @ root.T + 0.01 * np.eye(size)
    return VelocityProcess(lags[None], innovation[None])


def test_one_number_that_is_not_finite_spoils_one_process():
    whole = tilted()
    parts = (whole.coefficients, whole.innovation)
    assert whole.finite().tolist() == [True]
    for spoilt in range(2):
        pair = [np.concatenate([part, part]) for part in parts]
        pair[spoilt][1].flat[0] = np.inf
        assert VelocityProcess(*pair).finite().tolist() == [True, False]


def simulate(process, runs, steps, rng, burn=0, start=None):
    """Velocities, (runs, p + steps, D): p known ones, then the future."""
    order, size = process.coefficients.shape[1:3]
    root = np.linalg.cholesky(process.innovation[0])
    path = np.zeros((runs, order + burn + steps, size))
    if start is not None:
        path[:, :order] = start
    for h in range(order, path.shape[1]):
        for lag, matrix in enumerate(process.coefficients[0]):
            path[:, h] += path[:, h - 1 - lag] @ matrix.T
        path[:, h] += rng.standard_normal((runs, size)) @ root.T
    return path[:, burn:]


def coverage(error, covariance):
    """Percent of runs inside the 95 % ellipse, per step; a zero covariance covers nothing."""
    covered = np.zeros(error.shape[1])
    for h, matrix in enumerate(covariance):
        if np.trace(matrix) > 0:
            distance = np.einsum("ri,ij,rj->r", error[:, h], np.linalg.inv(matrix), error[:, h])
            covered[h] = 100 * (distance < QUANTILE).mean()
    return covered


def state_model(process, dt, integration):
    """Transition F and noise input G of the state (p_h, v_h, ..., v_{h-p+1}): textbook form."""
    order, size = process.coefficients.shape[1:3]
    companion = process.companion()[0]
    transition, entry = np.eye((order + 1) * size), np.zeros(((order + 1) * size, size))
    transition[size:, size:] = companion
    before = np.eye(size, order * size)
    share = companion[:size] if integration == "rectangle" else (companion[:size] + before) / 2
    transition[:size, size:] = dt * share
    entry[:size] = dt * np.eye(size) / (1 if integration == "rectangle" else 2)
    entry[size : 2 * size] = np.eye(size)
    return transition, entry


def marginals(process, start, rule):
    """Exact covariance of each step for one obstacle."""
    return process_covariances(process, DT, STEPS, start, rule)[0]


def mean_position(process, recent, steps, rule):
    path = velocity_path(process, recent[None], steps)
    return displacements(path, len(recent), DT, rule)[0].ravel()


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
    none, start = np.zeros((1, 2, 2)), np.zeros((1, 6, 6))
    exact = marginals(process, start, "rectangle")
    paper = paper_covariances(process, DT, STEPS, none)[0]
    got = [
        coverage(error["trapezoid"], covariance)
        for covariance in (
            paper_covariances(process, DT, STEPS, none, literal=True)[0],
            paper,
            paper_covariances(process, DT, STEPS, none, "rectangle")[0],
            marginals(process, start, "trapezoid"),
        )
    ]
    np.testing.assert_allclose(np.stack(got)[:, SHOWN], TABLE[name], atol=1.5)
    np.testing.assert_allclose(coverage(error["rectangle"], exact), 95.0, atol=0.5)
    ratio = np.sqrt(exact[-1, 0, 0] / paper[-1, 0, 0])
    assert ratio == pytest.approx(RATIO[name], abs=0.006)


def test_random_walk_has_the_closed_form_ratio():
    process = planar(1.0, 0.0)
    exact = marginals(process, np.zeros((1, 6, 6)), "rectangle")
    paper = paper_covariances(process, DT, STEPS, np.zeros((1, 2, 2)))[0]
    h = np.arange(1, STEPS + 1)
    np.testing.assert_allclose(
        exact[:, 0, 0] / paper[:, 0, 0], 4 * (h + 1) * (2 * h + 1) / (6 * h), rtol=1e-12
    )


@pytest.mark.parametrize("size", [2, 3])
def test_exact_joint_equals_the_moving_average_form(size):
    process, steps = tilted(size), 6
    companion = process.companion()[0]
    impulse = [np.linalg.matrix_power(companion, i)[:size, :size] for i in range(steps)]
    weights = np.cumsum(impulse, axis=0)
    wanted = np.zeros((steps, size, steps, size))
    for j in range(steps):
        for h in range(steps):
            for shock in range(min(j, h) + 1):
                wanted[j, :, h] += (
                    DT**2 * weights[j - shock] @ process.innovation[0] @ weights[h - shock].T
                )
    got = process_joint(process, DT, steps, np.zeros((1, 3 * size, 3 * size)), "rectangle")[0]
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
    mean = mean_position(process, start_velocity[::-1], steps, rule)
    joint = process_joint(process, DT, steps, np.zeros((1, 6, 6)), rule)[0]
    sigma = np.sqrt(np.diag(joint) / runs)
    assert (np.abs(flat.mean(axis=0) - mean) < 3 * sigma + 1e-12).all()
    sample = np.cov(flat.T)
    spread = np.sqrt((np.outer(np.diag(joint), np.diag(joint)) + joint**2) / runs)
    # Fifty-five different entries: at three sigma at most one of them may stick out.
    assert (np.abs(sample - joint) > 3 * spread).sum() <= 2


def test_start_covariance_is_carried_along():
    process, rng = tilted(), np.random.default_rng(4)
    noise = np.array([[4e-4, 1e-4], [1e-4, 2e-4]])
    start = differenced_noise(noise[None], DT, 2)[0]
    root = np.linalg.cholesky(noise)
    error = rng.standard_normal((40_000, 3, 2)) @ root.T  # of p_k, p_{k-1}, p_{k-2}
    state = np.concatenate(
        [error[:, 0], (error[:, 0] - error[:, 1]) / DT, (error[:, 1] - error[:, 2]) / DT], axis=1
    )
    spread = np.sqrt((np.outer(np.diag(start), np.diag(start)) + start**2) / 40_000)
    assert (np.abs(np.cov(state.T) - start) < 3.5 * spread + 1e-18).all()
    quiet = VelocityProcess(process.coefficients, 1e-30 * np.eye(2)[None])
    transition, _ = state_model(quiet, DT, "rectangle")
    power = np.linalg.matrix_power(transition, 4)
    joint = process_joint(quiet, DT, 4, start[None], "rectangle")[0]
    np.testing.assert_allclose(joint[6:, 6:], (power @ start @ power.T)[:2, :2], rtol=1e-12)


@pytest.mark.parametrize("rule", ["rectangle", "trapezoid"])
@pytest.mark.parametrize(("size", "order"), [(2, 1), (2, 2), (3, 2)])
def test_joint_equals_the_state_space_recursion(rule, size, order):
    """F P F' + G Sigma_u G' on the joint state: another way to the same numbers."""
    process, steps = tilted(size, order), 7
    transition, entry = state_model(process, DT, rule)
    rng = np.random.default_rng(8)
    root = 0.1 * rng.standard_normal((len(transition), len(transition)))
    noise = entry @ process.innovation[0] @ entry.T
    start = root @ root.T
    wanted = joint_covariance(transition, noise, start, size, steps)
    joint = process_joint(process, DT, steps, start[None], rule)[0]
    np.testing.assert_allclose(joint, wanted, rtol=1e-11, atol=1e-14)
    each = process_covariances(process, DT, steps, start[None], rule)[0]
    for h in range(steps):
        block = wanted[h * size :, h * size :][:size, :size]
        np.testing.assert_allclose(each[h], block, rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("rule", ["rectangle", "trapezoid"])
def test_estimation_term_against_finite_differences(rule):
    process, steps = tilted(), 6
    recent = np.array([[0.3, 0.2], [0.4, 0.1]])
    root = np.random.default_rng(6).standard_normal((4, 4)) / 7

    def positions(flat):
        matrix = flat.reshape(4, 2).T  # vec is column by column
        lags = matrix.reshape(2, 2, 2).swapaxes(0, 1)
        changed = VelocityProcess(lags[None], process.innovation)
        return mean_position(changed, recent, steps, rule)

    flat = np.concatenate([*process.coefficients[0]], axis=1).T.ravel()
    step = 1e-6
    jacobian = np.stack(
        [(positions(flat + step * e) - positions(flat - step * e)) / (2 * step)
         for e in np.eye(len(flat))],
        axis=1,
    )  # fmt: skip
    wanted = jacobian @ np.kron(root @ root.T, process.innovation[0]) @ jacobian.T
    estimation = Estimation(velocity_path(process, recent[None], steps), root[None])
    start = np.zeros((1, 6, 6))
    known = process_joint(process, DT, steps, start, rule)[0]
    estimated = process_joint(process, DT, steps, start, rule, estimation)[0]
    np.testing.assert_allclose(estimated - known, wanted, rtol=1e-6, atol=1e-9)
    each = process_covariances(process, DT, steps, start, rule, estimation)[0]
    for h in range(steps):
        block = estimated[2 * h :, 2 * h :][:2, :2]
        np.testing.assert_allclose(each[h], block, rtol=1e-12)


def test_a_singular_start_and_innovation_are_no_trouble():
    flat = np.array([[0.04, 0.02], [0.02, 0.01]])  # rank one
    process = VelocityProcess(tilted().coefficients, flat[None])
    start = np.kron(np.ones((3, 3)), flat)[None]
    transition, entry = state_model(process, DT, "rectangle")
    wanted = joint_covariance(transition, entry @ flat @ entry.T, start[0], 2, 5)
    joint = process_joint(process, DT, 5, start, "rectangle")[0]
    np.testing.assert_allclose(joint, wanted, rtol=1e-12, atol=1e-15)


def test_paper_recursion_as_printed():
    process, noise = tilted(), np.diag([0.01, 0.02])
    spread = velocity_covariances(process, STEPS)[0]
    literal, mended, before = [noise], [noise], np.zeros((2, 2))
    for i in range(STEPS):
        literal.append(literal[-1] + DT**2 / 4 * (np.zeros((2, 2)) + before))
        mended.append(mended[-1] + DT**2 / 4 * (spread[i] + before))
        before = spread[i]
    got = paper_covariances(process, DT, STEPS, noise[None], literal=True)[0]
    np.testing.assert_allclose(got, literal[1:], rtol=1e-13)
    got = paper_covariances(process, DT, STEPS, noise[None])[0]
    np.testing.assert_allclose(got, mended[1:], rtol=1e-13)


def test_obstacles_do_not_touch_each_other():
    first, second = tilted(), planar(0.9, 0.05)
    both = VelocityProcess(
        *(np.concatenate([getattr(one, name) for one in (first, second)])
          for name in ("coefficients", "innovation"))
    )  # fmt: skip
    recent = np.random.default_rng(9).standard_normal((2, 2, 2))
    start = differenced_noise(np.stack([np.eye(2), np.diag([0.1, 0.2])]), DT, 2)
    root = np.stack([0.1 * np.eye(4), 0.2 * np.eye(4)])
    together = Estimation(velocity_path(both, recent, 5), root)
    joint = process_joint(both, DT, 5, start, "rectangle", together)
    for o, one in enumerate((first, second)):
        path = velocity_path(one, recent[o : o + 1], 5)
        np.testing.assert_allclose(together.path[o : o + 1], path, rtol=1e-13)
        alone = Estimation(path, root[o : o + 1])
        wanted = process_joint(one, DT, 5, start[o : o + 1], "rectangle", alone)
        np.testing.assert_allclose(joint[o : o + 1], wanted, rtol=1e-12, atol=1e-15)
