/* Solving from several starting points, and the rungs of what is driven where a solve fails. What
 * multistart and rungs do in Python. */
#include "planner_parts.h"

#include <math.h>
#include <string.h>

#define GIVEN_UP 100         /* a status beside those of the solver */

static int feasible(const struct candidate *one)
{
    return wb_worst(&one->found) <= TOLERANCE;
}

static int optimal(const struct candidate *one)
{
    return one->solved && one->status == WIDEBERTH_SOLVED && feasible(one);
}

static double deepest_slack(const struct point *point)
{
    double worst = 0.0;
    int i;
    for (i = 0; i < N; i++) worst = fmax(worst, point->slack[i]);
    return worst;
}

/* Whether a plan that its solver calls solved does not pass the verification. */
static int refuted(const struct candidate *one)
{
    return one->status == WIDEBERTH_SOLVED && !feasible(one);
}

static int enters(const struct instance *instance, const struct candidate *one)
{
    return deepest_slack(&one->point) > TOLERANCE && !instance->polygons;
}

/* ---- One solve */

struct others { /* plans that a solve is compared with */
    int count;
    double best, fewest;
};

static void add(struct others *others, struct given *given, const struct candidate *one)
{
    if (one->status != WIDEBERTH_SOLVED) return;
    if (others->count < PLAN_MOST_PLANS)
        memcpy(given->plans[others->count++], one->point.states, sizeof(given->plans[0]));
    others->fewest = fmin(others->fewest, one->iterations);
    if (!(deepest_slack(&one->point) > TOLERANCE)) others->best = fmin(others->best, one->cost);
}

static double patience(const struct others *others)
{
    return fmax(fmax(PLAN_PATIENT_ITERATIONS, PLAN_PATIENT_PER_STEP * N), PLAN_PATIENT_SHARE * others->fewest);
}

/* Hand the arrays of multipliers and plans to the solver. */
static void give(struct given *given, const struct point *guess, wideberth_task *task)
{
    task->start.multipliers = given->steps_before[0], task->start.plans = given->plans[0][0];
    task->result.multipliers = given->steps_after[0];
    task->slots[WIDEBERTH_KIND_OBSTACLE].before = given->obstacles_before[0][0];
    task->slots[WIDEBERTH_KIND_OBSTACLE].after = given->obstacles_after[0][0];
#if WIDEBERTH_POLYGONS > 0
    task->slots[WIDEBERTH_KIND_POLYGON].before = given->polygons_before[0][0];
    task->slots[WIDEBERTH_KIND_POLYGON].after = given->polygons_after[0][0];
    task->slots[WIDEBERTH_KIND_POLYGON].begun = guess->own[0][0];
#else
    (void)guess;
#endif
}

static void run(struct wideberth_planner *planner, const struct point *guess, int warm,
    const struct others *others)
{
    struct scratch *scratch = &planner->scratch;
    wideberth_problem *problem = &planner->instance.problem;
    wideberth_task *task = &scratch->task;
    memcpy(problem->start_states, guess->states, sizeof(problem->start_states));
    memcpy(problem->start_inputs, guess->inputs, sizeof(problem->start_inputs));
    problem->start_level = guess->level;
    wideberth_prepare(problem, &scratch->result, task);
    give(&scratch->given, guess, task);
    if (warm) {
        task->settings.warm = 1.0;
        task->settings.push = PLAN_WARM_DISTANCE, task->settings.test = PLAN_WARM_TEST;
    }
    if (others) {
        task->settings.plans = others->count, task->settings.best = others->best;
        task->settings.within = PLAN_SAME_PLAN * PLAN_RADIUS;
        task->settings.iterations = fmin(task->settings.iterations, floor(patience(others)));
    }
    wideberth_run(problem, task, scratch->memory, sizeof(scratch->memory), &scratch->result);
}

static int given_up(const wideberth_task *task)
{
    return task->result.status == WB_SAME || task->result.status == WB_DEARER;
}

static int failed(const struct scratch *scratch)
{
    return !given_up(&scratch->task) && scratch->result.status != WIDEBERTH_SOLVED
        && scratch->result.status != WIDEBERTH_STOPPED;
}

/* Solve from one start; those that lead to no cheaper plan are given up unless `others` is NULL. */
static void solve(struct wideberth_planner *planner, const struct point *guess, int warm,
    const struct others *others, struct candidate *found)
{
    struct scratch *scratch = &planner->scratch;
    const wideberth_result *result = &scratch->result;
    const int64_t *status = &scratch->task.result.status;
    int before = 0;
    run(planner, guess, warm, others);
    if (warm && failed(scratch)) {
        before = result->iterations;
        run(planner, guess, 0, others);
    }
    found->solved = 1, found->way = -1;
    found->iterations = before + result->iterations;
    planner->outcome.iterations += found->iterations;
    found->cost = result->cost, found->status = result->status;
    found->multipliers = 0;
    if (given_up(&scratch->task)
        || (*status == WB_LIMIT && others && patience(others) < WIDEBERTH_ITERATIONS)) {
        found->status = GIVEN_UP;
        return;
    }
    memcpy(found->point.states, result->states, sizeof(found->point.states));
    memcpy(found->point.inputs, result->inputs, sizeof(found->point.inputs));
    memcpy(found->point.slack, result->slack, sizeof(found->point.slack));
    found->point.level = WIDEBERTH_SHARED_LEVEL ? result->level : NAN;
#if WIDEBERTH_POLYGONS > 0
    memcpy(found->point.own, result->polygon_auxiliaries, sizeof(found->point.own));
#endif
    if (*status != WB_SOLVED) return;
    found->multipliers = 1;
    memcpy(found->steps, scratch->given.steps_after, sizeof(found->steps));
    memcpy(found->slots, scratch->given.obstacles_after, sizeof(found->slots));
}

/* Whether regions press on the plan that was solved last. */
static int pressed(const struct wideberth_planner *planner, const struct candidate *one)
{
    const struct instance *instance = &planner->instance;
    double force = 0.0;
    int i, k, c;
    if (one->status != WIDEBERTH_SOLVED || !one->multipliers) return 1;
    for (i = 0; i < N; i++) {
        for (k = 0; k < instance->obstacles; k++)
            for (c = 0; c < PLAN_OBSTACLE_MULTIPLIERS; c++)
                force += fabs(one->slots[i][k][c]);
#if WIDEBERTH_POLYGONS > 0
        for (k = 0; k < instance->polygons; k++)
            for (c = 0; c < PLAN_POLYGON_MULTIPLIERS; c++) {
                const double value = planner->scratch.given.polygons_after[i][k][c];
                if (value == value) force += fabs(value);
            }
#endif
    }
    return !(force <= PLAN_NO_FORCE * (1.0 + fabs(one->cost)));
}

/* Verify a solution; one that did not converge is first made drivable. */
static void assess(struct wideberth_planner *planner, struct candidate *one)
{
    const struct instance *instance = &planner->instance;
    struct point *point = &one->point;
    if (WIDEBERTH_SHARED_LEVEL && point->level < PLAN_MINIMUM) point->level = PLAN_MINIMUM;
    if (one->status != WIDEBERTH_SOLVED) {
        wb_clip_inputs(point->inputs);
        wb_follow(instance->problem.initial, point->inputs, point->states);
        wb_suit(instance, point);
    }
    wb_verify(planner, point, NULL, &one->found);
    if (one->status != WIDEBERTH_SOLVED && feasible(one)) one->cost = wb_price(instance, point);
}

/* ---- Several starts */

/* Mean of the levels of all slots in use. */
static double asked(const struct instance *instance)
{
    return instance->obstacles ? PLAN_LEVELS[0] : 0.0;
}

static int stuck(const struct instance *instance, const struct candidate *one)
{
    double begin[3], end[3];
    const double *last = instance->problem.reference[N - 1];
    wb_pose(one->point.states[0], begin);
    wb_pose(one->point.states[N], end);
    return hypot(end[0] - begin[0], end[1] - begin[1])
        < PLAN_STUCK * hypot(last[0] - begin[0], last[1] - begin[1]);
}

static int gives_way_far(const struct instance *instance, const struct candidate *one)
{
    const double lowest = fmax(PLAN_MINIMUM, 0.0), most = PLAN_DEEP * (asked(instance) - lowest);
    return WIDEBERTH_SHARED_LEVEL && asked(instance) - one->point.level > most && most > 0.0;
}

/* Whether something stands on the reference, or makes the level give way. */
static int in_the_way(struct wideberth_planner *planner, const struct candidate *one,
    const struct point *laid)
{
    const struct instance *instance = &planner->instance;
    struct violation *entered = &planner->scratch.entered;
    int i, k;
    if (!instance->obstacles && !instance->polygons) return 0;
    wb_entered(instance, laid, instance->target, entered->regions);
    for (i = 0; i < N; i++)
        for (k = 0; k < SLOTS; k++)
            if (entered->regions[i][k] > 0.0) return 1;
    return WIDEBERTH_SHARED_LEVEL && one->point.level < asked(instance) - 1e-3;
}

static const int EVERY[] = {PLAN_ALONG, PLAN_LEFT, PLAN_RIGHT, PLAN_BACK_LEFT, PLAN_BACK_RIGHT,
    PLAN_WAIT, PLAN_TURN};
static const int FIRST[] = {PLAN_ALONG, PLAN_TURN};

/* How many of EVERY start are tried for what is in the way. */
static int past(const struct wideberth_planner *planner, const struct candidate *first, int there,
    int before)
{
    const struct instance *instance = &planner->instance;
    if (!optimal(first)) return 6;
    if (!there || !pressed(planner, first)) return 0;
    if (!instance->last || !before || stuck(instance, first) || gives_way_far(instance, first))
        return 6;
    return 1;
}

/* The starts that this situation asks for; returns how many. */
static int names_of(const struct wideberth_planner *planner, const struct candidate *first,
    int there, int before, const int **names)
{
    int count;
    *names = PLAN_STARTS_AUTO ? EVERY : PLAN_STARTS;
    if (!PLAN_STARTS_AUTO) return PLAN_STARTS_COUNT;
    count = past(planner, first, there, before);
    if (!wb_faces_away(&planner->instance.problem)) return count;
    if (count < 6) *names = FIRST + !count;
    return count + 1;
}

static int same_states(const struct point *first, const struct point *second)
{
    int i, r;
    for (i = 0; i <= N; i++)
        for (r = 0; r < NX; r++)
            if (!(first->states[i][r] == second->states[i][r])) return 0;
    return 1;
}

/* Further starting points, those left out that equal an earlier one; returns how many. */
static int starts_of(struct wideberth_planner *planner, const struct point *first,
    const struct point *laid, const int *names, int count)
{
    const struct instance *instance = &planner->instance;
    const wideberth_problem *problem = &instance->problem;
    struct point *starts = planner->scratch.starts;
    double pace = 1e-3, moving[3] = {0.0, 0.0, 0.0}, twist[3];
    int k, i, other, found = 0;
    for (i = 0; i < N; i++) pace = fmax(pace, fabs(problem->speed[i]));
    moving[0] = pace;
    for (k = 0; k < count; k++) {
        struct point *one = &starts[found];
        if (names[k] == PLAN_ALONG) {
            *one = *laid;
        } else if (names[k] == PLAN_TURN) {
            const int turning = wb_turn(problem, twist);
            wb_steer(problem->initial, twist, turning, moving, one->states, one->inputs);
        } else {
            wb_sweep(problem->initial, names[k], pace, names[k] == PLAN_COAST ? NULL : moving,
                twist);
            wb_steer(problem->initial, twist, N, twist, one->states, one->inputs);
        }
        one->level = instance->target;
        memset(one->slack, 0, sizeof(one->slack));
        for (other = 0; other < found && !same_states(one, &starts[other]);) other++;
        if (other < found || same_states(one, first)) continue;
        wb_suit(instance, one);
        found++;
    }
    return found;
}

/* Solve from further starts, and verify what was not given up. */
static void further(struct wideberth_planner *planner, const struct point *first,
    const struct point *laid, const int *names, int count)
{
    const struct instance *instance = &planner->instance;
    struct outcome *outcome = &planner->outcome;
    struct candidate *own = &outcome->candidates[0], *found = own + 1;
    struct others others = {0, INFINITY, INFINITY};
    int compare = 1, again = 0, k, kept;
    count = starts_of(planner, first, laid, names, count);
    if (refuted(own) && !enters(instance, own))
        compare = 0; /* those of other starts would be refuted as well */
    else if (optimal(own) || refuted(own))
        add(&others, &planner->scratch.given, own);
    for (k = 0; k < count; k++) {
        solve(planner, &planner->scratch.starts[k], 0, compare ? &others : NULL, &found[k]);
        if (compare) add(&others, &planner->scratch.given, &found[k]);
    }
    for (k = 0; k < count; k++) {
        if (found[k].status == GIVEN_UP) continue;
        assess(planner, &found[k]);
        again = again || (refuted(&found[k]) && !enters(instance, &found[k]));
    }
    for (k = 0; again && k < count; k++) { /* others may have been given up because of it */
        if (found[k].status != GIVEN_UP) continue;
        solve(planner, &planner->scratch.starts[k], 0, NULL, &found[k]);
        assess(planner, &found[k]);
    }
    for (k = kept = 0; k < count; k++) {
        if (found[k].status == GIVEN_UP) continue;
        if (kept != k) found[kept] = found[k];
        kept++;
    }
    outcome->count = 1 + kept;
}

void wb_multistart(struct wideberth_planner *planner, struct point *first, int warm)
{
    const struct instance *instance = &planner->instance;
    const wideberth_problem *problem = &instance->problem;
    struct outcome *outcome = &planner->outcome;
    struct point *laid = &planner->scratch.aimed;
    const int *names;
    int i, r, count, sound = 1;
    outcome->count = 0, outcome->before = planner->obstacle_in_way;
    outcome->in_the_way = outcome->before, outcome->iterations = 0;
    for (r = 0; r < NX; r++) sound = sound && fabs(problem->initial[r]) <= PLAN_FARTHEST;
    for (i = 0; i < N; i++)
        for (r = 0; r < 2; r++) sound = sound && fabs(problem->reference[i][r]) <= PLAN_FARTHEST;
    if (!sound) return;
    solve(planner, first, warm, NULL, &outcome->candidates[0]);
    outcome->count = 1;
    assess(planner, &outcome->candidates[0]);
    memset(laid, 0, sizeof(*laid));
    wb_laid(problem, laid->states, laid->inputs);
    laid->level = instance->target;
    wb_suit(instance, laid);
    outcome->in_the_way = in_the_way(planner, &outcome->candidates[0], laid);
    count = names_of(planner, &outcome->candidates[0], outcome->in_the_way, outcome->before, &names);
    if (count) further(planner, first, laid, names, count);
}

/* ---- Rungs */

static double lowest_level(void)
{
    return WIDEBERTH_SHARED_LEVEL ? fmax(PLAN_MINIMUM, 0.0) : NAN;
}

/* Wrap a trajectory at the lowest level that the policy allows, and verify it. */
static void at_lowest(struct wideberth_planner *planner, double (*states)[NX],
    double (*inputs)[NU], const double *touch, struct candidate *found)
{
    memset(found, 0, sizeof(*found));
    memcpy(found->point.states, states, sizeof(found->point.states));
    memcpy(found->point.inputs, inputs, sizeof(found->point.inputs));
    found->point.level = lowest_level(), found->cost = NAN, found->way = -1;
    wb_suit(&planner->instance, &found->point);
    wb_verify(planner, &found->point, touch, &found->found);
}

/* Solutions that keep the limits of motion, held against the lowest level; returns how many. */
static int drivable(struct wideberth_planner *planner)
{
    const struct outcome *outcome = &planner->outcome;
    struct candidate *found = planner->scratch.drivable;
    int k, count = 0;
    for (k = 0; k < outcome->count; k++) {
        const struct candidate *one = &outcome->candidates[k];
        double states[N + 1][NX], inputs[N][NU];
        if (!(wb_largest_motion(&one->found) <= TOLERANCE)) continue;
        memcpy(states, one->point.states, sizeof(states));
        memcpy(inputs, one->point.inputs, sizeof(inputs));
        at_lowest(planner, states, inputs, one->found.touch, &found[count]);
        found[count].solved = 1, found[count].status = one->status;
        found[count++].cost = one->cost;
    }
    return count;
}

static int leaves(const struct violation *found)
{
    int i;
    for (i = 0; found->in_contact && i < N; i++)
        if (found->pressed[i] != 0.0) return 0;
    return 1;
}

/* Steps that braking takes, and one more. */
static int window_of(const struct candidate *straight)
{
    int i, r, count = 1;
    for (i = 0; i <= N; i++) {
        double off = 0.0;
        for (r = 0; r < NX; r++)
            off = fmax(off, fabs(straight->point.states[i][r] - straight->point.states[N][r]));
        count += off > 1e-3;
    }
    return count;
}

/* What enters regions least: a way to stop, or one of `count` drivable solutions. */
static const struct candidate *gentlest(struct wideberth_planner *planner, int count)
{
    const struct instance *instance = &planner->instance;
    struct scratch *scratch = &planner->scratch;
    struct candidate *ways = scratch->ways;
    const struct candidate *every[ALL_STARTS + ALL_WAYS], *looked[ALL_STARTS + ALL_WAYS];
    double totals[ALL_STARTS + ALL_WAYS], depths[ALL_STARTS + ALL_WAYS], depth, least = INFINITY;
    const int all = wb_stops(instance->problem.initial,
        instance->contact.there ? instance->contact.fastest : 0.0, scratch->way_states,
        scratch->way_inputs);
    int k, place, window, some = 0, seen = 0;
    at_lowest(planner, scratch->way_states[0], scratch->way_inputs[0], NULL, &ways[0]);
    ways[0].way = 0;
    window = window_of(&ways[0]);
    depth = wb_touched_or_near(instance, &ways[0], window);
    if (fmax(depth, wb_total(&ways[0].found)) == 0.0) return &ways[0];
    every[some++] = &ways[0];
    for (k = 0; k < count; k++)
        if (leaves(&scratch->drivable[k].found)) every[some++] = &scratch->drivable[k];
    for (k = 1; k < all; k++) {
        at_lowest(planner, scratch->way_states[k], scratch->way_inputs[k], NULL, &ways[k]);
        ways[k].way = k;
        if (leaves(&ways[k].found)) every[some++] = &ways[k];
    }
    for (k = 0; k < some; k++) { /* by their totals; equal ones stay in order */
        const struct candidate *one = every[k];
        const double total = wb_total(&one->found);
        for (place = k; place > 0 && totals[place - 1] > total; place--)
            totals[place] = totals[place - 1], every[place] = every[place - 1];
        totals[place] = total, every[place] = one;
    }
    for (k = 0; k < some; k++) {
        looked[seen] = every[k];
        depths[seen] = every[k] == &ways[0] ? depth : wb_touched_or_near(instance, every[k], window);
        least = fmin(least, depths[seen]);
        if (depths[seen++] == 0.0) break;
    }
    for (k = 0; k < seen; k++)
        if (depths[k] <= least + TOLERANCE) return looked[k];
    return &ways[0];
}

/* Candidates that keep every constraint and cost little too much; returns how many. */
static int near_ones(const struct outcome *outcome, const struct candidate **near)
{
    double least = INFINITY, within;
    int k, count = 0;
    for (k = 0; k < outcome->count; k++)
        if (feasible(&outcome->candidates[k])) least = fmin(least, outcome->candidates[k].cost);
    if (least == INFINITY) return 0;
    within = PLAN_SWITCHING_MARGIN * (1.0 + fabs(least));
    for (k = 0; k < outcome->count; k++)
        if (feasible(&outcome->candidates[k]) && outcome->candidates[k].cost - least <= within)
            near[count++] = &outcome->candidates[k];
    return count;
}

/* The cheapest; that which continues the last plan while something stays in the way. */
static const struct candidate *cheapest(const struct wideberth_planner *planner,
    const struct candidate *const *some, int count)
{
    const struct outcome *outcome = &planner->outcome;
    const struct candidate *best = some[0];
    int k;
    if (outcome->before && planner->instance.last && some[0] == &outcome->candidates[0]) return best;
    for (k = 1; k < count; k++)
        if (some[k]->cost < best->cost) best = some[k];
    return best;
}

static const struct candidate *optimal_one(struct wideberth_planner *planner)
{
    const struct candidate *near[ALL_STARTS], *converged[ALL_STARTS];
    const int count = near_ones(&planner->outcome, near);
    int k, some = 0;
    for (k = 0; k < count; k++)
        if (optimal(near[k])) converged[some++] = near[k];
    return some ? cheapest(planner, converged, some) : NULL;
}

static const struct candidate *feasible_one(struct wideberth_planner *planner, int count)
{
    const struct candidate *near[ALL_STARTS];
    const int some = near_ones(&planner->outcome, near);
    int k;
    if (some) return cheapest(planner, near, some);
    for (k = 0; k < count; k++)
        if (feasible(&planner->scratch.drivable[k])) return &planner->scratch.drivable[k];
    return NULL;
}

static const struct candidate *shifted_one(struct wideberth_planner *planner)
{
    struct instance *instance = &planner->instance;
    struct candidate *one = &planner->scratch.one;
    double states[N + 1][NX];
    if (!instance->last || instance->contact.there) return NULL;
    wb_follow(instance->problem.initial, instance->last_inputs, states);
    at_lowest(planner, states, instance->last_inputs, NULL, one);
    return feasible(one) ? one : NULL;
}

static int is_drivable(const struct wideberth_planner *planner, const struct candidate *one)
{
    return one >= planner->scratch.drivable && one < planner->scratch.drivable + ALL_STARTS;
}

const struct candidate *wb_choose(struct wideberth_planner *planner, int *rung)
{
    const struct candidate *found = NULL, *least = NULL;
    int k, count = -1;
    for (k = 0; k < PLAN_RUNGS_COUNT && !found; k++) {
        *rung = PLAN_RUNGS[k];
        if (*rung == WIDEBERTH_OPTIMAL) found = optimal_one(planner);
        if (*rung == WIDEBERTH_SHIFTED) found = shifted_one(planner);
        if (*rung == WIDEBERTH_OPTIMAL || *rung == WIDEBERTH_SHIFTED || found) continue;
        if (count < 0) count = drivable(planner);
        if (*rung == WIDEBERTH_FEASIBLE) {
            found = feasible_one(planner, count);
            continue;
        }
        if (!least) least = gentlest(planner, count);
        if (*rung == WIDEBERTH_LEAST && is_drivable(planner, least)) found = least;
        if (*rung == WIDEBERTH_BRAKE)
            found = is_drivable(planner, least) ? gentlest(planner, 0) : least;
    }
    return found;
}
