/* Newton step: Riccati recursion over the horizon, for one robot's sizes.
 *
 *   minimise    sum_i  dw_i H_i dw_i / 2 + g_i dw_i + ds h_i dx_i   +   top of ds
 *   subject to  dx_{i+1} = A_i dx_i + B_i du_i + gap_i,  dx_0 = 0.
 *
 * The one level s is shared by all stages. It is carried as a second right-hand side: with the
 * value function x P x / 2 + (p + q ds) x the recursion for q is that for p without its constant
 * terms, and what is left at stage 0 is a parabola in ds.
 *
 * J. B. Rawlings, D. Q. Mayne, M. M. Diehl, Model Predictive Control (2017), section 8.8.
 *
 * Each stage has a record of n + w rows of `wide_row(w)` numbers:
 *
 *   A B gap 0      n rows
 *   P . p q        n rows, columns of (x, u) and two right-hand sides
 *   K . k ks       m rows, feedback du = K dx + k + ks ds
 *
 * Rows are padded to a multiple of 4 numbers. Everything is inlined with constant n and m, so that
 * the compiler unrolls the loops; a generic version has them as variables.
 */

/* Numbers of a row: (x, u), two right-hand sides, padding. */
static INLINE int64_t wide_row(int64_t w) { return (w + 2 + 3) / 4 * 4; }

/* Write (A B gap) of stage i into its record. */
static INLINE void load_dynamics(const core *s, int64_t n, int64_t w, int64_t i, double *ab) {
    const int64_t row = wide_row(w), wide = s->wide;
    for (int64_t r = 0; r < n; r++) {
        const double *slopes = s->drive + (s->at_jacobian + r * w) * wide + i;
        for (int64_t c = 0; c < w; c++) ab[r * row + c] = slopes[c * wide];
        ab[r * row + w] = s->gap[r * wide + i];
        for (int64_t c = w + 1; c < row; c++) ab[r * row + c] = 0.0;
    }
}

/* Write the stage's own quadratic, (H g h), into the rows of the condensed one. */
static INLINE void load_quadratic(const core *s, int64_t n, int64_t w, int64_t i, double *curve) {
    const int64_t row = wide_row(w), wide = s->wide;
    const double *more = s->hessian + i, *own = s->drive + s->at_hessian * wide + i;
    for (int64_t r = 0; r < w; r++) {
        for (int64_t c = 0; c <= r; c++, more += wide) {
            double value = *more + own[(r * w + c) * wide];
            curve[r * row + c] = curve[c * row + r] = value;
        }
        curve[r * row + r] += s->delta;
        curve[r * row + w] = s->gradient[r * wide + i] + s->drive[(n + 1 + r) * wide + i];
        curve[r * row + w + 1] = r < n ? s->cross[r * wide + i] : 0.0;
        for (int64_t c = w + 2; c < row; c++) curve[r * row + c] = 0.0;
    }
}

/* Add (A B)' P (A B) with the right-hand sides; `value` are the rows P . p q of the next stage. */
static INLINE void add_value(int64_t n, int64_t w, const double *restrict ab,
                             const double *restrict value, double *restrict product,
                             double *restrict curve) {
    const int64_t row = wide_row(w);
    for (int64_t r = 0; r < n; r++) {
        double *line = product + r * row;
        for (int64_t c = 0; c < row; c++) line[c] = 0.0;
        line[w] = value[r * row + w];
        line[w + 1] = value[r * row + w + 1];
        for (int64_t k = 0; k < n; k++)
            for (int64_t c = 0; c < row; c++) line[c] += value[r * row + k] * ab[k * row + c];
    }
    for (int64_t r = 0; r < w; r++)
        for (int64_t k = 0; k < n; k++)
            for (int64_t c = 0; c < row; c++)
                curve[r * row + c] += ab[k * row + r] * product[k * row + c];
}

/* Eliminate the inputs one after the other; returns whether all pivots were positive. */
static INLINE int eliminate_inputs(int64_t n, int64_t w, double *restrict curve, double *top) {
    const int64_t row = wide_row(w);
    for (int64_t a = n; a < w; a++) {
        const double *restrict pivot = curve + a * row;
        if (!(pivot[a] > WB_SMALLEST_PIVOT)) return 0;
        const double inverse = 1.0 / pivot[a];
        for (int64_t r = 0; r < w; r++) {
            if (r >= n && r <= a) continue;
            const double factor = pivot[r] * inverse;
            double *restrict line = curve + r * row;
            for (int64_t c = 0; c < row; c++) line[c] -= factor * pivot[c];
        }
        top[0] -= pivot[w + 1] * inverse * pivot[w + 1];
        top[1] -= pivot[w + 1] * inverse * pivot[w];
    }
    return 1;
}

/* Turn what the elimination left of the inputs' rows into their feedback. */
static INLINE void solve_inputs(int64_t n, int64_t w, double *restrict curve) {
    const int64_t row = wide_row(w);
    for (int64_t a = w - 1; a >= n; a--) {
        double *restrict line = curve + a * row;
        const double inverse = -1.0 / line[a];
        for (int64_t b = a + 1; b < w; b++) {
            const double *restrict later = curve + b * row, factor = line[b];
            for (int64_t c = 0; c < n; c++) line[c] += factor * later[c];
            line[w] += factor * later[w];
            line[w + 1] += factor * later[w + 1];
        }
        for (int64_t c = 0; c < n; c++) line[c] *= inverse;
        line[w] *= inverse;
        line[w + 1] *= inverse;
    }
}

/* Recursion from the last stage to the first; 0 where the curvature is wrong. */
static INLINE int backward_of(core *s, const int64_t n, const int64_t m) {
    const int64_t w = n + m, row = wide_row(w), record = (n + w) * row, last = s->steps;
    double *value = s->stages + last * record + n * row;
    for (int64_t r = 0; r < n; r++) {
        for (int64_t c = 0; c <= r; c++)
            value[r * row + c] = value[c * row + r] = s->hessian[triangle(r, c) * s->wide + last];
        value[r * row + r] += s->delta;
        value[r * row + w] = s->gradient[r * s->wide + last];
        value[r * row + w + 1] = s->cross[r * s->wide + last];
    }
    for (int64_t i = last - 1; i >= 0; i--) {
        double *ab = s->stages + i * record, *curve = ab + n * row;
        load_dynamics(s, n, w, i, ab);
        load_quadratic(s, n, w, i, curve);
        for (int64_t r = 0; r < n; r++) s->top[1] += value[r * row + w + 1] * ab[r * row + w];
        add_value(n, w, ab, value, s->product, curve);
        if (!eliminate_inputs(n, w, curve, s->top)) return 0;
        solve_inputs(n, w, curve);
        value = curve;
    }
    if (s->shared) {
        double curvature = s->top[0] + s->delta;
        if (!(curvature > WB_SMALLEST_PIVOT)) return 0;
        s->dlevel = -s->top[1] / curvature;
    }
    return 1;
}

/* Write the steps of states and inputs, and of the multipliers of the dynamics; returns 1. */
static INLINE int forward_of(core *s, const int64_t n, const int64_t m) {
    const int64_t w = n + m, row = wide_row(w), record = (n + w) * row, wide = s->wide;
    double *move = s->move;
    for (int64_t r = 0; r < n; r++) move[r] = 0.0;
    for (int64_t i = 0; i < s->steps; i++) {
        const double *ab = s->stages + i * record, *gain = ab + 2 * n * row;
        const double *value = ab + record + n * row;
        double *next = s->next;
        for (int64_t a = 0; a < m; a++) {
            double step = gain[a * row + w] + gain[a * row + w + 1] * s->dlevel;
            for (int64_t c = 0; c < n; c++) step += gain[a * row + c] * move[c];
            move[n + a] = s->dv[(n + a) * wide + i] = step;
        }
        for (int64_t r = 0; r < n; r++) {
            double step = ab[r * row + w];
            for (int64_t c = 0; c < w; c++) step += ab[r * row + c] * move[c];
            next[r] = s->dv[r * wide + i + 1] = step;
        }
        for (int64_t r = 0; r < n; r++) {
            double pi = value[r * row + w] + value[r * row + w + 1] * s->dlevel;
            for (int64_t c = 0; c < n; c++) pi += value[r * row + c] * next[c];
            s->dpi[r * wide + i] = pi - s->v[(w + r) * wide + i];
        }
        for (int64_t r = 0; r < n; r++) move[r] = next[r];
    }
    return 1;
}

/* Call a function with the sizes of the shipped robots as constants, or with any. */
#define WITH_SIZES(function)                                                                       \
    switch (256 * s->n + s->m) {                                                                   \
    case 0x202: return function(s, 2, 2);                                                          \
    case 0x302: return function(s, 3, 2);                                                          \
    case 0x402: return function(s, 4, 2);                                                          \
    case 0x502: return function(s, 5, 2);                                                          \
    case 0x603: return function(s, 6, 3);                                                          \
    default: return function(s, s->n, s->m);                                                       \
    }

static int backward(core *s) { WITH_SIZES(backward_of) }

static int forward(core *s) { WITH_SIZES(forward_of) }
