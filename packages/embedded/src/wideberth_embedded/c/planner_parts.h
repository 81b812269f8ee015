/* What the files of the planner have in common: numbers, structures, and who computes what. */
#ifndef WIDEBERTH_PLANNER_PARTS_H
#define WIDEBERTH_PLANNER_PARTS_H

#include "wideberth_planner.h"

#include <math.h>
#include <stdint.h>

#include "problem.h"

#include "wideberth_planner_tables.h"

enum {
    N = WIDEBERTH_HORIZON,
    NX = WIDEBERTH_STATES,
    NU = WIDEBERTH_INPUTS,
    KO = WIDEBERTH_OBSTACLES,
    KP = WIDEBERTH_POLYGONS,
    WALLS = KP ? WIDEBERTH_WALLS : 1,
    SLOTS = KO + KP,
    CORNERS = WIDEBERTH_CORNERS,
    POINTS = WIDEBERTH_PATH_POINTS,
    ALL_WAYS = 19, /* to stop: straight on, and six ways out for three durations */
    ALL_STARTS = 9 /* the last plan, and every other that can be named */
};

#define PLAN_FORGET WIDEBERTH_PLAN_FORGET
#define TOLERANCE WIDEBERTH_PLAN_TOLERANCE
#define PI 3.14159265358979323846

struct scratch;

/* ---- Tracks: what was measured of whom */

struct belief { /* Kalman state of an obstacle; see planner_forecast.c */
    double time;                       /* s, of its newest measurement; -INFINITY without one */
    double state[4], covariance[4][4]; /* position, velocity */
};

struct log {
    char name[WIDEBERTH_NAME];
    double place[2];                        /* of the newest measurement */
    struct belief now, before;              /* with the newest measurement, and without it */
    double reported, radius, covariance[4]; /* of the last report */
    size_t stem; /* length of the identity that another obstacle had before; 0 where none had */
    int unnamed, claimed;
};

struct history {
    int count;
    struct log logs[2 * PLAN_MOST]; /* in the order in which they came */
    double stamp;                   /* of the last observation; -INFINITY before */
    int placeless;                  /* how many were seen without a place */
    int shared, born;               /* identities of several obstacles; unnamed obstacles */
    char names[PLAN_MOST][WIDEBERTH_NAME];
};

struct tracks {
    int count;
    double stamp; /* of the newest measurement of all */
    const struct log *of[PLAN_MOST]; /* by name */
};

/* Take note of what is seen; `here` is the robot's place, or NULL. */
void wb_take(struct history *history, const wideberth_observation *seen, const double *here,
    struct scratch *scratch);
void wb_tracks(const struct history *history, struct tracks *tracks);

/* Eigenvalues, the larger first, and as columns the vectors of [[a, b], [b, c]]. */
void wb_axes(const double *matrix, double *values, double *vectors);

/* ---- Forecast */

struct forecast {
    double mean[PLAN_MOST][N][2], covariance[PLAN_MOST][N][4];
};

/* Update a belief with a position that was measured later than all others. */
void wb_filter(struct belief *belief, double time, const double *place, const double *covariance);

/* Forecast at the plan's steps 1..N; `first` is the time of the plan's first state. */
void wb_forecast(const struct tracks *tracks, double first, struct forecast *forecast);

/* Newest position of an obstacle that was measured at the newest instant of all; else NULL. */
const double *wb_newest(const struct tracks *tracks, const struct log *log);

/* Call a function of problem.c for one column. */
void wb_column(wb_function *function, const double *v, const double *p, double *out);

/* ---- Motion of the robot, without solving anything */

void wb_pose(const double *state, double *pose);                        /* x, y, heading */
void wb_twist(const double *state, const double *input, double *twist); /* linear, linear, yaw */
void wb_drive(const double *state, const double *twist, double *input);
void wb_next(const double *state, const double *input, double *next);
void wb_attained(const double *last, const double *wanted, double duration, double *twist);
void wb_follow(const double *start, double (*inputs)[NU], double (*states)[NX]);
void wb_clip_inputs(double (*inputs)[NU]);
void wb_within_bounds(const double *state, double *found);

/* Hold one twist for some steps, then another. */
void wb_steer(const double *start, const double *first, int count, const double *second,
    double (*states)[NX], double (*inputs)[NU]);
void wb_brake(const double *start, double (*states)[NX], double (*inputs)[NU]);
void wb_sweep(const double *start, int name, double speed, const double *now, double *twist);
void wb_shift(double (*inputs)[NU], double share, double (*found)[NU]);

struct instance;

/* States on the reference, and the inputs that bring each twist to the next. */
int wb_faces_away(const wideberth_problem *problem);
int wb_turn(const wideberth_problem *problem, double *spin);
void wb_laid(const wideberth_problem *problem, double (*states)[NX], double (*inputs)[NU]);

/* Ways to stop, straight on first; returns how many there are. */
int wb_stops(const double *start, double fastest, double (*states)[N + 1][NX],
    double (*inputs)[N][NU]);

void wb_limited(const double *state, const double *input, wideberth_command *command);

/* ---- Walls */

struct wall {
    int corners;
    double at[CORNERS][2]; /* counter-clockwise */
    double normals[CORNERS][2];
};

/* Returns 0 where the polygon is no convex one of enough width. */
int wb_wall(const wideberth_polygon *given, struct wall *wall);
double wb_separation(const double *place, const double (*at)[2], int corners, double *normal);

/* ---- The plan */

struct point {
    double states[N + 1][NX], inputs[N][NU], slack[N];
    double level;
#if WIDEBERTH_POLYGONS > 0
    double own[N][KP][WIDEBERTH_POLYGON_AUXILIARIES];
#endif
};

struct kept { /* multipliers of the last plan, and whose they are */
    int known, obstacles, polygons;
    double level;
    char names[KO][WIDEBERTH_NAME];
    double steps[N][PLAN_MULTIPLIERS], slots[N][KO][PLAN_OBSTACLE_MULTIPLIERS];
};

struct violation {
    double motion[N], regions[N][SLOTS], touch[N], pressed[N];
    int in_contact; /* whether the rule of contact was looked at */
};

struct candidate {
    struct point point;
    struct violation found;
    int status, iterations, solved, way; /* way -1: no manoeuvre */
    double cost;
    int multipliers; /* whether there are some */
    double steps[N][PLAN_MULTIPLIERS], slots[N][KO][PLAN_OBSTACLE_MULTIPLIERS];
};

struct moved { /* how a robot moves past those in contact */
    double begin, speed[N], turn[N], length[N];
};

struct contact {
    int there, count, placeless;
    double places[PLAN_MOST][2], radii[PLAN_MOST], fastest;
    struct moved braking;
    double braking_depth[N + 1][PLAN_MOST];
};

struct instance {
    wideberth_problem problem;
    int obstacles, polygons;           /* slots in use */
    char names[KO][WIDEBERTH_NAME];    /* of the obstacles' slots */
    double means[N][KO][2], radii[KO]; /* of the obstacles that have a slot */
    int walls;
    struct wall known[WALLS]; /* all of them */
    int last;                 /* whether there are inputs of the last plan */
    double last_inputs[N][NU];
    struct contact contact;
    double target; /* s_ref; NAN where none is shared */
    int left_out;
};

struct outcome {
    int count, in_the_way, before, iterations;
    struct candidate candidates[ALL_STARTS];
};

struct given { /* to the solver beside a problem, and its multipliers */
    double steps_before[N][PLAN_MULTIPLIERS], steps_after[N][PLAN_MULTIPLIERS];
    double obstacles_before[N][KO][PLAN_OBSTACLE_MULTIPLIERS];
    double obstacles_after[N][KO][PLAN_OBSTACLE_MULTIPLIERS];
#if WIDEBERTH_POLYGONS > 0
    double polygons_before[N][KP][PLAN_POLYGON_MULTIPLIERS];
    double polygons_after[N][KP][PLAN_POLYGON_MULTIPLIERS];
#endif
    double plans[PLAN_MOST_PLANS][N + 1][NX];
};

struct scratch {
    int order[WIDEBERTH_DETECTIONS];
    double away[WIDEBERTH_DETECTIONS], wall_away[WALLS];
    wideberth_detection seen[WIDEBERTH_DETECTIONS];
    double place[PLAN_MOST][N][2], spread[PLAN_MOST][N][4];
    struct candidate drivable[ALL_STARTS], ways[ALL_WAYS];
    double way_states[ALL_WAYS][N + 1][NX], way_inputs[ALL_WAYS][N][NU];
    struct candidate one;
    struct point starts[ALL_STARTS], aimed;
    struct violation entered;
    double towards[N][PLAN_MOST], depth[N + 1][PLAN_MOST];
    struct given given;
    wideberth_task task;
    wideberth_result result;
    double memory[WIDEBERTH_MEMORY / sizeof(double)];
};

struct progress { /* how far along the path the robot has come, and where it was then */
    int begun, grown; /* whether there was a call, and whether the arc length has grown since */
    int waited;       /* calls since it has grown beyond `farthest` */
    double last, where[2], farthest, begin; /* the search does not go behind `begin` */
};

enum { REFERENCE, APPROACH, ARRIVAL, PROGRESSES }; /* who follows it along the path */

struct path {
    int count;
    double at[POINTS][2], arc[POINTS];
    struct progress progress[PROGRESSES];
    int there;  /* whether the robot was at the path's end */
    double goal[2]; /* where that was */
};

struct wideberth_planner {
    uint64_t build;
    struct path path;
    int holds; /* whether it rests at `hold` while a body stands on its goal */
    double hold[2];
    struct history history;
    struct tracks tracks;
    struct forecast forecast;
    int has_plan;
    double plan_stamp, plan_inputs[N][NU];
    struct kept kept;
    int obstacle_in_way;
    struct instance instance;
    struct outcome outcome;
    struct scratch scratch;
};

/* Fill the problem of one decision; the first starting point is written to `first`. */
void wb_fill(struct wideberth_planner *planner, const wideberth_observation *seen,
    const double *start, double arc, struct point *first);
double wb_progressed(const struct path *path, struct progress *progress, const double *place);
double wb_advanced(struct path *path, const double *place);
void wb_lay(const struct path *path, double arc, wideberth_problem *problem);
/* Whether a robot at a place rests there, or goes on resting, since its goal is taken. */
void wb_hold(struct wideberth_planner *planner, const wideberth_observation *seen, double arc,
    const double *place);
/* The yaw rate that a robot near the end of its path still has a reason for. */
double wb_turning(double away, double speed, double rate);

/* Own variables that suit the poses of a point best. */
void wb_suit(const struct instance *instance, struct point *point);

/* Verify. */
void wb_verify(struct wideberth_planner *planner, const struct point *point, const double *touch,
    struct violation *found);
int wb_entered(const struct instance *instance, const struct point *point, double level,
    double (*regions)[SLOTS]);
double wb_worst(const struct violation *found);
double wb_total(const struct violation *found);
double wb_largest_motion(const struct violation *found);
double wb_touched_or_near(const struct instance *instance, const struct candidate *one, int window);
double wb_price(const struct instance *instance, const struct point *point);

/* The rule of contact. */
void wb_contact(struct wideberth_planner *planner, const wideberth_observation *seen,
    const double *start);
void wb_pressed(const struct instance *instance, const struct point *point, struct scratch *scratch,
    double *pressed);

/* Solve from one start or several, and take the first rung that holds. */
void wb_multistart(struct wideberth_planner *planner, struct point *first, int warm);
const struct candidate *wb_choose(struct wideberth_planner *planner, int *rung);

#endif
