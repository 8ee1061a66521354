"""Objects for programs that drive ABH3 motor drivers."""
