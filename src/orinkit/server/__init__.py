"""Servers: listeners around the protocol cores and the providers' sessions."""
