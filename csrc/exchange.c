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
HOT static double now(void)
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
    PyObject *conversation, *link, *function, *prepared, *seconds; /* borrowed; function may be NULL: see PreparedCall */
    const Template *template; /* NULL if the call is not prepared */
    double end;         /* of the wait for the reply */
    int descriptor;
    const uint8_t *request;
    size_t size;
    ssize_t sent, received; /* as the system calls return them */
    int error;
    uint8_t reply[RECEIVED_MOST];
} Exchange;

HOT static Outcome read_number(State *state, PyObject *object, Attribute name, long low, long high, long *number)
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
HOT static Outcome read_descriptor(State *state, Exchange *exchange)
{
    long descriptor = -1;
    Outcome outcome = read_number(state, exchange->link, A_DESCRIPTOR, -1, INT32_MAX, &descriptor);
    exchange->descriptor = outcome == DONE ? (int)descriptor : -1;
    return outcome == FAILED ? FAILED : DONE;
}

/* Send and receive, without Python. The send does not wait for a peer that does not read: Python sends the rest. */
HOT static void transfer(Exchange *exchange)
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
COLD static Outcome continue_wait(State *state, Exchange *exchange)
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
HOT static Outcome run_transfer(State *state, Exchange *exchange)
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
COLD static Outcome report(State *state, Exchange *exchange, int error)
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
COLD static PyObject *continue_in_python(State *state, Exchange *exchange)
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

HOT static Outcome read_conversation_limits(State *state, const Exchange *exchange, Limits *limits)
{
    PyObject *object = get_attribute(state, exchange->conversation, A_LIMITS);
    if (object == NULL)
        return FAILED;
    Outcome outcome = read_limits(state, object, limits);
    Py_DECREF(object);
    return outcome;
}

/* Read the result of the call. UNUSUAL: Python reads it, or reports the error. */
HOT static Outcome read_result(State *state, Exchange *exchange, const Limits *limits, bool exact, PyObject **value)
{
    int kind = exchange->template != NULL ? (int)exchange->template->result : result_kind(state, exchange->function);
    if (kind < 0)
        return FAILED;
    if (kind == NO_RESULT) {
        *value = Py_NewRef(Py_None);
        return DONE;
    }
    if (load_u16(exchange->reply + 13) == 0 || exact)
        return UNUSUAL;
    long long budget = limits->variants;
    size_t stop;
    Outcome outcome = read_argument(state, exchange->reply, PACKET_HEAD, (size_t)exchange->received - 1, limits, false,
                                    &budget, value, &stop);
    if (outcome != DONE || kind == ANY_RESULT || (kind == INTEGER_RESULT && PyLong_CheckExact(*value)) ||
        (kind == STRING_RESULT && PyUnicode_CheckExact(*value)))
        return outcome;
    Py_CLEAR(*value);
    return UNUSUAL;
}

/* Read a reply that is exactly one packet with the serial and a success code, within the limits. */
HOT static Outcome read_reply(State *state, Exchange *exchange, uint16_t serial, bool exact, uint32_t *code, PyObject **value)
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
COLD static PyObject *finish_in_python(State *state, Exchange *exchange, uint16_t serial, PyObject *exact, PyObject *received)
{
    PyObject *function = exchange->function == NULL ? get_attribute(state, exchange->prepared, A_FUNCTION)
                                                    : Py_NewRef(exchange->function);
    PyObject *number = PyLong_FromLong(serial), *result = NULL;
    if (function != NULL && number != NULL)
        result = PyObject_CallMethodObjArgs(exchange->conversation, state->names[A_FINISH], function, number, received, exact,
                                            NULL);
    if (result == Py_None) {
        Py_DECREF(result);
        result = PyObject_CallFunction(state->unfinished, "OOd", number, received, exchange->end);
    }
    Py_XDECREF(function);
    Py_XDECREF(number);
    Py_DECREF(received);
    return result;
}

/* Return the outcome of a transfer that was not followed by exactly the reply. */
COLD static PyObject *finish_unusual(State *state, Exchange *exchange, uint16_t serial, PyObject *exact)
{
    PyObject *received;
    int error = exchange->error;
    if (exchange->sent != (ssize_t)exchange->size) {
        if (exchange->sent < 0 && error != EAGAIN && error != EINTR && report(state, exchange, error) != DONE)
            return NULL;
        received = continue_in_python(state, exchange);
    } else if (exchange->received > 0) {
        received = PyBytes_FromStringAndSize((const char *)exchange->reply, (Py_ssize_t)exchange->received);
    } else if (exchange->received == 0) {
        received = report(state, exchange, 0) == DONE ? PyBytes_FromStringAndSize("", 0) : NULL;
    } else {
        received = error == EAGAIN || report(state, exchange, error) == DONE ? Py_NewRef(Py_None) : NULL;
    }
    return received == NULL ? NULL : finish_in_python(state, exchange, serial, exact, received);
}

/* Send the request, receive, and read the reply. UNUSUAL: "other" is what a call in Python returns. */
HOT static Outcome perform(State *state, Exchange *exchange, uint16_t serial, PyObject *exact, PreparedCall *call)
{
    exchange->end = now() + PyFloat_AS_DOUBLE(exchange->seconds);
    Outcome outcome = run_transfer(state, exchange);
    if (outcome == DONE)
        outcome = exchange->received > 0 ? read_reply(state, exchange, serial, exact == Py_True, &call->code, &call->result)
                                         : UNUSUAL;
    if (outcome == UNUSUAL)
        call->other = finish_unusual(state, exchange, serial, exact);
    return outcome == UNUSUAL && call->other == NULL ? FAILED : outcome;
}

/* --- functions for Python ------------------------------------------------------------------------------------------ */

/* Fill in the parts of an exchange, and prepare the socket. UNUSUAL: the link has no socket for this. */
HOT static Outcome prepare(State *state, Exchange *exchange, const PreparedCall *call)
{
    exchange->conversation = call->conversation;
    exchange->link = call->link;
    exchange->function = call->function;
    exchange->prepared = call->prepared;
    exchange->template = call->template;
    exchange->seconds = call->seconds;
    if (!PyFloat_CheckExact(call->seconds))
        return UNUSUAL;
    PyObject *set = get_attribute(state, call->link, A_KERNEL_SECONDS);
    if (set == NULL) {
        if (!PyErr_ExceptionMatches(PyExc_AttributeError))
            return FAILED;
        PyErr_Clear();
        return UNUSUAL;
    }
    bool equal = PyFloat_CheckExact(set) && PyFloat_AS_DOUBLE(set) == PyFloat_AS_DOUBLE(call->seconds);
    Py_DECREF(set);
    return equal ? DONE : call_link(exchange, state->names[A_USE_KERNEL_TIMEOUT], call->seconds);
}

/* Return what the functions for Python return, or let the Python function make the call. */
static PyObject *outcome_of(State *state, const PreparedCall *call, Outcome outcome, FunctionNumber number,
                            PyObject *const *arguments, Py_ssize_t count)
{
    if (outcome == DONE)
        return new_pair(PyLong_FromUnsignedLong(call->code), call->result);
    if (outcome == UNUSUAL)
        return call->other != NULL ? call->other : in_python(state, number, arguments, count, NULL);
    return NULL;
}

/* Encode the request in Python, and perform the call. */
static Outcome exchange_call(State *state, Exchange *exchange, PyObject *arguments, PyObject *exact, PreparedCall *call)
{
    PyObject *begun = PyObject_CallMethodObjArgs(call->conversation, state->names[A_BEGIN], call->function, arguments, NULL);
    unsigned short serial;
    PyObject *request;
    Outcome outcome = FAILED;
    if (begun != NULL && PyArg_ParseTuple(begun, "HS", &serial, &request) && read_descriptor(state, exchange) == DONE) {
        exchange->request = (const uint8_t *)PyBytes_AS_STRING(request);
        exchange->size = (size_t)PyBytes_GET_SIZE(request);
        outcome = perform(state, exchange, serial, exact, call);
    }
    Py_XDECREF(begun);
    return outcome;
}

/* call(conversation, link, function, arguments, seconds, exact) */
PyObject *call(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    State *state = state_of(module);
    Exchange exchange;
    PreparedCall call = {0};
    Outcome outcome = UNUSUAL;
    if (count == 6 && PyBool_Check(arguments[5])) {
        call.conversation = arguments[0];
        call.link = arguments[1];
        call.function = arguments[2];
        call.seconds = arguments[4];
        outcome = prepare(state, &exchange, &call);
        if (outcome == DONE)
            outcome = exchange_call(state, &exchange, arguments[3], arguments[5], &call);
    }
    return outcome_of(state, &call, outcome, CALL, arguments, count);
}

HOT static Outcome use_serial(State *state, PyObject *conversation, long serial)
{
    PyObject *next = PyLong_FromLong(serial % 0xFFFF + 1);
    Outcome outcome = next == NULL ? FAILED : set_attribute(state, conversation, A_SERIAL, next);
    Py_XDECREF(next);
    return outcome;
}

HOT Outcome exchange_prepared(State *state, PreparedCall *call)
{
    Exchange exchange;
    long serial;
    Outcome outcome = prepare(state, &exchange, call);
    if (outcome == DONE)
        outcome = read_number(state, call->conversation, A_SERIAL, 1, 0xFFFF, &serial);
    if (outcome != DONE)
        return outcome;
    Writer writer;
    writer_begin(&writer);
    outcome = put_prepared(state, call->template, call->value, (uint16_t)serial, &writer);
    if (outcome == DONE)
        outcome = use_serial(state, call->conversation, serial);
    if (outcome == DONE)
        outcome = read_descriptor(state, &exchange);
    if (outcome == DONE) {
        exchange.request = writer.start;
        exchange.size = writer.size;
        outcome = perform(state, &exchange, (uint16_t)serial, Py_False, call);
    }
    writer_end(&writer);
    return outcome;
}

/* Return the template in a RequestTemplate; NULL if it has none, or with an exception. */
static const Template *template_of(State *state, PyObject *object)
{
    PyObject *capsule = get_attribute(state, object, A_NATIVE);
    if (capsule == NULL)
        return NULL;
    const Template *template = template_in(capsule);
    Py_DECREF(capsule); /* the RequestTemplate keeps it */
    return template;
}

/* call_prepared(conversation, link, function, template, value, seconds) */
PyObject *call_prepared(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    State *state = state_of(module);
    PreparedCall call = {0};
    Outcome outcome = UNUSUAL;
    call.template = count == 6 ? template_of(state, arguments[3]) : NULL;
    if (call.template != NULL) {
        call.conversation = arguments[0];
        call.link = arguments[1];
        call.function = arguments[2];
        call.value = arguments[4];
        call.seconds = arguments[5];
        outcome = exchange_prepared(state, &call);
    } else if (PyErr_Occurred()) {
        return NULL;
    }
    return outcome_of(state, &call, outcome, CALL_PREPARED, arguments, count);
}
#endif
