"""Planners, whose commands stay within the limits of an arm."""
