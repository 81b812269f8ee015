/* {{ source }}: the planner's optimisation problem as C.
 *
 *   minimise    sum_{i=0..N-1} input_cost(x_i, u_i, stage_{i+1})
 *             + sum_{i=1..N}   state_cost(x_i, stage_i) + WIDEBERTH_PENALTY * slack_i
 *                              + regularisation * |auxiliaries_i - their guesses|^2
 *             + level_cost(level, target)
 *   subject to  x_{i+1} = dynamics(x_i, u_i),  input_constraints(x_i, u_i) >= 0,  i = 0..N-1
 *               state_constraints(x_i) >= 0,                                   i = 1..N
 *               inequalities of every slot at x_i + slack_i >= 0,  equalities == 0,  i = 1..N
 *               terminal_constraints(x_N) >= 0,  and the bounds below
 *
 * SI units and radians. Every argument is a vector of doubles, also where it has one entry;
 * NULL stands for one without entries. Matrices are dense and stand column by column. No
 * function keeps a state, allocates or fails. Made by wideberth; edit the config, not this file.
 */
#ifndef WIDEBERTH_H
#define WIDEBERTH_H

#include <math.h> /* INFINITY */

#ifdef __cplusplus
extern "C" {
#endif

/* Sizes and places. */
{% for name, value, text in constants %}
#define WIDEBERTH_{{ name }} {{ value|in_brackets }} /* {{ text }} */
{% endfor %}

/* Begin of slot k among the numbers of a stage, and of stage i = 1..N among the parameters. */
{% for name in slots %}
#define WIDEBERTH_STAGE_{{ name }}(k) (WIDEBERTH_STAGE_{{ name }}S + (k) * WIDEBERTH_{{ name }}_SIZE)
{% endfor %}
#define WIDEBERTH_PARAMETER_STAGE(i) \
    (WIDEBERTH_PARAMETER_STAGES + ((i) - 1) * WIDEBERTH_STAGE_SIZE)

/* Numbers. */
{% for name, value, text in numbers %}
#define WIDEBERTH_{{ name }} {{ value|number|in_brackets }} /* {{ text }} */
{% endfor %}

/* Bounds of states and inputs, of auxiliaries per slot, and of the NLP. */
{% for name, _ in bounds %}
extern const double wideberth_{{ name }}[];
{% endfor %}

/* Where the pieces of stage i = 0..N begin among variables and rows; -1: nowhere. */
{% for name, _, text in tables %}
extern const int wideberth_{{ name }}[]; /* {{ text }} */
{% endfor %}

/* Nonzeros: column k holds those from columns[k] to columns[k + 1] - 1. */
{% for name, _ in sparsity %}
extern const int wideberth_{{ name }}[];
{% endfor %}

/* Functions of one stage. */
{% for routine in stage %}
{{ routine|declaration }}
{% endfor %}

/* The whole problem as one NLP (wideberth_nlp.c), f over g within its bounds. */
{% for routine in flat %}
{{ routine|declaration }}
{% endfor %}

#ifdef __cplusplus
}
#endif

#endif
