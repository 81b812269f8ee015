"""The slack of the regions, one per stage: eliminated from the Newton step, and its own step."""

from numba import njit

from .memory import LEAN


@njit(**LEAN)
def close(size, quadratic, slack, mu, rho):
    """Eliminate the slack of each stage, whose price is rho."""
    last = size.n + 1
    for i in range(size.steps):
        into, force = quadratic.slots[i], quadratic.force[i]
        into[last, last] += slack.nu[i] / slack.eps[i]
        force[last] += rho - mu / slack.eps[i]
        for r in range(last):
            factor = into[last, r] / into[last, last]
            if factor != 0.0:
                force[r] -= factor * force[last]
                for k in range(r + 1):
                    into[r, k] -= factor * into[last, k]


@njit(**LEAN)
def open_slack(size, quadratic, slack, dv, ds, mu):
    """Write the steps of the slacks and their multipliers from those of states and level."""
    n = size.n
    for i in range(size.steps):
        into, eps, nu = quadratic.slots[i], slack.eps[i], slack.nu[i]
        value = quadratic.force[i, n + 1] + into[n + 1, n] * ds
        for r in range(n):
            value += into[n + 1, r] * dv[r, i + 1]
        slack.deps[i] = -value / into[n + 1, n + 1]
        slack.dnu[i] = (mu - nu * slack.deps[i]) / eps - nu


@njit(**LEAN)
def settle(size, moving, standing, slack, mu, rho):
    """Correct the step of the constraint that is paid for most at each stage.

    Inside a region t is tiny, and its step, a difference of numbers that nearly cancel, loses all
    digits once it is multiplied by lambda / t. The slack's own equation,
    rho - nu - sum lambda = 0 after the step, gives the new lambda without that loss.
    """
    for i in range(size.steps):
        if slack.nu[i] > 0.9 * rho:
            continue
        one, j, c = _heaviest(size, moving, i)
        two, k, d = _heaviest(size, standing, i)
        if max(one, two) < 0.1 * rho:
            continue
        rest = rho - slack.nu[i] - slack.dnu[i]
        rest -= _pressed(size, moving, i, j if one >= two else -1, c)
        rest -= _pressed(size, standing, i, -1 if one >= two else k, d)
        if one >= two:
            _correct(moving, j, c, rest, one, mu)
        else:
            _correct(standing, k, d, rest, two, mu)


@njit(**LEAN)
def _heaviest(size, slots, i):
    """Return the largest multiplier of a stage and where it stands."""
    first, count = len(slots.depends) + size.shared + len(slots.lower), len(slots.active)
    largest, row, column = 0.0, 0, 0
    for j in range(slots.t.shape[0]):
        for c in range(i * count, (i + 1) * count):
            if slots.v[first + j, c] > largest:
                largest, row, column = slots.v[first + j, c], j, c
    return largest, row, column


@njit(**LEAN)
def _pressed(size, slots, i, row, column):
    """Sum of the new multipliers of a stage, but for one."""
    first, count = len(slots.depends) + size.shared + len(slots.lower), len(slots.active)
    total = 0.0
    for j in range(slots.t.shape[0]):
        for c in range(i * count, (i + 1) * count):
            if j != row or c != column:
                total += slots.v[first + j, c] + slots.dlam[j, c]
    return total


@njit(**LEAN)
def _correct(slots, j, c, new, old, mu):
    """Write the steps of lambda and t that lead to a new lambda."""
    slots.dlam[j, c] = new - old
    slots.dt[j, c] = (mu - slots.t[j, c] * new) / old
