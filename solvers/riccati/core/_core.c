/* Python module: solve problems whose tables Python has filled in, see workspace.py. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "riccati.h"

/* The arguments of a solve. */
typedef struct {
    const wb_problem *problem;
    const wb_settings *settings;
    const wb_start *start;
    wb_result *result;
    const int64_t *stop;
    double *memory;
} task;

typedef void solver(const wb_problem *problem, const wb_settings *settings, const wb_start *start,
                    wb_result *result, const volatile int64_t *stop, double *memory);

wb_function wb_program;
int64_t wb_program_work(const int64_t *program);
static wb_function *program = wb_program;
static solver *solve_one = wb_solve;

/* Choose the code for this processor. */
static void choose_level(void) {
#ifdef WB_LEVELS
    wb_function wb_program_level_3;
    solver wb_solve_level_3;
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
        __builtin_cpu_supports("bmi2")) {
        program = wb_program_level_3;
        solve_one = wb_solve_level_3;
    }
#endif
}

static void *at(long long address) { return (void *)(intptr_t)address; }

/* solve(tasks, count): solve the tasks whose addresses stand in an array, one after the other.
 * Other threads of Python go on meanwhile, without being waited for in between. */
static PyObject *solve(PyObject *module, PyObject *arguments) {
    long long tasks, count;
    (void)module;
    if (!PyArg_ParseTuple(arguments, "LL", &tasks, &count)) return NULL;
    const int64_t *row = at(tasks);
    Py_BEGIN_ALLOW_THREADS for (long long k = 0; k < count; k++) {
        const task *given = at(row[k]);
        solve_one(given->problem, given->settings, given->start, given->result, given->stop,
                  given->memory);
    }
    Py_END_ALLOW_THREADS Py_RETURN_NONE;
}

/* size(problem) -> doubles of memory of a solve. */
static PyObject *size(PyObject *module, PyObject *address) {
    (void)module;
    long long place = PyLong_AsLongLong(address);
    return PyErr_Occurred() ? NULL : PyLong_FromLongLong(wb_size(at(place)));
}

/* work(program) -> doubles of scratch memory that a program needs. */
static PyObject *work(PyObject *module, PyObject *address) {
    (void)module;
    long long place = PyLong_AsLongLong(address);
    return PyErr_Occurred() ? NULL : PyLong_FromLongLong(wb_program_work(at(place)));
}

static PyMethodDef methods[] = {
    {"solve", solve, METH_VARARGS, "Solve the tasks whose addresses stand in an array."},
    {"size", size, METH_O, "Doubles of memory that a solve of a problem needs."},
    {"work", work, METH_O, "Doubles of scratch memory that a program needs."},
    {NULL, NULL, 0, NULL}};

/* Give Python the address of the evaluator, and the sizes of what it fills in. */
static int execute(PyObject *module) {
    choose_level();
    PyObject *address = PyLong_FromLongLong((intptr_t)program);
    PyObject *sizes =
        Py_BuildValue("(nnnnnnn)", sizeof(wb_problem), sizeof(wb_kind), sizeof(wb_slots),
                      sizeof(wb_settings), sizeof(wb_start), sizeof(wb_result), sizeof(task));
    int failed = PyModule_AddObjectRef(module, "PROGRAM", address) < 0 ||
                 PyModule_AddObjectRef(module, "SIZES", sizes) < 0;
    Py_XDECREF(address);
    Py_XDECREF(sizes);
    return -failed;
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, execute}, {0, NULL}};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_core", NULL, 0, methods, slots, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__core(void) { return PyModuleDef_Init(&definition); }
