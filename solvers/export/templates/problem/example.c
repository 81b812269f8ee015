/* Evaluates every function for one recorded instance and compares with Python's values.
 * total_cost and all_rows show how the functions of one stage make up the whole problem. */
#include "wideberth.h"

#include <math.h>
#include <stdio.h>

#include "example_data.h"

#define STAGE(i) (parameters + WIDEBERTH_PARAMETER_STAGE(i))
#define STATE(i) ((i) ? variables + wideberth_nlp_states[i] : parameters)
#define LEVEL variables /* the first variable where the level is shared; else not read */

static double deviation(const double *found, const double *expected, int count)
{
    double worst = 0.0;
    int k;
    for (k = 0; k < count; k++) {
        const double size = fabs(expected[k]) > 1.0 ? fabs(expected[k]) : 1.0;
        const double off = fabs(found[k] - expected[k]) / size;
        if (!(off <= worst)) worst = off; /* also what is not a number */
    }
    return worst;
}

static int check(const char *name, const double *found, const double *expected, int count)
{
    const double worst = deviation(found, expected, count);
    const int good = worst <= 1e-9;
    printf("%-32s %6d values  %.1e  %s\n", name, count, worst, good ? "ok" : "WRONG");
    return !good;
}

#if {{ lifted }}
static double distance(const double *first, const double *second, int count)
{
    double sum = 0.0;
    int k;
    for (k = 0; k < count; k++) sum += (first[k] - second[k]) * (first[k] - second[k]);
    return sum;
}
#endif

static double total_cost(void)
{
    double total, part;
    int i;
    wideberth_level_cost(LEVEL, parameters + WIDEBERTH_PARAMETER_TARGET, &total);
    for (i = 1; i <= WIDEBERTH_HORIZON; i++) {
        wideberth_input_cost(
            STATE(i - 1), variables + wideberth_nlp_inputs[i - 1], STAGE(i), &part);
        total += part;
        wideberth_state_cost(STATE(i), STAGE(i), &part);
        total += part;
#if WIDEBERTH_SLACKS > 0
        total += WIDEBERTH_PENALTY * variables[wideberth_nlp_slacks[i]];
#endif
{% for one in slots %}
#if WIDEBERTH_{{ one.upper }}_AUXILIARIES * WIDEBERTH_{{ one.upper }}S > 0
        {
            int k;
            for (k = 0; k < WIDEBERTH_{{ one.upper }}S; k++)
                total += WIDEBERTH_{{ one.upper }}_REGULARISATION
                    * distance(variables + {{ one.where }}[i] + k * WIDEBERTH_{{ one.upper }}_AUXILIARIES,
                          STAGE(i) + WIDEBERTH_STAGE_{{ one.upper }}(k) + WIDEBERTH_{{ one.upper }}_GUESS,
                          WIDEBERTH_{{ one.upper }}_AUXILIARIES);
        }
#endif
{% endfor %}
    }
    return total;
}

#define SLOT_ROWS ({{ rows }} + 1)
#define AUXILIARY(first, k, each) ((each) ? variables + (first) + (k) * (each) : NULL)
#if WIDEBERTH_SLACKS > 0
#define SLACK(i) variables[wideberth_nlp_slacks[i]]
#else
#define SLACK(i) 0.0
#endif

/* First the inequalities of all slots, {{ kinds }}, then the equalities. */
static void slots(int i, double *next)
{
    double found[SLOT_ROWS];
    double *tied = next + {{ inequalities }};
    int k, j;
{% for one in slots %}
#if WIDEBERTH_{{ one.upper }}S > 0
    for (k = 0; k < WIDEBERTH_{{ one.upper }}S; k++) {
        wideberth_{{ one.name }}(STATE(i), AUXILIARY({{ one.where }}[i], k, WIDEBERTH_{{ one.upper }}_AUXILIARIES), LEVEL,
            STAGE(i) + WIDEBERTH_STAGE_{{ one.upper }}(k), found);
        for (j = 0; j < WIDEBERTH_{{ one.upper }}_INEQUALITIES; j++) *next++ = found[j] + SLACK(i);
        for (j = 0; j < WIDEBERTH_{{ one.upper }}_EQUALITIES; j++)
            *tied++ = found[WIDEBERTH_{{ one.upper }}_INEQUALITIES + j];
    }
#endif
{% endfor %}
    (void)i, (void)k, (void)j, (void)next, (void)tied, (void)found;
}

static void all_rows(double *rows)
{
    int i, k;
    for (i = 0; i <= WIDEBERTH_HORIZON; i++) {
        double *next = rows + wideberth_nlp_first_row[i];
        if (i < WIDEBERTH_HORIZON) {
            const double *input = variables + wideberth_nlp_inputs[i];
            wideberth_dynamics(STATE(i), input, next);
            for (k = 0; k < WIDEBERTH_STATES; k++) next[k] = STATE(i + 1)[k] - next[k];
            next += WIDEBERTH_STATES;
            wideberth_input_constraints(STATE(i), input, next);
            next += WIDEBERTH_INPUT_CONSTRAINTS;
        }
        if (i == 0) continue;
        wideberth_state_constraints(STATE(i), next);
        next += WIDEBERTH_STATE_CONSTRAINTS;
        if (i == WIDEBERTH_HORIZON) {
            wideberth_terminal_constraints(STATE(i), next);
            next += WIDEBERTH_TERMINAL_CONSTRAINTS;
        }
        slots(i, next);
    }
}

int main(void)
{
    static double found[{{ largest }}];
    const double one = 1.0;
    int wrong = 0;
{% for one in checks %}
    wideberth_{{ one.name }}({{ one.given }}, found);
    wrong += check("{{ one.name }}", found, expected_{{ one.name }}, {{ one.size }});
{% endfor %}
    found[0] = total_cost();
    wrong += check("total cost", found, expected_nlp_cost, 1);
    all_rows(found);
    wrong += check("all rows", found, expected_nlp_constraints, WIDEBERTH_ROWS);
    if (wrong) printf("%d results differ\n", wrong);
    else printf("all results agree\n");
    return wrong != 0;
}
