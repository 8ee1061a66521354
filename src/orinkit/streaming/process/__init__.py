"""The streaming process, and the program's interface to it."""
