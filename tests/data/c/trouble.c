/* Everything a caller can do wrong gets its code; `trouble` prints what is not as it should be. */
#include "wideberth_solver.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { N = WIDEBERTH_HORIZON };
static const double PATH[][2] = {{0.0, 0.0}, {9.0, 0.0}};
static int wrong;

#define EXPECT(what, code) \
    do { \
        const int found = (what); \
        if (found != (code)) printf("%s is %d, not %s\n", #what, found, #code), wrong = 1; \
    } while (0)
#define HOLDS(what) \
    do { \
        if (!(what)) printf("%s does not hold\n", #what), wrong = 1; \
    } while (0)

static double means[N][2], covariances[N][4];

static void fill(wideberth_problem *problem, int slots)
{
    double arc = -1.0;
    int i, k;
    EXPECT(wideberth_begin(problem), WIDEBERTH_NO_ERROR);
    for (i = 0; i < N; i++) {
        means[i][0] = 3.0, means[i][1] = 0.3;
        covariances[i][0] = covariances[i][3] = 0.02, covariances[i][1] = covariances[i][2] = 0.0;
    }
    EXPECT(wideberth_follow(problem, PATH, 2, WIDEBERTH_SPEED, &arc), WIDEBERTH_NO_ERROR);
    for (k = 0; k < slots; k++) {
        means[0][0] = 3.0 + 0.1 * k;
        EXPECT(wideberth_set(problem, WIDEBERTH_KIND_OBSTACLE, k, (const double(*)[2])means,
                   (const double(*)[4])covariances, 0.3),
            WIDEBERTH_NO_ERROR);
    }
    EXPECT(wideberth_start(problem, NULL, 0.0), WIDEBERTH_NO_ERROR);
}

/* Any size is refused or enough, and nothing outside of it is written. */
static void sizes(const wideberth_problem *problem, wideberth_result *result)
{
    const size_t room = WIDEBERTH_MEMORY + 64;
    unsigned char *memory = malloc(room);
    size_t size, skip, k;
    for (size = 0; size + 32 <= WIDEBERTH_MEMORY; size += size < 4096 ? 7 : 1009) {
        memset(memory, 77, room);
        EXPECT(wideberth_solve(problem, memory + 16, size, result), WIDEBERTH_LITTLE_MEMORY);
        for (k = size + 16; k < room; k++)
            if (memory[k] != 77) break;
        HOLDS(k == room);
        for (k = 0; k < 16; k++) HOLDS(memory[k] == 77);
    }
    EXPECT(wideberth_solve(problem, memory, WIDEBERTH_MEMORY - 32, result),
        WIDEBERTH_LITTLE_MEMORY); /* the header asks for no more than is needed */
    for (skip = 0; skip < 17; skip++) {
        memset(memory, 77, room);
        EXPECT(wideberth_solve(problem, memory + skip, WIDEBERTH_MEMORY, result),
            WIDEBERTH_NO_ERROR);
        EXPECT(result->status, WIDEBERTH_SOLVED);
        for (k = WIDEBERTH_MEMORY + skip; k < room; k++) HOLDS(memory[k] == 77);
    }
    free(memory);
}

static void arguments(wideberth_problem *problem, wideberth_result *result, void *memory)
{
    const size_t size = WIDEBERTH_MEMORY;
    const double (*mean)[2] = (const double(*)[2])means;
    const double (*covariance)[4] = (const double(*)[4])covariances;
    const double still[][2] = {{1.0, 1.0}, {1.0, 1.0}}, bad[][2] = {{0.0, NAN}, {1.0, 1.0}};
    double arc = -1.0;
    EXPECT(wideberth_begin(NULL), WIDEBERTH_NULL);
    EXPECT(wideberth_solve(NULL, memory, size, result), WIDEBERTH_NULL);
    EXPECT(wideberth_solve(problem, NULL, size, result), WIDEBERTH_NULL);
    EXPECT(wideberth_solve(problem, memory, size, NULL), WIDEBERTH_NULL);
    EXPECT(wideberth_start(NULL, NULL, 0.0), WIDEBERTH_NULL);
    EXPECT(wideberth_follow(problem, PATH, 2, 0.5, NULL), WIDEBERTH_NULL);
    EXPECT(wideberth_follow(problem, still, 2, 0.5, &arc), WIDEBERTH_BAD_PATH);
    EXPECT(wideberth_follow(problem, PATH, 1, 0.5, &arc), WIDEBERTH_BAD_PATH);
    EXPECT(wideberth_follow(problem, bad, 2, 0.5, &arc), WIDEBERTH_NOT_FINITE);
    EXPECT(wideberth_follow(problem, PATH, 2, NAN, &arc), WIDEBERTH_NOT_FINITE);
    EXPECT(wideberth_set(problem, WIDEBERTH_KINDS, 0, mean, covariance, 0.3), WIDEBERTH_NO_SLOT);
    EXPECT(wideberth_set(problem, -1, 0, mean, covariance, 0.3), WIDEBERTH_NO_SLOT);
    EXPECT(wideberth_set(problem, 0, WIDEBERTH_OBSTACLES, mean, covariance, 0.3),
        WIDEBERTH_NO_SLOT);
    EXPECT(wideberth_clear(problem, 0, -1), WIDEBERTH_NO_SLOT);
    EXPECT(wideberth_clear(problem, 0, 0), WIDEBERTH_NO_ERROR);
    EXPECT(wideberth_set(problem, 0, 0, mean, covariance, -1.0), WIDEBERTH_NOT_FINITE);
    covariances[2][0] = -1.0;
    EXPECT(wideberth_set(problem, 0, 0, mean, covariance, 0.3), WIDEBERTH_NOT_A_COVARIANCE);
    covariances[2][0] = 0.02, covariances[2][1] = 0.01;
    EXPECT(wideberth_set(problem, 0, 0, mean, covariance, 0.3), WIDEBERTH_NOT_A_COVARIANCE);
    covariances[2][1] = covariances[2][2] = 0.03;
    EXPECT(wideberth_set(problem, 0, 0, mean, covariance, 0.3), WIDEBERTH_NOT_A_COVARIANCE);
    covariances[2][1] = covariances[2][2] = NAN;
    EXPECT(wideberth_set(problem, 0, 0, mean, covariance, 0.3), WIDEBERTH_NOT_FINITE);
    covariances[2][1] = covariances[2][2] = 0.0, means[1][1] = INFINITY;
    EXPECT(wideberth_set(problem, 0, 0, mean, covariance, 0.3), WIDEBERTH_NOT_FINITE);
    means[1][1] = 0.3;
    EXPECT(problem->obstacles.active[0] == 0.0, 1);
    EXPECT(wideberth_set(problem, 0, 0, mean, covariance, 0.3), WIDEBERTH_NO_ERROR);
    problem->build++;
    EXPECT(wideberth_solve(problem, memory, size, result), WIDEBERTH_OTHER_BUILD);
    EXPECT(wideberth_set(problem, 0, 0, mean, covariance, 0.3), WIDEBERTH_OTHER_BUILD);
    problem->build--;
    EXPECT(wideberth_begin_as(problem, sizeof(*problem), 1), WIDEBERTH_OTHER_BUILD);
    EXPECT(wideberth_begin_as(problem, sizeof(*problem) - 8, WIDEBERTH_BUILD),
        WIDEBERTH_OTHER_BUILD);
}

static void numbers(wideberth_problem *problem, wideberth_result *result, void *memory)
{
    static const volatile int64_t stop = 1;
    const size_t size = WIDEBERTH_MEMORY;
    fill(problem, 1);
    problem->stop = &stop;
    EXPECT(wideberth_solve(problem, memory, size, result), WIDEBERTH_NO_ERROR);
    EXPECT(result->status, WIDEBERTH_STOPPED);
    problem->stop = NULL;
    HOLDS(wideberth_violation(problem, NULL) == INFINITY);
    problem->initial[0] = NAN;
    EXPECT(wideberth_solve(problem, memory, size, result), WIDEBERTH_NO_ERROR);
    EXPECT(result->status, WIDEBERTH_FAILED);
    HOLDS(!(wideberth_violation(problem, result) < 1.0));
    EXPECT(wideberth_start(problem, NULL, 0.0), WIDEBERTH_NOT_FINITE);
    fill(problem, 1);
    problem->obstacles.parameters[3][0][1] = INFINITY;
    EXPECT(wideberth_solve(problem, memory, size, result), WIDEBERTH_NO_ERROR);
    HOLDS(result->status != WIDEBERTH_SOLVED);
    memset(result, 0, sizeof(*result));
    result->inputs[2][0] = NAN;
    EXPECT(wideberth_start(problem, result, 1.0), WIDEBERTH_NOT_FINITE);
    result->inputs[2][0] = 1e9; /* is brought within the robot's limits */
    EXPECT(wideberth_start(problem, result, 0.5), WIDEBERTH_NO_ERROR);
    HOLDS(problem->start_inputs[1][0] < 10.0 && problem->start_inputs[1][0] > 0.0);
    EXPECT(wideberth_start(problem, result, 1e5), WIDEBERTH_NO_ERROR);
    HOLDS(problem->start_inputs[1][0] == 0.0);
}

static void texts(void)
{
    int a, b;
    for (a = -1; a <= WIDEBERTH_ERRORS; a++)
        for (b = -1; b < a; b++)
            if (b >= 0 && a < WIDEBERTH_ERRORS)
                HOLDS(strcmp(wideberth_error_text(a), wideberth_error_text(b)) != 0);
    HOLDS(!strcmp(wideberth_error_text(-1), wideberth_error_text(WIDEBERTH_ERRORS)));
    for (a = 0; a < WIDEBERTH_STATUSES; a++) HOLDS(strlen(wideberth_status_text(a)) > 5);
}

int main(void)
{
    static wideberth_problem problem;
    static wideberth_result result;
    static unsigned char memory[WIDEBERTH_MEMORY];
    const int first = wideberth_begin(&problem);
    if (!first) {
        fill(&problem, WIDEBERTH_OBSTACLES);
        if (wideberth_solve(&problem, memory, sizeof(memory), &result)) {
            printf("%s\n", wideberth_error_text(
                wideberth_solve(&problem, memory, sizeof(memory), &result)));
            return 3;
        }
        sizes(&problem, &result);
        arguments(&problem, &result, memory);
        numbers(&problem, &result, memory);
        texts();
    } else {
        printf("%s\n", wideberth_error_text(first));
        return 2;
    }
    return wrong;
}
