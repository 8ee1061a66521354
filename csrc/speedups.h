/* The optional extension: codec of VARIANTs, packets of requests, and the exchange of one call.
 *
 * The code here contains only the frequent and successful case. For everything else a function reports UNUSUAL, and the
 * Python function of the same name does the work from the beginning. Errors, limits and rare types thus have one
 * definition, in Python.
 */
#ifndef ORINKIT_SPEEDUPS_H
#define ORINKIT_SPEEDUPS_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#if !PY_LITTLE_ENDIAN
#error "packets are little-endian, and this code copies them: use the pure package"
#endif

/* The number of the interface between this module and the modules in Python, which INTERFACE in orinkit/core/speedups.py
 * repeats. After a change of a function, of its arguments, or of an attribute that is read here, increase both. */
#define INTERFACE 4

/* The functions of a call, which the linker puts side by side, so that they occupy few pages. */
#ifdef __GNUC__
#define HOT __attribute__((hot))
#define COLD __attribute__((cold, noinline))
#else
#define HOT
#define COLD
#endif

/* Result of the internal functions; FAILED means that a Python exception is set. */
typedef enum { FAILED = -1, UNUSUAL = 0, DONE = 1 } Outcome;

enum {
    VT_EMPTY = 0, VT_NULL = 1, VT_I2 = 2, VT_I4 = 3, VT_R4 = 4, VT_R8 = 5, VT_CY = 6, VT_DATE = 7, VT_BSTR = 8,
    VT_ERROR = 10, VT_BOOL = 11, VT_VARIANT = 12, VT_I1 = 16, VT_UI1 = 17, VT_UI2 = 18, VT_UI4 = 19, VT_I8 = 20,
    VT_UI8 = 21, VT_TYPES = 22, VT_ARRAY = 0x2000
};

/* Larger values are left to Python, which converts them in slices, so that other threads run meanwhile. */
#define MOST_BYTES 16384
/* Deeper arrays are left to Python, so that the C stack cannot overflow. */
#define MOST_DEPTH 32
#define ARGUMENT_HEAD 10 /* length u32, type u16, count u32 */
#define ELEMENT_HEAD 6   /* type u16, count u32 */
#define PACKET_HEAD 15   /* SOH, length u32, serial u16, reserved u16, function or return code u32, count u16 */
#define PACKET_LEAST 16

typedef struct {
    unsigned char size;     /* bytes of one element; 0 if the type has no fixed size */
    unsigned char per_unit; /* elements that count as one towards PacketLimits.variants; 0: they do not count */
} FixedType;

extern const FixedType FIXED[VT_TYPES];

typedef struct {
    long long packet, depth, variants, error_size;
} Limits;

typedef enum {
    ENCODE, ENCODE_VARIANT, ENCODE_INTEGER, ENCODE_STRING, ENCODE_SINGLE, DECODE, ENCODE_REQUEST, CALL, CALL_PREPARED,
    CALL_PREPARED_BY_CLIENT,
    FUNCTIONS
} FunctionNumber;

/* Attributes and methods of Python objects; ATTRIBUTE_NAMES in attributes.c contains their names. */
typedef enum {
    A_ID, A_TYPE, A_VALUE, A_PACKET, A_DEPTH, A_VARIANTS, A_VT_ERROR_SIZE,
    A_SERIAL, A_LIMITS, A_BEGIN, A_FINISH, A_RESULT, A_NATIVE, A_DESCRIPTOR, A_KERNEL_SECONDS, A_USE_KERNEL_TIMEOUT,
    A_FINISH_EXCHANGE, A_FAIL,
    A_CONVERSATION, A_DEADLINE, A_END, A_TIMEOUT, A_LINK, A_LOCK, A_FUNCTION, A_DIRECT, A_ACQUIRE, A_RELEASE,
    A_ARGUMENTS, A_RESUME, A_FAILED,
    ATTRIBUTES
} Attribute;

typedef struct {
    Limits limits;                  /* the values of seen_limits */
    Py_ssize_t offsets[ATTRIBUTES]; /* of the slots in objects of the types in "owners" */
    /* From here to the end, there are only references. */
    PyObject *fallback[FUNCTIONS]; /* the Python functions */
    PyObject *seen_limits;         /* the frozen object that was read last */
    /* objects of orinkit.values, passed to set_codec() */
    PyObject *variant_type, *limits_type, *default_limits;
    PyObject *amount_to_wire, *date_to_wire, *amount_from_wire, *date_from_wire, *date_from_wire_exact;
    /* objects of orinkit.transport.direct and orinkit.values.types, passed to set_exchange() */
    PyObject *unfinished, *result_variant, *result_integer, *result_string;
    PyObject *argument_types; /* dict of orinkit.bcap.requests, passed to set_requests() */
    PyObject *lock_type, *lock_acquire, *lock_release; /* the type of the lock of a client, and its methods */
    PyObject *names[ATTRIBUTES];
    PyObject *owners[ATTRIBUTES]; /* for an attribute with a slot, the type of the object that was read last */
} State;

static inline State *state_of(PyObject *module) { return (State *)PyModule_GetState(module); }
/* Call the Python function. */
PyObject *in_python(State *state, FunctionNumber number, PyObject *const *arguments, Py_ssize_t count, PyObject *names);

/* --- attributes ---------------------------------------------------------------------------------------------------- */

int set_names(State *state);
/* Return an attribute. A read from a slot (__slots__) touches nothing but the object: a lookup by name touches the type
 * and the cache of methods, too, which takes longer than everything else if the program has slept for some ms. */
PyObject *get_attribute(State *state, PyObject *object, Attribute number);
Outcome set_attribute(State *state, PyObject *object, Attribute number, PyObject *value);

/* --- bytes that are being written: at most MOST_BYTES -------------------------------------------------------------- */

typedef struct {
    uint8_t *start;
    size_t size, room;
    uint8_t small[512]; /* enough for most values, without an allocation */
} Writer;

void writer_begin(Writer *writer);
void writer_end(Writer *writer);
Outcome writer_reserve(Writer *writer, size_t count); /* afterwards, writer->start + writer->size has room for count */
Outcome writer_add(Writer *writer, const void *bytes, size_t count);

static inline uint16_t load_u16(const uint8_t *at) { uint16_t n; memcpy(&n, at, sizeof n); return n; }
static inline uint32_t load_u32(const uint8_t *at) { uint32_t n; memcpy(&n, at, sizeof n); return n; }
static inline void store_u16(uint8_t *at, uint16_t number) { memcpy(at, &number, sizeof number); }
static inline void store_u32(uint8_t *at, uint32_t number) { memcpy(at, &number, sizeof number); }

/* --- codec --------------------------------------------------------------------------------------------------------- */

/* Append type, count and data of a value; with plain, refuse Variant objects anywhere in the value. */
Outcome put_value(State *state, Writer *writer, PyObject *value, bool plain, int depth);
/* Append type, count and data of a value of a simple type. */
Outcome put_plain(State *state, Writer *writer, int base, PyObject *value);
/* Fill in the length of an argument that was appended behind four free bytes at start. */
void put_length(Writer *writer, size_t start);

Outcome read_limits(State *state, PyObject *limits, Limits *found);
/* Read one argument; *stop is the position after it. */
Outcome read_argument(State *state, const uint8_t *data, size_t position, size_t end, const Limits *limits, bool exact,
                      long long *budget, PyObject **value, size_t *stop);
PyObject *new_pair(PyObject *first, PyObject *second);

PyObject *encode(PyObject *module, PyObject *value);
PyObject *encode_variant(PyObject *module, PyObject *const *arguments, Py_ssize_t count, PyObject *names);
PyObject *encode_integer(PyObject *module, PyObject *value);
PyObject *encode_string(PyObject *module, PyObject *value);
PyObject *encode_single(PyObject *module, PyObject *value);
PyObject *decode(PyObject *module, PyObject *const *arguments, Py_ssize_t count, PyObject *names);

/* --- requests ------------------------------------------------------------------------------------------------------ */

typedef enum { ANY_RESULT, NO_RESULT, INTEGER_RESULT, STRING_RESULT, OTHER_RESULT } ResultKind;

/* The constant part of the packets of a prepared call. */
typedef struct {
    ResultKind result;
    long most;       /* largest size of a packet */
    bool varies;     /* there is a varying argument */
    size_t size;     /* bytes of start */
    uint8_t start[]; /* header and constant arguments; length and serial are filled in for each call */
} Template;

/* Return the kind of the result of a function; -1 with an exception. */
int result_kind(State *state, PyObject *function);
/* Return the template in an object of native_template(); NULL for another object. */
const Template *template_in(PyObject *capsule);
/* Write the packet of a call. UNUSUAL: the Python code converts the value, for example a pose, or reports its error. */
Outcome put_prepared(State *state, const Template *template, PyObject *value, uint16_t serial, Writer *writer);

PyObject *encode_request(PyObject *module, PyObject *const *arguments, Py_ssize_t count, PyObject *names);
PyObject *native_template(PyObject *module, PyObject *arguments);
PyObject *native_request(PyObject *module, PyObject *const *arguments, Py_ssize_t count);

/* --- exchange ------------------------------------------------------------------------------------------------------ */

#ifdef __linux__ /* elsewhere, the time-out of sockets and the clock of Python are others */
#define WITH_EXCHANGE 1
/* What a prepared call requires, and its outcome; the references in the first lines are borrowed. */
typedef struct {
    PyObject *conversation, *link, *seconds, *value, *prepared;
    PyObject *function; /* NULL: the one of prepared */
    const Template *template;
    uint32_t code;    /* the return code */
    PyObject *result; /* the result of the function */
    PyObject *other;  /* what call_prepared() returns if the reply is unusual */
} PreparedCall;

/* Make a prepared call. UNUSUAL: "other" is set, or nothing was sent, and Python makes the call. */
Outcome exchange_prepared(State *state, PreparedCall *call);

PyObject *set_timeout(PyObject *module, PyObject *arguments);
PyObject *call(PyObject *module, PyObject *const *arguments, Py_ssize_t count);
PyObject *call_prepared(PyObject *module, PyObject *const *arguments, Py_ssize_t count);
PyObject *call_prepared_by_client(PyObject *module, PyObject *const *arguments, Py_ssize_t count);
#endif

#endif
