/* Bytes that are being written. */
#include "speedups.h"

HOT void writer_begin(Writer *writer)
{
    writer->start = writer->small;
    writer->size = 0;
    writer->room = sizeof writer->small;
}

HOT void writer_end(Writer *writer)
{
    if (writer->start != writer->small)
        PyMem_Free(writer->start);
}

HOT Outcome writer_reserve(Writer *writer, size_t count)
{
    if (count > MOST_BYTES || writer->size + count > MOST_BYTES)
        return UNUSUAL;
    size_t needed = writer->size + count;
    if (needed <= writer->room)
        return DONE;
    size_t room = needed > MOST_BYTES / 2 ? MOST_BYTES : 2 * needed;
    uint8_t *larger = PyMem_Malloc(room);
    if (larger == NULL) {
        PyErr_NoMemory();
        return FAILED;
    }
    memcpy(larger, writer->start, writer->size);
    writer_end(writer);
    writer->start = larger;
    writer->room = room;
    return DONE;
}

HOT Outcome writer_add(Writer *writer, const void *bytes, size_t count)
{
    Outcome outcome = writer_reserve(writer, count);
    if (outcome == DONE) {
        memcpy(writer->start + writer->size, bytes, count);
        writer->size += count;
    }
    return outcome;
}
