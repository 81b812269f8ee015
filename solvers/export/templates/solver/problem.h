/* {{ source }}: the problem as riccati.h takes it, for callers that want more than
 * wideberth_solver.h has. Made by wideberth. */
#ifndef WIDEBERTH_PROBLEM_H
#define WIDEBERTH_PROBLEM_H

#include "riccati.h"
#include "wideberth_solver.h"

#define WIDEBERTH_HEAD {{ head }} /* parameters of a step that belong to no slot */
{% for name, value, text in rows %}
#define WIDEBERTH_{{ name }} {{ value }} /* {{ text }} */
{% endfor %}

wb_function {{ kernels|join(",\n    ") }};

/* A kind of slots beside what wb_kind has of it. */
typedef struct {
    const double *aim;   /* (N,), level of a step */
    const double *begin; /* own variables at the start */
    wb_function *set;    /* (mean, covariance, radius) -> parameters; NULL: the caller fills them */
    wb_function *check;  /* (x, a, s), numbers -> h, e */
} wideberth_kind;

extern const wb_problem wideberth_core;
extern const wb_settings wideberth_settings; /* without the guess of the level */
extern const wideberth_kind wideberth_kinds[WIDEBERTH_KINDS];

/* All that wb_solve takes; a caller may change it between the two functions. */
typedef struct {
    wb_settings settings;
    wb_start start;
    wb_result result;
    wb_slots slots[WIDEBERTH_KINDS];
    double head[WIDEBERTH_HORIZON][WIDEBERTH_HEAD];
    double states[WIDEBERTH_HORIZON + 1][WIDEBERTH_STATES];
} wideberth_task;

/* Where the numbers of the slots stand. */
void wideberth_slots(const wideberth_problem *problem, const wideberth_result *result,
    wb_slots *slots);

/* Fill in a task, and solve it in `size` bytes of memory. */
void wideberth_prepare(const wideberth_problem *problem, wideberth_result *result,
    wideberth_task *task);
int wideberth_run(const wideberth_problem *problem, wideberth_task *task, double *memory,
    size_t size, wideberth_result *result);

#endif
