/* Parts of the solver's core for tests, which fill in its arrays and look at them. */
#include "riccati.c"

static core solve; /* of one test at a time */

/* Lay out memory for a problem without solving it. */
void parts_prepare(const wb_problem *problem, const wb_settings *settings, const wb_start *start,
                   double *memory) {
    const core empty = {0};
    solve = empty;
    set_sizes(&solve, problem);
    solve.settings = settings, solve.start = start;
    solve.minimum = settings->minimum;
    prepare(&solve, memory);
}

/* An array by its name; those of slots are of the first kind. */
double *parts_array(const char *name) {
#define ARRAY(field) \
    if (!strcmp(name, #field)) return solve.field;
#define OF_SLOTS(field) \
    if (!strcmp(name, "slots." #field)) return solve.slots[0].field;
    ARRAY(v) ARRAY(dv) ARRAY(dpi) ARRAY(drive) ARRAY(gap) ARRAY(eps) ARRAY(nu) ARRAY(deps)
    ARRAY(dnu) ARRAY(hessian) ARRAY(gradient) ARRAY(cross) ARRAY(top) ARRAY(region) ARRAY(force)
    OF_SLOTS(a) OF_SLOTS(y) OF_SLOTS(out) OF_SLOTS(t) OF_SLOTS(dt) OF_SLOTS(zl) OF_SLOTS(zu)
    OF_SLOTS(drawn) OF_SLOTS(da)
    return NULL;
}

/* Numbers of the present point. */
void parts_numbers(double mu, double rho, double delta, double weight, double dlevel) {
    solve.mu = mu, solve.rho = rho, solve.delta = delta, solve.dlevel = dlevel;
    if (solve.problem->kinds) solve.slots[0].weight = weight;
}

double parts_level_step(void) { return solve.dlevel; }

/* The recursion for these sizes, or the one for any. */
int32_t parts_backward(int32_t any) {
    return any ? backward_of(&solve, solve.n, solve.m) : backward(&solve);
}

void parts_forward(int32_t any) {
    if (any) forward_of(&solve, solve.n, solve.m);
    else forward(&solve);
}

/* Condense everything into the stages, at the point that the arrays hold. */
int32_t parts_condense(void) {
    slots *o = solve.slots;
    memcpy(o->trial, o->v, (size_t)(o->w * o->columns) * sizeof *o->v);
    try_bounds(&solve);
    for (const bound *b = solve.bounds; b < solve.bounds + solve.bound_count; b++)
        memcpy(b->row->t, b->tried, (size_t)solve.steps * sizeof *b->tried);
    return condense(&solve);
}

/* Steps of slack, own variables, slacks t and their multipliers from that of the states. */
void parts_expand(void) {
    recover_slack(&solve);
    expand_slots(&solve, solve.slots);
    step_of_rows(&solve);
}

int32_t parts_hopeless(double ahead, double entered) {
    return (int32_t)hopeless(&solve, ahead, entered);
}

double *parts_multiplier_step(int64_t row) { return solve.rows[row].dy; }
