"""Transports: the only place with sockets, ports, clocks and waiting. Two drivers, one small module per kind of link."""
