/* Forecasts of obstacles: a Kalman filter on position and velocity, whose acceleration is white
 * noise. What the predictor `kalman` of wideberth does in Python.
 *
 *   x = (p, v),   F = [[I, t I], [0, I]],   Q = q [[t^3/3 I, t^2/2 I], [t^2/2 I, t I]]
 */
#include "planner_parts.h"

#include <math.h>
#include <string.h>

#define LONGEST_LAG 6.0 /* steps of a track between two measurements that are bridged */
#define ROUNDING 1e-12  /* share of its trace below which an eigenvalue is rounding */
#define LEAST (PLAN_NOISE_FLOOR * PLAN_NOISE_FLOOR)

/* F x, F P F' + Q over `lag` s. */
static void carry(struct belief *belief, double lag)
{
    const double growth = PLAN_ACCELERATION_DENSITY * lag;
    double (*p)[4] = belief->covariance;
    int r, c;
    for (r = 0; r < 2; r++) {
        belief->state[r] += lag * belief->state[2 + r];
        for (c = 0; c < 4; c++) p[r][c] += lag * p[2 + r][c];
    }
    for (r = 0; r < 4; r++)
        for (c = 0; c < 2; c++) p[r][c] += lag * p[r][2 + c];
    for (r = 0; r < 2; r++) {
        p[r][r] += growth * lag * lag / 3.0;
        p[r][2 + r] += growth * lag / 2.0, p[2 + r][r] += growth * lag / 2.0;
        p[2 + r][2 + r] += growth;
    }
}

/* K = P H' S^-1,  S = H P H' + R,  x + K (z - H x),  (I - K H) P (I - K H)' + K R K' */
static void update(struct belief *belief, const double *place, const double *noise)
{
    double (*p)[4] = belief->covariance, gain[4][2], rest[4][4];
    const double gap[2] = {place[0] - belief->state[0], place[1] - belief->state[1]};
    const double total = fmax(p[0][0], 0.0) + noise[0], slope = (p[0][1] + noise[1]) / total;
    const double other = fmax(p[1][1] + noise[3] - slope * (p[0][1] + noise[1]), LEAST);
    int a, b, r;
    for (a = 0; a < 4; a++) {
        gain[a][1] = (p[a][1] - slope * p[a][0]) / other;
        gain[a][0] = p[a][0] / total - slope * gain[a][1];
        belief->state[a] += gain[a][0] * gap[0] + gain[a][1] * gap[1];
        for (b = 0; b < 4; b++) rest[a][b] = p[a][b] - gain[a][0] * p[0][b] - gain[a][1] * p[1][b];
    }
    for (a = 0; a < 4; a++) {
        for (b = 0; b <= a; b++) {
            double sum = rest[a][b];
            for (r = 0; r < 2; r++)
                sum -= gain[b][r]
                    * (rest[a][r] - gain[a][0] * noise[r] - gain[a][1] * noise[2 + r]);
            p[a][b] = p[b][a] = sum;
        }
    }
}

void wb_filter(struct belief *belief, double time, const double *place, const double *covariance)
{
    const double lag = time - belief->time;
    const double least = fmax(LEAST, ROUNDING * (covariance[0] + covariance[3]));
    const double noise[4]
        = {covariance[0] + least, covariance[1], covariance[2], covariance[3] + least};
    int r, c;
    if (lag <= LONGEST_LAG * PLAN_TRACK_DT * (1.0 + PLAN_SAME_TIME)) {
        carry(belief, lag);
        update(belief, place, noise);
    } else {
        memset(belief, 0, sizeof(*belief));
        memcpy(belief->state, place, 2 * sizeof(double));
        for (r = 0; r < 2; r++) {
            for (c = 0; c < 2; c++) belief->covariance[r][c] = noise[2 * r + c];
            belief->covariance[2 + r][2 + r] = PLAN_SPEED_VARIANCE;
        }
    }
    belief->time = time;
}

/* ---- On the plan's grid */

/* Time from an obstacle's newest measurement to the newest one of all, s. */
static double lag_of(const struct tracks *tracks, const struct log *log)
{
    const double size = fabs(tracks->stamp), lag = tracks->stamp - log->now.time;
    const double slack
        = fmax(PLAN_SAME_TIME * PLAN_TRACK_DT, 4.0 * (nextafter(size, INFINITY) - size));
    return lag > slack ? lag : 0.0;
}

const double *wb_newest(const struct tracks *tracks, const struct log *log)
{
    return lag_of(tracks, log) > 0.0 ? NULL : log->place;
}

static void position_after(const struct belief *belief, double lag, double *mean,
    double *covariance)
{
    struct belief ahead = *belief;
    int r;
    carry(&ahead, lag);
    for (r = 0; r < 2; r++) {
        mean[r] = ahead.state[r];
        memcpy(covariance + 2 * r, ahead.covariance[r], 2 * sizeof(double));
    }
}

/* Position at a time in steps after the newest measurement of all. Between two steps mean and
 * covariance are interpolated; before the first one they start at the newest position and its
 * measurement's covariance. */
static void forecast_at(const struct tracks *tracks, const struct log *log, double steps,
    double *mean, double *covariance)
{
    const double below = fmax(floor(steps), 0.0), share = fmax(steps - below, 0.0);
    const double lag = lag_of(tracks, log) + PLAN_TRACK_DT * below;
    const double *newest = wb_newest(tracks, log);
    double first[2], wide[4];
    int r;
    position_after(&log->now, lag + PLAN_TRACK_DT, mean, covariance);
    position_after(&log->now, lag, first, wide);
    if (below == 0.0) {
        memcpy(first, newest ? newest : mean, sizeof(first));
        memcpy(wide, log->covariance, sizeof(wide));
    }
    for (r = 0; r < 2; r++) mean[r] = (1.0 - share) * first[r] + share * mean[r];
    for (r = 0; r < 4; r++) covariance[r] = (1.0 - share) * wide[r] + share * covariance[r];
}

void wb_forecast(const struct tracks *tracks, double first, struct forecast *forecast)
{
    int k, i;
    for (k = 0; k < tracks->count; k++)
        for (i = 0; i < N; i++)
            forecast_at(tracks, tracks->of[k],
                (first - tracks->stamp + WIDEBERTH_DT * (i + 1)) / PLAN_TRACK_DT,
                forecast->mean[k][i], forecast->covariance[k][i]);
}
