"""Constants of the interior-point method.

A. Waechter and L. T. Biegler, On the implementation of an interior-point filter line-search
algorithm for large-scale nonlinear programming, Math. Program. 106 (2006); equations and sections
below are theirs. Where a value is not IPOPT's, the reason stands beside it.
"""

ITERATIONS = 200
"""Limit."""

TOLERANCE = 1e-6
"""Of the optimality conditions, scaled as by IPOPT."""

START_BARRIER = 0.1
"""First barrier parameter mu."""

START_DISTANCE = 0.1
"""How far a guess is moved inside its bounds, relative to the bounds or to their range. IPOPT's is
1e-2; from further inside, and with `BARRIER_TEST`, fewer iterations are needed."""

WARM_DISTANCE = 3e-2
"""The same for a start with multipliers, which is near its solution. From 1e-3 and from 0.1 more
iterations are needed."""

WARM_RANGE = 1e6
"""Multipliers that a solve starts from stay within this factor of mu / gap, either way."""

LARGEST_GRADIENT = 10.0
"""Of the cost after scaling (section 3.8; IPOPT's is 100)."""

START_PENALTY, MOST_PENALTY, DEARER = 1e4, 1e7, 30.0
"""Price of one unit of slack on hard regions, first and highest, and the factor between."""

DEARER_BARRIER = 1e-4
"""Least mu after the price has been raised."""

SLACK_LEFT = 10.0
"""Hard regions are kept where no slack is larger than this many tolerances."""

BARRIER_TEST = 1000.0
"""The barrier is lowered once the errors of its problem are below this many mu (eq. 6; IPOPT waits
for 10). With 1000, and from further inside the bounds, the compiled method takes 8.4 iterations in
the mean on the recorded instances instead of 11.1, and solves one more."""

LONG = 60
"""Steps from which on a horizon counts as long. Its guess is often far from the solution: if mu
falls early, regions cut most steps to a few per cent. On shorter horizons that costs less than a
large first mu costs a guess that is near (docs/solving.md has the table)."""

LONG_BARRIER, LONG_TEST, LONG_PENALTY = 1.0, 10.0, 1e6
"""First mu, IPOPT's test, and first price of slack on hard regions there, since the second price
takes up to 150 iterations over 120 steps."""

BARRIER_FACTOR, BARRIER_POWER, LAST_BARRIER = 0.2, 1.5, 0.1
"""mu <- min(factor mu, mu^power), not below the last share of the tolerance (eq. 7)."""

BOUNDARY_SHARE = 0.99
"""Least share of the way to a bound that a step may go (eq. 8)."""

NEAR = 0.9
"""A slack is set to the value of its constraint where that is at least this share of what the step
leads to. Otherwise the residuals of constraints that are far from active, which bend, cut steps
short: the exact sum then takes 11.4 iterations in the mean instead of 10.0, and fails at times."""

MULTIPLIER_RANGE = 1e10
"""Multipliers stay within this factor of mu / gap, either way (eq. 16)."""

FIRST_SHIFT, LARGEST_SHIFT = 1e-4, 1e20
"""Regularisation of the Hessian that is tried first, and beyond which a solve has failed
(algorithm IC)."""

SMALLEST_SHIFT, SHIFT_DECREASE, SHIFT_GROWTH, FIRST_GROWTH = 1e-20, 3.0, 8.0, 100.0
"""The next shift begins at the last one divided by the decrease, and grows by a factor; another
where none was needed before."""

SMALLEST_PIVOT = 1e-10
"""Of inputs and level, below which the reduced Hessian does not count as positive definite."""

SMALLEST_OWN_PIVOT = 1e-13
"""Smallest pivot of an own variable of a slot that counts as positive."""

EQUALITY_REGULARISATION = 1e-10
"""Of the equalities of slots, so that dependent ones do no harm."""

FILTER_SIZE = 200
"""Pairs that a filter holds."""

TRIALS = 12
"""Step lengths that a line search tries, each half of the one before."""

FAILURES = 8
"""Line searches without success after which an instance is given up."""

LARGEST_RESIDUAL, SMALL_RESIDUAL = 1e4, 1e-4
"""Residuals, relative to the first, beyond which no step is accepted (eq. 21), and below which the
barrier function has to fall (eq. 19)."""

MARGIN, ARMIJO = 1e-5, 1e-8
"""gamma of eq. 18 and eta of eq. 20."""

SLOPE_POWER, RESIDUAL_POWER = 2.3, 1.1
"""s_phi and s_theta of eq. 19."""

SAME_TARGET = 0.6
"""Share of the distance within which a start leads to a known plan, for the whole Newton step."""

MUCH_DEARER, HARDLY_ENTERED = 0.3, 0.5
"""A start leads to a dearer plan where its cost will exceed the best by this share of 1 + |cost|,
and regions are entered by less than this, all steps together. On the recorded instances the best
plan is then that of full solves; with a share of 0.03 two of 420 lose up to 1 % of the cost, and
where it does not matter how far regions are entered four lose up to 40 %."""

SETTLED_STEPS, SETTLED_SLOPE, MUCH_SLACK = 2, 1e-9, 1e-4
"""A plan that enters regions by more than `MUCH_SLACK` has converged as well once so many Newton
steps in a row would change the barrier function by less than this share of it. The multipliers of
such regions are as large as the price, and their slacks t = h + eps smaller than the rounding
errors of h: the errors of stationarity stay a thousand times above the tolerance, while the plan
moves by 1e-13 m."""

STILL_RESIDUAL, STILL_CHANGE, ROUNDING = 1e-9, 1e-12, 1e-13
"""Residual below which, and relative change of the barrier function within which, a step may do
nothing; relative rounding error of the barrier function."""
