"""e-CAP over HTTP, server side."""
