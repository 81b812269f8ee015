/* Interior-point method for optimal control problems with obstacles.
 *
 *   minimise    sum_i  stage costs(x_i, u_i) + rho sum_i eps_i + level cost(s)
 *   subject to  x_{i+1} = f(x_i, u_i),  bounds of x and u,  c(x_i, u_i) >= 0,  g(x_{i+1}) >= 0,
 *               h(x_{i+1}, s, a) + eps_{i+1} >= 0 and e(x_{i+1}, s, a) = 0 for every slot in use.
 *
 * A slot holds one obstacle at one step and has own variables a; slots of one kind share their
 * functions. The level s is one number that all regions may share.
 *
 * A. Waechter and L. T. Biegler, On the implementation of an interior-point filter line-search
 * algorithm for large-scale nonlinear programming, Math. Program. 106 (2006); equations and
 * sections below are theirs.
 *
 * Usage: fill in a wb_problem, allocate wb_size(&problem) doubles once, and for every solve fill in
 * wb_settings, wb_start and wb_result and call wb_solve. Nothing is allocated inside, and there is
 * no state outside of what is passed, so that several threads may solve at once, each with memory
 * and results of its own. Arrays are contiguous, the last index runs fastest. SI units.
 */
#ifndef WB_RICCATI_H
#define WB_RICCATI_H

#include <stdint.h>

#include "kernel.h" /* wb_kernel, by which stage functions are called */

/* One kind of slots, K of them at every step. */
typedef struct {
    wb_kernel derivatives;  /* (x's entries, s, a, y), (parameters, level, 1, drawn) -> (h, e),
                               Jacobian, Hessian */
    wb_kernel values;       /* the same -> (h, e) */
    int64_t slots;          /* K */
    int64_t parameters;     /* P, without the level */
    int64_t levelled;       /* 1 where slots have a level of their own, else 0 */
    int64_t entries;        /* number of the entries of x that h and e depend on */
    int64_t inequalities;   /* rows of h, H */
    int64_t equalities;     /* rows of e, E */
    int64_t own;            /* own variables a, A */
    const int64_t *depends; /* (entries,), which entries of x */
    const double *lower;    /* (A,), -infinity where there is no bound */
    const double *upper;    /* (A,) */
    double regularisation;  /* weight of |a - drawn|^2 */
} wb_kind;

/* Functions and sizes. Derivatives are those of the scaled cost plus pi f - y c, where y are the
 * multipliers; Jacobians stand row by row, Hessians are full. */
typedef struct {
    wb_kernel drive;       /* (x, u, pi, y), (head, scale) -> f, cost, gradient, [A B], Hessian, c,
                              Jacobian of c */
    wb_kernel node;        /* (x, y), (head, scale) -> cost, gradient, Hessian, g, its Jacobian */
    wb_kernel node_values; /* (x, y), (head, scale) -> cost, g */
    wb_kernel level;       /* (s), (s_ref, scale) -> cost, its derivative, its second derivative */
    int64_t n, m;          /* states, inputs */
    int64_t steps;         /* N */
    int64_t shared;        /* 1 where the problem has a shared level s, else 0 */
    int64_t input_rows;    /* rows of c(x_i, u_i) */
    int64_t node_rows;     /* rows of g(x_i), i > 0 */
    int64_t final_rows;    /* further rows of g, which hold at x_N alone */
    int64_t head;          /* parameters of one step that belong to no slot */
    int64_t work;          /* doubles of scratch memory that the functions need */
    int64_t kinds;         /* kinds of slots */
    const double *lower;   /* (n + m,), bounds of (x, u), -infinity where there is none */
    const double *upper;   /* (n + m,) */
    const wb_kind *kind;   /* (kinds,) */
} wb_problem;

/* Settings of a solve; recommended values are in solvers/riccati/interior_point.py. */
typedef struct {
    double iterations;   /* limit */
    double tolerance;    /* of the optimality conditions, scaled as by IPOPT */
    double barrier;      /* first barrier parameter mu */
    double test;         /* mu is lowered once the errors are below this many mu (eq. 6) */
    double push;         /* distance of the start from its bounds */
    double penalty;      /* price rho of one unit of slack, the first */
    double most_penalty; /* and the highest; equal to the first where regions are soft */
    double gradient;     /* largest gradient of the cost after scaling (section 3.8) */
    double minimum;      /* lower bound of the level s, -infinity where there is none */
    double guess;        /* of the level */
    double warm;         /* 1 where multipliers are given, else 0 */
    double plans;        /* number of plans that are known from other starts */
    double best;         /* cost of the best of them, infinity where none is known */
    double within;       /* distance within which a start leads to the same plan */
} wb_settings;

/* Numbers of the slots of one kind. Multipliers are those of h, e, of the lower and of the upper
 * bounds of a: H + E + 2 A numbers. */
typedef struct {
    const double *parameters; /* (N, K, P), finite also in slots that are not in use */
    const double *level;      /* (N, K), not read where levelled is 0 */
    const double *active;     /* (K,), above 0 where a slot is in use */
    const double *drawn;      /* (N, K, A), what the regularisation draws to */
    const double *begun;      /* (N, K, A), guess */
    const double *before;     /* (N, K, H + E + 2 A), given multipliers, NaN where a slot is new;
                                 read where settings.warm is 1 */
    double *found;            /* (N, K, A), result; slots not in use keep what stands there */
    double *after; /* (N, K, H + E + 2 A), multipliers, NaN in slots not in use; or NULL */
} wb_slots;

/* What a solve starts from. Multipliers of a step: of the lower bounds of (x_{i+1}, u_i), of the
 * upper ones; of the dynamics; of c(x_i, u_i), of g(x_{i+1}); of the slack; of the level's minimum,
 * which all steps repeat: M = 2 (n + m) + n + rows + 2 numbers. They belong to the cost as it is
 * stated, before scaling. */
typedef struct {
    const double *head;        /* (N, head) */
    const double *initial;     /* (n,), x_0 */
    const double *states;      /* (N + 1, n), guess; the first row is not read */
    const double *inputs;      /* (N, m), guess */
    const double *multipliers; /* (N, M), read where settings.warm is 1 */
    const double *plans;       /* (settings.plans, N + 1, n), states of known plans */
    const wb_slots *slots;     /* (kinds,) */
} wb_start;

/* How a solve ended. */
enum wb_status {
    WB_SOLVED,
    WB_LIMIT,      /* of iterations */
    WB_INFEASIBLE, /* regions are entered, as little as was found */
    WB_FAILED,
    WB_STOPPED, /* by the flag */
    WB_SAME,    /* given up: leads to a plan that is known */
    WB_DEARER,  /* given up: leads to a plan dearer than the best that is known */
};

/* Results of a solve. */
typedef struct {
    double *states;      /* (N + 1, n) */
    double *inputs;      /* (N, m) */
    double *slack;       /* (N,) */
    double *multipliers; /* (N, M); or NULL */
    int64_t status;      /* enum wb_status */
    int64_t iterations;
    double cost;    /* without slack and regularisation */
    double level;   /* s */
    double error;   /* of the optimality conditions */
    double penalty; /* last price of slack */
} wb_result;

/* Return the doubles of memory that a solve needs. */
int64_t wb_size(const wb_problem *problem);

/* Solve from one start. `stop`, or NULL, is a flag that another thread may set to 1 to end it after
 * the present iteration. `memory` holds wb_size(problem) doubles, in any state. */
void wb_solve(const wb_problem *problem, const wb_settings *settings, const wb_start *start,
              wb_result *result, const volatile int64_t *stop, double *memory);

/* ---- Constants. Where a value is not IPOPT's, the reason stands beside it. */

/* Added to the first input of a start without multipliers, twice to the second, and so on. Where a
 * problem is symmetric and its guess, too, exact arithmetic stays on a saddle between the two ways
 * around an obstacle, and rounding alone leaves it: 20 of the 40 recorded ones were solved, with
 * this 36. */
#define WB_TILT 1e-11

/* Multipliers that a solve starts from stay within this factor of mu / gap, either way. */
#define WB_WARM_RANGE 1e6

/* Factor between two prices of slack, and the least mu after the price has been raised. */
#define WB_PENALTY_FACTOR 30.0
#define WB_PENALTY_BARRIER 1e-4

/* Hard regions are kept where no slack is larger than this many tolerances. */
#define WB_SLACK_LEFT 10.0

/* mu <- min(factor mu, mu^power), not below the last share of the tolerance (eq. 7). */
#define WB_BARRIER_FACTOR 0.2
#define WB_BARRIER_POWER 1.5
#define WB_LAST_BARRIER 0.1

/* Least share of the way to a bound that a step may go (eq. 8). */
#define WB_BOUNDARY_SHARE 0.99

/* A slack is set to the value of its constraint where that is at least this share of what the step
 * leads to. Otherwise the residuals of constraints that are far from active, which bend, cut steps
 * short: the exact sum then takes 11.4 iterations in the mean instead of 10.0, and fails at times.
 */
#define WB_NEAR 0.9

/* Multipliers stay within this factor of mu / gap, either way (eq. 16). */
#define WB_MULTIPLIER_RANGE 1e10

/* Regularisation of the Hessian that is tried first, and beyond which a solve has failed; the next
 * one begins at the last one divided by the decrease, and grows by a factor; another where none was
 * needed before (algorithm IC). */
#define WB_FIRST_SHIFT 1e-4
#define WB_LARGEST_SHIFT 1e20
#define WB_SMALLEST_SHIFT 1e-20
#define WB_SHIFT_DECREASE 3.0
#define WB_SHIFT_GROWTH 8.0
#define WB_FIRST_GROWTH 100.0

/* Smallest pivots of inputs and level, and of own variables of slots, that count as positive. */
#define WB_SMALLEST_PIVOT 1e-10
#define WB_SMALLEST_OWN_PIVOT 1e-13

/* Regularisation of the equalities of slots, so that dependent ones do no harm. */
#define WB_EQUALITY_REGULARISATION 1e-10

/* Pairs that a filter holds. */
#define WB_FILTER_SIZE 200

/* Step lengths that a line search tries, each half of the one before; line searches without success
 * after which an instance is given up. */
#define WB_TRIALS 12
#define WB_FAILURES 8

/* Residuals, relative to the first, beyond which no step is accepted (eq. 21), and below which the
 * barrier function has to fall (eq. 19). */
#define WB_LARGEST_RESIDUAL 1e4
#define WB_SMALL_RESIDUAL 1e-4

/* gamma of eq. 18, eta of eq. 20, s_phi and s_theta of eq. 19. */
#define WB_MARGIN 1e-5
#define WB_ARMIJO 1e-8
#define WB_SLOPE_POWER 2.3
#define WB_RESIDUAL_POWER 1.1

/* Share of the distance within which a start leads to a known plan, for the whole Newton step. */
#define WB_SAME_TARGET 0.6

/* A start leads to a dearer plan where its cost will exceed the best by this share of 1 + |cost|,
 * and regions are entered by less than this, all steps together. On the recorded instances the best
 * plan is then that of full solves; with a share of 0.03 two of 420 lose up to 1 % of the cost, and
 * where it does not matter how far regions are entered four lose up to 40 %. */
#define WB_MUCH_DEARER 0.3
#define WB_HARDLY_ENTERED 0.5

/* A plan that enters regions by more than the slack has converged as well once so many Newton steps
 * in a row would change the barrier function by less than this share of it. The multipliers of such
 * regions are as large as the price, and their slacks t = h + eps smaller than the rounding errors
 * of h: the errors of stationarity stay a thousand times above the tolerance, while the plan moves
 * by 1e-13 m. */
#define WB_SETTLED_STEPS 2
#define WB_SETTLED_SLOPE 1e-9
#define WB_MUCH_SLACK 1e-4

/* Residual below which, and relative change of the barrier function within which, a step may do
 * nothing; relative rounding error of the barrier function. */
#define WB_STILL_RESIDUAL 1e-9
#define WB_STILL_CHANGE 1e-12
#define WB_ROUNDING 1e-13

#endif
