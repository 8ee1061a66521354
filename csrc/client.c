/* Prepared calls of the synchronous client, with its lock: Client.call_prepared in orinkit/client/_sync/client.py. */
#include "speedups.h"

#ifdef WITH_EXCHANGE
/* What a call reads from the client and from the prepared call. */
typedef struct {
    PyObject *client, *prepared, *value; /* borrowed */
    PyObject *conversation, *deadline, *end, *seconds, *link, *function, *template, *serial;
} ClientCall;

static void release_parts(ClientCall *call)
{
    for (PyObject **part = &call->conversation; part <= &call->serial; part++)
        Py_XDECREF(*part);
}

/* Return whether the call may take the direct path, as Client.call_prepared in Python does. */
static Outcome read_parts(State *state, ClientCall *call)
{
    call->conversation = get_attribute(state, call->client, A_CONVERSATION);
    call->deadline = get_attribute(state, call->client, A_DEADLINE);
    call->end = get_attribute(state, call->client, A_END);
    call->seconds = get_attribute(state, call->client, A_TIMEOUT);
    call->link = get_attribute(state, call->client, A_LINK);
    call->function = get_attribute(state, call->prepared, A_FUNCTION);
    call->template = get_attribute(state, call->prepared, A_TEMPLATE);
    for (PyObject **part = &call->conversation; part <= &call->template; part++)
        if (*part == NULL)
            return FAILED;
    if (call->conversation == Py_None || call->template == Py_None || call->deadline != Py_None || call->end != Py_None)
        return UNUSUAL;
    PyObject *direct = get_attribute(state, call->conversation, A_DIRECT);
    if (direct == NULL || (call->serial = get_attribute(state, call->conversation, A_SERIAL)) == NULL) {
        Py_XDECREF(direct);
        return FAILED;
    }
    Py_DECREF(direct); /* a bool */
    return direct == Py_True ? DONE : UNUSUAL;
}

/* Let the client continue the call; the reference to what is unfinished is consumed. */
static PyObject *resume(State *state, const ClientCall *call, PyObject *unfinished)
{
    PyObject *result = NULL;
    PyObject *arguments = PyObject_CallMethodOneArg(call->prepared, state->names[A_ARGUMENTS], call->value);
    if (arguments != NULL)
        result = PyObject_CallMethodObjArgs(call->client, state->names[A_RESUME], call->function, arguments, call->seconds,
                                            unfinished, NULL);
    Py_XDECREF(arguments);
    Py_DECREF(unfinished);
    return result;
}

/* Call a method of the client with the current exception, which remains set. */
static void break_off(State *state, const ClientCall *call)
{
    PyObject *type, *error, *trace, *done;
    PyErr_Fetch(&type, &error, &trace);
    PyErr_NormalizeException(&type, &error, &trace);
    done = PyObject_CallMethodObjArgs(call->client, state->names[A_FAILED], call->prepared, error, call->serial, NULL);
    if (done != NULL) {
        PyErr_Restore(type, error, trace);
        Py_DECREF(done);
        return;
    }
    Py_XDECREF(type);
    Py_XDECREF(error);
    Py_XDECREF(trace);
}

/* Make the call while the lock of the client is held. Return its code and result; None if nothing was sent. */
static PyObject *call_locked(State *state, ClientCall *call)
{
    Outcome outcome = read_parts(state, call);
    if (outcome != DONE)
        return outcome == FAILED ? NULL : Py_NewRef(Py_None);
    PyObject *const arguments[] = {call->conversation, call->link, call->function, call->template, call->value, call->seconds};
    PyObject *result = exchange_prepared(state, arguments, 6);
    if (result != NULL && (PyObject *)Py_TYPE(result) == state->unfinished)
        result = resume(state, call, result);
    if (result == NULL)
        break_off(state, call);
    return result;
}

/* Call a method of the lock, also while an exception is set. */
static Outcome use_lock(State *state, PyObject *lock, Attribute method)
{
    PyObject *type, *error, *trace;
    PyErr_Fetch(&type, &error, &trace);
    PyObject *done = PyObject_CallMethodNoArgs(lock, state->names[method]);
    if (done == NULL) {
        Py_XDECREF(type);
        Py_XDECREF(error);
        Py_XDECREF(trace);
        return FAILED;
    }
    Py_DECREF(done);
    PyErr_Restore(type, error, trace);
    return DONE;
}

/* call_prepared_by_client(client, prepared, value) */
PyObject *call_prepared_by_client(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    State *state = state_of(module);
    if (count != 3)
        return in_python(state, CALL_PREPARED_BY_CLIENT, arguments, count, NULL);
    ClientCall call = {.client = arguments[0], .prepared = arguments[1], .value = arguments[2]};
    PyObject *lock = get_attribute(state, call.client, A_LOCK), *result = NULL;
    if (lock != NULL && use_lock(state, lock, A_ACQUIRE) == DONE) {
        result = call_locked(state, &call);
        if (use_lock(state, lock, A_RELEASE) != DONE)
            Py_CLEAR(result);
    }
    release_parts(&call);
    Py_XDECREF(lock);
    if (result == Py_None) {
        Py_DECREF(result);
        return in_python(state, CALL_PREPARED_BY_CLIENT, arguments, count, NULL);
    }
    PyObject *value = result == NULL ? NULL : Py_NewRef(PyTuple_GET_ITEM(result, 1));
    Py_XDECREF(result);
    return value;
}
#endif
