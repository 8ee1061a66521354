"""b-CAP without I/O: packets, and the client and server sides of a conversation. No sockets, no clock."""
