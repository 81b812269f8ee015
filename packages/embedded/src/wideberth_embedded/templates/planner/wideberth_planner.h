/* {{ source }}: the whole planner without Python.
 *
 *   cc -O3 loop.c wideberth_planner.c planner_*.c wideberth_solver.c problem.c riccati.c -lm
 *
 * Give it wideberth_planner_size() bytes, a path, and each period what is seen: it answers with the
 * command of Python's planner. It forecasts obstacles with a Kalman filter, chooses those that get a
 * slot, solves from several starts, verifies, and falls back where no plan is found. After
 * wideberth_planner_begin it allocates nothing; a decision takes a bounded number of operations. Two
 * planners share nothing and may decide in two threads at once; one planner is called by one thread
 * at a time. SI units and radians, one frame for state, path, obstacles and walls. Made by
 * wideberth; edit the config, not this file.
 */
#ifndef WIDEBERTH_PLANNER_H
#define WIDEBERTH_PLANNER_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

{% for one in sizes %}
{{ one|define }}
{% endfor %}

/* What each entry of a state is. */
{% for one in entries %}
{{ one|define }}
{% endfor %}

/* Numbers of the planner. */
{% for name, value, text in numbers %}
{{ (name, value|number, text)|define }}
{% endfor %}

enum wideberth_plan_status {
{% for name, text in statuses %}
    WIDEBERTH_{{ name }}, /* {{ text }} */
{% endfor %}
    WIDEBERTH_PLAN_STATUSES
};

enum wideberth_rung {
{% for name, text in rungs %}
    WIDEBERTH_{{ name }}, /* {{ text }} */
{% endfor %}
    WIDEBERTH_RUNGS
};

typedef struct {
    char name[WIDEBERTH_NAME]; /* stable identity, ended by a zero */
    double position[2];        /* m */
    double covariance[4];      /* m^2, of the measured position, row by row */
    double radius;             /* m, of the disc that encloses it */
    double age;                /* s, how long ago it was measured; what is older than the newest
                                * measurement of this name is a report alone: the place is not used */
} wideberth_detection;

typedef struct {
    int corners;                        /* 3 to WIDEBERTH_CORNERS */
    double at[WIDEBERTH_CORNERS][2];    /* m, a convex polygon, in either orientation */
} wideberth_polygon;

typedef struct {
    double stamp;        /* s */
    const double *state; /* WIDEBERTH_PLAN_STATES numbers, the robot's own estimate */
    int obstacles;       /* those seen now; a missing one was not seen */
    const wideberth_detection *detections;
    int polygons; /* all that stands still, at most WIDEBERTH_WALLS */
    const wideberth_polygon *walls;
} wideberth_observation;

typedef struct {
    double linear[2]; /* m/s: (vx, vy) in the body frame */
    double omega;     /* rad/s */
    double ramp;      /* s, in which it should be reached; 0 at once */
} wideberth_command;

typedef struct {
    wideberth_command command; /* within the robot's limits, whatever the status */
    int status;                /* WIDEBERTH_PLANNED, ... */
    int rung;                  /* of the fallback ladder, WIDEBERTH_OPTIMAL, ... */
    int iterations, starts;    /* of the solver, and how many plans were verified */
    int left_out;              /* obstacles and walls within reach that got no slot */
    double violation;          /* largest of the plan taken */
    double level, cost;        /* shared level of the plan; NAN where none is */
    double states[WIDEBERTH_PLAN_HORIZON + 1][WIDEBERTH_PLAN_STATES];
    double inputs[WIDEBERTH_PLAN_HORIZON][WIDEBERTH_PLAN_INPUTS];
    char reason[160];
} wideberth_decision;

typedef struct wideberth_planner wideberth_planner;

/* Bytes that a planner takes, aligned as for a double. */
size_t wideberth_planner_size(void);

/* All of these return a status, WIDEBERTH_PLANNED if all is well. */
#define wideberth_planner_begin(memory, size, planner) \
    wideberth_planner_begin_as((memory), (size), WIDEBERTH_PLAN_BUILD, (planner))
int wideberth_planner_begin_as(void *memory, size_t size, uint64_t build,
    wideberth_planner **planner);

/* Follow this path from now on; what is known of obstacles is kept. The points are copied; those
 * that repeat the one before are left out. */
int wideberth_planner_set_path(wideberth_planner *planner, const double (*points)[2], int count);

/* The same path in another frame, as many points: how far the robot has come is kept. */
int wideberth_planner_move_path(wideberth_planner *planner, const double (*points)[2], int count);

/* Take note of what is seen without deciding anything. */
int wideberth_planner_remember(wideberth_planner *planner, const wideberth_observation *seen);

/* Decide. Whatever the status, the decision holds a command that is safe to execute, unless an
 * argument is NULL or the planner is none of this export's. */
int wideberth_planner_decide(wideberth_planner *planner, const wideberth_observation *seen,
    wideberth_decision *decision);

/* Forget everything but the path. */
void wideberth_planner_reset(wideberth_planner *planner);

/* Between two decisions, each period of the commands. Velocities are (vx, vy) in m/s, in the body
 * frame, and the yaw rate in rad/s. */

/* Slow a wanted velocity down near the end of the path, so that the robot neither passes the end nor
 * circles it; `pose` is x, y and heading. */
int wideberth_planner_approach(wideberth_planner *planner, const double *pose,
    const double *wanted, double *limited);

/* Whether a robot at a place is within a tolerance in m of the path's end. It stays there up to
 * twice the tolerance, until a path to another end comes; it should brake, and turn. */
int wideberth_planner_arrived(wideberth_planner *planner, const double *place, double tolerance);

/* Yaw rate of a robot that stands and has to turn by an angle of at most pi, commanded each `period`
 * seconds. */
double wideberth_spin_rate(double off, double period);

/* The velocity that the robot can have a period after the last one. */
void wideberth_next_velocity(const double *last, const double *wanted, double period,
    double *velocity);

typedef struct {
    const unsigned char *cells; /* row by row from the origin on, as in Nav2's Costmap2D */
    int width, height;
    double resolution, origin[2]; /* m */
    int occupied;                 /* least value of a cell that is a wall, 254 of Nav2's */
    int unknown;                  /* value that says nothing, 255 of Nav2's; -1 for none */
} wideberth_costmap;

/* Walls of a costmap: rectangles of occupied cells, of which the `most` nearest to a place are kept.
 * `taken` is room for width * height bytes. Returns how many rectangles there are, which may be more
 * than `most`; -1 for an argument of no use. Hand over raw obstacles: an inflated costmap would add
 * the robot's radius twice. */
int wideberth_walls_of(const wideberth_costmap *map, const double *near, unsigned char *taken,
    wideberth_polygon *walls, int most);

/* Words; also for numbers that are none of these. */
const char *wideberth_planner_status_text(int status);
const char *wideberth_rung_text(int rung);

#ifdef __cplusplus
}
#endif

#endif
