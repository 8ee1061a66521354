"""Virtual devices: providers that behave like the real controllers, without hardware, sockets or waiting."""
