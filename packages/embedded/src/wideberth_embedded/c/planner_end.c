/* The end of a path: how fast a robot may approach it, when it is there, and how it turns there. What
 * wideberth.framework.control.end_of_path does in Python; the limits come from there. */
#include "planner_parts.h"

#include <math.h>
#include <string.h>

static int computable(const double *place)
{
    return fabs(place[0]) <= PLAN_FARTHEST && fabs(place[1]) <= PLAN_FARTHEST;
}

/* The way from a place to the path's end, and what is left of the path there. */
static double left_of(struct path *path, int who, const double *place, double *away)
{
    const double *goal = path->at[path->count - 1];
    away[0] = goal[0] - place[0], away[1] = goal[1] - place[1];
    return path->arc[path->count - 1] - wb_progressed(path, &path->progress[who], place);
}

double wb_turning(double away, double speed, double rate)
{
    const double most = PLAN_END_YAW_RATE * fmax(away, PLAN_END_STEP * speed) / PLAN_END_NEAR;
    return PLAN_END_YAW_RATE > 0.0 ? copysign(fmin(fabs(rate), most), rate) : rate;
}

void wb_hold(struct wideberth_planner *planner, const wideberth_observation *seen, double arc,
    const double *place)
{
    const struct path *path = &planner->path;
    const double *goal = path->at[path->count - 1];
    const int held = planner->holds;
    int k;
    planner->holds = 0;
    if (arc < path->arc[path->count - 1] - PLAN_END_LEFT
        || path->progress[REFERENCE].waited < PLAN_PATIENCE)
        return;
    for (k = 0; k < seen->obstacles; k++) {
        const wideberth_detection *body = &seen->detections[k];
        if (hypot(body->position[0] - goal[0], body->position[1] - goal[1])
            < PLAN_ROOM + body->radius)
            planner->holds = 1;
    }
    if (planner->holds && !held) memcpy(planner->hold, place, sizeof(planner->hold));
}

int wideberth_planner_approach(wideberth_planner *planner, const double *pose,
    const double *wanted, double *limited)
{
    double away[2], left, apart, most, speed, heading, across;
    if (!planner || !pose || !wanted || !limited) return WIDEBERTH_PLAN_NULL;
    if (planner->build != WIDEBERTH_BUILD) return WIDEBERTH_PLAN_OTHER_BUILD;
    if (!planner->path.count) return WIDEBERTH_PLAN_NO_PATH;
    memmove(limited, wanted, 3 * sizeof(double));
    speed = hypot(limited[0], limited[1]);
    if (!computable(pose)) return WIDEBERTH_PLANNED;
    left = left_of(&planner->path, APPROACH, pose, away);
    apart = hypot(away[0], away[1]);
    most = sqrt(2.0 * PLAN_END_BRAKING * fmax(apart, left));
    if (left <= PLAN_END_LEFT && PLAN_END_TURNING > 0.0) {
        heading = atan2(limited[1], limited[0]) + pose[2];
        across = fabs(cos(heading) * away[1] - sin(heading) * away[0]);
        if (across > 0.0) most = fmin(most, 0.5 * PLAN_END_TURNING * apart * apart / across);
    }
    if (speed > most) limited[0] *= most / speed, limited[1] *= most / speed;
    if (left <= PLAN_END_LEFT) limited[2] = wb_turning(apart, fmin(speed, most), limited[2]);
    return WIDEBERTH_PLANNED;
}

int wideberth_planner_arrived(wideberth_planner *planner, const double *place, double tolerance)
{
    struct path *path;
    double away[2], left;
    const double *goal;
    if (!planner || !place || planner->build != WIDEBERTH_BUILD || !planner->path.count) return 0;
    path = &planner->path, goal = path->at[path->count - 1];
    if (!computable(place)) return path->there = 0;
    path->there = path->there
        && hypot(goal[0] - path->goal[0], goal[1] - path->goal[1]) <= PLAN_END_SHIFT;
    memcpy(path->goal, goal, sizeof(path->goal));
    left = left_of(path, ARRIVAL, place, away);
    path->there = hypot(away[0], away[1]) <= (1.0 + path->there) * tolerance
        && left <= PLAN_END_LEFT;
    return path->there;
}

double wideberth_spin_rate(double off, double period)
{
    const double most = fmin(PLAN_END_YAW_ACCELERATION, PLAN_END_YAW_RATE / period);
    return copysign(fmin(sqrt(most * fabs(off)), 0.25 * fabs(off) / period), off);
}

void wideberth_next_velocity(const double *last, const double *wanted, double period,
    double *velocity)
{
    wb_attained(last, wanted, period, velocity);
}
