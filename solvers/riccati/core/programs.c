/* The evaluator of programs, with the solver's flags. */

#include "evaluator.h"

#include "levels.h"

int64_t wb_program_work(const int64_t *program) { return wb_work(program); }

void wb_program(const int64_t *program, int64_t offset, int64_t count, const double *v,
                int64_t v_row, const double *p, int64_t p_row, double *out, int64_t out_row,
                double *work) {
    wb_evaluate(program, offset, count, v, v_row, p, p_row, out, out_row, work);
}
