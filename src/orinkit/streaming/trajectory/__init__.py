"""Trajectories: reading, checking, slowing down, resampling."""
