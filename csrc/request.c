/* The packets of requests: the counterpart of orinkit/bcap/requests.py, and the templates of orinkit/bcap/direct.py. */
#include "speedups.h"

#define CAPSULE "orinkit.template"

static void put_header(uint8_t *start, size_t size, uint16_t serial, uint16_t reserved, uint32_t function, size_t count)
{
    start[0] = 0x01;
    store_u32(start + 1, (uint32_t)size);
    store_u16(start + 5, serial);
    store_u16(start + 7, reserved);
    store_u32(start + 9, function);
    store_u16(start + 13, (uint16_t)count);
}

/* --- encode_request() ---------------------------------------------------------------------------------------------- */

static Outcome put_argument(State *state, Writer *writer, unsigned vt, PyObject *value)
{
    size_t start = writer->size;
    Outcome outcome = writer_add(writer, "\0\0\0\0", 4);
    if (outcome == DONE)
        outcome = vt == VT_VARIANT ? put_value(state, writer, value, false, 0) : put_plain(state, writer, (int)vt, value);
    if (outcome == DONE)
        put_length(writer, start);
    return outcome;
}

/* Write a packet; types are the VARIANT types of the arguments of this function, one byte each. */
static Outcome put_request(State *state, Writer *writer, PyObject *types, PyObject *arguments)
{
    Py_ssize_t count = PyTuple_GET_SIZE(arguments);
    if (count > PyBytes_GET_SIZE(types))
        return UNUSUAL;
    Outcome outcome = writer_reserve(writer, PACKET_HEAD);
    writer->size = PACKET_HEAD;
    for (Py_ssize_t i = 0; outcome == DONE && i < count; i++)
        outcome = put_argument(state, writer, (uint8_t)PyBytes_AS_STRING(types)[i], PyTuple_GET_ITEM(arguments, i));
    return outcome == DONE ? writer_add(writer, "\x04", 1) : outcome;
}

static bool read_word(PyObject *object, uint16_t *word)
{
    int overflow;
    long number = PyLong_CheckExact(object) ? PyLong_AsLongAndOverflow(object, &overflow) : -1;
    *word = (uint16_t)number;
    return number >= 0 && number <= UINT16_MAX;
}

/* Return whether the named arguments are those of a stream: crc=False, vt_error_size=4. */
static bool for_stream(PyObject *const *values, PyObject *names)
{
    for (Py_ssize_t i = 0; names != NULL && i < PyTuple_GET_SIZE(names); i++) {
        PyObject *name = PyTuple_GET_ITEM(names, i);
        uint16_t size;
        if (PyUnicode_CompareWithASCIIString(name, "crc") == 0) {
            if (values[i] != Py_False)
                return false;
        } else if (PyUnicode_CompareWithASCIIString(name, "vt_error_size") != 0 || !read_word(values[i], &size) || size != 4)
            return false;
    }
    return true;
}

/* Write the packet of a function of the table. UNUSUAL: Python writes it, or reports the error. */
static Outcome put_call(State *state, Writer *writer, PyObject *const *arguments, Py_ssize_t count)
{
    uint16_t serial, reserved = 0;
    if (!PyTuple_CheckExact(arguments[1]) || !read_word(arguments[2], &serial) ||
        (count == 4 && !read_word(arguments[3], &reserved)))
        return UNUSUAL;
    PyObject *id = get_attribute(state, arguments[0], A_ID);
    if (id == NULL)
        return FAILED;
    PyObject *types = PyDict_GetItemWithError(state->argument_types, id); /* borrowed: no entry is removed */
    long function = PyLong_AsLong(id);
    Py_DECREF(id);
    if (types == NULL || function < 0)
        return PyErr_Occurred() ? FAILED : UNUSUAL;
    Outcome outcome = put_request(state, writer, types, arguments[1]);
    if (outcome == DONE)
        put_header(writer->start, writer->size, serial, reserved, (uint32_t)function, (size_t)PyTuple_GET_SIZE(arguments[1]));
    return outcome;
}

/* encode_request(function, arguments, serial, reserved=0, *, crc=False, vt_error_size=4) */
PyObject *encode_request(PyObject *module, PyObject *const *arguments, Py_ssize_t count, PyObject *names)
{
    State *state = state_of(module);
    Writer writer;
    writer_begin(&writer);
    Outcome outcome = UNUSUAL;
    if ((count == 3 || count == 4) && state->argument_types != NULL && for_stream(arguments + count, names))
        outcome = put_call(state, &writer, arguments, count);
    if (outcome == FAILED && PyErr_ExceptionMatches(PyExc_Exception)) {
        PyErr_Clear(); /* Python raises the error again, with the name of the function and of the argument */
        outcome = UNUSUAL;
    }
    PyObject *packet = NULL;
    if (outcome == DONE)
        packet = PyBytes_FromStringAndSize((const char *)writer.start, (Py_ssize_t)writer.size);
    writer_end(&writer);
    return outcome == UNUSUAL ? in_python(state, ENCODE_REQUEST, arguments, count, names) : packet;
}

/* --- templates ----------------------------------------------------------------------------------------------------- */

static void free_template(PyObject *capsule) { PyMem_Free(PyCapsule_GetPointer(capsule, CAPSULE)); }

/* Return the kind of the result of a function; -1 with an exception. */
int result_kind(State *state, PyObject *function)
{
    PyObject *kind = get_attribute(state, function, A_RESULT);
    if (kind == NULL)
        return -1;
    Py_DECREF(kind); /* the table of functions keeps it */
    return kind == Py_None                 ? NO_RESULT
           : kind == state->result_variant ? ANY_RESULT
           : kind == state->result_integer ? INTEGER_RESULT
           : kind == state->result_string  ? STRING_RESULT
                                           : OTHER_RESULT;
}

/* native_template(function, count, constants, varies, most): return an object for RequestTemplate.native. */
PyObject *native_template(PyObject *module, PyObject *arguments)
{
    State *state = state_of(module);
    PyObject *function;
    unsigned short number;
    PyObject *constants;
    int varies;
    long most;
    if (!PyArg_ParseTuple(arguments, "OHSpl:native_template", &function, &number, &constants, &varies, &most))
        return NULL;
    PyObject *id = get_attribute(state, function, A_ID);
    if (id == NULL)
        return NULL;
    unsigned long function_id = PyLong_AsUnsignedLong(id);
    Py_DECREF(id);
    int result = PyErr_Occurred() ? -1 : result_kind(state, function);
    if (result < 0)
        return NULL;
    size_t size = (size_t)PyBytes_GET_SIZE(constants);
    Template *template = PyMem_Calloc(1, sizeof *template + PACKET_HEAD + size);
    if (template == NULL)
        return PyErr_NoMemory();
    template->result = (ResultKind)result;
    template->most = most;
    template->varies = varies;
    template->size = PACKET_HEAD + size;
    put_header(template->start, 0, 0, 0, (uint32_t)function_id, number);
    memcpy(template->start + PACKET_HEAD, PyBytes_AS_STRING(constants), size);
    PyObject *capsule = PyCapsule_New(template, CAPSULE, free_template);
    if (capsule == NULL)
        PyMem_Free(template);
    return capsule;
}

HOT const Template *template_in(PyObject *capsule)
{
    return PyCapsule_CheckExact(capsule) ? PyCapsule_GetPointer(capsule, CAPSULE) : NULL;
}

HOT Outcome put_prepared(State *state, const Template *template, PyObject *value, uint16_t serial, Writer *writer)
{
    if (!template->varies && value != Py_None)
        return UNUSUAL;
    Outcome outcome = writer_add(writer, template->start, template->size);
    if (outcome == DONE && template->varies) {
        outcome = writer_add(writer, "\0\0\0\0", 4);
        if (outcome == DONE)
            outcome = put_value(state, writer, value, true, 0);
        if (outcome == DONE)
            put_length(writer, template->size);
    }
    if (outcome == DONE)
        outcome = writer_add(writer, "\x04", 1);
    if (outcome != DONE || writer->size > (size_t)template->most)
        return outcome == FAILED ? FAILED : UNUSUAL;
    store_u32(writer->start + 1, (uint32_t)writer->size);
    store_u16(writer->start + 5, serial);
    return DONE;
}

/* native_request(template, serial, value): return the packet; None if Python converts the value or reports its error. */
PyObject *native_request(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    const Template *template = count == 3 ? template_in(arguments[0]) : NULL;
    uint16_t serial;
    if (template == NULL || !read_word(arguments[1], &serial))
        return PyErr_Format(PyExc_TypeError, "native_request() takes a template, a serial and a value");
    Writer writer;
    writer_begin(&writer);
    Outcome outcome = put_prepared(state_of(module), template, arguments[2], serial, &writer);
    PyObject *packet = outcome == UNUSUAL ? Py_NewRef(Py_None) : NULL;
    if (outcome == DONE)
        packet = PyBytes_FromStringAndSize((const char *)writer.start, (Py_ssize_t)writer.size);
    writer_end(&writer);
    return packet;
}
