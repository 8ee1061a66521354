"""e-CAP server over HTTP."""
