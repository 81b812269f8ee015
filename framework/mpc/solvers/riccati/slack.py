"""The slack of the regions, one per stage: eliminated from the Newton step, and its own step."""

from numba import njit

from .memory import LEAN


@njit(**LEAN)
def close(size, quadratic, slack, mu, rho):
    """Eliminate the slack of each stage, whose price is rho, and add the rest to the stages."""
    n, tall, wide = size.n, size.n + 2, size.wide
    into, force, seen = quadratic.slots, quadratic.force, quadratic.seen
    last = (n + 1) * tall
    for i in range(wide):
        into[last + n + 1, i] += slack.nu[i] / slack.eps[i]
        force[n + 1, i] += rho - mu / slack.eps[i]
    for a in range(len(seen) + size.shared):
        r = seen[a] if a < len(seen) else n
        for i in range(wide):
            force[r, i] -= into[last + r, i] * force[n + 1, i] / into[last + n + 1, i]
        for b in range(a + 1):
            c = seen[b] if b < len(seen) else n
            for i in range(wide):
                both = into[last + r, i] * into[last + c, i] / into[last + n + 1, i]
                into[max(r, c) * tall + min(r, c), i] -= both
    _spread(size, quadratic)


@njit(**LEAN)
def _spread(size, quadratic):
    """Add what slots contribute to the stages: x_{i+1} is that of stage i + 1."""
    n, tall, w = size.n, size.n + 2, size.w
    into, force, seen = quadratic.slots, quadratic.force, quadratic.seen
    for r in seen:
        for i in range(size.steps):
            quadratic.gradient[r, i + 1] += force[r, i]
        for c in seen:
            if c <= r:
                for i in range(size.steps):
                    quadratic.hessian[r * w + c, i + 1] += into[r * tall + c, i]
        if size.shared > 0:
            for i in range(size.steps):
                quadratic.cross[r, i + 1] = into[n * tall + r, i]
    if size.shared > 0:
        for i in range(size.steps):
            quadratic.top[0] += into[n * tall + n, i]
            quadratic.top[1] += force[n, i]


@njit(**LEAN)
def open_slack(size, quadratic, slack, dv, ds, mu):
    """Write the steps of the slacks and their multipliers from those of states and level."""
    n, tall = size.n, size.n + 2
    into, force, last = quadratic.slots, quadratic.force, (size.n + 1) * (size.n + 2)
    for i in range(size.wide):
        slack.deps[i] = force[n + 1, i] + into[last + n, i] * ds
    for r in quadratic.seen:
        for i in range(size.steps):
            slack.deps[i] += into[last + r, i] * dv[r, i + 1]
    for i in range(size.wide):
        slack.deps[i] = -slack.deps[i] / into[last + tall - 1, i]
        eps, nu = slack.eps[i], slack.nu[i]
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
        for c in range(i, i + count * size.wide, size.wide):
            if slots.v[first + j, c] > largest:
                largest, row, column = slots.v[first + j, c], j, c
    return largest, row, column


@njit(**LEAN)
def _pressed(size, slots, i, row, column):
    """Sum of the new multipliers of a stage, but for one."""
    first, count = len(slots.depends) + size.shared + len(slots.lower), len(slots.active)
    total = 0.0
    for j in range(slots.t.shape[0]):
        for c in range(i, i + count * size.wide, size.wide):
            if j != row or c != column:
                total += slots.v[first + j, c] + slots.dlam[j, c]
    return total


@njit(**LEAN)
def _correct(slots, j, c, new, old, mu):
    """Write the steps of lambda and t that lead to a new lambda."""
    slots.dlam[j, c] = new - old
    slots.dt[j, c] = (mu - slots.t[j, c] * new) / old
