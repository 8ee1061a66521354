"""Trajectories: reading, checking, retiming, resampling."""
