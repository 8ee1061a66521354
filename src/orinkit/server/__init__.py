"""Servers: they listen at addresses, perform the I/O of the protocols, and pass calls to the providers' sessions."""
