"""Planners: commands that stay within the limits of an arm."""
