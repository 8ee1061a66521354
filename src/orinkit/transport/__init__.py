"""Transports: the only package that uses sockets, ports, clocks and waiting.

It has two runners, and one small module per kind of link.
"""
