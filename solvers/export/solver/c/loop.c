/* A robot drives along a path among three obstacles that move at constant velocity and are the
 * less certain the farther ahead one looks. The plant is the planner's own model.
 *
 *   loop [RECORD]    RECORD: a file for all problems and results, as they stand in memory */
#include "wideberth_solver.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { N = WIDEBERTH_HORIZON, MOST = 3, CYCLES = 60 };
#define OBSTACLES (WIDEBERTH_OBSTACLES < MOST ? WIDEBERTH_OBSTACLES : MOST)

static const double PATH[][2] = {{0.0, 0.0}, {12.0, 0.0}};
static const double PLACE[MOST][2] = {{4.0, 2.5}, {8.0, -3.5}, {11.0, 0.4}};
static const double VELOCITY[MOST][2] = {{0.0, -0.3}, {0.0, 0.25}, {-0.25, 0.0}};
static const double RADIUS = 0.3;

/* Where an obstacle is after some seconds. */
static void place(int k, double time, double *found)
{
    found[0] = PLACE[k][0] + VELOCITY[k][0] * time;
    found[1] = PLACE[k][1] + VELOCITY[k][1] * time;
}

/* Forecast: straight on; the variance grows with the time ahead. */
static int forecast(wideberth_problem *problem, int k, double now)
{
    double mean[N][2], covariance[N][4];
    int i;
    for (i = 0; i < N; i++) {
        const double ahead = (i + 1) * WIDEBERTH_DT;
        const double along = 0.01 + 0.02 * ahead, across = 0.01 + 0.005 * ahead;
        const int upright = VELOCITY[k][0] == 0.0;
        place(k, now + ahead, mean[i]);
        covariance[i][0] = upright ? across : along;
        covariance[i][1] = covariance[i][2] = 0.002 * ahead;
        covariance[i][3] = upright ? along : across;
    }
    return wideberth_set(problem, WIDEBERTH_KIND_OBSTACLE, k, (const double(*)[2])mean,
        (const double(*)[4])covariance, RADIUS);
}

int main(int count, char **words)
{
    static unsigned char memory[WIDEBERTH_MEMORY];
    static wideberth_problem problem;
    static wideberth_result result;
    double state[WIDEBERTH_STATES] = {0.0}, arc = -1.0, closest = INFINITY;
    FILE *record = count > 1 ? fopen(words[1], "wb") : NULL;
    int cycle, k, error = WIDEBERTH_NO_ERROR, unsolved = 0;

    for (cycle = 0; cycle < CYCLES && !error; cycle++) {
        const double now = cycle * WIDEBERTH_DT;
        error = wideberth_begin(&problem);
        memcpy(problem.initial, state, sizeof(state));
        if (!error) error = wideberth_follow(&problem, PATH, 2, WIDEBERTH_SPEED, &arc);
        for (k = 0; k < OBSTACLES && !error; k++) error = forecast(&problem, k, now);
        if (!error) error = wideberth_start(&problem, cycle ? &result : NULL, 1.0);
        if (!error) error = wideberth_solve(&problem, memory, sizeof(memory), &result);
        if (error) break;
        if (record) {
            fwrite(&problem, sizeof(problem), 1, record);
            fwrite(&result, sizeof(result), 1, record);
        }
        unsolved += result.status != WIDEBERTH_SOLVED;
        wideberth_step(state, result.inputs[0], state);
        for (k = 0; k < OBSTACLES; k++) {
            double at[2];
            place(k, now + WIDEBERTH_DT, at);
            closest = fmin(closest, hypot(at[0] - state[0], at[1] - state[1]));
        }
        if (cycle % 10 == 0)
            printf("%5.1f s  (%6.3f, %6.3f) m  %s, %d iterations, broken by %.1e\n", now, state[0],
                state[1], wideberth_status_text(result.status), result.iterations,
                wideberth_violation(&problem, &result));
    }
    if (record) fclose(record);
    if (error) {
        fprintf(stderr, "%s\n", wideberth_error_text(error));
        return 1;
    }
    printf("at (%.6f, %.6f) m; an obstacle came within %.6f m; %d of %d without a plan\n", state[0],
        state[1], closest, unsolved, CYCLES);
    return 0;
}
