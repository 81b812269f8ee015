/* A plan is verified without the solver that made it, and held to the rule of contact. What verify,
 * in_contact and the slots' known obstacles do in Python. */
#include "planner_parts.h"

#include <math.h>
#include <string.h>

static int finite_states(const struct point *point)
{
    int i, r;
    for (i = 0; i <= N; i++)
        for (r = 0; r < NX; r++)
            if (!isfinite(point->states[i][r])) return 0;
    return 1;
}

/* How far the slots' regions are entered; the level is read where it is shared. Returns whether all
 * of it is finite; else it is zero. */
int wb_entered(const struct instance *instance, const struct point *point, double level,
    double (*regions)[SLOTS])
{
    const wideberth_problem *problem = &instance->problem;
    double v[WIDEBERTH_MOST_VARIABLES], p[WIDEBERTH_MOST_NUMBERS], rows[WIDEBERTH_MOST_ROWS];
    int i, k, r, sound = 1;
    memset(regions, 0, N * sizeof(regions[0]));
    for (i = 0; i < N; i++) {
        memcpy(v, point->states[i + 1], sizeof(point->states[0]));
        for (k = 0; k < instance->obstacles; k++) {
            if (WIDEBERTH_SHARED_LEVEL) v[NX] = level;
            memcpy(p, problem->obstacles.parameters[i][k], sizeof(problem->obstacles.parameters[i][k]));
            p[WIDEBERTH_OBSTACLE_PARAMETERS] = problem->obstacles.level[i][k];
            p[WIDEBERTH_OBSTACLE_PARAMETERS + 1] = 1.0;
            wb_column(wideberth_check0, v, p, rows);
            for (r = 0; r < PLAN_SLOT0_ROWS; r++)
                if (!(-rows[r] <= regions[i][k])) regions[i][k] = -rows[r];
            sound = sound && isfinite(regions[i][k]);
        }
#if WIDEBERTH_POLYGONS > 0
        for (k = 0; k < instance->polygons; k++) {
            v[NX] = point->own[i][k][0];
            if (WIDEBERTH_SHARED_LEVEL) v[NX + 1] = level;
            memcpy(p, problem->polygons.parameters[i][k], sizeof(problem->polygons.parameters[i][k]));
            p[WIDEBERTH_POLYGON_PARAMETERS] = 1.0, p[WIDEBERTH_POLYGON_PARAMETERS + 1] = 0.0;
            wb_column(wideberth_check1, v, p, rows);
            for (r = 0; r < PLAN_SLOT1_ROWS; r++)
                if (!(-rows[r] <= regions[i][KO + k])) regions[i][KO + k] = -rows[r];
            sound = sound && isfinite(regions[i][KO + k]);
        }
#endif
    }
    if (!sound) memset(regions, 0, N * sizeof(regions[0]));
    return sound;
}

static void motion_of(const struct instance *instance, const struct point *point, double *motion)
{
    double v[2 * NX + NU], rows[WIDEBERTH_MOTION_ROWS];
    int i, r;
    for (i = 0; i < N; i++) {
        memcpy(v, point->states[i], sizeof(point->states[0]));
        memcpy(v + NX, point->inputs[i], sizeof(point->inputs[0]));
        memcpy(v + NX + NU, point->states[i + 1], sizeof(point->states[0]));
        wb_column(wideberth_motion, v, v, rows);
        motion[i] = 0.0;
        for (r = 0; r < WIDEBERTH_MOTION_ROWS; r++) {
            const double one = r < NX ? fabs(rows[r]) : -rows[r];
            if (!(one <= motion[i])) motion[i] = one;
        }
    }
    for (r = 0; r < NX; r++) {
        const double off = fabs(point->states[0][r] - instance->problem.initial[r]);
        if (!(off <= motion[0])) motion[0] = off;
    }
}

/* How deep the body enters walls on the way to each step. */
static void touched(const struct instance *instance, const struct point *point, double *depth)
{
    const double half = PLAN_RADIUS;
    double place[N + 1][3], length[N], longest = 0.0;
    int i, k, look, looks;
    memset(depth, 0, N * sizeof(double));
    if (!instance->walls || !finite_states(point)) return;
    for (i = 0; i <= N; i++) wb_pose(point->states[i], place[i]);
    for (i = 0; i < N; i++) {
        const double x = place[i + 1][0] - place[i][0], y = place[i + 1][1] - place[i][1];
        length[i] = sqrt(x * x + y * y);
        longest = fmax(longest, length[i]);
    }
    looks = (int)fmin(fmax(ceil(longest / half), 1.0), PLAN_MOST_LOOKS);
    for (i = 0; i < N; i++) {
        const double square = half * half - 0.25 * length[i] * length[i];
        const double cut = half - sqrt(fmax(square, 0.25 * half * half));
        double least = INFINITY;
        for (k = 0; k < instance->walls; k++) {
            const struct wall *wall = &instance->known[k];
            for (look = 1; look <= looks; look++) {
                const double share = (double)look / looks;
                const double at[2] = {place[i][0] + share * (place[i + 1][0] - place[i][0]),
                    place[i][1] + share * (place[i + 1][1] - place[i][1])};
                const double x = at[0] - wall->at[0][0], y = at[1] - wall->at[0][1];
                double far = -INFINITY;
                int e;
                for (e = 0; e < wall->corners; e++) { /* one edge that keeps them apart is enough */
                    const double ahead = (x - (wall->at[e][0] - wall->at[0][0])) * wall->normals[e][0]
                        + (y - (wall->at[e][1] - wall->at[0][1])) * wall->normals[e][1];
                    far = fmax(far, ahead);
                }
                if (far > half + 1e-9) continue;
                least = fmin(least,
                    wb_separation(at, (const double (*)[2])wall->at, wall->corners, NULL) - half);
            }
        }
        if (least < -fmax(0.0, cut)) depth[i] = -least;
    }
}

void wb_verify(struct wideberth_planner *planner, const struct point *point, const double *touch,
    struct violation *found)
{
    const struct instance *instance = &planner->instance;
    int i, k, sound = 1;
    memset(found, 0, sizeof(*found));
    motion_of(instance, point, found->motion);
    for (i = 0; i < N; i++) sound = sound && isfinite(found->motion[i]);
    sound = wb_entered(instance, point, point->level, found->regions) && sound;
    for (i = 0; !sound && i < N; i++) {
        found->motion[i] = INFINITY;
        for (k = 0; k < SLOTS; k++) found->regions[i][k] = 0.0;
    }
    if (touch)
        memcpy(found->touch, touch, sizeof(found->touch));
    else
        touched(instance, point, found->touch);
    found->in_contact = instance->contact.there && finite_states(point);
    if (found->in_contact) wb_pressed(instance, point, &planner->scratch, found->pressed);
}

double wb_largest_motion(const struct violation *found)
{
    double worst = 0.0;
    int i;
    for (i = 0; i < N; i++) worst = fmax(worst, found->motion[i]);
    return worst;
}

double wb_worst(const struct violation *found)
{
    double worst = wb_largest_motion(found);
    int i, k;
    for (i = 0; i < N; i++) {
        for (k = 0; k < SLOTS; k++) worst = fmax(worst, found->regions[i][k]);
        worst = fmax(worst, fmax(found->touch[i], found->pressed[i]));
    }
    return worst;
}

static double sum(const double *values)
{
    double total = 0.0;
    int i;
    for (i = 0; i < N; i++) total += values[i];
    return total;
}

double wb_total(const struct violation *found)
{
    double each[N];
    int i, k;
    for (i = 0; i < N; i++) {
        double deepest = 0.0;
        for (k = 0; k < SLOTS; k++) deepest = fmax(deepest, found->regions[i][k]);
        each[i] = deepest + found->touch[i];
    }
    return sum(each);
}

double wb_touched_or_near(const struct instance *instance, const struct candidate *one, int window)
{
    double worst = 0.0, pose[3];
    int i, k;
    for (i = 0; i < N && i < window; i++) {
        wb_pose(one->point.states[i + 1], pose);
        for (k = 0; k < instance->obstacles; k++) {
            const double x = pose[0] - instance->means[i][k][0];
            const double y = pose[1] - instance->means[i][k][1];
            worst = fmax(worst, PLAN_ROOM + instance->radii[k] - sqrt(x * x + y * y));
        }
        for (k = KO; k < SLOTS; k++) worst = fmax(worst, one->found.regions[i][k]);
        worst = fmax(worst, one->found.touch[i]);
    }
    return worst;
}

/* Objective at a point that keeps every region. */
double wb_price(const struct instance *instance, const struct point *point)
{
    const wideberth_problem *problem = &instance->problem;
    double v[2 * NX + NU], p[5], each[N], total;
    int i;
    for (i = 0; i < N; i++) {
        memcpy(v, point->states[i], sizeof(point->states[0]));
        memcpy(v + NX, point->inputs[i], sizeof(point->inputs[0]));
        memcpy(v + NX + NU, point->states[i + 1], sizeof(point->states[0]));
        memcpy(p, problem->reference[i], sizeof(problem->reference[i]));
        memcpy(p + 2, problem->direction[i], sizeof(problem->direction[i]));
        p[4] = problem->speed[i];
        wb_column(wideberth_plan_price, v, p, &each[i]);
#if WIDEBERTH_POLYGONS > 0
        {
            int k;
            for (k = 0; k < instance->polygons; k++) {
                const double off = point->own[i][k][0] - problem->polygons.auxiliaries[i][k][0];
                each[i] += PLAN_REGULARISATION * off * off;
            }
        }
#endif
    }
    total = sum(each);
    if (WIDEBERTH_SHARED_LEVEL) {
        const double off = point->level - (instance->obstacles ? PLAN_LEVELS[0] : 0.0);
        total += PLAN_LEVEL_WEIGHT * off * off;
    }
    return total;
}

/* ---- The rule of contact: to stop, or to leave who is touched, and never faster than now */

static void moved(const struct contact *contact, double (*states)[NX], double (*inputs)[NU],
    struct moved *found, double (*towards)[PLAN_MOST], double (*depth)[PLAN_MOST])
{
    const double none[NU] = {0.0};
    double pose[3], before[3] = {0.0, 0.0, 0.0}, twist[3];
    int i, c;
    wb_twist(states[0], none, twist);
    found->begin = hypot(twist[0], twist[1]);
    for (i = 0; i <= N; i++) {
        wb_pose(states[i], pose);
        for (c = 0; c < contact->count; c++) {
            const double x = contact->places[c][0] - pose[0], y = contact->places[c][1] - pose[1];
            depth[i][c] = PLAN_RADIUS + contact->radii[c] - sqrt(x * x + y * y);
        }
        if (i) {
            const double way[2] = {pose[0] - before[0], pose[1] - before[1]};
            wb_twist(states[i], inputs[i - 1], twist);
            found->speed[i - 1] = hypot(twist[0], twist[1]);
            found->turn[i - 1] = fabs(twist[2]);
            found->length[i - 1] = sqrt(way[0] * way[0] + way[1] * way[1]);
            for (c = 0; towards && c < contact->count; c++)
                towards[i - 1][c] = way[0] * (contact->places[c][0] - before[0])
                    + way[1] * (contact->places[c][1] - before[1]);
        }
        memcpy(before, pose, sizeof(before));
    }
}

void wb_pressed(const struct instance *instance, const struct point *point, struct scratch *scratch,
    double *pressed)
{
    const struct contact *rule = &instance->contact;
    struct moved found;
    double states[N + 1][NX], inputs[N][NU];
    int i, c, held = 1;
    memcpy(states, point->states, sizeof(states)), memcpy(inputs, point->inputs, sizeof(inputs));
    moved(rule, states, inputs, &found, scratch->towards, scratch->depth);
    for (i = 0; i < N; i++) {
        const double length = found.length[i];
        const double slow = (PLAN_LEAVING + PLAN_OF_SOLVERS) * WIDEBERTH_DT;
        const double share = length <= slow ? PLAN_SLOWLY : PLAN_ONWARD;
        double broken = found.speed[i] - fmax(rule->fastest, rule->braking.speed[i]), deeper = 0.0;
        int onward = rule->placeless > 0, touching = rule->placeless > 0;
        for (c = 0; c < rule->count; c++) {
            const double room = (1.0 - 2.0 * share) * rule->radii[c] + PLAN_TOUCHING;
            onward = onward || room * length + scratch->towards[i][c] > 0.0;
            deeper = fmax(deeper, scratch->depth[i + 1][c]
                    - fmax(scratch->depth[i][c], rule->braking_depth[i + 1][c]));
            touching = touching || scratch->depth[i][c] >= -PLAN_TOUCHING;
        }
        broken = fmax(broken, onward ? length - rule->braking.length[i] : 0.0);
        broken = fmax(broken, deeper);
        if (rule->placeless) broken = fmax(broken, found.turn[i] - rule->braking.turn[i]);
        held = held && touching;
        pressed[i] = held && broken > PLAN_OF_SOLVERS ? broken : 0.0;
    }
}

/* Where an obstacle is expected as the plan begins. */
static void expected(const struct wideberth_planner *planner, int k, double lag, double *place)
{
    const double *newest = wb_newest(&planner->tracks, planner->tracks.of[k]);
    const double (*mean)[2] = (const double (*)[2])planner->forecast.mean[k];
    const double share = fmin(fmax(lag / (lag + WIDEBERTH_DT), 0.0), 1.0);
    int r;
    for (r = 0; r < 2; r++)
        place[r] = newest ? (1.0 - share) * newest[r] + share * mean[0][r]
                          : 2.0 * mean[0][r] - mean[N > 1][r];
}

void wb_contact(struct wideberth_planner *planner, const wideberth_observation *seen,
    const double *start)
{
    struct contact *contact = &planner->instance.contact;
    const double lag = seen->stamp - planner->tracks.stamp;
    struct scratch *scratch = &planner->scratch;
    double pose[3];
    int k;
    contact->count = 0, contact->placeless = planner->history.placeless;
    wb_pose(start, pose);
    for (k = 0; k < planner->tracks.count; k++) {
        double place[2], x, y;
        expected(planner, k, lag, place);
        x = place[0] - pose[0], y = place[1] - pose[1];
        if (!(PLAN_RADIUS + planner->tracks.of[k]->radius - sqrt(x * x + y * y) >= -PLAN_TOUCHING))
            continue;
        memcpy(contact->places[contact->count], place, sizeof(place));
        contact->radii[contact->count++] = planner->tracks.of[k]->radius;
    }
    contact->there = contact->count > 0 || contact->placeless > 0;
    if (!contact->there) return;
    wb_brake(start, scratch->way_states[0], scratch->way_inputs[0]);
    moved(contact, scratch->way_states[0], scratch->way_inputs[0], &contact->braking, NULL,
        contact->braking_depth);
    contact->fastest = fmax(contact->braking.begin, PLAN_LEAVING);
}
