"""Hardware around the arm that a virtual controller lacks: objects that the tool touches, sensors, areas, buttons."""
