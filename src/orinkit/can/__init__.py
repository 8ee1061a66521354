"""CAN: frames, buses, buses that are shared, devices served on a bus."""
