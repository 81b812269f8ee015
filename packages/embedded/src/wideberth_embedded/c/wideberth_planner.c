/* One decision from top to bottom: perceive, lay the reference, forecast, fill the problem, solve
 * from several starts, take the best rung, command. C99 and libm. */
#include "planner_parts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const char *const STATUSES[WIDEBERTH_PLAN_STATUSES] = {
    "a plan was made",
    "an argument is NULL",
    "header and sources are not of one export, or the planner was not begun by "
    "wideberth_planner_begin",
    "the memory is too small, or not aligned as for a double: give wideberth_planner_size() bytes",
    "no path is set: call wideberth_planner_set_path",
    "a path needs two different points at least, at most WIDEBERTH_PATH_POINTS, all finite",
    "stamp or state are not finite, or larger than anything that is computed with",
    "more detections than WIDEBERTH_DETECTIONS, or fewer than none",
    "more walls than WIDEBERTH_WALLS, or walls for a planner without a static region",
    "a wall is no convex polygon of up to WIDEBERTH_CORNERS corners",
    "no rung of the ladder holds: end its tuple with brake",
};

static const char *const RUNGS[WIDEBERTH_RUNGS] = {
    "optimal", "feasible", "shifted", "least violation", "brake", "emergency"};

const char *wideberth_planner_status_text(int status)
{
    return status >= 0 && status < WIDEBERTH_PLAN_STATUSES ? STATUSES[status] : "unknown status";
}

const char *wideberth_rung_text(int rung)
{
    return rung >= 0 && rung < WIDEBERTH_RUNGS ? RUNGS[rung] : "unknown rung";
}

size_t wideberth_planner_size(void)
{
    return sizeof(struct wideberth_planner);
}

static int begun(const wideberth_planner *planner)
{
    return planner->build == WIDEBERTH_BUILD;
}

int wideberth_planner_begin_as(void *memory, size_t size, uint64_t build,
    wideberth_planner **planner)
{
    wideberth_planner *made = (wideberth_planner *)memory;
    if (!memory || !planner) return WIDEBERTH_PLAN_NULL;
    *planner = NULL;
    if (build != WIDEBERTH_BUILD) return WIDEBERTH_PLAN_OTHER_BUILD;
    if (size < sizeof(*made) || (uintptr_t)memory % sizeof(double)) return WIDEBERTH_PLAN_MEMORY;
    memset(made, 0, sizeof(*made));
    made->build = WIDEBERTH_BUILD;
    wideberth_planner_reset(made);
    if (wideberth_begin(&made->instance.problem)) return WIDEBERTH_PLAN_OTHER_BUILD;
    *planner = made;
    return WIDEBERTH_PLANNED;
}

void wideberth_planner_reset(wideberth_planner *planner)
{
    if (!planner || !begun(planner)) return;
    planner->history.count = planner->history.placeless = 0;
    planner->history.shared = planner->history.born = 0;
    planner->history.stamp = -INFINITY;
    planner->has_plan = planner->kept.known = planner->obstacle_in_way = 0;
    memset(planner->path.progress, 0, sizeof(planner->path.progress));
    planner->path.there = planner->holds = 0;
}

int wideberth_planner_set_path(wideberth_planner *planner, const double (*points)[2], int count)
{
    struct path *path;
    int k, kept = 0, same = 1;
    if (!planner || !points) return WIDEBERTH_PLAN_NULL;
    if (!begun(planner)) return WIDEBERTH_PLAN_OTHER_BUILD;
    if (count < 2 || count > POINTS) return WIDEBERTH_PLAN_PATH;
    for (k = 0; k < count; k++)
        if (!(fabs(points[k][0]) <= PLAN_FARTHEST && fabs(points[k][1]) <= PLAN_FARTHEST))
            return WIDEBERTH_PLAN_PATH;
    for (k = 1; k < count && points[k][0] == points[0][0] && points[k][1] == points[0][1];) k++;
    if (k == count) return WIDEBERTH_PLAN_PATH;
    path = &planner->path;
    for (k = 0; k < count; k++) {
        const double *last = kept ? path->at[kept - 1] : NULL;
        double length = 0.0;
        if (last) {
            const double x = points[k][0] - last[0], y = points[k][1] - last[1];
            length = sqrt(x * x + y * y);
            if (length == 0.0) continue;
        }
        path->arc[kept] = last ? path->arc[kept - 1] + length : 0.0;
        same = same && kept < path->count
            && fabs(points[k][0] - path->at[kept][0]) <= PLAN_SAME_PATH
            && fabs(points[k][1] - path->at[kept][1]) <= PLAN_SAME_PATH;
        memcpy(path->at[kept++], points[k], sizeof(path->at[0]));
    }
    if (!same || path->count != kept) memset(path->progress, 0, sizeof(path->progress));
    path->count = kept;
    return WIDEBERTH_PLANNED;
}

int wideberth_planner_move_path(wideberth_planner *planner, const double (*points)[2], int count)
{
    struct progress before[PROGRESSES];
    int status;
    if (!planner || !points) return WIDEBERTH_PLAN_NULL;
    memcpy(before, planner->path.progress, sizeof(before));
    status = wideberth_planner_set_path(planner, points, count);
    if (!status) memcpy(planner->path.progress, before, sizeof(before));
    return status;
}

/* ---- Emergencies */

static void explained(wideberth_decision *decision)
{
    snprintf(decision->reason, sizeof(decision->reason), "%s%s%s", RUNGS[decision->rung],
        decision->status ? ": " : "",
        decision->status ? STATUSES[decision->status] : "");
}

/* Brake without looking; where even that fails, command zero velocity at once. */
static int braked(wideberth_planner *planner, const wideberth_observation *seen, int status,
    wideberth_decision *decision)
{
    double states[N + 1][NX] = {{0.0}}, inputs[N][NU] = {{0.0}}, start[NX];
    int r, sound = 1;
    for (r = 0; r < NX; r++) sound = sound && isfinite(seen->state[r]);
    memset(decision, 0, sizeof(*decision));
    if (sound) {
        wb_within_bounds(seen->state, start);
        wb_brake(start, states, inputs);
        wb_limited(states[1], inputs[0], &decision->command);
    }
    planner->has_plan = 1, planner->plan_stamp = seen->stamp;
    memcpy(planner->plan_inputs, inputs, sizeof(inputs));
    planner->kept.known = 0;
    memcpy(decision->states, states, sizeof(states));
    memcpy(decision->inputs, inputs, sizeof(inputs));
    decision->rung = WIDEBERTH_EMERGENCY, decision->status = status;
    decision->violation = NAN, decision->level = NAN;
    explained(decision);
    return status;
}

/* ---- Multipliers of the last plan */

static void later(const double *rows, int width, double share, double *found)
{
    int i, c;
    for (i = 0; i < N; i++) {
        const double place = fmin(i + share, N - 1.0);
        const int before = (int)place, after = before + 1 < N ? before + 1 : N - 1;
        const double weight = place - before;
        for (c = 0; c < width; c++)
            found[i * width + c]
                = (1.0 - weight) * rows[before * width + c] + weight * rows[after * width + c];
    }
}

/* Add level and multipliers of the last plan to a start soon after it; returns whether there are
 * multipliers that the solver takes. */
static int warmed(wideberth_planner *planner, double stamp, struct point *first)
{
    const struct instance *instance = &planner->instance;
    const struct kept *kept = &planner->kept;
    struct given *given = &planner->scratch.given;
    const double share = (stamp - planner->plan_stamp) / WIDEBERTH_DT;
    double sum = 0.0;
    int i, k, c, old;
    if (!planner->has_plan || !kept->known || !(share >= 0.0 && share <= PLAN_WARM_WITHIN)) return 0;
    first->level = kept->level;
    later(&kept->steps[0][0], PLAN_MULTIPLIERS, share, &given->steps_before[0][0]);
    for (i = 0; i < N; i++)
        for (c = 0; c < PLAN_MULTIPLIERS; c++) sum += given->steps_before[i][c];
    for (k = 0; k < KO; k++) {
        double rows[N][PLAN_OBSTACLE_MULTIPLIERS], found[N][PLAN_OBSTACLE_MULTIPLIERS];
        for (old = 0; old < kept->obstacles; old++)
            if (k < instance->obstacles && strcmp(kept->names[old], instance->names[k]) == 0) break;
        for (i = 0; i < N; i++)
            for (c = 0; c < PLAN_OBSTACLE_MULTIPLIERS; c++)
                rows[i][c] = old < kept->obstacles && k < instance->obstacles
                    ? kept->slots[i][old][c]
                    : NAN;
        later(&rows[0][0], PLAN_OBSTACLE_MULTIPLIERS, share, &found[0][0]);
        for (i = 0; i < N; i++) memcpy(given->obstacles_before[i][k], found[i], sizeof(found[i]));
    }
    return isfinite(sum) && !instance->polygons && !kept->polygons;
}

static void keep(wideberth_planner *planner, const struct candidate *one)
{
    struct kept *kept = &planner->kept;
    kept->known = one->multipliers;
    if (!kept->known) return;
    kept->level = one->point.level;
    kept->obstacles = planner->instance.obstacles, kept->polygons = planner->instance.polygons;
    memcpy(kept->names, planner->instance.names, sizeof(kept->names));
    memcpy(kept->steps, one->steps, sizeof(kept->steps));
    memcpy(kept->slots, one->slots, sizeof(kept->slots));
}

/* ---- The cycle */

static int checked(const wideberth_observation *seen)
{
    int r, k;
    if (seen->obstacles < 0 || seen->obstacles > WIDEBERTH_DETECTIONS)
        return WIDEBERTH_PLAN_DETECTIONS;
    if (seen->obstacles && !seen->detections) return WIDEBERTH_PLAN_NULL;
    if (seen->polygons < 0 || seen->polygons > (KP ? WALLS : 0)) return WIDEBERTH_PLAN_WALLS;
    if (seen->polygons && !seen->walls) return WIDEBERTH_PLAN_NULL;
    if (!isfinite(seen->stamp)) return WIDEBERTH_PLAN_NUMBERS;
    for (r = 0; r < NX; r++)
        if (!(fabs(seen->state[r]) <= PLAN_FARTHEST)) return WIDEBERTH_PLAN_NUMBERS;
    for (k = 0; k < seen->polygons; k++) {
        struct wall wall;
        if (!wb_wall(&seen->walls[k], &wall)) return WIDEBERTH_PLAN_POLYGON;
    }
    return WIDEBERTH_PLANNED;
}

static void perceive(wideberth_planner *planner, const wideberth_observation *seen)
{
    double pose[3];
    int r, sound = 1;
    for (r = 0; r < NX; r++) sound = sound && isfinite(seen->state[r]);
    if (seen->obstacles < 0 || seen->obstacles > WIDEBERTH_DETECTIONS
        || (seen->obstacles && !seen->detections))
        return;
    if (sound) wb_pose(seen->state, pose);
    wb_take(&planner->history, seen, sound ? pose : NULL, &planner->scratch);
}

int wideberth_planner_remember(wideberth_planner *planner, const wideberth_observation *seen)
{
    int status;
    if (!planner || !seen || !seen->state) return WIDEBERTH_PLAN_NULL;
    if (!begun(planner)) return WIDEBERTH_PLAN_OTHER_BUILD;
    status = checked(seen);
    perceive(planner, seen);
    return status;
}

/* Turn no more than there is a reason for near the end of the path, or where the robot rests. */
static void rest_from_turning(const wideberth_planner *planner, double arc, const double *place,
    wideberth_command *command)
{
    const struct path *path = &planner->path;
    const double *end = planner->holds ? planner->hold : path->at[path->count - 1];
    if (!planner->holds && path->arc[path->count - 1] - arc > PLAN_END_LEFT) return;
    command->omega = wb_turning(hypot(end[0] - place[0], end[1] - place[1]),
        hypot(command->linear[0], command->linear[1]), command->omega);
}

static int planned(wideberth_planner *planner, const wideberth_observation *seen,
    wideberth_decision *decision)
{
    struct point *first = &planner->scratch.one.point;
    const struct candidate *best;
    double start[NX], pose[3], arc;
    int warm;
    wb_within_bounds(seen->state, start);
    wb_pose(start, pose);
    arc = wb_advanced(&planner->path, pose);
    wb_hold(planner, seen, arc, pose);
    wb_tracks(&planner->history, &planner->tracks);
    wb_forecast(&planner->tracks, seen->stamp, &planner->forecast);
    if (planner->has_plan && isnan(planner->plan_stamp)) /* it cannot be continued */
        return braked(planner, seen, WIDEBERTH_PLAN_NUMBERS, decision);
    wb_fill(planner, seen, start, arc, first);
    warm = warmed(planner, seen->stamp, first);
    wb_multistart(planner, first, warm);
    best = wb_choose(planner, &decision->rung);
    if (!best) return braked(planner, seen, WIDEBERTH_PLAN_NO_RUNG, decision);
    wb_limited(best->point.states[1], best->point.inputs[0], &decision->command);
    rest_from_turning(planner, arc, pose, &decision->command);
    decision->violation = wb_worst(&best->found), decision->level = best->point.level;
    decision->cost = best->cost, decision->left_out = planner->instance.left_out;
    decision->starts = planner->outcome.count;
    decision->iterations = planner->outcome.iterations;
    memcpy(decision->states, best->point.states, sizeof(decision->states));
    memcpy(decision->inputs, best->point.inputs, sizeof(decision->inputs));
    planner->has_plan = 1, planner->plan_stamp = seen->stamp;
    memcpy(planner->plan_inputs, best->point.inputs, sizeof(planner->plan_inputs));
    keep(planner, best);
    planner->obstacle_in_way = planner->outcome.in_the_way;
    explained(decision);
    return WIDEBERTH_PLANNED;
}

int wideberth_planner_decide(wideberth_planner *planner, const wideberth_observation *seen,
    wideberth_decision *decision)
{
    int status;
    if (decision) memset(decision, 0, sizeof(*decision));
    if (!planner || !seen || !seen->state || !decision) return WIDEBERTH_PLAN_NULL;
    if (!begun(planner)) return WIDEBERTH_PLAN_OTHER_BUILD;
    if (!planner->path.count) return braked(planner, seen, WIDEBERTH_PLAN_NO_PATH, decision);
    perceive(planner, seen);
    status = checked(seen);
    if (status) return braked(planner, seen, status, decision);
    return planned(planner, seen, decision);
}
