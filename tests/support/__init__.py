"""Helpers shared by tests of several folders: devices, peers, clocks, cells, programs."""
