"""The streaming process, and the side of it that a program has."""
