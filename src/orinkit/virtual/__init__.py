"""Virtual devices: providers that behave like the real controller, without hardware, sockets or waiting."""
