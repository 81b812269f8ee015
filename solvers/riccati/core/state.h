/* What a solve works on. Every quantity of a stage is a row whose entries run over the stages, so
 * that one call of a stage function serves all of them, and loops run over neighbours in memory.
 * Rows have `wide` columns, at least N + 1 and a multiple of 8. What stands in columns that no
 * stage has is never read. */

#if defined(_MSC_VER) && !defined(__clang__)
#define INLINE __forceinline
#else
#define INLINE inline __attribute__((always_inline))
#endif

/* A loop whose turns do not depend on each other. */
#define LOOP(i, first, end) WB_INDEPENDENT for (int64_t i = (first); i < (end); i++)

/* Columns of slots that are eliminated at once. */
enum { LANES = 8 };

/* Rows of the tally of each stage: the largest residual, error of complementarity, and the sum of
 * the multipliers that press on the stage's slack. */
enum { RESIDUAL, COMPLEMENTARITY, PRESSURE, TALLIES };

/* Answers of the filter: the last accepts the trial point and adds the present one. */
enum { REFUSE, ACCEPT, ACCEPT_AND_ADD };

/* A row of inequalities from step `first` on: value + eps = t > 0, multiplier y. A bound is one
 * whose value is the slack itself. */
typedef struct {
    int64_t first;
    const double *value, *tried, *eps, *trial_eps; /* tried: value at the trial point */
    double *t, *dt, *y, *dy;
    const double *slope;  /* of the robot's alone, `width` rows */
    int64_t width, after; /* after: 1 where it is about x_{i+1} */
} inequality;

/* A bound of one variable at all steps: sign (x - at) > 0. */
typedef struct {
    const inequality *row;
    double at, sign;
    const double *dx, *trial;
    double *tried, *pull;     /* pull: gradient of the Lagrangian */
    double *curve, *gradient; /* of the condensed quadratic */
} bound;

/* Slots in use of one kind. Column c = k wide + i belongs to the k-th of them and stage i + 1. */
typedef struct {
    const wb_kind *kind;
    const wb_slots *given;
    int64_t *active, *order, *place;                        /* slots in use; see `order_slots` */
    int64_t count, columns, own, unequal, stated, first, w; /* stated: h and e; first: x's entries
                                                               and s; w: with own variables */
    double weight;                                          /* of the regularisation, scaled */
    double *v, *p, *out;                                    /* for the function `derivatives` */
    double *trial, *tried;                                  /* for the function `values` */
    double *a, *y, *slope, *hessian; /* parts of them: own variables, multipliers; results */
    double *t, *dt, *zl, *zu, *drawn, *pull, *curve, *side,
        *da;      /* da: behind them new multipliers of -e */
    double *back; /* rows that give da from the steps of (x, s, eps, 1) */
} slots;

typedef struct {
    const wb_problem *problem;
    const wb_settings *settings;
    const wb_start *start;
    wb_result *result;
    int64_t n, m, w, shared, steps, wide;
    int64_t at_jacobian, at_hessian; /* rows of [A B] and of the Hessian in `drive` */
    /* variables: rows (x, u, pi, y) and (x of the next stage, y) */
    double *v, *vn, *dv, *dpi, *zl, *zu;
    double *trial_v, *trial_vn;
    /* results of the stage functions; drive, trial_node and level_tried at the trial point */
    double *columns, *drive, *node, *gap, *trial_node;
    double *level_v, *level_p, *level_out, *level_tried;
    /* slack of the regions */
    double *eps, *nu, *deps, *dnu, *trial_eps, *none, *zs_row;
    /* condensed quadratic without `drive`; region: lower triangle in (x's entries seen, s, eps) */
    double *hessian, *gradient, *cross, *region, *force;
    double *stages, *product, *move, *next, *matrix;
    double *pull, *tally, *filter, *work;
    double top[2];             /* curvature and slope of the level */
    int64_t *seen, seen_count; /* entries of x that slots depend on */
    int64_t quadratic_size;
    inequality *rows; /* first those of the robot, of slots, of bounds, at last eps > 0 */
    bound *bounds;    /* first those of states and inputs */
    int64_t row_count, robot_count, bounds_from, given_count, bound_count, path_bounds;
    double **multipliers; /* rows in the order of `wb_start` */
    int64_t multiplier_rows;
    double *spare;
    slots *slots;
    int64_t slot_count, multiplier_count;
    /* single numbers */
    double scale, mu, rho, level, dlevel, zs, dzs,
        minimum; /* zs: multiplier of the level's minimum */
    double delta, theta_most, theta_least, length, share;
    int64_t entries, failed_searches; /* entries of the filter */
} core;

/* A point's residual theta; cost, with slack; logarithms, phi = cost - mu logarithms; plain cost.
 */
typedef struct {
    double theta, cost, logarithms, plain;
} merit;

/* ---- Single numbers */

static INLINE double larger(double a, double b) { return b > a ? b : a; }

static INLINE double smaller(double a, double b) { return b < a ? b : a; }

/* Whichever is larger; NaN wins. */
static INLINE double max_or_nan(double value, double most) { return value <= most ? most : value; }

static INLINE int64_t triangle(int64_t r, int64_t c) {
    return r >= c ? r * (r + 1) / 2 + c : c * (c + 1) / 2 + r;
}

/* Slack after a step: the value itself, unless that is far below what the step leads to.
 *
 * The step leaves at least a share `least` of it. The value of a constraint bends along the step;
 * with a slack that follows it, this is no residual that a later step would have to remove. */
static INLINE double next_slack(double t, double step, double here, double least) {
    double led = larger(t + step, least * t);
    return here >= WB_NEAR * led ? here : led;
}

/* Keep a multiplier within a huge factor of mu / gap (eq. 16). */
static INLINE double clip_multiplier(double z, double gap, double mu) {
    double middle = mu / gap;
    return larger(smaller(z, WB_MULTIPLIER_RANGE * middle), middle / WB_MULTIPLIER_RANGE);
}

/* A multiplier within a factor of mu / gap; NaN becomes mu / gap. */
static double known_multiplier(double z, double gap, double mu) {
    if (z != z) return mu / gap;
    return larger(smaller(z, WB_WARM_RANGE * mu / gap), mu / (WB_WARM_RANGE * gap));
}

/* Longest step that keeps 1 - share of what decreases by at most `most` times its value. */
static double longest_step(double most, double share) { return most > share ? share / most : 1.0; }

/* Move a value off its bounds by a share of the distance between them. */
static double push_inside(double value, double lower, double upper, double push) {
    double range = upper - lower;
    if (lower > -INFINITY)
        value = larger(value, lower + push * smaller(larger(1.0, fabs(lower)), range));
    if (upper < INFINITY)
        value = smaller(value, upper - push * smaller(larger(1.0, fabs(upper)), range));
    return value;
}

/* Multiply a factor to a product whose logarithm is wanted, without one call per factor. */
static INLINE void add_logarithm(double *total, double *product, double value) {
    *product *= value;
    if (!(*product > 1e-200 && *product < 1e200)) {
        *total += log(*product);
        *product = 1.0;
    }
}

/* Call a stage function for columns of arrays whose rows have `row` numbers. */
static void call(const core *s, const wb_kernel *kernel, int64_t count, int64_t row,
                 const double *v, const double *p, double *out) {
    const int64_t bytes = row * (int64_t)sizeof *v;
    kernel->run(kernel->program, 0, count, v, bytes, p, bytes, out, bytes, s->work);
}
