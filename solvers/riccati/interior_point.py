"""Settings of the interior-point method that Python hands to the core.

Constants that no setting changes stand in core/riccati.h. A. Waechter and L. T. Biegler, On the
implementation of an interior-point filter line-search algorithm for large-scale nonlinear
programming, Math. Program. 106 (2006); equations and sections below are theirs. Where a value is
not IPOPT's, the reason stands beside it.
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

LARGEST_GRADIENT = 10.0
"""Of the cost after scaling (section 3.8; IPOPT's is 100)."""

START_PENALTY, MOST_PENALTY = 1e4, 1e7
"""Price of one unit of slack on hard regions, first and highest."""

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
