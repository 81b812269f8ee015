/* Slots: obstacles, whose own unknowns are eliminated from the Newton step one slot at a time.
 *
 * Each states h(x, s, a) + eps_i = t > 0 and e(x, s, a) = 0. The rows of the Newton system that
 * belong to (t, y) are solved by hand: with sigma = y / t and r = h + eps - t they add
 *
 *   sigma (grad h, 1) (grad h, 1)'   and   -(mu / t - sigma r) (grad h, 1)
 *
 * to the quadratic in (x, s, a, eps). The own variables a and the multipliers of the equalities are
 * then eliminated from a small dense matrix, LANES columns at once: order (a, equalities, x's
 * entries, s, eps). */

/* Take the numbers of the slots in use and their own variables, off the bounds. */
static void start_of_slots(const core *s, slots *o) {
    const wb_kind *kind = o->kind;
    const wb_slots *given = o->given;
    const int64_t own = o->own, width = kind->parameters, row = o->columns;
    for (int64_t k = 0; k < o->count; k++)
        for (int64_t i = 0; i < s->steps; i++) {
            const int64_t c = k * s->wide + i, at = i * kind->slots + o->active[k];
            double *p = o->p + c;
            for (int64_t r = 0; r < width; r++) p[r * row] = given->parameters[at * width + r];
            p += width * row;
            if (kind->levelled) *p = given->level[at];
            p += kind->levelled * row;
            *p = 1.0;
            for (int64_t r = 0; r < own; r++) {
                p[(r + 1) * row] = o->drawn[r * row + c] = given->drawn[at * own + r];
                o->a[r * row + c] = push_inside(given->begun[at * own + r], kind->lower[r],
                                                kind->upper[r], s->settings->push);
            }
        }
}

/* Take given multipliers, and slacks without that of the stage; multipliers of equalities that are
 * NaN become 0. */
static void take_of_slots(const core *s, slots *o) {
    for (int64_t k = 0; k < o->count; k++)
        for (int64_t i = 0; i < s->steps; i++) {
            const int64_t c = k * s->wide + i, at = i * o->kind->slots + o->active[k];
            const double *given = o->given->before + at * (o->stated + 2 * o->own);
            for (int64_t j = 0; j < o->stated + 2 * o->own; j++) {
                const int64_t row = j * o->columns + c;
                o->y[row] = s->scale * given[j];
                if (j < o->unequal) o->t[row] = larger(o->tried[row], s->settings->push);
                else if (j < o->stated && o->y[row] != o->y[row]) o->y[row] = 0.0;
            }
        }
}

/* Copy own variables and multipliers into the results, of the slots in use. */
static void write_slots(const core *s, const slots *o) {
    const int64_t width = o->stated + 2 * o->own, all = o->kind->slots;
    double *found = o->given->found, *after = o->given->after;
    for (int64_t at = 0; after && at < s->steps * all * width; at++)
        after[at] = NAN; /* of a slot not in use that is all */
    for (int64_t k = 0; k < o->count; k++)
        for (int64_t i = 0; i < s->steps; i++) {
            const int64_t c = k * s->wide + i, at = i * all + o->active[k];
            for (int64_t r = 0; r < o->own; r++) found[at * o->own + r] = o->a[r * o->columns + c];
            for (int64_t j = 0; after && j < width; j++)
                after[at * width + j] = o->y[j * o->columns + c] / s->scale;
        }
}

/* ---- Values and derivatives */

/* Write poses and level into the variables of the slots. */
static void write_poses(const core *s, const slots *o, double *target, const double *v,
                        double level) {
    const int64_t entries = o->kind->entries;
    for (int64_t r = 0; r < entries; r++) {
        const double *row = v + o->kind->depends[r] * s->wide + 1;
        for (int64_t k = 0; k < o->count; k++)
            memcpy(target + r * o->columns + k * s->wide, row, (size_t)s->steps * sizeof *row);
    }
    for (int64_t c = 0; s->shared && c < o->columns; c++) target[entries * o->columns + c] = level;
}

/* Values at the trial point. */
static void try_slots(const core *s, slots *o, double level) {
    double *trial = o->trial + o->first * o->columns;
    LOOP (c, 0, o->own * o->columns) trial[c] = o->a[c] + s->length * o->da[c];
    write_poses(s, o, o->trial, s->trial_v, level);
    if (o->count) call(s, &o->kind->values, o->columns, o->columns, o->trial, o->p, o->tried);
}

/* Derivatives at the present point. */
static void differentiate_slots(const core *s, slots *o) {
    write_poses(s, o, o->v, s->v, s->level);
    if (o->count) call(s, &o->kind->derivatives, o->columns, o->columns, o->v, o->p, o->out);
}

/* Add residuals of equalities and the regularisation at a trial point. */
static void merit_of_slots(const core *s, const slots *o, merit *point) {
    const double *trial = o->trial + o->first * o->columns;
    for (int64_t at = 0; at < o->columns; at += s->wide) {
        for (int64_t j = o->unequal; j < o->stated; j++)
            LOOP (i, 0, s->steps) point->theta += fabs(o->tried[j * o->columns + at + i]);
        for (int64_t r = 0; r < o->own; r++)
            LOOP (i, r * o->columns + at, r * o->columns + at + s->steps) {
                double off = trial[i] - o->drawn[i];
                point->cost += o->weight * off * off;
            }
    }
}

/* Take the step in own variables and in multipliers of equalities. */
static void accept_slots(slots *o, double primal) {
    LOOP (c, 0, o->own * o->columns) o->a[c] += primal * o->da[c];
    double *y = o->y + o->unequal * o->columns;
    const double *negative = o->da + o->own * o->columns; /* the step solves for -y */
    LOOP (c, 0, (o->stated - o->unequal) * o->columns) y[c] -= primal * (negative[c] + y[c]);
}

/* Take the step in the own variables back. */
static void undo_slots(slots *o, double length) {
    LOOP (c, 0, o->own * o->columns) o->a[c] -= length * o->da[c];
}

/* Derivative of the regularisation along the step. */
static double slope_of_slots(const core *s, const slots *o) {
    double total = 0.0;
    for (int64_t r = 0; r < o->own; r++)
        for (int64_t at = r * o->columns; at < (r + 1) * o->columns; at += s->wide)
            LOOP (c, at, at + s->steps)
                total += 2.0 * o->weight * (o->a[c] - o->drawn[c]) * o->da[c];
    return total;
}

/* Add the forces of h and e to the gradient of the Lagrangian in states, level and own variables,
 * and residuals of equalities to the tally. Returns the force on the level. */
static double stationarity_of_slots(core *s, slots *o) {
    const int64_t wide = s->wide, columns = o->columns, entries = o->kind->entries;
    double force = 0.0;
    LOOP (c, 0, o->own * columns) o->pull[c] = 2.0 * o->weight * (o->a[c] - o->drawn[c]);
    for (int64_t at = 0; at < columns; at += wide)
        for (int64_t j = 0; j < o->stated; j++) {
            const double *y = o->y + j * columns + at;
            const double *slope = o->slope + j * o->w * columns + at;
            for (int64_t r = 0; r < entries; r++, slope += columns) {
                double *pull = s->pull + o->kind->depends[r] * wide + 1;
                LOOP (i, 0, s->steps) pull[i] -= y[i] * slope[i];
            }
            if (s->shared) {
                LOOP (i, 0, s->steps) force -= y[i] * slope[i];
                slope += columns;
            }
            for (int64_t r = 0; r < o->own; r++, slope += columns) {
                double *pull = o->pull + r * columns + at;
                LOOP (i, 0, wide) pull[i] -= y[i] * slope[i];
            }
            double *sum = s->tally + PRESSURE * wide, *off = s->tally + RESIDUAL * wide;
            if (j < o->unequal)
                LOOP (i, 0, wide) sum[i] += y[i];
            else
                LOOP (i, 0, wide) off[i] = max_or_nan(fabs(o->out[j * columns + at + i]), off[i]);
        }
    return force;
}

/* ---- Newton step */

/* Where entry (row, column) of the matrix stands; its part up to the diagonal is used. */
#define ENTRY(row, column)                                                                         \
    (matrix + ((row) >= (column) ? (row) * size + (column) : (column) * size + (row)) * LANES)

/* Write the Hessian in (x, s, a) with what bounds and regularisation add, for LANES columns from
 * `at` on. */
static void curvature_of_slots(const slots *o, int64_t at, int64_t size, double *restrict matrix,
                               double *restrict force) {
    const int64_t row = o->columns;
    LOOP (c, 0, size * size * LANES) matrix[c] = 0.0;
    LOOP (c, 0, size * LANES) force[c] = 0.0;
    for (int64_t r = 0; r < o->w; r++)
        for (int64_t c = 0; c <= r; c++) {
            const int64_t a = o->order[r];
            const int64_t b = o->order[c];
            const double *given = o->hessian + (r * o->w + c) * row + at;
            double *entry = ENTRY(a, b);
            LOOP (l, 0, LANES) entry[l] = given[l];
        }
    for (int64_t r = 0; r < o->own; r++) {
        const double *curve = o->curve + r * row + at, *side = o->side + r * row + at;
        double *entry = ENTRY(r, r);
        LOOP (l, 0, LANES) {
            entry[l] += curve[l];
            force[r * LANES + l] = side[l];
        }
    }
}

/* Add an inequality, (t, y) eliminated. */
static void add_inequality(const core *s, const slots *o, int64_t j, int64_t at, int64_t size,
                           double *restrict matrix, double *restrict force) {
    const int64_t row = o->columns, k = j * row + at;
    const double *eps = s->eps + at % s->wide, *slope = o->slope + j * o->w * row + at;
    double sigma[LANES], weight[LANES];
    LOOP (l, 0, LANES) {
        double inverse = 1.0 / o->t[k + l];
        sigma[l] = o->y[k + l] * inverse;
        weight[l] = s->mu * inverse - sigma[l] * (o->out[k + l] + eps[l] - o->t[k + l]);
    }
    double *entry = ENTRY(size - 1, size - 1), *side = force + (size - 1) * LANES;
    LOOP (l, 0, LANES) {
        entry[l] += sigma[l];
        side[l] -= weight[l];
    }
    for (int64_t r = 0; r < o->w; r++, slope += row) {
        const int64_t a = o->order[r];
        const double *other = o->slope + j * o->w * row + at;
        double product[LANES];
        side = force + a * LANES, entry = ENTRY(size - 1, a);
        LOOP (l, 0, LANES) {
            product[l] = sigma[l] * slope[l];
            entry[l] += product[l];
            side[l] -= weight[l] * slope[l];
        }
        for (int64_t c = 0; c <= r; c++, other += row) {
            entry = ENTRY(a, o->order[c]);
            LOOP (l, 0, LANES) entry[l] += product[l] * other[l];
        }
    }
}

/* Add an equality and its multiplier. */
static void add_equality(const slots *o, int64_t j, int64_t at, int64_t size,
                         double *restrict matrix, double *restrict force) {
    const int64_t row = o->columns, e = o->own + j - o->unequal;
    const double *slope = o->slope + j * o->w * row + at, *value = o->out + j * row + at;
    for (int64_t r = 0; r < o->w; r++, slope += row) {
        double *entry = ENTRY(e, o->order[r]);
        LOOP (l, 0, LANES) entry[l] = slope[l];
    }
    double *entry = ENTRY(e, e);
    LOOP (l, 0, LANES) {
        entry[l] = -WB_EQUALITY_REGULARISATION;
        force[e * LANES + l] = value[l];
    }
}

/* Eliminate the first `inner` unknowns: own variables need positive pivots, multipliers of
 * equalities negative ones. Returns whether they are, in the first `count` lanes. */
static int reduce_slots(const slots *o, int64_t inner, int64_t size, int64_t count,
                        double *restrict matrix, double *restrict force) {
    int sound = 1;
    for (int64_t j = 0; j < inner; j++) {
        const double *pivot = ENTRY(j, j), sign = j < o->own ? 1.0 : -1.0;
        double inverse[LANES], factor[LANES];
        for (int64_t l = 0; l < count; l++) sound &= sign * pivot[l] > WB_SMALLEST_OWN_PIVOT;
        LOOP (l, 0, LANES) inverse[l] = 1.0 / pivot[l];
        for (int64_t r = j + 1; r < size; r++) {
            const double *column = ENTRY(r, j);
            LOOP (l, 0, LANES) factor[l] = column[l] * inverse[l];
            LOOP (l, 0, LANES) force[r * LANES + l] -= factor[l] * force[j * LANES + l];
            for (int64_t k = j + 1; k <= r; k++) {
                double *entry = ENTRY(r, k);
                const double *other = ENTRY(k, j);
                LOOP (l, 0, LANES) entry[l] -= factor[l] * other[l];
            }
        }
    }
    return sound;
}

/* Solve for the inner unknowns as functions of (x, s, eps, 1), and keep that for later. */
static void solve_slots(const slots *o, int64_t at, int64_t inner, int64_t size,
                        const double *restrict matrix, const double *restrict force) {
    const int64_t outer = size - inner, row = o->columns;
    for (int64_t j = inner - 1; j >= 0; j--) {
        const double *pivot = ENTRY(j, j);
        for (int64_t c = 0; c <= outer; c++) {
            const double *right = c < outer ? ENTRY(inner + c, j) : force + j * LANES;
            double value[LANES];
            LOOP (l, 0, LANES) value[l] = right[l];
            for (int64_t k = j + 1; k < inner; k++) {
                const double *entry = ENTRY(k, j);
                const double *later = o->back + (k * (outer + 1) + c) * row + at;
                LOOP (l, 0, LANES) value[l] += entry[l] * later[l];
            }
            double *into = o->back + (j * (outer + 1) + c) * row + at;
            LOOP (l, 0, LANES) into[l] = -value[l] / pivot[l];
        }
    }
}

/* Add what is left in (x, s, eps) to the stages. */
static void add_to_region(const core *s, const slots *o, int64_t at, int64_t inner, int64_t size,
                          const double *restrict matrix, const double *restrict force) {
    const int64_t stage = at % s->wide;
    for (int64_t r = 0; r <= o->first; r++) {
        double *into = s->force + o->place[r] * s->wide + stage;
        LOOP (l, 0, LANES) into[l] += force[(inner + r) * LANES + l];
        for (int64_t c = 0; c <= r; c++) {
            const double *entry = ENTRY(inner + r, inner + c);
            into = s->region + triangle(o->place[r], o->place[c]) * s->wide + stage;
            LOOP (l, 0, LANES) into[l] += entry[l];
        }
    }
}

/* Condense the slots of a kind; returns whether the curvature in their own variables is right. */
static int condense_slots(const core *s, const slots *o) {
    const int64_t inner = o->own + o->stated - o->unequal, size = inner + o->first + 1;
    double *matrix = s->matrix, *force = s->matrix + size * size * LANES;
    for (int64_t at = 0; at < o->columns; at += LANES) {
        int64_t count = s->steps - at % s->wide;
        count = count < 0 ? 0 : count > LANES ? LANES : count;
        curvature_of_slots(o, at, size, matrix, force);
        for (int64_t j = 0; j < o->unequal; j++) add_inequality(s, o, j, at, size, matrix, force);
        for (int64_t j = o->unequal; j < o->stated; j++)
            add_equality(o, j, at, size, matrix, force);
        if (!reduce_slots(o, inner, size, count, matrix, force)) return 0;
        solve_slots(o, at, inner, size, matrix, force);
        add_to_region(s, o, at, inner, size, matrix, force);
    }
    return 1;
}

/* Write the steps of own variables and of the slacks t. */
static void expand_slots(const core *s, slots *o) {
    const int64_t wide = s->wide, row = o->columns, entries = o->kind->entries;
    const int64_t inner = o->own + o->stated - o->unequal, outer = o->first + 1;
    for (int64_t at = 0; at < row; at += wide) {
        for (int64_t j = 0; j < inner; j++) {
            const double *back = o->back + j * (outer + 1) * row + at;
            double *step = o->da + j * row + at;
            LOOP (i, 0, wide)
                step[i] = back[outer * row + i] + back[o->first * row + i] * s->deps[i];
            for (int64_t r = 0; r < entries; r++) {
                const double *dx = s->dv + o->kind->depends[r] * wide + 1;
                LOOP (i, 0, s->steps) step[i] += back[r * row + i] * dx[i];
            }
            if (s->shared)
                LOOP (i, 0, wide) step[i] += back[entries * row + i] * s->dlevel;
        }
        for (int64_t j = 0; j < o->unequal; j++) {
            const int64_t k = j * row + at;
            const double *slope = o->slope + j * o->w * row + at;
            double *dt = o->dt + k;
            LOOP (i, 0, wide) dt[i] = o->out[k + i] + s->eps[i] + s->deps[i] - o->t[k + i];
            for (int64_t r = 0; r < entries; r++, slope += row) {
                const double *dx = s->dv + o->kind->depends[r] * wide + 1;
                LOOP (i, 0, s->steps) dt[i] += slope[i] * dx[i];
            }
            if (s->shared) {
                LOOP (i, 0, wide) dt[i] += slope[i] * s->dlevel;
                slope += row;
            }
            for (int64_t r = 0; r < o->own; r++, slope += row)
                LOOP (i, 0, wide) dt[i] += slope[i] * o->da[r * row + at + i];
        }
    }
}
#undef ENTRY
