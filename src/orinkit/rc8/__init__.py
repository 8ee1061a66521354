"""The vocabulary of RC8 controllers, for clients and servers: poses, motion options, tasks, slave mode."""
