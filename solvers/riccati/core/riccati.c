/* The primal-dual interior-point iteration, from the first point to the results: see riccati.h.
 *
 * Barrier, step lengths, filter and regularisation are those of Waechter and Biegler. The Newton
 * step is a Riccati recursion over the horizon (sweep.h), after everything that belongs to one
 * obstacle has been eliminated (slots.h). */

#include "levels.h"
#include "riccati.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "state.h"

#include "slots.h"
#include "sweep.h"

/* ---- Inequalities and bounds */

/* Slacks at the values, those of inequalities off zero, and multipliers mu / t. */
static void start_multipliers(core *s) {
    for (int64_t k = 0; k < s->row_count; k++) {
        const inequality *q = s->rows + k;
        const double least = k < s->bounds_from ? s->settings->push : 0.0;
        LOOP (i, q->first, s->steps) {
            q->t[i] = larger(q->tried[i] + q->eps[i], least);
            q->y[i] = s->mu / q->t[i];
        }
    }
    s->zs = s->minimum > -INFINITY ? s->mu / (s->level - s->minimum) : 0.0;
}

/* Mean of multiplier times slack, of the multipliers that are numbers. */
static double mean_product(const core *s) {
    double total = 0.0, count = 0.0;
    for (int64_t k = 0; k < s->given_count; k++)
        for (int64_t i = s->rows[k].first; i < s->steps; i++) {
            const double product = s->rows[k].y[i] * s->rows[k].t[i];
            total += product == product ? product : 0.0;
            count += product == product;
        }
    return total / larger(count, 1.0);
}

/* Bring multipliers within a factor of mu / t. */
static void clip_multipliers(core *s) {
    for (int64_t k = 0; k < s->row_count; k++)
        for (int64_t i = s->rows[k].first; i < s->steps; i++) {
            const inequality *q = s->rows + k;
            q->t[i] = larger(q->t[i], q->tried[i] + q->eps[i]);
            q->y[i] = known_multiplier(q->y[i], q->t[i], s->mu);
        }
}

/* Distances from the bounds at the trial point. */
static void try_bounds(core *s) {
    for (int64_t k = 0; k < s->bound_count; k++) {
        const double *x = s->bounds[k].trial, at = s->bounds[k].at, sign = s->bounds[k].sign;
        double *tried = s->bounds[k].tried;
        LOOP (i, 0, s->steps) tried[i] = sign * (x[i] - at);
    }
}

/* Add the logarithms of the stages' products while the product of two is still a number. */
static void flush_products(const core *s, double *product, double *total) {
    for (int64_t i = 0; i < s->steps; i++)
        if (!(product[i] > 1e-100 && product[i] < 1e100)) {
            *total += log(product[i]);
            product[i] = 1.0;
        }
}

/* Add residuals and logarithms of all slacks to a trial point's merit. */
static void merit_of_rows(core *s, merit *point) {
    const double least = 1.0 - s->share, length = s->length;
    double *restrict product = s->pull, theta = 0.0, last = 1.0; /* pull is free until `errors` */
    LOOP (i, 0, s->steps) product[i] = 1.0;
    for (int64_t k = 0; k < s->row_count; k++) {
        const inequality *q = s->rows + k;
        const double *t = q->t, *dt = q->dt, *tried = q->tried, *eps = q->trial_eps;
        int beyond = 0;
        LOOP (i, q->first, s->steps) {
            const double here = tried[i] + eps[i];
            const double next = next_slack(t[i], length * dt[i], here, least);
            theta += next - here;
            product[i] *= next;
            beyond |= !(product[i] > 1e-100 && product[i] < 1e100);
        }
        if (beyond) flush_products(s, product, &point->logarithms);
    }
    for (int64_t i = 0; i < s->steps; i++) add_logarithm(&point->logarithms, &last, product[i]);
    point->logarithms += log(last);
    point->theta += theta;
}

/* Take the step, to the trial point, in slacks and multipliers. */
static void accept_rows(core *s, double primal, double dual) {
    const double least = 1.0 - s->share, mu = s->mu;
    for (int64_t k = 0; k < s->row_count; k++) {
        const inequality *q = s->rows + k;
        double *restrict t = q->t, *restrict y = q->y;
        const double *dt = q->dt, *dy = q->dy, *tried = q->tried, *eps = q->trial_eps;
        LOOP (i, q->first, s->steps) {
            t[i] = next_slack(t[i], primal * dt[i], tried[i] + eps[i], least);
            y[i] = clip_multiplier(y[i] + dual * dy[i], t[i], mu);
        }
    }
}

/* Add the bounds' forces to the gradients of the Lagrangian and fill in the tally of each stage;
 * returns the sum of the multipliers. */
static double stationarity_of_rows(core *s) {
    double *restrict residual = s->tally + RESIDUAL * s->wide, total = 0.0, mu = s->mu;
    double *restrict wrong = s->tally + COMPLEMENTARITY * s->wide;
    for (int64_t k = 0; k < s->row_count; k++) {
        const inequality *q = s->rows + k;
        const double *t = q->t, *y = q->y, *value = q->value, *eps = q->eps;
        LOOP (i, q->first, s->steps) {
            residual[i] = max_or_nan(fabs(value[i] + eps[i] - t[i]), residual[i]);
            wrong[i] = max_or_nan(fabs(t[i] * y[i] - mu), wrong[i]);
            total += y[i];
        }
    }
    for (int64_t k = 0; k < s->bound_count; k++) {
        const double *z = s->bounds[k].row->y, sign = s->bounds[k].sign;
        double *restrict pull = s->bounds[k].pull;
        LOOP (i, 0, s->steps) pull[i] -= sign * z[i];
    }
    return total;
}

/* Write the steps of the bounds' slacks and of all multipliers. */
static void step_of_rows(core *s) {
    for (int64_t k = 0; k < s->bound_count; k++) {
        const double *dx = s->bounds[k].dx, sign = s->bounds[k].sign;
        double *restrict dt = s->bounds[k].row->dt;
        LOOP (i, 0, s->steps) dt[i] = sign * dx[i];
    }
    for (int64_t k = 0; k < s->row_count; k++) {
        const double *t = s->rows[k].t, *dt = s->rows[k].dt, *y = s->rows[k].y, mu = s->mu;
        double *restrict dy = s->rows[k].dy;
        LOOP (i, s->rows[k].first, s->steps) dy[i] = (mu - y[i] * dt[i]) / t[i] - y[i];
    }
}

/* Largest decreases of primal and dual values, as shares of them; slope of the barrier terms. */
static void boundary_of_rows(core *s, double *primal, double *dual, double *slope) {
    double *restrict most = s->pull, *restrict other = s->pull + s->wide, sum = 0.0;
    LOOP (i, 0, s->steps) most[i] = other[i] = 0.0;
    for (int64_t k = 0; k < s->row_count; k++) {
        const inequality *q = s->rows + k;
        const double *t = q->t, *dt = q->dt, *y = q->y, *dy = q->dy;
        LOOP (i, q->first, s->steps) {
            const double share = -dt[i] / t[i];
            most[i] = larger(most[i], share);
            other[i] = larger(other[i], -dy[i] / y[i]);
            sum += share;
        }
    }
    *slope += s->mu * sum;
    for (int64_t i = 0; i < s->steps; i++) {
        *primal = larger(*primal, most[i]);
        *dual = larger(*dual, other[i]);
    }
}

/* ---- A point: where it starts, its derivatives, its merit, its errors */

/* States and inputs of the guess, off their bounds, and the numbers of the slots. */
static void start_point(core *s) {
    const double push = s->settings->push, *states = s->start->states, *inputs = s->start->inputs;
    const double tilt = s->settings->warm > 0.0 ? 0.0 : WB_TILT;
    const double *lower = s->problem->lower, *upper = s->problem->upper;
    const int64_t n = s->n, wide = s->wide;
    for (int64_t i = 0; i < s->steps; i++) {
        for (int64_t r = 0; r < n; r++) {
            double value = push_inside(states[(i + 1) * n + r], lower[r], upper[r], push);
            s->v[r * wide + i + 1] = s->vn[r * wide + i] = value;
        }
        for (int64_t r = 0; r < s->m; r++) {
            double value = inputs[i * s->m + r] + tilt * (double)(r + 1);
            s->v[(n + r) * wide + i] = push_inside(value, lower[n + r], upper[n + r], push);
        }
        for (int64_t r = 0; r < s->problem->head; r++)
            s->columns[r * wide + i] = s->start->head[i * s->problem->head + r];
    }
    for (int64_t r = 0; r < n; r++) s->v[r * wide] = s->start->initial[r];
    s->level = push_inside(s->settings->guess, s->minimum, INFINITY, push);
    for (int64_t k = 0; k < s->problem->kinds; k++) start_of_slots(s, s->slots + k);
}

/* Mean level of the slots in use, which the shared level is drawn to. */
static double mean_level(const core *s) {
    double total = 0.0;
    int64_t count = 0;
    for (int64_t k = 0; k < s->problem->kinds; k++) {
        const slots *o = s->slots + k;
        for (int64_t c = 0; o->kind->levelled && c < o->count; c++)
            for (int64_t i = 0; i < s->steps; i++, count++)
                total += o->given->level[i * o->kind->slots + o->active[c]];
    }
    return count > 0 ? total / (double)count : 0.0;
}

static void call_drive(core *s, const double *v) {
    call(s, &s->problem->drive, s->wide, s->wide, v, s->columns, s->drive);
}

static void call_node(core *s) {
    call(s, &s->problem->node, s->wide, s->wide, s->vn, s->columns, s->node);
}

static void call_level(core *s, double level, double *out) {
    s->level_v[0] = level;
    call(s, &s->problem->level, 1, LANES, s->level_v, s->level_p, out);
}

/* Scale the cost so that no entry of its gradient exceeds the limit. */
static void rescale(core *s) {
    double *scales = s->columns + s->problem->head * s->wide, largest = 1e-12;
    LOOP (i, 0, s->wide) scales[i] = 1.0;
    call_drive(s, s->v);
    call_node(s);
    for (int64_t i = 0; i < s->steps; i++) {
        for (int64_t r = 0; r < s->w; r++)
            largest = larger(largest, fabs(s->drive[(s->n + 1 + r) * s->wide + i]));
        for (int64_t r = 0; r < s->n; r++)
            largest = larger(largest, fabs(s->node[(1 + r) * s->wide + i]));
    }
    s->scale = larger(smaller(1.0, s->settings->gradient / largest), 1e-8);
    LOOP (i, 0, s->wide) scales[i] = s->scale;
    s->level_p[0] = s->shared ? mean_level(s) : 0.0;
    s->level_p[LANES] = s->scale;
    for (int64_t k = 0; k < s->problem->kinds; k++)
        s->slots[k].weight = s->scale * s->slots[k].kind->regularisation;
}

/* Slack of the regions for the barrier mu; values are those of the trial point. */
static void start_slack(core *s) {
    const double push = s->settings->push;
    for (int64_t i = 0; i < s->steps; i++) {
        double deepest = 0.0;
        for (int64_t k = s->robot_count; k < s->bounds_from; k++)
            deepest = smaller(deepest, s->rows[k].tried[i]);
        /* inside a region, as far from zero as the region is deep: short slacks mean short steps */
        s->eps[i] = deepest > -push ? s->mu / s->rho - deepest : push - 2.0 * deepest;
        s->trial_eps[i] = s->eps[i];
    }
}

/* Copy given multipliers of the path; those of the stages' slack and of the level come last. */
static void copy_multipliers(core *s) {
    const int64_t count = s->multiplier_rows;
    for (int64_t i = 0; i < s->steps; i++)
        for (int64_t r = 0; r < count; r++)
            s->multipliers[r][i] = s->scale * s->start->multipliers[i * count + r];
}

/* Take given multipliers instead; mu is the mean of multiplier times gap, at most the first mu.
 *
 * Where none is given, NaN, the multiplier becomes mu / gap. */
static void take_multipliers(core *s) {
    copy_multipliers(s);
    for (int64_t k = 0; k < s->problem->kinds; k++) take_of_slots(s, s->slots + k);
    s->mu = larger(s->mu, smaller(s->settings->barrier, mean_product(s)));
    if (s->minimum > -INFINITY)
        s->zs = known_multiplier(s->zs_row[0], s->level - s->minimum, s->mu);
    for (int64_t i = 0; s->slot_count && i < s->steps; i++) {
        s->nu[i] = smaller(larger(s->nu[i], s->rho / WB_WARM_RANGE), s->rho);
        s->eps[i] = s->trial_eps[i] = s->mu / s->nu[i];
    }
    clip_multipliers(s);
}

/* Values and derivatives of everything at the present point, that was tried last. */
static void differentiate(core *s) {
    const int64_t wide = s->wide;
    for (int64_t r = 0; r < s->n; r++)
        memcpy(s->vn + r * wide, s->v + r * wide + 1, (size_t)s->steps * sizeof *s->v);
    if (s->problem->input_rows > 0) /* else `try_point` did */
        call_drive(s, s->v);
    call_node(s);
    for (int64_t k = 0; k < s->problem->kinds; k++) differentiate_slots(s, s->slots + k);
    call_level(s, s->level, s->level_out);
    for (int64_t r = 0; r < s->n; r++)
        LOOP (i, r * wide, r * wide + s->steps) s->gap[i] = s->drive[i] - s->v[i + 1];
}

/* Values at the point of a step length along the direction; `level` is that there.
 *
 * Of `drive` the derivatives as well: nine of ten points are taken, and the sines and cosines that
 * both need take half of its time. */
static void try_point(core *s, double level) {
    const int64_t wide = s->wide, n = s->n;
    const double length = s->length;
    LOOP (c, 0, s->w * wide) s->trial_v[c] = s->v[c] + length * s->dv[c];
    LOOP (c, 0, n * wide) s->trial_v[s->w * wide + c] = s->v[s->w * wide + c] + length * s->dpi[c];
    for (int64_t r = 0; r < n; r++)
        memcpy(s->trial_vn + r * wide, s->trial_v + r * wide + 1, (size_t)s->steps * sizeof *s->v);
    LOOP (i, 0, s->wide) s->trial_eps[i] = s->eps[i] + length * s->deps[i];
    call_drive(s, s->trial_v);
    call(s, &s->problem->node_values, wide, wide, s->trial_vn, s->columns, s->trial_node);
    for (int64_t k = 0; k < s->problem->kinds; k++) try_slots(s, s->slots + k, level);
    try_bounds(s);
    call_level(s, level, s->level_tried);
}

/* Residual and barrier function at the trial point. */
static merit merit_of(core *s, double level) {
    const int64_t wide = s->wide;
    merit point = {0.0, s->level_tried[0], 0.0, 0.0};
    LOOP (i, 0, s->steps) point.cost += s->drive[s->n * wide + i] + s->trial_node[i];
    for (int64_t r = 0; r < s->n; r++)
        LOOP (i, r * wide, r * wide + s->steps)
            point.theta += fabs(s->drive[i] - s->trial_v[i + 1]);
    point.plain = point.cost;
    merit_of_rows(s, &point);
    for (int64_t k = 0; k < s->problem->kinds; k++) merit_of_slots(s, s->slots + k, &point);
    for (int64_t i = 0; i < s->steps; i++) point.cost += s->rho * s->trial_eps[i];
    if (s->minimum > -INFINITY) point.logarithms += log(level - s->minimum);
    return point;
}

/* Gradient of cost and dynamics in states and inputs; returns the sum of |pi|. */
static double stationarity_of_path(core *s) {
    const int64_t n = s->n, w = s->w, wide = s->wide;
    const double *pi = s->v + w * wide;
    double total = 0.0;
    for (int64_t r = 0; r < w; r++) {
        double *restrict pull = s->pull + r * wide;
        const double *gradient = s->drive + (n + 1 + r) * wide;
        LOOP (i, 0, wide) pull[i] = gradient[i];
        for (int64_t c = 0; c < n; c++) {
            const double *slope = s->drive + (s->at_jacobian + c * w + r) * wide;
            LOOP (i, 0, wide) pull[i] += slope[i] * pi[c * wide + i];
        }
        pull[s->steps] = 0.0;
    }
    for (int64_t r = 0; r < n; r++) {
        double *restrict pull = s->pull + r * wide;
        pull[0] = 0.0; /* x_0 is given */
        LOOP (i, 0, s->steps) {
            pull[i + 1] += s->node[(1 + r) * wide + i] - pi[r * wide + i];
            total += fabs(pi[r * wide + i]);
        }
    }
    return total;
}

/* Add the forces of the robot's inequalities. */
static void stationarity_of_limits(core *s) {
    for (const inequality *q = s->rows; q < s->rows + s->robot_count; q++)
        for (int64_t r = 0; r < q->width; r++) {
            const double *slope = q->slope + r * s->wide, *y = q->y;
            double *restrict pull = s->pull + r * s->wide + q->after;
            LOOP (i, q->first, s->steps) pull[i] -= y[i] * slope[i];
        }
}

/* Raise a number to the largest of a row; NaN wins. */
static double largest_of(const double *values, int64_t count, double most) {
    for (int64_t i = 0; i < count; i++) most = max_or_nan(fabs(values[i]), most);
    return most;
}

/* Errors of a point: residual, stationarity and complementarity, the latter two scaled as by IPOPT
 * by the mean multiplier, where it exceeds 100. */
typedef struct {
    double primal, dual, wrong, all;
} errors;

static errors errors_of(core *s) {
    const int64_t wide = s->wide, steps = s->steps;
    double force = s->level_out[LANES], primal = 0.0, dual = 0.0, wrong = 0.0;
    LOOP (c, 0, TALLIES * wide) s->tally[c] = 0.0;
    double total = stationarity_of_path(s);
    stationarity_of_limits(s);
    for (int64_t k = 0; k < s->problem->kinds; k++) force += stationarity_of_slots(s, s->slots + k);
    total += stationarity_of_rows(s);
    for (int64_t r = 0; r < s->n; r++) primal = largest_of(s->gap + r * wide, steps, primal);
    for (int64_t r = 0; r < s->w; r++) dual = largest_of(s->pull + r * wide, steps + 1, dual);
    for (int64_t k = 0; k < s->problem->kinds; k++)
        for (int64_t at = 0; at < s->slots[k].own * s->slots[k].columns; at += wide)
            dual = largest_of(s->slots[k].pull + at, steps, dual);
    for (int64_t i = 0; i < steps; i++) {
        primal = max_or_nan(s->tally[RESIDUAL * wide + i], primal);
        wrong = max_or_nan(s->tally[COMPLEMENTARITY * wide + i], wrong);
        if (s->slot_count)
            dual = max_or_nan(fabs(s->rho - s->tally[PRESSURE * wide + i] - s->nu[i]), dual);
    }
    if (s->minimum > -INFINITY) {
        force -= s->zs;
        wrong = larger(wrong, fabs((s->level - s->minimum) * s->zs - s->mu));
    }
    dual = max_or_nan(s->shared ? fabs(force) : 0.0, dual);
    const double scale = larger(100.0, total / (double)s->multiplier_count) / 100.0;
    errors found = {primal, dual / scale, wrong / scale, 0.0};
    found.all = max_or_nan(max_or_nan(dual, wrong + s->mu) / scale, primal);
    return found;
}

/* ---- Newton step */

/* Add to the condensed quadratic what the robot's inequalities contribute, t and y eliminated. */
static void add_limits(core *s) {
    double *restrict sigma = s->pull, *restrict force = s->pull + s->wide;
    for (const inequality *q = s->rows; q < s->rows + s->robot_count; q++) {
        LOOP (i, q->first, s->steps) {
            sigma[i] = q->y[i] / q->t[i];
            force[i] = s->mu / q->t[i] - sigma[i] * (q->value[i] - q->t[i]);
        }
        for (int64_t r = 0; r < q->width; r++) {
            const double *slope = q->slope + r * s->wide;
            double *restrict into = s->gradient + r * s->wide + q->after;
            LOOP (i, q->first, s->steps) into[i] -= force[i] * slope[i];
            for (int64_t c = 0; c <= r; c++) {
                const double *other = q->slope + c * s->wide;
                into = s->hessian + triangle(r, c) * s->wide + q->after;
                LOOP (i, q->first, s->steps) into[i] += sigma[i] * slope[i] * other[i];
            }
        }
    }
}

/* Add what the bounds contribute to curvature and gradient. */
static void add_bounds(core *s) {
    for (int64_t k = 0; k < s->bound_count; k++) {
        const double *t = s->bounds[k].row->t, *z = s->bounds[k].row->y;
        const double force = s->bounds[k].sign * s->mu;
        double *restrict curve = s->bounds[k].curve, *restrict gradient = s->bounds[k].gradient;
        LOOP (i, 0, s->steps) {
            curve[i] += z[i] / t[i];
            gradient[i] -= force / t[i];
        }
    }
}

/* Eliminate the slack of each stage, whose price is rho, and add the rest to the stages: x_{i+1} is
 * that of stage i + 1. */
static void eliminate_slack(core *s) {
    const int64_t wide = s->wide, count = s->seen_count, last = count + s->shared;
    double *restrict inverse = s->pull, *restrict side = s->force + last * wide;
    double *own = s->region + triangle(last, last) * wide;
    LOOP (i, 0, s->steps) {
        own[i] += s->nu[i] / s->eps[i];
        side[i] += s->rho - s->mu / s->eps[i];
        inverse[i] = 1.0 / own[i];
    }
    for (int64_t r = 0; r < last; r++) {
        const double *row = s->region + triangle(last, r) * wide, *force = s->force + r * wide;
        if (r < count) {
            double *restrict into = s->gradient + s->seen[r] * wide + 1;
            LOOP (i, 0, s->steps) into[i] += force[i] - row[i] * inverse[i] * side[i];
        } else
            LOOP (i, 0, s->steps) s->top[1] += force[i] - row[i] * inverse[i] * side[i];
        for (int64_t c = 0; c <= r; c++) {
            const double *other = s->region + triangle(last, c) * wide;
            const double *both = s->region + triangle(r, c) * wide;
            if (r == count && c == count) {
                LOOP (i, 0, s->steps) s->top[0] += both[i] - row[i] * inverse[i] * other[i];
                continue;
            }
            double *restrict into = r < count
                                        ? s->hessian + triangle(s->seen[r], s->seen[c]) * wide + 1
                                        : s->cross + s->seen[c] * wide + 1;
            LOOP (i, 0, s->steps) into[i] += both[i] - row[i] * inverse[i] * other[i];
        }
    }
}

/* Condense everything into stages of (x, u), and the level's curvature and slope. */
static int condense(core *s) {
    const int64_t n = s->n, wide = s->wide;
    memset(s->hessian, 0, (size_t)s->quadratic_size * sizeof *s->hessian);
    s->top[0] = s->level_out[2 * LANES];
    s->top[1] = s->level_out[LANES];
    for (slots *o = s->slots; o < s->slots + s->problem->kinds; o++)
        LOOP (c, 0, o->own * o->columns) {
            o->curve[c] = 2.0 * o->weight + s->delta;
            o->side[c] = 2.0 * o->weight * (o->a[c] - o->drawn[c]);
        }
    add_bounds(s);
    for (int64_t k = 0; k < s->problem->kinds; k++)
        if (!condense_slots(s, s->slots + k)) return 0;
    if (s->slot_count) eliminate_slack(s);
    for (int64_t r = 0; r < n; r++) {
        double *restrict into = s->gradient + r * wide + 1;
        const double *given = s->node + (1 + r) * wide;
        LOOP (i, 0, s->steps) into[i] += given[i];
        for (int64_t c = 0; c <= r; c++) {
            into = s->hessian + triangle(r, c) * wide + 1;
            given = s->node + (1 + n + r * n + c) * wide;
            LOOP (i, 0, s->steps) into[i] += given[i];
        }
    }
    add_limits(s);
    if (s->minimum > -INFINITY) {
        double inverse = 1.0 / (s->level - s->minimum);
        s->top[0] += s->zs * inverse;
        s->top[1] -= s->mu * inverse;
    }
    return 1;
}

/* Newton direction of the regularised problem whose reduced Hessian is positive definite; returns
 * whether there is one. */
static int direction(core *s) {
    const double last = s->delta;
    s->delta = 0.0;
    while (s->delta < WB_LARGEST_SHIFT) {
        if (condense(s) && backward(s)) {
            if (s->delta == 0.0) s->delta = last;
            return forward(s);
        }
        if (s->delta == 0.0)
            s->delta =
                last == 0.0 ? WB_FIRST_SHIFT : larger(WB_SMALLEST_SHIFT, last / WB_SHIFT_DECREASE);
        else s->delta *= last == 0.0 ? WB_FIRST_GROWTH : WB_SHIFT_GROWTH;
    }
    return 0;
}

/* Write the steps of the stages' slacks from those of states and level. */
static void recover_slack(core *s) {
    const int64_t wide = s->wide, last = s->seen_count + s->shared;
    const double *side = s->force + last * wide, *own = s->region + triangle(last, last) * wide;
    LOOP (i, 0, s->steps) s->deps[i] = side[i];
    for (int64_t r = 0; r < last; r++) {
        const double *row = s->region + triangle(last, r) * wide;
        const double *dx = r < s->seen_count ? s->dv + s->seen[r] * wide + 1 : NULL;
        LOOP (i, 0, s->steps) s->deps[i] += row[i] * (dx ? dx[i] : s->dlevel);
    }
    LOOP (i, 0, s->steps) s->deps[i] = -s->deps[i] / own[i];
}

/* Correct the step of the constraint with the largest multiplier at each stage.
 *
 * Inside a region t is tiny, and its step, a difference of numbers that nearly cancel, loses all
 * digits once it is multiplied by y / t. The slack's own equation, rho - nu - sum y = 0 after the
 * step, gives the new y without that loss. */
static void refine_multipliers(core *s) {
    for (int64_t i = 0; i < s->steps; i++) {
        const inequality *which = NULL, *q = s->rows, *end = s->rows + s->bounds_from;
        if (s->nu[i] > 0.9 * s->rho) continue;
        for (q += s->robot_count; q < end; q++)
            if (!which || q->y[i] > which->y[i]) which = q;
        if (!which || which->y[i] < 0.1 * s->rho) continue;
        double next = s->rho - s->nu[i] - s->dnu[i];
        for (q = s->rows + s->robot_count; q < end; q++)
            if (q != which) next -= q->y[i] + q->dy[i];
        which->dy[i] = next - which->y[i];
        which->dt[i] = (s->mu - which->t[i] * next) / which->y[i];
    }
}

/* Write the steps of the slacks of the robot's inequalities. */
static void step_of_limits(core *s) {
    for (const inequality *q = s->rows; q < s->rows + s->robot_count; q++) {
        LOOP (i, q->first, s->steps) q->dt[i] = q->value[i] - q->t[i];
        for (int64_t r = 0; r < q->width; r++) {
            const double *slope = q->slope + r * s->wide, *move = s->dv + r * s->wide + q->after;
            LOOP (i, q->first, s->steps) q->dt[i] += slope[i] * move[i];
        }
    }
}

/* Longest step lengths, and slopes along the step. */
typedef struct {
    double primal, dual; /* step lengths */
    double slope, fall;  /* of phi; of the cost, with slack and without the barrier */
} reach;

/* Write the steps of all slacks and multipliers, and measure the step. */
static reach measure_step(core *s) {
    double primal = 0.0, dual = 0.0, slack = 0.0;
    reach step = {0.0, 0.0, s->level_out[LANES] * s->dlevel, 0.0};
    for (int64_t r = 0; r < s->w; r++)
        LOOP (i, r * s->wide, r * s->wide + s->steps)
            step.slope += s->drive[(s->n + 1) * s->wide + i] * s->dv[i];
    for (int64_t r = 0; r < s->n; r++)
        LOOP (i, r * s->wide, r * s->wide + s->steps)
            step.slope += s->node[s->wide + i] * s->dv[i + 1];
    step.fall = step.slope;
    step_of_limits(s);
    if (s->slot_count) {
        recover_slack(s);
        for (int64_t k = 0; k < s->problem->kinds; k++) expand_slots(s, s->slots + k);
    }
    step_of_rows(s);
    if (s->slot_count) refine_multipliers(s);
    boundary_of_rows(s, &primal, &dual, &step.slope);
    for (int64_t k = 0; k < s->problem->kinds; k++) step.slope += slope_of_slots(s, s->slots + k);
    for (int64_t i = 0; i < s->steps; i++) slack += s->rho * s->deps[i];
    step.slope += slack, step.fall += slack;
    if (s->minimum > -INFINITY) {
        double gap = s->level - s->minimum;
        s->dzs = (s->mu - s->zs * s->dlevel) / gap - s->zs;
        primal = larger(primal, -s->dlevel / gap);
        dual = larger(dual, -s->dzs / s->zs);
        step.slope -= s->mu * s->dlevel / gap;
    }
    step.primal = longest_step(primal, s->share);
    step.dual = longest_step(dual, s->share);
    return step;
}

/* Take the step. */
static void accept(core *s, double primal, double dual) {
    const int64_t w = s->w, wide = s->wide;
    LOOP (c, 0, w * wide) s->v[c] += primal * s->dv[c];
    LOOP (c, 0, s->n * wide) s->v[w * wide + c] += primal * s->dpi[c];
    s->level += primal * s->dlevel;
    if (s->minimum > -INFINITY)
        s->zs = clip_multiplier(s->zs + dual * s->dzs, s->level - s->minimum, s->mu);
    for (int64_t k = 0; k < s->problem->kinds; k++) accept_slots(s->slots + k, primal);
    accept_rows(s, primal, dual);
}

/* Return to states, inputs and own variables before the step, the last that were finite. */
static void undo_step(core *s) {
    LOOP (c, 0, s->w * s->wide) s->v[c] -= s->length * s->dv[c];
    s->level -= s->length * s->dlevel;
    for (int64_t k = 0; k < s->problem->kinds; k++) undo_slots(s->slots + k, s->length);
}

/* ---- Filter line search, barrier and price */

/* Begin a new filter, which takes its limits from the next point. */
static void begin_filter(core *s) {
    s->entries = 0;
    s->theta_most = -1.0;
}

/* Whether the filter accepts a trial point. */
static int filter_accepts(core *s, double slope, double theta, double phi, double new_theta,
                          double new_phi) {
    if (s->theta_most < 0.0) {
        s->theta_most = WB_LARGEST_RESIDUAL * larger(1.0, theta);
        s->theta_least = WB_SMALL_RESIDUAL * larger(1.0, theta);
    }
    if (larger(theta, new_theta) <= WB_STILL_RESIDUAL &&
        fabs(new_phi - phi) <= WB_STILL_CHANGE * fabs(phi))
        return ACCEPT;
    if (!(new_theta <= s->theta_most && isfinite(new_phi))) return REFUSE;
    for (int64_t k = 0; k < s->entries; k++)
        if (new_theta >= s->filter[2 * k] && new_phi >= s->filter[2 * k + 1]) return REFUSE;
    const double rounding = WB_ROUNDING * fabs(phi), length = s->length;
    if (theta <= s->theta_least && slope < 0.0 &&
        length * pow(-slope, WB_SLOPE_POWER) > pow(theta, WB_RESIDUAL_POWER))
        return new_phi <= phi + WB_ARMIJO * length * slope + rounding ? ACCEPT : REFUSE;
    if (new_theta <= (1.0 - WB_MARGIN) * theta || new_phi <= phi - WB_MARGIN * theta + rounding)
        return ACCEPT_AND_ADD;
    return REFUSE;
}

/* Add an entry to the filter. */
static void add_to_filter(core *s, double theta, double phi) {
    if (s->entries < WB_FILTER_SIZE) {
        s->filter[2 * s->entries] = (1.0 - WB_MARGIN) * theta;
        s->filter[2 * s->entries + 1] = phi - WB_MARGIN * theta;
        s->entries++;
    }
}

/* Fiacco and McCormick: a smaller mu once the problem for this one is nearly solved. */
static void lower_barrier(core *s, const errors *error) {
    const double least = WB_LAST_BARRIER * s->settings->tolerance;
    double wrong = error->wrong, worst = larger(error->primal, larger(error->dual, wrong));
    while (s->mu > least && worst <= s->settings->test * s->mu) {
        double mu = s->mu;
        s->mu = larger(least, smaller(WB_BARRIER_FACTOR * mu, pow(mu, WB_BARRIER_POWER)));
        begin_filter(s);
        wrong += mu - s->mu;
        worst = larger(error->primal, larger(error->dual, wrong));
    }
}

/* Raise the price of slack, and begin a new filter. */
static void raise_price(core *s) {
    s->rho *= WB_PENALTY_FACTOR;
    s->mu = larger(s->mu, WB_PENALTY_BARRIER);
    for (int64_t i = 0; i < s->steps; i++)
        s->nu[i] = larger(s->rho - s->tally[PRESSURE * s->wide + i], s->mu / s->eps[i]);
    begin_filter(s);
}

/* Whether the whole Newton step keeps phi, all residuals being small and mu the last one. */
static int is_settled(const core *s, double primal, double slope, const merit *present) {
    const double tolerance = s->settings->tolerance;
    return s->mu <= WB_LAST_BARRIER * tolerance && primal <= tolerance &&
           fabs(slope) <= WB_SETTLED_SLOPE * fabs(present->cost - s->mu * present->logarithms);
}

/* How this start will end where it will not lead to a better plan than those known, or -1.
 *
 * It leads to the same plan where both the present point and that of the whole Newton step are near
 * it. It leads to a dearer one where regions are hardly entered and the cost `ahead`, that of the
 * whole step by the cost's slope less what the barrier may still be worth, is far above the best.
 */
static int hopeless(const core *s, double ahead, double entered) {
    const double best = s->settings->best, within = s->settings->within;
    const double *plan = s->start->plans;
    for (int64_t k = 0; k < (int64_t)s->settings->plans; k++, plan += (s->steps + 1) * s->n) {
        double here = 0.0, there = 0.0;
        for (int64_t e = 0; e < s->seen_count; e++)
            for (int64_t i = 1; i <= s->steps; i++) {
                double off = s->v[s->seen[e] * s->wide + i] - plan[i * s->n + s->seen[e]];
                here = larger(here, fabs(off));
                there = larger(there, fabs(off + s->dv[s->seen[e] * s->wide + i]));
            }
        if (here < within && there < WB_SAME_TARGET * within) return WB_SAME;
    }
    if (entered < WB_HARDLY_ENTERED && ahead > best + WB_MUCH_DEARER * (1.0 + fabs(best)))
        return WB_DEARER;
    return -1;
}

/* ---- Results */

/* Copy the last point into the results, and its multipliers for the cost before scaling. */
static void write_results(core *s, double cost) {
    const int64_t n = s->n, wide = s->wide, count = s->multiplier_rows;
    wb_result *result = s->result;
    double *into = result->multipliers;
    LOOP (i, 0, s->steps) s->zs_row[i] = s->zs;
    memcpy(result->states, s->start->initial, (size_t)n * sizeof *result->states);
    for (int64_t i = 0; i < s->steps; i++) {
        for (int64_t r = 0; r < n; r++) result->states[(i + 1) * n + r] = s->v[r * wide + i + 1];
        for (int64_t r = 0; r < s->m; r++) result->inputs[i * s->m + r] = s->v[(n + r) * wide + i];
        result->slack[i] = s->eps[i];
        for (int64_t r = 0; into && r < count; r++)
            into[i * count + r] = s->multipliers[r][i] / s->scale;
    }
    for (int64_t k = 0; k < s->problem->kinds; k++) write_slots(s, s->slots + k);
    result->cost = cost / s->scale;
    result->level = s->level;
}

/* ---- Memory */

/* Memory that is handed out piece by piece; without a base it is only measured. */
typedef struct {
    double *base;
    int64_t used;
} block;

enum { ALIGNED = 8 }; /* doubles; a processor loads up to so many at once */

/* Memory that is written before it is read. */
static void *take_unset(block *b, int64_t count) {
    void *place = b->base ? (void *)(b->base + b->used) : NULL;
    b->used += (count + ALIGNED - 1) / ALIGNED * ALIGNED;
    return place;
}

/* Zeroed memory. */
static void *take(block *b, int64_t count) {
    void *place = take_unset(b, count);
    if (place) memset(place, 0, (size_t)count * sizeof *b->base);
    return place;
}

/* Room for `count` things of a size in bytes. */
static void *take_things(block *b, int64_t count, size_t size) {
    return take(b, count * (int64_t)((size + sizeof(double) - 1) / sizeof(double)));
}

/* Sizes of a problem, and where the pieces of the results of `drive` begin. */
static void set_sizes(core *s, const wb_problem *problem) {
    s->problem = problem;
    s->n = problem->n, s->m = problem->m, s->w = problem->n + problem->m;
    s->shared = problem->shared, s->steps = problem->steps;
    s->wide = (s->steps + 8) / 8 * 8;
    s->at_jacobian = s->n + 1 + s->w;
    s->at_hessian = s->at_jacobian + s->n * s->w;
    s->robot_count = problem->input_rows + problem->node_rows + problem->final_rows;
}

/* Room for the slots of a kind, `count` of them in use. */
static void lay_out_slots(const core *s, slots *o, block *b, const wb_kind *kind, int64_t count) {
    const int64_t wide = count * s->wide, own = kind->own, equal = kind->equalities;
    o->kind = kind;
    o->count = count, o->columns = wide, o->own = own;
    o->unequal = kind->inequalities, o->stated = kind->inequalities + equal;
    o->first = kind->entries + s->shared, o->w = o->first + own;
    o->active = take_things(b, count, sizeof *o->active);
    o->order = take_things(b, o->w, sizeof *o->order);
    o->place = take_things(b, o->first + 1, sizeof *o->place);
    o->v = take(b, (o->w + o->stated + 2 * own) * wide);
    o->trial = take(b, (o->w + o->stated) * wide);
    o->p = take(b, (kind->parameters + kind->levelled + 1 + own) * wide);
    o->out = take_unset(b, (o->stated * (1 + o->w) + o->w * o->w) * wide);
    o->tried = take(b, o->stated * wide);
    o->t = take(b, o->unequal * wide), o->dt = take(b, o->unequal * wide);
    o->drawn = take(b, own * wide), o->pull = take(b, own * wide);
    o->curve = take(b, own * wide), o->side = take(b, own * wide);
    o->da = take(b, (own + equal) * wide);
    o->back = take_unset(b, (own + equal) * (o->first + 2) * wide);
    if (b->base) {
        o->a = o->v + o->first * wide, o->y = o->v + o->w * wide;
        o->zl = o->y + o->stated * wide, o->zu = o->zl + own * wide;
        o->slope = o->out + o->stated * wide, o->hessian = o->slope + o->stated * o->w * wide;
    }
}

/* Room for variables, results of the stage functions and the Newton step. */
static void lay_out_path(core *s, block *b) {
    const int64_t n = s->n, w = s->w, wide = s->wide, inputs = s->problem->input_rows;
    const int64_t nodes = s->robot_count - inputs;
    s->v = take(b, (w + n + inputs) * wide), s->trial_v = take(b, (w + n + inputs) * wide);
    s->vn = take(b, (n + nodes) * wide), s->trial_vn = take(b, (n + nodes) * wide);
    s->dv = take(b, w * wide), s->dpi = take(b, n * wide);
    s->zl = take(b, w * wide), s->zu = take(b, w * wide);
    s->columns = take(b, (s->problem->head + 1) * wide);
    s->drive = take(b, (s->at_hessian + w * w + inputs * (1 + w)) * wide);
    s->node = take(b, (1 + n + n * n + nodes * (1 + n)) * wide);
    s->trial_node = take(b, (1 + nodes) * wide);
    s->gap = take(b, n * wide);
    s->level_v = take(b, LANES), s->level_p = take(b, 2 * LANES);
    s->level_out = take(b, 3 * LANES), s->level_tried = take(b, 3 * LANES);
    s->eps = take(b, wide), s->nu = take(b, wide);
    s->deps = take(b, wide), s->dnu = take(b, wide);
    s->trial_eps = take(b, wide), s->none = take(b, wide), s->zs_row = take(b, wide);
    s->multipliers = take_things(b, 2 * w + n + s->robot_count + 2, sizeof *s->multipliers);
    s->pull = take(b, (w + 1) * wide), s->tally = take(b, TALLIES * wide);
    s->filter = take(b, 2 * WB_FILTER_SIZE);
    s->stages = take_unset(b, (s->steps + 1) * (n + w) * wide_row(w));
    s->product = take(b, n * wide_row(w)), s->move = take(b, w), s->next = take(b, n);
    s->work = take_unset(b, s->problem->work);
}

/* Room for the condensed quadratic, for as many entries of x as slots depend on. */
static void lay_out_quadratic(core *s, block *b) {
    const int64_t tall = s->seen_count + 2, wide = s->wide;
    const int64_t rows = triangle(s->w, 0) + s->w + s->n + triangle(tall, 0) + tall;
    s->quadratic_size = rows * wide;
    s->hessian = take(b, s->quadratic_size);
    if (b->base) {
        s->gradient = s->hessian + triangle(s->w, 0) * wide;
        s->cross = s->gradient + s->w * wide;
        s->region = s->cross + s->n * wide;
        s->force = s->region + triangle(tall, 0) * wide;
    }
}

/* Where the unknowns of a slot stand in its matrix, and among all entries of x that slots depend
 * on, followed by the level and the slack. */
static void order_slots(core *s, slots *o) {
    const int64_t inner = o->own + o->stated - o->unequal;
    for (int64_t r = 0; r < o->w; r++) o->order[r] = r < o->first ? inner + r : r - o->first;
    for (int64_t e = 0; e < o->kind->entries; e++) {
        int64_t place = 0, entry = o->kind->depends[e];
        while (place < s->seen_count && s->seen[place] != entry) place++;
        s->seen[place] = entry;
        s->seen_count += place == s->seen_count;
        o->place[e] = place;
    }
}

/* Lay out memory for the slots that are in use, or for all of them where it is only measured. */
static void lay_out(core *s, block *b) {
    const wb_problem *problem = s->problem;
    int64_t bounds = 2 * s->w, rows = s->robot_count, most = 0;
    lay_out_path(s, b);
    s->seen = take_things(b, s->n + 1, sizeof *s->seen);
    s->slots = take_things(b, problem->kinds, sizeof *s->slots);
    for (int64_t k = 0; k < problem->kinds; k++) {
        const wb_kind *kind = problem->kind + k;
        slots measured, *o = b->base ? s->slots + k : &measured;
        int64_t count = kind->slots;
        for (int64_t slot = 0; b->base && slot < kind->slots; slot++)
            count -= !(s->start->slots[k].active[slot] > 0.0);
        lay_out_slots(s, o, b, kind, count);
        const int64_t size = o->w + o->stated - o->unequal + 1;
        most = size > most ? size : most;
        bounds += 2 * count * kind->own;
        rows += count * kind->inequalities;
        s->slot_count += count;
    }
    s->matrix = take_unset(b, most * (most + 1) * LANES);
    s->bounds = take_things(b, bounds, sizeof *s->bounds);
    s->rows = take_things(b, rows + bounds + 1, sizeof *s->rows);
    s->spare = take(b, (2 * s->robot_count + rows + 4 * bounds + 2) * s->wide);
    s->seen_count = b->base ? 0 : s->n; /* at most */
    for (int64_t k = 0; b->base && k < problem->kinds; k++) order_slots(s, s->slots + k);
    for (int64_t k = 0; b->base && k < problem->kinds; k++) {
        s->slots[k].place[s->slots[k].kind->entries] = s->seen_count;
        s->slots[k].place[s->slots[k].first] = s->seen_count + s->shared;
    }
    lay_out_quadratic(s, b);
}

/* A row of the spare memory. */
static double *spare_row(core *s) {
    s->spare += s->wide;
    return s->spare - s->wide;
}

/* List an inequality from step `first` on, with a row for the step of its multiplier. */
static inequality *add_row(core *s, int64_t first, const double *value, const double *tried,
                           double *t, double *dt, double *y) {
    inequality *q = s->rows + s->row_count++;
    const inequality given = {first, value, tried,        s->none, s->none, t,
                              dt,    y,     spare_row(s), NULL,    0,       0};
    *q = given;
    return q;
}

/* List the robot's inequalities on (x_i, u_i) and on x_{i+1}. */
static void list_limits(core *s) {
    const int64_t n = s->n, w = s->w, wide = s->wide, inputs = s->problem->input_rows;
    const int64_t nodes = s->robot_count - inputs;
    double *c = s->drive + (s->at_hessian + w * w) * wide, *y = s->v + (w + n) * wide;
    double *g = s->node + (1 + n + n * n) * wide;
    for (int64_t j = 0; j < inputs; j++, c += wide, y += wide) {
        inequality *q = add_row(s, 0, c, c, spare_row(s), spare_row(s), y);
        q->slope = c + (inputs + j * (w - 1)) * wide, q->width = w;
    }
    for (int64_t j = 0; j < nodes; j++, g += wide) {
        const int64_t first = j < s->problem->node_rows ? 0 : s->steps - 1;
        inequality *q = add_row(s, first, g, s->trial_node + (1 + j) * wide, spare_row(s),
                                spare_row(s), s->vn + (n + j) * wide);
        q->slope = g + (nodes + j * (n - 1)) * wide, q->width = n, q->after = 1;
    }
}

/* List the inequalities of the slots of a kind. */
static void list_slots(core *s, const slots *o) {
    for (int64_t j = 0; j < o->unequal; j++)
        for (int64_t k = 0; k < o->count; k++) {
            const int64_t at = j * o->columns + k * s->wide;
            inequality *q =
                add_row(s, 0, o->out + at, o->tried + at, o->t + at, o->dt + at, o->y + at);
            q->eps = s->eps, q->trial_eps = s->trial_eps;
        }
}

/* List a bound with its multiplier, unless it is infinite. */
static void list_bound(core *s, bound b, double at, double sign, double *z) {
    if (!isfinite(at)) return;
    b.tried = spare_row(s);
    double *t = spare_row(s);
    b.row = add_row(s, 0, t, b.tried, t, spare_row(s), z);
    b.at = at, b.sign = sign;
    s->bounds[s->bound_count++] = b;
}

/* List the bounds of states and inputs, those of x_{i+1} in column i, and of own variables. */
static void list_bounds(core *s) {
    const double *lower = s->problem->lower, *upper = s->problem->upper;
    for (int64_t r = 0; r < s->w; r++) {
        const int64_t line = r * s->wide, after = r < s->n, at = line + after;
        const bound b = {NULL,
                         0.0,
                         0.0,
                         s->dv + at,
                         s->trial_v + at,
                         NULL,
                         s->pull + at,
                         s->hessian + triangle(r, r) * s->wide + after,
                         s->gradient + at};
        list_bound(s, b, lower[r], 1.0, s->zl + line);
        list_bound(s, b, upper[r], -1.0, s->zu + line);
    }
    s->path_bounds = s->bound_count;
    for (const slots *o = s->slots; o < s->slots + s->problem->kinds; o++)
        for (int64_t at = 0; at < o->own * o->columns; at += s->wide) {
            const bound b = {NULL,
                             0.0,
                             0.0,
                             o->da + at,
                             o->trial + o->first * o->columns + at,
                             NULL,
                             o->pull + at,
                             o->curve + at,
                             o->side + at};
            list_bound(s, b, o->kind->lower[at / o->columns], 1.0, o->zl + at);
            list_bound(s, b, o->kind->upper[at / o->columns], -1.0, o->zu + at);
        }
}

/* List the rows of multipliers in the order of `wb_start`. */
static void list_multipliers(core *s) {
    for (int64_t r = 0; r < s->w; r++) {
        s->multipliers[r] = s->zl + r * s->wide;
        s->multipliers[s->w + r] = s->zu + r * s->wide;
    }
    double **row = s->multipliers + 2 * s->w;
    for (int64_t r = 0; r < s->n; r++) *row++ = s->v + (s->w + r) * s->wide;
    for (int64_t j = 0; j < s->robot_count; j++) *row++ = s->rows[j].y;
    row[0] = s->nu, row[1] = s->zs_row;
    s->multiplier_rows = row + 2 - s->multipliers;
}

/* Multipliers of the slots of all steps, of own variables both bounds, finite or not. */
static int64_t count_of_slots(const core *s) {
    int64_t count = 0;
    for (const slots *o = s->slots; o < s->slots + s->problem->kinds; o++)
        count += o->count * s->steps * (o->unequal + 2 * o->own);
    return count;
}

/* Lay out the memory, and list slots in use, inequalities and bounds. */
static void prepare(core *s, double *memory) {
    block b = {memory, 0};
    while ((uintptr_t)b.base % (ALIGNED * sizeof *memory)) b.base++;
    lay_out(s, &b);
    list_limits(s);
    for (int64_t k = 0; k < s->problem->kinds; k++) {
        slots *o = s->slots + k;
        int64_t count = 0;
        o->given = s->start->slots + k;
        for (int64_t slot = 0; slot < o->kind->slots; slot++)
            if (o->given->active[slot] > 0.0) o->active[count++] = slot;
        list_slots(s, o);
    }
    s->bounds_from = s->row_count;
    list_bounds(s);
    s->given_count = s->row_count;
    if (s->slot_count) add_row(s, 0, s->eps, s->trial_eps, s->eps, s->deps, s->nu)->dy = s->dnu;
    list_multipliers(s);
    const int64_t always = s->robot_count - s->problem->final_rows + s->path_bounds + s->n;
    s->multiplier_count =
        count_of_slots(s) + s->problem->final_rows + (always + (s->slot_count > 0)) * s->steps;
}

#ifndef WB_LEVEL_3
int64_t wb_size(const wb_problem *problem) {
    core s = {0};
    block b = {NULL, 0};
    set_sizes(&s, problem);
    lay_out(&s, &b);
    return b.used + ALIGNED;
}
#endif

/* ---- Iteration */

/* What the iterations hand on. */
typedef struct {
    merit present;
    reach step;
    errors error;
    int64_t iterations, settled; /* settled: steps in a row that would do nothing */
    double left, deepest;        /* sum of the slack at the last price; largest slack */
} progress;

/* Sum of the slack of all steps. */
static double total_slack(const core *s) {
    double total = 0.0;
    for (int64_t i = 0; i < s->steps; i++) total += s->eps[i];
    return total;
}

/* The guess, with slacks and multipliers. */
static void begin(core *s, progress *now) {
    start_point(s);
    rescale(s);
    s->rho = s->scale * s->settings->penalty;
    s->mu = s->settings->barrier;
    s->share = WB_BOUNDARY_SHARE;
    begin_filter(s);
    if (s->settings->warm > 0.0) {
        s->mu = WB_LAST_BARRIER * s->settings->tolerance;
        copy_multipliers(s);
    }
    try_point(s, s->level);
    if (s->slot_count) start_slack(s);
    start_multipliers(s);
    if (s->settings->warm > 0.0) take_multipliers(s);
    now->present = merit_of(s, s->level);
    now->left = INFINITY;
}

/* Take the first point along the direction that the filter accepts; returns whether there is one.
 * After too many trials it begins anew, and the longest step is taken. */
static int search_line(core *s, progress *now) {
    int64_t attempt = 0;
    int forget = 0;
    s->length = now->step.primal;
    for (;;) {
        const double level = s->level + s->length * s->dlevel;
        try_point(s, level);
        const merit tried = merit_of(s, level), *present = &now->present;
        const double phi = present->cost - s->mu * present->logarithms;
        const double next = tried.cost - s->mu * tried.logarithms;
        int answer = filter_accepts(s, now->step.slope, present->theta, phi, tried.theta, next);
        if (answer == REFUSE && !forget) {
            s->length *= 0.5;
            if (++attempt == WB_TRIALS) {
                begin_filter(s);
                forget = 1;
                s->length = now->step.primal * (++s->failed_searches < 3 ? 1.0 : 0.5);
            }
            continue;
        }
        if (forget && !isfinite(next)) return 0;
        if (answer == ACCEPT_AND_ADD && !forget) add_to_filter(s, present->theta, phi);
        accept(s, s->length, now->step.dual);
        now->present = tried;
        return 1;
    }
}

/* How a converged solve ends, or -1 where a higher price of slack is tried. */
static int64_t judge_converged(core *s, progress *now) {
    const double total = total_slack(s);
    merit *present = &now->present;
    if (now->deepest <= WB_SLACK_LEFT * s->settings->tolerance) return WB_SOLVED;
    if (s->rho >= s->scale * s->settings->most_penalty || total > 0.99 * now->left)
        return WB_INFEASIBLE;
    if (s->settings->plans > 0.0 && present->cost > s->scale * s->settings->best)
        return WB_DEARER; /* and dearer still at a higher price */
    /* slack is left that a higher price may remove; if it does not, this point is kept */
    write_results(s, present->plain);
    now->left = total;
    present->cost += (WB_PENALTY_FACTOR - 1.0) * s->rho * total;
    raise_price(s);
    return -1;
}

/* How a solve ends at the present point, or -1. */
static int64_t judge(core *s, progress *now, const volatile int64_t *stop) {
    if (!isfinite(now->error.all)) undo_step(s);
    if (!isfinite(now->error.all) || s->failed_searches > WB_FAILURES) return WB_FAILED;
    now->deepest = 0.0;
    for (int64_t i = 0; i < s->steps; i++) now->deepest = larger(now->deepest, s->eps[i]);
    if (now->error.all <= s->settings->tolerance ||
        (now->settled >= WB_SETTLED_STEPS && now->deepest > WB_MUCH_SLACK)) {
        int64_t status = judge_converged(s, now);
        if (status >= 0) return status;
    }
    if (stop && *stop) return WB_STOPPED;
    return (double)now->iterations >= s->settings->iterations ? WB_LIMIT : -1;
}

/* Iterate; returns how the solve ended. */
static int64_t iterate(core *s, progress *now, const volatile int64_t *stop) {
    for (;; now->iterations++) {
        differentiate(s);
        now->error = errors_of(s);
        int64_t status = judge(s, now, stop);
        if (status >= 0) return status;
        lower_barrier(s, &now->error);
        if (!direction(s)) return WB_FAILED;
        s->share = larger(WB_BOUNDARY_SHARE, 1.0 - s->mu);
        now->step = measure_step(s);
        int settled = is_settled(s, now->error.primal, now->step.slope, &now->present);
        now->settled = settled ? now->settled + 1 : 0;
        if (s->settings->plans > 0.0) {
            const double barrier =
                s->mu * (double)(count_of_slots(s) + (2 * s->w + s->robot_count) * s->steps);
            const double ahead = now->present.cost + now->step.fall - barrier;
            status = hopeless(s, ahead / s->scale, total_slack(s));
            if (status >= 0) return status;
        }
        if (!search_line(s, now)) return WB_FAILED;
    }
}

void wb_solve(const wb_problem *problem, const wb_settings *settings, const wb_start *start,
              wb_result *result, const volatile int64_t *stop, double *memory) {
    core s = {0};
    progress now = {0};
    set_sizes(&s, problem);
    s.settings = settings, s.start = start, s.result = result;
    s.minimum = settings->minimum;
    prepare(&s, memory);
    begin(&s, &now);
    int64_t status = iterate(&s, &now, stop);
    if (status == WB_LIMIT && now.error.primal <= settings->tolerance && s.slot_count &&
        now.deepest > WB_MUCH_SLACK) {
        /* it converges slowly, but all that moves is how slack is shared out */
        status = WB_INFEASIBLE;
        now.left = INFINITY;
    }
    if (now.left == INFINITY || status == WB_SOLVED || status == WB_INFEASIBLE)
        write_results(&s, now.present.plain);
    else if (status == WB_LIMIT || status == WB_FAILED)
        status = WB_INFEASIBLE; /* with the point that was kept */
    result->status = status;
    result->iterations = now.iterations;
    result->error = now.error.all;
    result->penalty = s.rho / s.scale;
}
