/* How a function of many columns is called, be it a program or straight-line C. C99. */
#ifndef WB_KERNEL_H
#define WB_KERNEL_H

#include <math.h>
#include <stdint.h>

/* out[:, c] = function(v[:, offset + c], p[:, c]) for c = 0 .. count - 1. Rows are entries, columns
   are stages (or slots). The numbers of a row are neighbours; *_row is the distance in bytes of two
   rows. `out` overlaps neither v nor p. `work` is memory of the caller, wb_work(program) doubles,
   aligned to 64 bytes. Straight-line functions ignore `program` and `work`. */
typedef void wb_function(const int64_t *program, int64_t offset, int64_t count, const double *v,
                         int64_t v_row, const double *p, int64_t p_row, double *out,
                         int64_t out_row, double *work);
typedef struct {
  wb_function *run;
  const int64_t *program;
} wb_kernel;

/* No column depends on another one, whatever registers an operation reads and writes. */
#if defined(__clang__)
#define WB_INDEPENDENT _Pragma("clang loop vectorize(assume_safety)")
#elif defined(__GNUC__)
#define WB_INDEPENDENT _Pragma("GCC ivdep")
#elif defined(_MSC_VER)
#define WB_INDEPENDENT __pragma(loop(ivdep))
#else
#define WB_INDEPENDENT
#endif

#endif
