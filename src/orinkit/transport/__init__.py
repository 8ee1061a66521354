"""Transports: sockets, serial ports, clocks and waiting, which the implementations of the protocols do not use.

The package contains two runners of protocol operations, and one small module per kind of link.
"""
