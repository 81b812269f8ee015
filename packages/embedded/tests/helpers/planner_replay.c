/* Replays drives in two threads, each with a planner of its own, and writes the commands of both.
 *
 *   planner_replay DRIVES COMMANDS     see tests/helpers/planner_library.py */
#include "wideberth_planner.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

struct job {
    const char *from;
    FILE *to;
    int failed;
};

static int seen_in(FILE *file, wideberth_observation *seen, double *state,
    wideberth_detection *people, wideberth_polygon *walls)
{
    int counts[2];
    if (fread(&seen->stamp, sizeof(double), 1, file) != 1) return 0;
    if (fread(state, sizeof(double), WIDEBERTH_PLAN_STATES, file) != WIDEBERTH_PLAN_STATES) return 0;
    if (fread(counts, sizeof(int), 2, file) != 2) return 0;
    seen->state = state, seen->detections = people, seen->walls = walls;
    seen->obstacles = counts[0], seen->polygons = counts[1];
    return fread(people, sizeof(*people), (size_t)counts[0], file) == (size_t)counts[0]
        && fread(walls, sizeof(*walls), (size_t)counts[1], file) == (size_t)counts[1];
}

static void *replay(void *given)
{
    struct job *job = (struct job *)given;
    FILE *file = fopen(job->from, "rb");
    const size_t size = wideberth_planner_size();
    void *memory = malloc(size);
    wideberth_detection *people = malloc(WIDEBERTH_DETECTIONS * sizeof(*people));
    wideberth_polygon *walls = malloc((WIDEBERTH_WALLS + 1) * sizeof(*walls));
    wideberth_planner *planner;
    wideberth_observation seen;
    wideberth_decision decision;
    double points[8][2], state[WIDEBERTH_PLAN_STATES];
    int counts[3], k;
    job->failed = !file || wideberth_planner_begin(memory, size, &planner);
    while (!job->failed && fread(counts, sizeof(int), 3, file) == 3) {
        wideberth_planner_reset(planner);
        job->failed |= fread(points, 2 * sizeof(double), (size_t)counts[0], file) != (size_t)counts[0];
        job->failed |= wideberth_planner_set_path(planner, (const double(*)[2])points, counts[0]);
        for (k = 0; k < counts[1] + counts[2]; k++) {
            job->failed |= !seen_in(file, &seen, state, people, walls);
            if (k < counts[1]) {
                wideberth_planner_remember(planner, &seen);
                continue;
            }
            wideberth_planner_decide(planner, &seen, &decision);
            fwrite(&decision.command, sizeof(decision.command), 1, job->to);
        }
    }
    fclose(file);
    free(memory), free(people), free(walls);
    return NULL;
}

int main(int count, char **words)
{
    struct job jobs[2];
    pthread_t threads[2];
    FILE *file = count == 3 ? fopen(words[2], "wb") : NULL;
    char bytes[4096];
    size_t some;
    int k;
    if (!file) return 2;
    for (k = 0; k < 2; k++) {
        jobs[k].from = words[1], jobs[k].to = tmpfile();
        if (!jobs[k].to || pthread_create(&threads[k], NULL, replay, &jobs[k])) return 2;
    }
    for (k = 0; k < 2; k++) {
        pthread_join(threads[k], NULL);
        rewind(jobs[k].to);
        while ((some = fread(bytes, 1, sizeof(bytes), jobs[k].to))) fwrite(bytes, 1, some, file);
        fclose(jobs[k].to);
    }
    return fclose(file) || jobs[0].failed || jobs[1].failed;
}
