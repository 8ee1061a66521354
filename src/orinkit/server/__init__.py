"""Servers: they listen at addresses and connect the protocols, implemented without I/O, to the providers' sessions."""
