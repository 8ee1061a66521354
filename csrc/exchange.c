/* The exchange of one call over a stream socket: see orinkit/transport/direct.py.
 *
 * The socket is in blocking mode with a time-out of the system, so that a call takes two system calls: send and recv.
 */
#include "speedups.h"

#ifdef WITH_EXCHANGE
#include <errno.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <time.h>

#define RECEIVED_MOST 8192 /* a larger reply is continued in Python */
#define S_EXECUTING 0x900
#define FAILURE 0x80000000

/* --- time ---------------------------------------------------------------------------------------------------------- */

/* The clock of time.monotonic(). */
static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

/* set_timeout(descriptor, seconds): set the time-out of a socket in blocking mode for receiving. */
PyObject *set_timeout(PyObject *module, PyObject *arguments)
{
    (void)module;
    int descriptor;
    double seconds;
    if (!PyArg_ParseTuple(arguments, "id:set_timeout", &descriptor, &seconds))
        return NULL;
    seconds = seconds > 1e8 ? 1e8 : seconds >= 1e-6 ? seconds : 1e-6; /* 0 would mean no limit */
    struct timeval limit = {.tv_sec = (time_t)seconds};
    limit.tv_usec = (suseconds_t)((seconds - (double)limit.tv_sec) * 1e6);
    if (setsockopt(descriptor, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit) < 0)
        return PyErr_SetFromErrno(PyExc_OSError);
    Py_RETURN_NONE;
}

/* --- system calls -------------------------------------------------------------------------------------------------- */

typedef struct {
    PyObject *conversation, *link, *function, *seconds; /* borrowed */
    double end;         /* of the wait for the reply */
    int descriptor;
    const uint8_t *request;
    size_t size;
    ssize_t sent, received; /* as the system calls return them */
    int error;
    uint8_t reply[RECEIVED_MOST];
} Exchange;

static Outcome read_number(State *state, PyObject *object, Attribute name, long low, long high, long *number)
{
    PyObject *found = get_attribute(state, object, name);
    if (found == NULL)
        return FAILED;
    *number = PyLong_AsLong(found);
    Py_DECREF(found);
    if (*number == -1 && PyErr_Occurred())
        return FAILED;
    return *number < low || *number > high ? UNUSUAL : DONE;
}

/* Read the descriptor as late as possible: it is -1 after another thread has closed the link. */
static Outcome read_descriptor(State *state, Exchange *exchange)
{
    long descriptor = -1;
    Outcome outcome = read_number(state, exchange->link, A_DESCRIPTOR, -1, INT32_MAX, &descriptor);
    exchange->descriptor = outcome == DONE ? (int)descriptor : -1;
    return outcome == FAILED ? FAILED : DONE;
}

/* Send and receive, without Python. The send does not wait for a peer that does not read: Python sends the rest. */
static void transfer(Exchange *exchange)
{
    exchange->received = -1;
    exchange->sent = send(exchange->descriptor, exchange->request, exchange->size, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (exchange->sent == (ssize_t)exchange->size)
        exchange->received = recv(exchange->descriptor, exchange->reply, RECEIVED_MOST, 0);
    exchange->error = errno;
}

/* Wait for data, at most until the end. */
static bool wait_until_end(const Exchange *exchange)
{
    double left = exchange->end - now();
    struct pollfd waiting = {.fd = exchange->descriptor, .events = POLLIN};
    int milliseconds = left <= 0 ? 0 : left > 1e6 ? 1000000000 : (int)(left * 1e3) + 1;
    return poll(&waiting, 1, milliseconds) > 0;
}

/* Continue an interrupted wait: a signal neither prolongs the wait nor is its handler delayed. During the wait, another
 * thread may close the link, and its descriptor may then belong to another file. Therefore the descriptor is read again
 * before it is used, and the GIL is held in between. */
static Outcome continue_wait(State *state, Exchange *exchange)
{
    bool ready = false;
    if (PyErr_CheckSignals() < 0 || read_descriptor(state, exchange) != DONE)
        return FAILED;
    if (exchange->descriptor >= 0) {
        Py_BEGIN_ALLOW_THREADS
        ready = wait_until_end(exchange);
        Py_END_ALLOW_THREADS
        if (read_descriptor(state, exchange) != DONE)
            return FAILED;
    }
    exchange->error = EAGAIN;
    if (ready || exchange->descriptor < 0) {
        exchange->received = recv(exchange->descriptor, exchange->reply, RECEIVED_MOST, MSG_DONTWAIT);
        exchange->error = errno;
    }
    return DONE;
}

/* Make the transfer. UNUSUAL: the request was not sent completely. */
static Outcome run_transfer(State *state, Exchange *exchange)
{
    Outcome outcome = DONE;
    Py_BEGIN_ALLOW_THREADS
    transfer(exchange);
    Py_END_ALLOW_THREADS
    if (exchange->sent != (ssize_t)exchange->size)
        return UNUSUAL;
    while (outcome == DONE && exchange->received < 0 &&
           (exchange->error == EINTR || (exchange->error == EAGAIN && now() < exchange->end)))
        outcome = continue_wait(state, exchange);
    return outcome;
}

/* Call a method of the link that returns nothing. */
static Outcome call_link(const Exchange *exchange, PyObject *name, PyObject *argument)
{
    PyObject *nothing = PyObject_CallMethodOneArg(exchange->link, name, argument);
    Py_XDECREF(nothing);
    return nothing == NULL ? FAILED : DONE;
}

/* Let the link raise the exception for an error of the system, or for the end of a stream that this program closed;
 * return normally if the peer has closed the connection. */
static Outcome report(State *state, Exchange *exchange, int error)
{
    if (!error)
        return call_link(exchange, state->names[A_FAIL], Py_None);
    PyObject *text = PyUnicode_DecodeLocale(strerror(error), "surrogateescape");
    PyObject *reason = text == NULL ? NULL : PyObject_CallFunction(PyExc_OSError, "iO", error, text);
    Outcome outcome = reason == NULL ? FAILED : call_link(exchange, state->names[A_FAIL], reason);
    Py_XDECREF(text);
    Py_XDECREF(reason);
    return outcome;
}

/* Let the link send the rest of the request and receive; return what it received. */
static PyObject *continue_in_python(State *state, Exchange *exchange)
{
    Py_ssize_t sent = exchange->sent < 0 ? 0 : (Py_ssize_t)exchange->sent;
    PyObject *request = PyBytes_FromStringAndSize((const char *)exchange->request, (Py_ssize_t)exchange->size);
    PyObject *start = PyLong_FromSsize_t(sent);
    PyObject *received = NULL;
    if (request != NULL && start != NULL)
        received = PyObject_CallMethodObjArgs(exchange->link, state->names[A_FINISH_EXCHANGE], request, exchange->seconds, start, NULL);
    Py_XDECREF(request);
    Py_XDECREF(start);
    return received;
}

/* --- reply --------------------------------------------------------------------------------------------------------- */

static Outcome read_conversation_limits(State *state, const Exchange *exchange, Limits *limits)
{
    PyObject *object = get_attribute(state, exchange->conversation, A_LIMITS);
    if (object == NULL)
        return FAILED;
    Outcome outcome = read_limits(state, object, limits);
    Py_DECREF(object);
    return outcome;
}

/* Read the result of the call. UNUSUAL: Python reads it, or reports the error. */
static Outcome read_result(State *state, Exchange *exchange, const Limits *limits, bool exact, PyObject **value)
{
    PyObject *kind = get_attribute(state, exchange->function, A_RESULT);
    if (kind == NULL)
        return FAILED;
    Py_DECREF(kind); /* the table of functions keeps it */
    if (kind == Py_None) {
        *value = Py_NewRef(Py_None);
        return DONE;
    }
    if (load_u16(exchange->reply + 13) == 0 || exact)
        return UNUSUAL;
    long long budget = limits->variants;
    size_t stop;
    Outcome outcome = read_argument(state, exchange->reply, PACKET_HEAD, (size_t)exchange->received - 1, limits, false,
                                    &budget, value, &stop);
    if (outcome != DONE)
        return outcome;
    if (kind == state->result_variant || (kind == state->result_integer && PyLong_CheckExact(*value)) ||
        (kind == state->result_string && PyUnicode_CheckExact(*value)))
        return DONE;
    Py_CLEAR(*value);
    return UNUSUAL;
}

/* Read a reply that is exactly one packet with the serial and a success code, within the limits. */
static Outcome read_reply(State *state, Exchange *exchange, uint16_t serial, bool exact, uint32_t *code, PyObject **value)
{
    const uint8_t *reply = exchange->reply;
    ssize_t size = exchange->received;
    if (size < PACKET_LEAST || reply[0] != 0x01 || reply[size - 1] != 0x04 || load_u32(reply + 1) != (size_t)size ||
        load_u16(reply + 5) != serial)
        return UNUSUAL;
    *code = load_u32(reply + 9);
    if (*code == S_EXECUTING || *code >= FAILURE)
        return UNUSUAL;
    Limits limits;
    Outcome outcome = read_conversation_limits(state, exchange, &limits);
    if (outcome != DONE)
        return outcome;
    return size > limits.packet ? UNUSUAL : read_result(state, exchange, &limits, exact, value);
}

/* Let the conversation examine what was received; the reference to it is consumed. If it is not the reply, return
 * Unfinished. */
static PyObject *finish_in_python(State *state, Exchange *exchange, uint16_t serial, PyObject *exact, PyObject *received)
{
    PyObject *number = PyLong_FromLong(serial), *result = NULL;
    if (number != NULL)
        result = PyObject_CallMethodObjArgs(exchange->conversation, state->names[A_FINISH], exchange->function, number, received,
                                            exact, NULL);
    if (result == Py_None) {
        Py_DECREF(result);
        result = PyObject_CallFunction(state->unfinished, "OOd", number, received, exchange->end);
    }
    Py_XDECREF(number);
    Py_DECREF(received);
    return result;
}

/* Send the request, receive, and return the outcome of the call. */
static PyObject *perform(State *state, Exchange *exchange, uint16_t serial, PyObject *exact)
{
    PyObject *value = NULL, *received;
    uint32_t code = 0;
    exchange->end = now() + PyFloat_AS_DOUBLE(exchange->seconds);
    Outcome outcome = run_transfer(state, exchange);
    if (outcome == FAILED)
        return NULL;
    if (outcome == UNUSUAL) {
        if (exchange->sent < 0 && exchange->error != EAGAIN && exchange->error != EINTR &&
            report(state, exchange, exchange->error) != DONE)
            return NULL;
        received = continue_in_python(state, exchange);
        return received == NULL ? NULL : finish_in_python(state, exchange, serial, exact, received);
    }
    if (exchange->received > 0) {
        outcome = read_reply(state, exchange, serial, exact == Py_True, &code, &value);
        if (outcome != UNUSUAL)
            return outcome == DONE ? new_pair(PyLong_FromUnsignedLong(code), value) : NULL;
    } else if (exchange->received == 0 || exchange->error != EAGAIN) {
        if (report(state, exchange, exchange->received < 0 ? exchange->error : 0) != DONE)
            return NULL;
    }
    received = exchange->received < 0
                   ? Py_NewRef(Py_None)
                   : PyBytes_FromStringAndSize((const char *)exchange->reply, (Py_ssize_t)exchange->received);
    return received == NULL ? NULL : finish_in_python(state, exchange, serial, exact, received);
}

/* --- functions for Python ------------------------------------------------------------------------------------------ */

/* Fill in the parts of an exchange, and prepare the socket. UNUSUAL: the link has no socket for this. */
static Outcome prepare(State *state, Exchange *exchange, PyObject *const *arguments, PyObject *seconds)
{
    exchange->conversation = arguments[0];
    exchange->link = arguments[1];
    exchange->function = arguments[2];
    exchange->seconds = seconds;
    if (!PyFloat_CheckExact(seconds))
        return UNUSUAL;
    PyObject *set = get_attribute(state, exchange->link, A_KERNEL_SECONDS);
    if (set == NULL) {
        if (!PyErr_ExceptionMatches(PyExc_AttributeError))
            return FAILED;
        PyErr_Clear();
        return UNUSUAL;
    }
    bool equal = PyFloat_CheckExact(set) && PyFloat_AS_DOUBLE(set) == PyFloat_AS_DOUBLE(seconds);
    Py_DECREF(set);
    return equal ? DONE : call_link(exchange, state->names[A_USE_KERNEL_TIMEOUT], seconds);
}

static Outcome use_serial(State *state, Exchange *exchange, long serial)
{
    PyObject *next = PyLong_FromLong(serial % 0xFFFF + 1);
    Outcome outcome = next == NULL ? FAILED : set_attribute(state, exchange->conversation, A_SERIAL, next);
    Py_XDECREF(next);
    return outcome;
}

static const Template *template_of(State *state, PyObject *object)
{
    PyObject *capsule = get_attribute(state, object, A_NATIVE);
    if (capsule == NULL)
        return NULL;
    const Template *template = template_in(capsule);
    Py_DECREF(capsule); /* the RequestTemplate keeps it */
    return template;
}

/* call(conversation, link, function, arguments, seconds, exact) */
PyObject *call(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    State *state = state_of(module);
    Exchange exchange;
    bool usual = count == 6 && PyBool_Check(arguments[5]);
    Outcome outcome = usual ? prepare(state, &exchange, arguments, arguments[4]) : UNUSUAL;
    if (outcome != DONE)
        return outcome == FAILED ? NULL : in_python(state, CALL, arguments, count, NULL);
    PyObject *begun = PyObject_CallMethodObjArgs(exchange.conversation, state->names[A_BEGIN], arguments[2], arguments[3], NULL);
    unsigned short serial;
    PyObject *request, *result = NULL;
    if (begun != NULL && PyArg_ParseTuple(begun, "HS", &serial, &request) && read_descriptor(state, &exchange) == DONE) {
        exchange.request = (const uint8_t *)PyBytes_AS_STRING(request);
        exchange.size = (size_t)PyBytes_GET_SIZE(request);
        result = perform(state, &exchange, serial, arguments[5]);
    }
    Py_XDECREF(begun);
    return result;
}

static PyObject *perform_prepared(State *state, Exchange *exchange, const Template *template, PyObject *value)
{
    long serial;
    PyObject *result = NULL;
    Outcome outcome = read_number(state, exchange->conversation, A_SERIAL, 1, 0xFFFF, &serial);
    if (outcome != DONE)
        return outcome == FAILED ? NULL : Py_NewRef(Py_None);
    Writer writer;
    writer_begin(&writer);
    outcome = put_prepared(state, template, value, (uint16_t)serial, &writer);
    if (outcome == UNUSUAL) {
        result = Py_NewRef(Py_None); /* no layout for the value; nothing was sent, and no serial was used */
    } else if (outcome == DONE && use_serial(state, exchange, serial) == DONE && read_descriptor(state, exchange) == DONE) {
        exchange->request = writer.start;
        exchange->size = writer.size;
        result = perform(state, exchange, (uint16_t)serial, Py_False);
    }
    writer_end(&writer);
    return result;
}

PyObject *exchange_prepared(State *state, PyObject *const *arguments, Py_ssize_t count)
{
    Exchange exchange;
    const Template *template = count == 6 ? template_of(state, arguments[3]) : NULL;
    if (template == NULL && PyErr_Occurred())
        return NULL;
    Outcome outcome = template == NULL ? UNUSUAL : prepare(state, &exchange, arguments, arguments[5]);
    if (outcome == FAILED)
        return NULL;
    if (outcome == UNUSUAL)
        return in_python(state, CALL_PREPARED, arguments, count, NULL);
    return perform_prepared(state, &exchange, template, arguments[4]);
}

/* call_prepared(conversation, link, function, template, value, seconds) */
PyObject *call_prepared(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    return exchange_prepared(state_of(module), arguments, count);
}
#endif
