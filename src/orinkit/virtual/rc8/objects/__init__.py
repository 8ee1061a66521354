"""The CAO objects that clients of the virtual RC8 hold."""
