/* What stands between a controller in C and the solver's object code: it fills in the arrays that
 * the solver reads, gives it memory of the caller's, and says in words what went wrong. The same
 * file serves every problem; what differs is in wideberth_tables.h. C99 and libm. */
#include "wideberth_solver.h"

#include <math.h>
#include <string.h>

#ifndef WIDEBERTH_FOR_THIS_PROCESSOR
#error "wideberth: these objects are for another processor; export again with --target"
#endif

typedef void wideberth_kernel(const void *self, int64_t offset, int64_t count, const double *v,
    int64_t v_row, const double *p, int64_t p_row, double *out, int64_t out_row);
/* For columns c < count: out[:, c] of v[:, offset + c] and p[:, c]; rows stand so many bytes apart.
 * The core knows a kernel by where its address stands, and hands that place on as self; the kernels
 * of an export do not look at it. */

struct kind {
    int count, parameters, auxiliaries, inequalities, equalities;
    size_t numbers, level, active, own, found; /* where they stand in problem and result */
    size_t begun;                              /* and what a planner says more */
    const double *aim, *begin;                 /* level of each step, start of own variables */
    wideberth_kernel *rows, *set;              /* NULL: the caller fills the parameters */
};

#define NOWHERE ((size_t)-1)

#ifdef WIDEBERTH_OF_A_PLANNER
#include "wideberth_more.h"
#define SHARED /* with the planner */
#else
typedef struct wideberth_more wideberth_more; /* a planner alone has more to say */
#define SHARED static
#endif

#include "wideberth_tables.h"

int wideberth_core(void *result, void *problem, int64_t *table);
extern const uint64_t wideberth_archive_build;

/* Memory of the running solve. One pointer per thread, set while wideberth_solve runs and put back
 * when it returns: the solver asks for memory as from malloc, which has no argument for it. */
struct arena {
    unsigned char *next;
    size_t left;
};

#if defined(__cplusplus) || __STDC_VERSION__ < 201112L
static __thread struct arena *running;
#else
static _Thread_local struct arena *running;
#endif

void *wideberth_take(size_t size);
void wideberth_give(void *block);

void *wideberth_take(size_t size)
{
    const size_t whole = (size + 15) & ~(size_t)15;
    void *found;
    if (!running || whole < size || whole > running->left) return NULL;
    found = running->next;
    running->next += whole;
    running->left -= whole;
    return found;
}

void wideberth_give(void *block)
{
    (void)block; /* all of it is free when the solve ends */
}

#if defined(__GNUC__) && defined(__x86_64__)
static int processor_lacks(void)
{
    __builtin_cpu_init();
    return !(WIDEBERTH_NEEDS(__builtin_cpu_supports));
}
#else
static int processor_lacks(void)
{
    return 0;
}
#endif

/* ---- Small things */

static const char *const TEXTS[WIDEBERTH_ERRORS] = {
    "no error",
    "an argument is NULL",
    "header, wideberth_solver.c and archive are not of one export, or the problem was not begun "
    "by wideberth_begin: take all files of one folder, and compile everything that includes the "
    "header again",
    "this processor lacks instructions that the object code was made with: export again on it, "
    "or with --target linux-x86_64-v3",
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
    "no plan keeps every region; this one enters them least, as far as was found",
    "the numbers did not lead to a plan",
    "stopped by the caller",
};

const char *wideberth_error_text(int error)
{
    return error >= 0 && error < WIDEBERTH_ERRORS ? TEXTS[error] : "unknown error";
}

const char *wideberth_status_text(int status)
{
    return status >= 0 && status < WIDEBERTH_STATUSES ? STATUSES[status] : "unknown status";
}

static int sound(const double *values, size_t count, double most)
{
    size_t k;
    for (k = 0; k < count; k++)
        if (!(fabs(values[k]) <= most)) return 0;
    return 1;
}

static double *inside(wideberth_problem *problem, size_t place)
{
    return (double *)(void *)((unsigned char *)problem + place);
}

static const double *seen(const void *value, size_t place)
{
    return (const double *)(const void *)((const unsigned char *)value + place);
}

static void column(wideberth_kernel *kernel, const double *v, const double *p, double *out)
{
    kernel(NULL, 0, 1, v, sizeof(double), p, sizeof(double), out, sizeof(double));
}

static int begun(const wideberth_problem *problem)
{
    return problem->build == WIDEBERTH_BUILD && wideberth_archive_build == WIDEBERTH_BUILD;
}

/* ---- Filling in a problem */

int wideberth_begin_as(wideberth_problem *problem, size_t size, uint64_t build)
{
    int k, i, j, a;
    if (!problem) return WIDEBERTH_NULL;
    if (size != sizeof(*problem) || build != WIDEBERTH_BUILD) return WIDEBERTH_OTHER_BUILD;
    memset(problem, 0, sizeof(*problem));
    problem->build = WIDEBERTH_BUILD;
    problem->stop = NULL;
    problem->start_level = WIDEBERTH_START_LEVEL;
    for (k = 0; k < WIDEBERTH_KINDS; k++) {
        const struct kind *kind = &KINDS[k];
        for (i = 0; i < WIDEBERTH_HORIZON; i++) {
            for (j = 0; j < kind->count; j++) {
                const int slot = i * kind->count + j;
                if (kind->level != NOWHERE) inside(problem, kind->level)[slot] = kind->aim[i];
                for (a = 0; a < kind->auxiliaries; a++)
                    inside(problem, kind->own)[slot * kind->auxiliaries + a] = kind->begin[a];
            }
        }
    }
    return begun(problem) ? WIDEBERTH_NO_ERROR : WIDEBERTH_OTHER_BUILD;
}

static int covariance_like(const double *given)
{
    int r, c;
    for (r = 0; r < WIDEBERTH_DIMENSION; r++) {
        const double here = given[r * WIDEBERTH_DIMENSION + r];
        if (!(here >= 0.0)) return 0;
        for (c = 0; c < r; c++) {
            const double other = given[c * WIDEBERTH_DIMENSION + c];
            const double one = given[r * WIDEBERTH_DIMENSION + c];
            const double room = 1e-9 * (here > other ? here : other);
            if (!(fabs(one - given[c * WIDEBERTH_DIMENSION + r]) <= room)) return 0;
            if (!(one * one <= here * other + room * room)) return 0;
        }
    }
    return 1;
}

int wideberth_set(wideberth_problem *problem, int kind, int slot,
    const double (*mean)[WIDEBERTH_DIMENSION],
    const double (*covariance)[WIDEBERTH_DIMENSION * WIDEBERTH_DIMENSION], double radius)
{
    enum { D = WIDEBERTH_DIMENSION, ALL = D + D * D + 1 };
    const struct kind *one;
    double given[ALL];
    int i;
    if (!problem || !mean || !covariance) return WIDEBERTH_NULL;
    if (!begun(problem)) return WIDEBERTH_OTHER_BUILD;
    if (kind < 0 || kind >= WIDEBERTH_KINDS || slot < 0 || slot >= KINDS[kind].count)
        return WIDEBERTH_NO_SLOT;
    one = &KINDS[kind];
    if (!one->set) return WIDEBERTH_NO_CLOSED_FORM;
    if (!(radius >= 0.0 && radius <= WIDEBERTH_WIDEST)) return WIDEBERTH_NOT_FINITE;
    for (i = 0; i < WIDEBERTH_HORIZON; i++) {
        if (!sound(mean[i], D, WIDEBERTH_FARTHEST)
            || !sound(covariance[i], D * D, WIDEBERTH_WIDEST * WIDEBERTH_WIDEST))
            return WIDEBERTH_NOT_FINITE;
        if (!covariance_like(covariance[i])) return WIDEBERTH_NOT_A_COVARIANCE;
    }
    for (i = 0; i < WIDEBERTH_HORIZON; i++) {
        double *numbers = inside(problem, one->numbers);
        memcpy(given, mean[i], D * sizeof(double));
        memcpy(given + D, covariance[i], D * D * sizeof(double));
        given[ALL - 1] = radius;
        column(one->set, given, given, numbers + (i * one->count + slot) * one->parameters);
    }
    inside(problem, one->active)[slot] = 1.0;
    return WIDEBERTH_NO_ERROR;
}

int wideberth_clear(wideberth_problem *problem, int kind, int slot)
{
    if (!problem) return WIDEBERTH_NULL;
    if (!begun(problem)) return WIDEBERTH_OTHER_BUILD;
    if (kind < 0 || kind >= WIDEBERTH_KINDS || slot < 0 || slot >= KINDS[kind].count)
        return WIDEBERTH_NO_SLOT;
    inside(problem, KINDS[kind].active)[slot] = 0.0;
    return WIDEBERTH_NO_ERROR;
}

static double length_of(const double *from, const double *to)
{
    double sum = 0.0;
    int d;
    for (d = 0; d < WIDEBERTH_DIMENSION; d++) sum += (to[d] - from[d]) * (to[d] - from[d]);
    return sqrt(sum);
}

/* Arc length of the path's point nearest to a place, within (low, high). */
static double nearest(const double (*points)[WIDEBERTH_DIMENSION], int count, const double *place,
    double low, double high)
{
    double arc = 0.0, best = INFINITY, found = low;
    int k, d;
    for (k = 0; k + 1 < count; k++) {
        const double length = length_of(points[k], points[k + 1]);
        double along = 0.0, foot[WIDEBERTH_DIMENSION], away;
        if (length > 0.0 && arc <= high && arc + length >= low) {
            for (d = 0; d < WIDEBERTH_DIMENSION; d++)
                along += (place[d] - points[k][d]) * (points[k + 1][d] - points[k][d]) / length;
            along = fmin(fmax(along, fmax(low - arc, 0.0)), fmin(high - arc, length));
            for (d = 0; d < WIDEBERTH_DIMENSION; d++)
                foot[d] = points[k][d] + along / length * (points[k + 1][d] - points[k][d]);
            away = length_of(foot, place);
            if (away < best) best = away, found = arc + along;
        }
        arc += length;
    }
    return found;
}

/* Place at an arc length, and the unit tangent there; either may be NULL. */
static void walk(const double (*points)[WIDEBERTH_DIMENSION], int count, double arc, double *place,
    double *tangent)
{
    double passed = 0.0;
    int k, d, last = 0;
    for (k = 0; k + 1 < count; k++)
        if (length_of(points[k], points[k + 1]) > 0.0) last = k;
    for (k = 0; k <= last; k++) {
        const double length = length_of(points[k], points[k + 1]);
        if (length > 0.0 && (arc < passed + length || k == last)) {
            const double share = fmin(fmax((arc - passed) / length, 0.0), 1.0);
            for (d = 0; d < WIDEBERTH_DIMENSION; d++) {
                const double way = points[k + 1][d] - points[k][d];
                if (place) place[d] = points[k][d] + share * way;
                if (tangent) tangent[d] = way / length;
            }
            return;
        }
        passed += length;
    }
}

int wideberth_follow(wideberth_problem *problem, const double (*points)[WIDEBERTH_DIMENSION],
    int count, double speed, double *arc)
{
    double place[WIDEBERTH_DIMENSION], length = 0.0, before;
    int i, k;
    if (!problem || !points || !arc) return WIDEBERTH_NULL;
    if (!begun(problem)) return WIDEBERTH_OTHER_BUILD;
    for (k = 0; k < count; k++)
        if (!sound(points[k], WIDEBERTH_DIMENSION, WIDEBERTH_FARTHEST)) return WIDEBERTH_NOT_FINITE;
    for (k = 0; k + 1 < count; k++) length += length_of(points[k], points[k + 1]);
    if (!(length > 0.0)) return WIDEBERTH_BAD_PATH;
    if (!sound(problem->initial, WIDEBERTH_STATES, WIDEBERTH_FARTHEST)
        || !(speed >= 0.0 && speed <= WIDEBERTH_FARTHEST))
        return WIDEBERTH_NOT_FINITE;
    column(wideberth_kernel_place, problem->initial, problem->initial, place);
    if (*arc < 0.0) {
        *arc = nearest(points, count, place, 0.0, length);
    } else {
        const double reach = 0.5 + speed * WIDEBERTH_DT * WIDEBERTH_HORIZON;
        *arc = nearest(points, count, place, fmax(*arc - 0.5, 0.0), fmin(*arc + reach, length));
    }
    before = fmin(*arc, length);
    for (i = 0; i < WIDEBERTH_HORIZON; i++) {
        const double next = fmin(*arc + speed * WIDEBERTH_DT * (i + 1), length);
        walk(points, count, next, problem->reference[i], NULL);
        walk(points, count, 0.5 * (next + before), NULL, problem->direction[i]);
        problem->speed[i] = (next - before) / WIDEBERTH_DT;
        before = next;
    }
    return WIDEBERTH_NO_ERROR;
}

void wideberth_step(const double *state, const double *input, double *next)
{
    double given[WIDEBERTH_STATES + WIDEBERTH_INPUTS], found[WIDEBERTH_STATES];
    memcpy(given, state, WIDEBERTH_STATES * sizeof(double));
    memcpy(given + WIDEBERTH_STATES, input, WIDEBERTH_INPUTS * sizeof(double));
    column(wideberth_kernel_step, given, given, found);
    memcpy(next, found, sizeof(found));
}

int wideberth_start(wideberth_problem *problem, const wideberth_result *last, double share)
{
    int i, r;
    if (!problem) return WIDEBERTH_NULL;
    if (!begun(problem)) return WIDEBERTH_OTHER_BUILD;
    if (!sound(problem->initial, WIDEBERTH_STATES, WIDEBERTH_FARTHEST)
        || (last && !(share >= 0.0 && share <= 1e6)))
        return WIDEBERTH_NOT_FINITE;
    if (last && !sound(&last->inputs[0][0], WIDEBERTH_HORIZON * WIDEBERTH_INPUTS, INFINITY))
        return WIDEBERTH_NOT_FINITE;
    memcpy(problem->start_states[0], problem->initial, sizeof(problem->initial));
    for (i = 0; i < WIDEBERTH_HORIZON; i++) {
        const int from = last && share < WIDEBERTH_HORIZON ? i + (int)(share + 1e-9) : i;
        const double part = last ? fmax(share - (int)(share + 1e-9), 0.0) : 0.0;
        for (r = 0; r < WIDEBERTH_INPUTS; r++) {
            double value = 0.0;
            if (last && share < WIDEBERTH_HORIZON && from < WIDEBERTH_HORIZON) {
                const double after
                    = from + 1 < WIDEBERTH_HORIZON ? last->inputs[from + 1][r] : 0.0;
                value = (1.0 - part) * last->inputs[from][r] + part * after;
            }
            value = fmin(fmax(value, LIMITS[0][WIDEBERTH_STATES + r]),
                LIMITS[1][WIDEBERTH_STATES + r]);
            problem->start_inputs[i][r] = value;
        }
        wideberth_step(problem->start_states[i], problem->start_inputs[i],
            problem->start_states[i + 1]);
    }
    return WIDEBERTH_NO_ERROR;
}

/* ---- Solving */

/* Guessed states, shifted by full turns until the heading is within half a turn of x_0's. */
static void unwrap(const wideberth_problem *problem, double (*states)[WIDEBERTH_STATES])
{
    memcpy(states, problem->start_states, sizeof(problem->start_states));
#if WIDEBERTH_HEADING >= 0
    {
        const double pi = 3.14159265358979323846;
        const double off = states[0][WIDEBERTH_HEADING] - problem->initial[WIDEBERTH_HEADING];
        const double turns = rint(off / (2.0 * pi) * (1.0 - 1e-9));
        if (turns != 0.0 && fabs(turns) < INFINITY) {
            const volatile double away = 2.0 * pi * turns; /* rounded on its own */
            int i;
            for (i = 0; i <= WIDEBERTH_HORIZON; i++) states[i][WIDEBERTH_HEADING] -= away;
        }
    }
#endif
}

static int64_t *row_of(int64_t *row, const volatile void *data, int64_t a, int64_t b, int64_t c)
{
    row[0] = (int64_t)(intptr_t)data;
    row[1] = a, row[2] = b, row[3] = c;
    return row + 4;
}

/* Where own variables of a kind begin: at what they are drawn to, unless a planner says more. */
#ifdef WIDEBERTH_OF_A_PLANNER
#define BEGUN(problem, more, k) seen(more, KINDS[k].begun)
#else
#define BEGUN(problem, more, k) seen(problem, KINDS[k].own)
#endif

#define ROW(data, a, b, c) (row = row_of(row, (data), (a), (b), (c)))

static void describe(const wideberth_problem *problem, wideberth_more *more, struct work *work,
    wideberth_result *result)
{
    int64_t *row = work->table;
    int k;
    for (k = 0; k < WIDEBERTH_PLAIN_KERNELS; k++)
        work->kernels[k] = (int64_t)(intptr_t)&PLAIN_KERNELS[k];
    for (k = 0; k < WIDEBERTH_SLOT_KERNELS; k++)
        work->slot_kernels[k] = (int64_t)(intptr_t)&SLOT_KERNELS[k];
    memcpy(work->settings, SETTINGS, sizeof(SETTINGS));
    work->settings[WIDEBERTH_SETTING_GUESS] = problem->start_level;
#ifdef WIDEBERTH_OF_A_PLANNER
    if (more->warm > 0.0) {
        work->settings[WIDEBERTH_SETTING_WARM] = 1.0;
        work->settings[WIDEBERTH_SETTING_PUSH] = WIDEBERTH_WARM_PUSH;
        work->settings[WIDEBERTH_SETTING_TEST] = WIDEBERTH_WARM_TEST;
    }
    work->settings[WIDEBERTH_SETTING_PLANS] = more->known;
    work->settings[WIDEBERTH_SETTING_BEST] = more->best;
    work->settings[WIDEBERTH_SETTING_WITHIN] = more->within;
    work->settings[WIDEBERTH_SETTING_ITERATIONS] = more->iterations;
#else
    (void)more;
#endif
    unwrap(problem, work->states);
    WIDEBERTH_ROWS
    (void)row;
}

/* Sum as NumPy does it, which adds eight at a time. */
SHARED double wideberth_sum(const double *values, int count)
{
    double parts[8], sum;
    int i, k;
    if (count > 128) {
        const int half = count / 2 - count / 2 % 8;
        return wideberth_sum(values, half) + wideberth_sum(values + half, count - half);
    }
    if (count < 8) {
        sum = 0.0;
        for (i = 0; i < count; i++) sum += values[i];
        return sum;
    }
    memcpy(parts, values, sizeof(parts));
    for (i = 8; i < count - count % 8; i += 8)
        for (k = 0; k < 8; k++) parts[k] += values[i + k];
    sum = ((parts[0] + parts[1]) + (parts[2] + parts[3]))
        + ((parts[4] + parts[5]) + (parts[6] + parts[7]));
    for (; i < count; i++) sum += values[i];
    return sum;
}

static int solve(const wideberth_problem *problem, wideberth_more *more, void *memory, size_t size,
    wideberth_result *result)
{
    struct arena arena, *const outer = running;
    struct work *work;
    unsigned char *begin = (unsigned char *)memory;
    void *unused = NULL, *nothing = NULL;
    size_t skip;
    int failed, k;
    if (!problem || !memory || !result) return WIDEBERTH_NULL;
    if (!begun(problem)) return WIDEBERTH_OTHER_BUILD;
    if (processor_lacks()) return WIDEBERTH_OTHER_PROCESSOR;
    skip = (16 - (uintptr_t)memory % 16) % 16;
    if (size < skip + WIDEBERTH_WORK) return WIDEBERTH_LITTLE_MEMORY;
    work = (struct work *)(void *)(begin + skip);
    memset(work, 0, sizeof(*work));
    memset(result, 0, sizeof(*result));
    describe(problem, more, work, result);
    for (k = 0; k < WIDEBERTH_KINDS; k++) { /* own variables of empty slots stay as they began */
        const size_t own = sizeof(double) * (size_t)(KINDS[k].count * KINDS[k].auxiliaries);
        if (KINDS[k].found != NOWHERE)
            memcpy((unsigned char *)result + KINDS[k].found, BEGUN(problem, more, k),
                WIDEBERTH_HORIZON * own);
    }
    arena.next = begin + skip + WIDEBERTH_WORK;
    arena.left = size - skip - WIDEBERTH_WORK;
    running = &arena;
    failed = wideberth_core(&unused, &nothing, work->table);
    running = outer;
    if (failed) return WIDEBERTH_LITTLE_MEMORY;
    result->status = (int)work->numbers[WIDEBERTH_NUMBER_STATUS];
    result->iterations = (int)work->numbers[WIDEBERTH_NUMBER_ITERATIONS];
    result->cost = work->numbers[WIDEBERTH_NUMBER_COST];
    result->level = work->numbers[WIDEBERTH_NUMBER_LEVEL];
    result->error = work->numbers[WIDEBERTH_NUMBER_ERROR];
#ifdef WIDEBERTH_OF_A_PLANNER
    more->outcome = result->status;
#endif
#ifdef WIDEBERTH_PENALTY
    {
        const volatile double paid = WIDEBERTH_PENALTY * wideberth_sum(result->slack, WIDEBERTH_HORIZON);
        result->cost += paid;
        if (result->status == WIDEBERTH_INFEASIBLE) result->status = WIDEBERTH_SOLVED;
    }
#else
    (void)wideberth_sum;
#endif
    return WIDEBERTH_NO_ERROR;
}

#ifdef WIDEBERTH_OF_A_PLANNER

int wideberth_solve_more(const wideberth_problem *problem, wideberth_more *more, void *memory,
    size_t size, wideberth_result *result)
{
    return more ? solve(problem, more, memory, size, result) : WIDEBERTH_NULL;
}

#else

int wideberth_solve(
    const wideberth_problem *problem, void *memory, size_t size, wideberth_result *result)
{
    return solve(problem, NULL, memory, size, result);
}

/* ---- Holding a plan against its problem */

static double larger(double worst, double one)
{
    return one <= worst ? worst : one; /* also what is not a number */
}

#if WIDEBERTH_ANY_SLOTS
static double of_slots(
    const wideberth_problem *problem, const wideberth_result *plan, int i, double worst)
{
    double v[WIDEBERTH_MOST_GIVEN], p[WIDEBERTH_MOST_NUMBERS], rows[WIDEBERTH_MOST_ROWS];
    int k, j, r;
    for (k = 0; k < WIDEBERTH_KINDS; k++) {
        const struct kind *kind = &KINDS[k];
        for (j = 0; j < kind->count; j++) {
            const int slot = i * kind->count + j, own = kind->auxiliaries;
            double *to = p + kind->parameters;
            if (!kind->rows || seen(problem, kind->active)[j] == 0.0) continue;
            memcpy(v, plan->states[i + 1], sizeof(plan->states[0]));
            if (WIDEBERTH_SHARED_LEVEL) v[WIDEBERTH_STATES] = plan->level;
            if (own)
                memcpy(v + WIDEBERTH_STATES + WIDEBERTH_SHARED_LEVEL,
                    seen(plan, kind->found) + slot * own, (size_t)own * sizeof(double));
            memcpy(p, seen(problem, kind->numbers) + slot * kind->parameters,
                (size_t)kind->parameters * sizeof(double));
            if (kind->level != NOWHERE) *to++ = seen(problem, kind->level)[slot];
            *to++ = 1.0;
            for (r = 0; r < own; r++) to[r] = 0.0; /* a guess, which the rows do not read */
            column(kind->rows, v, p, rows);
            for (r = 0; r < kind->inequalities; r++) worst = larger(worst, -rows[r]);
            for (r = 0; r < kind->equalities; r++)
                worst = larger(worst, fabs(rows[kind->inequalities + r]));
        }
    }
    return worst;
}
#endif

double wideberth_violation(const wideberth_problem *problem, const wideberth_result *plan)
{
    double v[2 * WIDEBERTH_STATES + WIDEBERTH_INPUTS], rows[WIDEBERTH_MOTION_ROWS];
    double worst = 0.0;
    int i, r;
    if (!problem || !plan || !begun(problem)) return INFINITY;
    for (r = 0; r < WIDEBERTH_STATES; r++)
        worst = larger(worst, fabs(plan->states[0][r] - problem->initial[r]));
    for (i = 0; i < WIDEBERTH_HORIZON; i++) {
        const double *state = plan->states[i + 1], *input = plan->inputs[i];
        memcpy(v, plan->states[i], sizeof(plan->states[0]));
        memcpy(v + WIDEBERTH_STATES, input, sizeof(plan->inputs[0]));
        memcpy(v + WIDEBERTH_STATES + WIDEBERTH_INPUTS, state, sizeof(plan->states[0]));
        column(wideberth_kernel_motion, v, v, rows);
        for (r = 0; r < WIDEBERTH_MOTION_ROWS; r++)
            worst = larger(worst, r < WIDEBERTH_STATES ? fabs(rows[r]) : -rows[r]);
        for (r = 0; r < WIDEBERTH_STATES + WIDEBERTH_INPUTS; r++) {
            const double one = r < WIDEBERTH_STATES ? state[r] : input[r - WIDEBERTH_STATES];
            worst = larger(worst, LIMITS[0][r] - one);
            worst = larger(worst, one - LIMITS[1][r]);
        }
#if WIDEBERTH_ANY_SLOTS
        worst = of_slots(problem, plan, i, worst);
#endif
    }
#if WIDEBERTH_FINAL_ROWS > 0
    {
        double last[WIDEBERTH_FINAL_ROWS];
        column(wideberth_kernel_final, plan->states[WIDEBERTH_HORIZON],
            plan->states[WIDEBERTH_HORIZON], last);
        for (r = 0; r < WIDEBERTH_FINAL_ROWS; r++) worst = larger(worst, -last[r]);
    }
#endif
    return worst;
}

#endif
