"""b-CAP without I/O: packets, and the client and server sides of a conversation.

The package uses neither sockets nor a clock.
"""
