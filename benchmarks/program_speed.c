/* Run the programs of a file: microseconds, and one call each in `run` for a counter of
   instructions. program_speed.py writes the file and compiles this. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "evaluator.h"

void run(const int64_t *program, int64_t count, double *const *arrays);

void run(const int64_t *program, int64_t count, double *const *arrays) {
  const int64_t row = count * (int64_t)sizeof(double);
  wb_evaluate(program, 0, count, arrays[0], row, arrays[1], row, arrays[2], row, arrays[3]);
}

/* By a pointer that may change, so that `run` stays a function of its own. */
static void (*volatile call)(const int64_t *, int64_t, double *const *) = run;

static int64_t nanoseconds(void) {
  struct timespec now;
  timespec_get(&now, TIME_UTC);
  return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

/* FILE COUNT CALLS: a line for each program, the least time of one call. */
int main(int number, char **words) {
  FILE *file = number == 4 ? fopen(words[1], "rb") : NULL;
  const int64_t count = number == 4 ? atol(words[2]) : 0, calls = number == 4 ? atol(words[3]) : 0;
  int64_t length;
  while (file && fread(&length, sizeof length, 1, file) == 1) {
    int64_t *program = malloc((size_t)length * sizeof *program);
    if (!program || fread(program, sizeof *program, (size_t)length, file) != (size_t)length)
      return 1;
    const int64_t rows[3] = {program[1], program[2], program[7]};
    double *arrays[4];
    for (int k = 0; k < 3; k++) {
      arrays[k] = malloc((size_t)(rows[k] * count + 1) * sizeof(double));
      for (int64_t i = 0; arrays[k] && i < rows[k] * count; i++)
        arrays[k][i] = 0.2 + 0.7 * rand() / RAND_MAX;
    }
    char *block = malloc((size_t)wb_work(program) * sizeof(double) + 64);
    if (!block || !arrays[0] || !arrays[1] || !arrays[2]) return 1;
    arrays[3] = (double *)(block + (64 - (uintptr_t)block % 64));
    int64_t least = INT64_MAX;
    for (int64_t k = 0; k < calls; k++) {
      const int64_t begin = nanoseconds();
      call(program, count, arrays);
      const int64_t spent = nanoseconds() - begin;
      least = spent < least ? spent : least;
    }
    printf("%.3f\n", 1e-3 * (double)least);
    for (int k = 0; k < 3; k++) free(arrays[k]);
    free(block);
    free(program);
  }
  return !file;
}
