"""CAO: the object model that every ORiN protocol carries: its functions, what a device serves, one client's session."""
