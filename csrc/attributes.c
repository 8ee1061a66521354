/* Reading and writing attributes of Python objects. */
#include "speedups.h"
#include <structmember.h>

static const char *const ATTRIBUTE_NAMES[ATTRIBUTES] = {
    "id", "type", "value", "packet", "depth", "variants", "vt_error_size",
    "serial", "_limits", "begin", "finish", "result", "native", "descriptor", "kernel_seconds", "use_kernel_timeout",
    "finish_exchange", "fail",
    "_direct", "_deadline", "_end", "_timeout", "_link", "_lock", "function", "direct", "acquire", "release",
    "arguments", "_resume", "_failed_prepared",
};

int set_names(State *state)
{
    for (int i = 0; i < ATTRIBUTES; i++) {
        state->names[i] = PyUnicode_InternFromString(ATTRIBUTE_NAMES[i]);
        if (state->names[i] == NULL)
            return -1;
    }
    return 0;
}

/* Return whether the attribute of objects of a type is a slot that Python code may write; store its place. */
COLD static bool find_slot(State *state, PyTypeObject *type, Attribute number)
{
    if (type->tp_getattro != PyObject_GenericGetAttr)
        return false;
    PyObject *found = PyObject_GetAttr((PyObject *)type, state->names[number]);
    if (found == NULL) {
        PyErr_Clear();
        return false;
    }
    bool slot = Py_IS_TYPE(found, &PyMemberDescr_Type) && PyType_IsSubtype(type, PyDescr_TYPE(found));
    if (slot) {
        const PyMemberDef *member = ((PyMemberDescrObject *)found)->d_member;
        slot = member->type == T_OBJECT_EX && member->flags == 0;
        if (slot) {
            state->offsets[number] = member->offset;
            Py_XSETREF(state->owners[number], Py_NewRef((PyObject *)type));
        }
    }
    Py_DECREF(found);
    return slot;
}

/* Return the place of a slot, NULL if the attribute is not in a slot. */
HOT static PyObject **slot_of(State *state, PyObject *object, Attribute number)
{
    if ((PyObject *)Py_TYPE(object) != state->owners[number] && !find_slot(state, Py_TYPE(object), number))
        return NULL;
    return (PyObject **)((char *)object + state->offsets[number]);
}

HOT PyObject *get_attribute(State *state, PyObject *object, Attribute number)
{
    PyObject **slot = slot_of(state, object, number);
    return slot != NULL && *slot != NULL ? Py_NewRef(*slot) : PyObject_GetAttr(object, state->names[number]);
}

HOT Outcome set_attribute(State *state, PyObject *object, Attribute number, PyObject *value)
{
    PyObject **slot = slot_of(state, object, number);
    if (slot == NULL)
        return PyObject_SetAttr(object, state->names[number], value) < 0 ? FAILED : DONE;
    Py_XSETREF(*slot, Py_NewRef(value));
    return DONE;
}
