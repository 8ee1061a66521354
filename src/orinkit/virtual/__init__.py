"""Virtual devices, which behave like the real controllers and drivers; they require neither hardware nor sockets."""
