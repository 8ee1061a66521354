"""Protocol logic of a host of ABH3 drivers, without I/O."""
