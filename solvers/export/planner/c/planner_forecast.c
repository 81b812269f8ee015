/* Forecasts of obstacles: Kalman filter or interacting models, online calibration, and the way
 * onto the plan's time grid. What wideberth.predictors does in Python. */
#include "planner_parts.h"

#include <math.h>
#include <string.h>

#define LONGEST_GAP 5   /* missing samples in a row that are bridged */
#define NEVER_SEEN 1e3  /* m, deviation of an obstacle of which not one sample is known */
#define ROUNDING 1e-12  /* share of its trace below which an eigenvalue is rounding */
#define FAINTEST -690.0 /* least logarithm of a model's probability over the likeliest one's */
#define SMALLEST WIDEBERTH_PLAN_SMALLEST

void wb_axes(const double *matrix, double *values, double *vectors)
{
    const double a = matrix[0], b = 0.5 * (matrix[1] + matrix[2]), c = matrix[3];
    const double apart = hypot(a - c, 2.0 * b), angle = 0.5 * atan2(2.0 * b, a - c);
    double cosine = cos(angle), sine = sin(angle);
    if (b == 0.0) cosine = a >= c ? 1.0 : 0.0, sine = a >= c ? 0.0 : 1.0;
    values[0] = b == 0.0 ? fmax(a, c) : 0.5 * (a + c + apart);
    values[1] = b == 0.0 ? fmin(a, c) : 0.5 * (a + c - apart);
    vectors[0] = cosine, vectors[1] = -sine, vectors[2] = sine, vectors[3] = cosine;
}

static int seen_at(const double *place)
{
    return isfinite(place[0]) && isfinite(place[1]);
}

/* First column of the history: the oldest sample seen after the newest long gap. */
static int beginning(const int *seen, int length)
{
    int k, first = length, missing = 0, some = 0;
    for (k = 0; k < length; k++) {
        if (!seen[k]) {
            missing++;
            continue;
        }
        if (!some || missing > LONGEST_GAP) first = k;
        some = 1, missing = 0;
    }
    return first;
}

/* Prepare the history of one obstacle, see predictors/core/history.py. */
static void gather(const struct track *track, int length, struct past *past)
{
    int late = 0, k, r;
    memset(past, 0, sizeof(*past));
    past->length = length;
    while (late < PLAN_SAMPLES && !seen_at(track->places[PLAN_SAMPLES - 1 - late])) late++;
    for (k = 0; k < length; k++) {
        const int column = PLAN_SAMPLES - length - late + k;
        past->observed[k] = column >= 0 && seen_at(track->places[column]);
    }
    past->began = beginning(past->observed, length);
    past->late = past->began < length ? late : 0;
    if (past->began == length) return;
    memcpy(past->origin, track->places[PLAN_SAMPLES - 1 - late], sizeof(past->origin));
    for (k = 0; k < length; k++) {
        past->observed[k] = past->observed[k] && k >= past->began;
        past->samples += past->observed[k];
        for (r = 0; past->observed[k] && r < 2; r++)
            past->places[k][r] = track->places[PLAN_SAMPLES - length - late + k][r] - past->origin[r];
    }
}

static void measurement_noise(const struct track *track, double *noise)
{
    const double trace = track->noise[0] + track->noise[3];
    const double least = fmax(PLAN_NOISE_FLOOR * PLAN_NOISE_FLOOR, ROUNDING * trace);
    memcpy(noise, track->noise, 4 * sizeof(double));
    noise[0] += least, noise[3] += least;
}

static void never_seen(int steps, double (*mean)[2], double (*covariance)[4])
{
    int h;
    for (h = 0; h < steps; h++) {
        mean[h][0] = mean[h][1] = 0.0;
        covariance[h][0] = covariance[h][3] = NEVER_SEEN * NEVER_SEEN;
        covariance[h][1] = covariance[h][2] = 0.0;
    }
}

#if PLAN_MODELS == 1

/* ---- A Kalman filter on position and velocity: each axis of the noise on its own */

static void advanced(double *p) /* pp, pv, vv of one axis, one step on */
{
    const double dt = PLAN_TRACK_DT;
    const double pp = p[0] + dt * p[1] + dt * (p[1] + dt * p[2]), pv = p[1] + dt * p[2];
    p[0] = pp + PLAN_PROCESS[0], p[1] = pv + PLAN_PROCESS[1], p[2] += PLAN_PROCESS[2];
}

/* Filter one axis: position and velocity, and their covariance. */
static void filtered(const struct past *past, const double *direction, double variance,
    double *state, double *p)
{
    int k;
    state[0] = direction[0] * past->places[past->began][0]
        + direction[1] * past->places[past->began][1];
    state[1] = 0.0;
    p[0] = variance, p[1] = 0.0, p[2] = PLAN_SPEED_VARIANCE;
    for (k = past->began + 1; k < past->length; k++) {
        const double ahead = state[0] + PLAN_TRACK_DT * state[1];
        double total, gain[2], rest[3], gap;
        advanced(p);
        state[0] = ahead;
        if (!past->observed[k]) continue;
        total = fmax(p[0], 0.0) + variance;
        gain[0] = p[0] / total, gain[1] = p[1] / total;
        rest[0] = p[0] - gain[0] * p[0], rest[1] = p[1] - gain[1] * p[0];
        rest[2] = p[2] - gain[1] * p[1];
        p[0] = rest[0] - (rest[0] - variance * gain[0]) * gain[0];
        p[1] = rest[1] - (rest[1] - variance * gain[1]) * gain[0];
        p[2] = rest[2] - (rest[1] - variance * gain[1]) * gain[1];
        gap = direction[0] * past->places[k][0] + direction[1] * past->places[k][1] - ahead;
        state[0] = ahead + gain[0] * gap, state[1] += gain[1] * gap;
    }
}

static void predict_one(const struct track *track, int steps, struct past *past,
    double (*mean)[2], double (*covariance)[4])
{
    double noise[4], values[2], vectors[4], state[2][2], p[2][3], grown[3] = {0.0, 0.0, 0.0};
    int h, axis, r, c;
    gather(track, PLAN_FILTERED, past);
    if (!past->samples) {
        never_seen(steps, mean, covariance);
        return;
    }
    measurement_noise(track, noise);
    wb_axes(noise, values, vectors);
    for (axis = 0; axis < 2; axis++) {
        const double direction[2] = {vectors[axis], vectors[2 + axis]};
        filtered(past, direction, values[axis], state[axis], p[axis]);
    }
    for (h = 1; h <= steps + past->late; h++) {
        const double time = PLAN_TRACK_DT * h;
        const int at = h - 1 - past->late;
        advanced(grown);
        if (at < 0) continue;
        for (r = 0; r < 2; r++) {
            mean[at][r] = past->origin[r];
            for (axis = 0; axis < 2; axis++)
                mean[at][r] += vectors[2 * r + axis] * (state[axis][0] + time * state[axis][1]);
            for (c = 0; c < 2; c++) {
                double sum = r == c ? grown[0] : 0.0;
                for (axis = 0; axis < 2; axis++)
                    sum += vectors[2 * r + axis] * vectors[2 * c + axis]
                        * (p[axis][0] + 2.0 * time * p[axis][1] + time * time * p[axis][2]);
                covariance[at][2 * r + c] = sum;
            }
        }
    }
}

#else

/* ---- Interacting models: Kalman filters that are mixed, each as likely as it fits */

enum { S = 4, M = PLAN_MODELS };

struct beliefs {
    double weight[M], state[M][S], covariance[M][S][S];
};

static void mixed(const struct beliefs *now, struct beliefs *found)
{
    int i, j, a, b;
    for (j = 0; j < M; j++) {
        double share[M], sum = 0.0;
        for (i = 0; i < M; i++) sum += PLAN_SWITCHING[i][j] * now->weight[i];
        found->weight[j] = sum;
        for (i = 0; i < M; i++) share[i] = PLAN_SWITCHING[i][j] * now->weight[i] / sum;
        for (a = 0; a < S; a++) {
            found->state[j][a] = 0.0;
            for (i = 0; i < M; i++) found->state[j][a] += share[i] * now->state[i][a];
        }
        for (a = 0; a < S; a++) {
            for (b = 0; b < S; b++) {
                double inner = 0.0, outer = 0.0;
                for (i = 0; i < M; i++) {
                    const double gap = now->state[i][a] - found->state[j][a];
                    const double other = now->state[i][b] - found->state[j][b];
                    inner += share[i] * now->covariance[i][a][b];
                    outer += share[i] * gap * other;
                }
                found->covariance[j][a][b] = inner + outer;
            }
        }
    }
}

static void stepped(const struct beliefs *now, struct beliefs *found)
{
    struct beliefs before;
    int j, a, b, k;
    mixed(now, &before);
    memcpy(found->weight, before.weight, sizeof(found->weight));
    for (j = 0; j < M; j++) {
        double half[S][S];
        for (a = 0; a < S; a++) {
            found->state[j][a] = 0.0;
            for (k = 0; k < S; k++)
                found->state[j][a] += PLAN_TRANSITION[j][a][k] * before.state[j][k];
            for (b = 0; b < S; b++) {
                half[a][b] = 0.0;
                for (k = 0; k < S; k++)
                    half[a][b] += PLAN_TRANSITION[j][a][k] * before.covariance[j][k][b];
            }
        }
        for (a = 0; a < S; a++) {
            for (b = 0; b < S; b++) {
                double sum = 0.0;
                for (k = 0; k < S; k++) sum += half[a][k] * PLAN_TRANSITION[j][b][k];
                found->covariance[j][a][b] = sum + PLAN_PROCESS[j][a][b];
            }
        }
    }
}

/* Take in one position, one axis after the other, and weigh the models by it. */
static void updated(struct beliefs *now, const double *place, const double *variance)
{
    double logarithm[M], best = -INFINITY, sum = 0.0;
    int j, axis, a, b;
    for (j = 0; j < M; j++) {
        double (*p)[S] = now->covariance[j], density = 0.0;
        for (axis = 0; axis < 2; axis++) {
            const double total = fmax(p[axis][axis], 0.0) + variance[axis];
            const double gap = place[axis] - now->state[j][axis];
            double gain[S], kept[S][S];
            for (a = 0; a < S; a++) gain[a] = p[a][axis] / total;
            for (a = 0; a < S; a++)
                for (b = 0; b < S; b++) kept[a][b] = p[a][b] - gain[a] * p[b][axis];
            for (a = 0; a < S; a++)
                for (b = 0; b < S; b++)
                    p[a][b] = kept[a][b] - (kept[a][axis] - variance[axis] * gain[a]) * gain[b];
            for (a = 0; a < S; a++) now->state[j][a] += gain[a] * gap;
            density -= 0.5 * (log(2.0 * PI * total) + gap * gap / total);
        }
        logarithm[j] = log(now->weight[j]) + density;
        best = fmax(best, logarithm[j]);
    }
    for (j = 0; j < M; j++) {
        now->weight[j] = exp(fmax(logarithm[j] - best, FAINTEST));
        sum += now->weight[j];
    }
    for (j = 0; j < M; j++) now->weight[j] /= sum;
}

static void begun(const double *place, const double *variance, struct beliefs *found)
{
    int j, a;
    memset(found, 0, sizeof(*found));
    for (j = 0; j < M; j++) {
        found->weight[j] = PLAN_USUAL[j];
        for (a = 0; a < 2; a++) {
            found->state[j][a] = place[a];
            found->covariance[j][a][a] = variance[a];
            found->covariance[j][2 + a][2 + a] = PLAN_SPEED_VARIANCE;
        }
    }
}

/* Turn the axes of the noise into those of the world. */
static void turned(struct beliefs *now, const double *vectors)
{
    double turn[S][S] = {{0.0}}, state[S], half[S][S];
    int j, a, b, k;
    for (a = 0; a < 2; a++)
        for (b = 0; b < 2; b++) turn[a][b] = turn[2 + a][2 + b] = vectors[2 * a + b];
    for (j = 0; j < M; j++) {
        memset(state, 0, sizeof(state)), memset(half, 0, sizeof(half));
        for (a = 0; a < S; a++) {
            for (k = 0; k < S; k++) state[a] += turn[a][k] * now->state[j][k];
            for (b = 0; b < S; b++)
                for (k = 0; k < S; k++) half[a][b] += turn[a][k] * now->covariance[j][k][b];
        }
        memcpy(now->state[j], state, sizeof(state));
        for (a = 0; a < S; a++) {
            for (b = 0; b < S; b++) {
                double sum = 0.0;
                for (k = 0; k < S; k++) sum += half[a][k] * turn[b][k];
                now->covariance[j][a][b] = sum;
            }
        }
    }
}

static void filtered(const struct past *past, const double *values, const double *vectors,
    struct beliefs *now)
{
    struct beliefs ahead;
    double place[2];
    int k, r;
    for (k = past->began; k < past->length; k++) {
        for (r = 0; r < 2; r++)
            place[r] = past->places[k][0] * vectors[r] + past->places[k][1] * vectors[2 + r];
        if (k == past->began) {
            begun(place, values, now);
            continue;
        }
        stepped(now, &ahead);
        *now = ahead;
        if (past->observed[k]) updated(now, place, values);
    }
}

/* Mean and covariance of the position in the mixture of all models. */
static void merged(const struct beliefs *now, const double *origin, double *mean,
    double *covariance)
{
    double middle[2] = {0.0, 0.0};
    int j, a, b;
    for (a = 0; a < 2; a++)
        for (j = 0; j < M; j++) middle[a] += now->weight[j] * now->state[j][a];
    for (a = 0; a < 2; a++) {
        mean[a] = origin[a] + middle[a];
        for (b = 0; b < 2; b++) {
            double sum = 0.0;
            for (j = 0; j < M; j++)
                sum += now->weight[j]
                    * (now->covariance[j][a][b]
                        + (now->state[j][a] - middle[a]) * (now->state[j][b] - middle[b]));
            covariance[2 * a + b] = sum;
        }
    }
}

static void predict_one(const struct track *track, int steps, struct past *past,
    double (*mean)[2], double (*covariance)[4])
{
    struct beliefs now, ahead;
    double noise[4], values[2], vectors[4];
    int h;
    gather(track, PLAN_FILTERED, past);
    if (!past->samples) {
        never_seen(steps, mean, covariance);
        return;
    }
    measurement_noise(track, noise);
    wb_axes(noise, values, vectors);
    filtered(past, values, vectors, &now);
    turned(&now, vectors);
    for (h = 0; h < steps + past->late; h++) {
        stepped(&now, &ahead);
        now = ahead;
        if (h >= past->late)
            merged(&now, past->origin, mean[h - past->late], covariance[h - past->late]);
    }
}

#endif

/* ---- Online calibration: scales of the covariances that follow how often the truth was missed */

#if PLAN_CONFORMAL

enum { CLASSES = PLAN_CONFORMAL_CLASSES, STEPS = PLAN_CONFORMAL_STEPS };

#define LIMIT 12.0  /* largest |log scale| */
#define EARLY 0.9   /* steps after which the next forecast is stated */

static double spacing(double value)
{
    return nextafter(fabs(value), INFINITY) - fabs(value);
}

static double slack_of(const struct tracks *tracks)
{
    return fmax(1e-6 * PLAN_TRACK_DT, 4.0 * spacing(tracks->stamp));
}

/* Class of an obstacle: that of its speed, from its forecast; the last if it has just appeared. */
static int kind_of(const double (*mean)[2], int steps, const struct past *past)
{
    const double *first = steps > 1 ? mean[0] : past->origin;
    const double *second = steps > 1 ? mean[1] : mean[0];
    const double x = second[0] - first[0], y = second[1] - first[1];
    const double speed = sqrt(x * x + y * y) / PLAN_TRACK_DT;
    int kind = 0;
    if (past->samples == 1) return CLASSES - 1;
    while (kind < CLASSES - 2 && PLAN_CONFORMAL_SPEEDS[kind] <= speed) kind++;
    return kind;
}

/* Scale at a time ahead: linear between the steps, as at the first before, at the last after. */
static double scale_at(const double *logarithm, double time)
{
    const double dt = PLAN_TRACK_DT;
    int k;
    if (time <= dt) return exp(logarithm[0]);
    for (k = 1; k < STEPS; k++) {
        const double begin = dt * k, end = dt * (k + 1);
        if (time <= end) {
            const double low = exp(logarithm[k - 1]), high = exp(logarithm[k]);
            return time == end ? high : (high - low) / (end - begin) * (time - begin) + low;
        }
    }
    return exp(logarithm[STEPS - 1]);
}

/* The scaled forecast of one obstacle, and its class. */
static int stated_one(const struct learnt *learnt, const struct track *track, int steps,
    struct past *past, double (*mean)[2], double (*covariance)[4])
{
    int h, k, kind;
    predict_one(track, steps, past, mean, covariance);
    kind = kind_of((const double (*)[2])mean, steps, past);
    for (h = 0; h < steps; h++) {
        const double time = PLAN_TRACK_DT * (past->late + h + 1);
        const double scale = scale_at(learnt->logarithm[kind], time);
        for (k = 0; k < 4; k++) covariance[h][k] *= scale;
    }
    return kind;
}

static int due(double elapsed)
{
    return (int)fmin(fmax(elapsed / PLAN_TRACK_DT, 0.0), STEPS);
}

/* Where an obstacle was at a time; whether that is known. */
static int placed(const struct tracks *tracks, const struct track *track, double time,
    double *place)
{
    const int rows = PLAN_SAMPLES;
    double at = fmin(rows - 1 - (tracks->stamp - time) / PLAN_TRACK_DT, rows - 1.0), nearest;
    double share;
    int below, r;
    if (!(at > -1.0)) return 0;
    nearest = rint(at);
    if (fabs(at - nearest) * PLAN_TRACK_DT <= slack_of(tracks)) at = nearest;
    below = (int)floor(at);
    if (below < 0) return 0;
    share = at - below;
    for (r = 0; r < 2; r++)
        place[r] = share == 0.0
            ? track->places[below][r]
            : (1.0 - share) * track->places[below][r] + share * track->places[below + 1][r];
    return seen_at(place);
}

static int outside(const double *mean, const double *covariance, const double *place)
{
    double values[2], vectors[4], square = 0.0;
    int axis;
    wb_axes(covariance, values, vectors);
    for (axis = 0; axis < 2; axis++) {
        const double off = vectors[axis] * (place[0] - mean[0])
            + vectors[2 + axis] * (place[1] - mean[1]);
        square += off * off / fmax(values[axis], SMALLEST);
    }
    return exp(-0.5 * square) < PLAN_CONFORMAL_TAIL;
}

static const struct track *called(const struct tracks *tracks, const char *name)
{
    int low = 0, high = tracks->count - 1;
    while (low <= high) {
        const int middle = (low + high) / 2, way = strcmp(tracks->of[middle].name, name);
        if (way == 0) return &tracks->of[middle];
        if (way < 0)
            low = middle + 1;
        else
            high = middle - 1;
    }
    return NULL;
}

static void judge(const struct tracks *tracks, const struct pending *one, int step,
    double (*balance)[STEPS], double (*count)[STEPS])
{
    int k;
    for (k = 0; k < one->count; k++) {
        const struct track *track = called(tracks, one->names[k]);
        double place[2];
        if (!track || !placed(tracks, track, one->stamp + (step + 1) * PLAN_TRACK_DT, place))
            continue;
        balance[one->kind[k]][step] += outside(one->mean[k][step], one->covariance[k][step], place)
            - PLAN_CONFORMAL_TAIL;
        count[one->kind[k]][step] += 1.0;
    }
}

static void begin_anew(struct learnt *learnt, double stamp)
{
    int c;
    learnt->begun = 1, learnt->waiting = 0, learnt->stamp = stamp;
    for (c = 0; c < CLASSES; c++)
        memcpy(learnt->logarithm[c], PLAN_CONFORMAL_START[c], sizeof(learnt->logarithm[c]));
}

/* Learn from forecasts that have fallen due. */
static void adapt(struct learnt *learnt, const struct tracks *tracks)
{
    double balance[CLASSES][STEPS] = {{0.0}}, count[CLASSES][STEPS] = {{0.0}};
    const double slack = slack_of(tracks), horizon = tracks->stamp - STEPS * PLAN_TRACK_DT + slack;
    int k, step, c, kept = 0;
    if (!learnt->begun || tracks->stamp < learnt->stamp - slack) {
        begin_anew(learnt, tracks->stamp);
        return;
    }
    for (k = 0; k < learnt->waiting; k++) {
        const struct pending *one = &learnt->pending[k];
        const int last = due(tracks->stamp - one->stamp + slack);
        for (step = due(learnt->stamp - one->stamp + slack); step < last; step++)
            judge(tracks, one, step, balance, count);
    }
    for (c = 0; c < CLASSES; c++) {
        for (step = 0; step < STEPS; step++) {
            const double change
                = PLAN_CONFORMAL_RATE * balance[c][step] / sqrt(fmax(count[c][step], 1.0));
            learnt->logarithm[c][step]
                = fmin(fmax(learnt->logarithm[c][step] + change, -LIMIT), LIMIT);
        }
    }
    for (k = 0; k < learnt->waiting; k++) {
        if (!(learnt->pending[k].stamp > horizon)) continue;
        if (kept != k) learnt->pending[kept] = learnt->pending[k];
        kept++;
    }
    learnt->waiting = kept, learnt->stamp = tracks->stamp;
}

static int counts(const struct track *track)
{
    int k;
    if (PLAN_SAMPLES < PLAN_CONFORMAL_OBSERVED) return 0;
    for (k = PLAN_SAMPLES - PLAN_CONFORMAL_OBSERVED; k < PLAN_SAMPLES; k++)
        if (!seen_at(track->places[k])) return 0;
    return 1;
}

void wb_learn(struct learnt *learnt, const struct tracks *tracks, struct scratch *scratch)
{
    struct pending *one;
    int k;
    if (!tracks->count) return;
    adapt(learnt, tracks);
    if (learnt->waiting
        && tracks->stamp - learnt->pending[learnt->waiting - 1].stamp
            < EARLY * PLAN_TRACK_DT - slack_of(tracks))
        return;
    if (learnt->waiting == PLAN_CONFORMAL_PENDING) {
        memmove(&learnt->pending[0], &learnt->pending[1],
            (PLAN_CONFORMAL_PENDING - 1) * sizeof(learnt->pending[0]));
        learnt->waiting--;
    }
    one = &learnt->pending[learnt->waiting++];
    one->stamp = tracks->stamp, one->count = 0;
    for (k = 0; k < tracks->count; k++) {
        const int place = one->count;
        if (!counts(&tracks->of[k])) continue;
        one->kind[place] = stated_one(learnt, &tracks->of[k], STEPS, &scratch->past,
            one->mean[place], one->covariance[place]);
        memcpy(one->names[place], tracks->of[k].name, WIDEBERTH_NAME);
        one->count++;
    }
}

#else

void wb_learn(struct learnt *learnt, const struct tracks *tracks, struct scratch *scratch)
{
    (void)learnt, (void)tracks, (void)scratch;
}

static int stated_one(const struct learnt *learnt, const struct track *track, int steps,
    struct past *past, double (*mean)[2], double (*covariance)[4])
{
    (void)learnt;
    predict_one(track, steps, past, mean, covariance);
    return 0;
}

#endif

/* ---- On the plan's grid */

/* Between two steps mean and covariance are interpolated; before the first one they start at the
 * newest position and its measurement's covariance. */
static void resampled(const struct track *track, const double *times, int steps,
    const double (*mean)[2], const double (*covariance)[4], struct forecast *found, int k)
{
    const double *newest = seen_at(track->places[PLAN_SAMPLES - 1])
        ? track->places[PLAN_SAMPLES - 1]
        : mean[0];
    int i, r;
    for (i = 0; i < N; i++) {
        const double at = times[i] / PLAN_TRACK_DT;
        const int below = (int)fmin(fmax(floor(at), 0.0), steps - 1);
        const double share = fmin(fmax(at - below, 0.0), 1.0);
        const double *first = below ? mean[below - 1] : newest;
        const double *wide = below ? covariance[below - 1] : track->noise;
        for (r = 0; r < 2; r++)
            found->mean[k][i][r] = (1.0 - share) * first[r] + share * mean[below][r];
        for (r = 0; r < 4; r++)
            found->covariance[k][i][r] = (1.0 - share) * wide[r] + share * covariance[below][r];
    }
}

void wb_forecast(const struct learnt *learnt, const struct tracks *tracks, double first,
    struct forecast *forecast, struct scratch *scratch)
{
    double times[N];
    int steps, on_grid, k, i;
    if (!tracks->count) return;
    for (i = 0; i < N; i++) times[i] = first - tracks->stamp + WIDEBERTH_DT * (i + 1);
    steps = (int)fmax(ceil(times[N - 1] / PLAN_TRACK_DT - 1e-9), 1.0);
    if (steps > PLAN_AHEAD) steps = PLAN_AHEAD;
    on_grid = steps == N;
    for (i = 0; i < N; i++)
        on_grid = on_grid && fabs(times[i] / PLAN_TRACK_DT - (i + 1)) <= 1e-9;
    for (k = 0; k < tracks->count; k++) {
        double (*mean)[2] = scratch->forecast.mean[k];
        double (*covariance)[4] = scratch->forecast.covariance[k];
        stated_one(learnt, &tracks->of[k], steps, &scratch->past, mean, covariance);
        if (on_grid) {
            memcpy(forecast->mean[k], mean, sizeof(mean[0]) * N);
            memcpy(forecast->covariance[k], covariance, sizeof(covariance[0]) * N);
        } else {
            resampled(&tracks->of[k], times, steps, (const double (*)[2])mean,
                (const double (*)[4])covariance, forecast, k);
        }
    }
}
