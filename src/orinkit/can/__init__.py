"""CAN: frames, buses, shared buses, and servers for devices on a bus."""
