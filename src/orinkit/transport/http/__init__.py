"""e-CAP over HTTP, client side."""
