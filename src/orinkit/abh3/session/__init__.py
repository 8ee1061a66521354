"""Conversations with an ABH3, without I/O."""
