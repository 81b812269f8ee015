/* {{ source }}: the planner's solver, without Python.
 *
 *   cc -O3 loop.c wideberth_solver.c problem.c riccati.c -lm
 *
 * Each period: wideberth_begin, initial, wideberth_follow, wideberth_set for every obstacle,
 * wideberth_start, wideberth_solve; result.inputs[0] drives the robot. All functions may be called
 * from several threads at once, each with memory, problem and result of its own. None allocates,
 * and none keeps a state between calls. SI units and radians.
 *
 * Of what the planner does in Python around its solver, this is here: the reference along a path,
 * parameters of slots from mean and covariance, the shifted last plan as the start, and how far a
 * plan breaks its constraints. Left to the caller are forecasts, the robot's own uncertainty (add
 * its covariance to every obstacle's), which obstacles get a slot, further starts, and what to do
 * where no plan was found. Made by wideberth; edit the config, not this file.
 */
#ifndef WIDEBERTH_SOLVER_H
#define WIDEBERTH_SOLVER_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Sizes. */
{% for one in sizes %}
{{ one|define }}
{% endfor %}

/* What each entry is. */
{% for one in entries %}
{{ one|define }}
{% endfor %}

/* What a solve takes, in bytes; limits. */
{% for one in needs %}
{{ one|define }}
{% endfor %}

/* Numbers of the planner. */
{% for name, value, text in numbers %}
{{ (name, value|number, text)|define }}
{% endfor %}

enum wideberth_error {
    WIDEBERTH_NO_ERROR,         /* nothing is wrong; how a solve ended, its status says */
    WIDEBERTH_NULL,             /* an argument is NULL */
    WIDEBERTH_OTHER_BUILD,      /* the caller was compiled with the header of another export */
    WIDEBERTH_LITTLE_MEMORY,    /* fewer bytes than WIDEBERTH_MEMORY */
    WIDEBERTH_NO_SLOT,          /* no such kind, or no such slot of it */
    WIDEBERTH_NOT_FINITE,       /* a number is not finite, or too large */
    WIDEBERTH_NOT_A_COVARIANCE, /* a matrix that no Gaussian has */
    WIDEBERTH_NO_CLOSED_FORM,   /* the caller has to fill in the parameters of this kind */
    WIDEBERTH_BAD_PATH,         /* a path without two different points */
    WIDEBERTH_ERRORS
};

enum wideberth_status {
    WIDEBERTH_SOLVED,     /* the plan is a local optimum */
    WIDEBERTH_LIMIT,      /* the limit of iterations was reached */
    WIDEBERTH_INFEASIBLE, /* no plan keeps every region; this one enters them least */
    WIDEBERTH_FAILED,     /* the numbers did not lead to a plan */
    WIDEBERTH_STOPPED,    /* *stop was set */
    WIDEBERTH_STATUSES
};
{% for one in slots %}
{% set upper = "WIDEBERTH_" ~ one.name|upper %}

typedef struct {
    double parameters[WIDEBERTH_HORIZON][{{ upper }}S][{{ upper }}_PARAMETERS]; /* of step i + 1, see wideberth_set */
{% if one.levelled %}
    double level[WIDEBERTH_HORIZON][{{ upper }}S]; /* larger keeps farther away; not read if shared */
{% endif %}
    double active[{{ upper }}S]; /* 1 where the slot is used, else 0 */
{% if one.auxiliary|length %}
    double auxiliaries[WIDEBERTH_HORIZON][{{ upper }}S][{{ upper }}_AUXILIARIES]; /* their start */
{% endif %}
} wideberth_{{ one.name }}s;
{% endfor %}

typedef struct {
    uint64_t build; /* set by wideberth_begin, as is all that is not given */
    const volatile int64_t *stop; /* a solve ends early once *stop is 1; or NULL */
    double initial[WIDEBERTH_STATES]; /* x_0 */
    double reference[WIDEBERTH_HORIZON][WIDEBERTH_DIMENSION]; /* m, at steps 1..N */
    double direction[WIDEBERTH_HORIZON][WIDEBERTH_DIMENSION]; /* unit tangents */
    double speed[WIDEBERTH_HORIZON]; /* m/s */
{% if curve %}
    double curve[WIDEBERTH_HORIZON][WIDEBERTH_CURVE]; /* the caller's, see README.md */
{% endif %}
    double start_states[WIDEBERTH_HORIZON + 1][WIDEBERTH_STATES]; /* first guess */
    double start_inputs[WIDEBERTH_HORIZON][WIDEBERTH_INPUTS];
    double start_level; /* of a shared level; else not read */
{% for one in slots %}
    wideberth_{{ one.name }}s {{ one.name }}s;
{% endfor %}
} wideberth_problem;

typedef struct {
    double states[WIDEBERTH_HORIZON + 1][WIDEBERTH_STATES];
    double inputs[WIDEBERTH_HORIZON][WIDEBERTH_INPUTS]; /* the first one drives */
    double slack[WIDEBERTH_HORIZON]; /* of the regions, 0 where they are kept */
{% for one in slots if one.auxiliary|length %}
{% set upper = "WIDEBERTH_" ~ one.name|upper %}
    double {{ one.name }}_auxiliaries[WIDEBERTH_HORIZON][{{ upper }}S][{{ upper }}_AUXILIARIES];
{% endfor %}
    double cost, level, error; /* the price of slack included; shared level; residual */
    int iterations, status; /* WIDEBERTH_SOLVED, ... */
} wideberth_result;

/* All of these return an error, WIDEBERTH_NO_ERROR if all is well; see wideberth_error_text. */

/* Make a problem empty: no slot in use, levels and own variables those of the planner. */
#define wideberth_begin(problem) \
    wideberth_begin_as((problem), sizeof(wideberth_problem), WIDEBERTH_BUILD)
int wideberth_begin_as(wideberth_problem *problem, size_t size, uint64_t build);

/* Lay reference, direction and speed along a path, from its point nearest to `initial`, at `speed`
 * m/s; the reference stops at the end. `*arc` in m is how far the robot has come: negative before
 * the first call, then what the last call left in it. */
int wideberth_follow(wideberth_problem *problem, const double (*points)[WIDEBERTH_DIMENSION],
    int count, double speed, double *arc);

/* Put a thing with Gaussian place into a slot, for the steps 1..N: mean in m, covariance in m^2
 * row by row, radius in m of the thing alone; the robot's radius and the planner's margin of
 * {{ margin }} m are added. `kind` is one of WIDEBERTH_KIND_... */
int wideberth_set(wideberth_problem *problem, int kind, int slot,
    const double (*mean)[WIDEBERTH_DIMENSION],
    const double (*covariance)[WIDEBERTH_DIMENSION * WIDEBERTH_DIMENSION], double radius);

/* Put a slot out of use. */
int wideberth_clear(wideberth_problem *problem, int kind, int slot);

/* Start from the last plan, seen `share` steps (period / WIDEBERTH_DT) later and driven from
 * `initial`; from zero inputs where `last` is NULL. */
int wideberth_start(wideberth_problem *problem, const wideberth_result *last, double share);

/* Solve. The `size` bytes at `memory` (WIDEBERTH_MEMORY, any alignment) are used until it returns.
 * May be called inside a signal handler that interrupted it, with other memory. */
int wideberth_solve(
    const wideberth_problem *problem, void *memory, size_t size, wideberth_result *result);

/* Largest violation of dynamics, limits and regions by a plan, each in its own unit. */
double wideberth_violation(const wideberth_problem *problem, const wideberth_result *plan);

/* The planner's robot after one step of WIDEBERTH_DT; `next` may be `state`. */
void wideberth_step(const double *state, const double *input, double *next);

/* Words; also for numbers that are no error or status. */
const char *wideberth_error_text(int error);
const char *wideberth_status_text(int status);

#ifdef __cplusplus
}
#endif

#endif
