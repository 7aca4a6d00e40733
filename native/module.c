/* The binding: `bind(name, *arrays)` checks the arrays once and returns a callable `f(dt, flag=0) -> int`.
 *
 * Only Python's stable ABI (3.11) is used, and no header of numpy's: arrays come by the buffer protocol. A bound buffer
 * is held until the callable goes, so no array can be freed or resized under it. The GIL is held throughout.
 */
#define Py_LIMITED_API 0x030B0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <limits.h>
#include <string.h>

#include "law.h"

#if defined(__GNUC__) && !defined(__clang__)
#define COMPILER "gcc " __VERSION__
#elif defined(__VERSION__)
#define COMPILER __VERSION__
#else
#define COMPILER "an unknown compiler"
#endif
#ifndef SRL_VERSION
#define SRL_VERSION "" /* of the package: pyproject.toml gives it */
#endif
#define MOST_ARGS 32

static const Law *const LAWS[] = {&tool_pose, &admittance, &moca_impedance, &kairos_clik, &torque_guard,
                                  &velocity_guard, &position_guard, &sent_tracker, &command_left, &ur_take, &ur_fill,
                                  &felt_wrench, &object_mapping, &panda_fill, &panda_torque, &panda_record,
                                  &panda_watch, &sample_check, &rate_check, &following_position, &following_velocity, NULL};

typedef struct {
    PyObject_HEAD
    const Law *law;
    int n, count;
    double *arrays[MOST_ARGS];
    Py_buffer views[MOST_ARGS];
} Bound;

static PyObject *bound_type; /* kept for the process's life */

static void bound_dealloc(PyObject *self) {
    Bound *bound = (Bound *)self;
    PyTypeObject *type = Py_TYPE(self);
    for (int i = 0; i < bound->count; i++) PyBuffer_Release(&bound->views[i]);
    freefunc release = (freefunc)PyType_GetSlot(type, Py_tp_free);
    release(self);
    Py_DECREF(type);
}

static PyObject *bound_call(PyObject *self, PyObject *args, PyObject *keywords) {
    Bound *bound = (Bound *)self;
    Py_ssize_t given = PyTuple_Size(args);
    if (given < 1 || given > 2 || (keywords != NULL && PyDict_Size(keywords) > 0)) {
        PyErr_SetString(PyExc_TypeError, "expected dt, and at most one flag after it");
        return NULL;
    }
    double dt = PyFloat_AsDouble(PyTuple_GetItem(args, 0));
    if (dt == -1.0 && PyErr_Occurred()) return NULL;
    int flag = 0;
    if (given == 2 && (flag = PyObject_IsTrue(PyTuple_GetItem(args, 1))) < 0) return NULL;
    if (!(dt >= 0.0 && dt <= 1.0)) return PyLong_FromLong(RARE); /* a clock that goes back, or NaN: for Python */
    return PyLong_FromLong(bound->law->step(bound->arrays, bound->n, dt, flag));
}

static const Law *law_of(const char *name) {
    for (const Law *const *law = LAWS; *law; law++)
        if (!strcmp((*law)->name, name)) return *law;
    return NULL;
}

/* Takes one array, or says what is wrong with it. */
static int take(Bound *bound, int i, PyObject *array) {
    const Arg *arg = &bound->law->args[i];
    Py_buffer *view = &bound->views[i];
    if (PyObject_GetBuffer(array, view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (arg->written ? PyBUF_WRITABLE : 0)) < 0)
        return -1;
    bound->count = i + 1; /* it is to be released from here on */
    bound->arrays[i] = view->buf;
    if (view->format == NULL || strcmp(view->format, "d") || view->itemsize != (Py_ssize_t)sizeof(double)) {
        PyErr_Format(PyExc_TypeError, "%s: %s must be float64", bound->law->name, arg->name);
        return -1;
    }
    if ((size_t)view->buf % _Alignof(double)) {
        PyErr_Format(PyExc_ValueError, "%s: %s isn't aligned", bound->law->name, arg->name);
        return -1;
    }
    Py_ssize_t have = view->len / view->itemsize, want;
    if (i == 0 && arg->each == 1 && arg->fixed <= 0) {
        int most = arg->fixed == ANY ? INT_MAX : MOST_JOINTS;
        if (have < 1 || have > most) {
            PyErr_Format(PyExc_ValueError, "%s: %zd joints, and it takes 1 to %d", bound->law->name, have, most);
            return -1;
        }
        bound->n = (int)have;
    }
    want = (arg->fixed == ANY ? 0 : arg->fixed) + (Py_ssize_t)arg->each * bound->n;
    if (have != want) {
        PyErr_Format(PyExc_ValueError, "%s: %s has %zd elements instead of %zd", bound->law->name, arg->name, have,
                     want);
        return -1;
    }
    return 0;
}

static PyObject *module_bind(PyObject *module, PyObject *args) {
    (void)module;
    Py_ssize_t given = PyTuple_Size(args);
    PyObject *first = given ? PyTuple_GetItem(args, 0) : NULL;
    const char *name = first && PyUnicode_Check(first) ? PyUnicode_AsUTF8AndSize(first, NULL) : NULL;
    if (name == NULL) {
        if (!PyErr_Occurred()) PyErr_SetString(PyExc_TypeError, "expected a name, then arrays");
        return NULL;
    }
    const Law *law = law_of(name);
    if (law == NULL) return PyErr_Format(PyExc_KeyError, "nothing is called '%s'", name);
    int count = 0;
    while (law->args[count].name) count++;
    if (count > MOST_ARGS) return PyErr_Format(PyExc_SystemError, "%s has %d arrays: raise MOST_ARGS", name, count);
    if (given - 1 != count)
        return PyErr_Format(PyExc_TypeError, "%s takes %d arrays, not %zd", name, count, given - 1);
    allocfunc allocate = (allocfunc)PyType_GetSlot((PyTypeObject *)bound_type, Py_tp_alloc);
    Bound *bound = (Bound *)allocate((PyTypeObject *)bound_type, 0);
    if (bound == NULL) return NULL;
    bound->law = law;
    for (int i = 0; i < count; i++)
        if (take(bound, i, PyTuple_GetItem(args, i + 1)) < 0) {
            Py_DECREF(bound);
            return NULL;
        }
    return (PyObject *)bound;
}

static PyType_Slot bound_slots[] = {
    {Py_tp_dealloc, bound_dealloc},
    {Py_tp_call, bound_call},
    {Py_tp_doc, "A law with its arrays: f(dt, flag=0) returns 0, 1 (limited), or -1: nothing was done, Python must."},
    {0, NULL},
};

static PyType_Spec bound_spec = {
    .name = "srl.runtime._compiled.Bound",
    .basicsize = sizeof(Bound),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_DISALLOW_INSTANTIATION | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = bound_slots,
};

static PyMethodDef methods[] = {
    {"bind", module_bind, METH_VARARGS, "bind(name, *arrays): checks the arrays once and returns f(dt, flag=0)."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "srl.runtime._compiled", "Laws and guards in C.", -1,
                                        methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__compiled(void) {
    PyObject *module = PyModule_Create(&definition);
    if (module == NULL) return NULL;
    if (bound_type == NULL) bound_type = PyType_FromSpec(&bound_spec);
    if (bound_type == NULL || PyModule_AddStringConstant(module, "compiler", COMPILER) < 0 ||
        PyModule_AddStringConstant(module, "version", SRL_VERSION) < 0) {
        Py_DECREF(module);
        return NULL;
    }
    return module;
}
