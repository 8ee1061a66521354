"""Client side of e-CAP over HTTP."""
