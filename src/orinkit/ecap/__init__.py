"""e-CAP without I/O: bodies of requests and replies, and the client side of a conversation.

The package uses neither sockets nor a clock.
"""
