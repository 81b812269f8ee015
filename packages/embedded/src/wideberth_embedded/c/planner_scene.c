/* The problem of one decision: the reference along the path, which obstacles and walls get a slot,
 * and the first starting point. What cycle, reference, slots and starts do in Python. */
#include "planner_parts.h"

#include <math.h>
#include <string.h>

static double length_of(const double *first, const double *second)
{
    const double x = second[0] - first[0], y = second[1] - first[1];
    return sqrt(x * x + y * y);
}

/* ---- The path */

/* Arc length and distance of the nearest point of a piece within a window from `start` on; the
 * distance of a piece outside it is infinite. */
static double nearest_of(const struct path *path, int k, const double *place, double start,
    double window, double *away)
{
    const double *begin = path->at[k], before = path->arc[k];
    const double step[2] = {path->at[k + 1][0] - begin[0], path->at[k + 1][1] - begin[1]};
    const double length = path->arc[k + 1] - before;
    const double low = fmin(fmax(start - before, 0.0), length);
    const double high = fmin(fmax(start + window - before, 0.0), length);
    double along, reach, gap[2];
    along = ((place[0] - begin[0]) * step[0] + (place[1] - begin[1]) * step[1]) / length;
    along = fmin(fmax(along, low), high), reach = before + along;
    gap[0] = begin[0] + step[0] * (along / length) - place[0];
    gap[1] = begin[1] + step[1] * (along / length) - place[1];
    *away = sqrt(gap[0] * gap[0] + gap[1] * gap[1]);
    if (reach < start - 1e-12 || reach > start + window + 1e-12) *away = INFINITY;
    return reach;
}

/* Distance of the nearest point within a window from `start` on. */
static double least_away(const struct path *path, const double *place, double start, double window)
{
    double nearest = INFINITY, away;
    int k;
    for (k = 0; k + 1 < path->count; k++) {
        nearest_of(path, k, place, start, window, &away);
        nearest = fmin(nearest, away);
    }
    return nearest;
}

/* Arc length of the nearest point from `start` on, within a window; the first stretch is taken
 * whose nearest point is no more than `early` farther off than the nearest of all. */
static double project(const struct path *path, const double *place, double start, double window,
    double early)
{
    const double nearest = least_away(path, place, start, window);
    double reach, away;
    int k;
    for (k = 0; k + 1 < path->count; k++) {
        reach = nearest_of(path, k, place, start, window, &away);
        if (away <= nearest + early) return fmin(fmax(reach, 0.0), path->arc[path->count - 1]);
    }
    return 0.0;
}

static int piece_of(const struct path *path, double arc);

/* Arc length of the first stretch within a window that runs against the path at `arc`, and is no
 * more than `PLAN_BESIDE` farther off than the nearest one; `arc` if there is none. */
static double way_back(const struct path *path, const double *place, double arc, double window)
{
    const double nearest = least_away(path, place, arc, window);
    const int here = piece_of(path, arc);
    const double (*at)[2] = path->at;
    double reach, away, cosine;
    int k;
    for (k = 0; k + 1 < path->count; k++) {
        cosine = (at[k + 1][0] - at[k][0]) * (at[here + 1][0] - at[here][0])
            + (at[k + 1][1] - at[k][1]) * (at[here + 1][1] - at[here][1]);
        cosine /= (path->arc[k + 1] - path->arc[k]) * (path->arc[here + 1] - path->arc[here]);
        reach = nearest_of(path, k, place, arc, window, &away);
        if (cosine < PLAN_OPPOSITE && away <= nearest + PLAN_BESIDE) return reach;
    }
    return arc;
}

/* The progress at a place; the search reaches `farther` ahead, and a way back may cut off `ahead` m
 * of the path, or, where that is negative, counts once the robot has driven back. */
static double progressed(const struct path *path, struct progress *progress, const double *place,
    double farther, double ahead)
{
    double arc, reach, low, driven, back, before;
    const struct progress last = *progress;
    memcpy(progress->where, place, sizeof(progress->where));
    if (!last.begun) {
        progress->begun = 1;
        return progress->last = project(path, place, 0.0, INFINITY, PLAN_EARLY);
    }
    reach = PLAN_EARLY + 2.0 * length_of(last.where, place);
    low = fmax(last.last - reach, last.begin);
    arc = project(path, place, low, fmax(last.last + reach + farther - low, 0.0), 0.0);
    driven = last.grown ? fmax(last.farthest - arc, 0.0) : 0.0, back = arc;
    if (last.grown && last.waited >= PLAN_PATIENCE && (ahead >= 0.0 || driven >= PLAN_EARLY))
        back = way_back(path, place, arc, (ahead < 0.0 ? PLAN_CUT : ahead) + 2.0 * driven);
    if (back > arc) progress->begin = back;
    before = (last.grown ? last.farthest : last.last) + PLAN_GROWN;
    if (back > arc || arc > before)
        progress->grown = 1, progress->farthest = back, progress->waited = 0;
    else
        progress->waited += last.grown;
    return progress->last = back;
}

double wb_progressed(const struct path *path, struct progress *progress, const double *place)
{
    return progressed(path, progress, place, 0.0, -1.0);
}

double wb_advanced(struct path *path, const double *place)
{
    struct progress *reference = &path->progress[REFERENCE];
    return progressed(path, reference, place, fmin(PLAN_LONGER * reference->waited, PLAN_LONGEST),
        PLAN_SPEED * N * WIDEBERTH_DT);
}

/* Index of the piece of the path that an arc length lies in. */
static int piece_of(const struct path *path, double arc)
{
    int low = 0, high = path->count; /* how many points have at most this arc length */
    while (low < high) {
        const int middle = (low + high) / 2;
        if (path->arc[middle] <= arc)
            low = middle + 1;
        else
            high = middle;
    }
    low--;
    return low < 0 ? 0 : low > path->count - 2 ? path->count - 2 : low;
}

static void walk(const struct path *path, double arc, double *place)
{
    const int k = piece_of(path, arc), last = path->count - 1;
    const double begin = path->arc[k], end = path->arc[k + 1];
    int r;
    for (r = 0; r < 2; r++) {
        const double slope = (path->at[k + 1][r] - path->at[k][r]) / (end - begin);
        place[r] = arc >= path->arc[last] ? path->at[last][r]
            : arc <= path->arc[0]         ? path->at[0][r]
                                          : slope * (arc - begin) + path->at[k][r];
    }
}

void wb_lay(const struct path *path, double arc, wideberth_problem *problem)
{
    const double length = path->arc[path->count - 1];
    double begin = fmin(arc, length);
    int i, r;
    for (i = 0; i < N; i++) {
        const double end = fmin(arc + PLAN_SPEED * WIDEBERTH_DT * (i + 1), length);
        const int k = piece_of(path, 0.5 * (end + begin));
        const double step[2]
            = {path->at[k + 1][0] - path->at[k][0], path->at[k + 1][1] - path->at[k][1]};
        const double norm = sqrt(step[0] * step[0] + step[1] * step[1]);
        walk(path, end, problem->reference[i]);
        for (r = 0; r < 2; r++) problem->direction[i][r] = step[r] / norm;
        problem->speed[i] = (end - begin) / WIDEBERTH_DT;
        begin = end;
    }
}

/* ---- Obstacles */

/* Covariance no deviation of which exceeds `PLAN_WIDE`. */
static void not_wider(double *covariance)
{
    double values[2], vectors[4];
    int k, r, c, wide = 0;
    for (k = 0; k < 4; k++) wide = wide || !(fabs(covariance[k]) <= PLAN_WIDE * PLAN_WIDE / 2.0);
    if (!wide) return;
    for (k = 0; k < 4; k++) wide = wide && isfinite(covariance[k]);
    if (!wide) {
        covariance[0] = covariance[3] = PLAN_WIDE * PLAN_WIDE, covariance[1] = covariance[2] = 0.0;
        return;
    }
    wb_axes(covariance, values, vectors);
    for (r = 0; r < 2; r++)
        for (c = 0, covariance[2 * r] = covariance[2 * r + 1] = 0.0; c < 2; c++)
            for (k = 0; k < 2; k++)
                covariance[2 * r + c] += vectors[2 * r + k] * vectors[2 * c + k]
                    * fmin(fmax(values[k], 0.0), PLAN_WIDE * PLAN_WIDE);
}

/* Whether no plan can meet an obstacle, see slots/reachability.py. */
static int out_of_reach(const struct instance *instance, const double (*mean)[2],
    const double (*covariance)[4], double margin, const double *here, const double *travel)
{
    const double wide = fmin(margin, PLAN_WIDE);
    double values[2], vectors[4];
    int i;
    if (!PLAN_LEAVES_OUT) return 0;
    for (i = 0; i < N; i++) {
        const double first = length_of(instance->problem.reference[i], mean[i]);
        const double second = length_of(here, mean[i]) - travel[i], room = fmin(first, second);
        double radius;
        wb_axes(covariance[i], values, vectors);
        radius = PLAN_LEVELS[i] * sqrt(fmax(values[0], 0.0)) + wide;
        radius = fmax(radius, wide) * (1.0 + PLAN_SURPLUS) + PLAN_SURPLUS;
        if (!(room > wide) || !(PLAN_LEVELS[i] >= 0.0) || !(room > radius)) return 0;
    }
    return 1;
}

static double clearance(const struct instance *instance, const double (*mean)[2], double radius,
    const double *here)
{
    double least = INFINITY;
    int i;
    for (i = 0; i < N; i++) {
        least = fmin(least, length_of(instance->problem.reference[i], mean[i]));
        least = fmin(least, length_of(here, mean[i]));
    }
    return least - radius;
}

/* Distance from where it starts at which the robot can be at each step. */
static void travelled(const double *start, double *travel)
{
    const double none[NU] = {0.0};
    double twist[3], each, surplus;
    int i;
    wb_twist(start, none, twist);
    each = WIDEBERTH_DT * (PLAN_FASTEST + 2.0 * sqrt(TOLERANCE)) + TOLERANCE;
    surplus = sqrt(twist[0] * twist[0] + twist[1] * twist[1]) - PLAN_FASTEST;
    surplus = WIDEBERTH_DT * fmax(surplus, 0.0);
    for (i = 0; i < N; i++) travel[i] = surplus + each * (i + 1);
}

/* Give an obstacle the next slot; returns 0 where its numbers are none that a solver takes. */
static int put(struct instance *instance, const struct log *log, const double (*mean)[2],
    const double (*covariance)[4])
{
    const int slot = instance->obstacles++;
    int i;
    memcpy(instance->names[slot], log->name, WIDEBERTH_NAME);
    for (i = 0; i < N; i++) memcpy(instance->means[i][slot], mean[i], 2 * sizeof(double));
    instance->radii[slot] = log->radius;
    return wideberth_set(&instance->problem, WIDEBERTH_KIND_OBSTACLE, slot, mean, covariance,
               fmin(log->radius, PLAN_WIDE))
        == WIDEBERTH_NO_ERROR;
}

static void choose_obstacles(struct wideberth_planner *planner, const double *here,
    const double *travel)
{
    struct instance *instance = &planner->instance;
    struct scratch *scratch = &planner->scratch;
    const struct tracks *tracks = &planner->tracks;
    int near[PLAN_MOST], count = 0, k, i, r, other, rank;
    double *gaps = scratch->away;
    for (k = 0; k < tracks->count; k++) {
        double (*place)[2] = scratch->place[k];
        for (i = 0; i < N; i++) {
            const double *first = instance->problem.reference[0];
            for (r = 0; r < 2; r++)
                place[i][r] = fmin(fmax(planner->forecast.mean[k][i][r], first[r] - PLAN_FAR),
                    first[r] + PLAN_FAR);
            memcpy(scratch->spread[k][i], planner->forecast.covariance[k][i], 4 * sizeof(double));
            not_wider(scratch->spread[k][i]);
        }
        if (out_of_reach(instance, (const double (*)[2])place,
                (const double (*)[4])scratch->spread[k],
                tracks->of[k]->radius + PLAN_ROOM, here, travel))
            continue;
        gaps[count] = clearance(instance, (const double (*)[2])planner->forecast.mean[k],
            tracks->of[k]->radius, here);
        near[count++] = k;
    }
    for (k = 0; k < count; k++) {
        for (other = rank = 0; other < count; other++)
            rank += gaps[other] < gaps[k] || (gaps[other] == gaps[k] && other < k);
        if (rank >= PLAN_OBSTACLES_USED) {
            instance->left_out++;
            continue;
        }
        if (!put(instance, tracks->of[near[k]], (const double (*)[2])scratch->place[near[k]],
                (const double (*)[4])scratch->spread[near[k]]))
            planner->history.placeless++; /* nothing is known of it: the robot stops */
    }
}

/* ---- Walls */

#if WIDEBERTH_POLYGONS > 0

#define LEAST_LENGTH 0.1 /* m; bounds of the length beside the margin in a scale */
#define MOST_LENGTH 1.0

static void put_wall(struct instance *instance, const struct wall *wall)
{
    const int slot = instance->polygons++;
    double widest = 0.0, scale;
    int i, k, j;
    for (k = 0; k < wall->corners; k++)
        for (j = 0; j < wall->corners; j++)
            widest = fmax(widest, hypot(wall->at[k][0] - wall->at[j][0],
                                      wall->at[k][1] - wall->at[j][1]));
    scale = PLAN_WALL_ROOM + fmin(fmax(0.5 * widest, LEAST_LENGTH), MOST_LENGTH);
    for (i = 0; i < N; i++) {
        double *numbers = instance->problem.polygons.parameters[i][slot];
        for (k = 0; k < CORNERS; k++)
            memcpy(numbers + 2 * k, wall->at[k < wall->corners ? k : wall->corners - 1],
                2 * sizeof(double));
        numbers += 2 * CORNERS;
        numbers[0] = numbers[1] = numbers[2] = 0.0; /* the own state counts as exact */
        numbers[3] = PLAN_WALL_ROOM, numbers[4] = scale;
    }
    instance->problem.polygons.active[slot] = 1.0;
}

static double away_from(const struct instance *instance, const struct wall *wall,
    const double *here, double (*planned)[NX])
{
    double least = INFINITY, pose[3];
    int i;
    for (i = 0; i < N; i++) {
        const double (*at)[2] = (const double (*)[2])wall->at;
        least = fmin(least,
            wb_separation(instance->problem.reference[i], at, wall->corners, NULL));
        wb_pose(planned[i + 1], pose);
        least = fmin(least, wb_separation(pose, at, wall->corners, NULL));
        if (!i) least = fmin(least, wb_separation(here, at, wall->corners, NULL));
    }
    return least;
}

static void choose_walls(struct wideberth_planner *planner, const wideberth_observation *seen,
    const double *here, double (*planned)[NX])
{
    struct instance *instance = &planner->instance;
    double *away = planner->scratch.wall_away;
    const double reach = PLAN_WALL_ROOM + 0.5 * PLAN_SPEED * N * WIDEBERTH_DT;
    int k, other, rank;
    instance->walls = 0;
    for (k = 0; k < seen->polygons; k++) {
        if (!wb_wall(&seen->walls[k], &instance->known[instance->walls])) continue;
        away[instance->walls] = away_from(instance, &instance->known[instance->walls], here,
            planned);
        instance->walls++;
    }
    for (k = 0; k < instance->walls; k++) {
        if (!(away[k] <= reach)) continue;
        for (other = rank = 0; other < instance->walls; other++)
            rank += away[other] <= reach
                && (away[other] < away[k] || (away[other] == away[k] && other < k));
        if (rank < PLAN_OBSTACLES_USED)
            put_wall(instance, &instance->known[k]);
        else
            instance->left_out++;
    }
}

void wb_suit(const struct instance *instance, struct point *point)
{
    double pose[3], normal[2];
    int i, k;
    for (i = 0; i < N; i++) {
        wb_pose(point->states[i + 1], pose);
        for (k = 0; k < KP; k++) {
            const double *at = instance->problem.polygons.parameters[i][k];
            if (k >= instance->polygons) {
                point->own[i][k][0] = 0.0;
                continue;
            }
            normal[0] = 1.0, normal[1] = 0.0;
            wb_separation(pose, (const double (*)[2])at, CORNERS, normal);
            point->own[i][k][0] = atan2(normal[1], normal[0]);
        }
    }
}

#else

void wb_suit(const struct instance *instance, struct point *point)
{
    (void)instance, (void)point;
}

#endif

/* ---- All of it */

/* The inputs that are left of the last plan, driven from here; or coasting. */
static void resume(struct wideberth_planner *planner, double stamp, const double *start,
    struct point *first)
{
    struct instance *instance = &planner->instance;
    double share = 0.0;
    if (planner->has_plan) share = fmin((stamp - planner->plan_stamp) / WIDEBERTH_DT, N);
    instance->last = planner->has_plan && !(share < 0.0);
    if (instance->last) {
        wb_shift(planner->plan_inputs, share, instance->last_inputs);
        memcpy(first->inputs, instance->last_inputs, sizeof(first->inputs));
        wb_follow(start, first->inputs, first->states);
    } else {
        double coast[3];
        wb_sweep(start, PLAN_COAST, 0.0, NULL, coast);
        wb_steer(start, coast, N, coast, first->states, first->inputs);
    }
    memset(first->slack, 0, sizeof(first->slack));
    first->level = instance->target;
}

/* Lay the reference at the place where the robot rests. */
static void rest(const struct wideberth_planner *planner, wideberth_problem *problem)
{
    const struct path *path = &planner->path;
    const int k = path->count - 2;
    int i, r;
    for (i = 0; i < N; i++) {
        for (r = 0; r < 2; r++) {
            problem->reference[i][r] = planner->hold[r];
            problem->direction[i][r]
                = (path->at[k + 1][r] - path->at[k][r]) / length_of(path->at[k], path->at[k + 1]);
        }
        problem->speed[i] = 0.0;
    }
}

void wb_fill(struct wideberth_planner *planner, const wideberth_observation *seen,
    const double *start, double arc, struct point *first)
{
    struct instance *instance = &planner->instance;
    double here[3], travel[N];
    wideberth_begin(&instance->problem);
    memcpy(instance->problem.initial, start, sizeof(instance->problem.initial));
    wb_lay(&planner->path, arc, &instance->problem);
    if (planner->holds) rest(planner, &instance->problem);
    instance->obstacles = instance->polygons = instance->left_out = instance->walls = 0;
    instance->target = WIDEBERTH_SHARED_LEVEL ? PLAN_LEVELS[0] : NAN;
    wb_pose(start, here);
    travelled(start, travel);
    resume(planner, seen->stamp, start, first);
    choose_obstacles(planner, here, travel);
#if WIDEBERTH_POLYGONS > 0
    choose_walls(planner, seen, here, first->states);
    wb_suit(instance, first);
    memcpy(instance->problem.polygons.auxiliaries, first->own, sizeof(first->own));
#endif
    wb_contact(planner, seen, start);
}
