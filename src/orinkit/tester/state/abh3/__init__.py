"""The state of ABH3 motor drivers: frames, polled values, driving, and parameters."""
