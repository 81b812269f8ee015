/* A robot drives along a path past three people who walk. The plant is the planner's own model: a
 * first state that is reached, not a real robot. */
#include "wideberth_planner.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CYCLES = 60, PEOPLE = 3 };

static const double PATH[][2] = {{0.0, 0.0}, {12.0, 0.0}};
static const double PLACE[PEOPLE][2] = {{4.0, 2.5}, {8.0, -3.5}, {11.0, 0.4}};
static const double VELOCITY[PEOPLE][2] = {{0.0, -0.3}, {0.0, 0.25}, {-0.25, 0.0}};

int main(void)
{
    wideberth_planner *planner;
    wideberth_detection seen[PEOPLE];
    static wideberth_decision decision;
    double state[WIDEBERTH_PLAN_STATES] = {0.0}, closest = INFINITY;
    void *memory = malloc(wideberth_planner_size());
    int cycle, k, status = wideberth_planner_begin(memory, wideberth_planner_size(), &planner);

    if (!status) status = wideberth_planner_set_path(planner, PATH, 2);
    for (cycle = 0; cycle < CYCLES && !status; cycle++) {
        wideberth_observation now = {cycle * WIDEBERTH_PLAN_DT, state, PEOPLE, seen, 0, NULL};
        memset(seen, 0, sizeof(seen));
        for (k = 0; k < PEOPLE; k++) {
            snprintf(seen[k].name, WIDEBERTH_NAME, "person %d", k);
            seen[k].position[0] = PLACE[k][0] + VELOCITY[k][0] * now.stamp;
            seen[k].position[1] = PLACE[k][1] + VELOCITY[k][1] * now.stamp;
            seen[k].covariance[0] = seen[k].covariance[3] = 1e-4;
            seen[k].radius = 0.3;
            closest = fmin(closest,
                hypot(seen[k].position[0] - state[0], seen[k].position[1] - state[1]));
        }
        status = wideberth_planner_decide(planner, &now, &decision);
        memcpy(state, decision.states[1], sizeof(state));
        if (cycle % 10 == 0)
            printf("%5.1f s  (%6.3f, %6.3f) m  %s, %d iterations\n", now.stamp, state[0], state[1],
                decision.reason, decision.iterations);
    }
    free(memory);
    if (status) {
        fprintf(stderr, "%s\n", wideberth_planner_status_text(status));
        return 1;
    }
    printf("at (%.6f, %.6f) m; a person came within %.6f m\n", state[0], state[1], closest);
    return 0;
}
