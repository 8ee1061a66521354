"""b-CAP, sans-IO: packets and the two sides of a conversation. Nothing here opens a socket or reads a clock."""
