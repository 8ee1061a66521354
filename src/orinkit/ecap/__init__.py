"""e-CAP, sans-IO: bodies of requests and replies, and the client's side. Nothing here opens a socket or reads a clock."""
