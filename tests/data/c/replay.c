/* Solves the problems of a file, as many times as is asked for, and writes the results.
 * replay PROBLEMS RESULTS [TIMES]: the median processor time of each problem, us, goes to standard
 * output. */
#include "wideberth_solver.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static double now(void)
{
    struct timespec found;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &found);
    return 1e6 * (double)found.tv_sec + 1e-3 * (double)found.tv_nsec;
}

static int smaller(const void *one, const void *other)
{
    const double a = *(const double *)one, b = *(const double *)other;
    return (a > b) - (a < b);
}

int main(int count, char **words)
{
    static unsigned char memory[WIDEBERTH_MEMORY];
    static wideberth_problem problem;
    static wideberth_result result;
    static double spent[1000];
    const int times = count > 3 ? atoi(words[3]) : 1;
    FILE *in = fopen(words[1], "rb"), *out = fopen(words[2], "wb");
    while (fread(&problem, sizeof(problem), 1, in) == 1) {
        double violation;
        int k, error = 0;
        for (k = 0; k < times && !error; k++) {
            const double begin = now();
            error = wideberth_solve(&problem, memory, sizeof(memory), &result);
            spent[k] = now() - begin;
        }
        if (error) {
            fprintf(stderr, "%s\n", wideberth_error_text(error));
            return 1;
        }
        violation = wideberth_violation(&problem, &result);
        qsort(spent, (size_t)times, sizeof(double), smaller);
        printf("%.3f\n", spent[times / 2]);
        fwrite(&result, sizeof(result), 1, out);
        fwrite(&violation, sizeof(violation), 1, out);
    }
    fclose(in);
    return fclose(out);
}
