/* Python module: run a program. Compiled so that numbers are CasADi's own, see setup.py. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "evaluator.h"

static const double *at(long long address) { return (const double *)(intptr_t)address; }

/* evaluate(program, offset, count, v, v_row, p, p_row, out, out_row): addresses and numbers, see
   wb_function. Other threads of Python go on meanwhile. */
static PyObject *evaluate(PyObject *module, PyObject *arguments) {
  long long program_at, offset, count, v, v_row, p, p_row, out, out_row;
  (void)module;
  if (!PyArg_ParseTuple(arguments, "LLLLLLLLL", &program_at, &offset, &count, &v, &v_row, &p,
                        &p_row, &out, &out_row))
    return NULL;
  const int64_t *program = (const int64_t *)(intptr_t)program_at;
  if (program[0] != WB_MAGIC) {
    PyErr_SetString(PyExc_ValueError, "this is no program of this version");
    return NULL;
  }
  void *block = PyMem_Malloc((size_t)wb_work(program) * sizeof(double) + 64);
  if (block == NULL) return PyErr_NoMemory();
  double *work = (double *)(((uintptr_t)block + 63) / 64 * 64);
  Py_BEGIN_ALLOW_THREADS
  wb_evaluate(program, offset, count, at(v), v_row, at(p), p_row, (double *)at(out), out_row, work);
  Py_END_ALLOW_THREADS
  PyMem_Free(block);
  Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"evaluate", evaluate, METH_VARARGS, "Run a program for many columns, see evaluator.h."},
    {NULL, NULL, 0, NULL}};

static PyModuleDef_Slot slots[] = {{0, NULL}};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_evaluator", NULL, 0, methods,
                                        slots, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__evaluator(void) { return PyModuleDef_Init(&definition); }
