/* The module orinkit.core._speedups: its functions, and the objects of Python that they use. */
#include "speedups.h"

static const char *const NAMES[FUNCTIONS] = {
    "encode", "encode_variant", "encode_integer", "encode_string", "encode_single", "decode", "encode_request",
    "call", "call_prepared", "call_prepared_by_client",
};

PyObject *in_python(State *state, FunctionNumber number, PyObject *const *arguments, Py_ssize_t count, PyObject *names)
{
    PyObject *function = state->fallback[number];
    if (function == NULL)
        return PyErr_Format(PyExc_RuntimeError, "replaced() was not called for %s", NAMES[number]);
    return PyObject_Vectorcall(function, arguments, (size_t)count, names);
}

/* replaced(name, function): remember the Python function for unusual cases, and return the function in C. */
static PyObject *replaced(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    State *state = state_of(module);
    if (count != 2 || !PyUnicode_Check(arguments[0]))
        return PyErr_Format(PyExc_TypeError, "replaced() takes a name and a function");
    for (int i = 0; i < FUNCTIONS; i++)
        if (PyUnicode_CompareWithASCIIString(arguments[0], NAMES[i]) == 0)
            Py_XSETREF(state->fallback[i], Py_NewRef(arguments[1]));
    PyObject *function = PyObject_GetAttr(module, arguments[0]);
    if (function == NULL && PyErr_ExceptionMatches(PyExc_AttributeError)) {
        PyErr_Clear(); /* not available on this platform */
        function = Py_NewRef(arguments[1]);
    }
    return function;
}

static PyObject *keep(PyObject **places[], PyObject *const *arguments, Py_ssize_t count, Py_ssize_t wanted)
{
    if (count != wanted)
        return PyErr_Format(PyExc_TypeError, "%zd arguments expected, not %zd", wanted, count);
    for (Py_ssize_t i = 0; i < wanted; i++)
        Py_XSETREF(*places[i], Py_NewRef(arguments[i]));
    Py_RETURN_NONE;
}

static PyObject *set_codec(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    State *s = state_of(module);
    PyObject **places[] = {&s->variant_type, &s->limits_type, &s->default_limits, &s->amount_to_wire, &s->date_to_wire,
                           &s->amount_from_wire, &s->date_from_wire, &s->date_from_wire_exact};
    return keep(places, arguments, count, 8);
}

static PyObject *set_exchange(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    State *s = state_of(module);
    PyObject **places[] = {&s->unfinished, &s->result_variant, &s->result_integer, &s->result_string};
    return keep(places, arguments, count, 4);
}

static PyObject *set_requests(PyObject *module, PyObject *argument_types)
{
    if (!PyDict_CheckExact(argument_types))
        return PyErr_Format(PyExc_TypeError, "set_requests() takes a dict");
    PyObject **places[] = {&state_of(module)->argument_types};
    return keep(places, &argument_types, 1, 1);
}

#define WITH_COUNT(function) (PyCFunction)(void (*)(void))(function)

static const PyMethodDef FUNCTIONS_TABLE[] = {
    {"encode", encode, METH_O, NULL},
    {"encode_variant", WITH_COUNT(encode_variant), METH_FASTCALL | METH_KEYWORDS, NULL},
    {"encode_integer", encode_integer, METH_O, NULL},
    {"encode_string", encode_string, METH_O, NULL},
    {"encode_single", encode_single, METH_O, NULL},
    {"decode", WITH_COUNT(decode), METH_FASTCALL | METH_KEYWORDS, NULL},
    {"replaced", WITH_COUNT(replaced), METH_FASTCALL, NULL},
    {"set_codec", WITH_COUNT(set_codec), METH_FASTCALL, NULL},
    {"encode_request", WITH_COUNT(encode_request), METH_FASTCALL | METH_KEYWORDS, NULL},
    {"native_template", native_template, METH_VARARGS, NULL},
    {"native_request", WITH_COUNT(native_request), METH_FASTCALL, NULL},
    {"set_requests", set_requests, METH_O, NULL},
    {"set_exchange", WITH_COUNT(set_exchange), METH_FASTCALL, NULL},
#ifdef WITH_EXCHANGE
    {"set_timeout", set_timeout, METH_VARARGS, NULL},
    {"call", WITH_COUNT(call), METH_FASTCALL, NULL},
    {"call_prepared", WITH_COUNT(call_prepared), METH_FASTCALL, NULL},
    {"call_prepared_by_client", WITH_COUNT(call_prepared_by_client), METH_FASTCALL, NULL},
#endif
    {NULL, NULL, 0, NULL},
};

/* The references in State, for the garbage collector. */
static int traverse(PyObject *module, visitproc visit, void *arg)
{
    State *state = state_of(module);
    for (PyObject **object = state->fallback; object < (PyObject **)(state + 1); object++)
        Py_VISIT(*object);
    return 0;
}

static int clear(PyObject *module)
{
    State *state = state_of(module);
    for (PyObject **object = state->fallback; object < (PyObject **)(state + 1); object++)
        Py_CLEAR(*object);
    return 0;
}

static void release(void *module) { clear((PyObject *)module); }

static int execute(PyObject *module)
{
    State *s = state_of(module);
    if (set_names(s) < 0)
        return -1;
    return PyModule_AddIntConstant(module, "INTERFACE", INTERFACE);
}

static PyModuleDef_Slot SLOTS[] = {
    {Py_mod_exec, execute},
#if PY_VERSION_HEX >= 0x030C0000
    {Py_mod_multiple_interpreters, Py_MOD_PER_INTERPRETER_GIL_SUPPORTED},
#endif
    {0, NULL},
};

static PyModuleDef MODULE = {
    .m_base = PyModuleDef_HEAD_INIT,
    .m_name = "orinkit.core._speedups",
    .m_size = sizeof(State),
    .m_methods = (PyMethodDef *)FUNCTIONS_TABLE, /* Python does not write to it */
    .m_slots = SLOTS,
    .m_traverse = traverse,
    .m_clear = clear,
    .m_free = release,
};

PyMODINIT_FUNC PyInit__speedups(void) { return PyModuleDef_Init(&MODULE); }
