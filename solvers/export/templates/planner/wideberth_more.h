/* What the planner hands to the solver beside the problem: multipliers of the last plan, plans from
 * other starts, and what becomes of them. Made by wideberth. */
#ifndef WIDEBERTH_MORE_H
#define WIDEBERTH_MORE_H

#include "wideberth_solver.h"

{% for name, value, text in sizes %}
{{ (name, value, text)|define }}
{% endfor %}

enum { WIDEBERTH_SAME = WIDEBERTH_STATUSES, WIDEBERTH_DEARER }; /* given up */

typedef struct {
    double warm, known, best, within, iterations; /* settings of one solve */
    int outcome; /* a status, before slack that is paid for counts as solved */
    double steps_before[WIDEBERTH_HORIZON][WIDEBERTH_MULTIPLIERS];
    double steps_after[WIDEBERTH_HORIZON][WIDEBERTH_MULTIPLIERS];
    double plans[WIDEBERTH_MOST_PLANS][WIDEBERTH_HORIZON + 1][WIDEBERTH_STATES];
{% for one in slots %}
{% set upper = "WIDEBERTH_" ~ one.name|upper %}
    double {{ one.name }}s_before[WIDEBERTH_HORIZON][{{ upper }}S][{{ upper }}_MULTIPLIERS];
    double {{ one.name }}s_after[WIDEBERTH_HORIZON][{{ upper }}S][{{ upper }}_MULTIPLIERS];
{% if one.auxiliary|length %}
    double {{ one.name }}s_begun[WIDEBERTH_HORIZON][{{ upper }}S][{{ upper }}_AUXILIARIES];
{% endif %}
{% endfor %}
} wideberth_more;

/* Solve as wideberth_solve does; polygons' multipliers are taken from nowhere. */
int wideberth_solve_more(const wideberth_problem *problem, wideberth_more *more, void *memory,
    size_t size, wideberth_result *result);

/* Sum as NumPy does it, which adds eight at a time. */
double wideberth_sum(const double *values, int count);

#endif
