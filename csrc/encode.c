/* Values to bytes: the counterpart of "to bytes" in orinkit/values/codec.py. */
#include "speedups.h"

const FixedType FIXED[VT_TYPES] = {
    [VT_I2] = {2, 16}, [VT_I4] = {4, 16}, [VT_R4] = {4, 16}, [VT_R8] = {8, 16}, [VT_CY] = {8, 1}, [VT_DATE] = {8, 1},
    [VT_ERROR] = {4, 16}, [VT_BOOL] = {2, 16}, [VT_I1] = {1, 16}, [VT_UI1] = {1, 0}, [VT_UI2] = {2, 16},
    [VT_UI4] = {4, 16}, [VT_I8] = {8, 16}, [VT_UI8] = {8, 16},
};

static Outcome put_typed(State *state, Writer *writer, PyObject *variant, int error_size, int depth);

HOT static Outcome put_head(Writer *writer, unsigned vt, size_t count)
{
    Outcome outcome = writer_reserve(writer, ELEMENT_HEAD);
    if (outcome != DONE)
        return outcome;
    uint8_t *to = writer->start + writer->size;
    store_u16(to, (uint16_t)vt);
    store_u32(to + 2, (uint32_t)count);
    writer->size += ELEMENT_HEAD;
    return DONE;
}

/* --- elements of a fixed size -------------------------------------------------------------------------------------- */

static Outcome integer_between(PyObject *item, long long low, long long high, long long *number)
{
    int overflow;
    if (!PyLong_CheckExact(item))
        return UNUSUAL;
    *number = PyLong_AsLongLongAndOverflow(item, &overflow);
    return overflow || *number < low || *number > high ? UNUSUAL : DONE;
}

static Outcome store_integer(int base, PyObject *item, uint8_t *to, int size)
{
    static const struct { long long low, high; } BOUNDS[VT_TYPES] = {
        [VT_I2] = {INT16_MIN, INT16_MAX}, [VT_I4] = {INT32_MIN, INT32_MAX}, [VT_I1] = {INT8_MIN, INT8_MAX},
        [VT_UI1] = {0, UINT8_MAX}, [VT_UI2] = {0, UINT16_MAX}, [VT_UI4] = {0, UINT32_MAX}, [VT_ERROR] = {0, UINT32_MAX},
        [VT_I8] = {INT64_MIN, INT64_MAX},
    };
    long long number;
    long long high = base == VT_ERROR && size == 2 ? UINT16_MAX : BOUNDS[base].high;
    Outcome outcome = integer_between(item, BOUNDS[base].low, high, &number);
    if (outcome == DONE)
        memcpy(to, &number, (size_t)size); /* little-endian: the low bytes come first */
    return outcome;
}

static Outcome store_unsigned_64(PyObject *item, uint8_t *to)
{
    if (!PyLong_CheckExact(item))
        return UNUSUAL;
    unsigned long long number = PyLong_AsUnsignedLongLong(item);
    if (number == (unsigned long long)-1 && PyErr_Occurred()) {
        PyErr_Clear();
        return UNUSUAL;
    }
    memcpy(to, &number, sizeof number);
    return DONE;
}

static Outcome store_single(PyObject *item, uint8_t *to)
{
    if (!PyFloat_CheckExact(item))
        return UNUSUAL;
    if (PyFloat_Pack4(PyFloat_AS_DOUBLE(item), (char *)to, 1) < 0) {
        PyErr_Clear(); /* beyond the range of single precision */
        return UNUSUAL;
    }
    return DONE;
}

static Outcome store_double(PyObject *item, uint8_t *to)
{
    if (!PyFloat_CheckExact(item))
        return UNUSUAL;
    double number = PyFloat_AS_DOUBLE(item);
    memcpy(to, &number, sizeof number);
    return DONE;
}

/* Let a function of orinkit.values.conversions convert the element. An exception is passed on, except for
 * RecursionError, which encode_variant() in Python replaces. */
static Outcome store_converted(PyObject *convert, int base, PyObject *item, uint8_t *to)
{
    PyObject *number = PyObject_CallOneArg(convert, item);
    if (number == NULL) {
        if (!PyErr_ExceptionMatches(PyExc_RecursionError))
            return FAILED;
        PyErr_Clear();
        return UNUSUAL;
    }
    Outcome outcome = base == VT_CY ? store_integer(VT_I8, number, to, 8) : store_double(number, to);
    Py_DECREF(number);
    return outcome;
}

HOT static Outcome store_item(State *state, int base, PyObject *item, uint8_t *to, int size)
{
    switch (base) {
    case VT_R8:
        return store_double(item, to);
    case VT_R4:
        return store_single(item, to);
    case VT_DATE:
        return PyFloat_CheckExact(item) ? store_double(item, to) : store_converted(state->date_to_wire, base, item, to);
    case VT_CY:
        return store_converted(state->amount_to_wire, base, item, to);
    case VT_BOOL:
        if (item != Py_True && item != Py_False)
            return UNUSUAL;
        store_u16(to, item == Py_True ? 0xFFFF : 0); /* VARIANT_TRUE has all bits set */
        return DONE;
    case VT_UI8:
        return store_unsigned_64(item, to);
    default:
        return store_integer(base, item, to, size);
    }
}

/* --- texts --------------------------------------------------------------------------------------------------------- */

static size_t count_units(int kind, const void *characters, Py_ssize_t length)
{
    size_t units = (size_t)length;
    if (kind == PyUnicode_4BYTE_KIND)
        for (Py_ssize_t i = 0; i < length; i++)
            units += ((const Py_UCS4 *)characters)[i] > 0xFFFF;
    return units;
}

static uint8_t *put_character(uint8_t *to, Py_UCS4 character)
{
    if (character > 0xFFFF) {
        character -= 0x10000;
        store_u16(to, (uint16_t)(0xD800 | character >> 10));
        to += 2;
        character = 0xDC00 | (character & 0x3FF);
    }
    store_u16(to, (uint16_t)character); /* an unpaired surrogate is written as it is */
    return to + 2;
}

static Outcome put_text(Writer *writer, PyObject *text)
{
    if (!PyUnicode_CheckExact(text) || PyUnicode_GET_LENGTH(text) > MOST_BYTES / 2)
        return UNUSUAL;
#if PY_VERSION_HEX < 0x030C0000
    if (PyUnicode_READY(text) < 0)
        return FAILED;
#endif
    Py_ssize_t length = PyUnicode_GET_LENGTH(text);
    int kind = (int)PyUnicode_KIND(text);
    const void *characters = PyUnicode_DATA(text);
    size_t size = 2 * count_units(kind, characters, length);
    Outcome outcome = writer_reserve(writer, 4 + size);
    if (outcome != DONE)
        return outcome;
    uint8_t *to = writer->start + writer->size;
    store_u32(to, (uint32_t)size);
    to += 4;
    for (Py_ssize_t i = 0; i < length; i++)
        to = put_character(to, PyUnicode_READ(kind, characters, i));
    writer->size += 4 + size;
    return DONE;
}

/* --- lists --------------------------------------------------------------------------------------------------------- */

static bool is_sequence(PyObject *value) { return PyList_CheckExact(value) || PyTuple_CheckExact(value); }

/* Return a new reference to an element; NULL if the list has become shorter: Python code may run between two elements. */
static PyObject *item_at(PyObject *items, Py_ssize_t i)
{
    return i < PySequence_Fast_GET_SIZE(items) ? Py_NewRef(PySequence_Fast_GET_ITEM(items, i)) : NULL;
}

HOT static Outcome put_doubles(Writer *writer, PyObject *items, Py_ssize_t count)
{
    if (count > MOST_BYTES / 8)
        return UNUSUAL;
    Outcome outcome = writer_reserve(writer, 8 * (size_t)count);
    if (outcome != DONE)
        return outcome;
    uint8_t *to = writer->start + writer->size;
    PyObject **item = PySequence_Fast_ITEMS(items);
    for (Py_ssize_t i = 0; i < count; i++, to += 8)
        if (store_double(item[i], to) != DONE)
            return UNUSUAL;
    writer->size += 8 * (size_t)count;
    return DONE;
}

HOT static Outcome put_items(State *state, Writer *writer, int base, PyObject *items, Py_ssize_t count, int size)
{
    if (base == VT_R8)
        return put_doubles(writer, items, count);
    if (count > MOST_BYTES)
        return UNUSUAL;
    Outcome outcome = writer_reserve(writer, (size_t)size * (size_t)count);
    for (Py_ssize_t i = 0; outcome == DONE && i < count; i++) {
        PyObject *item = item_at(items, i);
        if (item == NULL)
            return UNUSUAL;
        outcome = store_item(state, base, item, writer->start + writer->size, size);
        writer->size += (size_t)size;
        Py_DECREF(item);
    }
    return outcome;
}

static Outcome put_texts(Writer *writer, PyObject *items, Py_ssize_t count)
{
    Outcome outcome = DONE;
    for (Py_ssize_t i = 0; outcome == DONE && i < count; i++)
        outcome = put_text(writer, PySequence_Fast_GET_ITEM(items, i));
    return outcome;
}

/* --- Variant objects ----------------------------------------------------------------------------------------------- */

static Outcome put_variants(State *state, Writer *writer, PyObject *items, Py_ssize_t count, int error_size, int depth)
{
    Outcome outcome = DONE;
    for (Py_ssize_t i = 0; outcome == DONE && i < count; i++) {
        PyObject *item = item_at(items, i);
        if (item == NULL)
            return UNUSUAL;
        outcome = put_typed(state, writer, item, error_size, depth);
        Py_DECREF(item);
    }
    return outcome;
}

HOT static Outcome put_array(State *state, Writer *writer, int base, PyObject *items, int error_size, int depth)
{
    if (base == VT_UI1) {
        if (!PyBytes_CheckExact(items))
            return UNUSUAL;
        Outcome outcome = put_head(writer, VT_UI1 | VT_ARRAY, (size_t)PyBytes_GET_SIZE(items));
        return outcome != DONE ? outcome
                               : writer_add(writer, PyBytes_AS_STRING(items), (size_t)PyBytes_GET_SIZE(items));
    }
    if (!is_sequence(items))
        return UNUSUAL;
    Py_ssize_t count = PySequence_Fast_GET_SIZE(items);
    Outcome outcome = put_head(writer, (unsigned)base | VT_ARRAY, (size_t)count);
    if (outcome != DONE)
        return outcome;
    if (base == VT_VARIANT)
        return put_variants(state, writer, items, count, error_size, depth + 1);
    if (base == VT_BSTR)
        return put_texts(writer, items, count);
    if (FIXED[base].size == 0)
        return UNUSUAL;
    return put_items(state, writer, base, items, count, base == VT_ERROR ? error_size : FIXED[base].size);
}

HOT static Outcome put_scalar(State *state, Writer *writer, int base, PyObject *value, int error_size, int depth)
{
    if (base == VT_VARIANT) /* b-CAP has no VT_VARIANT except as the type of an array: the value in it is written */
        return put_typed(state, writer, value, error_size, depth + 1);
    if (base != VT_EMPTY && base != VT_NULL && base != VT_BSTR && FIXED[base].size == 0)
        return UNUSUAL;
    Outcome outcome = put_head(writer, (unsigned)base, 1);
    if (outcome != DONE || base == VT_EMPTY || base == VT_NULL)
        return outcome;
    if (base == VT_BSTR)
        return put_text(writer, value);
    int size = base == VT_ERROR ? error_size : FIXED[base].size;
    outcome = writer_reserve(writer, (size_t)size);
    if (outcome == DONE)
        outcome = store_item(state, base, value, writer->start + writer->size, size);
    writer->size += outcome == DONE ? (size_t)size : 0;
    return outcome;
}

static Outcome put_content(State *state, Writer *writer, PyObject *type, PyObject *value, int error_size, int depth)
{
    if (!PyLong_Check(type)) /* a member of VarType is an int, too */
        return UNUSUAL;
    int overflow;
    long vt = PyLong_AsLongAndOverflow(type, &overflow);
    long base = vt & ~VT_ARRAY;
    if (overflow || base < 0 || base >= VT_TYPES)
        return UNUSUAL;
    return vt & VT_ARRAY ? put_array(state, writer, (int)base, value, error_size, depth)
                         : put_scalar(state, writer, (int)base, value, error_size, depth);
}

/* Append a Variant object. */
static Outcome put_typed(State *state, Writer *writer, PyObject *variant, int error_size, int depth)
{
    if (depth > MOST_DEPTH || (PyObject *)Py_TYPE(variant) != state->variant_type)
        return UNUSUAL;
    PyObject *type = get_attribute(state, variant, A_TYPE);
    if (type == NULL)
        return FAILED;
    PyObject *value = get_attribute(state, variant, A_VALUE);
    Outcome outcome = value == NULL ? FAILED : put_content(state, writer, type, value, error_size, depth);
    Py_DECREF(type);
    Py_XDECREF(value);
    return outcome;
}

/* --- plain values -------------------------------------------------------------------------------------------------- */

/* Return the type of the array for a list; VT_VARIANT unless all elements have one of the types with arrays here. */
HOT static int list_type(PyObject *items, Py_ssize_t count)
{
    PyTypeObject *kind = Py_TYPE(PySequence_Fast_GET_ITEM(items, 0));
    int base = kind == &PyFloat_Type ? VT_R8
             : kind == &PyLong_Type ? VT_I4
             : kind == &PyUnicode_Type ? VT_BSTR
             : kind == &PyBool_Type ? VT_BOOL
                                    : VT_VARIANT;
    for (Py_ssize_t i = 1; base != VT_VARIANT && i < count; i++)
        if (Py_TYPE(PySequence_Fast_GET_ITEM(items, i)) != kind)
            base = VT_VARIANT;
    return base;
}

/* An element that put_value() does not know makes the whole value UNUSUAL, so the type of a list of, for example, dates
 * is decided in Python. */
HOT static Outcome put_list(State *state, Writer *writer, PyObject *items, bool plain, int depth)
{
    Py_ssize_t count = PySequence_Fast_GET_SIZE(items);
    if (count > MOST_BYTES)
        return UNUSUAL;
    int base = count ? list_type(items, count) : VT_VARIANT;
    if (base != VT_VARIANT)
        return put_array(state, writer, base, items, 4, depth);
    Outcome outcome = put_head(writer, VT_VARIANT | VT_ARRAY, (size_t)count);
    for (Py_ssize_t i = 0; outcome == DONE && i < count; i++) {
        PyObject *item = item_at(items, i);
        if (item == NULL)
            return UNUSUAL;
        outcome = put_value(state, writer, item, plain, depth + 1);
        Py_DECREF(item);
    }
    return outcome;
}

HOT Outcome put_value(State *state, Writer *writer, PyObject *value, bool plain, int depth)
{
    if (depth > MOST_DEPTH)
        return UNUSUAL;
    if (is_sequence(value))
        return put_list(state, writer, value, plain, depth);
    if (PyUnicode_CheckExact(value))
        return put_scalar(state, writer, VT_BSTR, value, 4, depth);
    if (PyFloat_CheckExact(value))
        return put_scalar(state, writer, VT_R8, value, 4, depth);
    if (PyLong_CheckExact(value))
        return put_scalar(state, writer, VT_I4, value, 4, depth);
    if (value == Py_None)
        return put_head(writer, VT_EMPTY, 1);
    if (PyBool_Check(value))
        return put_scalar(state, writer, VT_BOOL, value, 4, depth);
    if (PyBytes_CheckExact(value))
        return put_array(state, writer, VT_UI1, value, 4, depth);
    if ((PyObject *)Py_TYPE(value) == state->variant_type && !plain)
        return put_typed(state, writer, value, 4, depth);
    return UNUSUAL;
}

Outcome put_plain(State *state, Writer *writer, int base, PyObject *value)
{
    return put_scalar(state, writer, base, value, 4, 0);
}

HOT void put_length(Writer *writer, size_t start)
{
    store_u32(writer->start + start, (uint32_t)(writer->size - start - 4));
}

/* --- functions for Python ------------------------------------------------------------------------------------------ */

/* Return what was written as bytes, or what the Python function returns. */
static PyObject *written(State *state, Writer *writer, Outcome outcome, FunctionNumber number, PyObject *value)
{
    PyObject *result = NULL;
    if (outcome == DONE) {
        put_length(writer, 0);
        result = PyBytes_FromStringAndSize((const char *)writer->start, (Py_ssize_t)writer->size);
    } else if (outcome == UNUSUAL) {
        result = in_python(state, number, &value, 1, NULL);
    }
    writer_end(writer);
    return result;
}

/* An argument begins with its length: begin behind it. */
static void begin_argument(Writer *writer)
{
    writer_begin(writer);
    writer->size = 4;
}

PyObject *encode(PyObject *module, PyObject *value)
{
    State *state = state_of(module);
    Writer writer;
    begin_argument(&writer);
    return written(state, &writer, put_value(state, &writer, value, false, 0), ENCODE, value);
}

static PyObject *encode_scalar(PyObject *module, PyObject *value, int base, FunctionNumber number)
{
    State *state = state_of(module);
    Writer writer;
    begin_argument(&writer);
    Outcome outcome = put_scalar(state, &writer, base, value, 4, 0);
    return written(state, &writer, outcome, number, value);
}

PyObject *encode_integer(PyObject *module, PyObject *value) { return encode_scalar(module, value, VT_I4, ENCODE_INTEGER); }
PyObject *encode_string(PyObject *module, PyObject *value) { return encode_scalar(module, value, VT_BSTR, ENCODE_STRING); }
PyObject *encode_single(PyObject *module, PyObject *value) { return encode_scalar(module, value, VT_R4, ENCODE_SINGLE); }

PyObject *encode_variant(PyObject *module, PyObject *const *arguments, Py_ssize_t count, PyObject *names)
{
    State *state = state_of(module);
    Outcome outcome = UNUSUAL;
    Writer writer;
    begin_argument(&writer);
    long long error_size = 4;
    bool usual = names == NULL && (count == 1 || (count == 2 && integer_between(arguments[1], 2, 4, &error_size) == DONE));
    if (usual && error_size != 3)
        outcome = put_typed(state, &writer, arguments[0], (int)error_size, 0);
    if (outcome == UNUSUAL) {
        writer_end(&writer);
        return in_python(state, ENCODE_VARIANT, arguments, count, names);
    }
    return written(state, &writer, outcome, ENCODE_VARIANT, arguments[0]);
}
