"""The robot of the virtual RC8: its arm, who may move it, what it is told, and the objects that clients hold."""
