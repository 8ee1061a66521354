"""Transports: the code that uses sockets, serial ports and clocks; the implementations of the protocols use none.

The package contains two runners, which perform the I/O of protocol operations, and a small module for each kind of
link. A link is the client's side of a connection: the object that sends and receives the bytes.
"""
