/* Prepared calls of the synchronous client, with its lock: Client.call_prepared in orinkit/client/_sync/client.py. */
#include "speedups.h"

#ifdef WITH_EXCHANGE
/* A call, and what it reads from the client and from the prepared call. */
typedef struct {
    PreparedCall call;
    PyObject *client; /* borrowed */
    /* references, side by side: release_parts() */
    PyObject *conversation, *link, *deadline, *end, *seconds, *native, *serial;
} ClientCall;

HOT static void release_parts(ClientCall *parts)
{
    for (PyObject **part = &parts->conversation; part <= &parts->serial; part++)
        Py_XDECREF(*part);
}

/* Return whether the call may take the direct path, as Client.call_prepared in Python does. */
HOT static Outcome read_parts(State *state, ClientCall *parts)
{
    PreparedCall *call = &parts->call;
    call->conversation = parts->conversation = get_attribute(state, parts->client, A_CONVERSATION);
    call->link = parts->link = get_attribute(state, parts->client, A_LINK);
    call->seconds = parts->seconds = get_attribute(state, parts->client, A_TIMEOUT);
    parts->deadline = get_attribute(state, parts->client, A_DEADLINE);
    parts->end = get_attribute(state, parts->client, A_END);
    parts->native = get_attribute(state, call->prepared, A_NATIVE);
    for (PyObject **part = &parts->conversation; part <= &parts->native; part++)
        if (*part == NULL)
            return FAILED;
    call->template = template_in(parts->native);
    if (call->template == NULL || parts->conversation == Py_None || parts->deadline != Py_None || parts->end != Py_None)
        return UNUSUAL;
    PyObject *direct = get_attribute(state, parts->conversation, A_DIRECT);
    if (direct == NULL || (parts->serial = get_attribute(state, parts->conversation, A_SERIAL)) == NULL) {
        Py_XDECREF(direct);
        return FAILED;
    }
    Py_DECREF(direct); /* a bool */
    return direct == Py_True ? DONE : UNUSUAL;
}

/* Let the client continue the call; the reference to what is unfinished is consumed. */
COLD static PyObject *resume(State *state, const ClientCall *parts, PyObject *unfinished)
{
    PyObject *prepared = parts->call.prepared, *arguments = NULL, *result = NULL;
    PyObject *function = get_attribute(state, prepared, A_FUNCTION);
    if (function != NULL)
        arguments = PyObject_CallMethodOneArg(prepared, state->names[A_ARGUMENTS], parts->call.value);
    if (arguments != NULL)
        result = PyObject_CallMethodObjArgs(parts->client, state->names[A_RESUME], function, arguments, parts->seconds,
                                            unfinished, NULL);
    Py_XDECREF(function);
    Py_XDECREF(arguments);
    Py_DECREF(unfinished);
    return result;
}

/* Call a method of the client with the current exception, which remains set. */
COLD static void break_off(State *state, const ClientCall *parts)
{
    PyObject *type, *error, *trace, *done;
    PyErr_Fetch(&type, &error, &trace);
    PyErr_NormalizeException(&type, &error, &trace);
    done = PyObject_CallMethodObjArgs(parts->client, state->names[A_FAILED], parts->call.prepared, error, parts->serial, NULL);
    if (done != NULL) {
        PyErr_Restore(type, error, trace);
        Py_DECREF(done);
        return;
    }
    Py_XDECREF(type);
    Py_XDECREF(error);
    Py_XDECREF(trace);
}

/* Take the result of the call out of the pair of return code and result, whose reference is consumed. */
COLD static Outcome take_result(PyObject *pair, PreparedCall *call)
{
    if (pair == NULL)
        return FAILED;
    if (!PyTuple_CheckExact(pair) || PyTuple_GET_SIZE(pair) != 2)
        PyErr_Format(PyExc_TypeError, "a pair was expected, not %R", pair);
    else
        call->result = Py_NewRef(PyTuple_GET_ITEM(pair, 1));
    Py_DECREF(pair);
    return call->result == NULL ? FAILED : DONE;
}

/* Make the call while the lock of the client is held. UNUSUAL: nothing was sent. */
HOT static Outcome call_locked(State *state, ClientCall *parts)
{
    Outcome outcome = read_parts(state, parts);
    if (outcome != DONE)
        return outcome;
    PreparedCall *call = &parts->call;
    outcome = exchange_prepared(state, call);
    if (outcome == UNUSUAL && call->other != NULL) {
        bool unfinished = (PyObject *)Py_TYPE(call->other) == state->unfinished;
        outcome = take_result(unfinished ? resume(state, parts, call->other) : call->other, call);
    }
    if (outcome == FAILED)
        break_off(state, parts);
    return outcome;
}

/* Remember the methods of this type of locks. */
COLD static Outcome learn_lock(State *state, PyTypeObject *type)
{
    PyObject *acquire = PyObject_GetAttr((PyObject *)type, state->names[A_ACQUIRE]);
    PyObject *release = acquire == NULL ? NULL : PyObject_GetAttr((PyObject *)type, state->names[A_RELEASE]);
    if (release == NULL) {
        Py_XDECREF(acquire);
        return FAILED;
    }
    Py_XSETREF(state->lock_type, Py_NewRef((PyObject *)type));
    Py_XSETREF(state->lock_acquire, acquire);
    Py_XSETREF(state->lock_release, release);
    return DONE;
}

/* Acquire or release the lock. As for attributes, the lookup of the method takes longer than the method. */
HOT static Outcome use_lock(State *state, PyObject *lock, bool acquire)
{
    if ((PyObject *)Py_TYPE(lock) != state->lock_type && learn_lock(state, Py_TYPE(lock)) != DONE)
        return FAILED;
    PyObject *done = PyObject_CallOneArg(acquire ? state->lock_acquire : state->lock_release, lock);
    Py_XDECREF(done);
    return done == NULL ? FAILED : DONE;
}

/* Release the lock while an exception is set, which remains set. */
COLD static void release_after_failure(State *state, PyObject *lock)
{
    PyObject *type, *error, *trace;
    PyErr_Fetch(&type, &error, &trace);
    if (use_lock(state, lock, false) != DONE)
        PyErr_Clear();
    PyErr_Restore(type, error, trace);
}

/* call_prepared_by_client(client, prepared, value) */
HOT PyObject *call_prepared_by_client(PyObject *module, PyObject *const *arguments, Py_ssize_t count)
{
    State *state = state_of(module);
    if (count != 3)
        return in_python(state, CALL_PREPARED_BY_CLIENT, arguments, count, NULL);
    ClientCall parts = {.client = arguments[0], .call = {.prepared = arguments[1], .value = arguments[2]}};
    PyObject *lock = get_attribute(state, parts.client, A_LOCK);
    Outcome outcome = lock == NULL ? FAILED : use_lock(state, lock, true);
    if (outcome == DONE) {
        outcome = call_locked(state, &parts);
        if (outcome == FAILED)
            release_after_failure(state, lock);
        else if (use_lock(state, lock, false) != DONE)
            outcome = FAILED;
    }
    release_parts(&parts);
    Py_XDECREF(lock);
    if (outcome == UNUSUAL)
        return in_python(state, CALL_PREPARED_BY_CLIENT, arguments, count, NULL);
    if (outcome == FAILED)
        Py_CLEAR(parts.call.result);
    return parts.call.result;
}
#endif
