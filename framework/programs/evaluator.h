/* Evaluate a program, a list of operations, for many columns at once. C99.

   A program is an array of 64-bit words, which program.py writes:

     8 words      WB_MAGIC, rows of v, rows of p, constants, reads, operations, registers, results
     constants    a double each; they fill the first registers
     reads        two words each: array (0 is v, 1 is p), row; they are the next registers
     operations   six 32-bit words each: code, destination, operands a, b, c, d (of sincos, b is
                  the destination of the cosine)
     results      a word each: the register to be copied to this row of `out`

   Register `registers + k` is row k of `out`. An operation may write there and a later one read
   it; where results[k] is that register, nothing is copied. */
#ifndef WB_EVALUATOR_H
#define WB_EVALUATOR_H

#include <string.h>

#include "kernel.h"

#define WB_MAGIC 0x7762303100000001 /* of this layout of programs; another one gets another */
enum { WB_HEAD = 8, WB_READ = 2, WB_STEP = 6, WB_LANES = 24 };

#define WB_OPERATION(NAME, VALUE) WB_##NAME,
enum {
#include "operations.h"
  WB_SINCOS /* the one operation with two results */
};
#undef WB_OPERATION

#if defined(__GNUC__)
#define WB_NEVER __builtin_unreachable()
#else
#define WB_NEVER __assume(0)
#endif

static int64_t wb_table(const int64_t *program) { return (program[6] + program[7] + 7) / 8 * 8; }

/* Doubles of `work` that a program needs: the places of its registers, and the registers. */
static int64_t wb_work(const int64_t *program) {
  return wb_table(program) + program[6] * WB_LANES + program[7] * 8;
}

/* Eight columns are read before they are written: a result may take an operand's register. */
#define WB_OPERATION(NAME, VALUE)                                                                 \
  case WB_##NAME:                                                                                 \
    for (int64_t k = 0; k < lanes; k += 8) {                                                      \
      double values[8];                                                                           \
      for (int i = 0; i < 8; i++) {                                                               \
        const double a = a_at[k + i], b = b_at[k + i], c = c_at[k + i], d = d_at[k + i];          \
        (void)a, (void)b, (void)c, (void)d;                                                       \
        values[i] = VALUE;                                                                        \
      }                                                                                           \
      for (int i = 0; i < 8; i++) x[k + i] = values[i];                                           \
    }                                                                                             \
    break;

/* Run the operations for some columns, a multiple of 8. */
static void wb_operations(const int64_t *program, const int32_t *step, double *const *place,
                          int64_t lanes) {
  for (const int32_t *end = step + WB_STEP * program[5]; step != end; step += WB_STEP) {
    double *const x = place[step[1]];
    const double *const a_at = place[step[2]], *const b_at = place[step[3]];
    const double *const c_at = place[step[4]], *const d_at = place[step[5]];
    switch (step[0]) {
#include "operations.h"
    case WB_SINCOS: {
      double *const y = place[step[3]];
      for (int64_t i = 0; i < lanes; i++) {
        const double a = a_at[i];
        x[i] = sin(a);
        y[i] = cos(a);
      }
      break;
    }
    default:
      WB_NEVER;
    }
  }
}
#undef WB_OPERATION

/* Copy the columns of a row that are fewer than 8, and fill up with its first one. */
static double *wb_padded(double *to, const double *row, int64_t count) {
  for (int64_t i = 0; i < 8; i++)
    to[i] = row[i < count ? i : 0];
  return to;
}

static void wb_evaluate(const int64_t *program, int64_t offset, int64_t count, const double *v,
                        int64_t v_row, const double *p, int64_t p_row, double *out,
                        int64_t out_row, double *work) {
  const int64_t constants = program[3], reads = program[4], registers = program[6];
  const int64_t results = program[7];
  const int64_t *const read = program + WB_HEAD + constants;
  const int64_t *const result = read + WB_READ * reads + WB_STEP / 2 * program[5];
  const int32_t *const step = (const int32_t *)(read + WB_READ * reads);
  double **const place = (double **)work, *const memory = work + wb_table(program);
  double *const few = memory + registers * WB_LANES; /* the result where count < 8 */
  for (int64_t i = 0; i < registers; i++)
    place[i] = memory + i * WB_LANES;
  for (int64_t i = 0; i < constants; i++)
    for (int k = 0; k < WB_LANES; k++)
      memcpy(place[i] + k, program + WB_HEAD + i, sizeof(double));
  for (int64_t first = 0, lanes; first < count; first += lanes) {
    lanes = count - first < WB_LANES ? (count - first) / 8 * 8 : WB_LANES;
    if (lanes == 0) { /* the last ones: with some columns before them once more, if there are */
      lanes = 8;
      first = count < 8 ? 0 : count - 8;
    }
    for (int64_t i = 0; i < reads; i++) {
      const char *row = (const char *)(read[2 * i] ? p + first : v + offset + first);
      row += read[2 * i + 1] * (read[2 * i] ? p_row : v_row);
      place[constants + i] = count < 8 ? wb_padded(memory + (constants + i) * WB_LANES,
                                                   (const double *)row, count)
                                       : (double *)row;
    }
    for (int64_t i = 0; i < results; i++)
      place[registers + i] = count < 8 ? few + 8 * i
                                       : (double *)((char *)(out + first) + i * out_row);
    wb_operations(program, step, place, lanes);
    for (int64_t i = 0; i < results; i++) {
      double *const row = (double *)((char *)(out + first) + i * out_row);
      if (place[result[i]] != row)
        memcpy(row, place[result[i]], (size_t)(count < 8 ? count : lanes) * sizeof(double));
    }
  }
}

#endif
