/* What stands between a controller in C and the solver's core: it fills in a problem from a path and
 * from Gaussian obstacles, and says in words what went wrong. The same file serves every problem;
 * what differs is in problem.c. C99 and libm. */
#include "problem.h"

#include <math.h>
#include <string.h>

enum { N = WIDEBERTH_HORIZON, D = WIDEBERTH_DIMENSION, NX = WIDEBERTH_STATES, NU = WIDEBERTH_INPUTS };

typedef const double (*points_of)[D];

static const char *const ERRORS[WIDEBERTH_ERRORS] = {
    "no error",
    "an argument is NULL",
    "the problem was not begun by wideberth_begin of this export: compile everything that includes "
    "the header again",
    "the memory is too small: give WIDEBERTH_MEMORY bytes",
    "there is no such kind, or no such slot of it",
    "a number is not finite, or larger than the solver calculates with",
    "this is no covariance: it has a negative eigenvalue, or is not symmetric",
    "the parameters of this kind have no closed form: fill them in as README.md says",
    "a path needs two different points at least",
};

static const char *const STATUSES[WIDEBERTH_STATUSES] = {
    "solved",
    "the limit of iterations was reached",
    "no plan keeps every region; this one enters them least",
    "the numbers did not lead to a plan",
    "stopped by the caller",
};

const char *wideberth_error_text(int error) {
    return error >= 0 && error < WIDEBERTH_ERRORS ? ERRORS[error] : "unknown error";
}

const char *wideberth_status_text(int status) {
    return status >= 0 && status < WIDEBERTH_STATUSES ? STATUSES[status] : "unknown status";
}

static int sound(const double *values, int count, double most) {
    for (int k = 0; k < count; k++)
        if (!(fabs(values[k]) <= most)) return 0;
    return 1;
}

static double within(double value, double lower, double upper) {
    return fmin(fmax(value, lower), upper);
}

/* Call a function for one column. */
static void column(wb_function *function, const double *v, const double *p, double *out) {
    const int64_t next = sizeof(double);
    function(NULL, 0, 1, v, next, p, next, out, next, NULL);
}

static int begun(const wideberth_problem *problem) { return problem->build == WIDEBERTH_BUILD; }

/* ---- Filling in a problem */

int wideberth_begin_as(wideberth_problem *problem, size_t size, uint64_t build) {
    wb_slots slots[WIDEBERTH_KINDS];
    if (!problem) return WIDEBERTH_NULL;
    if (size != sizeof *problem || build != WIDEBERTH_BUILD) return WIDEBERTH_OTHER_BUILD;
    memset(problem, 0, sizeof *problem);
    problem->build = WIDEBERTH_BUILD, problem->stop = NULL;
    problem->start_level = WIDEBERTH_START_LEVEL;
    wideberth_slots(problem, NULL, slots);
    for (int k = 0; k < WIDEBERTH_KINDS; k++) {
        const wb_kind *kind = wideberth_core.kind + k;
        for (int64_t at = 0; at < N * kind->slots; at++) {
            if (kind->levelled)
                ((double *)slots[k].level)[at] = wideberth_kinds[k].aim[at / kind->slots];
            if (kind->own)
                memcpy((double *)slots[k].drawn + at * kind->own, wideberth_kinds[k].begin,
                       (size_t)kind->own * sizeof(double));
        }
    }
    return WIDEBERTH_NO_ERROR;
}

static int is_covariance(const double *matrix) {
    for (int r = 0; r < D; r++) {
        const double here = matrix[r * D + r];
        if (!(here >= 0.0)) return 0;
        for (int c = 0; c < r; c++) {
            const double other = matrix[c * D + c], entry = matrix[r * D + c];
            const double rounding = 1e-9 * fmax(here, other);
            if (!(fabs(entry - matrix[c * D + r]) <= rounding)) return 0;
            if (!(entry * entry <= here * other + rounding * rounding)) return 0;
        }
    }
    return 1;
}

/* Find the numbers of the slots of a kind, if it has such a slot. */
static int find_slot(wideberth_problem *problem, int kind, int slot, wb_slots *found) {
    wb_slots slots[WIDEBERTH_KINDS];
    if (!begun(problem)) return WIDEBERTH_OTHER_BUILD;
    if (kind < 0 || kind >= WIDEBERTH_KINDS || slot < 0 || slot >= wideberth_core.kind[kind].slots)
        return WIDEBERTH_NO_SLOT;
    wideberth_slots(problem, NULL, slots);
    *found = slots[kind];
    return WIDEBERTH_NO_ERROR;
}

int wideberth_set(wideberth_problem *problem, int kind, int slot, points_of mean,
                  const double (*covariance)[D * D], double radius) {
    double gaussian[D + D * D + 1];
    wb_slots slots;
    if (!problem || !mean || !covariance) return WIDEBERTH_NULL;
    const int error = find_slot(problem, kind, slot, &slots);
    if (error) return error;
    if (!wideberth_kinds[kind].set) return WIDEBERTH_NO_CLOSED_FORM;
    if (!(radius >= 0.0 && radius <= WIDEBERTH_WIDEST)) return WIDEBERTH_NOT_FINITE;
    for (int i = 0; i < N; i++) {
        if (!sound(mean[i], D, WIDEBERTH_FARTHEST) ||
            !sound(covariance[i], D * D, WIDEBERTH_WIDEST * WIDEBERTH_WIDEST))
            return WIDEBERTH_NOT_FINITE;
        if (!is_covariance(covariance[i])) return WIDEBERTH_NOT_A_COVARIANCE;
    }
    for (int i = 0; i < N; i++) {
        const int64_t at = i * wideberth_core.kind[kind].slots + slot;
        memcpy(gaussian, mean[i], D * sizeof(double));
        memcpy(gaussian + D, covariance[i], D * D * sizeof(double));
        gaussian[D + D * D] = radius;
        column(wideberth_kinds[kind].set, gaussian, gaussian,
               (double *)slots.parameters + at * wideberth_core.kind[kind].parameters);
    }
    ((double *)slots.active)[slot] = 1.0;
    return WIDEBERTH_NO_ERROR;
}

int wideberth_clear(wideberth_problem *problem, int kind, int slot) {
    wb_slots slots;
    if (!problem) return WIDEBERTH_NULL;
    const int error = find_slot(problem, kind, slot, &slots);
    if (!error) ((double *)slots.active)[slot] = 0.0;
    return error;
}

static double distance(const double *from, const double *to) {
    double sum = 0.0;
    for (int d = 0; d < D; d++) sum += (to[d] - from[d]) * (to[d] - from[d]);
    return sqrt(sum);
}

/* Arc length of the path's point nearest to a place, within (low, high). */
static double nearest(points_of points, int count, const double *place, double low, double high) {
    double arc = 0.0, best = INFINITY, found = low;
    for (int k = 0; k + 1 < count; k++) {
        const double length = distance(points[k], points[k + 1]);
        if (length > 0.0 && arc <= high && arc + length >= low) {
            double along = 0.0, foot[D];
            for (int d = 0; d < D; d++)
                along += (place[d] - points[k][d]) * (points[k + 1][d] - points[k][d]) / length;
            along = fmin(fmax(along, fmax(low - arc, 0.0)), fmin(high - arc, length));
            for (int d = 0; d < D; d++)
                foot[d] = points[k][d] + along / length * (points[k + 1][d] - points[k][d]);
            if (distance(foot, place) < best) best = distance(foot, place), found = arc + along;
        }
        arc += length;
    }
    return found;
}

/* Place at an arc length, and the unit tangent there; beyond the path those of its end. */
static void walk(points_of points, int count, double arc, double *place, double *tangent) {
    for (int k = 0; k + 1 < count; k++) {
        const double length = distance(points[k], points[k + 1]);
        if (!(length > 0.0)) continue;
        for (int d = 0; d < D; d++) {
            tangent[d] = (points[k + 1][d] - points[k][d]) / length;
            place[d] = points[k][d] + within(arc, 0.0, length) * tangent[d];
        }
        if (arc < length) return;
        arc -= length;
    }
}

int wideberth_follow(wideberth_problem *problem, points_of points, int count, double speed,
                     double *arc) {
    double place[D], unused[D], length = 0.0, low = 0.0, high;
    if (!problem || !points || !arc) return WIDEBERTH_NULL;
    if (!begun(problem)) return WIDEBERTH_OTHER_BUILD;
    for (int k = 0; k < count; k++)
        if (!sound(points[k], D, WIDEBERTH_FARTHEST)) return WIDEBERTH_NOT_FINITE;
    for (int k = 0; k + 1 < count; k++) length += distance(points[k], points[k + 1]);
    if (!(length > 0.0)) return WIDEBERTH_BAD_PATH;
    if (!sound(problem->initial, NX, WIDEBERTH_FARTHEST) ||
        !(speed >= 0.0 && speed <= WIDEBERTH_FARTHEST))
        return WIDEBERTH_NOT_FINITE;
    column(wideberth_place, problem->initial, problem->initial, place);
    high = length;
    if (*arc >= 0.0) {
        low = fmax(*arc - 0.5, 0.0);
        high = fmin(*arc + 0.5 + speed * WIDEBERTH_DT * N, length);
    }
    *arc = nearest(points, count, place, low, high);
    double before = fmin(*arc, length);
    for (int i = 0; i < N; i++) {
        const double next = fmin(*arc + speed * WIDEBERTH_DT * (i + 1), length);
        walk(points, count, next, problem->reference[i], unused);
        walk(points, count, 0.5 * (next + before), unused, problem->direction[i]);
        problem->speed[i] = (next - before) / WIDEBERTH_DT;
        before = next;
    }
    return WIDEBERTH_NO_ERROR;
}

void wideberth_step(const double *state, const double *input, double *next) {
    double both[NX + NU];
    memcpy(both, state, NX * sizeof(double));
    memcpy(both + NX, input, NU * sizeof(double));
    column(wideberth_dynamics, both, both, next);
}

int wideberth_start(wideberth_problem *problem, const wideberth_result *last, double share) {
    if (!problem) return WIDEBERTH_NULL;
    if (!begun(problem)) return WIDEBERTH_OTHER_BUILD;
    if (!sound(problem->initial, NX, WIDEBERTH_FARTHEST)) return WIDEBERTH_NOT_FINITE;
    if (last && !(share >= 0.0 && share <= 1e6 && sound(last->inputs[0], N * NU, INFINITY)))
        return WIDEBERTH_NOT_FINITE;
    const int whole = last ? (int)(share + 1e-9) : N;
    const double part = fmax(share - whole, 0.0);
    memcpy(problem->start_states[0], problem->initial, sizeof problem->initial);
    for (int i = 0; i < N; i++) {
        const double *from = whole < N - i ? last->inputs[i + whole] : NULL;
        const double *after = whole < N - i - 1 ? last->inputs[i + whole + 1] : NULL;
        for (int r = 0; r < NU; r++)
            problem->start_inputs[i][r] =
                within((from ? (1.0 - part) * from[r] : 0.0) + (after ? part * after[r] : 0.0),
                       wideberth_core.lower[NX + r], wideberth_core.upper[NX + r]);
        wideberth_step(problem->start_states[i], problem->start_inputs[i],
                       problem->start_states[i + 1]);
    }
    return WIDEBERTH_NO_ERROR;
}

/* ---- Solving */

void wideberth_prepare(const wideberth_problem *problem, wideberth_result *result,
                       wideberth_task *task) {
    memset(task, 0, sizeof *task);
    memset(result, 0, sizeof *result);
    task->settings = wideberth_settings;
    task->settings.guess = problem->start_level;
    wideberth_slots(problem, result, task->slots);
    task->start.head = task->head[0], task->start.initial = problem->initial;
    task->start.states = task->states[0], task->start.inputs = problem->start_inputs[0];
    task->start.slots = task->slots;
    task->result.states = result->states[0], task->result.inputs = result->inputs[0];
    task->result.slack = result->slack;
    for (int i = 0; i < N; i++) {
        double *head = task->head[i];
        memcpy(head, problem->reference[i], D * sizeof(double));
        memcpy(head + D, problem->direction[i], D * sizeof(double));
        head[2 * D] = problem->speed[i];
#if WIDEBERTH_CURVE > 0
        memcpy(head + 2 * D + 1, problem->curve[i], sizeof problem->curve[i]);
#endif
    }
    memcpy(task->states, problem->start_states, sizeof task->states);
#if WIDEBERTH_HEADING >= 0
    const double turn = 2.0 * 3.14159265358979323846;
    const double off = task->states[0][WIDEBERTH_HEADING] - problem->initial[WIDEBERTH_HEADING];
    const double away = turn * rint(off / turn * (1.0 - 1e-9));
    for (int i = 0; away != 0.0 && fabs(away) < INFINITY && i <= N; i++)
        task->states[i][WIDEBERTH_HEADING] -= away;
#endif
}

int wideberth_run(const wideberth_problem *problem, wideberth_task *task, double *memory,
                  size_t size, wideberth_result *result) {
    if (size / sizeof(double) < (size_t)wb_size(&wideberth_core)) return WIDEBERTH_LITTLE_MEMORY;
    for (int k = 0; k < WIDEBERTH_KINDS; k++) { /* those of empty slots stay as they began */
        const wb_kind *kind = wideberth_core.kind + k;
        if (kind->slots * kind->own > 0)
            memcpy(task->slots[k].found, task->slots[k].begun,
                   (size_t)(N * kind->slots * kind->own) * sizeof(double));
    }
    wb_solve(&wideberth_core, &task->settings, &task->start, &task->result, problem->stop, memory);
    result->status = (int)task->result.status, result->iterations = (int)task->result.iterations;
    result->cost = task->result.cost, result->level = task->result.level;
    result->error = task->result.error;
#ifdef WIDEBERTH_PENALTY
    for (int i = 0; i < N; i++) result->cost += WIDEBERTH_PENALTY * result->slack[i];
    if (result->status == WIDEBERTH_INFEASIBLE) result->status = WIDEBERTH_SOLVED;
#endif
    return WIDEBERTH_NO_ERROR;
}

int wideberth_solve(const wideberth_problem *problem, void *memory, size_t size,
                    wideberth_result *result) {
    const size_t skip = (sizeof(double) - (uintptr_t)memory % sizeof(double)) % sizeof(double);
    const size_t used = skip + sizeof(wideberth_task);
    if (!problem || !memory || !result) return WIDEBERTH_NULL;
    if (!begun(problem)) return WIDEBERTH_OTHER_BUILD;
    if (size < used) return WIDEBERTH_LITTLE_MEMORY;
    wideberth_task *task = (void *)((unsigned char *)memory + skip);
    wideberth_prepare(problem, result, task);
    return wideberth_run(problem, task, (void *)(task + 1), size - used, result);
}

/* ---- Comparing a plan with its problem */

/* Largest of a violation so far, of the absolute values of the rows that shall be 0, and of how far
 * the others are below 0. NaN wins. */
static double worst_of(double worst, const double *rows, int count, int first, int last) {
    for (int r = 0; r < count; r++) {
        const double violation = r >= first && r < last ? fabs(rows[r]) : -rows[r];
        if (violation > worst || violation != violation) worst = violation;
    }
    return worst;
}

static double worst_of_slots(const wideberth_problem *problem, const wideberth_result *plan, int i,
                             double worst) {
    double v[WIDEBERTH_MOST_VARIABLES], p[WIDEBERTH_MOST_NUMBERS], rows[WIDEBERTH_MOST_ROWS];
    wb_slots slots[WIDEBERTH_KINDS];
    wideberth_slots(problem, plan, slots);
    for (int k = 0; k < WIDEBERTH_KINDS; k++) {
        const wb_kind *kind = wideberth_core.kind + k;
        for (int64_t j = 0; j < kind->slots; j++) {
            const int64_t at = i * kind->slots + j, own = kind->own;
            const int h = (int)kind->inequalities, all = h + (int)kind->equalities;
            double *next = p + kind->parameters;
            if (slots[k].active[j] == 0.0) continue;
            memcpy(v, plan->states[i + 1], NX * sizeof(double));
            if (own) memcpy(v + NX, slots[k].found + at * own, (size_t)own * sizeof(double));
            if (WIDEBERTH_SHARED_LEVEL) v[NX + own] = plan->level;
            memcpy(p, slots[k].parameters + at * kind->parameters,
                   (size_t)kind->parameters * sizeof(double));
            if (kind->levelled) *next++ = slots[k].level[at];
            *next++ = 1.0;
            for (int64_t r = 0; r < own; r++) next[r] = 0.0; /* a guess, which is not read */
            column(wideberth_kinds[k].check, v, p, rows);
            worst = worst_of(worst, rows, all, h, all);
        }
    }
    return worst;
}

double wideberth_violation(const wideberth_problem *problem, const wideberth_result *plan) {
    double v[2 * NX + NU], rows[WIDEBERTH_MOTION_ROWS + WIDEBERTH_FINAL_ROWS], worst = 0.0;
    if (!problem || !plan || !begun(problem)) return INFINITY;
    for (int r = 0; r < NX; r++) rows[r] = plan->states[0][r] - problem->initial[r];
    worst = worst_of(worst, rows, NX, 0, NX);
    for (int i = 0; i < N; i++) {
        memcpy(v, plan->states[i], NX * sizeof(double));
        memcpy(v + NX, plan->inputs[i], NU * sizeof(double));
        memcpy(v + NX + NU, plan->states[i + 1], NX * sizeof(double));
        column(wideberth_motion, v, v, rows);
        worst = worst_of(worst, rows, WIDEBERTH_MOTION_ROWS, 0, NX);
        worst = worst_of_slots(problem, plan, i, worst);
    }
#if WIDEBERTH_FINAL_ROWS > 0
    column(wideberth_final, plan->states[N], plan->states[N], rows);
    worst = worst_of(worst, rows, WIDEBERTH_FINAL_ROWS, 0, 0);
#endif
    return worst;
}
