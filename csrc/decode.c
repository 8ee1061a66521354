/* Bytes to values: the counterpart of "from bytes" in orinkit/values/codec.py.
 *
 * Nothing is allocated for an array before its elements are known to be present, and nothing is read beyond "end".
 */
#include "speedups.h"

typedef struct {
    State *state;
    const uint8_t *data;
    size_t position, end; /* next byte; end of the argument */
    const Limits *limits;
    bool exact;
    long long left; /* elements that may still be read */
} Reader;

static Outcome read_value(Reader *reader, unsigned vt, uint32_t count, long long depth, PyObject **value);

/* --- limits -------------------------------------------------------------------------------------------------------- */

#define LEAST -(1LL << 60) /* least limit or budget: room for subtractions */

static bool read_limit(State *state, PyObject *limits, Attribute name, long long *number)
{
    PyObject *found = get_attribute(state, limits, name);
    int overflow = 1;
    if (found != NULL && PyLong_CheckExact(found))
        *number = PyLong_AsLongLongAndOverflow(found, &overflow);
    Py_XDECREF(found);
    PyErr_Clear();
    return !overflow && *number > LEAST;
}

HOT Outcome read_limits(State *state, PyObject *limits, Limits *found)
{
    if (limits != NULL && limits == state->seen_limits) {
        *found = state->limits;
        return DONE;
    }
    if (limits == NULL || (PyObject *)Py_TYPE(limits) != state->limits_type)
        return UNUSUAL;
    bool usual = read_limit(state, limits, A_PACKET, &found->packet) && read_limit(state, limits, A_DEPTH, &found->depth) &&
                 read_limit(state, limits, A_VARIANTS, &found->variants) &&
                 read_limit(state, limits, A_VT_ERROR_SIZE, &found->error_size);
    if (!usual || (found->error_size != 2 && found->error_size != 4))
        return UNUSUAL;
    state->limits = *found; /* the object is frozen */
    Py_XSETREF(state->seen_limits, Py_NewRef(limits));
    return DONE;
}

static Outcome spend(Reader *reader, uint32_t count)
{
    reader->left -= count;
    return reader->left < 0 ? UNUSUAL : DONE;
}

/* --- lists --------------------------------------------------------------------------------------------------------- */

/* Return a list with room for its elements. Until finish_list(), gc.get_objects() does not return the list: Python code
 * that runs meanwhile would crash if it read an element that is missing. */
HOT static PyObject *begin_list(uint32_t count)
{
    PyObject *items = PyList_New(count);
    if (items != NULL)
        PyObject_GC_UnTrack(items);
    return items;
}

/* Return the list if it is complete; otherwise release it. */
HOT static Outcome finish_list(PyObject *items, Outcome outcome, PyObject **value)
{
    if (outcome == DONE)
        PyObject_GC_Track(items);
    else
        Py_CLEAR(items);
    *value = items;
    return outcome;
}

typedef Outcome (*ReadItem)(Reader *reader, long long depth, PyObject **item);

/* Read elements that differ in size, each at least "least" bytes. */
static Outcome read_list(Reader *reader, uint32_t count, size_t least, ReadItem read, long long depth, PyObject **value)
{
    if (least * (uint64_t)count > reader->end - reader->position)
        return UNUSUAL;
    PyObject *items = begin_list(count);
    Outcome outcome = items == NULL ? FAILED : DONE;
    for (uint32_t i = 0; outcome == DONE && i < count; i++) {
        PyObject *item = NULL;
        outcome = read(reader, depth, &item);
        if (outcome == DONE)
            PyList_SET_ITEM(items, i, item);
    }
    return finish_list(items, outcome, value);
}

/* --- elements of a fixed size -------------------------------------------------------------------------------------- */

static PyObject *converted(PyObject *convert, PyObject *number)
{
    PyObject *value = number == NULL ? NULL : PyObject_CallOneArg(convert, number);
    Py_XDECREF(number);
    return value;
}

static PyObject *integer_at(int base, const uint8_t *at, int size)
{
    int64_t number = 0;
    memcpy(&number, at, (size_t)size);
    switch (base) {
    case VT_I2:
        return PyLong_FromLong((int16_t)number);
    case VT_I4:
        return PyLong_FromLong((int32_t)number);
    case VT_I1:
        return PyLong_FromLong((int8_t)number);
    case VT_UI8:
        return PyLong_FromUnsignedLongLong((uint64_t)number);
    default: /* unsigned types, whose upper bytes are 0, and 64 bits */
        return PyLong_FromLongLong(number);
    }
}

HOT static PyObject *double_at(const uint8_t *at)
{
    double number;
    memcpy(&number, at, sizeof number);
    return PyFloat_FromDouble(number);
}

static PyObject *single_at(const uint8_t *at)
{
    double number = PyFloat_Unpack4((const char *)at, 1);
    return number == -1.0 && PyErr_Occurred() ? NULL : PyFloat_FromDouble(number);
}

HOT static PyObject *item_from(const Reader *reader, int base, const uint8_t *at, int size)
{
    switch (base) {
    case VT_R8:
        return double_at(at);
    case VT_R4:
        return single_at(at);
    case VT_BOOL:
        return PyBool_FromLong(load_u16(at));
    case VT_CY:
        return converted(reader->state->amount_from_wire, integer_at(VT_I8, at, 8));
    case VT_DATE:
        return converted(reader->exact ? reader->state->date_from_wire_exact : reader->state->date_from_wire, double_at(at));
    default:
        return integer_at(base, at, size);
    }
}

/* Like list_from(), for doubles: no other code of Python runs before the list is complete. */
HOT static Outcome doubles_from(const uint8_t *at, uint32_t count, PyObject **value)
{
    *value = PyList_New(count);
    for (uint32_t i = 0; *value != NULL && i < count; i++, at += 8) {
        PyObject *item = double_at(at);
        if (item == NULL)
            Py_CLEAR(*value);
        else
            PyList_SET_ITEM(*value, i, item);
    }
    return *value == NULL ? FAILED : DONE;
}

static Outcome list_from(const Reader *reader, int base, const uint8_t *at, uint32_t count, int size, PyObject **value)
{
    PyObject *items = begin_list(count);
    Outcome outcome = items == NULL ? FAILED : DONE;
    for (uint32_t i = 0; outcome == DONE && i < count; i++, at += size) {
        PyObject *item = item_from(reader, base, at, size);
        if (item == NULL)
            outcome = FAILED;
        else
            PyList_SET_ITEM(items, i, item);
    }
    return finish_list(items, outcome, value);
}

HOT static Outcome read_fixed(Reader *reader, int base, bool array, uint32_t count, PyObject **value)
{
    int size = base == VT_ERROR ? (int)reader->limits->error_size : FIXED[base].size;
    if ((uint64_t)count * (unsigned)size > reader->end - reader->position)
        return UNUSUAL;
    if (spend(reader, FIXED[base].per_unit ? count / FIXED[base].per_unit : 0) != DONE)
        return UNUSUAL;
    const uint8_t *at = reader->data + reader->position;
    reader->position += (size_t)count * (size_t)size;
    if (array && base == VT_R8)
        return doubles_from(at, count, value);
    if (array && base != VT_UI1)
        return list_from(reader, base, at, count, size, value);
    *value = array ? PyBytes_FromStringAndSize((const char *)at, count) : item_from(reader, base, at, size);
    return *value == NULL ? FAILED : DONE;
}

/* --- texts --------------------------------------------------------------------------------------------------------- */

static Outcome read_text(Reader *reader, long long depth, PyObject **value)
{
    (void)depth;
    if (reader->end - reader->position < 4)
        return UNUSUAL;
    size_t size = load_u32(reader->data + reader->position);
    if (size > reader->end - reader->position - 4 || size % 2)
        return UNUSUAL;
    int little_endian = -1; /* and a byte order mark is a character */
    *value = PyUnicode_DecodeUTF16((const char *)reader->data + reader->position + 4, (Py_ssize_t)size, "surrogatepass",
                                   &little_endian);
    reader->position += 4 + size;
    return *value == NULL ? FAILED : DONE;
}

/* --- Variant objects and arrays of VARIANTs ------------------------------------------------------------------------ */

/* Set an attribute like object.__setattr__: a Variant is frozen. */
static int set_frozen(PyObject *object, PyObject *name, PyObject *value) { return PyObject_GenericSetAttr(object, name, value); }

/* Return a Variant without checking its value, like trusted() in Python; the reference to the value is consumed. */
static PyObject *trusted(State *state, unsigned vt, PyObject *value)
{
    PyTypeObject *type = (PyTypeObject *)state->variant_type;
    PyObject *number = PyLong_FromLong((long)vt);
    PyObject *variant = number == NULL ? NULL : type->tp_alloc(type, 0);
    if (variant != NULL &&
        (set_frozen(variant, state->names[A_TYPE], number) < 0 || set_frozen(variant, state->names[A_VALUE], value) < 0))
        Py_CLEAR(variant);
    Py_XDECREF(number);
    Py_DECREF(value);
    return variant;
}

static Outcome read_element(Reader *reader, long long depth, PyObject **value)
{
    if (reader->end - reader->position < ELEMENT_HEAD)
        return UNUSUAL;
    const uint8_t *head = reader->data + reader->position;
    unsigned vt = load_u16(head);
    reader->position += ELEMENT_HEAD;
    Outcome outcome = read_value(reader, vt, load_u32(head + 2), depth, value);
    if (outcome != DONE || !reader->exact)
        return outcome;
    *value = trusted(reader->state, vt, *value);
    return *value == NULL ? FAILED : DONE;
}

static Outcome read_variants(Reader *reader, uint32_t count, long long depth, PyObject **value)
{
    if (depth >= reader->limits->depth || depth >= MOST_DEPTH || spend(reader, count) != DONE)
        return UNUSUAL;
    return read_list(reader, count, ELEMENT_HEAD, read_element, depth + 1, value);
}

/* Read the data of a value: count elements of a type. */
HOT static Outcome read_value(Reader *reader, unsigned vt, uint32_t count, long long depth, PyObject **value)
{
    unsigned base = vt & ~(unsigned)VT_ARRAY;
    bool array = vt & VT_ARRAY;
    if (base >= VT_TYPES || (!array && count != 1))
        return UNUSUAL;
    if (FIXED[base].size)
        return read_fixed(reader, (int)base, array, count, value);
    if (base == VT_BSTR) {
        if (spend(reader, count) != DONE)
            return UNUSUAL;
        return array ? read_list(reader, count, 4, read_text, depth, value) : read_text(reader, depth, value);
    }
    if (base == VT_VARIANT && array)
        return read_variants(reader, count, depth, value);
    if ((base == VT_EMPTY || base == VT_NULL) && !array) {
        *value = Py_NewRef(Py_None);
        return DONE;
    }
    return UNUSUAL;
}

HOT Outcome read_argument(State *state, const uint8_t *data, size_t position, size_t end, const Limits *limits, bool exact,
                      long long *budget, PyObject **value, size_t *stop)
{
    if (position > end || end - position < ARGUMENT_HEAD)
        return UNUSUAL;
    const uint8_t *head = data + position;
    uint32_t length = load_u32(head), count = load_u32(head + 6);
    unsigned vt = load_u16(head + 4);
    if (length < ELEMENT_HEAD || length > MOST_BYTES || length > end - position - 4 || length > limits->packet)
        return UNUSUAL;
    *stop = position + 4 + length;
    Reader reader = {state, data, position + ARGUMENT_HEAD, *stop, limits, exact, *budget};
    if (vt == (VT_R8 | VT_ARRAY) && !exact && length == ELEMENT_HEAD + 8 * (uint64_t)count)
        return doubles_from(head + ARGUMENT_HEAD, count, value); /* set-points: they do not count */
    Outcome outcome = read_value(&reader, vt, count, 0, value);
    if (outcome != DONE)
        return outcome;
    *budget = reader.left;
    if (reader.position != *stop) {
        Py_CLEAR(*value);
        return UNUSUAL;
    }
    if (exact)
        *value = trusted(state, vt, *value);
    return *value == NULL ? FAILED : DONE;
}

/* --- the function for Python --------------------------------------------------------------------------------------- */

typedef struct {
    PyObject *data, *position, *end, *limits, *exact, *budget;
} Arguments;

/* Assign the arguments to the parameters; return false if they do not match, which Python then reports. */
static bool assign(PyObject *const *arguments, Py_ssize_t count, PyObject *names, Arguments *found)
{
    static const char *const NAMES[] = {"data", "position", "end", "limits", "exact", "budget"};
    PyObject **parameters[] = {&found->data, &found->position, &found->end, &found->limits, &found->exact, &found->budget};
    if (count < 1 || count > 4)
        return false;
    for (Py_ssize_t i = 0; i < count; i++)
        *parameters[i] = arguments[i];
    Py_ssize_t named = names == NULL ? 0 : PyTuple_GET_SIZE(names);
    for (Py_ssize_t i = 0; i < named; i++) {
        int number = 5;
        while (number >= 0 && PyUnicode_CompareWithASCIIString(PyTuple_GET_ITEM(names, i), NAMES[number]) != 0)
            number--;
        if (number < 0 || *parameters[number] != NULL)
            return false;
        *parameters[number] = arguments[count + i];
    }
    return true;
}

/* Read a position within the data. */
static bool read_position(PyObject *number, size_t most, size_t *position)
{
    int overflow;
    if (!PyLong_CheckExact(number))
        return false;
    long long found = PyLong_AsLongLongAndOverflow(number, &overflow);
    *position = (size_t)found;
    return !overflow && found >= 0 && (unsigned long long)found <= most;
}

static bool read_budget(PyObject *budget, long long *left)
{
    int overflow;
    if (!PyList_CheckExact(budget) || PyList_GET_SIZE(budget) != 1 || !PyLong_CheckExact(PyList_GET_ITEM(budget, 0)))
        return false;
    *left = PyLong_AsLongLongAndOverflow(PyList_GET_ITEM(budget, 0), &overflow);
    return !overflow && *left > LEAST;
}

static Outcome decode_found(State *state, const Arguments *found, PyObject **value, size_t *stop, long long *left)
{
    if (!PyBytes_CheckExact(found->data))
        return UNUSUAL;
    size_t size = (size_t)PyBytes_GET_SIZE(found->data), position = 0, end = size;
    Limits limits;
    if ((found->position != NULL && !read_position(found->position, size, &position)) ||
        (found->end != NULL && found->end != Py_None && !read_position(found->end, size, &end)) ||
        (found->exact != NULL && !PyBool_Check(found->exact)))
        return UNUSUAL;
    if (read_limits(state, found->limits, &limits) != DONE)
        return UNUSUAL;
    *left = limits.variants;
    if (found->budget != NULL && found->budget != Py_None && !read_budget(found->budget, left))
        return UNUSUAL;
    return read_argument(state, (const uint8_t *)PyBytes_AS_STRING(found->data), position, end, &limits,
                         found->exact == Py_True, left, value, stop);
}

/* Return a tuple; the references are consumed. One that is NULL, with an exception, is a failure. */
HOT PyObject *new_pair(PyObject *first, PyObject *second)
{
    PyObject *result = first == NULL || second == NULL ? NULL : PyTuple_New(2);
    if (result == NULL) {
        Py_XDECREF(first);
        Py_XDECREF(second);
        return NULL;
    }
    PyTuple_SET_ITEM(result, 0, first);
    PyTuple_SET_ITEM(result, 1, second);
    return result;
}

/* Store what is left of the budget; false if the list was changed meanwhile or an exception is set. */
static bool store_budget(PyObject *budget, long long left)
{
    PyObject *number = PyLong_FromLongLong(left);
    return number != NULL && PyList_SetItem(budget, 0, number) == 0;
}

PyObject *decode(PyObject *module, PyObject *const *arguments, Py_ssize_t count, PyObject *names)
{
    State *state = state_of(module);
    Arguments found = {0};
    PyObject *value = NULL;
    size_t stop = 0;
    long long left = 0;
    Outcome outcome = UNUSUAL;
    if (assign(arguments, count, names, &found)) {
        if (found.limits == NULL)
            found.limits = state->default_limits;
        outcome = decode_found(state, &found, &value, &stop, &left);
    }
    if (outcome == FAILED)
        return NULL;
    if (outcome == UNUSUAL)
        return in_python(state, DECODE, arguments, count, names);
    if (found.budget != NULL && found.budget != Py_None && !store_budget(found.budget, left)) {
        Py_DECREF(value);
        return NULL;
    }
    return new_pair(value, PyLong_FromSize_t(stop));
}
